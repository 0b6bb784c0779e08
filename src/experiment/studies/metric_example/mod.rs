//! What the Euclidean distance on joint angles does not see (section II-B, Fig. 2).

mod moved_arm;

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
use crate::random::stream;
use anyhow::{Result, bail};
use moved_arm::{Drawing, MovedArm};
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
