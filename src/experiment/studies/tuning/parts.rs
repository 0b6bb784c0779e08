//! The numbers of the part-classification baseline, tuned with the budget that the pose estimation
//! forest had: on the same images, by the same rule, with as many settings.

use super::trial::{Trial, choose, data, error_deg, panel, summary};
use crate::dataset::DataSet;
use crate::estimator::error::mean_pose;
use crate::estimator::part_baseline::BaselineSpec;
use crate::experiment::figure::{Axis, Figure};
use crate::experiment::protocol::{CrossValidation, Protocol};
use crate::experiment::statistics::mean;
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::Cell;
use crate::experiment::task::Task;
use crate::experiment::tasks::part_estimates::{PartEstimatesTask, Voting};
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    pub protocol: Protocol,
    /// A file of `data/baselines/`, without extension, around which the settings vary.
    pub baseline: String,
    /// Every leaf size with every number of features per node.
    pub min_leaf: Vec<u32>,
    pub features_per_node: Vec<usize>,
    /// Each by itself.
    pub longest_m: Vec<f64>,
    pub heaviest: Vec<usize>,
    pub bandwidth_m: Vec<f64>,
    pub prior: Vec<f64>,
}

/// No claim is tested.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Test {}

/// What varies in a setting, and how the figure calls it.
const SWEEPS: [(&str, &str, &str); 5] = [
    (
        "grid",
        "Leaf size and features per node",
        "least samples in a leaf",
    ),
    ("longest", "Longest vote", "longest vote (m)"),
    ("heaviest", "Votes kept", "heaviest votes kept for a joint"),
    ("bandwidth", "Pooling", "bandwidth of mean shift (m)"),
    (
        "prior",
        "Alignment",
        "prior mu of the alignment (m^2/rad^2)",
    ),
];

const COLUMNS: [&str; 6] = [
    "min_leaf",
    "features_per_node",
    "longest_m",
    "heaviest",
    "bandwidth_m",
    "prior",
];

struct Setting {
    sweep: &'static str,
    /// The value that varies in its sweep.
    at: f64,
    baseline: BaselineSpec,
    tasks: Vec<Arc<PartEstimatesTask>>,
}

struct Tuning {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    settings: Vec<Setting>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let Specification {
        root, parameters, ..
    } = &specification;
    let protocol = parameters.protocol.clone();
    let features = protocol.training.features.count;
    let validation = CrossValidation::new(root, specification.seed, protocol)?;
    let path = root.join(format!("data/baselines/{}.toml", parameters.baseline));
    let mut base = BaselineSpec::read(&path)?;
    // Smaller profiles have fewer features.
    base.forest.features_per_node = base.forest.features_per_node.min(features);
    if let Some(count) = parameters.features_per_node.iter().find(|&&n| n > features) {
        bail!("features_per_node = {count}: choose at most {features}, the number of features");
    }
    let mut wanted: Vec<(&str, f64, BaselineSpec)> = Vec::new();
    let mut vary = |sweep, at: f64, change: &dyn Fn(&mut BaselineSpec)| {
        let mut baseline = base.clone();
        change(&mut baseline);
        wanted.push((sweep, at, baseline));
    };
    for &features in &parameters.features_per_node {
        for &leaf in &parameters.min_leaf {
            vary("grid", leaf.into(), &|b| {
                (b.forest.min_leaf, b.forest.features_per_node) = (leaf, features);
            });
        }
    }
    for &longest in &parameters.longest_m {
        vary("longest", longest, &|b| b.votes.longest_m = longest);
    }
    for &heaviest in &parameters.heaviest {
        vary("heaviest", heaviest as f64, &|b| {
            b.votes.heaviest = heaviest
        });
    }
    for &bandwidth in &parameters.bandwidth_m {
        vary("bandwidth", bandwidth, &|b| b.votes.bandwidth_m = bandwidth);
    }
    for &prior in &parameters.prior {
        vary("prior", prior, &|b| b.alignment.prior = prior);
    }
    let setting = |(sweep, at, baseline): (&'static str, f64, BaselineSpec)| {
        Ok(Setting {
            sweep,
            at,
            tasks: validation.part_estimates(&baseline, Voting::Forest)?,
            baseline,
        })
    };
    let settings = wanted.into_iter().map(setting).collect::<Result<_>>()?;
    Ok(Box::new(Tuning {
        specification,
        validation,
        settings,
    }))
}

impl Study for Tuning {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let mut tasks: Vec<Arc<dyn Task>> = vec![self.validation.set.clone()];
        for task in self.settings.iter().flat_map(|setting| &setting.tasks) {
            tasks.push(task.clone());
        }
        Ok(tasks)
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let set = DataSet::open(&done(&*self.validation.set)?)?;
        let trials = self
            .settings
            .iter()
            .map(|setting| try_out(setting, &set, done))
            .collect::<Result<Vec<Trial>>>()?;
        let mut constant = Vec::new();
        for task in self.settings.first().map_or(&[][..], |first| &first.tasks) {
            let training = &task.forest.samples.images;
            let poses = training.iter().map(|&image| set.pose(image));
            let pose = mean_pose(poses, set.circular());
            constant.extend(task.images.iter().map(|&i| error_deg(set.pose(i), &pose)));
        }
        let constant = mean(&constant);
        let choices: Vec<_> = SWEEPS
            .iter()
            .filter_map(|(sweep, ..)| choose(&trials, sweep))
            .collect();
        let mut text = String::new();
        for choice in &choices {
            let (lowest, chosen) = (&trials[choice.lowest], &trials[choice.chosen]);
            text.push_str(&format!(
                "{}: chosen {} {} with {:.2} deg, lowest {} {} with {:.2} deg\n",
                chosen.sweep,
                chosen.at.0,
                chosen.at.1,
                chosen.error(),
                lowest.at.0,
                lowest.at.1,
                lowest.error(),
            ));
        }
        text.push_str(&format!("constant pose {constant:.2} deg\n"));
        let panels = SWEEPS.iter().map(|&(sweep, title, axis)| {
            let axis = match sweep {
                "longest" | "bandwidth" => Axis::new(axis),
                _ => Axis::new(axis).log(),
            };
            panel(title, axis, &trials, sweep, constant)
        });
        let figure = Figure {
            title: self.specification.title.clone(),
            caption: "Means over the tuning images, each tested by a forest that had not seen it; whiskers: one \
                      standard error over images."
                .to_owned(),
            panels: panels.collect(),
            columns: 3,
            size: (2400, 1200),
        };
        let claims = self.specification.claims.iter();
        Ok(Report {
            data: data(&COLUMNS, &trials),
            summary: summary(&COLUMNS, &trials, &choices),
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), figure)],
            claims: claims.map(|claim| claim.without_test()).collect(),
            text,
        })
    }
}

fn try_out(setting: &Setting, set: &DataSet, done: Done<'_>) -> Result<Trial> {
    let mut results = Vec::new();
    for task in &setting.tasks {
        for estimated in PartEstimatesTask::read(&done(&**task)?)?.images {
            let error = error_deg(set.pose(estimated.image), &estimated.pose);
            results.push((estimated.image, error, task.forest.samples.fold));
        }
    }
    results.sort_by_key(|&(image, ..)| image);
    let errors_deg: Vec<f64> = results.iter().map(|&(_, error, _)| error).collect();
    let mean_error = mean(&errors_deg);
    let baseline = &setting.baseline;
    let (forest, votes) = (&baseline.forest, &baseline.votes);
    let features = forest.features_per_node;
    let (line, cost) = match setting.sweep {
        "grid" => (
            format!("{features} features a node"),
            // Features looked at, times levels of the tree.
            features as f64 * (1e6 / f64::from(forest.min_leaf)).log2(),
        ),
        "heaviest" => (String::new(), setting.at),
        // None of these costs more work than another: the lowest error is chosen.
        _ => (String::new(), mean_error),
    };
    Ok(Trial {
        sweep: setting.sweep,
        values: vec![
            Cell::Integer(forest.min_leaf.into()),
            features.into(),
            votes.longest_m.into(),
            votes.heaviest.into(),
            votes.bandwidth_m.into(),
            baseline.alignment.prior.into(),
        ],
        at: (setting.at, line),
        cost,
        errors_deg,
        folds: results.iter().map(|&(.., fold)| fold).collect(),
    })
}
