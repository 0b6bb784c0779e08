//! The joints whose positions the baseline looks for.

use crate::random::{stream, uniform};
use crate::robot::Robot;
use crate::scene::Rig;
use nalgebra::{Isometry3, Point3};

/// A place of an arm where one joint or more sit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JointPoint {
    /// The joints' names, joined by `+`.
    pub name: String,
    /// The link whose frame has its origin there.
    pub link: usize,
}

/// Two origins are one point when they are so near in every pose.
const COINCIDE_M: f64 = 1e-6;
/// Enough, for origins that differ do so in all but a few poses.
const POSES: u64 = 8;

/// The origins of an arm's joints, in the order of its pose y; joints whose origins coincide in every
/// pose, such as the three of a shoulder, are one point.
pub fn joint_points(rig: &Rig, arm: usize) -> Vec<JointPoint> {
    let robot = &rig.robot;
    let poses: Vec<Vec<Isometry3<f64>>> = (0..POSES)
        .map(|pose| {
            let mut random = stream(0, "joint points", &[pose]);
            let value = |(low, high)| uniform(&mut random, low, high);
            let mut configuration: Vec<f64> = robot
                .dof_joints()
                .map(|joint| joint.limits)
                .map(value)
                .collect();
            robot.apply_mimics(&mut configuration);
            robot.forward_kinematics(&configuration)
        })
        .collect();
    let coincide = |a: usize, b: usize| {
        let origin = |pose: &[Isometry3<f64>], link: usize| pose[link].translation.vector;
        let mut distances = poses
            .iter()
            .map(|pose| (origin(pose, a) - origin(pose, b)).norm());
        distances.all(|distance| distance < COINCIDE_M)
    };
    let joints: Vec<_> = robot.dof_joints().collect();
    let mut points: Vec<JointPoint> = Vec::new();
    for joint in rig.arms[arm].joints.iter().map(|&dof| joints[dof]) {
        match points
            .iter_mut()
            .find(|point| coincide(point.link, joint.child))
        {
            Some(point) => point.name = format!("{}+{}", point.name, joint.name),
            None => points.push(JointPoint {
                name: joint.name.clone(),
                link: joint.child,
            }),
        }
    }
    points
}

/// Where the points are in the camera's frame, metres, in a configuration of the robot.
pub fn joint_positions(
    points: &[JointPoint],
    robot: &Robot,
    configuration: &[f64],
    camera_from_root: &Isometry3<f64>,
) -> Vec<Point3<f64>> {
    let root_from_link = robot.forward_kinematics(configuration);
    let position = |point: &JointPoint| {
        let origin = root_from_link[point.link].translation.vector;
        camera_from_root * Point3::from(origin)
    };
    points.iter().map(position).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn joints_of_a_wam_and_its_hand_are_twelve_points() {
        let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm/robot.toml");
        let rig = Rig::read(&robot).unwrap();
        let points = joint_points(&rig, rig.arm("right").unwrap());
        let names: Vec<&str> = points.iter().map(|point| point.name.as_str()).collect();
        let shoulder = ["R_SFE+R_SAA+R_HR", "R_EB", "R_WR", "R_WFE+R_WAA"];
        let hand = [
            "R_FR", "R_FR2", "R_RF", "R_RF2", "R_MF", "R_MF2", "R_LF", "R_LF2",
        ];
        assert_eq!(names, [&shoulder[..], &hand[..]].concat());

        // The elbow is 0.55 m along the upper arm from the shoulder, and 0.045 m aside.
        let camera_from_root = Isometry3::translation(1.0, 2.0, 3.0);
        let still = vec![0.0; rig.robot.dofs()];
        let at = joint_positions(&points, &rig.robot, &still, &camera_from_root);
        assert!(((at[0] - at[1]).norm() - 0.55f64.hypot(0.045)).abs() < 1e-9);
        assert!(((at[1] - at[2]).norm() - 0.045).abs() < 1e-9);
    }
}
