//! Noise of the disparity, a field over the image that the filter reads at the dots.

use crate::random::{Stream, normal, shuffle, uniform};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// The kind of noise and its parameters; in TOML a table named after the kind.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Noise {
    Gaussian(Gaussian),
    Perlin(Perlin),
}

/// Independent from dot to dot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gaussian {
    /// Standard deviation of the disparity, px.
    pub sd_px: f64,
}

/// Fractal gradient noise after Perlin (2002): smooth patches that wander from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Perlin {
    /// Standard deviation of the disparity, px.
    pub sd_px: f64,
    /// Size of the coarsest octave's cells, px. Each further octave halves it.
    pub cell_px: f64,
    pub octaves: u32,
    /// Amplitude of an octave relative to the one before.
    pub persistence: f64,
}

/// The noise of one frame.
pub enum NoiseField<'a> {
    Still,
    Gaussian { sd: f64, stream: &'a mut Stream },
    Perlin(PerlinField),
}

impl NoiseField<'_> {
    pub fn new(noise: Option<Noise>, stream: &mut Stream) -> NoiseField<'_> {
        match noise {
            None => NoiseField::Still,
            Some(Noise::Gaussian(Gaussian { sd_px: sd })) => NoiseField::Gaussian { sd, stream },
            Some(Noise::Perlin(perlin)) => NoiseField::Perlin(PerlinField::new(perlin, stream)),
        }
    }

    /// The change of disparity at a pixel, px. Gaussian noise draws a new value at each call.
    pub fn at(&mut self, column: usize, row: usize) -> f64 {
        match self {
            NoiseField::Still => 0.0,
            NoiseField::Gaussian { sd, stream } => *sd * normal(stream),
            NoiseField::Perlin(field) => field.at(column as f64, row as f64),
        }
    }
}

/// Each octave interpolates between the planes that random unit gradients span at the corners of
/// its cells.
pub struct PerlinField {
    noise: Perlin,
    /// Makes the standard deviation over all places and fields `noise.sd_px`.
    amplitude: f64,
    gradients: Vec<[f64; 2]>,
    permutation: Vec<u8>,
    /// Where the field of each octave begins, so that their corners do not coincide.
    origins: Vec<[f64; 2]>,
}

/// Mean square of one octave of gradient noise with unit gradients: 4 corners times the mean of
/// w(x)^2 w(y)^2 (x^2 + y^2) / 2 over a cell, with w(t) = 1 - (6 t^5 - 15 t^4 + 10 t^3).
const MEAN_SQUARE: f64 = 0.046_531_15;
const CORNERS: usize = 256;

impl PerlinField {
    fn new(noise: Perlin, stream: &mut Stream) -> PerlinField {
        let mut permutation: Vec<u8> = (0..=255).collect();
        shuffle(stream, &mut permutation);
        // Directions are spread evenly, which is as good as random ones and has no mean.
        let direction = |i| TAU * i as f64 / CORNERS as f64;
        let power: f64 = (0..noise.octaves)
            .map(|k| noise.persistence.powi(2 * k as i32))
            .sum();
        PerlinField {
            noise,
            amplitude: noise.sd_px / (power * MEAN_SQUARE).sqrt(),
            gradients: (0..CORNERS)
                .map(|i| [direction(i).cos(), direction(i).sin()])
                .collect(),
            permutation,
            origins: (0..noise.octaves)
                .map(|_| [0; 2].map(|_| uniform(stream, 0.0, CORNERS as f64)))
                .collect(),
        }
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        let (mut sum, mut amplitude, mut frequency) =
            (0.0, self.amplitude, 1.0 / self.noise.cell_px);
        for origin in &self.origins {
            sum += amplitude * self.octave(x * frequency + origin[0], y * frequency + origin[1]);
            amplitude *= self.noise.persistence;
            frequency *= 2.0;
        }
        sum
    }

    /// At a place in units of cells, not negative.
    fn octave(&self, x: f64, y: f64) -> f64 {
        let (cell_x, cell_y) = (x as i64, y as i64);
        let (x, y) = (x - cell_x as f64, y - cell_y as f64);
        let corner = |i: i64, j: i64| {
            let row = self.permutation[((cell_y + j) as usize) % CORNERS];
            let hash = self.permutation[((cell_x + i) as usize + row as usize) % CORNERS];
            let [gx, gy] = self.gradients[hash as usize];
            gx * (x - i as f64) + gy * (y - j as f64)
        };
        let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
        let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
        let upper = mix(corner(0, 0), corner(1, 0), fade(x));
        let lower = mix(corner(0, 1), corner(1, 1), fade(x));
        mix(upper, lower, fade(y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::stream;

    /// Products of the noise at pairs of places `lag` px apart, over many fields and places.
    fn correlation(noise: Noise, lag: usize) -> f64 {
        let mut sum = 0.0;
        let (fields, places) = (400, 50);
        for field in 0..fields {
            let mut s = stream(field, "noise test", &[]);
            let mut field = NoiseField::new(Some(noise), &mut s);
            for place in 0..places {
                let (column, row) = (place * 97 % 640, place * 61 % 480);
                let here = field.at(column, row);
                sum += here
                    * if lag == 0 {
                        here
                    } else {
                        field.at(column + lag, row)
                    };
            }
        }
        sum / (fields * places as u64) as f64
    }

    #[test]
    fn perlin_noise_has_its_deviation_and_is_smooth() {
        let noise = Noise::Perlin(Perlin {
            sd_px: 0.2,
            cell_px: 240.0,
            octaves: 6,
            persistence: 0.7,
        });
        let variance = correlation(noise, 0);
        assert!((variance.sqrt() / 0.2 - 1.0).abs() < 0.05, "{variance}");
        // render_kinect's field: 0.98 at 1 px, 0.77 at 20 px, 0.25 at 80 px.
        let at = |lag| correlation(noise, lag) / variance;
        assert!(at(1) > 0.95 && at(1) < 1.0, "{}", at(1));
        assert!(at(20) > 0.6 && at(20) < 0.9, "{}", at(20));
        assert!(
            at(80) < 0.5 && at(600).abs() < 0.15,
            "{} {}",
            at(80),
            at(600)
        );
    }

    #[test]
    fn gaussian_noise_has_its_deviation_and_no_memory() {
        let noise = Noise::Gaussian(Gaussian { sd_px: 0.1 });
        let variance = correlation(noise, 0);
        assert!((variance.sqrt() / 0.1 - 1.0).abs() < 0.03, "{variance}");
        assert!((correlation(noise, 1) / variance).abs() < 0.03);
    }
}
