//! The robot's meshes against the manufacturer's CAD, where that is at hand: silhouettes and depth
//! in 24 directions, orthographic, 1 mm a pixel.

use armpose::robot::{Mesh, Robot};
use nalgebra::{Matrix3, Vector3};
use std::path::{Path, PathBuf};

/// Our file, the CAD's file, and the least mean overlap of silhouettes.
const LINKS: [(&str, &str, f64); 11] = [
    ("wam1", "wam1", 0.95),
    ("wam2", "wam2", 0.90),
    ("wam3", "wam3", 0.95),
    ("wam4", "wam4", 0.95),
    ("wam5", "wam5", 0.95),
    ("wam6", "wam6", 0.90),
    ("wam7", "wam7", 0.95),
    ("hand_base", "hand_base", 0.95),
    ("finger_knuckle", "finger0_0", 0.88),
    ("finger_proximal", "finger0_1", 0.88),
    ("finger_distal", "finger0_2", 0.88),
];
const VIEWS: usize = 24;
const PIXEL: f64 = 0.001;
/// Bound of the median depth error, m.
const DEPTH_BOUND: f64 = 0.002;

#[test]
fn silhouettes_and_depth_match_the_cad() {
    let shared = std::env::var_os("ARMPOSE_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"),
        PathBuf::from,
    );
    let cad_folder = shared.join("robots/barrett/meshes");
    if !cad_folder.is_dir() {
        println!("skipped: no CAD meshes at {}", cad_folder.display());
        return;
    }
    let our_folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm/meshes");
    let ours = read_meshes(&our_folder, LINKS.map(|(ours, _, _)| ours));
    let cad = read_meshes(&cad_folder, LINKS.map(|(_, cad, _)| cad));

    println!("link              mean IoU  worst IoU  median depth error [mm]");
    let mut below = Vec::new();
    for (((name, _, bound), ours), cad) in LINKS.iter().zip(&ours).zip(&cad) {
        let Comparison { overlaps, median } = compare(ours, cad);
        let mean = overlaps.iter().sum::<f64>() / VIEWS as f64;
        let worst = overlaps.iter().copied().fold(1.0, f64::min);
        println!("{name:<18}{mean:8.4}{worst:11.4}{:12.2}", 1e3 * median);
        if mean < *bound || median > DEPTH_BOUND {
            below.push(name);
        }
    }
    assert!(below.is_empty(), "too far from the CAD: {below:?}");
}

/// Reads mesh files by way of a robot that has one link for each.
fn read_meshes<const N: usize>(folder: &Path, names: [&str; N]) -> Vec<Mesh> {
    let mut urdf = String::from("<robot name=\"r\"><link name=\"root\"/>");
    for name in names {
        let file = folder.join(format!("{name}.stl"));
        urdf += &format!(
            "<link name=\"{name}\"><visual><geometry><mesh filename=\"{}\"/></geometry></visual></link>\
             <joint name=\"{name}\" type=\"fixed\"><parent link=\"root\"/><child link=\"{name}\"/></joint>",
            file.display()
        );
    }
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("meshes.urdf");
    std::fs::write(&path, urdf + "</robot>").unwrap();
    let robot = Robot::from_urdf(&path).unwrap();
    robot.links.into_iter().skip(1).map(|l| l.mesh).collect()
}

struct Comparison {
    /// Intersection over union of the silhouettes, one a view.
    overlaps: Vec<f64>,
    /// Of the absolute depth differences over the pixels that both cover, all views pooled; m.
    median: f64,
}

fn compare(ours: &Mesh, cad: &Mesh) -> Comparison {
    let mut overlaps = Vec::new();
    let mut errors = Vec::new();
    for view in views() {
        let (ours, cad) = (turned(ours, &view), turned(cad, &view));
        let window = Window::around(&[&ours, &cad]);
        let (ours, cad) = (window.draw(&ours), window.draw(&cad));
        let mut common = 0;
        let mut either = 0;
        for (a, b) in ours.iter().zip(&cad) {
            either += usize::from(a.is_finite() || b.is_finite());
            if a.is_finite() && b.is_finite() {
                common += 1;
                errors.push((a - b).abs());
            }
        }
        overlaps.push(common as f64 / either as f64);
    }
    let middle = errors.len() / 2;
    let (_, median, _) = errors.select_nth_unstable_by(middle, f64::total_cmp);
    Comparison {
        overlaps,
        median: *median,
    }
}

/// Rotations whose third rows, the directions of view, lie on a Fibonacci spiral on the sphere.
fn views() -> impl Iterator<Item = Matrix3<f64>> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..VIEWS).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / VIEWS as f64;
        let (sin, cos) = (golden_angle * i as f64).sin_cos();
        let forward = Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        let right = forward.cross(&Vector3::new(-sin, cos, 0.0)).normalize();
        let down = forward.cross(&right);
        Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()])
    })
}

fn turned(mesh: &Mesh, view: &Matrix3<f64>) -> Vec<[Vector3<f64>; 3]> {
    let corner = |i: u32| view * Vector3::from(mesh.vertices[i as usize].map(f64::from));
    mesh.triangles.iter().map(|t| t.map(corner)).collect()
}

/// A raster that covers what is drawn on it.
struct Window {
    low: [f64; 2],
    width: usize,
    height: usize,
}

impl Window {
    fn around(bodies: &[&Vec<[Vector3<f64>; 3]>]) -> Window {
        let corners = || bodies.iter().copied().flatten().flatten();
        let low = [0, 1].map(|i| corners().map(|c| c[i]).fold(f64::INFINITY, f64::min));
        let high = [0, 1].map(|i| corners().map(|c| c[i]).fold(f64::NEG_INFINITY, f64::max));
        let [width, height] = [0, 1].map(|i| ((high[i] - low[i]) / PIXEL).ceil() as usize + 1);
        Window { low, width, height }
    }

    /// Depth at each pixel's centre, infinite where nothing is.
    fn draw(&self, triangles: &[[Vector3<f64>; 3]]) -> Vec<f64> {
        let mut depth = vec![f64::INFINITY; self.width * self.height];
        for corners in triangles {
            let at = corners.map(|c| [0, 1].map(|i| (c[i] - self.low[i]) / PIXEL - 0.5));
            let cross = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| {
                (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
            };
            let area = cross(at[0], at[1], at[2]);
            if area == 0.0 {
                continue;
            }
            let range = |i: usize, size: usize| {
                let least = at.iter().map(|p| p[i]).fold(f64::INFINITY, f64::min);
                let most = at.iter().map(|p| p[i]).fold(f64::NEG_INFINITY, f64::max);
                least.ceil().max(0.0) as usize..((most.floor() + 1.0).max(0.0) as usize).min(size)
            };
            for row in range(1, self.height) {
                for column in range(0, self.width) {
                    let p = [column as f64, row as f64];
                    let weights = [
                        cross(at[1], at[2], p) / area,
                        cross(at[2], at[0], p) / area,
                        cross(at[0], at[1], p) / area,
                    ];
                    if weights.iter().all(|w| *w >= 0.0) {
                        let z: f64 = (0..3).map(|k| weights[k] * corners[k].z).sum();
                        let nearest = &mut depth[row * self.width + column];
                        *nearest = nearest.min(z);
                    }
                }
            }
        }
        depth
    }
}
