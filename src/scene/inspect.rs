//! What a robot's owner should know of its description before images are made of it.

use super::SelfCollision;
use crate::random::uniform;
use crate::robot::{Joint, Motion, Robot};
use serde_json::{Value, json};
use std::f64::consts::TAU;

/// As many as 8-bit labels tell apart.
const MOST_LINKS: usize = 255;
/// A link of more triangles makes every frame slow, and shows nothing that a depth camera sees.
const MANY_TRIANGLES: usize = 100_000;
/// A robot beyond these sizes (m) is probably given in another unit.
const SMALLEST: f64 = 0.05;
const LARGEST: f64 = 10.0;

/// All of a robot but its triangles, for other programs: joints in the order of the tree, links in that
/// of the URDF. Each link has its pose in the root's frame where all joints are at 0 (limits or not), as
/// the rows of a 4x4 matrix, and in its own frame the bounds of its body; metres, radians.
pub fn as_json(robot: &Robot) -> Value {
    let name = |link: usize| &robot.links[link].name;
    let joints = robot.joints.iter().map(|joint| {
        let (kind, axis) = match joint.motion {
            Motion::Fixed => ("fixed", None),
            Motion::Revolute(axis) => ("revolute", Some(axis)),
            Motion::Prismatic(axis) => ("prismatic", Some(axis)),
        };
        let leader = |dof| robot.joints.iter().find(|j| j.dof == Some(dof));
        let mimic = joint.mimic.and_then(|mimic| {
            let joint = &leader(mimic.leader)?.name;
            Some(json!({
                "joint": joint, "multiplier": mimic.multiplier, "offset": mimic.offset,
            }))
        });
        json!({
            "name": joint.name,
            "type": kind,
            "parent": name(joint.parent),
            "child": name(joint.child),
            "axis": axis.map(|axis| [axis.x, axis.y, axis.z]),
            "limits": axis.map(|_| [joint.limits.0, joint.limits.1]),
            "mimic": mimic,
        })
    });
    let poses = robot.forward_kinematics(&vec![0.0; robot.dofs()]);
    let links = robot.links.iter().zip(&poses).map(|(link, pose)| {
        let matrix = pose.to_homogeneous();
        let rows: Vec<Vec<f64>> = matrix
            .row_iter()
            .map(|row| row.iter().copied().collect())
            .collect();
        json!({
            "name": link.name,
            "pose": rows,
            "triangles": link.mesh.triangles.len(),
            "area": link.mesh.area(),
            "bounds": link.mesh.bounds().map(|(low, high)| [low, high]),
        })
    });
    json!({
        "name": robot.name,
        "joints": joints.collect::<Vec<_>>(),
        "links": links.collect::<Vec<_>>(),
        "warnings": robot.warnings,
        "notes": robot.notes,
    })
}

/// Everything about a sound robot that may surprise, one sentence each.
pub fn remarks(robot: &Robot) -> Vec<String> {
    let mut remarks = of_bodies(robot);
    remarks.extend(robot.dof_joints().filter_map(|joint| unseen(robot, joint)));
    remarks.extend(robot.dof_joints().filter_map(of_range));
    remarks.extend(
        robot
            .dof_joints()
            .filter_map(|joint| of_mimic(robot, joint)),
    );
    if robot.links.len() <= MOST_LINKS {
        remarks.extend(overlap_at_rest(robot));
    }
    remarks
}

fn overlap_at_rest(robot: &Robot) -> Option<String> {
    let sample = |stream: &mut _| {
        let range = |joint: &Joint| uniform(stream, joint.limits.0, joint.limits.1);
        let mut configuration: Vec<f64> = robot.dof_joints().map(range).collect();
        robot.apply_mimics(&mut configuration);
        configuration
    };
    let collision = SelfCollision::new(robot, sample);
    let poses = robot.forward_kinematics(&robot.rest());
    let (a, b) = collision.first(&poses, &collision.boxes(&poses))?;
    Some(format!(
        "links \"{}\" and \"{}\" overlap when all joints rest: poses near to it will be rejected",
        robot.links[a].name, robot.links[b].name
    ))
}

fn of_bodies(robot: &Robot) -> Vec<String> {
    let mut remarks = Vec::new();
    let links = robot.links.len();
    if links > MOST_LINKS {
        remarks.push(format!(
            "there are {links} links, but labels can tell only {MOST_LINKS} apart: join some to make images"
        ));
    }
    if robot.links.iter().all(|link| link.mesh.is_empty()) {
        remarks.push("no link has a visual or a collision shape: nothing can be drawn".to_owned());
    }
    for link in &robot.links {
        let triangles = link.mesh.triangles.len();
        if triangles > MANY_TRIANGLES {
            remarks.push(format!(
                "link \"{}\" has {triangles} triangles: drawing is slow; simplify its mesh",
                link.name
            ));
        }
    }
    let boxes = robot.links.iter().filter_map(|link| link.mesh.bounds());
    let extents = boxes.flat_map(|(low, high)| [0, 1, 2].map(|i| f64::from(high[i] - low[i])));
    let largest = extents.fold(0.0, f64::max);
    if largest > 0.0 && !(SMALLEST..=LARGEST).contains(&largest) {
        remarks.push(format!(
            "the largest link is {largest:.3} m across: is everything in metres?"
        ));
    }
    remarks
}

/// A joint that moves nothing with a body.
fn unseen(robot: &Robot, joint: &Joint) -> Option<String> {
    let mut moved = robot.descendants(joint.child).into_iter();
    let seen = moved.any(|link| !robot.links[link].mesh.is_empty());
    (!seen).then(|| {
        format!(
            "joint \"{}\" moves no link that has a body: no image can show its value",
            joint.name
        )
    })
}

fn of_range(joint: &Joint) -> Option<String> {
    let (low, high) = joint.limits;
    let turns = (high - low) / TAU;
    let text = match joint.motion {
        _ if high == low => "its limits leave it no room to move".to_owned(),
        Motion::Revolute(_) if turns > 1.001 => format!(
            "its limits span {turns:.2} turns, and an image cannot tell values apart that differ by a \
             full turn: it is estimated as an angle within one turn"
        ),
        Motion::Revolute(_) if joint.is_circular() => {
            "it reaches (nearly) all angles: its estimates are averaged on the circle".to_owned()
        }
        _ => return None,
    };
    Some(format!("joint \"{}\": {text}", joint.name))
}

/// A joint that its leader takes beyond its own limits.
fn of_mimic(robot: &Robot, joint: &Joint) -> Option<String> {
    let mimic = joint.mimic?;
    let leader = robot.joints.iter().find(|j| j.dof == Some(mimic.leader))?;
    let value = |x: f64| mimic.multiplier * x + mimic.offset;
    let (a, b) = (value(leader.limits.0), value(leader.limits.1));
    let (low, high) = (a.min(b), a.max(b));
    let slack = 1e-3;
    (low < joint.limits.0 - slack || high > joint.limits.1 + slack).then(|| {
        format!(
            "joint \"{}\" follows \"{}\" to values from {low:.3} to {high:.3}, beyond its own limits, \
             {:.3} to {:.3}",
            joint.name, leader.name, joint.limits.0, joint.limits.1
        )
    })
}
