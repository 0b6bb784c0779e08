//! Mean squared pairwise DISP (eq. 6), exactly and about as fast as the mean squared error.
//!
//! With c_a samples of target a and G = D^2 c, the sum over all pairs of a node is c . G. Samples
//! move from right to left in the order of their bins, those of one target and bin together. Of the
//! left side's counts c_l the products g = D^2 c_l are kept, one number for each target that is
//! present in the node: what w samples of target a add to c_l . g is 2 w g_a, and to g it is w times
//! row a of D^2. The sum over the pairs of the right side is c . G - 2 c_l . G + c_l . g.

use super::super::bins::BINS;
use super::cells::{Cells, Present};
use super::pairs::{SquaredDistances, mean_of_pairs, mspd_impurity};
use super::{Cut, NodeScan, Objective};
use crate::distances::DistanceMatrix;
use crate::forest::ForestError;
use crate::forest::grow::Member;
use pulp::{Arch, Simd, WithSimd};
use std::ops::{Add, Sub};

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
            present: Present::new(self.squared.targets()),
            cells: Cells::default(),
            rows: Vec::new(),
            products: Vec::new(),
            left: Vec::new(),
            weight: 0.0,
            pairs: 0,
            cuts: Box::new(Cuts {
                weights: [0.0; BINS],
                pairs: [[0.0; BINS]; 2],
                scores: [0.0; BINS],
            }),
        })
    }

    fn impurity(&self, members: &[Member]) -> f64 {
        mspd_impurity(self.distances, members)
    }
}

/// Rows of D^2 are filled up with zeros to a multiple of the widest vector.
const LANES: usize = 8;

/// D^2 has 32 bits and `f64` is exact for whole numbers up to 2^53: for sums of D^2 over two million
/// samples, and for sums over all pairs of a node of up to this weight.
const NARROW: f64 = 1440.0;

struct Scan<'a> {
    squared: &'a SquaredDistances,
    present: Present,
    cells: Cells,
    /// D^2 between the targets present, row by row.
    rows: Vec<f64>,
    /// G.
    products: Vec<f64>,
    /// g.
    left: Vec<f64>,
    /// Of the node, and over all its pairs.
    weight: f64,
    pairs: i128,
    cuts: Box<Cuts>,
}

/// After each occupied bin.
struct Cuts {
    /// Of the left side.
    weights: [f64; BINS],
    /// Over the pairs of the left and of the right side.
    pairs: [[f64; BINS]; 2],
    scores: [f64; BINS],
}

/// A number that holds sums over pairs.
trait Whole: Copy + Default + Add<Output = Self> + Sub<Output = Self> {
    /// Whether [`Self::to_f64`] costs time.
    const SLOW: bool;
    fn product(a: f64, b: f64) -> Self;
    fn to_f64(self) -> f64;
}

impl Whole for f64 {
    const SLOW: bool = false;

    #[inline(always)]
    fn product(a: f64, b: f64) -> Self {
        a * b
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
}

impl Whole for i128 {
    const SLOW: bool = true;

    #[inline(always)]
    fn product(a: f64, b: f64) -> Self {
        i128::from(a as i64) * i128::from(b as i64)
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        self as f64
    }
}

impl NodeScan for Scan<'_> {
    fn enter(&mut self, members: &[Member]) -> bool {
        self.present.enter(members);
        let (targets, counts) = (self.present.targets(), self.present.weights());
        self.rows.clear();
        self.products.clear();
        (self.weight, self.pairs) = (0.0, 0);
        for (&target, &count) in targets.iter().zip(counts) {
            let row = self.squared.row(target);
            let distances = targets.iter().map(|&other| row[usize::from(other)]);
            self.rows.extend(distances.clone().map(f64::from));
            let full = self.rows.len().next_multiple_of(LANES);
            self.rows.resize(full, 0.0);
            let products = distances
                .zip(counts)
                .map(|(d, &c)| f64::from(d) * f64::from(c));
            let product = products.sum();
            self.products.push(product);
            self.weight += f64::from(count);
            self.pairs += i128::product(f64::from(count), product);
        }
        self.left.resize(targets.len().next_multiple_of(LANES), 0.0);
        self.cells.enter(&self.present, members);
        self.pairs > 0
    }

    fn best_cut(&mut self, _: &[Member], codes: &[u8], min_leaf: u32) -> Option<Cut> {
        let cut = Arch::new().dispatch(BestCut {
            scan: self,
            codes,
            min_leaf,
        })?;
        Some(Cut {
            score: self.squared.worth(self.weight) * cut.score,
            ..cut
        })
    }
}

struct BestCut<'s, 'a> {
    scan: &'s mut Scan<'a>,
    codes: &'s [u8],
    min_leaf: u32,
}

impl WithSimd for BestCut<'_, '_> {
    type Output = Option<Cut>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Option<Cut> {
        self.scan.cells.sort(self.codes);
        if self.scan.weight <= NARROW {
            self.scan.sweep(simd, self.scan.pairs as f64, self.min_leaf)
        } else {
            self.scan.sweep(simd, self.scan.pairs, self.min_leaf)
        }
    }
}

impl Scan<'_> {
    #[inline(always)]
    fn sweep<S: Simd, T: Whole>(&mut self, simd: S, all_pairs: T, min_leaf: u32) -> Option<Cut> {
        let rows = &self.rows[..];
        let left = &mut self.left[..];
        left.fill(0.0);
        let stride = left.len();
        let Cuts {
            weights,
            pairs: [of_left, of_right],
            scores,
        } = &mut *self.cuts;
        let mut bin = 0;
        // Of the left side: the weight, c_l . g and c_l . G.
        let (mut weight, mut pairs, mut cross) = (0.0, T::default(), T::default());
        for cells in self.cells.sorted() {
            let rows = cells.map(|cell| &rows[cell.place() * stride..][..stride]);
            let added = cells.map(|cell| f64::from(cell.weight()));
            for (i, cell) in cells.iter().enumerate() {
                let place = cell.place();
                // What was moved just before is not in g yet.
                let mut g = left[place];
                for before in 0..i {
                    g += added[before] * rows[before][place];
                }
                weight += added[i];
                pairs = pairs + T::product(2.0 * added[i], g);
                cross = cross + T::product(2.0 * added[i], self.products[place]);
                if !T::SLOW || cell.is_last() {
                    weights[bin] = weight;
                    of_left[bin] = pairs.to_f64();
                    of_right[bin] = (all_pairs - cross + pairs).to_f64();
                }
                bin = (bin + usize::from(cell.is_last())) % BINS;
            }
            let added = added.map(|weight| simd.splat_f64s(weight));
            let [a, b, c, d] = rows.map(|row| S::as_simd_f64s(row).0);
            let rows = a.iter().zip(b).zip(c.iter().zip(d));
            for (g, ((a, b), (c, d))) in S::as_mut_simd_f64s(left).0.iter_mut().zip(rows) {
                // Whole numbers: the sum is the same with and without a rounding in between.
                let ab = simd.mul_add_e_f64s(added[1], *b, simd.mul_add_e_f64s(added[0], *a, *g));
                *g = simd.mul_add_e_f64s(added[3], *d, simd.mul_add_e_f64s(added[2], *c, ab));
            }
        }
        let bins = self.cells.occupied();
        let least = f64::from(min_leaf.max(1));
        let sums = weights.iter_mut().zip(of_left).zip(of_right);
        for (score, ((&mut left, of_left), of_right)) in
            scores.iter_mut().zip(sums).take(bins.len())
        {
            let right = self.weight - left;
            let allowed = (left >= least) & (right >= least);
            let of_both = mean_of_pairs([left, right], [*of_left, *of_right]);
            *score = if allowed { of_both } else { f64::NEG_INFINITY };
        }
        let mut best = 0;
        for bin in 1..bins.len() {
            if scores[bin] > scores[best] {
                best = bin;
            }
        }
        (scores[best] > f64::NEG_INFINITY).then(|| Cut {
            left: bins[best],
            right: bins[best + 1],
            score: scores[best],
        })
    }
}
