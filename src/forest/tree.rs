//! One tree: compact nodes, and the walk of an image's pixels through them.

use crate::feature::{FeaturesOnImage, LANES};
use rayon::prelude::*;

/// Eight bytes. A leaf has `feature == LEAF` and its number in `child`; any other node sends
/// `value <= threshold` to node `child` and the rest to node `child + 1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Node {
    pub feature: u16,
    pub threshold: i16,
    pub child: u32,
}

/// Marks a leaf in [`Node::feature`].
pub const LEAF: u16 = u16::MAX;

/// Node 0 is the root; children stand side by side and after their parent; leaves are numbered from
/// 0 in the order of a walk that goes left first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tree {
    nodes: Vec<Node>,
    leaves: usize,
}

/// Why some nodes are not a tree.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TreeError {
    #[error("node {0} has a child that does not exist or does not come after it")]
    Child(usize),
    #[error("node {0} asks for a feature that does not exist")]
    Feature(usize),
    #[error("node {0} is reached by no node or by several")]
    Parents(usize),
    #[error("leaf at node {0} does not have the next number")]
    LeafNumber(usize),
}

impl Tree {
    /// Checks that `nodes` are a tree over `features` features as described at [`Tree`].
    pub fn new(nodes: Vec<Node>, features: usize) -> Result<Self, TreeError> {
        let mut parents = vec![0u8; nodes.len()];
        let mut leaf_seen = vec![false; nodes.len()];
        let mut leaves = 0;
        for (at, node) in nodes.iter().enumerate() {
            let child = node.child as usize;
            if node.feature == LEAF {
                match leaf_seen.get_mut(child) {
                    Some(seen) if !*seen => *seen = true,
                    _ => return Err(TreeError::LeafNumber(at)),
                }
                leaves += 1;
                continue;
            }
            if usize::from(node.feature) >= features {
                return Err(TreeError::Feature(at));
            }
            match parents.get_mut(child..child.saturating_add(2)) {
                Some(children) if child > at => {
                    children
                        .iter_mut()
                        .for_each(|count| *count = count.saturating_add(1));
                }
                _ => return Err(TreeError::Child(at)),
            }
        }
        // A node has one parent, and it comes before: from every node the way up ends at the root.
        let strays = |(at, &count): (usize, &u8)| usize::from(count) != usize::from(at > 0);
        if let Some(at) = parents.iter().enumerate().position(strays) {
            return Err(TreeError::Parents(at));
        }
        if nodes.is_empty() {
            return Err(TreeError::Child(0));
        }
        // `leaves` distinct numbers: they are 0..leaves exactly when none is beyond.
        if let Some(at) = nodes
            .iter()
            .position(|node| node.feature == LEAF && node.child as usize >= leaves)
        {
            return Err(TreeError::LeafNumber(at));
        }
        Ok(Self { nodes, leaves })
    }

    /// Takes nodes that the grower made.
    pub(super) fn grown(nodes: Vec<Node>, leaves: usize) -> Self {
        Self { nodes, leaves }
    }

    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// How many leaves there are; their numbers are below.
    pub fn leaves(&self) -> usize {
        self.leaves
    }

    /// The most splits on the way from the root to a leaf.
    pub fn depth(&self) -> usize {
        let mut depths = vec![0; self.nodes.len()];
        for (at, node) in self.nodes.iter().enumerate() {
            if node.feature != LEAF {
                depths[node.child as usize] = depths[at] + 1;
                depths[node.child as usize + 1] = depths[at] + 1;
            }
        }
        depths.into_iter().max().unwrap_or(0)
    }

    /// Writes into `leaves` the number of the leaf that each of `pixels` ends in, in their order.
    ///
    /// Neighbours mostly go the same way, so the words of a node are looked at one after the other,
    /// sixteen pixels with a few vector instructions, and each is split in the pixels that go left and
    /// those that go right. Every node is visited once, and nothing waits for memory or for a guess
    /// which way a pixel goes.
    fn find_leaves(&self, image: &FeaturesOnImage, pixels: &Pixels, leaves: &mut [u32]) {
        let mut words = pixels.words.clone();
        let mut right = words.clone();
        let mut found = vec![[0; LANES]; words.len()];
        // Nodes to visit, and where their words begin; those of the last one are the last words.
        let mut waiting = vec![(0, 0)];
        while let Some((at, start)) = waiting.pop() {
            let node = self.nodes[at as usize];
            let here = &mut words[start..];
            if node.feature == LEAF {
                for word in here {
                    let found = &mut found[word.number()];
                    word.lanes().for_each(|lane| found[lane] = node.child);
                }
                words.truncate(start);
                continue;
            }
            let (minuend, subtrahend) = image.operands(node.feature.into());
            let (lefts, rights) = match subtrahend {
                Some(subtrahend) => {
                    let length = minuend.len().min(subtrahend.len());
                    let (minuend, subtrahend) = (&minuend[..length], &subtrahend[..length]);
                    split(here, &mut right, |first| {
                        let minuend = &minuend[first..first + LANES];
                        let subtrahend = &subtrahend[first..first + LANES];
                        mask(|lane| minuend[lane].wrapping_sub(subtrahend[lane]) > node.threshold)
                    })
                }
                None => split(here, &mut right, |first| {
                    let values = &minuend[first..first + LANES];
                    mask(|lane| values[lane] > node.threshold)
                }),
            };
            words.truncate(start + lefts);
            if lefts > 0 {
                waiting.push((node.child, start));
            }
            if rights > 0 {
                waiting.push((node.child + 1, start + lefts));
                words.extend_from_slice(&right[..rights]);
            }
        }
        let found = pixels.words.iter().zip(&found);
        let found = found.flat_map(|(word, found)| word.lanes().map(|lane| found[lane]));
        leaves
            .iter_mut()
            .zip(found)
            .for_each(|(leaf, found)| *leaf = found);
    }
}

/// Finds the leaf of each pixel in each of `trees`, in parallel: tree by tree, one number a pixel.
/// `image` are the features that the trees were grown on, on an image; `positions` are
/// [`PaddedDepth::position`]s, and neighbours in a row should stand together: they go together.
///
/// [`PaddedDepth::position`]: crate::feature::PaddedDepth::position
pub fn find_leaves(trees: &[Tree], image: &FeaturesOnImage, positions: &[u32]) -> Vec<u32> {
    let mut leaves = vec![0; trees.len() * positions.len()];
    let runs: Vec<Pixels> = positions.par_chunks(RUN).map(Pixels::new).collect();
    trees
        .par_iter()
        .zip(leaves.par_chunks_exact_mut(positions.len().max(1)))
        .for_each(|(tree, leaves)| {
            runs.par_iter()
                .zip(leaves.par_chunks_mut(RUN))
                .for_each(|(pixels, leaves)| tree.find_leaves(image, pixels, leaves));
        });
    leaves
}

/// How many pixels walk through a tree together: a fifth of an image, so that the work can be shared
/// out and all that is written stays in the second-level cache.
const RUN: usize = 1 << 16;

/// At most [`RUN`] pixels, neighbours in a row together in one word.
struct Pixels {
    words: Vec<Word>,
}

impl Pixels {
    fn new(positions: &[u32]) -> Self {
        let mut words: Vec<Word> = Vec::new();
        for &position in positions {
            let (lane, first) = (
                position % LANES as u32,
                position / LANES as u32 * LANES as u32,
            );
            let number = words.len() as u64;
            match words.last_mut() {
                // Lanes are in the order of the pixels.
                Some(word) if word.first() == first as usize && word.mask() >> lane == 0 => {
                    word.0 |= 1 << lane;
                }
                _ => words.push(Word(u64::from(first) << 32 | number << 16 | 1 << lane)),
            }
        }
        Self { words }
    }
}

/// Some of [`LANES`] neighbours: the position of the first of them, a multiple of their number, in the
/// upper 32 bits; then 16 bits for the word's number among all words; and the lowest 16 for the mask, in
/// which bit i says whether the i-th neighbour is meant.
#[derive(Clone, Copy)]
struct Word(u64);

impl Word {
    fn first(self) -> usize {
        (self.0 >> 32) as usize
    }

    fn number(self) -> usize {
        usize::from((self.0 >> 16) as u16)
    }

    fn mask(self) -> u16 {
        self.0 as u16
    }

    /// The lanes whose bit is set, ascending.
    fn lanes(self) -> impl Iterator<Item = usize> {
        let mut mask = self.mask();
        std::iter::from_fn(move || {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask.wrapping_sub(1);
            (lane < LANES).then_some(lane)
        })
    }
}

/// The lanes of which something holds, as bits.
#[inline(always)]
fn mask(holds: impl Fn(usize) -> bool) -> u16 {
    (0..LANES).fold(0, |mask, lane| mask | u16::from(holds(lane)) << lane)
}

/// Leaves in `words` what goes left, and writes into `right` what goes right: `above` says for the first
/// of some neighbours which of them do. Words without pixels are left out. Returns how many words there
/// are left and right. Kept apart so that its loop has the registers for itself.
#[inline(never)]
fn split(words: &mut [Word], right: &mut [Word], above: impl Fn(usize) -> u16) -> (usize, usize) {
    let right = &mut right[..words.len()];
    let (mut lefts, mut rights) = (0, 0);
    for at in 0..words.len() {
        let word = words[at];
        let above = u64::from(above(word.first()));
        let to_left = Word(word.0 & !above);
        let to_right = Word(word.0 & (above | !0xffff));
        // Written in any case, and kept by counting: a branch would be guessed wrong too often.
        words[lefts] = to_left;
        lefts += usize::from(to_left.mask() != 0);
        right[rights] = to_right;
        rights += usize::from(to_right.mask() != 0);
    }
    (lefts, rights)
}
