//! Segmenting the images of a set.

use super::data_set::DataSetTask;
use super::pose_forest::FOREST_FILE;
use super::segmentation_forest::SegmentationForestTask;
use crate::Progress;
use crate::camera::png::{read_labels, write_labels};
use crate::camera::{Intrinsics, LabelImage};
use crate::dataset::DataSet;
use crate::estimator::segmentation::{Confusion, Segmentation, segment};
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::forest::segmentation_forest::SegmentationForest;
use anyhow::{Result, bail};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Classifies every valid pixel of every image of a set. Writes 8-bit PNG images,
///
/// ```text
/// class/000000.png   0 = background or invalid, else 1 + index of the arm in the set's record
/// share/000000.png   the share of the target arm, in 255ths; 0 = none or invalid
/// ```
///
/// and `confusions.json`, which compares them with the truth.
pub struct SegmentationTask {
    pub forest: Arc<SegmentationForestTask>,
    pub set: Arc<DataSetTask>,
}

const CONFUSIONS: &str = "confusions.json";

impl SegmentationTask {
    /// Fails when the forest was trained on images of the set.
    pub fn new(
        forest: Arc<SegmentationForestTask>,
        set: Arc<DataSetTask>,
    ) -> Result<SegmentationTask> {
        let name = &set.spec.name;
        if *name == forest.set.spec.name {
            bail!(
                "the images of set {name} cannot be segmented: the segmentation forest was trained \
                 on them; take another set"
            );
        }
        Ok(SegmentationTask { forest, set })
    }

    /// Reads from the folder that [`Task::run`] wrote: for each image, how its valid pixels of each
    /// class were classified.
    pub fn confusions(folder: &Path) -> Result<Vec<Confusion>> {
        read_json(&folder.join(CONFUSIONS))
    }

    /// Reads the segmentation of one image.
    pub fn read(folder: &Path, image: usize, camera: &Intrinsics) -> Result<Segmentation> {
        Ok(Segmentation {
            classes: read_labels(&file(folder, "class", image), camera)?,
            share: read_labels(&file(folder, "share", image), camera)?,
        })
    }
}

fn file(folder: &Path, part: &str, image: usize) -> PathBuf {
    folder.join(part).join(format!("{image:06}.png"))
}

/// The true class of every pixel, as [`Segmentation::classes`] but also where depth is invalid.
pub fn true_classes(set: &DataSet, labels: &LabelImage) -> LabelImage {
    let arm_of_label = set.arm_of_label();
    let class = |&label: &u8| arm_of_label[usize::from(label)].map_or(0, |arm| arm as u8 + 1);
    LabelImage {
        width: labels.width,
        height: labels.height,
        pixels: labels.pixels.iter().map(class).collect(),
    }
}

impl Task for SegmentationTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "segmentation".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        format!("segmentation of {}", self.set.label())
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({})
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        vec![self.forest.clone(), self.set.clone()]
    }

    fn cost(&self) -> Cost {
        let walks =
            self.set.spec.images as f64 * 270_000.0 * self.forest.training.forest.trees as f64;
        Cost {
            seconds: 20e-9 * walks,
            megabytes: 300.0,
        }
    }

    fn steps(&self) -> u64 {
        self.set.spec.images as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let forest = SegmentationForest::load(&inputs[0].join(FOREST_FILE))?;
        let set = DataSet::open(&inputs[1])?;
        if forest.classes() != set.classes() {
            bail!(
                "the segmentation forest knows {}, but set {} shows {}",
                forest.classes().join(", "),
                self.set.spec.name,
                set.classes().join(", ")
            );
        }
        for part in ["class", "share"] {
            std::fs::create_dir(out.join(part))?;
        }
        let classify = |image: usize| {
            let frame = set.frame(image)?;
            let found = segment(&forest, &frame.depth, set.target() + 1, 1);
            write_labels(&file(out, "class", image), &found.classes)?;
            write_labels(&file(out, "share", image), &found.share)?;
            let mut confusion = Confusion::new(forest.classes().len());
            let truth = true_classes(&set, &frame.labels);
            let pixels = truth.pixels.iter().zip(&found.classes.pixels);
            for ((&truth, &given), &mm) in pixels.zip(&frame.depth.pixels) {
                if mm > 0 {
                    confusion.0[usize::from(truth)][usize::from(given)] += 1;
                }
            }
            progress(1);
            Ok(confusion)
        };
        let confusions = (0..set.len())
            .into_par_iter()
            .map(classify)
            .collect::<Result<Vec<_>>>()?;
        std::fs::write(out.join(CONFUSIONS), serde_json::to_vec(&confusions)?)?;
        Ok(())
    }
}
