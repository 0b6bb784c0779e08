//! Growing trees and comparing the split of each node with the clusters of WSC (eqs. 7-9).

use super::distances::DistancesTask;
use super::pose_forest::PoseForestTask;
use crate::Progress;
use crate::dataset::DataSet;
use crate::distances::DistanceMatrix;
use crate::experiment::statistics::spearman;
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::forest::grow::{Member, grow};
use crate::forest::objective::Objective;
use crate::forest::objective::wsc::{NodeClusters, wsc};
use crate::forest::tree::{LEAF, Node, Tree};
use crate::training::pose::Samples;
use crate::training::tree_steps;
use anyhow::Result;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Grows the trees of a forest on WSC and looks at every node that is split: the file `nodes.json`.
pub struct WscNodesTask {
    /// It is not trained; the trees are those that it would have.
    pub forest: Arc<PoseForestTask>,
    /// The first tree's node of so many samples, at least and at most, that has the median share of
    /// wrong samples is told with all its samples.
    pub example: (usize, usize),
}

/// What [`WscNodesTask`] writes. A sample counts as often as the bootstrap drew it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WscNodes {
    pub trees: Vec<TreeRecord>,
    /// `None` when no node has a fitting size.
    pub example: Option<Example>,
}

/// A tree: what was found at its nodes, and at its leaves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TreeRecord {
    /// By the number of splits above the node.
    pub levels: Vec<Level>,
    pub leaves: usize,
    /// Leaves with H of eq. 8 zero and that of eq. 6 not.
    pub falsely_pure: usize,
    /// The rank correlation of the two over the leaves; `None` when either is constant.
    pub correlation: Option<f64>,
}

/// Sums over nodes of one depth that have clusters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Level {
    pub nodes: usize,
    pub samples: f64,
    /// Samples on the wrong side.
    pub wrong: f64,
    /// What would be wrong on average with sides of the same sizes and samples dealt at random.
    pub by_chance: f64,
    /// The share of eq. 6 that a split takes away as eq. 1 counts it, times the node's samples: if
    /// the clusters were the sides, and with the sides as they are.
    pub removed_by_clusters: f64,
    pub removed_by_split: f64,
}

/// One node with the split that its tree gave it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Example {
    pub depth: usize,
    pub feature: usize,
    /// Values up to here go left.
    pub threshold_mm: i16,
    pub samples: Vec<Sample>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    pub image: usize,
    pub weight: u16,
    /// The lowest value in the bin that its value is in.
    pub feature_mm: i16,
    pub goes_left: bool,
    /// The cluster that is meant to go left is 0.
    pub cluster: usize,
    /// DISP to the central poses of both clusters.
    pub to_centres_m: [f64; 2],
}

impl std::ops::AddAssign for Level {
    fn add_assign(&mut self, other: Level) {
        self.nodes += other.nodes;
        self.samples += other.samples;
        self.wrong += other.wrong;
        self.by_chance += other.by_chance;
        self.removed_by_clusters += other.removed_by_clusters;
        self.removed_by_split += other.removed_by_split;
    }
}

const FILE: &str = "nodes.json";

impl WscNodesTask {
    /// Reads the result from the folder that [`Task::run`] wrote.
    pub fn read(folder: &Path) -> Result<WscNodes> {
        read_json(&folder.join(FILE))
    }
}

impl Task for WscNodesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "wsc-nodes".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        format!("clusters and splits: {}", self.forest.label())
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({ "forest": self.forest.parameters(), "example": self.example })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        let set = self.forest.set.clone();
        vec![set.clone(), Arc::new(DistancesTask { set })]
    }

    fn cost(&self) -> Cost {
        let Cost { seconds, megabytes } = self.forest.cost();
        Cost {
            seconds: 1.5 * seconds,
            // The samples of each tree, in the order of the leaves.
            megabytes: megabytes
                + 8e-6 * (self.forest.samples() * self.forest.training.forest.trees) as f64,
        }
    }

    fn steps(&self) -> u64 {
        self.forest.steps()
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[0])?;
        let distances = DistancesTask::read(&inputs[1])?.subset(&self.forest.images);
        let samples = self.forest.samples_of(&set, None, progress)?;
        let objective = wsc(&distances)?;
        let grown: Vec<(Tree, Leaves)> = grow(
            &samples.binned,
            &samples.targets,
            &*objective,
            &self.forest.training.forest,
            self.forest.seed_of_trees(),
            Leaves::push,
            &|trees| progress(tree_steps(self.forest.images.len()) * trees),
        )?;
        let look = |(tree, leaves): &(Tree, Leaves)| look(tree, leaves, &distances, &*objective);
        let mut looked: Vec<(TreeRecord, Vec<Split>)> = grown.par_iter().map(look).collect();
        let example = looked.first_mut().and_then(|(_, splits)| {
            let (least, most) = self.example;
            let sizes = least as f64..=most as f64;
            splits.retain(|split| sizes.contains(&split.found.level.samples));
            splits.sort_by(|a, b| a.wrong_share().total_cmp(&b.wrong_share()));
            let split = splits.get(splits.len().saturating_sub(1) / 2)?;
            let (tree, leaves) = &grown[0];
            Some(self.tell(split, tree, leaves, &samples, &distances))
        });
        let nodes = WscNodes {
            trees: looked.into_iter().map(|(record, _)| record).collect(),
            example,
        };
        std::fs::write(out.join(FILE), serde_json::to_vec(&nodes)?)?;
        Ok(())
    }
}

impl WscNodesTask {
    fn tell(
        &self,
        split: &Split,
        tree: &Tree,
        leaves: &Leaves,
        samples: &Samples,
        distances: &DistanceMatrix,
    ) -> Example {
        let Node {
            feature, threshold, ..
        } = tree.nodes()[split.node];
        let feature = usize::from(feature);
        let members = leaves.members(&split.leaves);
        let mut clusters = NodeClusters::new(distances);
        clusters.find(members);
        let mut centres = clusters.centres();
        if split.found.second_goes_left {
            centres.reverse();
        }
        let in_second: Vec<u16> = clusters
            .targets()
            .filter_map(|(target, second)| second.then_some(target))
            .collect();
        let column = samples.binned.column(feature);
        let sample = |member: &Member| {
            let value = (samples.binned).lowest(feature, column[member.sample as usize]);
            let in_second = in_second.binary_search(&member.target).is_ok();
            Sample {
                image: self.forest.images[usize::from(member.target)],
                weight: member.weight,
                feature_mm: value,
                goes_left: value <= threshold,
                cluster: usize::from(in_second != split.found.second_goes_left),
                to_centres_m: centres
                    .map(|centre| distances.get(usize::from(member.target), usize::from(centre))),
            }
        };
        let mut told: Vec<&Member> = members.iter().collect();
        told.sort_by_key(|member| member.sample);
        Example {
            depth: split.depth,
            feature,
            threshold_mm: threshold,
            samples: told.into_iter().map(sample).collect(),
        }
    }
}

/// The samples of a tree, leaf by leaf.
#[derive(Default)]
struct Leaves {
    members: Vec<Member>,
    /// Where each leaf ends.
    ends: Vec<usize>,
}

impl Leaves {
    fn push(&mut self, members: &[Member]) {
        self.members.extend(members);
        self.ends.push(self.members.len());
    }

    /// The samples of consecutive leaves.
    fn members(&self, leaves: &Range<usize>) -> &[Member] {
        let start = |leaf: usize| leaf.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.members[start(leaves.start)..start(leaves.end)]
    }
}

/// A node that was split and has clusters.
struct Split {
    node: usize,
    depth: usize,
    leaves: Range<usize>,
    found: Comparison,
}

/// The two sides of a node and its clusters.
struct Comparison {
    level: Level,
    second_goes_left: bool,
    /// H of both sides by eq. 8.
    wrong_m: [f64; 2],
}

impl Split {
    fn wrong_share(&self) -> f64 {
        self.found.level.wrong / self.found.level.samples
    }
}

fn look(
    tree: &Tree,
    leaves: &Leaves,
    distances: &DistanceMatrix,
    objective: &dyn Objective,
) -> (TreeRecord, Vec<Split>) {
    let nodes = tree.nodes();
    let mut depths = vec![0; nodes.len()];
    for (at, node) in nodes.iter().enumerate() {
        if node.feature != LEAF {
            depths[node.child as usize] = depths[at] + 1;
            depths[node.child as usize + 1] = depths[at] + 1;
        }
    }
    // Leaves are numbered from left to right, so that those below a node follow each other.
    let mut below = vec![0..0; nodes.len()];
    for (at, node) in nodes.iter().enumerate().rev() {
        let child = node.child as usize;
        below[at] = match node.feature {
            LEAF => child..child + 1,
            _ => below[child].start..below[child + 1].end,
        };
    }
    let mut comparer = Comparer::new(distances);
    let mut levels: Vec<Level> = Vec::new();
    let mut splits = Vec::new();
    let (mut leaf_wrong_m, mut leaf_impurity) = (Vec::new(), Vec::new());
    for (at, node) in nodes.iter().enumerate().filter(|(_, n)| n.feature != LEAF) {
        let children = [node.child as usize, node.child as usize + 1];
        let sides = children.map(|child| leaves.members(&below[child]));
        let members = leaves.members(&below[at]);
        let Some(found) = comparer.compare(members, sides[0].len()) else {
            continue;
        };
        for ((child, side), wrong_m) in children.into_iter().zip(sides).zip(found.wrong_m) {
            if nodes[child].feature == LEAF {
                leaf_wrong_m.push(wrong_m);
                leaf_impurity.push(objective.impurity(side));
            }
        }
        let depth = depths[at];
        levels.resize(levels.len().max(depth + 1), Level::default());
        levels[depth] += found.level;
        splits.push(Split {
            node: at,
            depth,
            leaves: below[at].clone(),
            found,
        });
    }
    let pairs = leaf_wrong_m.iter().zip(&leaf_impurity);
    let record = TreeRecord {
        levels,
        leaves: leaf_impurity.len(),
        falsely_pure: pairs.filter(|&(&w, &h)| w == 0.0 && h > 0.0).count(),
        correlation: Some(spearman(&leaf_wrong_m, &leaf_impurity)).filter(|c| c.is_finite()),
    };
    (record, splits)
}

struct Comparer<'a> {
    distances: &'a DistanceMatrix,
    clusters: NodeClusters<'a>,
    /// The weight of each target on either side; zero between calls.
    weights: Vec<[f64; 2]>,
}

impl<'a> Comparer<'a> {
    fn new(distances: &'a DistanceMatrix) -> Self {
        Self {
            distances,
            clusters: NodeClusters::new(distances),
            weights: vec![[0.0; 2]; distances.count()],
        }
    }

    /// The first `left` of the members go left. `None` when all are alike.
    fn compare(&mut self, members: &[Member], left: usize) -> Option<Comparison> {
        if !self.clusters.find(members) {
            return None;
        }
        for (place, member) in members.iter().enumerate() {
            let side = usize::from(place >= left);
            self.weights[usize::from(member.target)][side] += f64::from(member.weight);
        }
        let targets: Vec<(usize, bool)> = (self.clusters.targets())
            .map(|(target, second)| (usize::from(target), second))
            .collect();
        let take = |&(target, _): &(usize, bool)| std::mem::take(&mut self.weights[target]);
        let weights: Vec<[f64; 2]> = targets.iter().map(take).collect();
        // By cluster and side: samples, and the sum of their distances to the other's centre.
        let (mut counts, mut sums) = ([[0.0; 2]; 2], [[0.0; 2]; 2]);
        let centres = self.clusters.centres().map(usize::from);
        for (&(target, second), weights) in targets.iter().zip(&weights) {
            let distance = self.distances.get(target, centres[usize::from(!second)]);
            for (side, weight) in weights.iter().enumerate() {
                counts[usize::from(second)][side] += weight;
                sums[usize::from(second)][side] += weight * distance;
            }
        }
        let second_goes_left = sums[0][0] + sums[1][1] < sums[1][0] + sums[0][1];
        // The cluster that is wrong on the left, and the one that is so on the right.
        let [l, r] = if second_goes_left { [0, 1] } else { [1, 0] };

        let of_side: [f64; 2] = [0, 1].map(|side| counts[0][side] + counts[1][side]);
        let of_cluster = counts.map(|[left, right]| left + right);
        let samples = of_side[0] + of_side[1];
        let by_chance = (of_side[0] * of_cluster[1] + of_side[1] * of_cluster[0]) / samples;
        let whole = |i: usize| weights[i][0] + weights[i][1];
        let impurity = self.impurity(&targets, whole);
        // The share that is left of it, times the samples.
        let left_by = |share: &dyn Fn(usize, usize) -> f64, sizes: [f64; 2]| {
            let part = |part: usize| sizes[part] * self.impurity(&targets, |i| share(part, i));
            (part(0) + part(1)) / impurity
        };
        let in_cluster = |cluster: usize, i: usize| match usize::from(targets[i].1) == cluster {
            true => whole(i),
            false => 0.0,
        };
        Some(Comparison {
            level: Level {
                nodes: 1,
                samples,
                wrong: counts[l][0] + counts[r][1],
                by_chance: by_chance.min(samples - by_chance),
                removed_by_clusters: samples - left_by(&in_cluster, of_cluster),
                removed_by_split: samples - left_by(&|side, i| weights[i][side], of_side),
            },
            second_goes_left,
            wrong_m: [sums[l][0], sums[r][1]],
        })
    }

    /// Eq. 6, the i-th target having a weight.
    fn impurity(&self, targets: &[(usize, bool)], weight: impl Fn(usize) -> f64) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        for (i, &(a, _)) in targets.iter().enumerate() {
            let row = self.distances.row(a);
            let mut of_row = 0.0;
            for (j, &(b, _)) in targets[..i].iter().enumerate() {
                of_row += weight(j) * row[b] * row[b];
            }
            sum += 2.0 * weight(i) * of_row;
            n += weight(i);
        }
        if n > 1.0 { sum / (n * (n - 1.0)) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member(target: u16, weight: u16) -> Member {
        Member {
            sample: 0,
            target,
            weight,
        }
    }

    /// Two pairs of poses on a line, at 0, 1 and at 10, 11: four samples left, five right.
    #[test]
    fn a_split_by_hand() {
        let distances = DistanceMatrix::euclidean(&[0.0, 1.0, 10.0, 11.0], 1);
        let members = [(2, 2), (3, 1), (0, 1), (0, 3), (1, 1), (3, 1)].map(|(t, w)| member(t, w));
        let mut comparer = Comparer::new(&distances);
        for _ in 0..2 {
            let found = comparer.compare(&members, 3).unwrap();
            // Centres are at 0 and at 10; the high cluster goes left, where a sample at 0 is wrong,
            // and one at 11 on the right.
            assert!(found.second_goes_left);
            assert_eq!(found.wrong_m, [10.0, 11.0]);
            let level = found.level;
            assert_eq!((level.nodes, level.samples, level.wrong), (1, 9.0, 2.0));
            // 4 of 9 are of the high cluster: 4 * 5/9 + 5 * 4/9.
            assert!((level.by_chance - 40.0 / 9.0).abs() < 1e-12);
        }
        // Sides that are the clusters take away all that the clusters do.
        let pure = [(2, 2), (3, 1), (0, 1), (1, 2)].map(|(t, w)| member(t, w));
        let level = comparer.compare(&pure, 2).unwrap().level;
        assert_eq!(level.wrong, 0.0);
        assert_eq!(level.removed_by_split, level.removed_by_clusters);
        // By hand: 3 samples with 4 of 6 ordered pairs at 1 on either side, and across 9 pairs of
        // samples, each twice.
        let across = 2.0 * (2.0 * 100.0 + 4.0 * 81.0 + 121.0 + 2.0 * 100.0);
        let left = (4.0 / 6.0) / ((8.0 + across) / 30.0);
        assert!((level.removed_by_split - 6.0 * (1.0 - left)).abs() < 1e-12);
        assert!(comparer.compare(&[member(1, 3), member(1, 1)], 1).is_none());
    }
}
