//! A picture of a robot alone, to be looked at.

use super::DataSetError;
use super::sheet::write_rgb;
use crate::camera::{Body, Camera, Drawing, Intrinsics, Photographer, Range};
use crate::robot::Robot;
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;

const WIDTH: usize = 960;
const HEIGHT: usize = 720;
/// Pixels. The picture is 37 degrees high.
const FOCAL: f64 = 1080.0;
/// Where the viewer stands, seen from the middle of the robot: in front, to its right and above.
const VIEWER: [f64; 3] = [0.8, -0.5, 0.35];
/// The colours of Okabe and Ito, but black: links take them in turn.
const COLOURS: [[f64; 3]; 7] = [
    [86.0, 180.0, 233.0],
    [230.0, 159.0, 0.0],
    [0.0, 158.0, 115.0],
    [240.0, 228.0, 66.0],
    [204.0, 121.0, 167.0],
    [0.0, 114.0, 178.0],
    [213.0, 94.0, 0.0],
];

/// Writes a PNG of a robot in a configuration: seen from its front (x), right (-y) and above, as large
/// as fits, links in turn in seven colours, shaded by how they face the viewer, before black.
pub fn portrait(robot: &Robot, configuration: &[f64], path: &Path) -> Result<(), DataSetError> {
    let poses = robot.forward_kinematics(configuration);
    let camera_from_root = viewpoint(robot, &poses);
    let camera = Camera {
        intrinsics: Intrinsics {
            width: WIDTH,
            height: HEIGHT,
            fx: FOCAL,
            fy: FOCAL,
            cx: (WIDTH - 1) as f64 / 2.0,
            cy: (HEIGHT - 1) as f64 / 2.0,
        },
        range: Range {
            near_m: 0.1,
            far_m: 50.0,
        },
        projector: None,
    };
    let links = robot.links.iter().zip(&poses).enumerate();
    let bodies: Vec<Body> = links
        .filter(|(_, (link, _))| !link.mesh.is_empty())
        .map(|(index, (link, pose))| Body {
            mesh: &link.mesh,
            camera_from_mesh: camera_from_root * pose,
            label: (index % COLOURS.len()) as u8 + 1,
        })
        .collect();
    let drawing = Photographer::new(&camera).draw(&bodies);
    let pixels = (0..WIDTH * HEIGHT).flat_map(|pixel| colour(&drawing, &camera.intrinsics, pixel));
    let pixels: Vec<u8> = pixels.collect();
    write_rgb(path, WIDTH, HEIGHT, &pixels).map_err(|cause| DataSetError::Write {
        path: path.to_owned(),
        cause,
    })
}

/// `camera_from_root` of a camera that has all bodies in view.
fn viewpoint(robot: &Robot, poses: &[Isometry3<f64>]) -> Isometry3<f64> {
    let vertices: Vec<Point3<f64>> = (robot.links.iter().zip(poses))
        .flat_map(|(link, pose)| {
            let placed = move |v: &[f32; 3]| pose * Point3::from(v.map(f64::from));
            link.mesh.vertices.iter().map(placed)
        })
        .collect();
    let bound = |pick: fn(f64, f64) -> f64| {
        let all = vertices.iter().copied().map(|v| v.coords);
        all.reduce(|a, b| a.zip_map(&b, pick)).unwrap_or_default()
    };
    let centre = Point3::from((bound(f64::min) + bound(f64::max)) / 2.0);
    let distances = vertices.iter().map(|v| (v - centre).norm());
    let radius = distances.fold(0.05, f64::max);
    // A ball of this radius touches the upper and lower edges of the picture.
    let distance = radius * (1.0 + (2.0 * FOCAL / HEIGHT as f64).powi(2)).sqrt();
    let viewer = centre + Vector3::from(VIEWER).normalize() * distance;
    // nalgebra's right-handed view looks along -z with y up.
    let view = Isometry3::look_at_rh(&viewer, &centre, &Vector3::z());
    Isometry3::rotation(Vector3::x() * std::f64::consts::PI) * view
}

/// Black where nothing is seen.
fn colour(drawing: &Drawing, intrinsics: &Intrinsics, pixel: usize) -> [u8; 3] {
    let (x, y) = ((pixel % WIDTH) as isize, (pixel / WIDTH) as isize);
    let label = drawing.labels.pixels[pixel];
    if label == 0 {
        return [0; 3];
    }
    let point = |(dx, dy): (isize, isize)| {
        let (x, y) = ((x + dx) as usize, (y + dy) as usize);
        let at = (x < WIDTH && y < HEIGHT).then_some(y * WIDTH + x)?;
        let z = f64::from(drawing.depth.pixels[at]);
        let ray = Vector3::new(
            (x as f64 - intrinsics.cx) / intrinsics.fx,
            (y as f64 - intrinsics.cy) / intrinsics.fy,
            1.0,
        );
        (drawing.labels.pixels[at] == label).then(|| ray * z)
    };
    // The surface's direction from a neighbour in each direction that shows the same link.
    let along = |forth, back| {
        let here = point((0, 0))?;
        point(forth).or(point(back)).map(|there| there - here)
    };
    let normal = along((1, 0), (-1, 0)).zip(along((0, 1), (0, -1)));
    let facing = normal
        .zip(point((0, 0)))
        .map_or(0.5, |((right, down), ray)| {
            right.cross(&down).normalize().dot(&ray.normalize()).abs()
        });
    COLOURS[usize::from(label) - 1].map(|c| (c * (0.25 + 0.75 * facing)) as u8)
}
