//! Weighted spectral clustering-based split (section III-B3, eqs. 7-9).
//!
//! The samples of a node are clustered into C_0 and C_1, and a split is judged by the samples that
//! it sends to the wrong side: each counts with its distance to the central sample of the cluster
//! whose side it is on (eqs. 7, 8). Which cluster is meant to go left is found by trying both; the
//! smaller H(S_l) + H(S_r) decides. The score is that of eq. 1, in which each side's H counts by the
//! side's share of the samples.
//!
//! Section III-B says that eq. 1 holds for all objectives, but can also be read so that the plain
//! sum is the score. The sum alone is least, wherever features do not tell the clusters apart, for a
//! cut that sends nearly all samples one way: trees become chains thousands of nodes deep.

use super::histogram::{Histogram, LANE_MAX, Rows};
use super::pairs::mspd_impurity;
use super::{Cut, Made, NodeScan, Objective};
use crate::distances::DistanceMatrix;
use crate::forest::ForestError;
use crate::forest::grow::Member;
use crate::pose_space::spectral::TwoClusters;

/// Target t of a sample is row t of `distances`. Splits are chosen on distances rounded to 15 bits
/// of the node's largest e; [`Objective::impurity`] is eq. 6, as the paper has it for leaves.
pub fn wsc(distances: &DistanceMatrix) -> Made<'_> {
    with_worth(distances, |distance| distance)
}

/// The simpler method that the paper decides against: H is the number of wrong samples.
pub fn wsc_count(distances: &DistanceMatrix) -> Made<'_> {
    with_worth(distances, |_| 1.0)
}

fn with_worth(distances: &DistanceMatrix, worth: fn(f64) -> f64) -> Made<'_> {
    let targets = distances.count();
    let most = usize::from(u16::MAX) + 1;
    if targets > most {
        return Err(ForestError::TooMany {
            what: "targets",
            got: targets,
            most,
        });
    }
    for target in 0..targets {
        let row = distances.row(target);
        if let Some(column) = row.iter().position(|distance| !distance.is_finite()) {
            return Err(ForestError::NotFinite { target, column });
        }
    }
    Ok(Box::new(Wsc { distances, worth }))
}

struct Wsc<'a> {
    distances: &'a DistanceMatrix,
    /// How bad a wrong sample is, by its distance to the centre of the cluster whose side it is on.
    worth: fn(f64) -> f64,
}

impl Objective for Wsc<'_> {
    fn targets(&self) -> usize {
        self.distances.count()
    }

    fn scan(&self, max_weight: u16) -> Box<dyn NodeScan + '_> {
        let nothing = vec![[1, 0, 0, 0]; self.distances.count()];
        Box::new(Scan {
            clusters: NodeClusters::new(self.distances),
            worth: self.worth,
            rows: Rows::new(&nothing, max_weight),
            total: [0.0; LANES],
            histogram: Histogram::default(),
        })
    }

    fn impurity(&self, members: &[Member]) -> f64 {
        mspd_impurity(self.distances, members)
    }
}

/// The clusters of one node after the other.
pub struct NodeClusters<'a> {
    distances: &'a DistanceMatrix,
    /// The weight of each target in the node.
    weight_of: Vec<u32>,
    present: Vec<u16>,
    weights: Vec<f64>,
    /// The distances between those present, row by row.
    among: Vec<f64>,
    spectral: TwoClusters,
    in_second: Vec<bool>,
    centres: [usize; 2],
}

impl<'a> NodeClusters<'a> {
    pub fn new(distances: &'a DistanceMatrix) -> Self {
        Self {
            distances,
            weight_of: vec![0; distances.count()],
            present: Vec::new(),
            weights: Vec::new(),
            among: Vec::new(),
            spectral: TwoClusters::default(),
            in_second: Vec::new(),
            centres: [0; 2],
        }
    }

    /// Clusters the samples of a node. False when all are alike; then there are no clusters.
    pub fn find(&mut self, members: &[Member]) -> bool {
        self.present.clear();
        for member in members {
            let weight = &mut self.weight_of[usize::from(member.target)];
            if *weight == 0 {
                self.present.push(member.target);
            }
            *weight += u32::from(member.weight);
        }
        self.present.sort_unstable();
        self.weights.clear();
        self.among.clear();
        for &target in &self.present {
            let weight = std::mem::take(&mut self.weight_of[usize::from(target)]);
            self.weights.push(f64::from(weight));
            let row = self.distances.row(usize::from(target));
            let others = self.present.iter();
            self.among
                .extend(others.map(|&other| row[usize::from(other)]));
        }
        let Some(in_second) = self.spectral.find(&self.among, &self.weights) else {
            return false;
        };
        self.in_second.clear();
        self.in_second.extend(in_second);
        self.centres = [self.central(false), self.central(true)];
        true
    }

    /// The place of a cluster's central target (eq. 9); of equals the first.
    fn central(&self, second: bool) -> usize {
        let mut best = (f64::INFINITY, 0);
        let rows = self.among.chunks_exact(self.present.len());
        for (place, row) in rows.enumerate() {
            if self.in_second[place] != second {
                continue;
            }
            let mut sum = 0.0;
            for (other, (distance, weight)) in row.iter().zip(&self.weights).enumerate() {
                if self.in_second[other] == second {
                    sum += weight * distance;
                }
            }
            if sum < best.0 {
                best = (sum, place);
            }
        }
        best.1
    }

    /// The targets in the node, ascending, and whether each is in C_1. The lowest is in C_0.
    pub fn targets(&self) -> impl Iterator<Item = (u16, bool)> {
        let clusters = self.in_second.iter().copied();
        self.present.iter().copied().zip(clusters)
    }

    /// The targets c_0 and c_1.
    pub fn centres(&self) -> [u16; 2] {
        [self.present[self.centres[0]], self.present[self.centres[1]]]
    }

    /// The distance e of the target at a place to the centre of the other cluster.
    fn to_other_centre(&self, place: usize) -> f64 {
        let other = self.centres[usize::from(!self.in_second[place])];
        self.among[place * self.present.len() + other]
    }
}

/// A multiple of what vectors hold.
const LANES: usize = 4;

struct Scan<'a> {
    clusters: NodeClusters<'a>,
    worth: fn(f64) -> f64,
    /// Lane 1 + i holds, for targets in C_i, how bad they are on the side of the other cluster.
    rows: Rows<LANES>,
    total: [f64; LANES],
    histogram: Histogram<LANES>,
}

impl NodeScan for Scan<'_> {
    fn enter(&mut self, members: &[Member]) -> bool {
        if !self.clusters.find(members) {
            return false;
        }
        let clusters = &self.clusters;
        let worth = |place: usize| (self.worth)(clusters.to_other_centre(place));
        let mut largest = 0.0;
        for place in 0..clusters.present.len() {
            largest = f64::max(largest, worth(place));
        }
        let scale = f64::from(LANE_MAX) / largest;
        for (place, (target, second)) in clusters.targets().enumerate() {
            let mut row = [1, 0, 0, 0];
            row[1 + usize::from(second)] = (worth(place) * scale).round() as i32;
            self.rows.set(usize::from(target), row);
        }
        self.total = self.histogram.enter(&self.rows, members);
        true
    }

    fn best_cut(&mut self, _: &[Member], codes: &[u8], min_leaf: u32) -> Option<Cut> {
        let Self { rows, total, .. } = self;
        self.histogram
            .best_cut(rows, total, codes, min_leaf, less_is_wrong)
    }
}

/// -(|S_l| H(S_l) + |S_r| H(S_r)). With whole numbers below 2^53 it is exact in nodes of up to half a
/// million samples, and the same for a split and its mirror image.
#[inline(always)]
fn less_is_wrong(left: &[f64; LANES], total: &[f64; LANES]) -> f64 {
    let right = [total[0] - left[0], total[1] - left[1], total[2] - left[2]];
    // With C_0 on the left, what C_1 has there and C_0 on the right is wrong; and the reverse.
    let variant = |wrong_left: f64, wrong_right: f64| {
        let weighted = left[0] * wrong_left + right[0] * wrong_right;
        (wrong_left + wrong_right, weighted)
    };
    let (one, other) = (variant(left[2], right[1]), variant(left[1], right[2]));
    -if other < one { other.1 } else { one.1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{below, normal, stream};

    fn poses(count: usize, seed: u64) -> DistanceMatrix {
        let mut s = stream(seed, "poses", &[]);
        let points: Vec<f64> = (0..2 * count).map(|_| normal(&mut s)).collect();
        DistanceMatrix::euclidean(&points, 2)
    }

    /// Eqs. 7 to 9 as they stand, over samples of weight 1, and n times the loss of eq. 1.
    fn by_definition(
        distances: &DistanceMatrix,
        samples: &[u16],
        goes_left: &[bool],
        second: impl Fn(u16) -> bool,
        worth: fn(f64) -> f64,
    ) -> f64 {
        let d = |a: u16, b: u16| distances.get(usize::from(a), usize::from(b));
        let central = |cluster: bool| {
            let set = samples.iter().copied().filter(|&s| second(s) == cluster);
            let set: Vec<u16> = set.collect();
            let sum = |s: u16| set.iter().map(|&other| d(s, other)).sum::<f64>();
            let best = set
                .iter()
                .copied()
                .min_by(|&a, &b| sum(a).total_cmp(&sum(b)));
            best.unwrap()
        };
        let centres = [central(false), central(true)];
        // H of both sides when C_0 or when C_1 is meant to go left.
        let wrong = |left: bool| {
            let side = |is_left: bool| {
                let meant = left == is_left;
                let on_side = samples.iter().zip(goes_left);
                let on_side = on_side.filter(|(_, goes_left)| **goes_left == is_left);
                let wrong = on_side.clone().filter(|(s, _)| second(**s) != meant);
                let centre = centres[usize::from(meant)];
                let sum: f64 = wrong.map(|(&s, _)| worth(d(s, centre))).sum();
                (sum, on_side.count() as f64)
            };
            let ((l, n_l), (r, n_r)) = (side(true), side(false));
            (l + r, n_l * l + n_r * r)
        };
        let (one, other) = (wrong(false), wrong(true));
        if one.0 < other.0 { one.1 } else { other.1 }
    }

    #[test]
    fn scores_are_those_of_the_definition_for_every_cut() {
        scores_are_those_of_the_definition(wsc, |distance| distance);
        scores_are_those_of_the_definition(wsc_count, |_| 1.0);
    }

    fn scores_are_those_of_the_definition(
        make: fn(&DistanceMatrix) -> Made<'_>,
        worth: fn(f64) -> f64,
    ) {
        for (seed, count) in [2usize, 3, 5, 8, 20].into_iter().enumerate() {
            let distances = poses(count, seed as u64);
            let mut s = stream(seed as u64, "members", &[]);
            let members: Vec<Member> = (0..4 * count as u32)
                .map(|sample| Member {
                    sample,
                    target: match sample as usize {
                        early if early < count => early,
                        _ => below(&mut s, count),
                    } as u16,
                    weight: 1 + below(&mut s, 3) as u16,
                })
                .collect();
            let samples: Vec<u16> = (members.iter())
                .flat_map(|m| std::iter::repeat_n(m.target, usize::from(m.weight)))
                .collect();
            let objective = make(&distances).unwrap();
            let mut scan = objective.scan(3);
            assert!(scan.enter(&members));
            let mut clusters = NodeClusters::new(&distances);
            assert!(clusters.find(&members));
            let second: Vec<bool> = clusters.targets().map(|(_, second)| second).collect();
            let second = |target: u16| second[usize::from(target)];
            // What a whole number is worth.
            let [c0, c1] = clusters.centres().map(usize::from);
            let e = |target: u16| match second(target) {
                true => worth(distances.get(usize::from(target), c0)),
                false => worth(distances.get(usize::from(target), c1)),
            };
            let unit = samples.iter().map(|&s| e(s)).fold(0.0, f64::max) / f64::from(LANE_MAX);

            let bins: Vec<u8> = members.iter().map(|_| below(&mut s, 10) as u8).collect();
            let mut best: Option<(u8, f64)> = None;
            for cut in 0..9 {
                let codes: Vec<u8> = bins.iter().map(|&bin| u8::from(bin > cut)).collect();
                let goes_left: Vec<bool> = (members.iter().zip(&codes))
                    .flat_map(|(m, &code)| std::iter::repeat_n(code == 0, m.weight.into()))
                    .collect();
                let Some(found) = scan.best_cut(&members, &codes, 1) else {
                    assert!(codes.iter().all(|&code| code == codes[0]));
                    continue;
                };
                let expected = by_definition(&distances, &samples, &goes_left, second, worth);
                let ours = -found.score * unit;
                let rounding = unit * (samples.len() as f64).powi(2) / 2.0;
                assert!((ours - expected).abs() < rounding, "{ours} {expected}");
                if bins.contains(&cut) && best.is_none_or(|best| found.score > best.1) {
                    best = Some((cut, found.score));
                }
            }
            let found = scan.best_cut(&members, &bins, 1);
            assert_eq!(found.map(|cut| (cut.left, cut.score)), best);
        }
    }

    /// Whatever was in the nodes before.
    #[test]
    fn a_weight_is_a_repetition_and_the_order_does_not_matter() {
        let distances = poses(30, 7);
        let objective = wsc(&distances).unwrap();
        let mut scan = objective.scan(4);
        let mut s = stream(8, "members", &[]);
        for _ in 0..20 {
            let member = |sample| Member {
                sample,
                target: below(&mut s, 30) as u16,
                weight: 1 + below(&mut s, 4) as u16,
            };
            let members: Vec<Member> = (0..40).map(member).collect();
            let codes: Vec<u8> = (0..40).map(|_| below(&mut s, 256) as u8).collect();
            assert!(scan.enter(&members));
            let cut = scan.best_cut(&members, &codes, 3);
            let once = |(member, &code): (&Member, &u8)| {
                let once = Member {
                    weight: 1,
                    ..*member
                };
                std::iter::repeat_n((once, code), usize::from(member.weight))
            };
            let repeated = members.iter().zip(&codes).rev().flat_map(once);
            let (repeated, codes): (Vec<_>, Vec<_>) = repeated.unzip();
            assert!(scan.enter(&repeated));
            assert_eq!(scan.best_cut(&repeated, &codes, 3), cut);
        }
    }

    #[test]
    fn a_node_of_one_pose_is_a_leaf() {
        let distances = DistanceMatrix::euclidean(&[1.0, 1.0, 4.0], 1);
        let objective = wsc(&distances).unwrap();
        let mut scan = objective.scan(1);
        let member = |target| Member {
            sample: 0,
            target,
            weight: 1,
        };
        for (targets, splits) in [([0, 0], false), ([0, 1], false), ([1, 2], true)] {
            assert_eq!(scan.enter(&targets.map(member)), splits);
        }
        assert_eq!(objective.impurity(&[0, 2].map(member)), 9.0);
        let infinite = DistanceMatrix::new(2, |_, _| f64::INFINITY);
        assert!(wsc(&infinite).is_err());
    }
}
