//! Training the segmentation forest (sections III-D and IV-A).

use super::data_set::DataSetTask;
use super::pose_forest::FOREST_FILE;
use crate::Progress;
use crate::dataset::DataSet;
use crate::experiment::task::{Cost, Stage, Task};
use crate::random::seed;
use crate::training::{self, Training};
use anyhow::Result;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Trains a forest that tells the arms and the background apart on all images of a set: the file
/// [`FOREST_FILE`].
pub struct SegmentationForestTask {
    pub set: Arc<DataSetTask>,
    pub training: Training,
}

impl SegmentationForestTask {
    fn images(&self) -> usize {
        self.set.spec.images
    }
}

impl Task for SegmentationForestTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "segmentation-forest".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        let forest = &self.training.forest;
        format!(
            "segmentation forest (leaves {}, features {}), {} images of {}",
            forest.min_leaf,
            forest.features_per_node,
            self.images(),
            self.set.spec.name
        )
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({ "training": self.training, "seed": self.set.seed })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        vec![self.set.clone()]
    }

    fn cost(&self) -> Cost {
        let samples = (self.images() * self.training.samples_per_image()) as f64;
        let forest = &self.training.forest;
        let levels = (samples / f64::from(forest.min_leaf)).log2().max(1.0);
        let visits = samples * levels * forest.features_per_node as f64 * forest.trees as f64;
        let bytes = samples * self.training.features.count as f64;
        Cost {
            seconds: 1.0e-9 * visits + 0.02 * self.images() as f64,
            megabytes: 700.0 + 2.2 * bytes / 1e6,
        }
    }

    fn steps(&self) -> u64 {
        self.training.steps(self.images())
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[0])?;
        let images: Vec<usize> = (0..set.len()).collect();
        let seed = seed(self.set.seed, "segmentation forest", &[]);
        let training = &self.training;
        let forest = training::segmentation::train(&set, &images, training, &[], seed, progress)?;
        forest.save(&out.join(FOREST_FILE))?;
        Ok(())
    }
}
