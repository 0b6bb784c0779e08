//! MSPD in a few dimensions: what splits of [`mspd`](super::mspd::mspd) cost when they may be
//! approximate.
//!
//! Every symmetric D has points x_a and signs s_k with D_ab^2 = sum_k s_k (x_ak - x_bk)^2
//! ([`signed_scaling`]). With <x, y> = sum_k s_k x_k y_k the sum over all pairs of n samples is
//! 2 n sum_i <x_i, x_i> - 2 <sum_i x_i, sum_i x_i>. So sums over samples of the coordinates and of
//! one square are enough, as they are for the mean squared error; here they are taken over the
//! dimensions of the largest eigenvalues only, as many as fit the rows of a pose's 15 angles.

use super::histogram::{Histogram, LANE_MAX, Rows};
use super::pairs::mspd_impurity;
use super::{Cut, Made, NodeScan, Objective};
use crate::distances::DistanceMatrix;
use crate::forest::grow::Member;
use crate::pose_space::classical_scaling::signed_scaling;

/// A count, a square, and coordinates.
const LANES: usize = 16;
const DIMENSIONS: usize = LANES - 2;

/// Eq. 6 in 14 signed dimensions, coordinates rounded to 16 bits; [`Objective::impurity`] is exact.
/// Target t of a sample is row t of `distances`.
pub fn mspd_few(distances: &DistanceMatrix) -> Made<'_> {
    let scaling = signed_scaling(distances, DIMENSIONS)?;
    let dimensions = scaling.signs.len();
    let points = (0..distances.count()).map(|a| &scaling.points[a * dimensions..][..dimensions]);
    let squares: Vec<f64> = points
        .clone()
        .map(|x| x.iter().zip(&scaling.signs).map(|(x, s)| s * x * x).sum())
        .collect();
    let unit_of = |values: &[f64]| {
        let largest = values
            .iter()
            .fold(0.0, |most, value| f64::max(most, value.abs()));
        if largest > 0.0 {
            largest / f64::from(LANE_MAX)
        } else {
            1.0
        }
    };
    let (of_square, of_coordinate) = (unit_of(&squares), unit_of(&scaling.points));
    let row = |(x, square): (&[f64], &f64)| {
        let mut row = [0; LANES];
        row[0] = 1;
        row[1] = (square / of_square).round() as i32;
        for (lane, x) in row[2..].iter_mut().zip(x) {
            *lane = (x / of_coordinate).round() as i32;
        }
        row
    };
    let mut worths = [0.0; LANES];
    for (worth, sign) in worths[2..].iter_mut().zip(&scaling.signs) {
        *worth = sign * of_coordinate.powi(2) / of_square;
    }
    Ok(Box::new(Few {
        distances,
        rows: points.zip(&squares).map(row).collect(),
        worths,
    }))
}

struct Few<'a> {
    distances: &'a DistanceMatrix,
    rows: Vec<[i32; LANES]>,
    /// What the square of each coordinate's sum is worth, in units of the square; signed.
    worths: [f64; LANES],
}

impl Objective for Few<'_> {
    fn targets(&self) -> usize {
        self.rows.len()
    }

    fn scan(&self, max_weight: u16) -> Box<dyn NodeScan + '_> {
        Box::new(Scan {
            objective: self,
            weighted: Rows::new(&self.rows, max_weight),
            total: [0.0; LANES],
            histogram: Histogram::default(),
        })
    }

    fn impurity(&self, members: &[Member]) -> f64 {
        mspd_impurity(self.distances, members)
    }
}

struct Scan<'a> {
    objective: &'a Few<'a>,
    weighted: Rows<LANES>,
    total: [f64; LANES],
    histogram: Histogram<LANES>,
}

impl NodeScan for Scan<'_> {
    fn enter(&mut self, members: &[Member]) -> bool {
        self.total = self.histogram.enter(&self.weighted, members);
        let row = |member: &Member| &self.objective.rows[usize::from(member.target)];
        members.iter().any(|member| row(member) != row(&members[0]))
    }

    fn best_cut(&mut self, _: &[Member], codes: &[u8], min_leaf: u32) -> Option<Cut> {
        let Self {
            weighted, total, ..
        } = self;
        let worths = &self.objective.worths;
        let score = |left: &[f64; LANES], total: &[f64; LANES]| mean_of_pairs(left, total, worths);
        self.histogram
            .best_cut(weighted, total, codes, min_leaf, score)
    }
}

/// -(n_l H(S_l) + n_r H(S_r)), up to a factor.
#[inline(always)]
fn mean_of_pairs(left: &[f64; LANES], total: &[f64; LANES], worths: &[f64; LANES]) -> f64 {
    let mut squares = [[0.0; 4]; 2];
    let (left_lanes, _) = left.as_chunks::<4>();
    let (total_lanes, _) = total.as_chunks::<4>();
    let (worths, _) = worths.as_chunks::<4>();
    for ((left, total), worths) in left_lanes.iter().zip(total_lanes).zip(worths) {
        for lane in 0..4 {
            let right = total[lane] - left[lane];
            squares[0][lane] += worths[lane] * left[lane] * left[lane];
            squares[1][lane] += worths[lane] * right * right;
        }
    }
    let side = |n: f64, square: f64, of_sum: [f64; 4]| {
        let of_sum = (of_sum[0] + of_sum[2]) + (of_sum[1] + of_sum[3]);
        (n * square - of_sum) / if n > 1.0 { n - 1.0 } else { 1.0 }
    };
    let of_right = side(total[0] - left[0], total[1] - left[1], squares[1]);
    -(side(left[0], left[1], squares[0]) + of_right)
}
