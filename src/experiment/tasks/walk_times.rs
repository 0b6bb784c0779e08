//! How fast images are estimated, whole and by fewer pixels.

use super::estimates::EstimatesTask;
use super::pose_forest::FOREST_FILE;
use super::segmentation::SegmentationTask;
use crate::Progress;
use crate::camera::DepthImage;
use crate::dataset::DataSet;
use crate::estimator::image::ImageEstimate;
use crate::estimator::look::Look;
use crate::estimator::segmentation::{masked, segment};
use crate::experiment::manifest::timing_conditions;
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::feature::PaddedDepth;
use crate::forest::pose_forest::PoseForest;
use crate::forest::segmentation_forest::SegmentationForest;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Segments and estimates images in memory, one after the other, by every pixel and by every second in
/// x and y; lets one core find the leaves of whole images; and loads a model: the file `times.json`. A
/// measured time is never the same twice; see
/// [`TrainingTimesTask`](super::training_times::TrainingTimesTask).
pub struct WalkTimesTask {
    /// Estimates of the same images on whole and on segmented images.
    pub whole: Arc<EstimatesTask>,
    pub segmented: Arc<EstimatesTask>,
    pub segmentation: Arc<SegmentationTask>,
    pub repetitions: usize,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WalkTimes {
    /// Loading the forest of whole images, its integrity checked, once for each repetition.
    pub load_ms: Vec<f64>,
    /// For each image and stride.
    pub estimates: Vec<Timed>,
    /// For each image and repetition, finding the leaves of all its valid pixels in the forest of whole
    /// images on one thread, by pixel and tree.
    pub walk_ns: Vec<f64>,
}

/// The estimate of an image by every `stride`-th row and column: segmentation, then pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Timed {
    pub image: usize,
    pub stride: usize,
    /// One for each repetition.
    pub ms: Vec<f64>,
    /// Absent when segmentation leaves nothing.
    pub estimate: Option<ImageEstimate>,
}

/// What strides are compared.
pub const STRIDES: [usize; 2] = [1, 2];

const FILE: &str = "times.json";

impl WalkTimesTask {
    /// Reads the result from the folder that [`Task::run`] wrote.
    pub fn read(folder: &Path) -> Result<WalkTimes> {
        read_json(&folder.join(FILE))
    }
}

impl Task for WalkTimesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "walk-times".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        format!("speed of {} estimates", self.whole.images.len())
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({
            "images": self.whole.images,
            "strides": STRIDES,
            "repetitions": self.repetitions,
            "conditions": timing_conditions(),
        })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        vec![
            self.whole.forest.set.clone(),
            self.segmentation.forest.clone(),
            self.whole.forest.clone(),
            self.segmented.forest.clone(),
        ]
    }

    fn cost(&self) -> Cost {
        Cost {
            seconds: 0.4 * (self.repetitions * self.whole.images.len()) as f64,
            megabytes: 500.0,
        }
    }

    fn steps(&self) -> u64 {
        self.whole.images.len() as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[0])?;
        let segmenter = SegmentationForest::load(&inputs[1].join(FOREST_FILE))?;
        let whole = || PoseForest::load(&inputs[2].join(FOREST_FILE));
        let segmented = PoseForest::load(&inputs[3].join(FOREST_FILE))?;
        let arm = set.target() + 1;
        let estimate = |depth: &DepthImage, stride: usize| {
            let classes = segment(&segmenter, depth, arm, stride).classes;
            let of_arm = masked(depth, |at| usize::from(classes.pixels[at]) == arm);
            let padded = PaddedDepth::every(stride, &of_arm, segmented.features().reach());
            Look::new(&segmented, &of_arm, &padded, stride).estimate(|_| true)
        };
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let one = one.context("cannot start a thread")?;

        let mut load_ms = Vec::new();
        for _ in 0..self.repetitions {
            let clock = Instant::now();
            black_box(whole()?);
            load_ms.push(1e3 * clock.elapsed().as_secs_f64());
        }
        let whole = whole()?;
        let (mut estimates, mut walk_ns) = (Vec::new(), Vec::new());
        for &image in &self.whole.images {
            let depth = set.frame(image)?.depth;
            let mut timed = STRIDES.map(|stride| Timed {
                image,
                stride,
                ms: Vec::new(),
                estimate: estimate(&depth, stride),
            });
            let padded = PaddedDepth::new(&depth, whole.features().reach());
            for _ in 0..self.repetitions {
                for timed in &mut timed {
                    let clock = Instant::now();
                    black_box(estimate(&depth, timed.stride));
                    timed.ms.push(1e3 * clock.elapsed().as_secs_f64());
                }
                let clock = Instant::now();
                let look = one.install(|| Look::new(&whole, &depth, &padded, 1));
                let ns = 1e9 * clock.elapsed().as_secs_f64();
                walk_ns.push(ns / (look.pixels.len() * whole.trees().len()) as f64);
            }
            estimates.extend(timed);
            progress(1);
        }
        let times = WalkTimes {
            load_ms,
            estimates,
            walk_ns,
        };
        std::fs::write(out.join(FILE), serde_json::to_vec(&times)?)?;
        Ok(())
    }
}
