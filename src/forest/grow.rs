//! Growing trees.
//!
//! A node looks at `features_per_node` features drawn without replacement, and at more of them for
//! as long as none can split it. The best score wins; of equals the feature drawn first and then
//! the lowest threshold. A node is a leaf when its impurity is zero, when it is `max_depth` splits
//! below the root, or when no feature leaves `min_leaf` on both sides.

use super::ForestError;
use super::bins::BinnedMatrix;
use super::objective::{NodeScan, Objective};
use super::tree::{LEAF, Node, Tree};
use crate::Progress;
use crate::random::{Stream, below, stream};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How many trees are grown, and how far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GrowSpec {
    pub trees: usize,
    /// The least weight of a leaf: its samples, counted as often as the bootstrap drew them.
    pub min_leaf: u32,
    pub features_per_node: usize,
    /// The most splits between root and leaf; without it there is no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_depth: Option<usize>,
    /// Whether each tree draws its samples with replacement, or takes all of them once.
    pub bootstrap: bool,
}

/// A sample in a node: its row of the matrix, its row of the target table, and how often it counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Member {
    pub sample: u32,
    pub target: u16,
    pub weight: u16,
}

/// What there is to learn: a row of values for each target. Samples share targets, as the pixels
/// of an image share its pose.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetTable {
    width: usize,
    values: Vec<f64>,
}

impl TargetTable {
    /// `values` row by row, `width` of them a target.
    pub fn new(width: usize, values: Vec<f64>) -> Result<Self, ForestError> {
        if width == 0 {
            return Err(ForestError::Zero("the number of values of a target"));
        }
        if values.is_empty() || !values.len().is_multiple_of(width) {
            return Err(ForestError::Size {
                what: "values of the last target",
                got: values.len() % width,
                expected: width,
            });
        }
        let most = usize::from(u16::MAX) + 1;
        if values.len() / width > most {
            return Err(ForestError::TooMany {
                what: "targets",
                got: values.len() / width,
                most,
            });
        }
        match values.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(ForestError::NotFinite {
                target: at / width,
                column: at % width,
            }),
            None => Ok(Self { width, values }),
        }
    }

    /// Values of a target.
    pub fn width(&self) -> usize {
        self.width
    }

    /// How many there are.
    pub fn targets(&self) -> usize {
        self.values.len() / self.width
    }

    /// The values of a target.
    pub fn row(&self, target: usize) -> &[f64] {
        &self.values[target * self.width..(target + 1) * self.width]
    }

    /// Writes the mean over some samples.
    pub fn mean(&self, members: &[Member], mean: &mut [f64]) {
        mean.fill(0.0);
        let mut weight = 0.0;
        for member in members {
            weight += f64::from(member.weight);
            for (sum, y) in mean.iter_mut().zip(self.row(usize::from(member.target))) {
                *sum += f64::from(member.weight) * y;
            }
        }
        mean.iter_mut().for_each(|sum| *sum /= weight);
    }
}

/// Grows `spec.trees` trees in parallel. `targets[i]` is the row of the objective's table that
/// sample i belongs to. Tree i depends on `seed` and i only, neither on the number of threads nor
/// on that of trees, and draws the same samples whatever the objective.
///
/// For each leaf, in the order of its number, `leaf(payload, members)` is called with the samples
/// in it, ascending; the payload starts as `P::default()` for each tree and is returned with it.
/// `progress` hears of one unit a tree.
pub fn grow<P: Default + Send>(
    data: &BinnedMatrix,
    targets: &[u16],
    objective: &dyn Objective,
    spec: &GrowSpec,
    seed: u64,
    leaf: impl Fn(&mut P, &[Member]) + Sync,
    progress: Progress,
) -> Result<Vec<(Tree, P)>, ForestError> {
    if targets.len() != data.samples() {
        return Err(ForestError::Size {
            what: "targets of samples",
            got: targets.len(),
            expected: data.samples(),
        });
    }
    if let Some(&target) = targets
        .iter()
        .find(|&&t| usize::from(t) >= objective.targets())
    {
        return Err(ForestError::Size {
            what: "targets of the objective",
            got: objective.targets(),
            expected: usize::from(target) + 1,
        });
    }
    for (what, number) in [
        ("the number of trees", spec.trees),
        ("the number of features a node", spec.features_per_node),
        ("the least weight of a leaf", spec.min_leaf as usize),
    ] {
        if number == 0 {
            return Err(ForestError::Zero(what));
        }
    }
    let tree = |tree: usize| {
        let weights = if spec.bootstrap {
            bootstrap(
                data.samples(),
                &mut stream(seed, "bootstrap", &[tree as u64]),
            )
        } else {
            vec![1; data.samples()]
        };
        let mut payload = P::default();
        let random = stream(seed, "tree", &[tree as u64]);
        let report = |members: &[Member]| leaf(&mut payload, members);
        let small = BLOCK_BYTES / data.features();
        let tree = grow_tree(
            data, targets, &weights, objective, spec, small, random, report,
        );
        progress(1);
        (tree, payload)
    };
    Ok((0..spec.trees).into_par_iter().map(tree).collect())
}

/// How often each of `samples` is drawn when as many are drawn with replacement.
fn bootstrap(samples: usize, random: &mut Stream) -> Vec<u16> {
    let mut weights = vec![0; samples];
    for _ in 0..samples {
        let weight: &mut u16 = &mut weights[below(random, samples)];
        *weight = weight.saturating_add(1);
    }
    weights
}

/// A copy of so much of the matrix stays in the caches. (4 MB are faster than 1 MB by 4 % with 22
/// features a node and by 16 % with 500; 16 MB are slower again.)
const BLOCK_BYTES: usize = 1 << 22;
/// Samples that are turned from rows into columns together: a cache line of each column.
const TILE: usize = 64;

/// Grows one tree on the samples whose weight is not zero. A node of up to `small` samples is
/// copied, with all features, into a block in which it and all below it are grown.
#[expect(clippy::too_many_arguments)]
fn grow_tree(
    data: &BinnedMatrix,
    targets: &[u16],
    weights: &[u16],
    objective: &dyn Objective,
    spec: &GrowSpec,
    small: usize,
    random: Stream,
    mut leaf: impl FnMut(&[Member]),
) -> Tree {
    let mut members: Vec<Member> = (0..)
        .zip(targets)
        .zip(weights)
        .filter(|&(_, &weight)| weight > 0)
        .map(|((sample, &target), &weight)| Member {
            sample,
            target,
            weight,
        })
        .collect();
    let mut grower = Grower {
        data,
        spec,
        random,
        block: Block::default(),
        scan: objective.scan(weights.iter().copied().max().unwrap_or(1)),
        features: (0..data.features()).collect(),
        codes: vec![0; members.len()],
        right: Vec::with_capacity(members.len()),
    };
    let unfinished = Node {
        feature: LEAF,
        threshold: 0,
        child: 0,
    };
    let mut nodes = vec![unfinished];
    let mut leaves = 0;
    // Nodes to be grown: their number, their members, their depth, and whether they lie in the
    // block. The left one lies on top, so that a block is done with before the next is copied.
    let mut open = vec![(0, 0..members.len(), 0, false)];
    while let Some((at, range, depth, mut in_block)) = open.pop() {
        let members = &mut members[range.clone()];
        if !in_block {
            in_block = members.len() <= small;
            grower.block.samples.clear();
            if in_block {
                grower.block.copy(data, members);
            }
        }
        let split = if spec.max_depth.is_some_and(|most| depth >= most) {
            None
        } else {
            grower.best_split(members)
        };
        let Some(split) = split else {
            if in_block {
                grower.block.restore(members);
            }
            leaf(members);
            nodes[at].child = leaves;
            leaves += 1;
            continue;
        };
        let child = nodes.len();
        nodes[at] = Node {
            feature: split.feature as u16,
            threshold: data.threshold(split.feature, split.left, split.right),
            child: child as u32,
        };
        nodes.extend([unfinished; 2]);
        let middle = range.start + grower.partition(members, &split);
        open.push((child + 1, middle..range.end, depth + 1, in_block));
        open.push((child, range.start..middle, depth + 1, in_block));
    }
    Tree::grown(nodes, leaves as usize)
}

/// The part of the matrix that a small subtree needs, column by column. As long as it is in use,
/// its members are numbered by their place in it.
#[derive(Default)]
struct Block {
    /// The rows of the matrix that were copied; empty when the block is not in use.
    samples: Vec<u32>,
    codes: Vec<u8>,
    /// Some rows, turned into columns.
    tile: Vec<[u8; TILE]>,
}

impl Block {
    fn copy(&mut self, data: &BinnedMatrix, members: &mut [Member]) {
        let count = members.len();
        self.samples.extend(members.iter().map(|m| m.sample));
        self.codes.resize(count * data.features(), 0);
        self.tile.resize(data.features(), [0; TILE]);
        for (i, group) in members.chunks_mut(TILE).enumerate() {
            for (turn, member) in group.iter_mut().enumerate() {
                let row = data.row(member.sample as usize);
                for (column, &code) in self.tile.iter_mut().zip(row) {
                    column[turn] = code;
                }
                member.sample = (i * TILE + turn) as u32;
            }
            for (column, tile) in self.codes.chunks_exact_mut(count).zip(&self.tile) {
                column[i * TILE..][..group.len()].copy_from_slice(&tile[..group.len()]);
            }
        }
    }

    fn restore(&self, members: &mut [Member]) {
        for member in members {
            member.sample = self.samples[member.sample as usize];
        }
    }

    /// The bins of one feature, by the members' numbers.
    #[inline]
    fn column<'a>(&'a self, data: &'a BinnedMatrix, feature: usize) -> &'a [u8] {
        match self.samples.len() {
            0 => data.column(feature),
            n => &self.codes[feature * n..(feature + 1) * n],
        }
    }
}

struct Split {
    feature: usize,
    left: u8,
    right: u8,
    score: f64,
}

struct Grower<'a> {
    data: &'a BinnedMatrix,
    spec: &'a GrowSpec,
    random: Stream,
    block: Block,
    scan: Box<dyn NodeScan + 'a>,
    /// All features, in the order that the last draws left.
    features: Vec<usize>,
    /// The bins of the node's members, for one feature.
    codes: Vec<u8>,
    /// Holds the members that go right while the others move together.
    right: Vec<Member>,
}

impl Grower<'_> {
    fn best_split(&mut self, members: &[Member]) -> Option<Split> {
        let weight: u64 = members.iter().map(|member| u64::from(member.weight)).sum();
        if weight < 2 * u64::from(self.spec.min_leaf) || !self.scan.enter(members) {
            return None;
        }
        let codes = &mut self.codes[..members.len()];
        let mut best: Option<Split> = None;
        for drawn in 0..self.features.len() {
            if drawn >= self.spec.features_per_node && best.is_some() {
                break;
            }
            let pick = drawn + below(&mut self.random, self.features.len() - drawn);
            self.features.swap(drawn, pick);
            let feature = self.features[drawn];
            let column = self.block.column(self.data, feature);
            let first = column[members[0].sample as usize];
            let mut differ = 0;
            for (code, member) in codes.iter_mut().zip(members) {
                *code = column[member.sample as usize];
                differ |= *code ^ first;
            }
            if differ == 0 {
                continue;
            }
            let Some(cut) = self.scan.best_cut(members, codes, self.spec.min_leaf) else {
                continue;
            };
            if best.as_ref().is_none_or(|best| cut.score > best.score) {
                best = Some(Split {
                    feature,
                    left: cut.left,
                    right: cut.right,
                    score: cut.score,
                });
            }
        }
        best
    }

    /// Puts the members that go left before the others, each side in ascending order, and returns
    /// how many they are.
    fn partition(&mut self, members: &mut [Member], split: &Split) -> usize {
        let column = self.block.column(self.data, split.feature);
        self.right.clear();
        let mut left = 0;
        for at in 0..members.len() {
            let member = members[at];
            if column[member.sample as usize] <= split.left {
                members[left] = member;
                left += 1;
            } else {
                self.right.push(member);
            }
        }
        members[left..].copy_from_slice(&self.right);
        left
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distances::DistanceMatrix;
    use crate::feature::SampleMatrix;
    use crate::forest::objective::{mse::mse, mspd::mspd};
    use crate::random::unit;

    /// A sample of weight 3 and three samples are the same, and a weight of 0 is none; and blocks
    /// of any size change nothing.
    #[test]
    fn weights_are_repetitions_and_blocks_do_not_matter() {
        let mut random = stream(1, "weights", &[]);
        let table = TargetTable::new(2, (0..80).map(|_| unit(&mut random)).collect()).unwrap();
        let samples = 500;
        let weights: Vec<u16> = (0..samples).map(|_| below(&mut random, 4) as u16).collect();
        let targets: Vec<u16> = (0..samples)
            .map(|_| below(&mut random, 40) as u16)
            .collect();
        let rows: Vec<[i16; 5]> = (0..samples)
            .map(|_| std::array::from_fn(|_| below(&mut random, 200) as i16))
            .collect();
        let spec = GrowSpec {
            trees: 1,
            min_leaf: 4,
            features_per_node: 2,
            max_depth: None,
            bootstrap: false,
        };
        let grown = |drawn: &[usize], weights: &[u16], small: usize| {
            let matrix = SampleMatrix::fill(5, &[drawn.len()], |_, columns| {
                for (feature, column) in columns.iter_mut().enumerate() {
                    for (value, &sample) in column.iter_mut().zip(drawn) {
                        *value = rows[sample][feature];
                    }
                }
                Ok::<(), ()>(())
            });
            let data = BinnedMatrix::new(&matrix.unwrap()).unwrap();
            let targets: Vec<u16> = drawn.iter().map(|&sample| targets[sample]).collect();
            let objective = mse(&table).unwrap();
            let mut impurities = Vec::new();
            let leaf = |members: &[Member]| {
                assert!(members.iter().map(|m| u32::from(m.weight)).sum::<u32>() >= 4);
                impurities.push(objective.impurity(members));
            };
            let random = stream(2, "tree", &[]);
            let tree = grow_tree(
                &data,
                &targets,
                weights,
                &*objective,
                &spec,
                small,
                random,
                leaf,
            );
            (tree, impurities)
        };
        let once: Vec<usize> = (0..samples).collect();
        let repeated: Vec<usize> = (0..samples)
            .flat_map(|sample| std::iter::repeat_n(sample, usize::from(weights[sample])))
            .collect();
        let (tree, impurities) = grown(&once, &weights, 0);
        for small in [0, 100, 1000] {
            assert_eq!(
                grown(&once, &weights, small),
                (tree.clone(), impurities.clone())
            );
            let (same, others) = grown(&repeated, &vec![1; repeated.len()], small);
            assert!(tree == same && tree.leaves() > 50);
            for (a, b) in impurities.iter().zip(others) {
                assert!((a - b).abs() < 1e-12);
            }
        }
    }

    /// With D = |y_a - y_b| the variance and eq. 6 differ by 2 k n / (n - 1), and where each sample
    /// weighs as much as 20,000 by a constant: they grow the same trees.
    #[test]
    fn mspd_of_euclidean_distances_grows_the_trees_of_mse() {
        const SAMPLES: usize = 400;
        let mut random = stream(3, "euclidean", &[]);
        let values: Vec<f64> = (0..3 * 50).map(|_| unit(&mut random)).collect();
        let distances = DistanceMatrix::euclidean(&values, 3);
        let table = TargetTable::new(3, values).unwrap();
        let matrix = SampleMatrix::fill(6, &[SAMPLES], |_, columns| {
            let mut random = stream(3, "values", &[]);
            for column in columns {
                column.fill_with(|| below(&mut random, 300) as i16);
            }
            Ok::<(), ()>(())
        });
        let data = BinnedMatrix::new(&matrix.unwrap()).unwrap();
        let targets: Vec<u16> = (0..SAMPLES as u16).map(|sample| sample / 8).collect();
        let spec = GrowSpec {
            trees: 1,
            min_leaf: 3 * 20_000,
            features_per_node: 6,
            max_depth: None,
            bootstrap: false,
        };
        let grown = |objective: &dyn Objective| {
            let random = stream(4, "tree", &[]);
            let weights = [20_000; SAMPLES];
            grow_tree(
                &data,
                &targets,
                &weights,
                objective,
                &spec,
                0,
                random,
                |_| (),
            )
        };
        let tree = grown(&*mse(&table).unwrap());
        assert_eq!(tree, grown(&*mspd(&distances).unwrap()));
        assert!(tree.leaves() > 80);
    }

    #[test]
    fn a_bootstrap_draws_each_sample_as_often_as_poisson_says() {
        let weights = bootstrap(100_000, &mut stream(1, "bootstrap", &[0]));
        assert_eq!(weights.iter().map(|&w| u32::from(w)).sum::<u32>(), 100_000);
        let absent = weights.iter().filter(|&&w| w == 0).count() as f64 / 100_000.0;
        assert!((absent - (-1f64).exp()).abs() < 0.006, "{absent}");
    }
}
