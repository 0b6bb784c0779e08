//! Photographs of flat things, and what can be measured in them.

use super::Observation;
use crate::camera::{Body, Photographer};
use crate::random::stream;
use crate::robot::Mesh;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// A camera that is measured, with a photographer of its own.
pub struct Bench<'a> {
    pub name: &'a str,
    pub photographer: Photographer,
    pub seed: u64,
}

/// A slab's mesh and its place: the middle of its front lies at depth `distance` straight ahead.
pub struct Slab {
    mesh: Mesh,
    camera_from_mesh: Isometry3<f64>,
}

impl Slab {
    /// `side` metres wide and high, turned about the vertical by `slant` degrees.
    pub fn new(side: f32, distance: f64, slant: f64) -> Slab {
        const THICKNESS: f32 = 0.02;
        let half = [side / 2.0, side / 2.0, THICKNESS / 2.0];
        let corner = |i: usize| {
            [0, 1, 2].map(|axis| {
                if i >> axis & 1 == 1 {
                    half[axis]
                } else {
                    -half[axis]
                }
            })
        };
        let turned = UnitQuaternion::from_euler_angles(0.0, slant.to_radians(), 0.0);
        let centre = Vector3::new(0.0, 0.0, distance) + turned * Vector3::z() * f64::from(half[2]);
        Slab {
            mesh: Mesh {
                vertices: (0..8).map(corner).collect(),
                triangles: vec![
                    [0, 2, 1],
                    [1, 2, 3],
                    [4, 5, 6],
                    [5, 7, 6], // front and back
                    [0, 1, 4],
                    [1, 5, 4],
                    [2, 6, 3],
                    [3, 6, 7], // above and below
                    [0, 4, 2],
                    [2, 4, 6],
                    [1, 3, 5],
                    [3, 7, 5], // left and right
                ],
            },
            camera_from_mesh: Isometry3::from_parts(Translation3::from(centre), turned),
        }
    }

    fn body(&self, label: u8) -> Body<'_> {
        Body {
            mesh: &self.mesh,
            camera_from_mesh: self.camera_from_mesh,
            label,
        }
    }
}

impl Bench<'_> {
    fn observation(&self, measurement: &str, distance: f64, frame: usize) -> Observation {
        Observation {
            measurement: measurement.to_owned(),
            source: self.name.to_owned(),
            distance_m: distance,
            frame,
            ..Observation::default()
        }
    }

    /// A wall that fills the view: how depth scatters about the truth, how far neighbouring depths
    /// are apart, how much is valid. Only pixels within 5 % of `distance` count, and what grows
    /// with z^2 is brought to `distance`.
    pub fn wall(
        &mut self,
        measurement: &str,
        distance: f64,
        slant: f64,
        frame: usize,
    ) -> Observation {
        let slab = Slab::new(40.0, distance, slant);
        let bodies = [slab.body(1)];
        let axes = [distance.to_bits(), slant.to_bits(), frame as u64];
        let photo = self
            .photographer
            .photograph(&bodies, &mut stream(self.seed, "sensor wall", &axes));
        let exact = self.photographer.draw(&bodies);
        let near = |z: f64| (z / distance - 1.0).abs() < 0.05;
        let pairs: Vec<(f64, f64)> = photo
            .depth
            .pixels
            .iter()
            .zip(&exact.depth.pixels)
            .map(|(&mm, &z)| (f64::from(mm) / 1000.0, f64::from(z)))
            .filter(|&(_, z)| near(z))
            .collect();
        let valid: Vec<(f64, f64)> = pairs.iter().copied().filter(|pair| pair.0 > 0.0).collect();
        let squares: f64 = valid
            .iter()
            .map(|(found, z)| ((found - z) * (distance / z).powi(2)).powi(2))
            .sum();
        let sd = (squares / valid.len() as f64).sqrt();
        let enough = valid.len() >= 100;
        Observation {
            slant_deg: Some(slant),
            axial_sd_mm: enough.then_some(sd * 1000.0),
            // On a steep wall few pixels share a depth, and not all depths occur.
            depth_step_mm: (slant < 10.0)
                .then(|| mean_step(valid.iter().map(|pair| pair.0), distance))
                .flatten(),
            valid_share: Some(valid.len() as f64 / pairs.len() as f64),
            pixels: pairs.len(),
            ..self.observation(measurement, distance, frame)
        }
    }

    /// A plate of 0.4 m before a wall: the gaps beside it, and where its right edge is found.
    pub fn plate(&mut self, distance: f64, background: f64, frame: usize) -> Observation {
        let (plate, wall) = (
            Slab::new(0.4, distance, 0.0),
            Slab::new(40.0, background, 0.0),
        );
        let bodies = [plate.body(1), wall.body(2)];
        let axes = [distance.to_bits(), background.to_bits(), frame as u64];
        let photo = self
            .photographer
            .photograph(&bodies, &mut stream(self.seed, "sensor plate", &axes));
        let lit = self.photographer.lit(&bodies);
        let width = photo.depth.width;
        let (mut shadow, mut left_gap, mut right_gap, mut edges) = (0.0, 0.0, 0.0, Vec::new());
        let rows = photo.labels.pixels.chunks_exact(width).enumerate();
        // Rows at least 10 px within the plate, away from what happens at its upper and lower edge.
        let plate_rows: Vec<usize> = rows
            .filter(|(_, labels)| labels.contains(&1))
            .map(|(row, _)| row)
            .collect();
        let plate_rows =
            &plate_rows[10.min(plate_rows.len() / 2)..plate_rows.len().saturating_sub(10)];
        for &row in plate_rows {
            let line = row * width..(row + 1) * width;
            let labels = &photo.labels.pixels[line.clone()];
            let depth = &photo.depth.pixels[line.clone()];
            let is_plate = |&label: &u8| label == 1;
            let (Some(left), Some(right)) = (
                labels.iter().position(is_plate),
                labels.iter().rposition(is_plate),
            ) else {
                continue;
            };
            let middle = left.midpoint(right);
            shadow += lit.pixels[line].iter().filter(|&&lit| !lit).count() as f64;
            // The invalid run nearest to each edge of the plate, seen from its middle.
            let gap = |columns: &mut dyn Iterator<Item = usize>| {
                let invalid = columns
                    .skip_while(|&c| depth[c] > 0)
                    .take_while(|&c| depth[c] == 0);
                invalid.count() as f64
            };
            left_gap += gap(&mut (0..middle).rev());
            right_gap += gap(&mut (middle..width));
            let is_near =
                |mm: u16| mm > 0 && f64::from(mm) / 1000.0 < distance.midpoint(background);
            let found = (middle..width).rev().find(|&c| is_near(depth[c]));
            edges.extend(found.map(|found| found as f64 - right as f64));
        }
        let n = plate_rows.len() as f64;
        let invalid = photo.depth.pixels.iter().filter(|&&mm| mm == 0).count();
        Observation {
            background_m: Some(background),
            shadow_px: Some(shadow / n),
            left_gap_px: Some(left_gap / n),
            right_gap_px: Some(right_gap / n),
            lateral_sd_px: Some(crate::experiment::statistics::standard_deviation(&edges)),
            valid_share: Some(1.0 - invalid as f64 / photo.depth.pixels.len() as f64),
            pixels: photo.depth.pixels.len(),
            ..self.observation("plate", distance, frame)
        }
    }
}

/// The mean distance between neighbouring values of depth, in mm, brought to `distance` as z^2:
/// neighbours are equally far apart in 1 / z. `None` with fewer than three values.
pub fn mean_step(depths: impl Iterator<Item = f64>, distance: f64) -> Option<f64> {
    let values: std::collections::BTreeSet<u64> =
        depths.map(|z| (z * 1000.0).round() as u64).collect();
    let (first, last) = (
        *values.first()? as f64 / 1000.0,
        *values.last()? as f64 / 1000.0,
    );
    (values.len() >= 3).then(|| {
        (1.0 / first - 1.0 / last) / (values.len() - 1) as f64 * distance * distance * 1000.0
    })
}
