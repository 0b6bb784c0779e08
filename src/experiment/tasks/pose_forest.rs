//! Training a pose estimation forest.

use super::data_set::DataSetTask;
use super::distances::DistancesTask;
use super::sight::{Seen, Sight};
use crate::Progress;
use crate::dataset::{DataSet, DataSetError, Pixel};
use crate::experiment::task::{Cost, Stage, Task};
use crate::feature::{DepthFeatures, FeatureSpec, SampleMatrix};
use crate::forest::ForestError;
use crate::forest::bins::BinnedMatrix;
use crate::forest::grow::{GrowSpec, TargetTable};
use crate::forest::leaves::{LeafTable, grow_means};
use crate::forest::objective::{Make, Objective, ObjectiveKind};
use crate::forest::pose_forest::PoseForest;
use crate::forest::tree::Tree;
use crate::random::stream;
use anyhow::Result;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

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
#[derive(Clone)]
pub struct PoseForestTask {
    pub set: Arc<DataSetTask>,
    /// The training images, ascending.
    pub images: Vec<usize>,
    pub objective: &'static ObjectiveKind,
    pub training: Training,
    /// What the forest sees of the images, in training and when it estimates.
    pub sight: Sight,
    /// Which of several forests that differ in their images: part of the trees' seed.
    pub fold: usize,
}

/// The file in the folder of a trained forest.
pub const FOREST_FILE: &str = "forest.bin";

/// The pixels that a forest is trained on. The pixels of an image share its pose as their target.
pub struct Samples {
    pub features: DepthFeatures,
    pub binned: BinnedMatrix,
    /// One row for each training image.
    pub poses: TargetTable,
    /// The row of each sample.
    pub targets: Vec<u16>,
}

impl PoseForestTask {
    fn samples_per_image(&self) -> usize {
        self.training.foreground + self.training.background
    }

    pub fn samples(&self) -> usize {
        self.images.len() * self.samples_per_image()
    }

    /// All that trees are grown from but the objective. `set` and `segmented` are the results of
    /// `self.set` and of what `self.sight` takes as input.
    pub fn samples_of(&self, set: &DataSet, segmented: Option<&Path>) -> Result<Samples> {
        let mut stream_of_features = stream(self.set.seed, "features", &[]);
        let extra = self.sight.extra();
        let features =
            DepthFeatures::draw(&self.training.features, extra, &mut stream_of_features)?;
        // An image of which nothing is left has nothing to draw from.
        let counts: Vec<usize> = match self.sight.arm_pixels(set, segmented)? {
            Some(pixels) if self.sight.kind.removes() => {
                let has_pixels = |&image: &usize| usize::from(pixels[image] > 0);
                let images = self.images.iter().map(has_pixels);
                images.map(|any| any * self.samples_per_image()).collect()
            }
            _ => vec![self.samples_per_image(); self.images.len()],
        };
        let matrix = self.sample_matrix(set, segmented, &features, &counts)?;
        let binned = BinnedMatrix::new(&matrix)?;
        let poses: Vec<f64> = self
            .images
            .iter()
            .flat_map(|&i| set.pose(i))
            .copied()
            .collect();
        let of_image = |row: usize| std::iter::repeat_n(row as u16, counts[row]);
        Ok(Samples {
            features,
            binned,
            poses: TargetTable::new(set.target_joints().len(), poses)?,
            targets: (0..self.images.len()).flat_map(of_image).collect(),
        })
    }

    /// Trees on these samples, and the tables of their leaves.
    pub fn grow(
        &self,
        samples: &Samples,
        objective: &dyn Objective,
        progress: Progress<'_>,
    ) -> Result<(Vec<Tree>, Vec<LeafTable>), ForestError> {
        grow_means(
            &samples.binned,
            &samples.targets,
            &samples.poses,
            objective,
            &self.training.forest,
            self.seed_of_trees(),
            progress,
        )
    }

    pub fn seed_of_trees(&self) -> u64 {
        crate::random::seed(self.set.seed, "forest", &[self.fold as u64])
    }

    /// The pixels that are drawn from a training image, in the order of the samples. `arm_of_label`
    /// comes from [`DataSet::arm_of_label`].
    pub fn pixels_of(
        &self,
        seen: &Seen,
        image: usize,
        arm_of_label: &[Option<usize>; 256],
    ) -> Result<Vec<Pixel>, DataSetError> {
        let stage = format!("pixels of {}", self.set.spec.name);
        let mut stream = stream(self.set.seed, &stage, &[image as u64]);
        let (foreground, background) = (self.training.foreground, self.training.background);
        seen.sample(arm_of_label, foreground, background, &mut stream)
    }

    /// The features' values at the pixels drawn from each image. Features and pixels are the same
    /// for all folds and objectives.
    fn sample_matrix(
        &self,
        set: &DataSet,
        segmented: Option<&Path>,
        features: &DepthFeatures,
        counts: &[usize],
    ) -> Result<SampleMatrix> {
        let arms = set.arm_of_label();
        SampleMatrix::fill(features.count(), counts, |row, runs| {
            if counts[row] == 0 {
                return Ok(());
            }
            let image = self.images[row];
            let seen = self.sight.look(set, segmented, image)?;
            let pixels = self.pixels_of(&seen, image, &arms)?;
            let depth = seen.padded(features);
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
            version: 2,
        }
    }

    fn label(&self) -> String {
        let forest = &self.training.forest;
        let depth = forest
            .max_depth
            .map_or(String::new(), |most| format!(", depth {most}"));
        format!(
            "forest on {}{} (leaves {}, features {}{depth}), fold {} of {}",
            self.objective.title,
            self.sight.label(),
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
            "segmentation": self.sight.kind,
            "fold": self.fold,
            "seed": self.set.seed,
        })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        let set = self.set.clone();
        let mut inputs: Vec<Arc<dyn Task>> = vec![set.clone()];
        if let Make::OfDistances(_) = self.objective.make {
            inputs.push(Arc::new(DistancesTask { set }));
        }
        inputs.extend(self.sight.input());
        inputs
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
        let segmented = self.sight.input().and(inputs.last());
        let samples = self.samples_of(&set, segmented.map(PathBuf::as_path))?;
        let distances;
        let objective = match self.objective.make {
            Make::OfPoses(make) => make(&samples.poses)?,
            Make::OfDistances(make) => {
                distances = DistancesTask::read(&inputs[1])?.subset(&self.images);
                make(&distances)?
            }
        };
        let (trees, leaves) = self.grow(&samples, &*objective, progress)?;
        let names = set.target_joints().to_vec();
        // Whoever asks the forest chooses sigma; 1 is the paper's.
        let forest = PoseForest::new(samples.features, names, trees, leaves, 1.0)?;
        forest.save(&out.join(FOREST_FILE))?;
        Ok(())
    }
}
