//! The segmentation forest: which class its trees give a pixel (section III-D).

use super::ForestError;
use super::leaves::{LeafTable, check_leaves, mean_values};
use super::model_file::{self, Fault, ModelError};
use super::tree::Tree;
use crate::feature::{DepthFeatures, FeaturesOnImage};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Trees with the share of each class in each leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentationForest {
    header: Header,
    trees: Vec<Tree>,
    leaves: Vec<LeafTable>,
}

/// What a model file says about the forest besides its trees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    kind: Kind,
    classes: Vec<String>,
    features: DepthFeatures,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Kind {
    #[serde(rename = "segmentation forest")]
    SegmentationForest,
}

impl SegmentationForest {
    /// Joins the features that trees were grown on, the names of the classes, the trees, and the
    /// tables of their leaves, which hold the share of each class (see
    /// [`grow_means`](super::leaves::grow_means)).
    pub fn new(
        features: DepthFeatures,
        classes: Vec<String>,
        trees: Vec<Tree>,
        leaves: Vec<LeafTable>,
    ) -> Result<Self, ForestError> {
        let header = Header {
            kind: Kind::SegmentationForest,
            classes,
            features,
        };
        Self::assemble(header, trees, leaves)
    }

    /// Adds the trees of another forest. Fails when they were grown on other features or classes.
    pub fn join(self, other: Self) -> Result<Self, ForestError> {
        if self.header != other.header {
            return Err(ForestError::Different);
        }
        let trees = [self.trees, other.trees].concat();
        Self::assemble(self.header, trees, [self.leaves, other.leaves].concat())
    }

    fn assemble(
        header: Header,
        trees: Vec<Tree>,
        leaves: Vec<LeafTable>,
    ) -> Result<Self, ForestError> {
        if header.classes.is_empty() {
            return Err(ForestError::Zero("the number of classes"));
        }
        check_leaves(&trees, &leaves, header.classes.len())?;
        Ok(Self {
            header,
            trees,
            leaves,
        })
    }

    /// Writes a model file, see [`model_file`].
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        model_file::write(path, &self.header, &self.trees, &self.leaves)
    }

    /// Reads what [`Self::save`] wrote.
    pub fn load(path: &Path) -> Result<Self, ModelError> {
        let (header, trees, leaves) =
            model_file::read(path, |header: &Header| header.features.count())?;
        Self::assemble(header, trees, leaves).map_err(|fault| ModelError::Unusable {
            path: path.to_owned(),
            fault: Fault::Inconsistent(fault),
        })
    }

    pub fn features(&self) -> &DepthFeatures {
        &self.header.features
    }

    /// What the classes are called, in the order of their numbers.
    pub fn classes(&self) -> &[String] {
        &self.header.classes
    }

    pub fn trees(&self) -> &[Tree] {
        &self.trees
    }

    /// The share of each class in the leaves of a pixel, mean over the trees: pixel by pixel, one
    /// number a class, in parallel. `image` is `self.features().on(&padded)`; for `positions` see
    /// [`tree::find_leaves`](super::tree::find_leaves).
    pub fn shares(&self, image: &FeaturesOnImage, positions: &[u32]) -> Vec<f32> {
        let classes = self.header.classes.len();
        mean_values(&self.trees, &self.leaves, classes, image, positions)
    }
}
