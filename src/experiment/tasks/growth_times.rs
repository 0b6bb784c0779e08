//! How the time of growing trees grows with the number of samples.

use super::pose_forest::PoseForestTask;
use crate::Progress;
use crate::dataset::DataSet;
use crate::experiment::manifest::timing_conditions;
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::forest::objective::Make;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Grows trees from more and more images and throws them away: the file `times.json`. A measured
/// time is never the same twice; see [`TrainingTimesTask`](super::training_times::TrainingTimesTask).
pub struct GrowthTimesTask {
    /// Of one set; they differ in how many images they are trained on. Nothing is segmented.
    pub forests: Vec<PoseForestTask>,
    pub repetitions: usize,
}

/// One growing of a forest, once samples are in memory and binned.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Grown {
    pub samples: usize,
    pub repetition: usize,
    pub seconds: f64,
    /// Of the first tree.
    pub leaves: usize,
    pub depth: usize,
}

const FILE: &str = "times.json";

impl GrowthTimesTask {
    /// Reads the result from the folder that [`Task::run`] wrote.
    pub fn read(folder: &Path) -> Result<Vec<Grown>> {
        read_json(&folder.join(FILE))
    }
}

impl Task for GrowthTimesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "growth-times".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        let most = self.forests.iter().map(PoseForestTask::samples).max();
        format!("times of growing on up to {} samples", most.unwrap_or(0))
    }

    fn parameters(&self) -> serde_json::Value {
        let forests: Vec<_> = self.forests.iter().map(|f| f.parameters()).collect();
        serde_json::json!({
            "forests": forests,
            "repetitions": self.repetitions,
            "conditions": timing_conditions(),
        })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        let sets = self.forests.iter().map(|forest| forest.set.clone());
        sets.take(1).map(|set| set as Arc<dyn Task>).collect()
    }

    fn cost(&self) -> Cost {
        let costs = self.forests.iter().map(|forest| forest.cost());
        let sum = |(seconds, most): (f64, f64), cost: Cost| {
            (seconds + cost.seconds, most.max(cost.megabytes))
        };
        let (seconds, megabytes) = costs.fold((0.0, 0.0), sum);
        Cost {
            seconds: self.repetitions as f64 * seconds,
            megabytes,
        }
    }

    fn steps(&self) -> u64 {
        (self.forests.len() * self.repetitions) as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(inputs.first().context("there is nothing to grow on")?)?;
        let mut times = Vec::new();
        for forest in &self.forests {
            let samples = forest.samples_of(&set, None, &|_| ())?;
            let Make::OfPoses(make) = forest.objective.make else {
                bail!(
                    "{} rests on distances: choose another objective",
                    forest.objective.title
                );
            };
            let objective = make(&samples.poses)?;
            for repetition in 0..self.repetitions {
                let clock = Instant::now();
                let (trees, _leaves) = forest.grow(&samples, &*objective, &|_| ())?;
                let seconds = clock.elapsed().as_secs_f64();
                let first = trees.first().context("there are no trees")?;
                times.push(Grown {
                    samples: samples.targets.len(),
                    repetition,
                    seconds,
                    leaves: first.leaves(),
                    depth: first.depth(),
                });
                progress(1);
            }
        }
        std::fs::write(out.join(FILE), serde_json::to_vec_pretty(&times)?)?;
        Ok(())
    }
}
