//! Sums over all pairs of a node's samples, which the forms of MSPD have in common.

use crate::distances::DistanceMatrix;
use crate::forest::ForestError;
use crate::forest::grow::Member;

/// D^2 between targets in whole numbers, the largest of which needs 32 bits: what splits are chosen
/// by. Sums of them are exact, so that equal splits have equal scores however they were summed up.
#[derive(Debug, Clone)]
pub struct SquaredDistances {
    targets: usize,
    /// Row by row, both halves.
    values: Vec<u32>,
    /// A whole number's worth, a power of two.
    unit: f64,
}

impl SquaredDistances {
    /// Fails when a distance is not finite.
    pub fn new(distances: &DistanceMatrix) -> Result<Self, ForestError> {
        let targets = distances.count();
        let most = usize::from(u16::MAX) + 1;
        if targets > most {
            return Err(ForestError::TooMany {
                what: "targets",
                got: targets,
                most,
            });
        }
        let all = (0..targets).flat_map(|a| distances.row(a));
        let squares: Vec<f64> = all.map(|d| d * d).collect();
        if let Some(at) = squares.iter().position(|square| !square.is_finite()) {
            return Err(ForestError::NotFinite {
                target: at / targets,
                column: at % targets,
            });
        }
        let largest = squares.iter().copied().fold(0.0, f64::max);
        let mut unit = 1.0;
        if largest > 0.0 {
            unit = (largest.log2().floor() - 31.0)
                .exp2()
                .max(f64::MIN_POSITIVE);
            if (largest / unit).round() > f64::from(u32::MAX) {
                unit *= 2.0;
            }
        }
        let whole = |square: f64| (square / unit).round() as u32;
        Ok(Self {
            targets,
            values: squares.into_iter().map(whole).collect(),
            unit,
        })
    }

    /// How many targets there are distances between.
    pub fn targets(&self) -> usize {
        self.targets
    }

    /// From one target to all.
    #[inline]
    pub fn row(&self, target: u16) -> &[u32] {
        &self.values[usize::from(target) * self.targets..][..self.targets]
    }

    /// A score's worth in a node of weight n, see [`mean_of_pairs`]: with this factor it is eq. 1.
    pub fn worth(&self, n: f64) -> f64 {
        self.unit / n
    }
}

/// n times eq. 1 with eq. 6, from both sides' weights and sums over all pairs; and the negative of
/// it, for larger is better. A side of one sample has no pairs and is pure.
#[inline(always)]
pub fn mean_of_pairs(weights: [f64; 2], pairs: [f64; 2]) -> f64 {
    let others = weights.map(|n| if n > 1.0 { n - 1.0 } else { 1.0 });
    -(pairs[0] / others[0] + pairs[1] / others[1])
}

/// Eq. 6: the mean of D^2 over all pairs of samples, each counted as often as it weighs; 0 for a
/// single one.
pub fn mspd_impurity(distances: &DistanceMatrix, members: &[Member]) -> f64 {
    let mut counts: Vec<(u16, u64)> = members
        .iter()
        .map(|member| (member.target, u64::from(member.weight)))
        .collect();
    counts.sort_unstable();
    counts.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        kept.1 += if same { next.1 } else { 0 };
        same
    });
    let n: u64 = counts.iter().map(|&(_, count)| count).sum();
    if n <= 1 {
        return 0.0;
    }
    let mut sum = 0.0;
    for (i, &(a, count_a)) in counts.iter().enumerate() {
        let row = distances.row(usize::from(a));
        let others = counts[..i].iter();
        let squares = others.map(|&(b, count)| count as f64 * row[usize::from(b)].powi(2));
        sum += 2.0 * count_a as f64 * squares.sum::<f64>();
    }
    sum / (n as f64 * (n - 1) as f64)
}
