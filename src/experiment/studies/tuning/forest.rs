//! Leaf size and features per node, chosen on images that are used nowhere else.

use crate::estimator::error::mean_angle_error;
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{CrossValidation, Protocol, step_of};
use crate::experiment::statistics::{mean, standard_deviation};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::{Cell, Table};
use crate::experiment::task::Task;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::experiment::tasks::sight::Sight;
use crate::forest::objective::ObjectiveKind;
use crate::training::Training;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    pub objective: &'static ObjectiveKind,
    pub t_r: f64,
    /// The protocol around which the settings vary; its forest carries the chosen values.
    pub protocol: Protocol,
    /// Every leaf size with every number of features per node.
    pub min_leaf: Vec<u32>,
    pub features_per_node: Vec<usize>,
    /// Each by itself, at the protocol's other values. `trees` are the first of a forest's trees.
    pub trees: Vec<usize>,
    pub max_depth: Vec<usize>,
    pub sigma: Vec<f64>,
}

/// How a claim is tested: over the values of sigma the error varies by at most `within` of its size;
/// *partly* by at most three times that.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Test {
    within: f64,
}

/// What varies in a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sweep {
    Grid,
    Trees,
    Depth,
    Sigma,
}

impl Sweep {
    fn id(self) -> &'static str {
        match self {
            Sweep::Grid => "grid",
            Sweep::Trees => "trees",
            Sweep::Depth => "depth",
            Sweep::Sigma => "sigma",
        }
    }
}

struct Setting {
    sweep: Sweep,
    training: Training,
    sigma: f64,
    trees: usize,
    tasks: Vec<Arc<EstimatesTask>>,
}

struct Tuning {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    settings: Vec<Setting>,
    step: usize,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let parameters = &specification.parameters;
    let protocol = &parameters.protocol;
    let step = step_of(parameters.t_r)?;
    let validation =
        CrossValidation::new(&specification.root, specification.seed, protocol.clone())?;
    if parameters.min_leaf.is_empty() || parameters.features_per_node.is_empty() {
        bail!("`min_leaf` and `features_per_node` must name at least one value each");
    }
    let base = &protocol.training;
    if let Some(more) = parameters
        .trees
        .iter()
        .find(|&&trees| trees > base.forest.trees)
    {
        bail!("trees = {more}: the forest has only {}", base.forest.trees);
    }
    let mut wanted = Vec::new();
    for &features_per_node in &parameters.features_per_node {
        for &min_leaf in &parameters.min_leaf {
            let mut training = base.clone();
            training.forest.min_leaf = min_leaf;
            training.forest.features_per_node = features_per_node;
            wanted.push((Sweep::Grid, training, protocol.sigma, base.forest.trees));
        }
    }
    for &trees in &parameters.trees {
        wanted.push((Sweep::Trees, base.clone(), protocol.sigma, trees));
    }
    for &max_depth in &parameters.max_depth {
        let mut training = base.clone();
        training.forest.max_depth = Some(max_depth);
        wanted.push((Sweep::Depth, training, protocol.sigma, base.forest.trees));
    }
    for &sigma in &parameters.sigma {
        wanted.push((Sweep::Sigma, base.clone(), sigma, base.forest.trees));
    }
    let setting = |(sweep, training, sigma, trees): (Sweep, Training, f64, usize)| {
        let tasks = validation.estimates_with(
            parameters.objective,
            &Sight::WHOLE,
            &training,
            sigma,
            trees,
        )?;
        Ok(Setting {
            sweep,
            training,
            sigma,
            trees,
            tasks,
        })
    };
    let settings = wanted.into_iter().map(setting).collect::<Result<_>>()?;
    Ok(Box::new(Tuning {
        specification,
        validation,
        settings,
        step,
    }))
}

/// A setting and its error in each image.
struct Tried<'a> {
    setting: &'a Setting,
    errors_deg: Vec<f64>,
    folds: Vec<usize>,
}

impl Tried<'_> {
    fn error(&self) -> f64 {
        mean(&self.errors_deg)
    }

    /// Mean and standard error, over images, of how much larger the error is than `other`'s.
    fn excess(&self, other: &Tried) -> (f64, f64) {
        let pairs = self.errors_deg.iter().zip(&other.errors_deg);
        let differences: Vec<f64> = pairs.map(|(mine, theirs)| mine - theirs).collect();
        let count = differences.len() as f64;
        (
            mean(&differences),
            standard_deviation(&differences) / count.sqrt(),
        )
    }

    /// Grows with the work of training: features looked at, times levels of the tree.
    fn cost(&self) -> f64 {
        let forest = &self.setting.training.forest;
        forest.features_per_node as f64 * (1e6 / f64::from(forest.min_leaf)).log2()
    }
}

/// The one-standard-error rule: of the settings whose error exceeds the lowest by at most one
/// standard error of the difference, the one that is cheapest to train. (lowest, chosen).
fn choose<'a>(grid: &[&'a Tried<'a>]) -> Option<(&'a Tried<'a>, &'a Tried<'a>)> {
    let lowest = *grid.iter().min_by(|a, b| a.error().total_cmp(&b.error()))?;
    let near = grid.iter().filter(|tried| {
        let (excess, standard_error) = tried.excess(lowest);
        excess <= standard_error
    });
    let chosen = near.min_by(|a, b| a.cost().total_cmp(&b.cost()))?;
    Some((lowest, *chosen))
}

impl Study for Tuning {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let estimates = self.settings.iter().flat_map(|setting| &setting.tasks);
        Ok(self.validation.tasks(estimates))
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let mut floor = 0.0;
        let mut tried = Vec::new();
        for setting in &self.settings {
            let (one, constant) = self.try_out(setting, done)?;
            floor = constant;
            tried.push(one);
        }
        let grid: Vec<&Tried> = tried
            .iter()
            .filter(|t| t.setting.sweep == Sweep::Grid)
            .collect();
        let Some((lowest, chosen)) = choose(&grid) else {
            bail!("no setting was tried");
        };
        let protocol = &self.specification.parameters.protocol.training.forest;
        let rule = &chosen.setting.training.forest;
        let best = &lowest.setting.training.forest;
        let text = format!(
            "lowest error {:.2} deg with leaves of {} and {} features a node\n\
             one-standard-error rule: leaves of {} and {} features a node, {:.2} deg\n\
             the studies use leaves of {} and {} features a node; constant pose {floor:.2} deg\n",
            lowest.error(),
            best.min_leaf,
            best.features_per_node,
            rule.min_leaf,
            rule.features_per_node,
            chosen.error(),
            protocol.min_leaf,
            protocol.features_per_node,
        );
        Ok(Report {
            data: data(&tried),
            summary: summary(&tried, lowest, chosen),
            figures: vec![(self.specification.id.clone(), self.figure(&tried, floor))],
            claims: self
                .specification
                .claims
                .iter()
                .map(|claim| judge(claim, &tried))
                .collect(),
            text,
        })
    }
}

impl Tuning {
    /// The setting's errors, and the mean error of the constant pose.
    fn try_out<'a>(&self, setting: &'a Setting, done: Done<'_>) -> Result<(Tried<'a>, f64)> {
        let outcomes = self.validation.outcomes(&setting.tasks, done)?;
        let error = |truth: &[f64], pose: &[f64]| mean_angle_error(truth, pose).to_degrees();
        let tried = Tried {
            setting,
            errors_deg: outcomes
                .iter()
                .map(|o| error(&o.truth, &o.estimate.thresholds[self.step].pose))
                .collect(),
            folds: outcomes.iter().map(|o| o.fold).collect(),
        };
        let constant: Vec<f64> = outcomes
            .iter()
            .map(|o| error(&o.truth, &o.constant))
            .collect();
        Ok((tried, mean(&constant)))
    }

    fn figure(&self, tried: &[Tried], floor: f64) -> Figure {
        let of = |sweep: Sweep| tried.iter().filter(move |t| t.setting.sweep == sweep);
        let panel = |title: &str, x: Axis, marks: Vec<Mark>| {
            let level = Mark::new("constant pose", 7, Shape::Level(floor));
            Panel::Plot(Plot {
                title: title.to_owned(),
                x,
                y: Axis::new("mean absolute joint error (deg)"),
                marks: marks.into_iter().chain([level]).collect(),
            })
        };
        let line = |sweep: Sweep, x: &dyn Fn(&Setting) -> f64| {
            let points: Vec<(f64, f64)> = of(sweep).map(|t| (x(t.setting), t.error())).collect();
            let bars = of(sweep).map(|t| {
                let error = standard_deviation(&t.errors_deg) / (t.errors_deg.len() as f64).sqrt();
                (x(t.setting), t.error() - error, t.error() + error)
            });
            vec![
                Mark::new("", 0, Shape::Errors(bars.collect())),
                Mark::new("", 0, Shape::Line(points)),
            ]
        };
        let features = &self.specification.parameters.features_per_node;
        let grid = features.iter().enumerate().map(|(at, &count)| {
            let with =
                of(Sweep::Grid).filter(|t| t.setting.training.forest.features_per_node == count);
            let points = with.map(|t| (f64::from(t.setting.training.forest.min_leaf), t.error()));
            Mark::new(
                &format!("{count} features a node"),
                at,
                Shape::Line(points.collect()),
            )
        });
        let depth = |s: &Setting| s.training.forest.max_depth.unwrap_or(0) as f64;
        Figure {
            title: self.specification.title.clone(),
            caption: "Means over the tuning images, each tested by a forest that had not seen it; whiskers: one \
                      standard error over images."
                .to_owned(),
            panels: vec![
                panel("Leaf size and features per node", Axis::new("least samples in a leaf").log(), grid.collect()),
                panel("Trees", Axis::new("number of trees"), line(Sweep::Trees, &|s| s.trees as f64)),
                panel("Depth", Axis::new("greatest depth (splits)"), line(Sweep::Depth, &depth)),
                panel("Confidence", Axis::new("bandwidth sigma of eq. 2").log(), line(Sweep::Sigma, &|s| s.sigma)),
            ],
            columns: 2,
            size: (1800, 1200),
        }
    }
}

fn cells(setting: &Setting) -> Vec<Cell> {
    let forest = &setting.training.forest;
    vec![
        setting.sweep.id().into(),
        Cell::Integer(forest.min_leaf.into()),
        forest.features_per_node.into(),
        setting.trees.into(),
        forest.max_depth.into(),
        setting.sigma.into(),
    ]
}

const SETTING: [&str; 6] = [
    "sweep",
    "min_leaf",
    "features_per_node",
    "trees",
    "max_depth",
    "sigma",
];

fn data(tried: &[Tried]) -> Table {
    let mut table = Table::new(SETTING.into_iter().chain(["image", "fold", "error_deg"]));
    for one in tried {
        for (image, (&error, &fold)) in one.errors_deg.iter().zip(&one.folds).enumerate() {
            let result: [Cell; 3] = [image.into(), fold.into(), error.into()];
            table.push(cells(one.setting).into_iter().chain(result));
        }
    }
    table
}

fn summary(tried: &[Tried], lowest: &Tried, chosen: &Tried) -> Table {
    let results = ["error_deg", "excess_deg", "excess_se_deg", "images", "role"];
    let mut table = Table::new(SETTING.into_iter().chain(results));
    for one in tried {
        let (excess, standard_error) = one.excess(lowest);
        let role = match one {
            one if std::ptr::eq(one, chosen) => "chosen",
            one if std::ptr::eq(one, lowest) => "lowest",
            _ => "",
        };
        let result: [Cell; 5] = [
            one.error().into(),
            excess.into(),
            standard_error.into(),
            one.errors_deg.len().into(),
            role.into(),
        ];
        table.push(cells(one.setting).into_iter().chain(result));
    }
    table
}

fn judge(claim: &Claim<Test>, tried: &[Tried]) -> ClaimResult {
    let Some(Test { within }) = claim.test else {
        return claim.without_test();
    };
    let sigmas: Vec<&Tried> = tried
        .iter()
        .filter(|t| t.setting.sweep == Sweep::Sigma)
        .collect();
    if sigmas.is_empty() {
        return claim.not_checkable("no value of sigma was tried");
    }
    let errors: Vec<f64> = sigmas.iter().map(|t| t.error()).collect();
    let (low, high) = errors
        .iter()
        .fold((f64::MAX, 0.0f64), |(l, h), &e| (l.min(e), h.max(e)));
    let verdict = match (high - low) / low {
        range if range <= within => Verdict::Reproduced,
        range if range <= 3.0 * within => Verdict::Partly,
        _ => Verdict::Not,
    };
    let range = |pick: fn(f64, f64) -> f64| {
        sigmas
            .iter()
            .map(|t| t.setting.sigma)
            .reduce(pick)
            .unwrap_or(f64::NAN)
    };
    let ours = format!(
        "{low:.2} to {high:.2} deg for sigma from {} to {}",
        range(f64::min),
        range(f64::max)
    );
    let images = sigmas.first().map_or(0, |t| t.errors_deg.len());
    claim.result(ours, images, verdict)
}
