//! Objectives: what a split should make small (eq. 1).
//!
//! An objective is one file here, and one line of [`OBJECTIVES`]. It implements [`Objective`] and
//! hands the grower a [`NodeScan`], which is asked at every node for the best cut of one feature
//! after the other. Where the score depends on sums over samples only, [`histogram::Histogram`] does
//! the counting and the objective gives a row of integers for each target and a score of two sums;
//! [`mse`] is an example. One that needs to look at the whole node before it scores does so in
//! [`NodeScan::enter`]; [`wsc`] clusters it.

mod cells;
pub mod histogram;
pub mod mpmse;
pub mod mse;
pub mod mspd;
pub mod mspd_few;
pub mod mspd_published;
mod pairs;
mod vectorized;
pub mod wsc;

use super::ForestError;
use super::grow::{Member, TargetTable};
use crate::distances::DistanceMatrix;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

/// All objectives that can be asked for by name: the paper's in its order and with its parameters,
/// then ours, then variants of the study `variants`.
pub static OBJECTIVES: [ObjectiveKind; 12] = [
    of_poses("mse", "MSE", mse::mse),
    of_distances("mspd", "MSPD", mspd::mspd),
    of_distances("wsc", "WSC", wsc::wsc),
    of_distances("tsne", "MPMSE tSNE", |d| mpmse::tsne(d, 2, 40.0)),
    of_distances("kpca", "MPMSE KPCA", |d| mpmse::kpca(d, 10, 10.0)),
    of_distances("mds", "MPMSE MDS", |d| mpmse::mds(d, 10)),
    of_distances("mspd-few", "MSPD, few dimensions", mspd_few::mspd_few),
    of_distances("wsc-count", "WSC, counting", wsc::wsc_count),
    of_distances("tsne-d3", "tSNE, d = 3", |d| mpmse::tsne(d, 3, 40.0)),
    of_distances("tsne-d10", "tSNE, d = 10", |d| mpmse::tsne(d, 10, 40.0)),
    of_distances("tsne-p10", "tSNE, p = 10", |d| mpmse::tsne(d, 2, 10.0)),
    of_distances("tsne-p20", "tSNE, p = 20", |d| mpmse::tsne(d, 2, 20.0)),
];

/// An entry of [`OBJECTIVES`]. Study files and recipes hold its `id`.
#[derive(Debug)]
pub struct ObjectiveKind {
    /// Its name in files.
    pub id: &'static str,
    /// Its name in figures, the paper's where there is one.
    pub title: &'static str,
    pub make: Make,
}

/// Makes an objective for the poses of the training images, one a target.
#[derive(Debug)]
pub enum Make {
    /// Of the poses.
    OfPoses(fn(&TargetTable) -> Made<'_>),
    /// Of the distances between them.
    OfDistances(fn(&DistanceMatrix) -> Made<'_>),
}

/// An objective, or why the poses cannot be learnt by it.
pub type Made<'a> = Result<Box<dyn Objective + 'a>, ForestError>;

const fn of_poses(
    id: &'static str,
    title: &'static str,
    make: fn(&TargetTable) -> Made<'_>,
) -> ObjectiveKind {
    let make = Make::OfPoses(make);
    ObjectiveKind { id, title, make }
}

const fn of_distances(
    id: &'static str,
    title: &'static str,
    make: fn(&DistanceMatrix) -> Made<'_>,
) -> ObjectiveKind {
    let make = Make::OfDistances(make);
    ObjectiveKind { id, title, make }
}

impl ObjectiveKind {
    /// The entry with this `id`.
    pub fn named(id: &str) -> Option<&'static ObjectiveKind> {
        OBJECTIVES.iter().find(|kind| kind.id == id)
    }

    /// Its place in [`OBJECTIVES`].
    pub fn place(&self) -> usize {
        OBJECTIVES
            .iter()
            .take_while(|kind| kind.id != self.id)
            .count()
    }
}

impl Serialize for ObjectiveKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.id.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for &'static ObjectiveKind {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        const IDS: [&str; OBJECTIVES.len()] = {
            let mut ids = [""; OBJECTIVES.len()];
            let mut at = 0;
            while at < ids.len() {
                ids[at] = OBJECTIVES[at].id;
                at += 1;
            }
            ids
        };
        let id = String::deserialize(deserializer)?;
        ObjectiveKind::named(&id).ok_or_else(|| D::Error::unknown_variant(&id, &IDS))
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{below, normal, stream};
    use std::collections::BTreeSet;

    /// Whatever is in the list can be named, can be made of poses, and finds the split that parts
    /// two clouds of them.
    #[test]
    fn every_objective_parts_what_lies_apart() {
        let ids: BTreeSet<&str> = OBJECTIVES.iter().map(|kind| kind.id).collect();
        assert_eq!(ids.len(), OBJECTIVES.len());
        const TARGETS: usize = 24;
        let mut random = stream(1, "two clouds", &[]);
        let far = |target: usize| if target < TARGETS / 2 { 0.0 } else { 50.0 };
        let values = (0..TARGETS * 3).map(|at| far(at / 3) + normal(&mut random));
        let values: Vec<f64> = values.collect();
        let distances = DistanceMatrix::euclidean(&values, 3);
        let poses = TargetTable::new(3, values).unwrap();
        let members: Vec<Member> = (0..200)
            .map(|sample| Member {
                sample,
                target: below(&mut random, TARGETS) as u16,
                weight: 1 + below(&mut random, 2) as u16,
            })
            .collect();
        let side = |member: &Member| usize::from(member.target) / (TARGETS / 2);
        let codes: Vec<u8> = members.iter().map(|m| 9 + 100 * side(m) as u8).collect();
        let noise: Vec<u8> = members
            .iter()
            .map(|_| below(&mut random, 200) as u8)
            .collect();
        for kind in &OBJECTIVES {
            let objective = match kind.make {
                Make::OfPoses(make) => make(&poses),
                Make::OfDistances(make) => make(&distances),
            };
            let objective = objective.unwrap();
            assert_eq!(objective.targets(), TARGETS);
            let mut scan = objective.scan(2);
            assert!(scan.enter(&members), "{}", kind.id);
            let cut = scan.best_cut(&members, &codes, 1).unwrap();
            assert_eq!((cut.left, cut.right), (9, 109), "{}", kind.id);
            let other = scan.best_cut(&members, &noise, 1).unwrap();
            assert!(cut.score > other.score, "{}", kind.id);
            let left: Vec<Member> = members.iter().copied().filter(|m| side(m) == 0).collect();
            assert!(objective.impurity(&left) < 0.5 * objective.impurity(&members));
        }
    }

    #[test]
    fn objectives_are_read_and_written_by_name() {
        for kind in &OBJECTIVES {
            let text = serde_json::to_string(kind).unwrap();
            let read: &'static ObjectiveKind = serde_json::from_str(&text).unwrap();
            assert!(std::ptr::eq(read, kind));
        }
        let unknown = serde_json::from_str::<&'static ObjectiveKind>("\"msd\"").unwrap_err();
        let message = unknown.to_string();
        assert!(message.starts_with("unknown variant `msd`, expected one of `mse`"));
    }
}
