//! Growing a part forest: trees that tell parts apart, and leaves that are then fitted with votes
//! for the joints (Girshick et al., ICCV 2011, whose offsets the baseline \[3\] takes over).

use super::ForestError;
use super::bins::BinnedMatrix;
use super::grow::{GrowSpec, Member, TargetTable, grow};
use super::leaves::LeafTable;
use super::objective::mse::mse;
use super::part_forest::PartClass;
use super::tree::Tree;
use crate::Progress;
use crate::mean_shift::{WeightedPoint, modes};
use serde::{Deserialize, Serialize};

/// How the votes of a leaf are found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RetrofitSpec {
    /// Of a leaf with more voting samples so many are looked at, evenly spaced in the order of the
    /// samples, which is that of the images.
    pub most_samples: usize,
    /// Of mean shift in a leaf.
    pub bandwidth_m: f64,
    /// How many modes a leaf keeps for each joint: the largest.
    pub modes: usize,
}

/// What the samples of a part forest show, in the order of its matrix.
#[derive(Debug, Clone)]
pub struct PartSamples {
    /// The class of each sample, as an index into the forest's classes.
    pub classes: Vec<u16>,
    /// The point that each sample's pixel shows: camera frame, metres.
    pub points: Vec<[f32; 3]>,
    /// The image of each sample, as an index into `joints`.
    pub images: Vec<u16>,
    /// The true position of each joint in each image: camera frame, metres.
    pub joints: Vec<Vec<[f32; 3]>>,
}

/// Grows trees on the Gini impurity of the classes. Every leaf then gets the share of each class and,
/// for each joint, the modes of the vectors from the points of its voting samples to the joint, with
/// the share of all its samples that belong to a mode as weight: where background or another arm has
/// come in, the votes weigh less. Rows are as [`PartForest`](super::part_forest::PartForest) wants them.
pub fn grow_parts(
    data: &BinnedMatrix,
    samples: &PartSamples,
    classes: &[PartClass],
    grow_spec: &GrowSpec,
    spec: &RetrofitSpec,
    seed: u64,
    progress: Progress,
) -> Result<(Vec<Tree>, Vec<LeafTable>), ForestError> {
    if spec.most_samples == 0 {
        return Err(ForestError::Zero(
            "the number of samples a leaf learns votes from",
        ));
    }
    if spec.modes == 0 {
        return Err(ForestError::Zero("the number of modes a leaf keeps"));
    }
    let per_sample = [
        ("points of samples", samples.points.len()),
        ("images of samples", samples.images.len()),
    ];
    for (what, got) in per_sample {
        if got != data.samples() {
            return Err(ForestError::Size {
                what,
                got,
                expected: data.samples(),
            });
        }
    }
    // One target a class, 1 for itself and 0 for the others: the variance of eq. 5 is the Gini
    // impurity 1 - sum of shares squared, divided by the number of classes.
    let one_hot = |row: usize| (0..classes.len()).map(move |at| f64::from(u8::from(at == row)));
    let table = TargetTable::new(
        classes.len(),
        (0..classes.len()).flat_map(one_hot).collect(),
    )?;
    let objective = mse(&table)?;
    let leaf = |rows: &mut Rows, members: &[Member]| {
        let mut shares = vec![0.0; classes.len()];
        table.mean(members, &mut shares);
        rows.values.extend(shares.iter().map(|&share| share as f32));
        rows.values.extend(votes(samples, classes, spec, members));
        rows.impurities.push(objective.impurity(members));
    };
    let targets = &samples.classes;
    let grown = grow(data, targets, &*objective, grow_spec, seed, leaf, progress)?;
    let finish = |(tree, rows): (Tree, Rows)| {
        let width = rows.values.len() / tree.leaves();
        Ok((tree, LeafTable::new(width, rows.values, rows.impurities)?))
    };
    grown.into_iter().map(finish).collect()
}

/// The rows of a tree's leaves so far.
#[derive(Default)]
struct Rows {
    values: Vec<f32>,
    impurities: Vec<f64>,
}

/// The votes of a leaf: for each joint `spec.modes` times x, y, z and weight.
fn votes(
    samples: &PartSamples,
    classes: &[PartClass],
    spec: &RetrofitSpec,
    members: &[Member],
) -> Vec<f32> {
    let joints = samples.joints.first().map_or(0, Vec::len);
    let mut votes = vec![0.0; 4 * spec.modes * joints];
    let mut voters = members.to_vec();
    voters.retain(|member| classes[usize::from(member.target)].votes);
    let weight = |members: &[Member]| members.iter().map(|m| f64::from(m.weight)).sum::<f64>();
    let share_of_voters = weight(&voters) / weight(members);
    let count = voters.len().min(spec.most_samples);
    let voters: Vec<Member> = (0..count)
        .map(|i| voters[i * voters.len() / count])
        .collect();
    let scale = share_of_voters / weight(&voters);
    for (joint, of_joint) in votes.chunks_exact_mut(4 * spec.modes).enumerate() {
        let offset = |member: &Member| {
            let sample = member.sample as usize;
            let to = samples.joints[usize::from(samples.images[sample])][joint];
            let from = samples.points[sample];
            WeightedPoint {
                at: std::array::from_fn(|axis| f64::from(to[axis]) - f64::from(from[axis])),
                weight: f64::from(member.weight),
            }
        };
        let offsets: Vec<WeightedPoint> = voters.iter().map(offset).collect();
        let modes = modes(&offsets, spec.bandwidth_m);
        for (vote, mode) in of_joint.chunks_exact_mut(4).zip(&modes) {
            let [x, y, z] = mode.at;
            let values = [x, y, z, mode.weight * scale];
            vote.copy_from_slice(&values.map(|value| value as f32));
        }
    }
    votes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four samples of an arm in two images, one of the other arm and one of the background, in one
    /// leaf; by hand.
    #[test]
    fn votes_of_a_leaf_by_hand() {
        let class = |name: &str, votes| PartClass {
            name: name.to_owned(),
            votes,
        };
        let classes = [
            class("background", false),
            class("hand", true),
            class("forearm", true),
            class("other hand", false),
        ];
        let samples = PartSamples {
            classes: vec![1, 2, 1, 1, 3, 0],
            points: vec![
                [0.0, 0.0, 1.0],
                [0.1, 0.0, 1.0],
                [0.5, 0.0, 1.0],
                [0.5, 0.02, 1.0],
                [9.0, 9.0, 9.0],
                [9.0, 9.0, 9.0],
            ],
            images: vec![0, 0, 1, 1, 0, 1],
            joints: vec![
                vec![[0.0, 0.3, 1.0], [0.05, 0.0, 1.0]],
                vec![[0.5, 0.3, 1.0], [0.5, 0.0, 2.0]],
            ],
        };
        let member = |sample: u32, weight: u16| Member {
            sample,
            target: samples.classes[sample as usize],
            weight,
        };
        let members = [
            member(0, 2),
            member(1, 1),
            member(2, 1),
            member(3, 1),
            member(4, 4),
            member(5, 1),
        ];
        let mut spec = RetrofitSpec {
            most_samples: 10,
            bandwidth_m: 0.005,
            modes: 2,
        };
        let near = |found: &[f32], expected: &[f32]| {
            let close = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6;
            assert!(found.iter().zip(expected).all(close), "{found:?}");
            assert_eq!(found.len(), expected.len());
        };
        // To the first joint samples 0 and 2, of weight 3, say 0.3 down; to the second sample 0, of
        // weight 2, says 0.05 to the right. All others stand alone.
        let found = votes(&samples, &classes, &spec, &members);
        near(&found[..4], &[0.0, 0.3, 0.0, 0.3]);
        assert_eq!(found[7], 0.1);
        near(&found[8..12], &[0.05, 0.0, 0.0, 0.2]);
        // With a bandwidth that takes in samples 0, 2 and 3 they are one mode of the weight 4 of 10.
        spec.bandwidth_m = 0.03;
        let found = votes(&samples, &classes, &spec, &members);
        assert_eq!(found[3], 0.4);
        assert!(0.28 < found[1] && found[1] < 0.3);
        // Of two voters, samples 0 and 2, one mode, which stands for all five of ten.
        spec.most_samples = 2;
        let found = votes(&samples, &classes, &spec, &members);
        near(&found[..8], &[0.0, 0.3, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]);
        // Where nobody votes there are no votes.
        let found = votes(&samples, &classes, &spec, &members[4..]);
        assert_eq!(found, [0.0; 16]);
    }
}
