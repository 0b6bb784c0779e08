//! What a pose estimation forest sees of the images: all of them, or one arm only (section III-D).

use super::segmentation::{SegmentationTask, true_classes};
use crate::dataset::DataSet;
use crate::experiment::task::Task;
use crate::feature::Extra;
use crate::training::seen::Seen;
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

    /// Whether a segmentation forest must be trained for it.
    pub fn needs_forest(self) -> bool {
        matches!(self, SegmentationKind::Forest | SegmentationKind::Context)
    }
}

/// What tasks of the pose estimation forest see.
#[derive(Clone)]
pub struct Sight {
    pub kind: SegmentationKind,
    /// The segmentation of the set, where the kind needs one.
    task: Option<Arc<SegmentationTask>>,
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

    /// What segments the set; `None` where the kind needs nothing trained.
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

    /// Looks at an image. `folder` is the result of [`Sight::input`].
    pub fn look(&self, set: &DataSet, folder: Option<&Path>, image: usize) -> Result<Seen> {
        let frame = set.frame(image)?;
        let arm = set.target() as u8 + 1;
        let found = || {
            let folder = folder.context("no segmentation")?;
            SegmentationTask::read(folder, image, &set.camera().intrinsics)
        };
        Ok(match self.kind {
            SegmentationKind::None => Seen::whole(frame),
            SegmentationKind::Truth => {
                let sure_pixels = set.record().images[image].arms[set.target()];
                let classes = true_classes(set, &frame.labels);
                Seen::segmented(frame, &classes, arm, sure_pixels)
            }
            SegmentationKind::Forest => {
                let found = found()?;
                Seen::segmented(frame, &found.classes, arm, found.sure_pixels())
            }
            SegmentationKind::Context => {
                let found = found()?;
                let sure_pixels = found.sure_pixels();
                Seen::with_context(frame, found.share, sure_pixels)
            }
        })
    }
}
