//! Self-collision of a robot, for any URDF. Every connected part of a link's mesh counts as solid
//! and convex; links that can collide must not overlap in any pair of their parts.

use super::oriented_box::OrientedBox;
use crate::random::{Stream, stream};
use crate::robot::{Mesh, Motion, Robot};
use nalgebra::{Isometry3, Point3, Vector3};

/// Links joined by at most this many moving joints are never tested: their parts are made to
/// overlap, and joint limits keep them from worse.
const NEIGHBOURS: usize = 2;
/// Links that overlap in more than this share of random poses do so by design, and are not tested
/// either.
const ALWAYS: f64 = 0.95;
const TRIAL_POSES: usize = 200;

/// The parts of each link, and the pairs of links that must stay apart.
#[derive(Debug, Clone)]
pub struct SelfCollision {
    /// By link, in the link's frame.
    parts: Vec<Vec<Part>>,
    /// Ascending pairs of links, ascending.
    pairs: Vec<(usize, usize)>,
}

#[derive(Debug, Clone)]
struct Part {
    bounds: OrientedBox,
    /// The part is the convex hull of these.
    vertices: Vec<Point3<f64>>,
}

impl SelfCollision {
    /// `sample` draws the configurations in which the robot will be seen.
    pub fn new(robot: &Robot, sample: impl Fn(&mut Stream) -> Vec<f64>) -> Self {
        let part = |mesh: &Mesh| Part {
            bounds: OrientedBox::around(mesh),
            vertices: mesh
                .vertices
                .iter()
                .map(|v| v.map(f64::from).into())
                .collect(),
        };
        let parts = robot.links.iter();
        let parts = parts.map(|link| link.mesh.components().iter().map(part).collect());
        let parts: Vec<Vec<Part>> = parts.collect();
        let links = (0..parts.len()).filter(|&link| !parts[link].is_empty());
        let pairs = links
            .clone()
            .flat_map(|a| links.clone().map(move |b| (a, b)));
        let apart = |&(a, b): &(usize, usize)| a < b && joints_between(robot, a, b) > NEIGHBOURS;
        let pairs: Vec<_> = pairs.filter(apart).collect();
        let mut collision = SelfCollision { parts, pairs };

        let mut trials = stream(0, "self-collision trials", &[]);
        let mut overlaps = vec![0; collision.pairs.len()];
        for _ in 0..TRIAL_POSES {
            let root_from_link = robot.forward_kinematics(&sample(&mut trials));
            let boxes = collision.boxes(&root_from_link);
            for (count, &pair) in overlaps.iter_mut().zip(&collision.pairs) {
                *count += usize::from(collision.overlap(pair, &root_from_link, &boxes));
            }
        }
        let mut count = overlaps.into_iter();
        let limit = (ALWAYS * TRIAL_POSES as f64) as usize;
        collision
            .pairs
            .retain(|_| count.next().is_some_and(|n| n <= limit));
        collision
    }

    /// A box round each part of each link, in the root frame.
    pub fn boxes(&self, root_from_link: &[Isometry3<f64>]) -> Vec<Vec<OrientedBox>> {
        let place = |(parts, pose): (&Vec<Part>, &Isometry3<f64>)| {
            parts
                .iter()
                .map(|part| part.bounds.transformed(pose))
                .collect()
        };
        self.parts.iter().zip(root_from_link).map(place).collect()
    }

    /// The first pair of links that collide; `boxes` is what [`SelfCollision::boxes`] gives for
    /// the same poses.
    pub fn first(
        &self,
        root_from_link: &[Isometry3<f64>],
        boxes: &[Vec<OrientedBox>],
    ) -> Option<(usize, usize)> {
        let collide = |&&pair: &&(usize, usize)| self.overlap(pair, root_from_link, boxes);
        self.pairs.iter().find(collide).copied()
    }

    fn overlap(
        &self,
        (a, b): (usize, usize),
        root_from_link: &[Isometry3<f64>],
        boxes: &[Vec<OrientedBox>],
    ) -> bool {
        let b_from_a = root_from_link[b].inv_mul(&root_from_link[a]);
        self.parts[a].iter().zip(&boxes[a]).any(|(part_a, box_a)| {
            self.parts[b].iter().zip(&boxes[b]).any(|(part_b, box_b)| {
                box_a.overlaps(box_b) && hulls_overlap(part_a, part_b, &b_from_a)
            })
        })
    }
}

/// Whether the convex hulls of two parts overlap: Gilbert's algorithm walks to the point of the
/// Minkowski difference that is nearest to the origin, until a plane separates it from the origin.
/// Hulls so near that [`STEPS`] find no such plane count as overlapping.
fn hulls_overlap(a: &Part, b: &Part, b_from_a: &Isometry3<f64>) -> bool {
    let farthest = |part: &Part, direction: &Vector3<f64>| {
        let along = |v: &Point3<f64>| v.coords.dot(direction);
        let mut best = (f64::NEG_INFINITY, Point3::origin());
        for vertex in &part.vertices {
            if along(vertex) > best.0 {
                best = (along(vertex), *vertex);
            }
        }
        best.1
    };
    // Everything in b's frame: `nearest` lies in the difference b - a.
    let mut nearest = b.bounds.centre - b_from_a * a.bounds.centre;
    for _ in 0..STEPS {
        let on_b = farthest(b, &-nearest);
        let on_a = farthest(a, &b_from_a.inverse_transform_vector(&nearest));
        let support = on_b - b_from_a * on_a;
        if nearest.dot(&support) > 0.0 {
            return false;
        }
        let step = support - nearest;
        let share = -nearest.dot(&step) / step.norm_squared();
        nearest += step * share.min(1.0);
    }
    true
}

/// Enough to tell parts of a robot apart that are a few millimetres from each other.
const STEPS: usize = 40;

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
