//! The robot: links, joints, meshes, forward kinematics. Knows nothing of cameras or forests.

mod bodies;
mod files;
mod joints;
mod mesh;
mod mesh_file;
mod packages;
pub mod solids;
mod units;
mod urdf;
mod xacro;
mod xml;

pub use mesh::Mesh;
pub use packages::Packages;
pub use urdf::{RobotError, UrdfProblem};

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// A rigid body of the robot; its frame is where the joint that moves it stands.
#[derive(Debug, Clone)]
pub struct Link {
    pub name: String,
    /// All visuals of the link merged, in the link's frame; its collision shapes where it has no
    /// visuals. Empty for a link without a body.
    pub mesh: Mesh,
}

/// How the child of a joint moves against its parent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    Fixed,
    /// Turns about the axis (child frame), radians.
    Revolute(Unit<Vector3<f64>>),
    /// Slides along the axis (child frame), metres.
    Prismatic(Unit<Vector3<f64>>),
}

/// The joint follows another one: `value = multiplier * leader + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mimic {
    /// Index of the leading joint in a configuration. A leader never mimics: where a URDF has a
    /// joint follow a follower, the chain is resolved when it is read.
    pub leader: usize,
    pub multiplier: f64,
    pub offset: f64,
}

/// What connects two links.
#[derive(Debug, Clone)]
pub struct Joint {
    pub name: String,
    /// Index into [`Robot::links`].
    pub parent: usize,
    /// Index into [`Robot::links`].
    pub child: usize,
    /// `parent_from_child` at joint value 0.
    pub origin: Isometry3<f64>,
    pub motion: Motion,
    /// Lower and upper limit, rad or m; -pi and pi for a continuous joint.
    pub limits: (f64, f64),
    pub mimic: Option<Mimic>,
    /// Where this joint's value stands in a configuration; `None` for a fixed joint.
    pub dof: Option<usize>,
}

/// A joint that leaves less than a fiftieth of a turn out of its reach has wrapped angles: the values
/// at its limits are neighbours.
const NEARLY_A_TURN: f64 = 0.98 * TAU;

impl Joint {
    /// Whether its value is an angle on a circle, so that values near to both limits look alike: a
    /// continuous joint, or one whose limits are (nearly) a full turn apart or more.
    pub fn is_circular(&self) -> bool {
        matches!(self.motion, Motion::Revolute(_)) && self.limits.1 - self.limits.0 >= NEARLY_A_TURN
    }

    /// Whether it can take every direction there is: then a value may differ from those within the
    /// limits by full turns.
    pub fn reaches_all_angles(&self) -> bool {
        matches!(self.motion, Motion::Revolute(_)) && self.limits.1 - self.limits.0 >= TAU
    }

    /// `parent_from_child` at the given joint value (rad or m; without meaning for a fixed joint).
    pub fn parent_from_child(&self, value: f64) -> Isometry3<f64> {
        match self.motion {
            Motion::Fixed => self.origin,
            Motion::Revolute(axis) => self.origin * UnitQuaternion::from_axis_angle(&axis, value),
            Motion::Prismatic(axis) => self.origin * Translation3::from(axis.into_inner() * value),
        }
    }
}

/// A tree of links. A *configuration* is a slice with one value for each joint that is not fixed,
/// in the order in which the URDF lists them, joints that mimic another included.
#[derive(Debug, Clone)]
pub struct Robot {
    pub name: String,
    /// In URDF order.
    pub links: Vec<Link>,
    /// Parents before children.
    pub joints: Vec<Joint>,
    /// What is probably wrong in the files it was read from, one sentence each.
    pub warnings: Vec<String>,
    /// What was made of files that do not say it, one sentence each.
    pub notes: Vec<String>,
}

impl Robot {
    /// The length of a configuration.
    pub fn dofs(&self) -> usize {
        self.joints.iter().filter(|j| j.dof.is_some()).count()
    }

    /// Where the value of the joint `name` stands in a configuration; `None` when there is no such
    /// joint or it is fixed.
    pub fn dof(&self, name: &str) -> Option<usize> {
        self.joints.iter().find(|j| j.name == name)?.dof
    }

    /// The joints that are not fixed, in the order of a configuration.
    pub fn dof_joints(&self) -> impl Iterator<Item = &Joint> {
        let mut joints: Vec<&Joint> = self.joints.iter().filter(|j| j.dof.is_some()).collect();
        joints.sort_by_key(|j| j.dof);
        joints.into_iter()
    }

    /// The index of the link `name`.
    pub fn link(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|l| l.name == name)
    }

    /// The index of the one link that is nobody's child.
    pub fn root(&self) -> usize {
        self.joints.first().map_or(0, |joint| joint.parent)
    }

    /// `root_from_link` for each link, in link order. `q` is taken as it is: neither limits nor
    /// mimics are enforced. Panics when `q` is not a configuration of this robot.
    pub fn forward_kinematics(&self, q: &[f64]) -> Vec<Isometry3<f64>> {
        assert_eq!(q.len(), self.dofs(), "one value for each joint that moves");
        let mut poses = vec![Isometry3::identity(); self.links.len()];
        for joint in &self.joints {
            let value = joint.dof.map_or(0.0, |dof| q[dof]);
            poses[joint.child] = poses[joint.parent] * joint.parent_from_child(value);
        }
        poses
    }

    /// Sets every joint that mimics another to what its leader demands.
    pub fn apply_mimics(&self, q: &mut [f64]) {
        for joint in &self.joints {
            if let (Some(dof), Some(mimic)) = (joint.dof, joint.mimic) {
                q[dof] = mimic.multiplier * q[mimic.leader] + mimic.offset;
            }
        }
    }

    /// The configuration with every joint at 0, or at the limit next to it.
    pub fn rest(&self) -> Vec<f64> {
        let value = |joint: &Joint| 0f64.clamp(joint.limits.0, joint.limits.1);
        let mut configuration: Vec<f64> = self.dof_joints().map(value).collect();
        self.apply_mimics(&mut configuration);
        configuration
    }

    /// `link` and all links below it, parents before children.
    pub fn descendants(&self, link: usize) -> Vec<usize> {
        let mut below = vec![link];
        for joint in &self.joints {
            if below.contains(&joint.parent) {
                below.push(joint.child);
            }
        }
        below
    }
}
