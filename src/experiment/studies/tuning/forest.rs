//! Leaf size and features per node of the pose estimation forest.

use super::trial::{Trial, choose, data, error_deg, panel, summary};
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{Axis, Figure};
use crate::experiment::protocol::{CrossValidation, Protocol, step_of};
use crate::experiment::statistics::mean;
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::Cell;
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

impl Study for Tuning {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let estimates = self.settings.iter().flat_map(|setting| &setting.tasks);
        Ok(self.validation.tasks(estimates))
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let mut constant = 0.0;
        let mut trials = Vec::new();
        for setting in &self.settings {
            let (trial, of_constant) = self.try_out(setting, done)?;
            constant = of_constant;
            trials.push(trial);
        }
        let Some(choice) = choose(&trials, Sweep::Grid.id()) else {
            bail!("no setting was tried");
        };
        let protocol = &self.specification.parameters.protocol.training.forest;
        let rule = &self.settings[choice.chosen].training.forest;
        let best = &self.settings[choice.lowest].training.forest;
        let text = format!(
            "lowest error {:.2} deg with leaves of {} and {} features a node\n\
             one-standard-error rule: leaves of {} and {} features a node, {:.2} deg\n\
             the studies use leaves of {} and {} features a node; constant pose {constant:.2} deg\n",
            trials[choice.lowest].error(),
            best.min_leaf,
            best.features_per_node,
            rule.min_leaf,
            rule.features_per_node,
            trials[choice.chosen].error(),
            protocol.min_leaf,
            protocol.features_per_node,
        );
        Ok(Report {
            data: data(&SETTING, &trials),
            summary: summary(&SETTING, &trials, &[choice]),
            tables: Vec::new(),
            figures: vec![(
                self.specification.id.clone(),
                self.figure(&trials, constant),
            )],
            claims: self
                .specification
                .claims
                .iter()
                .map(|claim| self.judge(claim, &trials))
                .collect(),
            text,
        })
    }
}

impl Tuning {
    /// The setting's errors, and the mean error of the constant pose.
    fn try_out(&self, setting: &Setting, done: Done<'_>) -> Result<(Trial, f64)> {
        let outcomes = self.validation.outcomes(&setting.tasks, done)?;
        let estimates = outcomes
            .iter()
            .map(|o| error_deg(&o.truth, &o.estimate.thresholds[self.step].pose));
        let constant: Vec<f64> = outcomes
            .iter()
            .map(|o| error_deg(&o.truth, &o.constant))
            .collect();
        let forest = &setting.training.forest;
        let features = forest.features_per_node;
        let (at, line) = match setting.sweep {
            Sweep::Grid => (
                f64::from(forest.min_leaf),
                format!("{features} features a node"),
            ),
            Sweep::Trees => (setting.trees as f64, String::new()),
            Sweep::Depth => (forest.max_depth.unwrap_or(0) as f64, String::new()),
            Sweep::Sigma => (setting.sigma, String::new()),
        };
        let trial = Trial {
            sweep: setting.sweep.id(),
            values: values(setting),
            at: (at, line),
            // Features looked at, times levels of the tree.
            cost: features as f64 * (1e6 / f64::from(forest.min_leaf)).log2(),
            errors_deg: estimates.collect(),
            folds: outcomes.iter().map(|o| o.fold).collect(),
        };
        Ok((trial, mean(&constant)))
    }

    fn figure(&self, trials: &[Trial], constant: f64) -> Figure {
        let panel = |title, x, sweep: Sweep| panel(title, x, trials, sweep.id(), constant);
        let leaf = Axis::new("least samples in a leaf").log();
        let sigma = Axis::new("bandwidth sigma of eq. 2").log();
        Figure {
            title: self.specification.title.clone(),
            caption: "Means over the tuning images, each tested by a forest that had not seen it; whiskers: one \
                      standard error over images."
                .to_owned(),
            panels: vec![
                panel("Leaf size and features per node", leaf, Sweep::Grid),
                panel("Trees", Axis::new("number of trees"), Sweep::Trees),
                panel("Depth", Axis::new("greatest depth (splits)"), Sweep::Depth),
                panel("Confidence", sigma, Sweep::Sigma),
            ],
            columns: 2,
            size: (1800, 1200),
        }
    }

    fn judge(&self, claim: &Claim<Test>, trials: &[Trial]) -> ClaimResult {
        let Some(Test { within }) = claim.test else {
            return claim.without_test();
        };
        let of_sigma: Vec<&Trial> = trials
            .iter()
            .filter(|t| t.sweep == Sweep::Sigma.id())
            .collect();
        let range = |value: &dyn Fn(&Trial) -> f64| {
            let values = of_sigma.iter().map(|t| value(t));
            values.fold((f64::MAX, 0.0f64), |(low, high), v| {
                (low.min(v), high.max(v))
            })
        };
        if of_sigma.is_empty() {
            return claim.not_checkable("no value of sigma was tried");
        }
        let (low, high) = range(&Trial::error);
        let verdict = match (high - low) / low {
            range if range <= within => Verdict::Reproduced,
            range if range <= 3.0 * within => Verdict::Partly,
            _ => Verdict::Not,
        };
        let (least, most) = range(&|t| t.at.0);
        let ours = format!("{low:.2} to {high:.2} deg for sigma from {least} to {most}");
        claim.result(ours, of_sigma[0].errors_deg.len(), verdict)
    }
}

fn values(setting: &Setting) -> Vec<Cell> {
    let forest = &setting.training.forest;
    vec![
        Cell::Integer(forest.min_leaf.into()),
        forest.features_per_node.into(),
        setting.trees.into(),
        forest.max_depth.into(),
        setting.sigma.into(),
    ]
}

const SETTING: [&str; 5] = [
    "min_leaf",
    "features_per_node",
    "trees",
    "max_depth",
    "sigma",
];
