//! Feature values as 8-bit bins: what the grower counts in.

use super::ForestError;
use crate::feature::SampleMatrix;
use rayon::prelude::*;

/// Bins of one feature are the values of a `u8`.
pub const BINS: usize = 256;

/// Samples that are turned from columns into rows together: a cache line of each column.
const TILE: usize = 64;

/// The training samples' features as bin numbers: column by column, as large nodes read them, and
/// once more row by row, from which the few samples of a small node are fetched with all features.
#[derive(Debug, Clone)]
pub struct BinnedMatrix {
    samples: usize,
    codes: Vec<u8>,
    rows: Vec<u8>,
    edges: Vec<Edges>,
}

/// The lowest and the highest training value in each bin of one feature, ascending.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Edges {
    lowest: Vec<i16>,
    highest: Vec<i16>,
}

impl BinnedMatrix {
    /// Bins every column by the quantiles of its values: as many samples a bin as ties allow, and
    /// one bin a value where there are at most [`BINS`] distinct ones.
    pub fn new(matrix: &SampleMatrix) -> Result<Self, ForestError> {
        let samples = matrix.samples();
        let columns: Vec<&[i16]> = matrix.columns().collect();
        if samples == 0 || columns.is_empty() {
            return Err(ForestError::Empty);
        }
        // A tree's node names its feature in 16 bits, of which the last value marks a leaf.
        for (what, got, most) in [
            ("features", columns.len(), usize::from(u16::MAX)),
            ("samples", samples, u32::MAX as usize),
        ] {
            if got > most {
                return Err(ForestError::TooMany { what, got, most });
            }
        }
        let mut codes = vec![0; samples * columns.len()];
        let edges = codes
            .par_chunks_exact_mut(samples)
            .zip(&columns)
            .map(|(codes, column)| bin_column(column, codes))
            .collect();
        let mut rows = vec![0; codes.len()];
        rows.par_chunks_mut(TILE * columns.len())
            .enumerate()
            .for_each(|(tile, rows)| {
                for (feature, column) in codes.chunks_exact(samples).enumerate() {
                    let of_tile = rows.iter_mut().skip(feature).step_by(columns.len());
                    for (to, &code) in of_tile.zip(&column[tile * TILE..]) {
                        *to = code;
                    }
                }
            });
        Ok(Self {
            samples,
            codes,
            rows,
            edges,
        })
    }

    pub fn samples(&self) -> usize {
        self.samples
    }

    pub fn features(&self) -> usize {
        self.edges.len()
    }

    /// The bin of each sample.
    #[inline]
    pub fn column(&self, feature: usize) -> &[u8] {
        &self.codes[feature * self.samples..(feature + 1) * self.samples]
    }

    /// The bin of each feature at one sample.
    pub fn row(&self, sample: usize) -> &[u8] {
        &self.rows[sample * self.features()..(sample + 1) * self.features()]
    }

    /// The lowest training value in a bin.
    pub fn lowest(&self, feature: usize, bin: u8) -> i16 {
        self.edges[feature].lowest[usize::from(bin)]
    }

    /// The threshold (`value <= threshold` goes left) that sends bins up to `left` one way and bins
    /// from `right` on the other: midway between the nearest training values of the two, rounded
    /// down, as scikit-learn does.
    pub fn threshold(&self, feature: usize, left: u8, right: u8) -> i16 {
        let edges = &self.edges[feature];
        let below = i32::from(edges.highest[usize::from(left)]);
        let above = i32::from(edges.lowest[usize::from(right)]);
        ((below + above) >> 1) as i16
    }
}

/// Counts the values, cuts their range into bins, writes each value's bin.
fn bin_column(column: &[i16], codes: &mut [u8]) -> Edges {
    let low = column.iter().copied().min().unwrap_or(0);
    let place = |value: i16| (i32::from(value) - i32::from(low)) as usize;
    let high = column.iter().copied().max().unwrap_or(0);
    let mut counts = vec![0u32; place(high) + 1];
    for &value in column {
        counts[place(value)] += 1;
    }
    // A value that holds more than a bin's share of the samples takes a bin for itself, which
    // leaves less to the others.
    let (mut share, mut common) = (f64::INFINITY, (0, 0));
    loop {
        let even = (column.len() - common.1) as f64 / (BINS - common.0) as f64;
        if even >= share {
            break;
        }
        share = even;
        let above = counts.iter().filter(|&&count| f64::from(count) > share);
        common = above.fold((0, 0), |(n, sum), &count| (n + 1, sum + count as usize));
    }
    let distinct = counts.iter().filter(|&&count| count > 0).count();

    let mut edges = Edges {
        lowest: Vec::new(),
        highest: Vec::new(),
    };
    let mut code_of = vec![0u8; counts.len()];
    // What the open bin holds, and what there is for the bins that may still be opened; common
    // values apart.
    let mut held = 0.0;
    let mut bins = BINS - common.0;
    let mut left = (column.len() - common.1) as f64;
    let mut target = share;
    let mut after_common = true;
    for (place, &count) in counts.iter().enumerate().filter(|&(_, &count)| count > 0) {
        let value = (i32::from(low) + place as i32) as i16;
        let count = f64::from(count);
        let is_common = count > share;
        let full = distinct <= BINS || is_common || after_common || held + count / 2.0 > target;
        if edges.lowest.is_empty() || (full && edges.lowest.len() < BINS) {
            edges.lowest.push(value);
            edges.highest.push(value);
            held = 0.0;
            if !is_common {
                target = left / bins.max(1) as f64;
                bins = bins.saturating_sub(1);
            }
        }
        after_common = is_common;
        if !is_common {
            held += count;
            left -= count;
        }
        code_of[place] = (edges.lowest.len() - 1) as u8;
        if let Some(highest) = edges.highest.last_mut() {
            *highest = value;
        }
    }
    for (code, &value) in codes.iter_mut().zip(column) {
        *code = code_of[place(value)];
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{below, normal, stream};

    fn binned(column: &[i16]) -> (Edges, Vec<u8>) {
        let mut codes = vec![0; column.len()];
        (bin_column(column, &mut codes), codes)
    }

    #[test]
    fn few_values_have_a_bin_each() {
        let mut s = stream(1, "bins", &[]);
        let column: Vec<i16> = (0..2000).map(|_| below(&mut s, 256) as i16 * 256).collect();
        let (edges, codes) = binned(&column);
        assert_eq!(edges.lowest, edges.highest);
        for (&code, &value) in codes.iter().zip(&column) {
            assert_eq!(edges.lowest[usize::from(code)], value);
        }
    }

    #[test]
    fn bins_are_ordered_disjoint_even_and_all_used() {
        let mut s = stream(2, "bins", &[]);
        // Half of the samples share the value 0, as features on background do.
        let column: Vec<i16> = (0..200_000)
            .map(|i| {
                if i % 2 == 0 {
                    0
                } else {
                    (1500.0 * normal(&mut s)) as i16
                }
            })
            .collect();
        let (edges, codes) = binned(&column);
        assert_eq!(edges.lowest.len(), BINS);
        let mut counts = [0u32; BINS];
        for (&code, &value) in codes.iter().zip(&column) {
            let bin = usize::from(code);
            assert!(edges.lowest[bin] <= value && value <= edges.highest[bin]);
            counts[bin] += 1;
        }
        assert!((1..BINS).all(|bin| edges.highest[bin - 1] < edges.lowest[bin]));
        // 100,000 samples share 255 bins: 392 each, but for ties and what is left over beside 0 and last.
        counts.sort_unstable();
        assert!(counts[2] > 300 && counts[BINS - 2] < 500, "{counts:?}");
    }

    #[test]
    fn the_extremes_of_i16_are_values_like_others() {
        let (edges, codes) = binned(&[i16::MIN, i16::MAX, 0]);
        assert_eq!(codes, [0, 2, 1]);
        assert_eq!(edges.lowest, [i16::MIN, 0, i16::MAX]);
    }
}
