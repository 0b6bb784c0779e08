//! A first guess at what only a robot's owner knows: which links are the arm, how far its joints are to be
//! turned, and where a camera may stand that sees it. It is there to be corrected.

use crate::camera::Intrinsics;
use crate::random::{stream, uniform};
use crate::robot::{Joint, Robot};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

/// A chain of links that is moved by joints of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limb {
    /// The link that it hangs on with all its joints: the robot's base, or else the first link that moves.
    pub root: usize,
    /// Where its hand begins, or a link for tools behind it.
    pub tip: usize,
    /// Indices into [`Robot::joints`] of those that move it, from the root outward, without the hand's.
    pub joints: Vec<usize>,
}

/// So many joints make a limb an arm, if its hand has as many fingers as it likes.
const ARM: usize = 4;
const ARM_NAMES: [&str; 9] = [
    "arm", "hand", "gripper", "tool", "wrist", "ee", "flange", "tcp", "palm",
];
const OTHER_NAMES: [&str; 8] = [
    "leg", "foot", "ankle", "knee", "head", "wheel", "camera", "neck",
];
const TIP_NAMES: [&str; 6] = ["tcp", "tool", "tip", "grasp", "ee", "eef"];

/// The limbs of a robot, the likeliest arm first: by their names, then by how many joints they have.
pub fn limbs(robot: &Robot) -> Vec<Limb> {
    let mut limbs = Vec::new();
    let start = Limb {
        root: robot.root(),
        tip: robot.root(),
        joints: Vec::new(),
    };
    follow(robot, start, true, &mut limbs);
    limbs.retain(|limb| !limb.joints.is_empty());
    limbs.sort_by_key(|limb| std::cmp::Reverse(likelihood(robot, limb)));
    limbs
}

/// Follows a limb from its present tip outward. `from_base` says that nothing has branched off yet.
fn follow(robot: &Robot, mut limb: Limb, mut from_base: bool, limbs: &mut Vec<Limb>) {
    loop {
        let of_tip = |joint: &Joint| joint.parent == limb.tip;
        let children = (0..robot.joints.len()).filter(|&joint| of_tip(&robot.joints[joint]));
        let moving: Vec<usize> = children
            .filter(|&joint| moves(robot, joint) || longest(robot, robot.joints[joint].child) > 0)
            .collect();
        let [next] = moving[..] else {
            let reach = moving.iter().map(|&joint| {
                usize::from(moves(robot, joint)) + longest(robot, robot.joints[joint].child)
            });
            let is_hand = limb.joints.len() >= ARM
                || (!limb.joints.is_empty() && reach.max().unwrap_or(0) < ARM);
            if moving.is_empty() || is_hand {
                limb.tip = tool(robot, limb.tip);
                limbs.push(limb);
                return;
            }
            for joint in moving {
                let child = robot.joints[joint].child;
                let joints = if moves(robot, joint) {
                    vec![joint]
                } else {
                    Vec::new()
                };
                let limb = Limb {
                    root: child,
                    tip: child,
                    joints,
                };
                follow(robot, limb, false, limbs);
            }
            return;
        };
        let joint = &robot.joints[next];
        if moves(robot, next) {
            if limb.joints.is_empty() {
                limb.root = if from_base { joint.parent } else { joint.child };
                from_base = false;
            }
            limb.joints.push(next);
        }
        limb.tip = joint.child;
    }
}

/// Whether a joint moves by itself.
fn moves(robot: &Robot, joint: usize) -> bool {
    let joint = &robot.joints[joint];
    joint.dof.is_some() && joint.limits.0 < joint.limits.1
}

/// The greatest number of joints that move on a way outward from a link.
fn longest(robot: &Robot, link: usize) -> usize {
    let children = (0..robot.joints.len()).filter(|&joint| robot.joints[joint].parent == link);
    let of_child =
        |joint: usize| usize::from(moves(robot, joint)) + longest(robot, robot.joints[joint].child);
    children.map(of_child).max().unwrap_or(0)
}

/// A link for tools that is fixed to `tip`, or `tip` itself.
fn tool(robot: &Robot, tip: usize) -> usize {
    let is_fixed = |joint: &&Joint| joint.dof.is_none();
    let mut fixed = vec![tip];
    for joint in robot.joints.iter().filter(is_fixed) {
        if fixed.contains(&joint.parent) {
            fixed.push(joint.child);
        }
    }
    let is_tool = |&&link: &&usize| names(robot, link, &TIP_NAMES) > 0;
    fixed[1..].iter().find(is_tool).copied().unwrap_or(tip)
}

/// How many of the words are parts of a link's name, which `_`, `-` and digits divide.
fn names(robot: &Robot, link: usize, words: &[&str]) -> usize {
    let name = robot.links[link].name.to_lowercase();
    let parts: Vec<&str> = name.split(|c: char| !c.is_ascii_alphabetic()).collect();
    words.iter().filter(|word| parts.contains(word)).count()
}

fn likelihood(robot: &Robot, limb: &Limb) -> (i32, usize) {
    let links = limb.joints.iter().map(|&joint| robot.joints[joint].child);
    let links: Vec<usize> = links.chain([limb.tip]).collect();
    let any = |words: &[&str]| i32::from(links.iter().any(|&link| names(robot, link, words) > 0));
    let kind = any(&ARM_NAMES) - 2 * any(&OTHER_NAMES) + i32::from(limb.joints.len() >= ARM);
    (kind, limb.joints.len())
}

/// Ranges for the joints that turn (nearly) all round: from the middle of their limits a quarter of a turn
/// either way. With more, an arm takes the same places again with another elbow or wrist.
pub fn ranges(robot: &Robot, limb: &Limb) -> BTreeMap<String, [f64; 2]> {
    let joints = limb.joints.iter().map(|&joint| &robot.joints[joint]);
    let circular = joints.filter(|joint| joint.is_circular() && joint.mimic.is_none());
    let range = |joint: &Joint| {
        let (low, high) = joint.limits;
        let quarter = |x: f64| (100.0 * x).trunc() / 100.0;
        let middle = (low + high) / 2.0;
        let ends = [middle - FRAC_PI_2, middle + FRAC_PI_2].map(quarter);
        (joint.name.clone(), ends)
    };
    circular.map(range).collect()
}

/// A camera that looks at an arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// Coordinates in the robot's root frame to the camera's optical frame.
    pub camera_from_root: Isometry3<f64>,
    /// How far it is from the middle of what the arm reaches, and how far the arm reaches from there (m).
    pub distance: f64,
    pub reach: f64,
}

/// In front of the robot (x) and a little above, looking at the middle of what the arm reaches, as near as
/// its reach fits into the image. The robot stands upright (z up). `None` when the limb has no body.
pub fn viewpoint(robot: &Robot, limb: &Limb, camera: &Intrinsics) -> Option<Viewpoint> {
    let ranges = ranges(robot, limb);
    let links = robot.descendants(limb.root);
    let mut random = stream(1, "viewpoint", &[]);
    let mut points = Vec::new();
    for _ in 0..100 {
        let mut configuration = robot.rest();
        for joint in robot
            .dof_joints()
            .filter(|joint| links.contains(&joint.child))
        {
            let (low, high) = joint.limits;
            let [low, high] = ranges.get(&joint.name).copied().unwrap_or([low, high]);
            if let Some(dof) = joint.dof {
                configuration[dof] = uniform(&mut random, low, high);
            }
        }
        robot.apply_mimics(&mut configuration);
        let root_from_link = robot.forward_kinematics(&configuration);
        for &link in &links {
            if let Some((low, high)) = robot.links[link].mesh.bounds() {
                let corner = |i: usize| {
                    let at = |axis: usize| f64::from([low, high][i >> axis & 1][axis]);
                    Point3::new(at(0), at(1), at(2))
                };
                points.extend((0..8).map(|i| root_from_link[link] * corner(i)));
            }
        }
    }
    let count = points.len() as f64;
    let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
    let middle = Point3::from(sum / count);
    let mut distances: Vec<f64> = points
        .iter()
        .map(|p| nalgebra::distance(p, &middle))
        .collect();
    distances.sort_by(f64::total_cmp);
    let reach = *distances.get((0.95 * count) as usize)?;
    let half_view = (camera.width as f64 / camera.fx).min(camera.height as f64 / camera.fy) / 2.0;
    // The far half of what it reaches may be cut off at the corners, not the near one.
    let distance = (reach / half_view.atan().sin()).max(reach + 0.5);
    let up = 15f64.to_radians();
    let eye = middle + distance * Vector3::new(up.cos(), 0.0, up.sin());
    // Columns: where the camera's x (right), y (down) and z (forward) point.
    let forward = (middle - eye).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Some(Viewpoint {
        camera_from_root: Isometry3::from_parts(eye.coords.into(), turn).inverse(),
        distance,
        reach,
    })
}
