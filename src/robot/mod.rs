//! The robot: links, joints, meshes, forward kinematics. Knows nothing of cameras or forests.

use nalgebra::{Isometry3, Unit, Vector3};

/// A triangle mesh, metres. Triangles are counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    pub vertices: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

#[derive(Debug, Clone)]
pub struct Link {
    pub name: String,
    /// All visuals of the link merged, in the link's frame. Empty for a link without a body.
    pub mesh: Mesh,
}

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
    /// Index of the leading joint in a configuration.
    pub leader: usize,
    pub multiplier: f64,
    pub offset: f64,
}

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

/// A tree of links. A *configuration* is a slice with one value for each joint that is not fixed,
/// in the order in which the URDF lists them, joints that mimic another included.
#[derive(Debug, Clone)]
pub struct Robot {
    pub name: String,
    /// In URDF order.
    pub links: Vec<Link>,
    /// Parents before children.
    pub joints: Vec<Joint>,
}
