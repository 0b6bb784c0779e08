//! The joints of a URDF file.

use super::urdf::{UrdfProblem, finite, name_of, pose, values};
use super::xml::child;
use super::{Joint, Mimic, Motion};
use nalgebra::{Unit, Vector3};
use roxmltree::Node;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Joint values beyond this are mistakes.
const MAX_LIMIT: f64 = 1e6;

/// Reads the joints of a tree of links: parents before children, otherwise in URDF order.
/// `notes` takes what is not as the file says.
pub fn read(
    elements: &[Node],
    link_index: &BTreeMap<&str, usize>,
    notes: &mut Vec<String>,
) -> Result<Vec<Joint>, UrdfProblem> {
    let mut dofs = 0;
    let mut joints = Vec::with_capacity(elements.len());
    for &element in elements {
        let name = name_of(element)?;
        let what = format!("joint \"{name}\"");
        let link = |end: &'static str| {
            let link = child(element, end).and_then(|end| end.attribute("link"));
            let link = link.ok_or_else(|| UrdfProblem::NoEnd {
                joint: name.to_owned(),
                end,
            })?;
            let unknown = || UrdfProblem::UnknownLink {
                joint: name.to_owned(),
                link: link.to_owned(),
            };
            link_index.get(link).copied().ok_or_else(unknown)
        };
        let axis = || {
            let axis = child(element, "axis").map_or(Ok(None), |a| values(a, "xyz", &what));
            let axis = Vector3::from(axis?.unwrap_or([1.0, 0.0, 0.0]));
            Unit::try_new(axis, 1e-9).ok_or_else(|| UrdfProblem::Number { what: what.clone() })
        };
        let kind = element.attribute("type").unwrap_or("").trim();
        let motion = match kind {
            "fixed" => Motion::Fixed,
            "revolute" | "continuous" => Motion::Revolute(axis()?),
            "prismatic" => Motion::Prismatic(axis()?),
            "floating" | "planar" | "spherical" | "ball" => {
                notes.push(format!(
                    "joint \"{name}\" is {kind}: it is held where it is at 0, as if it were fixed"
                ));
                Motion::Fixed
            }
            _ => {
                return Err(UrdfProblem::JointType {
                    joint: name.to_owned(),
                    kind: kind.chars().take(40).collect(),
                });
            }
        };
        joints.push(Joint {
            name: name.to_owned(),
            parent: link("parent")?,
            child: link("child")?,
            origin: pose(element, &what)?,
            motion,
            limits: (0.0, 0.0),
            mimic: None,
            dof: (motion != Motion::Fixed).then(|| {
                dofs += 1;
                dofs - 1
            }),
        });
    }
    let by_name: BTreeMap<&str, usize> = (elements.iter().enumerate())
        .map(|(i, element)| Ok((name_of(*element)?, i)))
        .collect::<Result<_, UrdfProblem>>()?;
    let mimics: Vec<Option<Mimic>> = (0..joints.len())
        .map(|i| mimic(elements, &joints, &by_name, i))
        .collect::<Result<_, _>>()?;
    // Leaders first: a joint that follows and has no limits of its own gets those of its leader.
    for followers in [false, true] {
        for i in 0..joints.len() {
            if mimics[i].is_some() != followers || joints[i].motion == Motion::Fixed {
                continue;
            }
            let of_leader = mimics[i].and_then(|mimic| {
                let leader = joints.iter().find(|j| j.dof == Some(mimic.leader))?;
                let (low, high) = leader.limits;
                let [a, b] = [low, high].map(|x| mimic.multiplier * x + mimic.offset);
                Some((a.min(b), a.max(b)))
            });
            joints[i].limits = limits(elements[i], of_leader, notes)?;
            joints[i].mimic = mimics[i];
        }
    }
    Ok(joints)
}

/// The limits that a joint that moves says, or else `of_leader`.
fn limits(
    element: Node,
    of_leader: Option<(f64, f64)>,
    notes: &mut Vec<String>,
) -> Result<(f64, f64), UrdfProblem> {
    let kind = element.attribute("type").unwrap_or("").trim();
    if kind == "continuous" {
        return Ok((-PI, PI));
    }
    let name = element.attribute("name").unwrap_or("");
    let problem = || UrdfProblem::Limits {
        joint: name.to_owned(),
    };
    let limit = |name| -> Result<Option<f64>, UrdfProblem> {
        let text = child(element, "limit").and_then(|limit| limit.attribute(name));
        let number = |text: &str| text.trim().parse().map_err(|_| problem());
        text.map(number).transpose()
    };
    let (lower, upper) = match (limit("lower")?, limit("upper")?) {
        (None, None) => of_leader.ok_or_else(problem)?,
        // One that is left out is 0.
        (lower, upper) => (lower.unwrap_or(0.0), upper.unwrap_or(0.0)),
    };
    if kind == "revolute" && lower < -MAX_LIMIT && upper > MAX_LIMIT {
        notes.push(format!(
            "joint \"{name}\" has limits of {lower:e} and {upper:e} rad: it is taken to be continuous"
        ));
        return Ok((-PI, PI));
    }
    let in_range = lower <= upper && lower.abs() <= MAX_LIMIT && upper.abs() <= MAX_LIMIT;
    in_range.then_some((lower, upper)).ok_or_else(problem)
}

/// Follows the leaders of joint `i` to one that mimics nobody.
fn mimic(
    elements: &[Node],
    joints: &[Joint],
    by_name: &BTreeMap<&str, usize>,
    i: usize,
) -> Result<Option<Mimic>, UrdfProblem> {
    let Some(own_dof) = joints[i].dof else {
        return Ok(None);
    };
    let mut chain = Mimic {
        leader: own_dof,
        multiplier: 1.0,
        offset: 0.0,
    };
    let mut at = i;
    for _ in 0..joints.len() {
        let Some(mimic) = child(elements[at], "mimic") else {
            return Ok((at != i).then_some(chain));
        };
        let what = format!("the mimic of joint \"{}\"", joints[at].name);
        let [multiplier] = values(mimic, "multiplier", &what)?.unwrap_or([1.0]);
        let [offset] = values(mimic, "offset", &what)?.unwrap_or([0.0]);
        let leader = mimic.attribute("joint").unwrap_or("");
        let unknown = || UrdfProblem::UnknownLeader {
            joint: joints[at].name.clone(),
            leader: leader.to_owned(),
        };
        let next = by_name.get(leader).copied().ok_or_else(unknown)?;
        chain = Mimic {
            leader: joints[next].dof.ok_or_else(unknown)?,
            multiplier: chain.multiplier * multiplier,
            offset: chain.offset + chain.multiplier * offset,
        };
        finite([chain.multiplier, chain.offset], &what)?;
        at = next;
    }
    Err(UrdfProblem::MimicLoop {
        joint: joints[i].name.clone(),
    })
}

/// Parents before children, otherwise in URDF order; fails unless the links form one tree.
pub fn in_tree_order(links: &[&str], joints: Vec<Joint>) -> Result<Vec<Joint>, UrdfProblem> {
    let name = |link: usize| links[link].to_owned();
    let mut joint_above: Vec<Option<&Joint>> = vec![None; links.len()];
    for joint in &joints {
        if let Some(first) = joint_above[joint.child].replace(joint) {
            return Err(UrdfProblem::TwoParents {
                link: name(joint.child),
                first: first.name.clone(),
                second: joint.name.clone(),
            });
        }
    }
    if links.is_empty() {
        return Err(UrdfProblem::NoLinks);
    }
    let depth_of = |link: usize| {
        let (mut depth, mut at) = (0, link);
        while let Some(joint) = joint_above[at] {
            at = joint.parent;
            depth += 1;
            if depth > joints.len() {
                return Err(UrdfProblem::Loop { link: name(link) });
            }
        }
        Ok(depth)
    };
    let depth: Vec<usize> = (0..links.len()).map(depth_of).collect::<Result<_, _>>()?;
    let mut roots = (0..links.len()).filter(|&link| depth[link] == 0);
    if let (Some(first), Some(second)) = (roots.next(), roots.next()) {
        return Err(UrdfProblem::TwoRoots {
            first: name(first),
            second: name(second),
        });
    }
    let mut sorted = joints;
    sorted.sort_by_key(|joint| depth[joint.child]);
    Ok(sorted)
}
