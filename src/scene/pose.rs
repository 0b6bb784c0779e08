//! Random configurations, as a data set's specification declares them.

use super::{Rig, SceneError};
use crate::random::{Stream, uniform};
use crate::robot::Robot;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Which joints move and how far. Every joint of every arm is drawn uniformly between its limits
/// unless it is named here; all other joints rest at 0, or at the limit nearest to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseSpec {
    /// Joints that keep one value (rad or m).
    pub fixed: BTreeMap<String, f64>,
    /// Joints drawn uniformly from a range of their own (rad or m), within their limits unless they
    /// turn all round.
    pub ranges: BTreeMap<String, [f64; 2]>,
    /// No part of an arm comes nearer to the camera than this (m), since a head that carries the
    /// camera is not drawn and would collide.
    pub camera_clearance: f64,
}

impl Default for PoseSpec {
    fn default() -> Self {
        PoseSpec {
            fixed: BTreeMap::new(),
            ranges: BTreeMap::new(),
            camera_clearance: 0.3,
        }
    }
}

/// Draws configurations.
#[derive(Debug, Clone)]
pub struct PoseSampler {
    /// Lowest and highest value for each joint of a configuration; the value for those that mimic
    /// another is set by the mimic.
    ranges: Vec<[f64; 2]>,
}

impl PoseSampler {
    /// Fails on a joint that does not exist or follows another, on a range that is not within the
    /// joint's limits, and when a joint between root and camera is to move: the camera of a data
    /// set stands still.
    pub fn new(rig: &Rig, spec: &PoseSpec) -> Result<Self, SceneError> {
        let robot = &rig.robot;
        let mut ranges: Vec<[f64; 2]> = robot
            .dof_joints()
            .map(|joint| {
                let (low, high) = joint.limits;
                match rig.arm_of_link(joint.child) {
                    Some(_) => [low, high],
                    None => [0f64.clamp(low, high); 2],
                }
            })
            .collect();
        let fixed = spec.fixed.iter().map(|(name, &value)| (name, [value; 2]));
        for (name, [low, high]) in fixed.chain(spec.ranges.iter().map(|(n, &r)| (n, r))) {
            let fail = |message: String| SceneError::Pose {
                joint: name.clone(),
                message,
            };
            let joint = robot.joints.iter().find(|j| &j.name == name);
            let (joint, dof) = joint
                .and_then(|j| Some((j, j.dof?)))
                .ok_or_else(|| fail("the robot has no such joint that moves".to_owned()))?;
            if joint.mimic.is_some() {
                return Err(fail("it follows another joint; name that one".to_owned()));
            }
            if spec.fixed.contains_key(name) && spec.ranges.contains_key(name) {
                return Err(fail("it has both a fixed value and a range".to_owned()));
            }
            let (lowest, highest) = joint.limits;
            let within = lowest <= low && high <= highest;
            let sound = low <= high && low.is_finite() && high.is_finite();
            if !(sound && (within || joint.reaches_all_angles())) {
                return Err(fail(format!(
                    "{low} to {high} is not a range within its limits, {lowest} to {highest}"
                )));
            }
            ranges[dof] = [low, high];
        }
        let sampler = PoseSampler { ranges };
        sampler.check_that_the_camera_stands_still(rig)?;
        Ok(sampler)
    }

    fn check_that_the_camera_stands_still(&self, rig: &Rig) -> Result<(), SceneError> {
        let mut link = rig.camera_link;
        // Joints stand parents first, so one pass from the back climbs from the camera to the root.
        for joint in rig.robot.joints.iter().rev() {
            if joint.child != link {
                continue;
            }
            link = joint.parent;
            let drawn = joint.mimic.map(|mimic| mimic.leader).or(joint.dof);
            if drawn.is_some_and(|dof| self.ranges[dof][0] < self.ranges[dof][1]) {
                return Err(SceneError::Pose {
                    joint: joint.name.clone(),
                    message: "it moves the camera, which must stand still in a data set; give it a value in [poses.fixed]".to_owned(),
                });
            }
        }
        Ok(())
    }

    /// A configuration, not checked for collision. Every joint takes one draw from the stream,
    /// whether it moves or not, so that fixing a joint leaves all others as they were.
    pub fn sample(&self, robot: &Robot, stream: &mut Stream) -> Vec<f64> {
        let draw = |&[low, high]: &[f64; 2]| uniform(stream, low, high);
        let mut q: Vec<f64> = self.ranges.iter().map(draw).collect();
        robot.apply_mimics(&mut q);
        q
    }
}
