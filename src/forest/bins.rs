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
    /// For so many samples there is room.
    counted: usize,
    codes: Vec<u8>,
    rows: Vec<u8>,
    bins: Vec<Bins>,
}

/// The bins of one feature: the lowest and the highest training value in each, ascending, and the
/// bin of every value from `low` to the highest.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Bins {
    lowest: Vec<i16>,
    highest: Vec<i16>,
    low: i16,
    code_of: Vec<u8>,
}

/// Counts the values of samples, to bin them by quantiles: as many samples a bin as ties allow, and
/// one bin a value where there are at most [`BINS`] distinct ones.
///
/// Samples too many to be held in memory as they are come in parts, twice: [`BinCounter::add`] each
/// part, [`BinCounter::finish`], then [`BinnedMatrix::push`] each part.
#[derive(Debug, Clone, Default)]
pub struct BinCounter {
    samples: usize,
    columns: Vec<Counts>,
}

/// How often each value occurs in a column, from the lowest to the highest.
#[derive(Debug, Clone, Default)]
struct Counts {
    low: i16,
    of: Vec<u32>,
}

impl BinCounter {
    /// Panics when the part has another number of columns than the first.
    pub fn add(&mut self, part: &SampleMatrix) -> Result<(), ForestError> {
        if self.samples == 0 {
            self.columns.resize(part.columns().len(), Counts::default());
        }
        self.samples += part.samples();
        // A tree's node names its feature in 16 bits, of which the last value marks a leaf.
        for (what, got, most) in [
            ("features", self.columns.len(), usize::from(u16::MAX)),
            ("samples", self.samples, u32::MAX as usize),
        ] {
            if got > most {
                return Err(ForestError::TooMany { what, got, most });
            }
        }
        let columns: Vec<&[i16]> = part.columns().collect();
        assert_eq!(columns.len(), self.columns.len(), "columns of a part");
        self.columns
            .par_iter_mut()
            .zip(columns)
            .for_each(|(counts, column)| counts.add(column));
        Ok(())
    }

    /// A matrix with room for all that was counted.
    pub fn finish(self) -> Result<BinnedMatrix, ForestError> {
        let size = self.samples * self.columns.len();
        if size == 0 {
            return Err(ForestError::Empty);
        }
        let samples = self.samples;
        Ok(BinnedMatrix {
            samples: 0,
            counted: samples,
            codes: vec![0; size],
            rows: vec![0; size],
            bins: self.columns.par_iter().map(|c| c.cut(samples)).collect(),
        })
    }
}

impl BinnedMatrix {
    /// The samples of one matrix.
    pub fn new(matrix: &SampleMatrix) -> Result<Self, ForestError> {
        let mut counter = BinCounter::default();
        counter.add(matrix)?;
        let mut binned = counter.finish()?;
        binned.push(matrix);
        Ok(binned)
    }

    /// Adds samples to those that are there. Panics when they are not what was counted: more, or
    /// with values beyond the lowest or the highest.
    pub fn push(&mut self, part: &SampleMatrix) {
        let (from, to) = (self.samples, self.samples + part.samples());
        assert!(to <= self.counted, "more samples than were counted");
        let columns: Vec<&[i16]> = part.columns().collect();
        assert_eq!(columns.len(), self.features(), "columns of a part");
        self.codes
            .par_chunks_exact_mut(self.counted)
            .zip(&self.bins)
            .zip(columns)
            .for_each(|((codes, bins), column)| bins.encode(column, &mut codes[from..to]));
        let features = self.bins.len();
        let (codes, counted) = (&self.codes, self.counted);
        self.rows[from * features..to * features]
            .par_chunks_mut(TILE * features)
            .enumerate()
            .for_each(|(tile, rows)| {
                for (feature, column) in codes.chunks_exact(counted).enumerate() {
                    let of_tile = rows.iter_mut().skip(feature).step_by(features);
                    for (to, &code) in of_tile.zip(&column[from + tile * TILE..]) {
                        *to = code;
                    }
                }
            });
        self.samples = to;
    }

    /// How many have been pushed.
    pub fn samples(&self) -> usize {
        self.samples
    }

    pub fn features(&self) -> usize {
        self.bins.len()
    }

    /// The bin of each sample.
    #[inline]
    pub fn column(&self, feature: usize) -> &[u8] {
        &self.codes[feature * self.counted..][..self.samples]
    }

    /// The bin of each feature at one sample.
    pub fn row(&self, sample: usize) -> &[u8] {
        &self.rows[sample * self.features()..(sample + 1) * self.features()]
    }

    /// The lowest training value in a bin.
    pub fn lowest(&self, feature: usize, bin: u8) -> i16 {
        self.bins[feature].lowest[usize::from(bin)]
    }

    /// The threshold (`value <= threshold` goes left) that sends bins up to `left` one way and bins
    /// from `right` on the other: midway between the nearest training values of the two, rounded
    /// down, as scikit-learn does.
    pub fn threshold(&self, feature: usize, left: u8, right: u8) -> i16 {
        let bins = &self.bins[feature];
        let below = i32::from(bins.highest[usize::from(left)]);
        let above = i32::from(bins.lowest[usize::from(right)]);
        ((below + above) >> 1) as i16
    }
}

/// Where a value stands in a table that begins with `low`.
#[inline]
fn place(value: i16, low: i16) -> usize {
    (i32::from(value) - i32::from(low)) as usize
}

impl Counts {
    fn add(&mut self, column: &[i16]) {
        let (Some(&low), Some(&high)) = (column.iter().min(), column.iter().max()) else {
            return;
        };
        if self.of.is_empty() {
            self.low = low;
        }
        if low < self.low {
            let below = place(self.low, low);
            self.of.splice(0..0, std::iter::repeat_n(0, below));
            self.low = low;
        }
        let length = (place(high.max(self.low), self.low) + 1).max(self.of.len());
        self.of.resize(length, 0);
        // Neighbours are often equal, and adding to a number that was just written has to wait. So every
        // second one is counted apart.
        let mut second = vec![0; self.of.len()];
        let (pairs, last) = column.as_chunks::<2>();
        for &[one, other] in pairs {
            self.of[place(one, self.low)] += 1;
            second[place(other, self.low)] += 1;
        }
        for &value in last {
            self.of[place(value, self.low)] += 1;
        }
        for (count, second) in self.of.iter_mut().zip(second) {
            *count += second;
        }
    }

    /// Cuts the range of the values of `samples` samples into bins.
    fn cut(&self, samples: usize) -> Bins {
        let counts = &self.of;
        // A value that holds more than a bin's share of the samples takes a bin for itself, which
        // leaves less to the others.
        let (mut share, mut common) = (f64::INFINITY, (0, 0));
        loop {
            let even = (samples - common.1) as f64 / (BINS - common.0) as f64;
            if even >= share {
                break;
            }
            share = even;
            let above = counts.iter().filter(|&&count| f64::from(count) > share);
            common = above.fold((0, 0), |(n, sum), &count| (n + 1, sum + count as usize));
        }
        let distinct = counts.iter().filter(|&&count| count > 0).count();

        let mut cut = Bins {
            lowest: Vec::new(),
            highest: Vec::new(),
            low: self.low,
            code_of: vec![0; counts.len()],
        };
        // What the open bin holds, and what there is for the bins that may still be opened; common
        // values apart.
        let mut held = 0.0;
        let mut bins = BINS - common.0;
        let mut left = (samples - common.1) as f64;
        let mut target = share;
        let mut after_common = true;
        for (place, &count) in counts.iter().enumerate().filter(|&(_, &count)| count > 0) {
            let value = (i32::from(self.low) + place as i32) as i16;
            let count = f64::from(count);
            let is_common = count > share;
            let full = distinct <= BINS || is_common || after_common || held + count / 2.0 > target;
            if cut.lowest.is_empty() || (full && cut.lowest.len() < BINS) {
                cut.lowest.push(value);
                cut.highest.push(value);
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
            cut.code_of[place] = (cut.lowest.len() - 1) as u8;
            if let Some(highest) = cut.highest.last_mut() {
                *highest = value;
            }
        }
        cut
    }
}

impl Bins {
    /// Writes each value's bin.
    fn encode(&self, column: &[i16], codes: &mut [u8]) {
        for (code, &value) in codes.iter_mut().zip(column) {
            *code = self.code_of[place(value, self.low)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{below, normal, stream};

    fn binned(column: &[i16]) -> (Bins, Vec<u8>) {
        let mut counts = Counts::default();
        counts.add(column);
        let bins = counts.cut(column.len());
        let mut codes = vec![0; column.len()];
        bins.encode(column, &mut codes);
        (bins, codes)
    }

    /// In parts of any size, with ranges of their own, samples become the same matrix as in one.
    #[test]
    fn parts_make_the_whole() {
        let mut s = stream(3, "bins", &[]);
        let columns: Vec<Vec<i16>> = (0..3)
            .map(|column| {
                let value = |i: usize| (i as f64 - 500.0 + 40.0 * normal(&mut s)) as i16 >> column;
                (0..1000).map(value).collect()
            })
            .collect();
        let matrix = |from: usize, to: usize| {
            let fill = |_, runs: &mut [&mut [i16]]| {
                for (run, column) in runs.iter_mut().zip(&columns) {
                    run.copy_from_slice(&column[from..to]);
                }
                Ok::<(), ()>(())
            };
            SampleMatrix::fill(3, &[to - from], fill).unwrap()
        };
        let whole = BinnedMatrix::new(&matrix(0, 1000)).unwrap();
        let parts = [(600, 1000), (0, 599), (599, 600)];
        let mut counter = BinCounter::default();
        for (from, to) in parts {
            counter.add(&matrix(from, to)).unwrap();
        }
        let mut binned = counter.finish().unwrap();
        for (from, to) in [(0, 599), (599, 600), (600, 1000)] {
            binned.push(&matrix(from, to));
        }
        assert_eq!(binned.samples(), 1000);
        for feature in 0..3 {
            assert_eq!(binned.column(feature), whole.column(feature));
        }
        for sample in 0..1000 {
            assert_eq!(binned.row(sample), whole.row(sample));
            assert_eq!(binned.row(sample)[1], binned.column(1)[sample]);
        }
        assert_eq!(binned.bins, whole.bins);
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
