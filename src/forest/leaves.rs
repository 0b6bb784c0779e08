//! What the leaves of a tree say.

use super::ForestError;
use super::bins::BinnedMatrix;
use super::grow::{GrowSpec, Member, TargetTable, grow};
use super::objective::Objective;
use super::tree::{Tree, find_leaves};
use crate::Progress;
use crate::feature::FeaturesOnImage;
use rayon::prelude::*;

/// A row of `width` values for each leaf of a tree, and its impurity.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LeafTable {
    width: usize,
    values: Vec<f32>,
    impurities: Vec<f64>,
}

impl LeafTable {
    /// `values` row by row, one row an impurity.
    pub fn new(width: usize, values: Vec<f32>, impurities: Vec<f64>) -> Result<Self, ForestError> {
        if values.len() != width * impurities.len() {
            return Err(ForestError::Size {
                what: "values of leaves",
                got: values.len(),
                expected: width * impurities.len(),
            });
        }
        let finite = values.iter().position(|value| !value.is_finite());
        if let Some(at) = finite {
            return Err(ForestError::NotFinite {
                target: at / width,
                column: at % width,
            });
        }
        // The impurity of a leaf stands after its values.
        if let Some(target) = impurities.iter().position(|value| !value.is_finite()) {
            return Err(ForestError::NotFinite {
                target,
                column: width,
            });
        }
        Ok(Self {
            width,
            values,
            impurities,
        })
    }

    /// Values of a leaf.
    pub fn width(&self) -> usize {
        self.width
    }

    /// How many there are.
    pub fn leaves(&self) -> usize {
        self.impurities.len()
    }

    /// The values of a leaf.
    #[inline]
    pub fn row(&self, leaf: usize) -> &[f32] {
        &self.values[leaf * self.width..(leaf + 1) * self.width]
    }

    /// All rows, one after the other.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// H of each leaf by the objective (eq. 2).
    pub fn impurities(&self) -> &[f64] {
        &self.impurities
    }
}

/// Whether there is a table of `width` values a leaf for each of the trees, of which there must be
/// one.
pub(super) fn check_leaves(
    trees: &[Tree],
    tables: &[LeafTable],
    width: usize,
) -> Result<(), ForestError> {
    let same = |what, got, expected| match got == expected {
        true => Ok(()),
        false => Err(ForestError::Size {
            what,
            got,
            expected,
        }),
    };
    if trees.is_empty() {
        return Err(ForestError::Zero("the number of trees"));
    }
    same("tables of leaves", tables.len(), trees.len())?;
    for (tree, table) in trees.iter().zip(tables) {
        same("rows of a table of leaves", table.leaves(), tree.leaves())?;
        same("values of a leaf", table.width(), width)?;
    }
    Ok(())
}

/// Pixels that a thread takes at once.
const RUN: usize = 1 << 14;

/// The first `width` values of the leaves of a pixel, mean over the trees: pixel by pixel, in
/// parallel. For `positions` see [`find_leaves`].
pub(super) fn mean_values(
    trees: &[Tree],
    tables: &[LeafTable],
    width: usize,
    image: &FeaturesOnImage,
    positions: &[u32],
) -> Vec<f32> {
    let leaves = find_leaves(trees, image, positions);
    let mut means = vec![0.0; positions.len() * width];
    means
        .par_chunks_mut(RUN * width)
        .enumerate()
        .for_each(|(run, means)| {
            let of_trees = leaves.chunks_exact(positions.len());
            for (table, leaves) in tables.iter().zip(of_trees) {
                let leaves = &leaves[run * RUN..];
                for (sums, &leaf) in means.chunks_exact_mut(width).zip(leaves) {
                    let row = table.row(leaf as usize);
                    sums.iter_mut()
                        .zip(row)
                        .for_each(|(sum, value)| *sum += value);
                }
            }
            means.iter_mut().for_each(|sum| *sum /= trees.len() as f32);
        });
    means
}

/// A forest whose leaves hold the mean over their samples of the rows of `table` (poses; or class
/// membership, whose mean is the share of each class), and their impurity by the objective. The
/// objective may have been made of another table with the same targets. See [`grow`].
pub fn grow_means(
    data: &BinnedMatrix,
    targets: &[u16],
    table: &TargetTable,
    objective: &dyn Objective,
    spec: &GrowSpec,
    seed: u64,
    progress: Progress,
) -> Result<(Vec<Tree>, Vec<LeafTable>), ForestError> {
    if let Some(&target) = targets.iter().find(|&&t| usize::from(t) >= table.targets()) {
        return Err(ForestError::Size {
            what: "targets in the table",
            got: table.targets(),
            expected: usize::from(target) + 1,
        });
    }
    let leaf = |leaves: &mut LeafTable, members: &[Member]| {
        let mut mean = vec![0.0; table.width()];
        table.mean(members, &mut mean);
        leaves.width = table.width();
        leaves.values.extend(mean.iter().map(|&value| value as f32));
        leaves.impurities.push(objective.impurity(members));
    };
    let trees = grow(data, targets, objective, spec, seed, leaf, progress)?;
    Ok(trees.into_iter().unzip())
}
