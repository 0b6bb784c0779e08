//! Training a pose estimation forest.

use super::data_set::DataSetTask;
use crate::Progress;
use crate::dataset::{DataSet, sample_pixels};
use crate::experiment::task::{Cost, Stage, Task};
use crate::feature::{DepthFeatures, FeatureSpec, PaddedDepth, SampleMatrix};
use crate::forest::bins::BinnedMatrix;
use crate::forest::grow::{GrowSpec, TargetTable};
use crate::forest::leaves::grow_means;
use crate::forest::objective::{Objective, mse::mse};
use crate::forest::pose_forest::PoseForest;
use crate::random::stream;
use anyhow::Result;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What the split of a node is chosen by (section III-B).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObjectiveName {
    Mse,
}

impl ObjectiveName {
    /// As the files call it.
    pub fn id(self) -> &'static str {
        match self {
            ObjectiveName::Mse => "mse",
        }
    }

    /// As the paper calls it.
    pub fn title(self) -> &'static str {
        match self {
            ObjectiveName::Mse => "MSE",
        }
    }

    fn objective(self, poses: &TargetTable) -> Result<Box<dyn Objective + '_>> {
        Ok(match self {
            ObjectiveName::Mse => mse(poses)?,
        })
    }
}

/// How a forest is trained on images, whichever they are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Training {
    /// Pixels of either arm drawn from each image.
    pub foreground: usize,
    /// Other valid pixels drawn from each image.
    pub background: usize,
    pub features: FeatureSpec,
    pub forest: GrowSpec,
}

/// Trains a forest on some images of a set: the file `forest.bin`.
pub struct PoseForestTask {
    pub set: Arc<DataSetTask>,
    /// The training images, ascending.
    pub images: Vec<usize>,
    pub objective: ObjectiveName,
    pub training: Training,
    /// Which of several forests that differ in their images: part of the trees' seed.
    pub fold: usize,
}

/// The file in the folder of a trained forest.
pub const FOREST_FILE: &str = "forest.bin";

impl PoseForestTask {
    fn samples_per_image(&self) -> usize {
        self.training.foreground + self.training.background
    }

    fn samples(&self) -> usize {
        self.images.len() * self.samples_per_image()
    }

    /// The features' values at the pixels drawn from each image. Features and pixels are the same
    /// for all folds and objectives.
    fn sample_matrix(&self, set: &DataSet, features: &DepthFeatures) -> Result<SampleMatrix> {
        let arms = set.arm_of_label();
        let counts = vec![self.samples_per_image(); self.images.len()];
        SampleMatrix::fill(features.count(), &counts, |row, runs| {
            let image = self.images[row];
            let frame = set.frame(image)?;
            let mut stream = stream(
                self.set.seed,
                &format!("pixels of {}", self.set.spec.name),
                &[image as u64],
            );
            let (foreground, background) = (self.training.foreground, self.training.background);
            let pixels = sample_pixels(&frame, &arms, foreground, background, &mut stream)?;
            let depth = PaddedDepth::new(&frame.depth, features.reach());
            let positions: Vec<u32> = pixels
                .iter()
                .map(|&(x, y)| depth.position(x.into(), y.into()))
                .collect();
            features.fill(&depth, &positions, runs);
            anyhow::Ok(())
        })
    }
}

impl Task for PoseForestTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "pose-forest".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        let forest = &self.training.forest;
        let depth = forest
            .max_depth
            .map_or(String::new(), |most| format!(", depth {most}"));
        format!(
            "forest on {} (leaves {}, features {}{depth}), fold {} of {}",
            self.objective.title(),
            forest.min_leaf,
            forest.features_per_node,
            self.fold + 1,
            self.set.spec.name
        )
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({
            "images": self.images,
            "objective": self.objective,
            "training": self.training,
            "fold": self.fold,
            "seed": self.set.seed,
        })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        vec![self.set.clone()]
    }

    fn cost(&self) -> Cost {
        let samples = self.samples() as f64;
        let forest = &self.training.forest;
        // Visits of a sample by a feature: one a level, and the levels grow with the logarithm.
        let levels = (samples / f64::from(forest.min_leaf)).log2().max(1.0);
        let visits = samples * levels * forest.features_per_node as f64 * forest.trees as f64;
        let bytes = samples * self.training.features.count as f64 * 3.0;
        Cost {
            seconds: 1.0e-9 * visits + 4e-9 * bytes,
            megabytes: 100.0 + bytes / 1e6,
        }
    }

    fn steps(&self) -> u64 {
        self.training.forest.trees as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[0])?;
        let mut stream_of_features = stream(self.set.seed, "features", &[]);
        let features = DepthFeatures::draw(&self.training.features, &mut stream_of_features)?;
        let binned = BinnedMatrix::new(&self.sample_matrix(&set, &features)?)?;

        let names = set.target_joints().to_vec();
        let poses: Vec<f64> = self
            .images
            .iter()
            .flat_map(|&i| set.pose(i))
            .copied()
            .collect();
        let poses = TargetTable::new(names.len(), poses)?;
        let of_image = |row: usize| std::iter::repeat_n(row as u16, self.samples_per_image());
        let targets: Vec<u16> = (0..self.images.len()).flat_map(of_image).collect();
        let objective = self.objective.objective(&poses)?;
        let (trees, leaves) = grow_means(
            &binned,
            &targets,
            &poses,
            &*objective,
            &self.training.forest,
            crate::random::seed(self.set.seed, "forest", &[self.fold as u64]),
            progress,
        )?;
        // Whoever asks the forest chooses sigma; 1 is the paper's.
        PoseForest::new(features, names, trees, leaves, 1.0)?.save(&out.join(FOREST_FILE))?;
        Ok(())
    }
}
