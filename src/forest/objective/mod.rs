//! Objectives: what a split should make small (eq. 1).
//!
//! An objective is one file here. It implements [`Objective`] and hands the grower a [`NodeScan`],
//! which is asked at every node for the best cut of one feature after the other. Where the score
//! depends on sums over samples only, [`histogram::Histogram`] does the counting and the objective
//! gives a row of integers for each target and a score of two sums; [`mse`] is an example. One that
//! needs to look at the whole node before it scores (to cluster it, say) does so in
//! [`NodeScan::enter`].

pub mod histogram;
pub mod mpmse;
pub mod mse;
pub mod mspd;
pub mod mspd_published;
mod pairs;

use super::grow::Member;

/// An impurity H and the splits that make it small.
pub trait Objective: Sync {
    /// How many targets it knows: those of samples are below.
    fn targets(&self) -> usize;

    /// What one tree's grower keeps for this objective. No member's weight is above `max_weight`.
    fn scan(&self, max_weight: u16) -> Box<dyn NodeScan + '_>;

    /// H of a set of samples, exactly, as the confidence of a leaf needs it (eq. 2).
    fn impurity(&self, members: &[Member]) -> f64;
}

/// Scores the cuts of one node at a time. The call is dynamic: once for a node and feature, never
/// once for a sample.
pub trait NodeScan {
    /// A new node. False when its impurity is zero and no split can lower it.
    fn enter(&mut self, members: &[Member]) -> bool;

    /// The best cut of one feature, `codes[i]` being the bin of `members[i]`, that leaves a weight
    /// of `min_leaf` on both sides; of equals the one between the lowest bins.
    fn best_cut(&mut self, members: &[Member], codes: &[u8], min_leaf: u32) -> Option<Cut>;
}

/// A split between two bins with nothing in between.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// The last bin that goes left, and the first that goes right.
    pub left: u8,
    pub right: u8,
    /// Larger is better. Comparable within one node: eq. 1 up to what is constant there.
    pub score: f64,
}
