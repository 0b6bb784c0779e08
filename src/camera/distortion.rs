//! Lens distortion: where in a real camera's image a ray of the ideal pinhole camera is found.

use super::Intrinsics;

/// A camera with the distortion of its lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    pub intrinsics: Intrinsics,
    pub distortion: Distortion,
}

impl From<&Intrinsics> for Lens {
    /// Without distortion.
    fn from(intrinsics: &Intrinsics) -> Lens {
        Lens {
            intrinsics: *intrinsics,
            distortion: Distortion::default(),
        }
    }
}

/// The model of Brown and Conrady in OpenCV's terms: with x and y the ray at z = 1 and r² = x² + y²,
///
/// ```text
/// s  = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
/// x' = s x + 2 p1 x y + p2 (r² + 2 x²)
/// y' = s y + p1 (r² + 2 y²) + 2 p2 x y
/// ```
///
/// ROS calls it `plumb_bob` (k4 to k6 are zero) and `rational_polynomial`. In librealsense's modified
/// and inverse models, s x and s y stand for x and y in the terms of p1 and p2 (but r² is still that
/// of the ray): both are projected so by its `rs2_project_point_to_pixel`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distortion {
    k: [f64; 6],
    p: [f64; 2],
    modified: bool,
    /// The model holds for rays within this r²: farther out, rays would fold back into the image.
    limit: f64,
}

impl Default for Distortion {
    /// No distortion.
    fn default() -> Distortion {
        Distortion {
            k: [0.0; 6],
            p: [0.0; 2],
            modified: false,
            limit: f64::INFINITY,
        }
    }
}

/// Rays are followed out to 79 degrees from the optical axis.
const FARTHEST: f64 = 5.0;
const STEPS: usize = 1000;

impl Distortion {
    /// From coefficients in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6; those that are not there are
    /// zero. `modified` is for librealsense's variant. The error is a sentence.
    pub fn new(coefficients: &[f64], modified: bool) -> Result<Distortion, String> {
        if !coefficients.iter().all(|c| c.is_finite()) {
            return Err("the distortion coefficients must be finite numbers".to_owned());
        }
        if coefficients.iter().all(|&c| c == 0.0) {
            return Ok(Distortion::default());
        }
        if coefficients.iter().skip(8).any(|&c| c != 0.0) {
            return Err(
                "of the distortion coefficients only k1, k2, p1, p2, k3, k4, k5, k6 are known, not \
                 those of a thin prism or a tilted sensor; undistort the images first"
                    .to_owned(),
            );
        }
        let at = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
        let mut distortion = Distortion {
            k: [at(0), at(1), at(4), at(5), at(6), at(7)],
            p: [at(2), at(3)],
            modified,
            limit: 0.0,
        };
        let mut before = 0.0;
        for step in 1..=STEPS {
            let r = FARTHEST * step as f64 / STEPS as f64;
            let (scale, sound) = distortion.scale(r * r);
            if !(sound && scale * r > before) {
                break;
            }
            before = scale * r;
            distortion.limit = r * r;
        }
        match distortion.limit > 0.0 {
            true => Ok(distortion),
            false => Err("no lens distorts as its coefficients say".to_owned()),
        }
    }

    /// s for a ray, and whether its denominator is positive, as it must be.
    fn scale(&self, r2: f64) -> (f64, bool) {
        let [k1, k2, k3, k4, k5, k6] = self.k;
        let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        (above / below, below > 0.0)
    }

    /// Where the ray (x, y, 1) is found, as the ray that a pinhole camera would have there; `None` beyond
    /// what the lens sees.
    pub fn apply(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let r2 = x * x + y * y;
        let (scale, _) = self.scale(r2);
        let (sx, sy) = (scale * x, scale * y);
        let (x, y) = if self.modified { (sx, sy) } else { (x, y) };
        let [p1, p2] = self.p;
        let far = [
            sx + (2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)),
            sy + (p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y),
        ];
        (r2 <= self.limit).then_some(far)
    }
}

#[cfg(test)]
#[path = "distortion/tests.rs"]
mod tests;
