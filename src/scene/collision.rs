//! Self-collision of a robot, for any URDF: every connected part of a link's mesh is wrapped in an
//! oriented box, and boxes of links that can collide must not overlap.

use super::oriented_box::OrientedBox;
use crate::random::{Stream, stream};
use crate::robot::{Motion, Robot};
use nalgebra::Isometry3;

/// Links joined by at most this many moving joints are never tested: their parts are made to
/// overlap, and joint limits keep them from worse.
const NEIGHBOURS: usize = 2;
/// Links that overlap in more than this share of random poses do so by design (or because their
/// boxes are too coarse) and are not tested either.
const ALWAYS: f64 = 0.95;
const TRIAL_POSES: usize = 200;

/// The boxes of each link, and the pairs of links that must stay apart.
#[derive(Debug, Clone)]
pub struct SelfCollision {
    /// By link, in the link's frame.
    boxes: Vec<Vec<OrientedBox>>,
    /// Ascending pairs of links, ascending.
    pairs: Vec<(usize, usize)>,
}

impl SelfCollision {
    /// `sample` draws the configurations in which the robot will be seen.
    pub fn new(robot: &Robot, sample: impl Fn(&mut Stream) -> Vec<f64>) -> Self {
        let wrap = |link: &crate::robot::Link| -> Vec<OrientedBox> {
            link.mesh
                .components()
                .iter()
                .map(OrientedBox::around)
                .collect()
        };
        let boxes: Vec<_> = robot.links.iter().map(wrap).collect();
        let with_body = |link: &usize| !boxes[*link].is_empty();
        let links: Vec<usize> = (0..boxes.len()).filter(with_body).collect();
        let pairs = links
            .iter()
            .flat_map(|&a| links.iter().map(move |&b| (a, b)));
        let apart = |&(a, b): &(usize, usize)| a < b && joints_between(robot, a, b) > NEIGHBOURS;
        let mut collision = SelfCollision {
            pairs: pairs.filter(apart).collect(),
            boxes,
        };

        let mut trials = stream(0, "self-collision trials", &[]);
        let mut overlaps = vec![0; collision.pairs.len()];
        for _ in 0..TRIAL_POSES {
            let posed = collision.posed(&robot.forward_kinematics(&sample(&mut trials)));
            for (count, &(a, b)) in overlaps.iter_mut().zip(&collision.pairs) {
                *count += usize::from(any_overlap(&posed[a], &posed[b]));
            }
        }
        let mut count = overlaps.into_iter();
        let limit = (ALWAYS * TRIAL_POSES as f64) as usize;
        collision
            .pairs
            .retain(|_| count.next().is_some_and(|n| n <= limit));
        collision
    }

    /// The boxes of each link in the root frame, given `root_from_link` of each link.
    pub fn posed(&self, root_from_link: &[Isometry3<f64>]) -> Vec<Vec<OrientedBox>> {
        let place = |(boxes, pose): (&Vec<OrientedBox>, &Isometry3<f64>)| {
            boxes.iter().map(|b| b.transformed(pose)).collect()
        };
        self.boxes.iter().zip(root_from_link).map(place).collect()
    }

    /// The first pair of links that collide, given the boxes posed.
    pub fn first(&self, posed: &[Vec<OrientedBox>]) -> Option<(usize, usize)> {
        let collide = |&&(a, b): &&(usize, usize)| any_overlap(&posed[a], &posed[b]);
        self.pairs.iter().find(collide).copied()
    }
}

/// Whether any box of one list overlaps any of the other.
pub fn any_overlap(some: &[OrientedBox], others: &[OrientedBox]) -> bool {
    some.iter().any(|a| others.iter().any(|b| a.overlaps(b)))
}

/// How many joints that move lie on the path between two links.
fn joints_between(robot: &Robot, a: usize, b: usize) -> usize {
    // The moving joints from a link up to the root, root first.
    let path = |link: usize| {
        let mut path = Vec::new();
        let mut link = link;
        for (index, joint) in robot.joints.iter().enumerate().rev() {
            if joint.child == link {
                if joint.motion != Motion::Fixed {
                    path.push(index);
                }
                link = joint.parent;
            }
        }
        path.reverse();
        path
    };
    let (a, b) = (path(a), path(b));
    let shared = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    a.len() + b.len() - 2 * shared
}
