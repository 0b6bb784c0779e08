//! Sums of integer rows over the bins of a feature: the inner loop of growing.
//!
//! Every target has a row of `L` integers, lane 0 being 1 and the others within +-[`LANE_MAX`]. The
//! sums are exact, so that their order, the number of threads and the width of vectors do not
//! matter and equal splits have equal scores.

use super::super::bins::BINS;
use super::super::grow::Member;
use super::Cut;
use super::cells::bits;
use super::vectorized::vectorized;
use std::ops::AddAssign;

/// The largest magnitude of a row's integer.
pub const LANE_MAX: i32 = 32_767;
/// As much weight as `i32` sums can take without overflow.
const NARROW: i32 = 65_536;

/// The rows of all targets, for each weight a sample can have.
#[derive(Debug, Clone)]
pub struct Rows<const L: usize> {
    targets: usize,
    weighted: Vec<[i32; L]>,
}

impl<const L: usize> Rows<L> {
    pub fn new(rows: &[[i32; L]], max_weight: u16) -> Self {
        let weighted = (1..=i32::from(max_weight))
            .flat_map(|weight| rows.iter().map(move |row| row.map(|lane| weight * lane)))
            .collect();
        Self {
            targets: rows.len(),
            weighted,
        }
    }

    /// Gives a target another row.
    pub fn set(&mut self, target: usize, row: [i32; L]) {
        let weighted = self.weighted[target..].iter_mut().step_by(self.targets);
        for (weight, of_weight) in (1..).zip(weighted) {
            (0..L).for_each(|lane| of_weight[lane] = weight * row[lane]);
        }
    }

    #[inline(always)]
    fn place(&self, member: Member) -> usize {
        (usize::from(member.weight) - 1) * self.targets + usize::from(member.target)
    }
}

/// Memory for the sums of one feature at one node. Between calls its sums are zero.
pub struct Histogram<const L: usize> {
    /// The row of each member of the node.
    places: Vec<u32>,
    sums: Box<[[i32; L]; BINS]>,
    /// Where sums go that `i32` cannot hold: integers below 2^53 are exact in `f64`.
    wide: Box<[[f64; L]; BINS]>,
    /// 1 for each bin that any sample fell into.
    occupied: [u8; BINS],
}

impl<const L: usize> Default for Histogram<L> {
    fn default() -> Self {
        Self {
            places: Vec::new(),
            sums: Box::new([[0; L]; BINS]),
            wide: Box::new([[0.0; L]; BINS]),
            occupied: [0; BINS],
        }
    }
}

impl<const L: usize> Histogram<L> {
    /// A new node. Returns the sum over it.
    pub fn enter(&mut self, rows: &Rows<L>, members: &[Member]) -> [f64; L] {
        self.places.clear();
        let mut total = [0i64; L];
        for &member in members {
            let place = rows.place(member);
            let row = &rows.weighted[place];
            (0..L).for_each(|lane| total[lane] += i64::from(row[lane]));
            self.places.push(place as u32);
        }
        total.map(|lane| lane as f64)
    }

    /// The best cut of a feature by `score(left, total)`, as [`super::NodeScan::best_cut`] wants it.
    /// `rows` and `total` are those of [`Self::enter`]; `score` must be `#[inline(always)]`.
    pub fn best_cut(
        &mut self,
        rows: &Rows<L>,
        total: &[f64; L],
        codes: &[u8],
        min_leaf: u32,
        score: impl Fn(&[f64; L], &[f64; L]) -> f64 + Copy,
    ) -> Option<Cut> {
        vectorized(
            #[inline(always)]
            || self.sum_and_sweep(rows, total, codes, min_leaf, score),
        )
    }

    #[inline(always)]
    fn sum_and_sweep(
        &mut self,
        rows: &Rows<L>,
        total: &[f64; L],
        codes: &[u8],
        min_leaf: u32,
        score: impl Fn(&[f64; L], &[f64; L]) -> f64,
    ) -> Option<Cut> {
        let Self {
            places,
            sums,
            wide,
            occupied,
        } = self;
        let (sums, rows) = (&mut **sums, &rows.weighted[..]);
        if total[0] <= NARROW as f64 {
            add(sums, occupied, rows, places, codes);
            return sweep(sums, occupied, total, min_leaf, score);
        }
        let wide = &mut **wide;
        let mut from = 0;
        while from < places.len() {
            let mut weight = 0;
            let chunk = places[from..].iter().take_while(|&&place| {
                weight += rows[place as usize][0];
                weight <= NARROW
            });
            let to = from + chunk.count();
            add(sums, occupied, rows, &places[from..to], &codes[from..to]);
            for (wide, sums) in wide.iter_mut().zip(&mut *sums) {
                (0..L).for_each(|lane| wide[lane] += f64::from(sums[lane]));
                *sums = [0; L];
            }
            from = to;
        }
        sweep(wide, occupied, total, min_leaf, score)
    }
}

#[inline(always)]
fn add<const L: usize>(
    sums: &mut [[i32; L]; BINS],
    occupied: &mut [u8; BINS],
    rows: &[[i32; L]],
    places: &[u32],
    codes: &[u8],
) {
    for (&place, &code) in places.iter().zip(codes) {
        let row = &rows[place as usize];
        let sums = &mut sums[usize::from(code)];
        (0..L).for_each(|lane| sums[lane] += row[lane]);
        occupied[usize::from(code)] = 1;
    }
}

/// Moves one occupied bin after the other from the right to the left and keeps the best place to
/// stop. Leaves the memory zero.
#[inline(always)]
fn sweep<T: Copy + Default + AddAssign + Into<f64>, const L: usize>(
    sums: &mut [[T; L]; BINS],
    occupied: &mut [u8; BINS],
    total: &[f64; L],
    min_leaf: u32,
    score: impl Fn(&[f64; L], &[f64; L]) -> f64,
) -> Option<Cut> {
    let min_leaf = f64::from(min_leaf.max(1));
    let most_left = total[0] - min_leaf;
    let mut left = [T::default(); L];
    let mut best: Option<Cut> = None;
    // The best cut so far still lacks the bin that follows it.
    let mut follows = false;
    for (word, mut bits) in bits(occupied).into_iter().enumerate() {
        while bits != 0 {
            let bin = 64 * word + bits.trailing_zeros() as usize;
            bits &= bits - 1;
            if follows && let Some(cut) = &mut best {
                cut.right = bin as u8;
            }
            follows = false;
            let sums = &mut sums[bin];
            (0..L).for_each(|lane| left[lane] += sums[lane]);
            *sums = [T::default(); L];
            let left = left.map(Into::into);
            if left[0] < min_leaf || left[0] > most_left {
                continue;
            }
            let score = score(&left, total);
            if best.is_none_or(|cut| score > cut.score) {
                follows = true;
                best = Some(Cut {
                    left: bin as u8,
                    right: bin as u8,
                    score,
                });
            }
        }
    }
    *occupied = [0; BINS];
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{below, stream};

    /// Beyond 65,536 samples the narrow sums overflow; all rows at the limit make that certain.
    #[test]
    fn sums_are_exact_at_any_size() {
        let rows = [[1, LANE_MAX, -LANE_MAX, 7], [1, -LANE_MAX, LANE_MAX, -3]];
        let rows = Rows::new(&rows, 3);
        let mut s = stream(1, "sums", &[]);
        let mut members = Vec::new();
        let mut codes = Vec::new();
        let mut expected = [0i64; 4];
        for sample in 0..400_000 {
            let (target, weight) = (u16::from(sample > 250_000), 1 + below(&mut s, 3) as u16);
            let code = below(&mut s, 3) as u8 * 100;
            members.push(Member {
                sample,
                target,
                weight,
            });
            codes.push(code);
            if code < 200 {
                let sign = 1 - 2 * i64::from(target);
                let row = [
                    1,
                    sign * 32_767,
                    sign * -32_767,
                    if target == 0 { 7 } else { -3 },
                ];
                (0..4).for_each(|lane| expected[lane] += i64::from(weight) * row[lane]);
            }
        }
        let mut histogram = Histogram::default();
        let total = histogram.enter(&rows, &members);
        // A score that prefers the second cut and shows what it is of.
        let seen = std::cell::Cell::new([0.0; 4]);
        let score = |left: &[f64; 4], _: &[f64; 4]| {
            seen.set(*left);
            left[0]
        };
        let cut = histogram.best_cut(&rows, &total, &codes, 1, score);
        assert_eq!(seen.get(), expected.map(|lane| lane as f64));
        assert_eq!(cut.map(|cut| (cut.left, cut.right)), Some((100, 200)));
        assert_eq!(histogram.occupied, [0; BINS]);
        assert_eq!(*histogram.wide, [[0.0; 4]; BINS]);
        assert_eq!(*histogram.sums, [[0; 4]; BINS]);
    }
}
