//! MSPD as the paper computes it: "despite using a lookup table with precomputed DISP distances"
//! (section IV-D) the time grows with the square of a node's samples. The reference that [`mspd`]
//! is held against, in tests and in Table II.
//!
//! [`mspd`]: super::mspd::mspd

use super::pairs::{SquaredDistances, mean_of_pairs, mspd_impurity};
use super::{Cut, NodeScan, Objective};
use crate::distances::DistanceMatrix;
use crate::forest::ForestError;
use crate::forest::grow::Member;

/// Eq. 6, moving one sample after the other from the right to the left, in the order of their
/// values: the sums over the pairs of either side change by the distances of the moved sample to
/// each sample there, which are looked up. Target t of a sample is row t of `distances`.
pub fn mspd_published(distances: &DistanceMatrix) -> Result<Box<dyn Objective + '_>, ForestError> {
    Ok(Box::new(Published {
        distances,
        squared: SquaredDistances::new(distances)?,
    }))
}

struct Published<'a> {
    distances: &'a DistanceMatrix,
    squared: SquaredDistances,
}

impl Objective for Published<'_> {
    fn targets(&self) -> usize {
        self.squared.targets()
    }

    fn scan(&self, _max_weight: u16) -> Box<dyn NodeScan + '_> {
        Box::new(Scan {
            squared: &self.squared,
            order: Vec::new(),
            weight: 0,
            pairs: 0,
        })
    }

    fn impurity(&self, members: &[Member]) -> f64 {
        mspd_impurity(self.distances, members)
    }
}

struct Scan<'a> {
    squared: &'a SquaredDistances,
    /// A feature's bins and the samples in them, ascending.
    order: Vec<(u8, Member)>,
    /// Of the node.
    weight: u64,
    pairs: i128,
}

/// The sum of the squared distances of one sample to some others, each pair as often as it weighs.
fn look_up<'a>(
    squared: &SquaredDistances,
    one: Member,
    others: impl Iterator<Item = &'a Member>,
) -> i128 {
    let row = squared.row(one.target);
    let sum: u64 = others
        .map(|other| u64::from(other.weight) * u64::from(row[usize::from(other.target)]))
        .sum();
    i128::from(one.weight) * i128::from(sum)
}

impl NodeScan for Scan<'_> {
    fn enter(&mut self, members: &[Member]) -> bool {
        self.weight = members.iter().map(|m| u64::from(m.weight)).sum();
        let to_all = |&one: &Member| look_up(self.squared, one, members.iter());
        self.pairs = members.iter().map(to_all).sum();
        self.pairs > 0
    }

    fn best_cut(&mut self, members: &[Member], codes: &[u8], min_leaf: u32) -> Option<Cut> {
        self.order.clear();
        self.order
            .extend(codes.iter().copied().zip(members.iter().copied()));
        self.order.sort_by_key(|&(bin, _)| bin);
        let least = u64::from(min_leaf.max(1));
        let (mut left, mut right) = ((0, 0), (self.weight, self.pairs));
        let mut best: Option<Cut> = None;
        for next in 1..self.order.len() {
            let (bin, moved) = self.order[next - 1];
            let (before, after) = self.order.split_at(next);
            // A sample is at no distance from itself.
            let to_left = look_up(self.squared, moved, before.iter().map(|(_, m)| m));
            let to_right = look_up(self.squared, moved, after.iter().map(|(_, m)| m));
            let weight = u64::from(moved.weight);
            left = (left.0 + weight, left.1 + 2 * to_left);
            right = (right.0 - weight, right.1 - 2 * to_right);
            if after[0].0 == bin || left.0 < least || right.0 < least {
                continue;
            }
            let score = mean_of_pairs(
                [left.0 as f64, right.0 as f64],
                [left.1 as f64, right.1 as f64],
            );
            if best.is_none_or(|best| score > best.score) {
                best = Some(Cut {
                    left: bin,
                    right: after[0].0,
                    score,
                });
            }
        }
        let worth = self.squared.worth(self.weight as f64);
        best.map(|cut| Cut {
            score: worth * cut.score,
            ..cut
        })
    }
}
