//! What a pose estimation forest sees of the images: all of them, or one arm only (section III-D).

use super::segmentation::{SegmentationTask, true_classes};
use crate::camera::{DepthImage, Image};
use crate::dataset::{DataSet, DataSetError, Frame, Pixel, draw_pixels, sample_pixels};
use crate::estimator::segmentation::masked;
use crate::experiment::task::Task;
use crate::feature::{DepthFeatures, Extra, PaddedDepth};
use crate::random::Stream;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// How images are segmented before the pose is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SegmentationKind {
    /// Not at all.
    None,
    /// What the segmentation forest does not take for the estimated arm becomes invalid.
    Forest,
    /// The same with the true classes: what a perfect segmentation would bring.
    Truth,
    /// No pixel is removed; the share of the estimated arm is context for further features
    /// ([`Extra::Context`]).
    Context,
}

impl SegmentationKind {
    /// As the files call it.
    pub fn id(self) -> &'static str {
        match self {
            SegmentationKind::None => "none",
            SegmentationKind::Forest => "forest",
            SegmentationKind::Truth => "truth",
            SegmentationKind::Context => "context",
        }
    }

    /// The kind with this `id`.
    pub fn named(id: &str) -> Option<SegmentationKind> {
        let kinds = [Self::None, Self::Forest, Self::Truth, Self::Context];
        kinds.into_iter().find(|kind| kind.id() == id)
    }

    /// As figures call images segmented so.
    pub fn title(self) -> &'static str {
        match self {
            SegmentationKind::None => "images as they are",
            SegmentationKind::Forest => "segmented by the forest",
            SegmentationKind::Truth => "segmented by the truth",
            SegmentationKind::Context => "segmentation as context",
        }
    }

    pub fn needs_forest(self) -> bool {
        matches!(self, SegmentationKind::Forest | SegmentationKind::Context)
    }

    /// Whether pixels are removed.
    pub fn removes(self) -> bool {
        matches!(self, SegmentationKind::Forest | SegmentationKind::Truth)
    }
}

/// What tasks of the pose estimation forest see.
#[derive(Clone)]
pub struct Sight {
    pub kind: SegmentationKind,
    /// The segmentation of the set, where the kind needs one.
    task: Option<Arc<SegmentationTask>>,
}

/// An image as a forest sees it.
pub struct Seen {
    /// With its depth as it is, or with that of one arm only.
    pub frame: Frame,
    /// How many pixels surely show the arm that is estimated; absent without segmentation.
    pub sure_pixels: Option<usize>,
    context: Option<Image<u8>>,
    removes: bool,
}

impl Sight {
    /// All of every image.
    pub const WHOLE: Sight = Sight {
        kind: SegmentationKind::None,
        task: None,
    };

    /// `forest` segments the set that is seen; it is asked when the kind needs it.
    pub fn new(
        kind: SegmentationKind,
        forest: impl FnOnce() -> Result<Arc<SegmentationTask>>,
    ) -> Result<Sight> {
        let task = kind.needs_forest().then(forest).transpose()?;
        Ok(Sight { kind, task })
    }

    pub fn segmentation(&self) -> Option<Arc<SegmentationTask>> {
        self.task.clone()
    }

    /// The segmentation, to be among the inputs of whoever sees.
    pub fn input(&self) -> Option<Arc<dyn Task>> {
        Some(self.segmentation()?)
    }

    /// What it adds to the label of a task.
    pub fn label(&self) -> String {
        match self.kind {
            SegmentationKind::None => String::new(),
            kind => format!(", segmentation {}", kind.id()),
        }
    }

    /// The features that follow those of eq. 4.
    pub fn extra(&self) -> Extra {
        match self.kind {
            SegmentationKind::Context => Extra::Context,
            _ => Extra::Nothing,
        }
    }

    /// How many pixels of each image are classified as the arm that is estimated; `None` where nothing
    /// is. `folder` is the result of [`Sight::input`].
    pub fn arm_pixels(&self, set: &DataSet, folder: Option<&Path>) -> Result<Option<Vec<usize>>> {
        Ok(match self.kind {
            SegmentationKind::None => None,
            SegmentationKind::Truth => {
                let images = set.record().images.iter();
                Some(images.map(|image| image.arms[set.target()]).collect())
            }
            SegmentationKind::Forest | SegmentationKind::Context => {
                let confusions = SegmentationTask::confusions(folder.context("no segmentation")?)?;
                let arm = set.target() + 1;
                Some(confusions.iter().map(|image| image.given(arm)).collect())
            }
        })
    }

    /// Looks at an image. `folder` is the result of [`Sight::input`].
    pub fn look(&self, set: &DataSet, folder: Option<&Path>, image: usize) -> Result<Seen> {
        let mut frame = set.frame(image)?;
        let arm = set.target() as u8 + 1;
        let (mut context, mut sure_pixels) = (None, None);
        let classes = match self.kind {
            SegmentationKind::None => None,
            SegmentationKind::Truth => {
                sure_pixels = Some(set.record().images[image].arms[set.target()]);
                Some(true_classes(set, &frame.labels))
            }
            SegmentationKind::Forest | SegmentationKind::Context => {
                let folder = folder.context("no segmentation")?;
                let found = SegmentationTask::read(folder, image, &set.camera().intrinsics)?;
                sure_pixels = Some(found.sure_pixels());
                context = Some(found.share);
                Some(found.classes)
            }
        };
        let removes = self.kind.removes();
        if let Some(classes) = classes.filter(|_| removes) {
            frame.depth = masked(&frame.depth, |at| classes.pixels[at] == arm);
        }
        Ok(Seen {
            frame,
            sure_pixels,
            context: context.filter(|_| !removes),
            removes,
        })
    }
}

impl Seen {
    /// Draws training pixels: `foreground` of either arm and `background` others; as many in all of what
    /// is left, where pixels were removed.
    pub fn sample(
        &self,
        arm_of_label: &[Option<usize>; 256],
        foreground: usize,
        background: usize,
        stream: &mut Stream,
    ) -> Result<Vec<Pixel>, DataSetError> {
        if !self.removes {
            return sample_pixels(&self.frame, arm_of_label, foreground, background, stream);
        }
        let DepthImage { width, pixels, .. } = &self.frame.depth;
        let left: Vec<Pixel> = (0..pixels.len())
            .filter(|&at| pixels[at] > 0)
            .map(|at| ((at % width) as u16, (at / width) as u16))
            .collect();
        draw_pixels(&left, foreground + background, stream)
            .ok_or(DataSetError::NoPixels { what: "arm" })
    }

    /// The image as features read it.
    pub fn padded(&self, features: &DepthFeatures) -> PaddedDepth {
        let padded = PaddedDepth::new(&self.frame.depth, features.reach());
        match &self.context {
            Some(map) => padded.with_context(map),
            None => padded,
        }
    }
}
