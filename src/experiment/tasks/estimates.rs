//! Estimating the pose in images that a forest was not trained on.

use super::data_set::DataSetTask;
use super::pose_forest::{FOREST_FILE, PoseForestTask};
use super::sight::Sight;
use crate::Progress;
use crate::dataset::DataSet;
use crate::estimator::image::ImageEstimate;
use crate::estimator::look::Look;
use crate::estimator::segmentation::LEAST_ARM_PIXELS;
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::forest::pose_forest::PoseForest;
use anyhow::{Result, bail};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Estimates the pose in some images with the valid pixels that the forest sees: the file
/// `estimates.json`.
pub struct EstimatesTask {
    pub forest: Arc<PoseForestTask>,
    /// The set of the test images.
    pub set: Arc<DataSetTask>,
    /// What is seen of them.
    pub sight: Sight,
    /// The test images, ascending.
    pub images: Vec<usize>,
    /// The bandwidth of eq. 2.
    pub sigma: f64,
    /// How many of the forest's trees take part, from the first on.
    pub trees: usize,
    /// Only the pixels of every such row and column take part; 1 for all.
    pub stride: usize,
}

/// What came out for one image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimated {
    pub image: usize,
    /// Pixels that surely show the arm; absent without segmentation.
    pub sure_pixels: Option<usize>,
    /// Absent when these are fewer than [`LEAST_ARM_PIXELS`], or when no pixel takes part: then nothing
    /// can be said of the pose.
    pub estimate: Option<ImageEstimate>,
}

const FILE: &str = "estimates.json";

impl EstimatesTask {
    /// Of images of the training images' set, seen as those. Fails when an image is among those that the
    /// forest was trained on.
    pub fn new(
        forest: Arc<PoseForestTask>,
        images: Vec<usize>,
        sigma: f64,
        trees: usize,
        stride: usize,
    ) -> Result<EstimatesTask> {
        if let Some(image) = images.iter().find(|image| forest.images.contains(image)) {
            let set = &forest.set.spec.name;
            bail!("image {image} of set {set} is in the training and in the test images");
        }
        Ok(EstimatesTask {
            set: forest.set.clone(),
            sight: forest.sight.clone(),
            forest,
            images,
            sigma,
            trees,
            stride,
        })
    }

    /// Of all images of another set, with all trees and pixels. Fails when it is not another.
    pub fn of_other_set(
        forest: Arc<PoseForestTask>,
        set: Arc<DataSetTask>,
        sight: Sight,
        sigma: f64,
    ) -> Result<EstimatesTask> {
        let name = &set.spec.name;
        if *name == forest.set.spec.name {
            bail!("the images of set {name} are in the training and in the test images");
        }
        Ok(EstimatesTask {
            images: (0..set.spec.images).collect(),
            trees: forest.training.forest.trees,
            set,
            sight,
            forest,
            sigma,
            stride: 1,
        })
    }

    /// Reads the result from the folder that [`Task::run`] wrote: in the order of the images.
    pub fn read(folder: &Path) -> Result<Vec<Estimated>> {
        read_json(&folder.join(FILE))
    }
}

impl Task for EstimatesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "estimates".to_owned(),
            version: 2,
        }
    }

    fn label(&self) -> String {
        let elsewhere = match self.set.spec.name == self.forest.set.spec.name {
            true => String::new(),
            false => format!(" on {}{}", self.set.spec.name, self.sight.label()),
        };
        format!(
            "estimates with {} trees, sigma {}{elsewhere}: {}",
            self.trees,
            self.sigma,
            self.forest.label()
        )
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({ "images": self.images, "sigma": self.sigma, "trees": self.trees, "stride": self.stride })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        let mut inputs: Vec<Arc<dyn Task>> = vec![self.forest.clone(), self.set.clone()];
        inputs.extend(self.sight.input());
        inputs
    }

    fn cost(&self) -> Cost {
        let walks =
            self.images.len() as f64 * 270_000.0 / self.stride.pow(2) as f64 * self.trees as f64;
        Cost {
            seconds: 20e-9 * walks + 0.02 * self.images.len() as f64,
            megabytes: 300.0,
        }
    }

    fn steps(&self) -> u64 {
        self.images.len() as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[1])?;
        let mut forest = PoseForest::load(&inputs[0].join(FOREST_FILE))?;
        forest.keep_trees(self.trees);
        forest.set_sigma(self.sigma)?;
        let sight = &self.sight;
        let segmented = inputs.get(2).map(PathBuf::as_path);
        let arm_of_label = set.arm_of_label();
        let estimate = |&image: &usize| {
            let seen = sight.look(&set, segmented, image)?;
            let depth = seen.padded(forest.features());
            let look = Look::new(&forest, &seen.frame.depth, &depth, self.stride);
            let labels = &seen.frame.labels.pixels;
            let shows_arm = |at: usize| arm_of_label[usize::from(labels[at])].is_some();
            let sure_pixels = seen.sure_pixels;
            let estimate = match sure_pixels {
                Some(pixels) if pixels < LEAST_ARM_PIXELS => None,
                _ => look.estimate(shows_arm),
            };
            progress(1);
            Ok(Estimated {
                image,
                sure_pixels,
                estimate,
            })
        };
        let estimated = self
            .images
            .par_iter()
            .map(estimate)
            .collect::<Result<Vec<_>>>()?;
        std::fs::write(out.join(FILE), serde_json::to_vec(&estimated)?)?;
        Ok(())
    }
}
