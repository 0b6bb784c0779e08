//! Votes for a joint, and where most of them meet.

use crate::mean_shift::{WeightedPoint, modes};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// How votes are pooled.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VoteSpec {
    /// Longer votes are discarded: far from a joint little is known of it.
    pub longest_m: f64,
    /// A vote's weight is multiplied with the depth of its pixel in metres to this power. With 2 it
    /// grows with the surface that the pixel covers.
    pub depth_power: i32,
    /// So many votes for a joint count: the heaviest.
    pub heaviest: usize,
    /// Of mean shift.
    pub bandwidth_m: f64,
}

/// A pixel and the point that it shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelPoint {
    /// Its number in the image, row by row.
    pub pixel: u32,
    /// Camera frame, metres.
    pub at: [f32; 3],
}

/// Where a joint was found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FoundJoint {
    /// Camera frame, metres.
    pub at: [f64; 3],
    /// The weight of the votes that meet there.
    pub confidence: f64,
}

/// The votes for one joint in one image.
pub struct Ballot<'a> {
    spec: &'a VoteSpec,
    votes: Vec<Vote>,
}

#[derive(Debug, Clone, Copy)]
struct Vote {
    at: [f32; 3],
    weight: f32,
    /// Decides between votes of equal weight. Multiples of 2^32 over the golden ratio, modulo 2^32,
    /// are all different and those of any row of numbers are spread evenly, so that a choice among
    /// equals takes pixels from all over the image.
    turn: u32,
}

impl Vote {
    fn heavier_first(&self, other: &Vote) -> Ordering {
        let axes = self.at.iter().zip(&other.at);
        let places = axes.map(|(a, b)| a.total_cmp(b));
        let weight = other.weight.total_cmp(&self.weight);
        places.fold(weight.then(self.turn.cmp(&other.turn)), Ordering::then)
    }
}

impl<'a> Ballot<'a> {
    /// Without votes yet.
    pub fn new(spec: &'a VoteSpec) -> Self {
        let votes = Vec::new();
        Self { spec, votes }
    }

    /// A pixel says where the joint is, seen from the point it shows, and with what weight. Votes
    /// without weight and those that are too long do not count.
    #[inline]
    pub fn cast(&mut self, voter: &PixelPoint, offset: [f32; 3], weight: f32) {
        let [x, y, z] = offset.map(f64::from);
        if weight > 0.0 && x * x + y * y + z * z <= self.spec.longest_m.powi(2) {
            self.votes.push(Vote {
                at: std::array::from_fn(|axis| voter.at[axis] + offset[axis]),
                weight: weight * voter.at[2].powi(self.spec.depth_power),
                turn: voter.pixel.wrapping_mul(0x9E37_79B9),
            });
        }
    }

    /// The heaviest mode of the heaviest votes; none without votes. The order in which votes were
    /// cast does not matter.
    pub fn joint(mut self) -> Option<FoundJoint> {
        let most = self.spec.heaviest;
        if self.votes.len() > most {
            self.votes.select_nth_unstable_by(most, Vote::heavier_first);
            self.votes.truncate(most);
        }
        let point = |vote: &Vote| WeightedPoint {
            at: vote.at.map(f64::from),
            weight: vote.weight.into(),
        };
        let votes: Vec<WeightedPoint> = self.votes.iter().map(point).collect();
        let mode = *modes(&votes, self.spec.bandwidth_m).first()?;
        Some(FoundJoint {
            at: mode.at,
            confidence: mode.weight,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{shuffle, stream, uniform};

    const SPEC: VoteSpec = VoteSpec {
        longest_m: 0.5,
        depth_power: 2,
        heaviest: 100,
        bandwidth_m: 0.05,
    };

    fn joint(spec: &VoteSpec, votes: &[(PixelPoint, [f32; 3], f32)]) -> Option<FoundJoint> {
        let mut ballot = Ballot::new(spec);
        for (voter, offset, weight) in votes {
            ballot.cast(voter, *offset, *weight);
        }
        ballot.joint()
    }

    fn voters(count: u32) -> Vec<PixelPoint> {
        let mut random = stream(1, "voters", &[]);
        let mut place = |low, high| uniform(&mut random, low, high) as f32;
        let mut voter = |pixel| PixelPoint {
            pixel,
            at: [place(-0.2, 0.2), place(-0.2, 0.2), place(0.9, 1.3)],
        };
        (0..count).map(&mut voter).collect()
    }

    /// Exact votes meet in the joint, whichever of them count; the confidence is their weight times
    /// the squared depth. Stray and long votes change nothing.
    #[test]
    fn exact_votes_meet_in_the_joint() {
        let truth = [0.05f32, -0.1, 1.1];
        let exact = |voter: &PixelPoint| {
            let offset = std::array::from_fn(|axis| truth[axis] - voter.at[axis]);
            (*voter, offset, 0.5)
        };
        for count in [1, 40, 1000] {
            let voters = voters(count);
            let mut votes: Vec<_> = voters.iter().map(exact).collect();
            let found = joint(&SPEC, &votes).unwrap();
            for (found, truth) in found.at.iter().zip(truth) {
                assert!((found - f64::from(truth)).abs() < 1e-6);
            }
            let mut depths: Vec<f64> = voters.iter().map(|v| f64::from(v.at[2])).collect();
            depths.sort_by(|a, b| b.total_cmp(a));
            let squares: f64 = depths.iter().take(100).map(|z| 0.5 * z * z).sum();
            assert!((found.confidence - squares).abs() < 1e-5 * squares);

            // Stray votes are light enough to be left out, or alone.
            votes.push((voters[0], [0.4, 0.2, 0.1], 0.01));
            votes.push((voters[0], [0.4, 0.4, 0.1], 9.0));
            votes.push((voters[0], [0.0; 3], 0.0));
            let same = joint(&SPEC, &votes).unwrap();
            assert_eq!(same, found);
        }
    }

    #[test]
    fn the_order_of_votes_does_not_matter_and_equals_are_taken_evenly() {
        let mut random = stream(2, "votes", &[]);
        let votes: Vec<_> = voters(2000)
            .into_iter()
            .map(|voter| {
                let offset = std::array::from_fn(|_| uniform(&mut random, -0.1, 0.1) as f32);
                (voter, offset, 1.0)
            })
            .collect();
        let spec = VoteSpec {
            depth_power: 0,
            ..SPEC
        };
        let found = joint(&spec, &votes);
        let mut shuffled = votes.clone();
        for _ in 0..5 {
            shuffle(&mut random, &mut shuffled);
            assert_eq!(joint(&spec, &shuffled), found);
        }
        // 100 of 2000 equal votes: about half of them from either half of the image.
        let mut ballot = Ballot::new(&spec);
        for (voter, offset, weight) in votes {
            ballot.cast(&voter, offset, weight);
        }
        ballot.votes.sort_by(Vote::heavier_first);
        let first_half = (0..1000u32).map(|pixel| pixel.wrapping_mul(0x9E37_79B9));
        let turns: Vec<u32> = first_half.collect();
        let among = ballot.votes[..100]
            .iter()
            .filter(|vote| turns.contains(&vote.turn));
        assert!((45..=55).contains(&among.count()));
    }

    #[test]
    fn no_votes_no_joint() {
        assert_eq!(joint(&SPEC, &[]), None);
        let voter = voters(1)[0];
        assert_eq!(joint(&SPEC, &[(voter, [0.0, 0.6, 0.0], 1.0)]), None);
    }
}
