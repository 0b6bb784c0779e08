//! The part forest of the baseline \[3\]: which part of the robot its trees give a pixel, and where
//! from there they expect the joints.

use super::ForestError;
use super::leaves::{LeafTable, check_leaves, mean_values};
use super::model_file::{self, Fault, ModelError};
use super::tree::Tree;
use crate::feature::{DepthFeatures, FeaturesOnImage};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What a pixel can show.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartClass {
    pub name: String,
    /// Whether its pixels vote for the joints: parts of the arm that is estimated do.
    pub votes: bool,
}

/// Trees whose leaves hold the share of each class, and votes for each joint.
#[derive(Debug, Clone, PartialEq)]
pub struct PartForest {
    header: Header,
    trees: Vec<Tree>,
    leaves: Vec<LeafTable>,
}

/// What a model file says about the forest besides its trees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    kind: Kind,
    classes: Vec<PartClass>,
    joints: Vec<String>,
    features: DepthFeatures,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Kind {
    #[serde(rename = "part forest")]
    PartForest,
}

/// A vote takes so many values: x, y, z and weight.
const VOTE: usize = 4;

impl PartForest {
    /// Joins the features that trees were grown on, the classes, the names of the joints that are
    /// voted for, the trees, and the tables of their leaves, as
    /// [`grow_parts`](super::retrofit::grow_parts) makes them: the share of each class and then, for
    /// each joint, the same number of votes.
    pub fn new(
        features: DepthFeatures,
        classes: Vec<PartClass>,
        joints: Vec<String>,
        trees: Vec<Tree>,
        leaves: Vec<LeafTable>,
    ) -> Result<Self, ForestError> {
        let header = Header {
            kind: Kind::PartForest,
            classes,
            joints,
            features,
        };
        Self::join(header, trees, leaves)
    }

    fn join(header: Header, trees: Vec<Tree>, leaves: Vec<LeafTable>) -> Result<Self, ForestError> {
        for (what, number) in [
            ("the number of classes", header.classes.len()),
            ("the number of joints", header.joints.len()),
        ] {
            if number == 0 {
                return Err(ForestError::Zero(what));
            }
        }
        let forest = Self {
            header,
            trees,
            leaves,
        };
        let votes = VOTE * forest.header.joints.len() * forest.votes_per_joint().max(1);
        let width = forest.header.classes.len() + votes;
        check_leaves(&forest.trees, &forest.leaves, width)?;
        Ok(forest)
    }

    /// Writes a model file, see [`model_file`].
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        model_file::write(path, &self.header, &self.trees, &self.leaves)
    }

    /// Reads what [`Self::save`] wrote.
    pub fn load(path: &Path) -> Result<Self, ModelError> {
        let (header, trees, leaves) =
            model_file::read(path, |header: &Header| header.features.count())?;
        Self::join(header, trees, leaves).map_err(|fault| ModelError::Unusable {
            path: path.to_owned(),
            fault: Fault::Inconsistent(fault),
        })
    }

    pub fn features(&self) -> &DepthFeatures {
        &self.header.features
    }

    /// In the order of their numbers.
    pub fn classes(&self) -> &[PartClass] {
        &self.header.classes
    }

    /// What the joints are called that are voted for.
    pub fn joints(&self) -> &[String] {
        &self.header.joints
    }

    pub fn trees(&self) -> &[Tree] {
        &self.trees
    }

    /// How many votes for a joint a leaf has room for.
    pub fn votes_per_joint(&self) -> usize {
        let width = self.leaves.first().map_or(0, LeafTable::width);
        width.saturating_sub(self.header.classes.len()) / (VOTE * self.header.joints.len())
    }

    /// The share of each class in the leaves of a pixel, mean over the trees: as
    /// [`SegmentationForest::shares`](super::segmentation_forest::SegmentationForest::shares).
    pub fn shares(&self, image: &FeaturesOnImage, positions: &[u32]) -> Vec<f32> {
        let classes = self.header.classes.len();
        mean_values(&self.trees, &self.leaves, classes, image, positions)
    }

    /// What a leaf says of a joint, the heaviest vote first: x, y and z of the joint from the point
    /// that the pixel shows, in metres along the axes of the camera's frame; and a weight, the share of
    /// the leaf's samples that stand behind the vote. A weight of 0 is no vote.
    #[inline]
    pub fn votes(&self, tree: usize, leaf: usize, joint: usize) -> &[[f32; VOTE]] {
        let votes = self.leaves[tree].row(leaf)[self.header.classes.len()..]
            .as_chunks()
            .0;
        let per_joint = self.votes_per_joint();
        &votes[joint * per_joint..(joint + 1) * per_joint]
    }
}
