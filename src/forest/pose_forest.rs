//! The pose estimation forest: what its trees say of a pixel, and how sure they are (section II-A).

use super::ForestError;
use super::leaves::{LeafTable, check_leaves};
use super::model_file::{self, Fault, ModelError};
use super::tree::{self, Tree};
use crate::circular::Circular;
use crate::feature::{DepthFeatures, FeaturesOnImage};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Trees with the mean pose and the confidence of each leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseForest {
    header: Header,
    trees: Vec<Tree>,
    leaves: Vec<LeafTable>,
    /// Eq. 2 for each leaf of each tree.
    confidences: Vec<Vec<f32>>,
}

/// What a model file says about the forest besides its trees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    kind: Kind,
    names: Vec<String>,
    #[serde(default, skip_serializing_if = "Circular::is_empty")]
    circular: Circular,
    sigma: f64,
    features: DepthFeatures,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Kind {
    #[serde(rename = "pose forest")]
    PoseForest,
}

/// Pixels that a thread takes at once.
const RUN: usize = 1 << 14;

impl PoseForest {
    /// Joins the features that trees were grown on, the names of a pose's values and which of them are
    /// circular, the trees, the tables of their leaves (see
    /// [`grow_means`](super::leaves::grow_means)), which hold the columns that `circular` makes of
    /// poses, and the bandwidth of eq. 2.
    pub fn new(
        features: DepthFeatures,
        names: Vec<String>,
        circular: Circular,
        trees: Vec<Tree>,
        leaves: Vec<LeafTable>,
        sigma: f64,
    ) -> Result<Self, ForestError> {
        let header = Header {
            kind: Kind::PoseForest,
            names,
            circular,
            sigma,
            features,
        };
        Self::join(header, trees, leaves)
    }

    fn join(header: Header, trees: Vec<Tree>, leaves: Vec<LeafTable>) -> Result<Self, ForestError> {
        let values = header.names.len();
        if !header.circular.fits(values) {
            return Err(ForestError::Circular(values));
        }
        check_leaves(&trees, &leaves, header.circular.columns(values))?;
        let sigma = header.sigma;
        let mut forest = Self {
            header,
            trees,
            leaves,
            confidences: Vec::new(),
        };
        forest.set_sigma(sigma)?;
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

    /// Eq. 2 with another bandwidth: c = exp(-(H / nu)^2 / (2 sigma^2)), nu being the largest leaf
    /// impurity of the forest. c = 1 everywhere when that is zero.
    pub fn set_sigma(&mut self, sigma: f64) -> Result<(), ForestError> {
        if !(sigma.is_finite() && sigma > 0.0) {
            return Err(ForestError::Sigma(sigma));
        }
        self.header.sigma = sigma;
        let all = self.leaves.iter().flat_map(LeafTable::impurities);
        let nu = all.copied().fold(0.0, f64::max);
        let confidence = |&h: &f64| {
            let scaled = if nu > 0.0 { h / nu } else { 0.0 };
            (-scaled.powi(2) / (2.0 * sigma.powi(2))).exp() as f32
        };
        let of_tree = |leaves: &LeafTable| leaves.impurities().iter().map(confidence).collect();
        self.confidences = self.leaves.iter().map(of_tree).collect();
        Ok(())
    }

    /// The bandwidth of eq. 2 by which confidences are.
    pub fn sigma(&self) -> f64 {
        self.header.sigma
    }

    pub fn features(&self) -> &DepthFeatures {
        &self.header.features
    }

    /// What the values of a pose are called.
    pub fn names(&self) -> &[String] {
        &self.header.names
    }

    /// Which values of a pose are circular. The leaves hold the columns that it makes of poses.
    pub fn circular(&self) -> &Circular {
        &self.header.circular
    }

    pub fn trees(&self) -> &[Tree] {
        &self.trees
    }

    /// Cuts the forest down to its first `count` trees, at least one. Confidences change with
    /// [`Self::set_sigma`] only: the largest impurity may have been in a tree that is gone.
    pub fn keep_trees(&mut self, count: usize) {
        let count = count.max(1);
        self.trees.truncate(count);
        self.leaves.truncate(count);
        self.confidences.truncate(count);
    }

    /// Eq. 2 for each leaf of each tree.
    pub fn confidences(&self) -> &[Vec<f32>] {
        &self.confidences
    }

    /// The leaves of each tree.
    pub fn leaves(&self) -> &[LeafTable] {
        &self.leaves
    }

    /// Finds the leaf of each pixel in each tree, see [`tree::find_leaves`]. `image` is
    /// `self.features().on(&padded)`.
    pub fn find_leaves(&self, image: &FeaturesOnImage, positions: &[u32]) -> PixelLeaves<'_> {
        PixelLeaves {
            forest: self,
            pixels: positions.len(),
            leaves: tree::find_leaves(&self.trees, image, positions),
        }
    }
}

/// The leaf of each pixel in each tree.
#[derive(Debug, Clone, PartialEq)]
pub struct PixelLeaves<'a> {
    forest: &'a PoseForest,
    pixels: usize,
    /// Tree by tree, one number a pixel.
    leaves: Vec<u32>,
}

impl PixelLeaves<'_> {
    /// The leaves of all pixels in one tree.
    pub fn of_tree(&self, tree: usize) -> &[u32] {
        &self.leaves[tree * self.pixels..(tree + 1) * self.pixels]
    }

    /// The confidence of each pixel's estimate: the mean over the trees.
    pub fn confidences(&self) -> Vec<f32> {
        let mut confidences = vec![0.0f32; self.pixels];
        let trees = self.forest.trees.len() as f32;
        confidences
            .par_chunks_mut(RUN)
            .enumerate()
            .for_each(|(run, confidences)| {
                for (tree, of_leaf) in self.forest.confidences.iter().enumerate() {
                    let leaves = &self.of_tree(tree)[run * RUN..];
                    for (sum, &leaf) in confidences.iter_mut().zip(leaves) {
                        *sum += of_leaf[leaf as usize];
                    }
                }
                confidences.iter_mut().for_each(|sum| *sum /= trees);
            });
        confidences
    }

    /// Writes the estimate of one pixel, the mean of its leaves' poses over the trees weighted by
    /// their confidences, into `pose`.
    pub fn pose(&self, pixel: usize, pose: &mut [f64]) {
        pose.fill(0.0);
        let mut weight = 0.0;
        for (tree, leaves) in self.forest.leaves.iter().enumerate() {
            let leaf = self.of_tree(tree)[pixel] as usize;
            let confidence = f64::from(self.forest.confidences[tree][leaf]);
            weight += confidence;
            for (sum, &y) in pose.iter_mut().zip(leaves.row(leaf)) {
                *sum += confidence * f64::from(y);
            }
        }
        pose.iter_mut().for_each(|sum| *sum /= weight);
        // Of a circular value this is the cosine; the sines stand after the values.
        let values = self.forest.header.names.len();
        for (column, &place) in (values..).zip(self.forest.header.circular.places()) {
            let sine = |(tree, leaves): (usize, &LeafTable)| {
                let leaf = self.of_tree(tree)[pixel] as usize;
                let confidence = f64::from(self.forest.confidences[tree][leaf]);
                confidence * f64::from(leaves.row(leaf)[column])
            };
            let sum: f64 = self.forest.leaves.iter().enumerate().map(sine).sum();
            pose[place] = (sum / weight).atan2(pose[place]);
        }
    }
}
