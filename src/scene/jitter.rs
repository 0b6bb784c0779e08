//! A camera that is never mounted twice in quite the same way.

use crate::random::{Stream, normal, uniform, unit};
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// How far the camera is displaced from its nominal pose, drawn anew for every frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraJitter {
    /// The camera's centre lies uniformly in a ball of this radius (m) about its nominal place.
    pub translation_m: f64,
    /// The camera is turned about its centre, about an axis of uniform direction, by an angle that is
    /// uniform from 0 to this (degrees).
    pub rotation_deg: f64,
}

impl CameraJitter {
    /// Draws `displaced_from_nominal`, between the two optical frames. Takes eight numbers from the
    /// stream, whatever they are.
    pub fn sample(&self, stream: &mut Stream) -> Isometry3<f64> {
        let radius = self.translation_m * unit(stream).cbrt();
        let centre = direction(stream).into_inner() * radius;
        let angle = uniform(stream, 0.0, self.rotation_deg.to_radians());
        let turn = UnitQuaternion::from_axis_angle(&direction(stream), angle);
        Isometry3::from_parts(Translation3::from(centre), turn).inverse()
    }
}

/// Uniform on the unit sphere.
fn direction(stream: &mut Stream) -> Unit<Vector3<f64>> {
    let mut component = || normal(stream);
    let (x, y, z) = (component(), component(), component());
    Unit::try_new(Vector3::new(x, y, z), 1e-12).unwrap_or(Vector3::z_axis())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::stream;

    #[test]
    fn centres_fill_the_ball_and_turns_their_range_evenly() {
        let jitter = CameraJitter {
            translation_m: 0.2,
            rotation_deg: 3.0,
        };
        let mut s = stream(1, "jitter test", &[]);
        let draws = 20_000;
        let (mut inner, mut small, mut mean) = (0, 0, Vector3::zeros());
        for _ in 0..draws {
            let nominal_from_displaced = jitter.sample(&mut s).inverse();
            let centre = nominal_from_displaced.translation.vector;
            let angle = nominal_from_displaced.rotation.angle().to_degrees();
            assert!(centre.norm() <= 0.2 + 1e-12 && angle <= 3.0 + 1e-9);
            // Half the radius holds an eighth of the volume.
            inner += usize::from(centre.norm() < 0.1);
            small += usize::from(angle < 1.0);
            mean += centre / f64::from(draws);
        }
        assert!((inner as f64 / f64::from(draws) - 0.125).abs() < 0.01);
        assert!((small as f64 / f64::from(draws) - 1.0 / 3.0).abs() < 0.02);
        assert!(mean.norm() < 0.003);
    }

    #[test]
    fn no_jitter_displaces_nothing() {
        let none = CameraJitter {
            translation_m: 0.0,
            rotation_deg: 0.0,
        };
        let drawn = none.sample(&mut stream(2, "jitter test", &[]));
        assert!((drawn.to_homogeneous() - nalgebra::Matrix4::identity()).norm() < 1e-15);
    }
}
