//! Our side of `compare_open3d.py`, which calls it:
//!
//! - `compare_frame export DIR` writes the scene: `triangles.f32`, three corners each in the camera's
//!   optical frame (m, little-endian).
//! - `compare_frame time FRAMES` prints the milliseconds of each of so many frames on one thread: posing,
//!   the camera's and the projector's raster pass, and the sensor.

use anyhow::{Context, Result, bail};
use armpose::experiment::tasks::frame_times::CrowdedScene;
use nalgebra::Point3;
use std::path::Path;

fn main() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scene = CrowdedScene::read(root)?;
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["export", folder] => export(&scene, Path::new(folder)),
        ["time", frames] => {
            for ms in scene.time(root, frames.parse().context("FRAMES")?)? {
                println!("{ms}");
            }
            Ok(())
        }
        _ => bail!("compare_frame export DIR | time FRAMES"),
    }
}

fn export(scene: &CrowdedScene, folder: &Path) -> Result<()> {
    let mut file = Vec::new();
    for body in scene.bodies() {
        for corner in body.mesh.triangles.iter().flatten() {
            let vertex = body.mesh.vertices[*corner as usize].map(f64::from);
            let point = body.camera_from_mesh * Point3::from(vertex);
            for x in point.iter() {
                file.extend((*x as f32).to_le_bytes());
            }
        }
    }
    std::fs::write(folder.join("triangles.f32"), file)?;
    Ok(())
}
