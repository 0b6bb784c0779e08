//! How long training takes, objective beside objective.

use super::pose_forest::PoseForestTask;
use crate::Progress;
use crate::dataset::DataSet;
use crate::experiment::manifest::timing_conditions;
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::forest::objective::Make;
use crate::forest::objective::mspd_published::mspd_published;
use crate::pose_space::disp::Disp;
use crate::robot::Robot;
use crate::training::pose::Samples;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Trains forests again and again and throws them away: the file `times.json`.
///
/// A measured time is never the same twice, so that the result is not a function of the recipe as
/// those of other tasks are. The recipe holds the processor, the number of threads and the hash of
/// this program, so that no time is reported that another one took.
pub struct TrainingTimesTask {
    /// They differ in their objective only.
    pub forests: Vec<Arc<PoseForestTask>>,
    /// MSPD as published, on fewer samples.
    pub published: Vec<PoseForestTask>,
    pub repetitions: usize,
}

/// How an objective is evaluated: as we do, or as the paper did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    Exact,
    Published,
}

impl Form {
    /// Its name in files.
    pub fn id(self) -> &'static str {
        match self {
            Form::Exact => "exact",
            Form::Published => "published",
        }
    }
}

/// One training: seconds of wall-clock time, once samples and poses are in memory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Timed {
    pub objective: String,
    pub form: Form,
    pub samples: usize,
    pub repetition: usize,
    /// DISP between the training poses.
    pub distances_s: f64,
    /// What the objective does with them before a tree is grown, such as mapping the poses.
    pub preparation_s: f64,
    pub growing_s: f64,
}

const FILE: &str = "times.json";

impl TrainingTimesTask {
    /// Reads the result from the folder that [`Task::run`] wrote.
    pub fn read(folder: &Path) -> Result<Vec<Timed>> {
        read_json(&folder.join(FILE))
    }
}

/// What stays the same from training to training.
struct Stopwatch<'a> {
    robot: &'a Robot,
    set: &'a DataSet,
}

impl Stopwatch<'_> {
    fn time(
        &self,
        task: &PoseForestTask,
        form: Form,
        samples: &Samples,
        repetition: usize,
    ) -> Result<Timed> {
        let mut distances_s = 0.0;
        let distances;
        let clock;
        let objective = match task.objective.make {
            Make::OfPoses(make) => {
                clock = Instant::now();
                make(&samples.poses)?
            }
            Make::OfDistances(make) => {
                let poses = task.images.iter().map(|&image| self.set.pose(image));
                let poses: Vec<&[f64]> = poses.collect();
                let start = Instant::now();
                distances = Disp::new(self.robot, self.set.target_joints())?.matrix(&poses);
                distances_s = start.elapsed().as_secs_f64();
                clock = Instant::now();
                match form {
                    Form::Exact => make(&distances)?,
                    Form::Published => mspd_published(&distances)?,
                }
            }
        };
        let preparation_s = clock.elapsed().as_secs_f64();
        let clock = Instant::now();
        let grown = task.grow(samples, &*objective, &|_| ())?;
        let growing_s = clock.elapsed().as_secs_f64();
        drop(grown);
        Ok(Timed {
            objective: task.objective.id.to_owned(),
            form,
            samples: samples.targets.len(),
            repetition,
            distances_s,
            preparation_s,
            growing_s,
        })
    }
}

impl Task for TrainingTimesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "training-times".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        format!("training times, {} repetitions", self.repetitions)
    }

    fn parameters(&self) -> serde_json::Value {
        let all = |tasks: &mut dyn Iterator<Item = &PoseForestTask>| -> Vec<serde_json::Value> {
            tasks.map(|task| task.parameters()).collect()
        };
        serde_json::json!({
            "forests": all(&mut self.forests.iter().map(|forest| &**forest)),
            "published": all(&mut self.published.iter()),
            "repetitions": self.repetitions,
            "conditions": timing_conditions(),
        })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        self.forests
            .iter()
            .take(1)
            .map(|forest| forest.set.clone() as Arc<dyn Task>)
            .collect()
    }

    fn cost(&self) -> Cost {
        let forests = self.forests.iter().map(|forest| forest.cost());
        let (seconds, megabytes) = forests.fold((0.0, 0.0f64), |(seconds, megabytes), cost| {
            (seconds + cost.seconds, megabytes.max(cost.megabytes))
        });
        // The published form moves a sample past all others, at every level twice as often in all.
        let trees = |task: &PoseForestTask| task.training.forest.trees as f64;
        let published = self.published.iter().map(|task| {
            let features = task.training.forest.features_per_node as f64;
            2e-9 * (task.samples() as f64).powi(2) * features * trees(task)
        });
        Cost {
            seconds: self.repetitions as f64 * (seconds + published.sum::<f64>()),
            megabytes,
        }
    }

    fn steps(&self) -> u64 {
        (self.repetitions * (self.forests.len() + self.published.len())) as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let first = self.forests.first().context("there is nothing to train")?;
        let set = DataSet::open(&inputs[0])?;
        let (rig, _) = first.set.rig()?;
        let stopwatch = Stopwatch {
            robot: &rig.robot,
            set: &set,
        };
        let samples = first.samples_of(&set, None, &|_| ())?;
        let few: Vec<Samples> = self
            .published
            .iter()
            .map(|task| task.samples_of(&set, None, &|_| ()))
            .collect::<Result<_>>()?;
        let mut times = Vec::new();
        // Side by side: what disturbs the machine for a while disturbs all alike.
        for repetition in 0..self.repetitions {
            for forest in &self.forests {
                times.push(stopwatch.time(forest, Form::Exact, &samples, repetition)?);
                progress(1);
            }
            for (task, samples) in self.published.iter().zip(&few) {
                times.push(stopwatch.time(task, Form::Published, samples, repetition)?);
                progress(1);
            }
        }
        std::fs::write(out.join(FILE), serde_json::to_vec_pretty(&times)?)?;
        Ok(())
    }
}
