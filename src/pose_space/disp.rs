//! The displacement distance of poses (eq. 3): how far the farthest-moved point of the robot's
//! surface moves from one pose to the other.
//!
//! A rigid body takes p to Rp + t, so that from pose to pose p is displaced by |Ap + b| with
//! A = R - R', b = t - t'. This is the norm of an affine map of p: over a body it is largest at a
//! corner of the body's convex hull, and within a ball of radius r round c it is at most
//! |Ac + b| + 2 sin(theta/2) r, theta being the angle between R and R'. With these bounds the
//! search is that of C-DIST (Zhang et al., 2007): bodies by decreasing bound, each through a
//! hierarchy of balls over its corners, leaving out what cannot exceed the best so far.

use super::hull::extreme_points;
use crate::distances::DistanceMatrix;
use crate::robot::{Joint, Robot};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use rayon::prelude::*;
use std::f64::consts::FRAC_1_SQRT_2;

/// Why there is no DISP for a robot and some joints.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DispError {
    #[error("robot \"{robot}\" has no joint \"{joint}\" that moves")]
    Joint { robot: String, joint: String },
    #[error("joint \"{0}\" is named twice")]
    Twice(String),
    #[error("the joints {joints:?} of robot \"{robot}\" move no link that has a surface")]
    NothingMoves { robot: String, joints: Vec<String> },
}

/// The displacement distance of poses of some joints of a robot.
#[derive(Debug, Clone)]
pub struct Disp<'a> {
    robot: &'a Robot,
    /// Where the joints of a pose stand in a configuration.
    dofs: Vec<usize>,
    /// The joints that follow others and are not in the pose.
    followers: Vec<&'a Joint>,
    bodies: Vec<Body>,
}

/// Links that move as one.
#[derive(Debug, Clone)]
struct Body {
    /// The link that carries the others, and the centre of the body in its frame.
    link: usize,
    centre: Translation3<f64>,
    /// A binary tree of balls over the corners: the left child follows its parent. All from the
    /// body's centre, which is also that of the root.
    balls: Vec<Ball>,
    corners: Vec<[f64; 3]>,
}

#[derive(Debug, Clone)]
struct Ball {
    centre: [f64; 3],
    radius: f64,
    inside: Inside,
}

#[derive(Debug, Clone)]
enum Inside {
    /// The place of the right child.
    Balls {
        right: usize,
    },
    Corners {
        from: usize,
        to: usize,
    },
}

/// Corners in a ball that has no children.
const FEW: usize = 8;

/// Bodies whose bounds are sorted together. Of robots with more the search is still exact.
const ABREAST: usize = 32;

/// The first three rows of `root_from_body`, from the body's centre; or the difference of two such.
type Rows = [[f64; 4]; 3];

impl<'a> Disp<'a> {
    /// A pose holds the values of `joints` in this order. Joints that mimic others and are not
    /// named follow their leaders, all others rest at 0.
    pub fn new(robot: &'a Robot, joints: &[impl AsRef<str>]) -> Result<Self, DispError> {
        let mut dofs = Vec::with_capacity(joints.len());
        for name in joints.iter().map(AsRef::as_ref) {
            let unknown = || DispError::Joint {
                robot: robot.name.clone(),
                joint: name.to_owned(),
            };
            let dof = robot.dof(name).ok_or_else(unknown)?;
            if dofs.contains(&dof) {
                return Err(DispError::Twice(name.to_owned()));
            }
            dofs.push(dof);
        }
        let named = |joint: &&Joint| joint.dof.is_some_and(|dof| dofs.contains(&dof));
        let followers = robot.joints.iter();
        let followers = followers.filter(|joint| joint.mimic.is_some() && !named(joint));
        let mut disp = Self {
            robot,
            followers: followers.collect(),
            dofs,
            bodies: Vec::new(),
        };
        disp.bodies = disp.find_bodies();
        if disp.bodies.is_empty() {
            return Err(DispError::NothingMoves {
                robot: robot.name.clone(),
                joints: joints.iter().map(|name| name.as_ref().to_owned()).collect(),
            });
        }
        Ok(disp)
    }

    fn find_bodies(&self) -> Vec<Body> {
        let moved = |dof: usize| self.dofs.contains(&dof);
        let moves = |joint: &Joint| {
            joint.dof.is_some_and(moved) || joint.mimic.is_some_and(|mimic| moved(mimic.leader))
        };
        let rest = self.configuration(&vec![0.0; self.dofs.len()]);
        // The link that carries each link, and the transform from the one to the other.
        let links = 0..self.robot.links.len();
        let mut carried: Vec<_> = links.map(|link| (link, Isometry3::identity())).collect();
        for joint in &self.robot.joints {
            if !moves(joint) {
                let (carrier, carrier_from_parent) = carried[joint.parent];
                let value = joint.dof.map_or(0.0, |dof| rest[dof]);
                let carrier_from_child = carrier_from_parent * joint.parent_from_child(value);
                carried[joint.child] = (carrier, carrier_from_child);
            }
        }
        let moving = self.robot.joints.iter().filter(|&joint| moves(joint));
        let body = |joint: &Joint| {
            let on_body = self.robot.links.iter().zip(&carried);
            let on_body = on_body.filter(|(_, (carrier, _))| *carrier == joint.child);
            let vertices = on_body.flat_map(|(link, (_, carrier_from_link))| {
                let vertices = link.mesh.welded().vertices.into_iter();
                vertices.map(move |v| carrier_from_link * Point3::from(v.map(f64::from)))
            });
            let vertices: Vec<[f64; 3]> = vertices.map(|v| v.coords.into()).collect();
            Body::new(joint.child, &vertices)
        };
        moving.filter_map(body).collect()
    }

    /// The distance of two poses in metres. Panics when one has not as many values as there are
    /// joints.
    pub fn distance(&self, a: &[f64], b: &[f64]) -> f64 {
        self.displacement(&self.place(a), &self.place(b))
    }

    /// The distances of all poses in metres. Panics when one has not as many values as there are
    /// joints.
    pub fn matrix(&self, poses: &[impl AsRef<[f64]> + Sync]) -> DistanceMatrix {
        let placed = poses.par_iter().map(|pose| self.place(pose.as_ref()));
        let placed: Vec<Vec<Rows>> = placed.collect();
        DistanceMatrix::new(poses.len(), |a, b| {
            self.displacement(&placed[a], &placed[b])
        })
    }

    /// The configuration of the whole robot in a pose.
    fn configuration(&self, pose: &[f64]) -> Vec<f64> {
        assert_eq!(pose.len(), self.dofs.len(), "one value for each joint");
        let mut q = vec![0.0; self.robot.dofs()];
        for (&dof, &value) in self.dofs.iter().zip(pose) {
            q[dof] = value;
        }
        for joint in &self.followers {
            if let (Some(dof), Some(mimic)) = (joint.dof, joint.mimic) {
                q[dof] = mimic.multiplier * q[mimic.leader] + mimic.offset;
            }
        }
        q
    }

    fn place(&self, pose: &[f64]) -> Vec<Rows> {
        let root_from_link = self.robot.forward_kinematics(&self.configuration(pose));
        let place = |body: &Body| {
            let matrix = (root_from_link[body.link] * body.centre).to_homogeneous();
            std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
        };
        self.bodies.iter().map(place).collect()
    }

    fn displacement(&self, a: &[Rows], b: &[Rows]) -> f64 {
        let mut best = 0.0;
        let placed = a.chunks(ABREAST).zip(b.chunks(ABREAST));
        for (bodies, (a, b)) in self.bodies.chunks(ABREAST).zip(placed) {
            let mut bounds = [0.0; ABREAST];
            let bounds = &mut bounds[..bodies.len()];
            for (body, bound) in bounds.iter_mut().enumerate() {
                *bound = Motion::between(&a[body], &b[body]).bound(&bodies[body].balls[0]);
            }
            loop {
                let (mut body, mut bound) = (0, 0.0);
                for (other, &wider) in bounds.iter().enumerate() {
                    if wider > bound {
                        (body, bound) = (other, wider);
                    }
                }
                if bound <= best {
                    break;
                }
                best = bodies[body].farther(0, &Motion::between(&a[body], &b[body]), best);
                bounds[body] = 0.0;
            }
        }
        best
    }
}

impl Body {
    /// `None` without vertices, which are in the frame of `link`.
    fn new(link: usize, vertices: &[[f64; 3]]) -> Option<Self> {
        let corners = extreme_points(vertices).into_iter().map(|i| vertices[i]);
        let mut corners: Vec<[f64; 3]> = corners.collect();
        let centre = Vector3::from(bounds(&corners)?.0);
        for corner in &mut corners {
            *corner = (Vector3::from(*corner) - centre).into();
        }
        let mut balls = Vec::new();
        let to = corners.len();
        cover(&mut corners, 0, to, &mut balls);
        Some(Self {
            link,
            centre: centre.into(),
            balls,
            corners,
        })
    }

    /// The largest displacement of a corner in a ball, if it is above `best`, else `best`.
    fn farther(&self, ball: usize, motion: &Motion, best: f64) -> f64 {
        match self.balls[ball].inside {
            Inside::Balls { right } => {
                let mut near = (motion.bound(&self.balls[right]), right);
                let mut far = (motion.bound(&self.balls[ball + 1]), ball + 1);
                if near.0 > far.0 {
                    (near, far) = (far, near);
                }
                let mut best = best;
                if far.0 > best {
                    best = self.farther(far.1, motion, best);
                }
                if near.0 > best {
                    best = self.farther(near.1, motion, best);
                }
                best
            }
            Inside::Corners { from, to } => {
                let mut most = 0.0;
                for corner in &self.corners[from..to] {
                    let square = motion.square(corner);
                    if square > most {
                        most = square;
                    }
                }
                best.max(most.sqrt())
            }
        }
    }
}

/// Adds a ball round the corners `from..to`, and those below it, for which the corners are put in
/// another order.
fn cover(corners: &mut [[f64; 3]], from: usize, to: usize, balls: &mut Vec<Ball>) {
    let inside = &mut corners[from..to];
    let Some((centre, half)) = bounds(inside) else {
        return;
    };
    let distance = |p: &[f64; 3]| (Vector3::from(*p) - Vector3::from(centre)).norm();
    let place = balls.len();
    balls.push(Ball {
        centre,
        radius: inside.iter().map(distance).fold(0.0, f64::max),
        inside: Inside::Corners { from, to },
    });
    if inside.len() <= FEW {
        return;
    }
    let longest = Vector3::from(half).imax();
    let middle = inside.len() / 2;
    inside.select_nth_unstable_by(middle, |p, q| p[longest].total_cmp(&q[longest]));
    cover(corners, from, from + middle, balls);
    let right = balls.len();
    cover(corners, from + middle, to, balls);
    balls[place].inside = Inside::Balls { right };
}

/// The centre of the bounding box and half its size; `None` without points.
fn bounds(points: &[[f64; 3]]) -> Option<([f64; 3], [f64; 3])> {
    let first = *points.first()?;
    let (mut low, mut high) = (first, first);
    for point in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let at = |sign: f64| std::array::from_fn(|axis| (high[axis] + sign * low[axis]) / 2.0);
    Some((at(1.0), at(-1.0)))
}

/// How a body's points are displaced from one pose to another. (Plain loops: these few lines are
/// where the time goes, and closures of the standard library's arrays are calls in a dev build.)
struct Motion {
    /// A and b.
    rows: Rows,
    /// 2 sin(theta/2): no vector grows by more under A.
    stretch: f64,
}

impl Motion {
    #[inline(always)]
    fn between(a: &Rows, b: &Rows) -> Self {
        let mut rows = [[0.0; 4]; 3];
        let mut squares = 0.0;
        for (row, (a, b)) in rows.iter_mut().zip(a.iter().zip(b)) {
            *row = [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]];
            squares += row[0] * row[0] + row[1] * row[1] + row[2] * row[2];
        }
        // The singular values of a difference of two rotations are 2 sin(theta/2), twice, and 0.
        Self {
            rows,
            stretch: FRAC_1_SQRT_2 * squares.sqrt(),
        }
    }

    /// The displacement of a point, squared.
    #[inline(always)]
    fn square(&self, p: &[f64; 3]) -> f64 {
        let mut square = 0.0;
        for row in &self.rows {
            let along = row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3];
            square += along * along;
        }
        square
    }

    /// No point in the ball is displaced by more.
    #[inline(always)]
    fn bound(&self, ball: &Ball) -> f64 {
        self.square(&ball.centre).sqrt() + self.stretch * ball.radius
    }
}
