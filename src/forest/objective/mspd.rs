//! Mean squared pairwise DISP (eq. 6), exactly and about as fast as the mean squared error.
//!
//! With c_a samples of target a and G = D^2 c, the sum over all pairs is c^T D^2 c = c . G. The
//! samples move from right to left in the order of their bins; of the left side the products
//! g = D^2 c_l are kept, one number for each target that is present in the node. A sample of weight
//! w and target a adds 2 w g_a to the left side's sum of pairs, and w times row a of D^2 to g. The
//! right side's sum is that of the node minus 2 c_l . G plus that of the left side.

use super::super::bins::BINS;
use super::pairs::{SquaredDistances, mean_of_pairs, mspd_impurity};
use super::{Cut, NodeScan, Objective};
use crate::distances::DistanceMatrix;
use crate::forest::ForestError;
use crate::forest::grow::Member;

/// Eq. 6. Target t of a sample is row t of `distances`. Splits are the same as those of
/// [`mspd_published`](super::mspd_published::mspd_published), scores and ties too.
pub fn mspd(distances: &DistanceMatrix) -> Result<Box<dyn Objective + '_>, ForestError> {
    Ok(Box::new(Mspd {
        distances,
        squared: SquaredDistances::new(distances)?,
    }))
}

struct Mspd<'a> {
    distances: &'a DistanceMatrix,
    squared: SquaredDistances,
}

impl Objective for Mspd<'_> {
    fn targets(&self) -> usize {
        self.squared.targets()
    }

    fn scan(&self, _max_weight: u16) -> Box<dyn NodeScan + '_> {
        Box::new(Scan {
            squared: &self.squared,
            place: vec![ABSENT; self.squared.targets()],
            present: Vec::new(),
            places: Vec::new(),
            rows: Vec::new(),
            products: Vec::new(),
            left: Vec::new(),
            weight: 0,
            pairs: 0,
            first: [NONE; BINS],
            next: Vec::new(),
        })
    }

    fn impurity(&self, members: &[Member]) -> f64 {
        mspd_impurity(self.distances, members)
    }
}

/// Numbers that are added together.
const LANES: usize = 8;
const ABSENT: u32 = u32::MAX;
const NONE: u32 = u32::MAX;

/// Whole numbers below 2^53, for which `f64` is exact: a sum of D^2 over up to 2^21 samples.
type Lanes = [f64; LANES];

struct Scan<'a> {
    squared: &'a SquaredDistances,
    /// The place of each target among those present in the node.
    place: Vec<u32>,
    present: Vec<u16>,
    /// The place of each member's target.
    places: Vec<u32>,
    /// D^2 between the targets present, row by row, filled up with zeros to whole lanes.
    rows: Vec<Lanes>,
    /// G, by place.
    products: Vec<u64>,
    /// g.
    left: Vec<Lanes>,
    /// Of the node.
    weight: u64,
    pairs: i128,
    /// The members of each bin, as chains: the first of a bin and the next of a member.
    first: [u32; BINS],
    next: Vec<u32>,
}

impl NodeScan for Scan<'_> {
    fn enter(&mut self, members: &[Member]) -> bool {
        for target in self.present.drain(..) {
            self.place[usize::from(target)] = ABSENT;
        }
        self.places.clear();
        let mut counts: Vec<u64> = Vec::new();
        for member in members {
            let place = &mut self.place[usize::from(member.target)];
            if *place == ABSENT {
                *place = self.present.len() as u32;
                self.present.push(member.target);
                counts.push(0);
            }
            counts[*place as usize] += u64::from(member.weight);
            self.places.push(*place);
        }
        self.rows.clear();
        self.products.clear();
        for &target in &self.present {
            let row = self.squared.row(target);
            let to = |&other: &u16| row[usize::from(other)];
            for others in self.present.chunks(LANES) {
                let mut lanes = [0.0; LANES];
                for (lane, other) in lanes.iter_mut().zip(others) {
                    *lane = f64::from(to(other));
                }
                self.rows.push(lanes);
            }
            let products = self.present.iter().zip(&counts);
            self.products
                .push(products.map(|(other, c)| c * u64::from(to(other))).sum());
        }
        self.weight = counts.iter().sum();
        let products = self.products.iter().zip(&counts);
        self.pairs = products.map(|(&g, &c)| i128::from(g) * i128::from(c)).sum();
        self.next.resize(self.next.len().max(members.len()), NONE);
        self.pairs > 0
    }

    fn best_cut(&mut self, members: &[Member], codes: &[u8], min_leaf: u32) -> Option<Cut> {
        for (i, &code) in codes.iter().enumerate() {
            let first = &mut self.first[usize::from(code)];
            self.next[i] = *first;
            *first = i as u32;
        }
        let stride = self.present.len().div_ceil(LANES);
        self.left.clear();
        self.left.resize(stride, [0.0; LANES]);
        let least = u64::from(min_leaf.max(1));
        let (mut weight, mut pairs, mut cross) = (0, 0i128, 0i128);
        let mut best: Option<Cut> = None;
        let mut follows = false;
        for bin in 0..BINS {
            let mut at = std::mem::replace(&mut self.first[bin], NONE);
            if at == NONE {
                continue;
            }
            if follows && let Some(cut) = &mut best {
                cut.right = bin as u8;
            }
            follows = false;
            while at != NONE {
                let i = at as usize;
                let place = self.places[i] as usize;
                let w = u64::from(members[i].weight);
                weight += w;
                let g = self.left[place / LANES][place % LANES] as u64;
                pairs += i128::from(2 * w * g);
                cross += i128::from(w * self.products[place]);
                let row = &self.rows[place * stride..(place + 1) * stride];
                for (sums, lanes) in self.left.iter_mut().zip(row) {
                    (0..LANES).for_each(|lane| sums[lane] += w as f64 * lanes[lane]);
                }
                at = self.next[i];
            }
            if weight < least || self.weight - weight < least {
                continue;
            }
            let right = self.pairs - 2 * cross + pairs;
            let score = mean_of_pairs([weight, self.weight - weight], [pairs, right]);
            if best.is_none_or(|best| score > best.score) {
                follows = true;
                best = Some(Cut {
                    left: bin as u8,
                    right: bin as u8,
                    score,
                });
            }
        }
        let worth = self.squared.worth(self.weight);
        best.map(|cut| Cut {
            score: worth * cut.score,
            ..cut
        })
    }
}
