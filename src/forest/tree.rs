//! One tree: compact nodes, and the walk of many samples through them.

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

/// How many samples walk through a tree together: enough to hide the latency of memory, few enough
/// to stay in the first-level cache.
const ABREAST: usize = 64;

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

    /// Writes into `leaves` the number of the leaf that each of `samples` ends in. `value(f, s)` is
    /// the value of feature f at sample s.
    pub fn find_leaves<S: Copy>(
        &self,
        samples: &[S],
        value: impl Fn(usize, S) -> i16,
        leaves: &mut [u32],
    ) {
        for (samples, leaves) in samples.chunks(ABREAST).zip(leaves.chunks_mut(ABREAST)) {
            // Samples that still walk stand first in `walking`; `leaves` holds the node each is at.
            leaves.fill(0);
            let mut walking: [u8; ABREAST] = std::array::from_fn(|i| i as u8);
            let mut count = samples.len();
            while count > 0 {
                let mut still = 0;
                for turn in 0..count {
                    let at = usize::from(walking[turn]);
                    let node = self.nodes[leaves[at] as usize];
                    if node.feature == LEAF {
                        leaves[at] = node.child;
                    } else {
                        let right = value(usize::from(node.feature), samples[at]) > node.threshold;
                        leaves[at] = node.child + u32::from(right);
                        walking[still] = at as u8;
                        still += 1;
                    }
                }
                count = still;
            }
        }
    }
}
