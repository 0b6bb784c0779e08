//! The error of the pose by either way (Fig. 11a).

use super::verdicts::Test;
use super::{Baseline, Compared, Parameters};
use crate::estimator::part_baseline::votes::FoundJoint;
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{FLOOR_COLOUR, Outcome, PoseError, Ruler};
use crate::experiment::statistics::{mean, quantile, standard_deviation};
use crate::experiment::studies::cross_validation::report::fifths;
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::{Cell, Table};
use crate::experiment::task::Task;
use crate::experiment::tasks::part_estimates::{PartEstimated, PartEstimatesTask};
use anyhow::{Context, Result};
use std::sync::Arc;

pub(super) struct Angles {
    pub(super) specification: Specification<Parameters, Test>,
    compared: Compared,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let place = (
        &*specification.root,
        specification.profile,
        specification.seed,
    );
    Ok(Box::new(Angles {
        compared: Compared::new(place, &specification.parameters)?,
        specification,
    }))
}

/// A row of the comparison.
pub(super) struct Method {
    pub(super) id: String,
    title: String,
    colour: usize,
    /// In the order of the images.
    pub(super) images: Vec<Tested>,
}

/// One image by one method.
pub(super) struct Tested {
    image: usize,
    fold: usize,
    pub(super) visible: usize,
    pose: Vec<f64>,
    pub(super) error: PoseError,
    /// Of the baseline only.
    parts: Option<Parts>,
}

struct Parts {
    /// Which joints of the pose the found positions can tell.
    observed: Vec<bool>,
    /// How far each joint was found from where it is, metres; `None` where it was not found.
    off_m: Vec<Option<f64>>,
}

impl Tested {
    /// The mean error of the joints that can be told, degrees; NaN when none can.
    fn observable_deg(&self) -> f64 {
        let Some(parts) = &self.parts else {
            return f64::NAN;
        };
        let joints = self.error.joints_deg.iter().zip(&parts.observed);
        mean(
            &joints
                .filter(|(_, told)| **told)
                .map(|(&e, _)| e)
                .collect::<Vec<_>>(),
        )
    }

    /// The mean distance of the found positions from the joints, metres; NaN when none was found.
    pub(super) fn off_m(&self) -> f64 {
        let found = self
            .parts
            .iter()
            .flat_map(|parts| parts.off_m.iter().flatten());
        mean(&found.copied().collect::<Vec<_>>())
    }
}

/// What is measured.
struct Measure {
    name: String,
    unit: &'static str,
    of: Box<dyn Fn(&Tested) -> f64>,
}

fn measures(joints: &[&str]) -> Vec<Measure> {
    let measure = |name: &str, unit, of: fn(&Tested) -> f64| Measure {
        name: name.to_owned(),
        unit,
        of: Box::new(of),
    };
    let joint = |(at, name): (usize, &&str)| Measure {
        name: (*name).to_owned(),
        unit: "deg",
        of: Box::new(move |t: &Tested| t.error.joints_deg[at]),
    };
    [
        measure("all joints", "deg", |t| t.error.all_deg),
        measure("arm joints", "deg", |t| t.error.arm_deg),
        measure("hand joints", "deg", |t| t.error.hand_deg),
        measure("observable joints", "deg", Tested::observable_deg),
        measure("DISP", "m", |t| t.error.disp_m),
        measure("fingertip", "m", |t| t.error.tip_m),
        measure("joint positions", "m", Tested::off_m),
    ]
    .into_iter()
    .chain(joints.iter().enumerate().map(joint))
    .collect()
}

/// The angles and the distances among the measures.
const ANGLES: std::ops::Range<usize> = 0..3;
const DISTANCES: std::ops::Range<usize> = 4..7;

impl Method {
    /// A measure of those images that have it and that are `wanted`.
    fn measured(&self, measure: &Measure, wanted: impl Fn(&Tested) -> bool) -> Vec<(usize, f64)> {
        let images = self.images.iter().filter(|tested| wanted(tested));
        let measured = images.map(|tested| (tested.fold, (measure.of)(tested)));
        measured.filter(|(_, value)| !value.is_nan()).collect()
    }
}

/// The mean over images and the standard deviation over folds; NaN of nothing.
fn centre_and_spread(measured: &[(usize, f64)]) -> (f64, f64) {
    let all: Vec<f64> = measured.iter().map(|&(_, value)| value).collect();
    let folds = measured
        .iter()
        .map(|&(fold, _)| fold + 1)
        .max()
        .unwrap_or(0);
    let of_fold = |fold: usize| {
        let of = measured.iter().filter(|&&(f, _)| f == fold);
        mean(&of.map(|&(_, value)| value).collect::<Vec<_>>())
    };
    let means: Vec<f64> = (0..folds).map(of_fold).filter(|m| !m.is_nan()).collect();
    (mean(&all), standard_deviation(&means))
}

impl Study for Angles {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let Compared {
            validation,
            ours,
            baselines,
            oracle,
            ..
        } = &self.compared;
        let mut tasks = validation.tasks(ours);
        for baseline in baselines.iter().chain([oracle]) {
            let of_baseline = baseline.tasks.iter();
            tasks.extend(of_baseline.map(|task| task.clone() as Arc<dyn Task>));
        }
        Ok(tasks)
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let (rig, arm) = self.compared.validation.set.rig()?;
        let ruler = Ruler::new(&rig, arm)?;
        let methods = self.methods(&ruler, done)?;
        let measures = measures(ruler.joints());
        let claims = self.specification.claims.iter();
        Ok(Report {
            data: self.data(&methods, ruler.joints()),
            summary: self.summary(&methods, &measures),
            tables: Vec::new(),
            figures: vec![(
                self.specification.id.clone(),
                self.figure(&methods, &measures),
            )],
            claims: claims
                .map(|claim| {
                    self.judge(claim, &methods)
                        .with_context(|| format!("claim {}", claim.id))
                })
                .collect::<Result<_>>()?,
            text: text(&methods, &measures),
        })
    }
}

impl Angles {
    fn methods(&self, ruler: &Ruler, done: Done<'_>) -> Result<Vec<Method>> {
        let Compared {
            validation,
            ours,
            step,
            baselines,
            oracle,
            ..
        } = &self.compared;
        let outcomes = validation.outcomes(ours, done)?;
        let test = |outcome: &Outcome, pose: Vec<f64>, parts| Tested {
            image: outcome.image,
            fold: outcome.fold,
            visible: outcome.visible,
            error: ruler.measure(&outcome.truth, &pose),
            pose,
            parts,
        };
        let method = |id: &str, title: &str, colour, images| Method {
            id: id.to_owned(),
            title: title.to_owned(),
            colour,
            images,
        };
        let Parameters {
            objective,
            segmentation,
            ..
        } = &self.specification.parameters;
        let constant = outcomes.iter().map(|o| test(o, o.constant.clone(), None));
        let regressed = |o: &Outcome| test(o, o.estimate.thresholds[*step].pose.clone(), None);
        let mut methods = vec![
            method(
                "constant-pose",
                "constant pose",
                FLOOR_COLOUR,
                constant.collect(),
            ),
            method(
                &format!("{}/{}", objective.id, segmentation.id()),
                &format!("{}, {}", objective.title, segmentation.title()),
                0,
                outcomes.iter().map(regressed).collect(),
            ),
        ];
        for (at, Baseline { id, title, tasks }) in baselines.iter().chain([oracle]).enumerate() {
            let mut estimated: Vec<PartEstimated> = Vec::new();
            for task in tasks {
                estimated.extend(PartEstimatesTask::read(&done(&**task)?)?.images);
            }
            estimated.sort_by_key(|estimated| estimated.image);
            let images = outcomes.iter().zip(estimated).map(|(outcome, estimated)| {
                let off = estimated.truth.iter().zip(&estimated.found);
                let distance = |(truth, found): (&[f64; 3], &Option<_>)| {
                    let found: &FoundJoint = found.as_ref()?;
                    let square = |axis: usize| (truth[axis] - found.at[axis]).powi(2);
                    Some((0..3).map(square).sum::<f64>().sqrt())
                };
                let parts = Parts {
                    off_m: off.map(distance).collect(),
                    observed: estimated.observed,
                };
                test(outcome, estimated.pose, Some(parts))
            });
            methods.push(method(id, title, at + 1, images.collect()));
        }
        Ok(methods)
    }

    /// Whether an image shows more than hardly anything of the arm.
    pub(super) fn shows_arm(&self, tested: &Tested) -> bool {
        tested.visible >= self.specification.parameters.little_px
    }

    /// A row for each image by each method, with the pose in radians.
    fn data(&self, methods: &[Method], joints: &[&str]) -> Table {
        let columns = [
            "image",
            "fold",
            "method",
            "visible_px",
            "error_deg",
            "arm_error_deg",
            "hand_error_deg",
            "observable_error_deg",
            "observable_joints",
            "disp_m",
            "tip_m",
            "joint_positions_m",
            "found_joints",
        ];
        let poses = joints.iter().map(|joint| format!("{joint}_rad"));
        let mut table = Table::new(columns.map(str::to_owned).into_iter().chain(poses));
        for method in methods {
            for tested in &method.images {
                let number = |value: f64| match value.is_nan() {
                    true => Cell::Empty,
                    false => value.into(),
                };
                let count = |of: fn(&Parts) -> usize| tested.parts.as_ref().map(of).into();
                let cells: [Cell; 13] = [
                    tested.image.into(),
                    tested.fold.into(),
                    method.id.as_str().into(),
                    tested.visible.into(),
                    tested.error.all_deg.into(),
                    tested.error.arm_deg.into(),
                    tested.error.hand_deg.into(),
                    number(tested.observable_deg()),
                    count(|parts| parts.observed.iter().filter(|&&told| told).count()),
                    tested.error.disp_m.into(),
                    tested.error.tip_m.into(),
                    number(tested.off_m()),
                    count(|parts| parts.off_m.iter().flatten().count()),
                ];
                let pose = tested.pose.iter().map(|&angle| Cell::from(angle));
                table.push(cells.into_iter().chain(pose));
            }
        }
        table
    }

    /// A row for each measure of each method: over all images, and over those that show the arm.
    fn summary(&self, methods: &[Method], measures: &[Measure]) -> Table {
        let mut table = Table::new([
            "method",
            "shown",
            "measure",
            "unit",
            "error",
            "fold_sd",
            "median_image",
            "images",
        ]);
        for method in methods {
            for (shown, only) in [("all", false), ("arm", true)] {
                for measure in measures {
                    let wanted = |tested: &Tested| !only || self.shows_arm(tested);
                    let measured = method.measured(measure, wanted);
                    if measured.is_empty() {
                        continue;
                    }
                    let (centre, spread) = centre_and_spread(&measured);
                    let mut values: Vec<f64> = measured.iter().map(|&(_, value)| value).collect();
                    values.sort_by(f64::total_cmp);
                    table.push([
                        method.id.as_str().into(),
                        shown.into(),
                        measure.name.as_str().into(),
                        measure.unit.into(),
                        centre.into(),
                        spread.into(),
                        quantile(&values, 0.5).into(),
                        values.len().into(),
                    ]);
                }
            }
        }
        table
    }

    fn figure(&self, methods: &[Method], measures: &[Measure]) -> Figure {
        let bars = |title: &str, axis: &str, of: &[Measure], only: bool| {
            let marks = methods.iter().map(|method| {
                let bar = |measure: &Measure| {
                    let wanted = |tested: &Tested| !only || self.shows_arm(tested);
                    let (centre, spread) = centre_and_spread(&method.measured(measure, wanted));
                    (centre, Some((centre - spread, centre + spread)))
                };
                let bars = Shape::Bars(of.iter().map(bar).collect());
                Mark::new(&method.title, method.colour, bars)
            });
            Panel::Plot(Plot {
                title: title.to_owned(),
                x: Axis::of("", of.iter().map(|measure| measure.name.clone())),
                y: Axis::new(axis).including(0.0, 0.0),
                marks: marks.collect(),
            })
        };
        let little = self.specification.parameters.little_px;
        let angle = "mean absolute error (deg)";
        let by_pixels = methods.iter().map(|method| {
            let seen = |t: &Tested| (t.visible.max(1) as f64, t.error.all_deg);
            let points = method.images.iter().map(seen).collect();
            Mark::new(&method.title, method.colour, Shape::Line(fifths(points)))
        });
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Bars: mean over {} images; whiskers: one standard deviation over {} folds. Lines join \
                 the means of fifths of the images. Joint positions are those that the baseline finds, \
                 before the arm is aligned with them.",
                self.compared.protocol.images, self.compared.protocol.folds
            ),
            panels: vec![
                bars("Joint error", angle, &measures[ANGLES], false),
                bars(
                    &format!("Images with at least {little} pixels of the arm"),
                    angle,
                    &measures[ANGLES],
                    true,
                ),
                bars("Distance", "distance (m)", &measures[DISTANCES], false),
                Panel::Plot(Plot {
                    title: "Error by what is seen of the arm".to_owned(),
                    x: Axis::new("visible pixels of the arm").log(),
                    y: Axis::new("mean joint error (deg)").including(0.0, 0.0),
                    marks: by_pixels.collect(),
                }),
            ],
            columns: 2,
            size: (2200, 1400),
        }
    }
}

/// A table for the terminal: measures over all images, a column for each method.
fn text(methods: &[Method], measures: &[Measure]) -> String {
    let titles = methods.iter().map(|method| method.title.clone());
    let mut table =
        Table::new(std::iter::once("mean error (sd over folds)".to_owned()).chain(titles));
    for measure in measures {
        let row = methods.iter().map(|method| {
            let measured = method.measured(measure, |_| true);
            if measured.is_empty() {
                return Cell::Empty;
            }
            let (centre, spread) = centre_and_spread(&measured);
            let digits = if measure.unit == "m" { 3 } else { 2 };
            Cell::from(format!("{centre:.digits$} ({spread:.digits$})"))
        });
        let name = format!("{} ({})", measure.name, measure.unit);
        table.push(std::iter::once(Cell::from(name)).chain(row));
    }
    table.to_text()
}
