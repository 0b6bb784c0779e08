//! Training the segmentation forest (sections III-D and IV-A).

use super::data_set::DataSetTask;
use super::pose_forest::{FOREST_FILE, Training};
use crate::Progress;
use crate::dataset::{DataSet, sample_pixels};
use crate::experiment::task::{Cost, Stage, Task};
use crate::feature::{DepthFeatures, Extra, PaddedDepth, SampleMatrix};
use crate::forest::bins::{BinCounter, BinnedMatrix};
use crate::forest::grow::TargetTable;
use crate::forest::leaves::grow_means;
use crate::forest::objective::mse::mse;
use crate::forest::segmentation_forest::SegmentationForest;
use crate::random::{seed, stream};
use anyhow::Result;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Trains a forest that tells the arms and the background apart on all images of a set: the file
/// [`FOREST_FILE`].
pub struct SegmentationForestTask {
    pub set: Arc<DataSetTask>,
    pub training: Training,
}

/// Images whose samples are held in memory as they are, before they are binned.
const PART: usize = 32;
/// A tree takes about as long as so many images.
const TREE_STEPS: u64 = 400;

impl SegmentationForestTask {
    fn images(&self) -> usize {
        self.set.spec.images
    }

    fn samples_per_image(&self) -> usize {
        self.training.foreground + self.training.background
    }

    /// All images, in parts.
    fn parts(&self) -> impl Iterator<Item = Range<usize>> {
        let images = self.images();
        (0..images)
            .step_by(PART)
            .map(move |first| first..images.min(first + PART))
    }

    /// The features' values and the classes of the pixels drawn from some images.
    fn samples(
        &self,
        set: &DataSet,
        features: &DepthFeatures,
        images: Range<usize>,
    ) -> Result<(SampleMatrix, Vec<u16>)> {
        let counts = vec![self.samples_per_image(); images.len()];
        let arm_of_label = set.arm_of_label();
        let classes = Mutex::new(vec![0; counts.len() * self.samples_per_image()]);
        let matrix = SampleMatrix::fill(features.count(), &counts, |row, runs| {
            let image = images.start + row;
            let frame = set.frame(image)?;
            let stage = format!("pixels of {}", self.set.spec.name);
            let mut stream = stream(self.set.seed, &stage, &[image as u64]);
            let (foreground, background) = (self.training.foreground, self.training.background);
            let pixels = sample_pixels(&frame, &arm_of_label, foreground, background, &mut stream)?;
            let depth = PaddedDepth::new(&frame.depth, features.reach());
            let position = |&(x, y): &(u16, u16)| depth.position(x.into(), y.into());
            let positions: Vec<u32> = pixels.iter().map(position).collect();
            features.fill(&depth, &positions, runs);
            let class = |&(x, y): &(u16, u16)| {
                let at = usize::from(y) * frame.labels.width + usize::from(x);
                let arm = arm_of_label[usize::from(frame.labels.pixels[at])];
                arm.map_or(0, |arm| arm as u16 + 1)
            };
            let of_image: Vec<u16> = pixels.iter().map(class).collect();
            if let Ok(mut classes) = classes.lock() {
                let from = row * self.samples_per_image();
                classes[from..from + of_image.len()].copy_from_slice(&of_image);
            }
            anyhow::Ok(())
        })?;
        Ok((matrix, classes.into_inner().unwrap_or_default()))
    }

    /// The samples of all images, which are read twice: once to count values, once to bin them.
    fn binned(
        &self,
        set: &DataSet,
        features: &DepthFeatures,
        progress: Progress,
    ) -> Result<(BinnedMatrix, Vec<u16>)> {
        let mut counter = BinCounter::default();
        let mut classes = Vec::new();
        for part in self.parts() {
            let (matrix, of_part) = self.samples(set, features, part.clone())?;
            counter.add(&matrix)?;
            classes.extend(of_part);
            progress(part.len() as u64);
        }
        let mut binned = counter.finish()?;
        for part in self.parts() {
            binned.push(&self.samples(set, features, part.clone())?.0);
            progress(part.len() as u64);
        }
        Ok((binned, classes))
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
        let samples = (self.images() * self.samples_per_image()) as f64;
        let forest = &self.training.forest;
        let levels = (samples / f64::from(forest.min_leaf)).log2().max(1.0);
        let visits = samples * levels * forest.features_per_node as f64 * forest.trees as f64;
        let bytes = samples * self.training.features.count as f64;
        Cost {
            seconds: 1.0e-9 * visits + 0.02 * self.images() as f64,
            megabytes: 200.0 + 2.2 * bytes / 1e6,
        }
    }

    fn steps(&self) -> u64 {
        2 * self.images() as u64 + TREE_STEPS * self.training.forest.trees as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[0])?;
        let mut random = stream(self.set.seed, "segmentation features", &[]);
        let features = DepthFeatures::draw(&self.training.features, Extra::Pixel, &mut random)?;
        let (binned, classes) = self.binned(&set, &features, progress)?;

        // One target a class, 1 for itself and 0 for the others: the mean over a leaf is the share of
        // each class, and the variance of eq. 5 a third of the Gini impurity 1 - sum of shares squared.
        let names = set.classes();
        let one_hot = |row: usize| (0..names.len()).map(move |at| f64::from(u8::from(at == row)));
        let table = TargetTable::new(names.len(), (0..names.len()).flat_map(one_hot).collect())?;
        let (trees, leaves) = grow_means(
            &binned,
            &classes,
            &table,
            &*mse(&table)?,
            &self.training.forest,
            seed(self.set.seed, "segmentation forest", &[]),
            &|trees| progress(TREE_STEPS * trees),
        )?;
        let forest = SegmentationForest::new(features, names, trees, leaves)?;
        forest.save(&out.join(FOREST_FILE))?;
        Ok(())
    }
}
