//! The arm as its points see it: where they are in a pose, how they move with the joints, and which
//! joints can be told from them.

use crate::random;
use crate::robot::{Joint, Motion, Robot};
use nalgebra::{DMatrix, Isometry3, Point3, SymmetricEigen, Vector3};

/// A direction in the space of joint values is seen when one radian (or metre) along it displaces
/// the points by at least this, m: root of the sum of squares, to first order.
const SEEN: f64 = 1e-3;

/// A joint whose unit vector has at most this square in directions that are not seen is observed.
const UNSEEN_SHARE: f64 = 1e-6;

/// Poses at which [`VirtualArm::observable`] looks; odd, so that the majority is clear.
const GENERIC_POSES: u64 = 9;

/// An arm with marked points, the origins of some of its links.
///
/// Joints that mimic others always follow. So a pose of `joints` has as many free *variables* as
/// there are different leaders, and the limits are those of the leaders.
#[derive(Debug, Clone)]
pub struct VirtualArm {
    /// For each joint of a pose, what drives it.
    joints: Vec<Drive>,
    /// Of each variable, rad or m.
    pub(super) limits: Vec<(f64, f64)>,
    /// Parents before children.
    bodies: Vec<Body>,
    pub(super) points: Vec<MarkedPoint>,
}

/// The value of a joint is `multiplier * variable + offset`.
#[derive(Debug, Clone, Copy)]
struct Drive {
    variable: usize,
    multiplier: f64,
    offset: f64,
}

impl Drive {
    fn value(&self, variables: &[f64]) -> f64 {
        self.multiplier * variables[self.variable] + self.offset
    }
}

/// What moves as one.
#[derive(Debug, Clone)]
struct Body {
    /// The body it hangs on; `None` for what stands still.
    parent: Option<usize>,
    /// Its joint, whose origin is given in the frame of `parent`, past all joints at rest.
    joint: Joint,
    drive: Drive,
}

/// Where a body is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    root_from_body: Isometry3<f64>,
    /// Of its joint, in the frame of the root; zero for a fixed joint.
    axis: Vector3<f64>,
}

#[derive(Debug, Clone)]
pub(super) struct MarkedPoint {
    in_body: Point3<f64>,
    /// The bodies whose joints move the point, from the root outward; it is fixed to the last.
    chain: Vec<usize>,
    /// The variables that move it, ascending.
    pub(super) variables: Vec<usize>,
}

impl VirtualArm {
    /// A pose holds the values of `joints` (indices into a configuration) in this order; a point is
    /// the origin of a link of `links`. Joints that neither are named nor share a leader with one
    /// that is rest at 0. Panics when `robot` has no such joint or link.
    pub fn new(robot: &Robot, joints: &[usize], links: &[usize]) -> Self {
        let moving: Vec<&Joint> = robot.dof_joints().collect();
        let leader = |dof: usize| match moving[dof].mimic {
            Some(mimic) => (mimic.leader, mimic.multiplier, mimic.offset),
            None => (dof, 1.0, 0.0),
        };
        let mut leaders = Vec::new();
        for &dof in joints {
            if !leaders.contains(&leader(dof).0) {
                leaders.push(leader(dof).0);
            }
        }
        let drive = |dof: usize| {
            let (leader, multiplier, offset) = leader(dof);
            let variable = leaders.iter().position(|&l| l == leader)?;
            Some(Drive {
                variable,
                multiplier,
                offset,
            })
        };

        let mut rest = vec![0.0; robot.dofs()];
        robot.apply_mimics(&mut rest);
        let mut bodies: Vec<Body> = Vec::new();
        // The body that carries each link, and the link's frame in that of the body.
        let mut carried = vec![(None, Isometry3::identity()); robot.links.len()];
        for joint in &robot.joints {
            let (parent, parent_from_link) = carried[joint.parent];
            carried[joint.child] = if let Some(drive) = joint.dof.and_then(drive) {
                let mut joint = joint.clone();
                joint.origin = parent_from_link * joint.origin;
                bodies.push(Body {
                    parent,
                    joint,
                    drive,
                });
                (Some(bodies.len() - 1), Isometry3::identity())
            } else {
                let value = joint.dof.map_or(0.0, |dof| rest[dof]);
                (parent, parent_from_link * joint.parent_from_child(value))
            };
        }
        let point = |&link: &usize| {
            let (carrier, body_from_link) = carried[link];
            let above = |&body: &usize| bodies[body].parent;
            let mut chain: Vec<usize> = std::iter::successors(carrier, above).collect();
            chain.reverse();
            let variables = chain.iter().map(|&body| bodies[body].drive.variable);
            let mut variables: Vec<usize> = variables.collect();
            variables.sort_unstable();
            variables.dedup();
            MarkedPoint {
                in_body: body_from_link.translation.vector.into(),
                chain,
                variables,
            }
        };
        Self {
            joints: joints.iter().filter_map(|&dof| drive(dof)).collect(),
            limits: leaders.iter().map(|&dof| moving[dof].limits).collect(),
            points: links.iter().map(point).collect(),
            bodies,
        }
    }

    /// Where the points are in a pose, in the frame of the robot's root link. Joints that mimic
    /// others are taken to do so. Panics when there is not one value for each joint.
    pub fn positions(&self, pose: &[f64]) -> Vec<Point3<f64>> {
        let mut placed = Vec::new();
        self.place(&self.variables(pose), &mut placed);
        let points = self.points.iter();
        points.map(|p| self.position(p, &placed)).collect()
    }

    /// Which joints of a pose the points can tell, by the rank of their Jacobian: of those points
    /// for which `found` holds, and in poses without special symmetry. A joint is observable when no
    /// motion of the joints that leaves all points in place to first order moves it. This is local:
    /// a wrist whose three axes meet in a point has two poses with the same points in any case.
    /// Panics when `found` has not a value for each point.
    ///
    /// The answer is the same in all poses but few. It is that of the majority of some random ones.
    pub fn observable(&self, found: &[bool]) -> Vec<bool> {
        let mut votes = vec![0; self.joints.len()];
        for pose in 0..GENERIC_POSES {
            let observed = self.observed_at(&self.generic(pose), found);
            let votes = votes.iter_mut().zip(observed);
            votes.for_each(|(votes, yes)| *votes += u64::from(yes));
        }
        votes.iter().map(|&v| 2 * v > GENERIC_POSES).collect()
    }

    /// As [`Self::observable`], but where the variables have the given values.
    pub(super) fn observed_at(&self, variables: &[f64], found: &[bool]) -> Vec<bool> {
        let eigen = SymmetricEigen::new(self.squares(variables, found));
        let observed = |drive: &Drive| {
            let components = eigen.eigenvectors.row(drive.variable);
            let pairs = eigen.eigenvalues.iter().zip(components.iter());
            let unseen = pairs.filter(|(value, _)| **value < SEEN * SEEN);
            let share: f64 = unseen.map(|(_, component)| component * component).sum();
            share <= UNSEEN_SHARE
        };
        self.joints.iter().map(observed).collect()
    }

    /// Which variables move none of the points that were found, in a generic pose.
    pub(super) fn idle(&self, found: &[bool]) -> Vec<bool> {
        let squares = self.squares(&self.generic(0), found);
        let squares = squares.diagonal();
        squares.iter().map(|&square| square < SEEN * SEEN).collect()
    }

    /// J^T J of the points that were found.
    fn squares(&self, variables: &[f64], found: &[bool]) -> DMatrix<f64> {
        assert_eq!(found.len(), self.points.len(), "one value for each point");
        let count = self.limits.len();
        let mut placed = Vec::new();
        self.place(variables, &mut placed);
        let mut columns = vec![Vector3::zeros(); count];
        let mut squares = DMatrix::zeros(count, count);
        for (point, _) in self.points.iter().zip(found).filter(|(_, found)| **found) {
            let position = self.position(point, &placed);
            self.differentiate(point, &position, &placed, &mut columns);
            add_squares(&mut squares, 1.0, point, &columns);
        }
        squares.fill_upper_triangle_with_lower_triangle();
        squares
    }

    /// Variables without special symmetry, the same for each `number`.
    fn generic(&self, number: u64) -> Vec<f64> {
        self.draw(&mut random::stream(0, "generic poses", &[number]))
    }

    /// The pose that variables stand for.
    pub(super) fn pose(&self, variables: &[f64]) -> Vec<f64> {
        let joints = self.joints.iter();
        joints.map(|drive| drive.value(variables)).collect()
    }

    /// The variables whose pose comes closest to the given one; it is that pose when its joints
    /// follow their leaders.
    pub(super) fn variables(&self, pose: &[f64]) -> Vec<f64> {
        assert_eq!(pose.len(), self.joints.len(), "one value for each joint");
        let mut sums = vec![0.0; self.limits.len()];
        for (drive, value) in self.joints.iter().zip(pose) {
            sums[drive.variable] += drive.multiplier * (value - drive.offset);
        }
        let stiffness = self.stiffness();
        sums.iter().zip(stiffness).map(|(sum, s)| sum / s).collect()
    }

    /// By how much |pose|^2 grows with the square of each variable.
    pub(super) fn stiffness(&self) -> Vec<f64> {
        // A multiplier of 0 leaves a variable without influence, and then any value will do.
        let mut squares = vec![f64::MIN_POSITIVE; self.limits.len()];
        for drive in &self.joints {
            squares[drive.variable] += drive.multiplier * drive.multiplier;
        }
        squares
    }

    /// Variables drawn uniformly between their limits.
    pub(super) fn draw(&self, stream: &mut random::Stream) -> Vec<f64> {
        let mut draw = |&(low, high): &(f64, f64)| random::uniform(stream, low, high);
        self.limits.iter().map(&mut draw).collect()
    }

    /// Places each body.
    pub(super) fn place(&self, variables: &[f64], placed: &mut Vec<Placed>) {
        placed.clear();
        for body in &self.bodies {
            let own = body.joint.parent_from_child(body.drive.value(variables));
            let above = body.parent.map(|parent| placed[parent].root_from_body);
            let root_from_body = above.map_or(own, |above| above * own);
            let axis = match body.joint.motion {
                Motion::Fixed => Vector3::zeros(),
                Motion::Revolute(axis) | Motion::Prismatic(axis) => {
                    root_from_body.rotation * axis.into_inner()
                }
            };
            placed.push(Placed {
                root_from_body,
                axis,
            });
        }
    }

    pub(super) fn position(&self, point: &MarkedPoint, placed: &[Placed]) -> Point3<f64> {
        let fixed_to = point.chain.last();
        fixed_to.map_or(point.in_body, |&body| {
            placed[body].root_from_body * point.in_body
        })
    }

    /// The derivatives of the point's `position` by the variables that move it; `columns` has a place
    /// for every variable and the others are left as they are. A joint turns the point about its axis
    /// or slides it along.
    pub(super) fn differentiate(
        &self,
        point: &MarkedPoint,
        position: &Point3<f64>,
        placed: &[Placed],
        columns: &mut [Vector3<f64>],
    ) {
        for &variable in &point.variables {
            columns[variable] = Vector3::zeros();
        }
        for &body in &point.chain {
            let (at, Body { joint, drive, .. }) = (&placed[body], &self.bodies[body]);
            let velocity = match joint.motion {
                Motion::Revolute(_) => {
                    let lever = position.coords - at.root_from_body.translation.vector;
                    at.axis.cross(&lever)
                }
                _ => at.axis,
            };
            columns[drive.variable] += velocity * drive.multiplier;
        }
    }
}

/// Adds `weight` J^T J of one point to the lower triangle of a symmetric matrix.
pub(super) fn add_squares(
    matrix: &mut DMatrix<f64>,
    weight: f64,
    point: &MarkedPoint,
    columns: &[Vector3<f64>],
) {
    let rows = matrix.nrows();
    for (count, &b) in point.variables.iter().enumerate() {
        let weighted = columns[b] * weight;
        let column = &mut matrix.as_mut_slice()[b * rows..(b + 1) * rows];
        for &a in &point.variables[count..] {
            column[a] += weighted.dot(&columns[a]);
        }
    }
}
