//! The camera against exact rays and the published formulas of structured-light sensors.

mod camera_scene;

use armpose::camera::{Body, Camera, CameraError, Gaussian, Intrinsics, Noise, Photographer};
use armpose::random::{Stream, below, stream, uniform};
use armpose::robot::Mesh;
use camera_scene::{Thing, bodies, cuboid, furnished_room};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::path::{Path, PathBuf};

fn preset(name: &str) -> Camera {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/cameras");
    Camera::read(&folder.join(name).with_extension("toml")).expect("a sound preset")
}

fn without_noise() -> Camera {
    let mut camera = preset("realistic");
    camera.projector.as_mut().expect("a projector").noise = None;
    camera
}

fn noise() -> Stream {
    stream(5, "camera tests", &[])
}

/// A slab whose front lies at depth `z`, turned about the vertical by `angle`.
fn wall(size: f32, x: f64, z: f64, angle: f64) -> Thing {
    let turned = UnitQuaternion::from_euler_angles(0.0, angle, 0.0);
    let half_thickness = turned * Vector3::new(0.0, 0.0, 0.05);
    Thing {
        mesh: cuboid([size, size, 0.1], false),
        camera_from_mesh: Isometry3::from_parts(
            Translation3::from(Vector3::new(x, 0.0, z) + half_thickness),
            turned,
        ),
    }
}

/// All triangles of a scene in the camera's frame.
struct Rays {
    triangles: Vec<([Vector3<f64>; 3], u8)>,
}

impl Rays {
    fn new(bodies: &[Body]) -> Rays {
        let placed = |body: &Body, corner: u32| {
            let [x, y, z] = body.mesh.vertices[corner as usize].map(f64::from);
            (body.camera_from_mesh * nalgebra::Point3::new(x, y, z)).coords
        };
        let of_body = |body: &Body| -> Vec<_> {
            let triangles = body.mesh.triangles.iter();
            triangles
                .map(|t| (t.map(|i| placed(body, i)), body.label))
                .collect()
        };
        Rays {
            triangles: bodies.iter().flat_map(of_body).collect(),
        }
    }

    /// The least `t` in `range` at which `origin + t direction` meets a triangle, and its label
    /// (Moeller and Trumbore 1997).
    fn cast(
        &self,
        origin: Vector3<f64>,
        direction: Vector3<f64>,
        range: std::ops::Range<f64>,
    ) -> Option<(f64, u8)> {
        let mut nearest = None;
        let mut end = range.end;
        for &([a, b, c], label) in &self.triangles {
            let (ab, ac, from) = (b - a, c - a, origin - a);
            let p = direction.cross(&ac);
            let det = ab.dot(&p);
            let u = from.dot(&p) / det;
            let q = from.cross(&ab);
            let v = direction.dot(&q) / det;
            let t = ac.dot(&q) / det;
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= range.start && t < end {
                end = t;
                nearest = Some((t, label));
            }
        }
        nearest
    }

    /// Depth in metres and label at a place of the image.
    fn seen(&self, camera: &Intrinsics, u: f64, v: f64) -> Option<(f64, u8)> {
        let direction = Vector3::new(
            (u - camera.cx) / camera.fx,
            (v - camera.cy) / camera.fy,
            1.0,
        );
        self.cast(Vector3::zeros(), direction, 0.05..f64::INFINITY)
    }
}

fn random_pixels(
    camera: &Intrinsics,
    count: usize,
    seed: u64,
) -> impl Iterator<Item = (usize, usize)> {
    let mut s = stream(seed, "pixels", &[]);
    let (width, height) = (camera.width, camera.height);
    (0..count).map(move |_| (below(&mut s, width), below(&mut s, height)))
}

#[test]
fn depth_and_labels_are_those_of_exact_rays() {
    let camera = preset("ideal");
    let things = furnished_room(4, 24);
    let bodies = bodies(&things);
    let drawing = Photographer::new(&camera).draw(&bodies);
    let rays = Rays::new(&bodies);
    let i = &camera.intrinsics;
    let mut errors = Vec::new();
    let pixels: Vec<_> = random_pixels(i, 2500, 1).collect();
    for &(column, row) in &pixels {
        let (u, v) = (column as f64, row as f64);
        let around = [
            (0.0, 0.0),
            (-1e-3, 0.0),
            (1e-3, 0.0),
            (0.0, -1e-3),
            (0.0, 1e-3),
        ]
        .map(|(du, dv)| rays.seen(i, u + du, v + dv));
        let Some((depth, label)) = around[0] else {
            panic!("the room is closed");
        };
        let smooth = around
            .iter()
            .flatten()
            .all(|&(z, l)| l == label && (z - depth).abs() < 0.01);
        if smooth {
            let pixel = row * i.width + column;
            assert_eq!(drawing.labels.pixels[pixel], label, "at ({column}, {row})");
            errors.push((f64::from(drawing.depth.pixels[pixel]) - depth).abs());
        }
    }
    assert!(
        errors.len() > pixels.len() * 98 / 100,
        "few pixels are silhouettes"
    );
    errors.sort_by(f64::total_cmp);
    let (worst, high) = (errors[errors.len() - 1], errors[errors.len() * 999 / 1000]);
    println!(
        "depth error: worst {:.3} um, 99.9th percentile {:.3} um",
        worst * 1e6,
        high * 1e6
    );
    assert!(worst < 100e-6 && high < 2e-6);
}

#[test]
fn shadow_is_where_no_ray_of_the_projector_comes() {
    let camera = without_noise();
    let things = furnished_room(4, 24);
    let bodies = bodies(&things);
    let lit = Photographer::new(&camera).lit(&bodies);
    let rays = Rays::new(&bodies);
    let i = &camera.intrinsics;
    let origin = Vector3::new(0.075, 0.0, 0.0);
    let is_lit = |u: f64, v: f64| {
        rays.seen(i, u, v).map(|(z, _)| {
            let point = Vector3::new((u - i.cx) / i.fx, (v - i.cy) / i.fy, 1.0) * z;
            rays.cast(origin, point - origin, 1e-6..1.0 - 1e-4)
                .is_none()
        })
    };
    let (mut inside, mut shadow, mut wrong) = (0, 0, 0);
    for (column, row) in random_pixels(i, 1500, 2) {
        let (u, v) = (column as f64, row as f64);
        let around = [-1.0, 0.0, 1.0].map(|du| is_lit(u + du, v));
        // Borders of shadows are found to a pixel; away from them:
        if around[0] == around[1] && around[1] == around[2] {
            inside += 1;
            shadow += usize::from(around[1] == Some(false));
            wrong += usize::from(around[1] != Some(lit.pixels[row * i.width + column]));
        }
    }
    println!("{inside} pixels away from borders, {shadow} in shadow, {wrong} wrong");
    assert!(inside > 1350 && shadow > 60);
    assert!(wrong * 500 <= inside);
}

/// f b (1 / z_near - 1 / z_far) pixels of shadow, on the left of the near thing.
#[test]
fn shadow_has_the_width_of_the_disparity_jump() {
    let camera = without_noise();
    for (near, far) in [(1.0, 2.0), (1.0, 3.0), (2.0, 3.0), (0.8, 4.5)] {
        let things = [wall(0.4, 0.0, near, 0.0), wall(20.0, 0.0, far, 0.0)];
        let bodies = bodies(&things);
        let mut photographer = Photographer::new(&camera);
        let lit = photographer.lit(&bodies);
        let photo = photographer.photograph(&bodies, &mut noise());
        let row = 240 * 640..241 * 640;
        let labels = &photo.labels.pixels[row.clone()];
        let left = labels
            .iter()
            .position(|&l| l == 1)
            .expect("the near wall is seen");
        let right = labels
            .iter()
            .rposition(|&l| l == 1)
            .expect("the near wall is seen");
        let width = lit.pixels[row.clone()].iter().filter(|&&lit| !lit).count();
        let expected = 43.5 * (1.0 / near - 1.0 / far);
        assert!(
            (width as f64 - expected).abs() < 1.5,
            "{width} px, not {expected}"
        );
        assert!(
            lit.pixels[row.clone()][left - width..left]
                .iter()
                .all(|&lit| !lit)
        );
        let valid = |column: usize| photo.depth.pixels[row.start + column] > 0;
        assert!((left - width + 3..left - 3).all(|column| !valid(column)));
        // Beyond the shadow and the band of edges that the filter cannot resolve, all is valid.
        assert!((20..left - width - 6).chain(right + 10..620).all(valid));
        assert!((left + 6..right - 6).all(valid));
    }
}

#[test]
fn depths_are_whole_steps_of_disparity() {
    let camera = without_noise();
    let things = [wall(20.0, 0.0, 2.5, 0.7)];
    let photo = Photographer::new(&camera).photograph(&bodies(&things), &mut noise());
    let exact = Photographer::new(&camera).draw(&bodies(&things));
    let mut steps = std::collections::BTreeSet::new();
    for (&mm, &z) in photo
        .depth
        .pixels
        .iter()
        .zip(&exact.depth.pixels)
        .filter(|(mm, _)| **mm > 0)
    {
        let z = f64::from(z);
        let code = (8.0 * 43.5 * 1000.0 / f64::from(mm)).round();
        assert_eq!(f64::from(mm), (8.0 * 43.5 * 1000.0 / code).round());
        steps.insert(code as u32);
        // The nearest dot within 3 px gives the disparity, so the error is half a step z^2 / (8 f b)
        // and what the wall falls away by within 3 px, most at the far side of the image.
        let step = z * z / (8.0 * 43.5);
        let slope = 0.7_f64.tan();
        let fall = 3.0 * z / 580.0 * slope / (1.0 - slope * 320.0 / 580.0);
        assert!((f64::from(mm) / 1000.0 - z).abs() < 0.55 * step + fall + 0.0005);
    }
    // No step is left out.
    let (first, last) = (
        *steps.first().expect("valid pixels"),
        *steps.last().expect("some"),
    );
    assert_eq!(steps.len() as u32, last - first + 1);
    assert!(steps.len() > 50);
}

/// The standard deviation of depth on a wall lies between the curves that Khoshelham and Elberink
/// (2012) and Nguyen et al. (2012) measured on real Kinects, or within 15 % of them.
#[test]
fn realistic_noise_is_that_of_real_kinects() {
    let camera = preset("realistic");
    for z in [1.0_f64, 2.0, 3.0] {
        // Slightly slanted, so that all fractions of a disparity step occur.
        let things = [wall(20.0, 0.0, z, 0.1)];
        let mut photographer = Photographer::new(&camera);
        let photo = photographer.photograph(&bodies(&things), &mut noise());
        let exact = photographer.draw(&bodies(&things));
        let pairs = photo.depth.pixels.iter().zip(&exact.depth.pixels);
        // In units of z^2, in which the noise is the same everywhere.
        let errors: Vec<f64> = pairs
            .filter(|(mm, _)| **mm > 0)
            .map(|(&mm, &exact)| {
                (f64::from(mm) / 1000.0 / f64::from(exact) - 1.0) / f64::from(exact)
            })
            .collect();
        assert!(errors.len() > 280_000);
        let sd = z * z * (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        let khoshelham = 1.42e-3 * z * z;
        let nguyen = 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4);
        println!(
            "{z} m: {:.2} mm; {:.2}, {:.2}",
            sd * 1e3,
            khoshelham * 1e3,
            nguyen * 1e3
        );
        assert!(sd > khoshelham.min(nguyen) / 1.15 && sd < khoshelham.max(nguyen) * 1.15);
    }
}

#[test]
fn triangles_through_the_camera_are_cut() {
    let camera = preset("ideal");
    let i = &camera.intrinsics;
    let mut s = stream(9, "near triangles", &[]);
    for _ in 0..40 {
        // A closed tetrahedron around a point near the camera, some of it behind.
        let mut corner = || [0; 3].map(|_| uniform(&mut s, -0.7, 0.7) as f32);
        let vertices = vec![corner(), corner(), corner(), corner()];
        let mesh = Mesh {
            triangles: vec![
                [0, 1, 2],
                [0, 2, 1],
                [0, 3, 1],
                [0, 1, 3],
                [1, 3, 2],
                [1, 2, 3],
                [2, 3, 0],
                [2, 0, 3],
            ],
            vertices,
        };
        let things = [Thing {
            mesh,
            camera_from_mesh: Isometry3::translation(0.0, 0.0, 0.2),
        }];
        let bodies = bodies(&things);
        let drawing = Photographer::new(&camera).draw(&bodies);
        let rays = Rays::new(&bodies);
        let mut wrong = 0;
        for (column, row) in random_pixels(i, 200, 3) {
            let drawn = f64::from(drawing.depth.pixels[row * i.width + column]);
            let exact = rays
                .seen(i, column as f64, row as f64)
                .map_or(f64::INFINITY, |(z, _)| z);
            wrong += usize::from(drawn != exact && (drawn / exact - 1.0).abs() > 1e-5);
        }
        assert!(wrong <= 1, "{wrong} of 200 pixels differ");
    }
}

#[test]
fn an_empty_scene_has_no_depth() {
    for name in ["realistic", "render-kinect", "ideal"] {
        let mut photographer = Photographer::new(&preset(name));
        let photo = photographer.photograph(&[], &mut noise());
        assert!(photo.depth.pixels.iter().all(|&mm| mm == 0));
        assert!(photo.labels.pixels.iter().all(|&label| label == 0));
        assert!(
            photographer
                .draw(&[])
                .depth
                .pixels
                .iter()
                .all(|&z| z == f32::INFINITY)
        );
    }
}

#[test]
fn a_photo_depends_on_scene_and_seed_only() {
    let things = furnished_room(3, 16);
    let bodies = bodies(&things);
    for name in ["realistic", "render-kinect"] {
        let camera = preset(name);
        let fresh = Photographer::new(&camera).photograph(&bodies, &mut noise());
        let mut used = Photographer::new(&camera);
        used.photograph(&bodies[1..4], &mut stream(1, "other", &[]));
        assert!(used.photograph(&bodies, &mut noise()) == fresh);
        assert!(used.photograph(&bodies, &mut stream(1, "other", &[])).depth != fresh.depth);
    }
}

#[test]
fn labels_show_every_surface_and_depths_keep_to_the_range() {
    let things = furnished_room(4, 16);
    let bodies = bodies(&things);
    for name in ["realistic", "render-kinect", "ideal"] {
        let camera = preset(name);
        let mut photographer = Photographer::new(&camera);
        let photo = photographer.photograph(&bodies, &mut noise());
        let drawing = photographer.draw(&bodies);
        assert!(photo.labels == drawing.labels);
        assert!(
            drawing.labels.pixels.iter().all(|&label| label > 0),
            "the room is closed"
        );
        let (near, far) = (camera.range.near_m * 1000.0, camera.range.far_m * 1000.0);
        for (&mm, &z) in photo.depth.pixels.iter().zip(&drawing.depth.pixels) {
            let mm = f64::from(mm);
            assert!(mm == 0.0 || (near..=far).contains(&mm));
            if camera.projector.is_none() && mm > 0.0 {
                assert!((mm - f64::from(z) * 1000.0).abs() <= 0.501);
            }
        }
    }
}

#[test]
fn mistakes_in_a_preset_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let sound = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("data/cameras/realistic.toml"),
    )
    .expect("the preset");
    let read = |text: String| {
        let path: PathBuf = folder.path().join("camera.toml");
        std::fs::write(&path, text).expect("written");
        Camera::read(&path)
    };
    assert!(read(sound.clone()).is_ok());
    for (from, to, message) in [
        ("width = 640", "width = 0", "each side must be"),
        ("fx = 580.0", "fx = -580.0", "fx and fy must be positive"),
        ("far_m = 5.0", "far_m = 0.4", "less than far_m = 0.4"),
        ("far_m = 5.0", "far_m = 80.0", "at most 65"),
        ("baseline_m = 0.075", "baseline_m = nan", "must be positive"),
        (
            "disparity_step_px = 0.125",
            "disparity_step_px = 0.0001",
            "must be less than",
        ),
        (
            "sd_px = 0.055",
            "sd_px = -1.0",
            "sd_px must not be negative",
        ),
        ("baseline_m", "base_line_m", "baseline_m"),
    ] {
        let error = read(sound.replace(from, to)).expect_err(to);
        assert!(error.to_string().contains(message), "{error}");
        assert!(error.to_string().contains("camera.toml"), "{error}");
    }
    assert!(matches!(
        Camera::read(Path::new("nowhere.toml")),
        Err(CameraError::Toml(_))
    ));
    let noise = without_noise().projector.expect("a projector").noise;
    assert_eq!(noise, None);
    let noise = preset("realistic").projector.expect("a projector").noise;
    assert!(matches!(noise, Some(Noise::Gaussian(Gaussian { .. }))));
}
