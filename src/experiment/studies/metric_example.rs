//! What the Euclidean distance on joint angles does not see (section II-B, Fig. 2).

use crate::circular::Circular;
use crate::dataset::DataSet;
use crate::distances::DistanceMatrix;
use crate::estimator::error::mean_pose;
use crate::experiment::claims::{Claim, ClaimResult, Verdict, difference};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::statistics::{Interval, bootstrap_mean, mean, quantile, spearman};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::data_set::DataSetTask;
use crate::experiment::tasks::distances::DistancesTask;
use crate::pose_space::disp::Disp;
use crate::random::stream;
use crate::robot::{Joint, Motion, Robot};
use crate::scene::{Arm, Rig};
use anyhow::{Result, bail};
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// A file of `data/sets/`, without its extension.
    pub set: String,
    pub images: usize,
    /// How far one joint is moved.
    pub turn_deg: f64,
    /// The two joints of the example.
    pub joints: [String; 2],
}

/// How a claim is tested.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// The same turn moves the end-effector at least so many times as far by the first joint as by
    /// the second, over the poses.
    MovesFarther { times: f64 },
    /// From each pose to all others, DISP ranks the displacements of the end-effector better than
    /// the Euclidean distance does.
    RanksBetter,
}

struct MetricExample {
    specification: Specification<Parameters, Test>,
    distances: Arc<DistancesTask>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let p = &specification.parameters;
    if !(p.turn_deg > 0.0 && p.turn_deg < 180.0) {
        bail!(
            "turn_deg = {}: choose more than 0 and less than 180",
            p.turn_deg
        );
    }
    if p.images < 3 {
        bail!("images = {}: choose at least 3, to compare pairs", p.images);
    }
    let set = DataSetTask::new(&specification.root, &p.set, p.images, specification.seed)?;
    Ok(Box::new(MetricExample {
        distances: Arc::new(DistancesTask { set: Arc::new(set) }),
        specification,
    }))
}

/// One observation: the image whose pose it is, a joint or "all pairs", a quantity, and its value.
struct Observed {
    image: usize,
    case: String,
    quantity: &'static str,
    value: f64,
}

const DISP: &str = "DISP (m)";
const TIP: &str = "displacement of the tip (m)";
const BY_DISP: &str = "rank correlation of DISP and tip";
const BY_EUCLID: &str = "rank correlation of Euclid and tip";
const PAIRS: &str = "all pairs";

impl Study for MetricExample {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        Ok(vec![self.distances.set.clone(), self.distances.clone()])
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let set = DataSet::open(&done(&*self.distances.set)?)?;
        let distances = DistancesTask::read(&done(&*self.distances)?)?;
        let (rig, arm) = self.distances.set.rig()?;
        let arm = MovedArm::new(&rig, &rig.arms[arm])?;
        let poses: Vec<&[f64]> = (0..set.len()).map(|image| set.pose(image)).collect();

        let turn = self.specification.parameters.turn_deg.to_radians();
        let mut observed = Vec::new();
        for (image, pose) in poses.iter().enumerate() {
            for joint in 0..pose.len() {
                let turn = arm.turn(joint, pose, turn);
                for (quantity, value) in [(DISP, turn.disp_m), (TIP, turn.tip_m)] {
                    let case = arm.joint(joint).name.clone();
                    observed.push(Observed {
                        image,
                        case,
                        quantity,
                        value,
                    });
                }
            }
        }
        let flat: Vec<f64> = poses.concat();
        let euclid = DistanceMatrix::euclidean(&flat, set.target_joints().len());
        let tips: Vec<f64> = poses.iter().flat_map(|pose| arm.tip(pose)).collect();
        let tips = DistanceMatrix::euclidean(&tips, 3);
        for image in 0..set.len() {
            let others = |matrix: &DistanceMatrix| -> Vec<f64> {
                let row = matrix.row(image).iter().enumerate();
                row.filter(|&(other, _)| other != image)
                    .map(|(_, &d)| d)
                    .collect()
            };
            for (quantity, metric) in [(BY_DISP, &distances), (BY_EUCLID, &euclid)] {
                let value = spearman(&others(metric), &others(&tips));
                let case = PAIRS.to_owned();
                observed.push(Observed {
                    image,
                    case,
                    quantity,
                    value,
                });
            }
        }

        let mut data = Table::new(["image", "case", "quantity", "value"]);
        for row in &observed {
            let case = row.case.as_str();
            data.push([
                row.image.into(),
                case.into(),
                row.quantity.into(),
                row.value.into(),
            ]);
        }
        let mut summary = Table::new(["case", "quantity", "value", "low", "high"]);
        let joints = set
            .target_joints()
            .iter()
            .flat_map(|joint| [(joint.as_str(), DISP), (joint, TIP)]);
        for (case, quantity) in joints.chain([(PAIRS, BY_DISP), (PAIRS, BY_EUCLID)]) {
            let mut stream = stream(self.specification.seed, "interval of displacements", &[]);
            let Interval { mean, low, high } =
                bootstrap_mean(&values(&observed, case, quantity), &mut stream);
            summary.push([
                case.into(),
                quantity.into(),
                mean.into(),
                low.into(),
                high.into(),
            ]);
        }
        let claims = self.specification.claims.iter();
        Ok(Report {
            data,
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(
                self.specification.id.clone(),
                self.figure(&arm, &poses, set.circular(), &observed)?,
            )],
            claims: claims.map(|claim| self.judge(claim, &observed)).collect(),
        })
    }
}

/// One quantity in the order of the images.
fn values(observed: &[Observed], case: &str, quantity: &str) -> Vec<f64> {
    let rows = observed
        .iter()
        .filter(|row| row.case == case && row.quantity == quantity);
    rows.map(|row| row.value).collect()
}

impl MetricExample {
    fn judge(&self, claim: &Claim<Test>, observed: &[Observed]) -> ClaimResult {
        let (higher, lower, what) = match &claim.test {
            None => return claim.without_test(),
            Some(Test::MovesFarther { times }) => {
                let [far, near] = &self.specification.parameters.joints;
                let scaled = values(observed, near, TIP)
                    .iter()
                    .map(|tip| times * tip)
                    .collect();
                let what = format!("tip by {far} - {times} times that by {near}, m:");
                (values(observed, far, TIP), scaled, what)
            }
            Some(Test::RanksBetter) => (
                values(observed, PAIRS, BY_DISP),
                values(observed, PAIRS, BY_EUCLID),
                "rank correlation with the tip, DISP - Euclid:".to_owned(),
            ),
        };
        let mut stream = stream(self.specification.seed, "order of metrics", &[]);
        let gap = difference(&higher, &lower, &mut stream);
        let ours = format!(
            "{what} {:.3} ({:.3} to {:.3}); 95 % interval",
            gap.mean, gap.low, gap.high
        );
        claim.result(ours, higher.len(), Verdict::of(&gap, 0.0, f64::INFINITY))
    }

    fn figure(
        &self,
        arm: &MovedArm,
        poses: &[&[f64]],
        circular: &Circular,
        observed: &[Observed],
    ) -> Result<Figure> {
        let Parameters {
            set,
            turn_deg,
            joints,
            ..
        } = &self.specification.parameters;
        let mean_pose = mean_pose(poses.iter().copied(), circular);
        let mut drawings = Vec::new();
        for name in joints {
            let Some(joint) = arm.place(name) else {
                bail!("the {} arm has no joint {name}", arm.arm.name);
            };
            let turn = arm.turn(joint, &mean_pose, turn_deg.to_radians());
            drawings.push((
                arm.draw(joint, &turn),
                format!("{name} by {turn_deg}°: DISP {:.2} m", turn.disp_m),
            ));
        }
        // Both drawings at one scale.
        let corners = drawings.iter().flat_map(|(drawing, _)| drawing.corners());
        let (mut x, mut y) = ((0.0, 0.0), (0.0, 0.0));
        for (right, up) in corners {
            x = (f64::min(x.0, right), f64::max(x.1, right));
            y = (f64::min(y.0, up), f64::max(y.1, up));
        }
        let panel = |(drawing, title): (Drawing, String)| {
            Panel::Plot(Plot {
                title,
                x: Axis::new("from the joint's axis (m)")
                    .including(x.0, x.1)
                    .to_scale(),
                y: Axis::new("from the joint's axis (m)").including(y.0, y.1),
                marks: drawing.marks(*turn_deg),
            })
        };
        let mut panels: Vec<Panel> = drawings.into_iter().map(panel).collect();

        let names: Vec<&str> = (0..mean_pose.len())
            .map(|at| arm.joint(at).name.as_str())
            .collect();
        let bar = |name: &&str| {
            let mut each = values(observed, name, DISP);
            each.sort_by(f64::total_cmp);
            (
                mean(&each),
                Some((quantile(&each, 0.05), quantile(&each, 0.95))),
            )
        };
        panels.push(Panel::Plot(Plot {
            title: "Every joint".to_owned(),
            x: Axis::of("", names.iter().copied()),
            y: Axis::new(&format!("DISP of {turn_deg}° (m)")),
            marks: vec![Mark::new(
                "",
                0,
                Shape::Bars(names.iter().map(bar).collect()),
            )],
        }));
        Ok(Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "One joint of the {} arm turned by {turn_deg}°, all else at the mean pose of set {set},                  seen along the joint's axis; links are drawn as their convex outlines. Right: mean                  over the {} poses of the set, bars from the 5 % to the 95 % quantile.",
                arm.arm.name,
                poses.len()
            ),
            panels,
            columns: 3,
            size: (2300, 900),
        })
    }
}

/// What turning one joint does to a pose.
struct Turn {
    before: Vec<f64>,
    after: Vec<f64>,
    tip_m: f64,
    disp_m: f64,
}

/// The arm whose joints are turned, all else at rest.
struct MovedArm<'a> {
    robot: &'a Robot,
    arm: &'a Arm,
    disp: Disp<'a>,
}

impl<'a> MovedArm<'a> {
    fn new(rig: &'a Rig, arm: &'a Arm) -> Result<Self> {
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
    fn joint(&self, place: usize) -> &Joint {
        let dof = Some(self.arm.joints[place]);
        let mut joints = self.robot.joints.iter();
        joints
            .find(|joint| joint.dof == dof)
            .unwrap_or(&self.robot.joints[0])
    }

    /// The place of a joint in a pose.
    fn place(&self, name: &str) -> Option<usize> {
        let dof = self.robot.dof(name)?;
        self.arm.joints.iter().position(|&of_arm| of_arm == dof)
    }

    /// Turns a joint by `angle`, about its value in `pose` as far as its limits allow.
    fn turn(&self, place: usize, pose: &[f64], angle: f64) -> Turn {
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
    fn tip(&self, pose: &[f64]) -> [f64; 3] {
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
    fn draw(&self, place: usize, turn: &Turn) -> Drawing {
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
struct Drawing {
    resting: Vec<Outline>,
    before: Vec<Outline>,
    after: Vec<Outline>,
    disp: Vec<(f64, f64)>,
}

type Outline = Vec<(f64, f64)>;

impl Drawing {
    fn corners(&self) -> impl Iterator<Item = (f64, f64)> {
        let outlines = self.resting.iter().chain(&self.before).chain(&self.after);
        outlines.flatten().copied()
    }

    fn marks(self, turn_deg: f64) -> Vec<Mark> {
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
