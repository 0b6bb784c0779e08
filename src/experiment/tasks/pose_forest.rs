//! Training a pose estimation forest.

use super::data_set::DataSetTask;
use super::distances::DistancesTask;
use super::sight::Sight;
use crate::Progress;
use crate::dataset::DataSet;
use crate::experiment::task::{Cost, Stage, Task};
use crate::forest::ForestError;
use crate::forest::leaves::LeafTable;
use crate::forest::objective::{Make, Objective, ObjectiveKind};
use crate::forest::pose_forest::PoseForest;
use crate::forest::tree::Tree;
use crate::training::Training;
use crate::training::pose::Samples;
use anyhow::Result;
use std::path::{Path, PathBuf};
use std::sync::Arc;

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

impl PoseForestTask {
    /// An upper bound: an image of which a segmentation leaves nothing has none.
    pub fn samples(&self) -> usize {
        self.images.len() * self.training.samples_per_image()
    }

    /// All that trees are grown from but the objective. `set` and `segmented` are the results of
    /// `self.set` and of what `self.sight` takes as input.
    pub fn samples_of(
        &self,
        set: &DataSet,
        segmented: Option<&Path>,
        progress: Progress,
    ) -> Result<Samples> {
        let see = |image| self.sight.look(set, segmented, image);
        let extra = self.sight.extra();
        Samples::draw(set, &self.images, &self.training, extra, see, progress)
    }

    /// Trees on these samples, and the tables of their leaves.
    pub fn grow(
        &self,
        samples: &Samples,
        objective: &dyn Objective,
        progress: Progress,
    ) -> Result<(Vec<Tree>, Vec<LeafTable>), ForestError> {
        let (spec, seed) = (&self.training.forest, self.seed_of_trees());
        samples.grow(objective, spec, seed, progress)
    }

    /// What bootstrap and features of nodes are drawn by: the same for all objectives.
    pub fn seed_of_trees(&self) -> u64 {
        crate::random::seed(self.set.seed, "forest", &[self.fold as u64])
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
        let bytes = samples * self.training.features.count as f64;
        Cost {
            seconds: 1.0e-9 * visits + 12e-9 * bytes,
            // Columns and rows of the bins, and samples that are yet to be binned.
            megabytes: 700.0 + 2.0 * bytes / 1e6,
        }
    }

    fn steps(&self) -> u64 {
        self.training.steps(self.images.len())
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[0])?;
        let segmented = self.sight.input().and(inputs.last());
        let samples = self.samples_of(&set, segmented.map(PathBuf::as_path), progress)?;
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
        let circular = set.circular().clone();
        let forest = PoseForest::new(samples.features, names, circular, trees, leaves, 1.0)?;
        forest.save(&out.join(FOREST_FILE))?;
        Ok(())
    }
}
