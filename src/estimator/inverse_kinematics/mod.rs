//! Inverse kinematics: the pose in which an arm comes closest to points that were found in an image,
//! the last stage of the part-classification baseline ("a virtual arm is optimally aligned with these
//! positions through inverse kinematics", section II).
//!
//! [`VirtualArm::align`] minimises over the poses q within the joint limits
//!
//! ```text
//! sum_j s_j rho(|p_j(q) - p_j|) + mu |q - q_ref|^2,    rho(r) = c^2 r^2 / (c^2 + r^2)
//! ```
//!
//! where p_j(q) is where point j is in pose q, p_j where it was found and s_j its weight, as a
//! multiple of the mean weight. The loss of Geman and McClure bounds what a point can do that was
//! found in a wrong place: beyond c its pull falls with r^-3. The term of mu keeps the joints that
//! the points cannot tell at the reference; with points known to s metres and joints known to d
//! radians beforehand, mu = (s / d)^2 makes the result the most probable pose.

mod descent;
mod virtual_arm;

pub use virtual_arm::VirtualArm;

use crate::random;
use descent::Descent;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Where a point was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// In the frame of the robot's root link, m.
    pub position: Point3<f64>,
    /// Its confidence, above 0, in any unit.
    pub weight: f64,
}

/// How [`VirtualArm::align`] looks for the pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// c, m, above 0. A point that is found further off than a few c is taken for a false one.
    pub scale: f64,
    /// mu, m^2/rad^2, above 0.
    pub prior: f64,
    /// From how many poses to start at most; at least 1. The first is the reference, the others are
    /// drawn uniformly between the limits.
    pub starts: usize,
    /// The draws depend on this alone.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            scale: 0.05,
            prior: 1e-6,
            starts: 32,
            seed: 1,
        }
    }
}

/// The pose in which the arm comes closest to the targets.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// One value for each joint, rad or m, within the limits.
    pub pose: Vec<f64>,
    /// Which joints the points that were found tell in this pose, as in [`VirtualArm::observable`].
    /// The others have, of the values that suit the points, those nearest to the reference; where no
    /// point moves with a joint that is the reference itself.
    pub observed: Vec<bool>,
    /// The distance of each point from its target, m; `None` where there was no target.
    pub residuals: Vec<Option<f64>>,
    /// The objective's value, m^2.
    pub cost: f64,
}

/// The search ends when all points are this near to their targets, m.
const SOLVED: f64 = 1e-3;

impl VirtualArm {
    /// Aligns the arm with the targets, one for each point, `None` where it was not found. A target
    /// that is not finite or has no positive weight counts as not found. Without any the result is
    /// the reference. Of equally good poses the first found is taken.
    ///
    /// The reference is moved to the nearest limit where it lies beyond. Panics when there is not one
    /// target for each point or one reference value for each joint.
    pub fn align(
        &self,
        targets: &[Option<Target>],
        reference: &[f64],
        settings: &Settings,
    ) -> Alignment {
        assert_eq!(
            targets.len(),
            self.points.len(),
            "one target for each point"
        );
        let usable = |target: &Target| {
            let finite = target.position.iter().all(|x| x.is_finite()) && target.weight.is_finite();
            finite && target.weight > 0.0
        };
        let targets: Vec<_> = targets.iter().map(|t| t.filter(usable)).collect();
        let found: Vec<bool> = targets.iter().map(Option::is_some).collect();
        let idle = self.idle(&found);
        let reference = self.variables(reference);
        let mut descent = Descent::new(self, &targets, &reference, settings);
        let mut stream = random::stream(settings.seed, "inverse kinematics", &[]);
        let mut best = descent.run(&reference, f64::INFINITY);
        for _ in 1..settings.starts {
            if best.farthest <= SOLVED {
                break;
            }
            let mut start = self.draw(&mut stream);
            for ((start, &reference), &idle) in start.iter_mut().zip(&reference).zip(&idle) {
                if idle {
                    *start = reference;
                }
            }
            let minimum = descent.run(&start, best.cost);
            if minimum.cost < best.cost {
                best = minimum;
            }
        }

        let variables = best.variables.as_slice();
        let pose = self.pose(variables);
        let positions = self.positions(&pose).into_iter().zip(&targets);
        let residual = |(at, target): (Point3<f64>, &Option<Target>)| {
            target.map(|target| (at - target.position).norm())
        };
        Alignment {
            observed: self.observed_at(variables, &found),
            residuals: positions.map(residual).collect(),
            cost: best.cost,
            pose,
        }
    }
}

#[cfg(test)]
mod tests;
