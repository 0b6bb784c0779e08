//! The same measurements in depth images of a real Kinect, on whatever is flat in them.

use super::Observation;
use super::measure::mean_step;
use crate::camera::png::read_depth;
use crate::camera::{DepthImage, Intrinsics};
use anyhow::{Context, Result};
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

/// Side of the square patches that planes are fitted to, px.
const PATCH: usize = 24;
/// Distances are gathered in bins of this width, m.
const BIN: f64 = 0.25;
/// A patch counts as flat when its depths scatter by less than this many steps about the plane.
/// Real planes scatter by half a step.
const FLAT: f64 = 1.5;
/// The sensor's step of depth at 1 m, from f = 580 px, b = 75 mm and 1/8 px.
const STEP_AT_1_M: f64 = 1.0 / 348.0;

fn bin_centre(z: f64) -> f64 {
    ((z / BIN).floor() + 0.5) * BIN
}

/// Measures the frame at `path`. Pixels are those of a Kinect, 640x480.
pub fn measure(path: &Path, name: &str) -> Result<Vec<Observation>> {
    // Only the size matters here: planes are planes in 1 / z over the pixels of any pinhole camera.
    let camera = Intrinsics {
        width: 640,
        height: 480,
        fx: 525.0,
        fy: 525.0,
        cx: 319.5,
        cy: 239.5,
    };
    let image = read_depth(path, &camera).with_context(|| path.display().to_string())?;
    let observation = |measurement: &str, distance| Observation {
        measurement: measurement.to_owned(),
        source: name.to_owned(),
        distance_m: distance,
        ..Observation::default()
    };
    let mut found = Vec::new();
    for top in (0..image.height + 1 - PATCH).step_by(PATCH) {
        for left in (0..image.width + 1 - PATCH).step_by(PATCH) {
            if let Some((z, sd)) = plane_scatter(&image, left, top) {
                let distance = bin_centre(z);
                found.push(Observation {
                    axial_sd_mm: Some(sd * (distance / z).powi(2) * 1000.0),
                    pixels: PATCH * PATCH,
                    ..observation("real plane", distance)
                });
            }
        }
    }
    let metres = image
        .pixels
        .iter()
        .filter(|&&mm| mm > 0)
        .map(|&mm| f64::from(mm) / 1000.0);
    let mut by_bin = std::collections::BTreeMap::<u64, Vec<f64>>::new();
    for z in metres.filter(|&z| z < 5.0) {
        by_bin.entry((z / BIN) as u64).or_default().push(z);
    }
    for depths in by_bin.values().filter(|depths| depths.len() >= 2000) {
        let distance = bin_centre(depths[0]);
        found.push(Observation {
            depth_step_mm: mean_step(depths.iter().copied(), distance),
            pixels: depths.len(),
            ..observation("real step", distance)
        });
    }
    Ok(found)
}

/// Mean depth of a patch and the standard deviation about its plane, metres, when the patch is
/// valid to 95 % and flat. On a plane 1 / z = a + b u + c v, fitted here by least squares.
fn plane_scatter(image: &DepthImage, left: usize, top: usize) -> Option<(f64, f64)> {
    let mut points = Vec::new();
    for row in 0..PATCH {
        for column in 0..PATCH {
            let mm = image.pixels[(top + row) * image.width + left + column];
            if mm > 0 {
                points.push((
                    Vector3::new(1.0, column as f64, row as f64),
                    f64::from(mm) / 1000.0,
                ));
            }
        }
    }
    if points.len() * 20 < PATCH * PATCH * 19 {
        return None;
    }
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (place, z) in &points {
        normal += place * place.transpose();
        right += place / *z;
    }
    let plane = normal.try_inverse()? * right;
    let n = points.len() as f64;
    let squares: f64 = points
        .iter()
        .map(|(place, z)| (z - 1.0 / plane.dot(place)).powi(2))
        .sum();
    let sd = (squares / (n - 3.0)).sqrt();
    let mean = points.iter().map(|(_, z)| z).sum::<f64>() / n;
    (sd < FLAT * STEP_AT_1_M * mean * mean).then_some((mean, sd))
}
