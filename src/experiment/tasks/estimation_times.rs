//! How long it takes to segment an image and to estimate the pose in it, with and without
//! segmentation, and by way of parts.

use super::estimates::EstimatesTask;
use super::part_estimates::PartEstimatesTask;
use super::pose_forest::FOREST_FILE;
use super::segmentation::SegmentationTask;
use crate::Progress;
use crate::camera::DepthImage;
use crate::dataset::DataSet;
use crate::estimator::look::Look;
use crate::estimator::part_baseline::{classify, find_joints, pixel_points, voters};
use crate::estimator::segmentation::{masked, segment};
use crate::experiment::manifest::timing_conditions;
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::feature::PaddedDepth;
use crate::forest::part_forest::PartForest;
use crate::forest::pose_forest::PoseForest;
use crate::forest::segmentation_forest::SegmentationForest;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Measures the steps of an estimate on images in memory, one image after the other: the file
/// `times.json`. A measured time is never the same twice; see
/// [`TrainingTimesTask`](super::training_times::TrainingTimesTask).
pub struct EstimationTimesTask {
    /// Estimates of the same images on whole and on segmented images.
    pub whole: Arc<EstimatesTask>,
    pub segmented: Arc<EstimatesTask>,
    pub segmentation: Arc<SegmentationTask>,
    /// Estimates of the same images by the part-classification baseline, if that is timed.
    pub parts: Option<Arc<PartEstimatesTask>>,
    /// Of several the shortest counts.
    pub repetitions: usize,
    /// Absent: one for each core.
    pub threads: Option<usize>,
}

/// Seconds for one image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Timed {
    pub image: usize,
    pub segmenting_s: f64,
    /// Estimating the pixels of the whole image, and of what segmentation leaves.
    pub whole_s: f64,
    pub segmented_s: f64,
    pub parts: Option<PartTimes>,
}

/// Seconds for one image by the part-classification baseline.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartTimes {
    pub classifying_s: f64,
    /// Casting votes and finding the joints by them.
    pub voting_s: f64,
    /// Aligning the arm with the joints.
    pub aligning_s: f64,
}

const FILE: &str = "times.json";

impl EstimationTimesTask {
    /// Reads the result from the folder that [`Task::run`] wrote.
    pub fn read(folder: &Path) -> Result<Vec<Timed>> {
        read_json(&folder.join(FILE))
    }

    /// The shortest of some repetitions, s.
    fn shortest(&self, work: impl Fn()) -> f64 {
        let once = |_| {
            let clock = Instant::now();
            work();
            clock.elapsed().as_secs_f64()
        };
        (0..self.repetitions.max(1))
            .map(once)
            .fold(f64::INFINITY, f64::min)
    }
}

impl Task for EstimationTimesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "estimation-times".to_owned(),
            version: 2,
        }
    }

    fn label(&self) -> String {
        format!("times of {} estimates", self.whole.images.len())
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({
            "images": self.whole.images,
            "repetitions": self.repetitions,
            "threads": self.threads,
            "parts": self.parts.as_ref().map(|parts| parts.parameters()),
            "conditions": timing_conditions(),
        })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        let mut inputs: Vec<Arc<dyn Task>> = vec![
            self.whole.forest.set.clone(),
            self.segmentation.forest.clone(),
            self.whole.forest.clone(),
            self.segmented.forest.clone(),
        ];
        if let Some(parts) = &self.parts {
            inputs.push(parts.forest.clone());
        }
        inputs
    }

    fn cost(&self) -> Cost {
        Cost {
            seconds: 0.5 * (self.repetitions * self.whole.images.len()) as f64,
            megabytes: 500.0,
        }
    }

    fn steps(&self) -> u64 {
        self.whole.images.len() as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads.unwrap_or(0));
        let pool = pool.build().context("cannot start the threads")?;
        let times = pool.install(|| self.measure(inputs, progress))?;
        std::fs::write(out.join(FILE), serde_json::to_vec_pretty(&times)?)?;
        Ok(())
    }
}

impl EstimationTimesTask {
    fn measure(&self, inputs: &[PathBuf], progress: Progress) -> Result<Vec<Timed>> {
        let set = DataSet::open(&inputs[0])?;
        let segmenter = SegmentationForest::load(&inputs[1].join(FOREST_FILE))?;
        let whole = PoseForest::load(&inputs[2].join(FOREST_FILE))?;
        let segmented = PoseForest::load(&inputs[3].join(FOREST_FILE))?;
        let parts = match (&self.parts, inputs.get(4)) {
            (Some(parts), Some(folder)) => {
                let forest = PartForest::load(&folder.join(FOREST_FILE))?;
                Some((parts, forest, parts.aligner(&set)?))
            }
            _ => None,
        };
        let arm = set.target() + 1;
        let mut times = Vec::new();
        for &image in &self.whole.images {
            let depth = set.frame(image)?.depth;
            let classes = segment(&segmenter, &depth, arm, 1).classes;
            let of_arm = masked(&depth, |at| usize::from(classes.pixels[at]) == arm);
            let estimate = |forest: &PoseForest, depth: &DepthImage| {
                self.shortest(|| {
                    let padded = PaddedDepth::new(depth, forest.features().reach());
                    black_box(Look::new(forest, depth, &padded, 1).estimate(|_| true));
                })
            };
            let by_parts = parts.as_ref().map(|(task, forest, aligner)| {
                let votes = &task.forest.baseline.votes;
                let camera = &set.camera().intrinsics;
                let see = || {
                    let pixels = pixel_points(&depth, camera, 1);
                    (PaddedDepth::new(&depth, forest.features().reach()), pixels)
                };
                let (padded, pixels) = see();
                let features = forest.features().on(&padded);
                let classes = classify(forest, (&padded, &features), &pixels);
                let voters = voters(forest.classes(), &pixels, &classes);
                let joints = find_joints(forest, (&padded, &features), &voters, votes);
                PartTimes {
                    classifying_s: self.shortest(|| {
                        let (padded, pixels) = see();
                        let features = forest.features().on(&padded);
                        black_box(classify(forest, (&padded, &features), &pixels));
                    }),
                    voting_s: self.shortest(|| {
                        black_box(find_joints(forest, (&padded, &features), &voters, votes));
                    }),
                    aligning_s: self.shortest(|| {
                        black_box(task.align(aligner, &joints));
                    }),
                }
            });
            times.push(Timed {
                image,
                segmenting_s: self.shortest(|| {
                    black_box(segment(&segmenter, &depth, arm, 1));
                }),
                whole_s: estimate(&whole, &depth),
                segmented_s: estimate(&segmented, &of_arm),
                parts: by_parts,
            });
            progress(1);
        }
        Ok(times)
    }
}
