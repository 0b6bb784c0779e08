//! How far an estimated pose is from the true one.

use crate::circular::Circular;
use crate::robot::Robot;
use std::f64::consts::TAU;

/// Absolute difference of two joint angles, rad, wrapped to at most pi.
pub fn angle_error(truth: f64, estimate: f64) -> f64 {
    let turn = (truth - estimate).rem_euclid(TAU);
    turn.min(TAU - turn)
}

/// Mean of [`angle_error`] over the joints of a pose, rad. NaN for no joints.
pub fn mean_angle_error(truth: &[f64], estimate: &[f64]) -> f64 {
    let sum: f64 = truth
        .iter()
        .zip(estimate)
        .map(|(&t, &e)| angle_error(t, e))
        .sum();
    sum / truth.len() as f64
}

/// Distance in metres between the origins of link `tip` when the joints `dofs` of the arm take the
/// values `truth` and `estimate`. All other joints rest at 0: `tip` must not depend on them unless
/// they move both alike.
pub fn tip_error(
    robot: &Robot,
    tip: usize,
    dofs: &[usize],
    truth: &[f64],
    estimate: &[f64],
) -> f64 {
    let tip_at = |values: &[f64]| {
        let mut configuration = vec![0.0; robot.dofs()];
        for (&dof, &value) in dofs.iter().zip(values) {
            configuration[dof] = value;
        }
        robot.forward_kinematics(&configuration)[tip]
            .translation
            .vector
    };
    (tip_at(truth) - tip_at(estimate)).norm()
}

/// The constant that a method must beat: the mean of `poses`, joint by joint.
pub fn mean_pose<'a>(
    poses: impl ExactSizeIterator<Item = &'a [f64]>,
    circular: &Circular,
) -> Vec<f64> {
    let count = poses.len() as f64;
    let mut mean = Vec::new();
    for pose in poses {
        let columns = circular.encode(pose);
        mean.resize(columns.len(), 0.0);
        for (sum, column) in mean.iter_mut().zip(columns) {
            *sum += column / count;
        }
    }
    match mean.is_empty() {
        true => mean,
        false => circular.decode(mean),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn errors_wrap() {
        assert!((angle_error(3.0, -3.0) - (TAU - 6.0)).abs() < 1e-12);
        assert!((angle_error(-5.0, 0.4) - (TAU - 5.4)).abs() < 1e-12);
        assert_eq!(angle_error(1.25, 1.25), 0.0);
        assert!((angle_error(0.0, PI) - PI).abs() < 1e-12);
    }

    #[test]
    fn errors_are_symmetric_and_at_most_pi() {
        let mut stream = crate::random::stream(1, "angle error", &[]);
        for _ in 0..1000 {
            let a = crate::random::uniform(&mut stream, -20.0, 20.0);
            let b = crate::random::uniform(&mut stream, -20.0, 20.0);
            assert!((angle_error(a, b) - angle_error(b, a)).abs() < 1e-12);
            assert!((0.0..=PI).contains(&angle_error(a, b)));
            assert!((angle_error(a, b) - angle_error(a + TAU, b)).abs() < 1e-9);
        }
    }

    #[test]
    fn the_mean_pose_is_the_mean() {
        let poses = [vec![1.0, -2.0], vec![3.0, 4.0]];
        let mean = |circular| mean_pose(poses.iter().map(Vec::as_slice), &circular);
        assert_eq!(mean(Circular::default()), [2.0, 1.0]);
        // Of -2 and 4 = -2.28 on the circle.
        let turned = mean(Circular::new(vec![1]));
        assert!(turned[0] == 2.0 && (turned[1] - (2.0 - TAU) / 2.0).abs() < 1e-12);
    }
}
