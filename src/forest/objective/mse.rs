//! Mean squared error: the variance of the targets, averaged over their values (eq. 5).

use super::histogram::{Histogram, LANE_MAX, Rows};
use super::{Cut, Made, NodeScan, Objective};
use crate::forest::ForestError;
use crate::forest::grow::{Member, TargetTable};
use std::borrow::Cow;

/// Eq. 5 on the rows of `table`. Splits are chosen on values rounded to 16 bits of the widest
/// value's range; [`Objective::impurity`] takes them as they are.
pub fn mse(table: &TargetTable) -> Made<'_> {
    mse_of(Cow::Borrowed(table))
}

/// The same, whoever keeps the table.
pub(super) fn mse_of(table: Cow<TargetTable>) -> Made {
    // The compiler knows the size of a row, and lane 0 counts.
    match table.width() {
        0..4 => Ok(Box::new(Mse::<4>::new(table))),
        4..8 => Ok(Box::new(Mse::<8>::new(table))),
        8..16 => Ok(Box::new(Mse::<16>::new(table))),
        16..32 => Ok(Box::new(Mse::<32>::new(table))),
        got => Err(ForestError::TooMany {
            what: "values of a target",
            got,
            most: 31,
        }),
    }
}

struct Mse<'a, const L: usize> {
    table: Cow<'a, TargetTable>,
    rows: Vec<[i32; L]>,
}

impl<'a, const L: usize> Mse<'a, L> {
    fn new(table: Cow<'a, TargetTable>) -> Self {
        let rows = (0..table.targets()).map(|target| table.row(target));
        let column = |i: usize| rows.clone().map(move |row| row[i]);
        let range = |i: usize| {
            column(i).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| {
                (low.min(y), high.max(y))
            })
        };
        let ranges: Vec<(f64, f64)> = (0..table.width()).map(range).collect();
        // One scale for all values, since eq. 5 weighs them alike.
        let half = ranges.iter().map(|(low, high)| (high - low) / 2.0);
        let half = half.fold(0.0, f64::max);
        let scale = if half > 0.0 {
            f64::from(LANE_MAX) / half
        } else {
            0.0
        };
        let fixed = |target: usize| {
            let mut row = [0; L];
            row[0] = 1;
            for ((lane, y), (low, high)) in row[1..].iter_mut().zip(table.row(target)).zip(&ranges)
            {
                *lane = ((y - (low + high) / 2.0) * scale).round() as i32;
            }
            row
        };
        let rows = (0..table.targets()).map(fixed).collect();
        Self { table, rows }
    }
}

impl<const L: usize> Objective for Mse<'_, L> {
    fn targets(&self) -> usize {
        self.rows.len()
    }

    fn scan(&self, max_weight: u16) -> Box<dyn NodeScan + '_> {
        Box::new(Scan {
            rows: &self.rows,
            weighted: Rows::new(&self.rows, max_weight),
            total: [0.0; L],
            histogram: Histogram::default(),
        })
    }

    fn impurity(&self, members: &[Member]) -> f64 {
        let width = self.table.width();
        let mut mean = vec![0.0; width];
        self.table.mean(members, &mut mean);
        let (mut weight, mut squares) = (0.0, 0.0);
        for member in members {
            let row = self.table.row(usize::from(member.target));
            let distance: f64 = row.iter().zip(&mean).map(|(y, m)| (y - m).powi(2)).sum();
            squares += f64::from(member.weight) * distance;
            weight += f64::from(member.weight);
        }
        squares / (weight * width as f64)
    }
}

struct Scan<'a, const L: usize> {
    rows: &'a [[i32; L]],
    weighted: Rows<L>,
    total: [f64; L],
    histogram: Histogram<L>,
}

impl<const L: usize> NodeScan for Scan<'_, L> {
    fn enter(&mut self, members: &[Member]) -> bool {
        self.total = self.histogram.enter(&self.weighted, members);
        let row = |member: &Member| &self.rows[usize::from(member.target)];
        members.iter().any(|member| row(member) != row(&members[0]))
    }

    fn best_cut(&mut self, _: &[Member], codes: &[u8], min_leaf: u32) -> Option<Cut> {
        let Self {
            weighted, total, ..
        } = self;
        self.histogram
            .best_cut(weighted, total, codes, min_leaf, variance_removed)
    }
}

/// |S_l| |S_r| |mean_l - mean_r|^2, what eq. 1 gains with eq. 5 but for a factor of the node. As
/// |n sum_l - n_l sum|^2 / (n_l n_r), up to a factor n^2, it is exact before the division in nodes
/// of up to half a million samples, and the same for a split and its mirror image.
#[inline(always)]
fn variance_removed<const L: usize>(left: &[f64; L], total: &[f64; L]) -> f64 {
    let (n, n_left) = (total[0], left[0]);
    let (left, _) = left.as_chunks::<4>();
    let (total, _) = total.as_chunks::<4>();
    let mut squares = [0.0; 4];
    for (left, total) in left.iter().zip(total) {
        for lane in 0..4 {
            let d = n * left[lane] - n_left * total[lane];
            squares[lane] += d * d;
        }
    }
    ((squares[0] + squares[2]) + (squares[1] + squares[3])) / (n_left * (n - n_left))
}
