//! An arm of which one joint is turned: how far that moves it, and its picture from the side.

use crate::experiment::figure::{Mark, Shape};
use crate::pose_space::disp::Disp;
use crate::robot::{Joint, Motion, Robot};
use crate::scene::{Arm, Rig};
use anyhow::Result;
use nalgebra::{Isometry3, Point3, Vector3};

/// What turning one joint does to a pose.
pub struct Turn {
    pub before: Vec<f64>,
    pub after: Vec<f64>,
    pub tip_m: f64,
    pub disp_m: f64,
}

/// The arm whose joints are turned, all else at rest.
pub struct MovedArm<'a> {
    robot: &'a Robot,
    pub arm: &'a Arm,
    disp: Disp<'a>,
}

impl<'a> MovedArm<'a> {
    pub fn new(rig: &'a Rig, arm: &'a Arm) -> Result<Self> {
        let names: Vec<&str> = rig
            .robot
            .dof_joints()
            .map(|joint| joint.name.as_str())
            .collect();
        let names: Vec<&str> = arm.joints.iter().map(|&dof| names[dof]).collect();
        Ok(Self {
            robot: &rig.robot,
            arm,
            disp: Disp::new(&rig.robot, &names)?,
        })
    }

    /// The joint at a place of the pose. Every one of an arm's joints is one of the robot's.
    pub fn joint(&self, place: usize) -> &Joint {
        let dof = Some(self.arm.joints[place]);
        let mut joints = self.robot.joints.iter();
        joints
            .find(|joint| joint.dof == dof)
            .unwrap_or(&self.robot.joints[0])
    }

    /// The place of a joint in a pose.
    pub fn place(&self, name: &str) -> Option<usize> {
        let dof = self.robot.dof(name)?;
        self.arm.joints.iter().position(|&of_arm| of_arm == dof)
    }

    /// Turns a joint by `angle`, about its value in `pose` as far as its limits allow.
    pub fn turn(&self, place: usize, pose: &[f64], angle: f64) -> Turn {
        let (low, high) = self.joint(place).limits;
        let start = (pose[place] - angle / 2.0).min(high - angle).max(low);
        let (mut before, mut after) = (pose.to_vec(), pose.to_vec());
        (before[place], after[place]) = (start, start + angle);
        let (tip, moved) = (
            Point3::from(self.tip(&before)),
            Point3::from(self.tip(&after)),
        );
        Turn {
            tip_m: (moved - tip).norm(),
            disp_m: self.disp.distance(&before, &after),
            before,
            after,
        }
    }

    /// Where the tip is.
    pub fn tip(&self, pose: &[f64]) -> [f64; 3] {
        self.root_from_links(pose)[self.arm.tip]
            .translation
            .vector
            .into()
    }

    fn root_from_links(&self, pose: &[f64]) -> Vec<Isometry3<f64>> {
        let mut configuration = vec![0.0; self.robot.dofs()];
        for (&dof, &value) in self.arm.joints.iter().zip(pose) {
            configuration[dof] = value;
        }
        self.robot.forward_kinematics(&configuration)
    }

    /// Looks along the axis of the joint, so that all displacements are seen at their true length.
    pub fn draw(&self, place: usize, turn: &Turn) -> Drawing {
        let joint = self.joint(place);
        let (before, after) = (
            self.root_from_links(&turn.before),
            self.root_from_links(&turn.after),
        );
        let frame = before[joint.child];
        let axis = match joint.motion {
            Motion::Revolute(axis) | Motion::Prismatic(axis) => frame * axis.into_inner(),
            Motion::Fixed => Vector3::z(),
        };
        // Upwards in the picture is as nearly upwards as can be.
        let upright = [Vector3::z(), Vector3::x()];
        let up = upright.map(|up| up - axis * axis.dot(&up));
        let up = up[usize::from(up[0].norm() < 0.2)].normalize();
        let right = up.cross(&axis);
        let seen = |point: Point3<f64>| {
            let from_axis = point - Point3::from(frame.translation.vector);
            (right.dot(&from_axis), up.dot(&from_axis))
        };
        let points = |link: usize, root_from_link: &Isometry3<f64>| -> Vec<Point3<f64>> {
            let vertices = self.robot.links[link].mesh.vertices.iter();
            vertices
                .map(|v| root_from_link * Point3::from(v.map(f64::from)))
                .collect()
        };
        let outline = |link: usize, poses: &[Isometry3<f64>]| {
            convex_outline(points(link, &poses[link]).into_iter().map(seen).collect())
        };
        let moving = self.robot.descendants(joint.child);
        let base = self
            .robot
            .joints
            .iter()
            .find(|j| j.child == self.arm.links[0]);
        let resting = self
            .arm
            .links
            .iter()
            .copied()
            .chain(base.map(|base| base.parent));
        let displaced = moving.iter().flat_map(|&link| {
            points(link, &before[link])
                .into_iter()
                .zip(points(link, &after[link]))
        });
        let square = |(a, b): &(Point3<f64>, Point3<f64>)| (b - a).norm_squared();
        let farthest = displaced.max_by(|one, other| square(one).total_cmp(&square(other)));
        Drawing {
            resting: resting
                .filter(|link| !moving.contains(link))
                .map(|link| outline(link, &before))
                .collect(),
            before: moving.iter().map(|&link| outline(link, &before)).collect(),
            after: moving.iter().map(|&link| outline(link, &after)).collect(),
            disp: farthest.map_or(Vec::new(), |(a, b)| vec![seen(a), seen(b)]),
        }
    }
}

/// Outlines of links, and the line along which the farthest-moved point moves.
pub struct Drawing {
    resting: Vec<Outline>,
    before: Vec<Outline>,
    after: Vec<Outline>,
    disp: Vec<(f64, f64)>,
}

type Outline = Vec<(f64, f64)>;

impl Drawing {
    pub fn corners(&self) -> impl Iterator<Item = (f64, f64)> {
        let outlines = self.resting.iter().chain(&self.before).chain(&self.after);
        outlines.flatten().copied()
    }

    pub fn marks(self, turn_deg: f64) -> Vec<Mark> {
        vec![
            Mark::new("at rest", 7, Shape::Areas(self.resting)),
            Mark::new("before", 5, Shape::Areas(self.before)),
            Mark::new(
                &format!("turned by {turn_deg}°"),
                0,
                Shape::Areas(self.after),
            ),
            Mark::new("DISP", 1, Shape::Line(self.disp)),
        ]
    }
}

/// The corners of the convex hull in the order in which one walks round it (Andrew's algorithm).
fn convex_outline(mut points: Vec<(f64, f64)>) -> Outline {
    points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let half = |points: &mut dyn Iterator<Item = &(f64, f64)>| {
        let mut half = Outline::new();
        for &c in points {
            while let [.., a, b] = half[..]
                && (b.0 - a.0) * (c.1 - a.1) <= (b.1 - a.1) * (c.0 - a.0)
            {
                half.pop();
            }
            half.push(c);
        }
        half.pop(); // the first of the other half
        half
    };
    let mut outline = half(&mut points.iter());
    outline.extend(half(&mut points.iter().rev()));
    outline
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{stream, unit};

    #[test]
    fn an_outline_is_convex_and_holds_all_points() {
        let mut s = stream(1, "outline", &[]);
        let points: Vec<(f64, f64)> = (0..200).map(|_| (unit(&mut s), unit(&mut s))).collect();
        let outline = convex_outline(points.clone());
        for (at, a) in outline.iter().enumerate() {
            let b = outline[(at + 1) % outline.len()];
            let left = |p: &(f64, f64)| (b.0 - a.0) * (p.1 - a.1) - (b.1 - a.1) * (p.0 - a.0);
            assert!(points.iter().all(|p| left(p) >= -1e-12));
        }
        assert!(outline.len() > 4 && outline.iter().all(|corner| points.contains(corner)));
        let square = [
            (0.0, 0.0),
            (1.0, 0.0),
            (0.5, 0.0),
            (1.0, 1.0),
            (0.0, 1.0),
            (1.0, 1.0),
        ];
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        assert_eq!(convex_outline(square.to_vec()), corners);
    }
}
