//! The segmentation forest tested (section IV-C): [`scores`] for Table I, [`gallery`] for Fig. 8.

pub mod gallery;
pub mod scores;

use super::sets::SetSize;
use crate::camera::{Image, LabelImage};
use crate::dataset::DataSet;
use crate::experiment::figure::PALETTE;
use crate::experiment::study::Profile;
use crate::experiment::study_file::parameters_of;
use crate::experiment::tasks::data_set::DataSetTask;
use crate::experiment::tasks::segmentation::SegmentationTask;
use crate::experiment::tasks::segmentation_forest::SegmentationForestTask;
use crate::experiment::tasks::sight::{SegmentationKind, Sight};
use crate::training::Training;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// A segmentation forest and the images on which it is tested.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// Foreground are the pixels of either arm.
    pub training: Training,
    /// All of its images are trained on.
    pub train: SetSize,
    pub test: SetSize,
}

impl Parameters {
    /// The task that trains the forest.
    pub fn forest(&self, root: &Path, seed: u64) -> Result<Arc<SegmentationForestTask>> {
        let grow = &self.training.forest;
        // Three are added: column, row and depth.
        let features = self.training.features.count + 3;
        if !(1..=features).contains(&grow.features_per_node) {
            bail!(
                "features_per_node = {}: choose 1 to {features}, the number of features",
                grow.features_per_node
            );
        }
        Ok(Arc::new(SegmentationForestTask {
            set: set(root, &self.train, seed)?,
            training: self.training.clone(),
        }))
    }
}

/// What pose estimation forests see of the images of `set`. The segmentation forest is that of the
/// study called `study`.
pub fn sight(
    kind: SegmentationKind,
    study: &str,
    (root, profile, seed): (&Path, Profile, u64),
    set: &Arc<DataSetTask>,
) -> Result<Sight> {
    Sight::new(kind, || {
        let parameters: Parameters = parameters_of(root, profile, study)?;
        let forest = parameters.forest(root, seed)?;
        Ok(Arc::new(SegmentationTask::new(forest, set.clone())?))
    })
}

fn set(root: &Path, set: &SetSize, seed: u64) -> Result<Arc<DataSetTask>> {
    let task = DataSetTask::new(root, &set.name, set.images, seed)?;
    Ok(Arc::new(task))
}

/// The colour of a class in the figures: light blue for the background, then vermilion, blue, green.
pub fn class_colour(class: usize) -> usize {
    [5, 1, 0, 2][class % 4]
}

/// What the colours of [`class_colours`] mean, as part of a caption.
pub fn class_legend(set: &DataSet) -> String {
    let classes = set.classes();
    let arms = ["Vermilion", "blue", "green"].iter().zip(&classes[1..]);
    let arms: Vec<String> = arms
        .map(|(colour, arm)| format!("{colour}: {arm}"))
        .collect();
    format!("{}; grey: background; black: invalid.", arms.join("; "))
}

/// Classes in colours: arms as [`class_colour`] says, the background light, invalid pixels black.
pub fn class_colours(classes: &LabelImage, depth: &Image<u16>) -> Image<[u8; 3]> {
    let colour = |(&class, &mm): (&u8, &u16)| match (mm, class) {
        (0, _) => [0; 3],
        (_, 0) => [225; 3],
        (_, arm) => {
            let (r, g, b) = PALETTE[class_colour(usize::from(arm))];
            [r, g, b]
        }
    };
    let pixels = classes.pixels.iter().zip(&depth.pixels);
    Image {
        width: classes.width,
        height: classes.height,
        pixels: pixels.map(colour).collect(),
    }
}
