//! The statistics that tables and claims need.

use crate::random::{self, Stream};

/// Arithmetic mean; NaN of nothing.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Sample standard deviation (n - 1 in the denominator); 0 of a single value, NaN of nothing.
pub fn standard_deviation(values: &[f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let centre = mean(values);
    let squares: f64 = values.iter().map(|v| (v - centre).powi(2)).sum();
    (squares / (values.len() as f64 - 1.0).max(1.0)).sqrt()
}

/// The quantile at `share` (0 to 1) of values in ascending order, linear between neighbours
/// (Hyndman and Fan's type 7); NaN of nothing.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let position = share * last as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (sorted[above] - sorted[below]) * (position - below as f64)
}

/// The middle of values in any order, between two of them their mean; NaN of nothing.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    quantile(&sorted, 0.5)
}

/// A mean, or another statistic, with the limits of its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    pub mean: f64,
    pub low: f64,
    pub high: f64,
}

/// Percentile bootstrap of the mean, see [`bootstrap`]. NaN of nothing.
pub fn bootstrap_mean(values: &[f64], stream: &mut Stream) -> Interval {
    let of = |drawn: &[usize]| drawn.iter().map(|&i| values[i]).sum::<f64>() / drawn.len() as f64;
    bootstrap(values.len(), of, stream)
}

/// Percentile bootstrap of a statistic of `count` observations, which is told their indices: the
/// 2.5 % and 97.5 % quantiles over 10,000 resamples drawn with replacement; `mean` is the statistic
/// of the observations themselves. Values that belong together (the pixels of an image) must have
/// been brought down to one observation each before.
pub fn bootstrap(
    count: usize,
    statistic: impl Fn(&[usize]) -> f64,
    stream: &mut Stream,
) -> Interval {
    const RESAMPLES: usize = 10_000;
    let mut drawn: Vec<usize> = (0..count).collect();
    let mean = statistic(&drawn);
    let resample = |_| {
        drawn.fill_with(|| random::below(stream, count));
        statistic(&drawn)
    };
    let mut resampled: Vec<f64> = (0..RESAMPLES).map(resample).collect();
    resampled.sort_by(f64::total_cmp);
    Interval {
        mean,
        low: quantile(&resampled, 0.025),
        high: quantile(&resampled, 0.975),
    }
}

/// Spearman's rank correlation of paired values, in [-1, 1]; equal values share the mean of their
/// ranks. NaN when either side is constant. Panics when the lengths differ.
pub fn spearman(x: &[f64], y: &[f64]) -> f64 {
    assert_eq!(x.len(), y.len(), "spearman needs pairs");
    pearson(&ranks(x), &ranks(y))
}

fn pearson(x: &[f64], y: &[f64]) -> f64 {
    let (mean_x, mean_y) = (mean(x), mean(y));
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (a, b) in x.iter().zip(y) {
        let (a, b) = (a - mean_x, b - mean_y);
        xx += a * a;
        yy += b * b;
        xy += a * b;
    }
    xy / (xx * yy).sqrt()
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    for tie in order.chunk_by(|&a, &b| values[a] == values[b]) {
        for &index in tie {
            ranks[index] = first as f64 + (tie.len() as f64 - 1.0) / 2.0;
        }
        first += tie.len();
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{normal, stream};

    #[test]
    fn mean_and_deviation_of_known_values() {
        let values = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0];
        assert_eq!(mean(&values), 5.0);
        assert!((standard_deviation(&values) - (32.0_f64 / 7.0).sqrt()).abs() < 1e-15);
        assert_eq!(standard_deviation(&[3.0]), 0.0);
        assert!(mean(&[]).is_nan() && standard_deviation(&[]).is_nan());
    }

    #[test]
    fn quantiles_are_linear_between_neighbours() {
        let values = [1.0, 2.0, 4.0];
        assert_eq!(quantile(&values, 0.0), 1.0);
        assert_eq!(quantile(&values, 0.25), 1.5);
        assert_eq!(quantile(&values, 0.75), 3.0);
        assert_eq!(quantile(&values, 1.0), 4.0);
        assert!(quantile(&[], 0.5).is_nan());
    }

    /// The interval of the mean of n normal values is mean +- 1.96 sd / sqrt(n), and contains the
    /// true mean in about 95 % of experiments.
    #[test]
    fn bootstrap_agrees_with_the_normal_interval() {
        let mut s = stream(1, "bootstrap-test", &[]);
        let values: Vec<f64> = (0..200).map(|_| 3.0 + 2.0 * normal(&mut s)).collect();
        let interval = bootstrap_mean(&values, &mut s);
        let half = 1.96 * standard_deviation(&values) / 200_f64.sqrt();
        assert_eq!(interval.mean, mean(&values));
        assert!((interval.high - interval.mean - half).abs() < 0.08 * half);
        assert!((interval.mean - interval.low - half).abs() < 0.08 * half);
        let shifted: Vec<f64> = values.iter().map(|v| v + 1.0).collect();
        let again = |values: &[f64]| bootstrap_mean(values, &mut stream(2, "same", &[]));
        assert!((again(&shifted).low - again(&values).low - 1.0).abs() < 1e-12);
    }

    #[test]
    fn spearman_sees_order_only() {
        let x = [1.0, 2.0, 3.0, 4.0, 5.0];
        let cubes: Vec<f64> = x.iter().map(|v: &f64| v.powi(3)).collect();
        let falling: Vec<f64> = x.iter().map(|v| -v).collect();
        assert!((spearman(&x, &cubes) - 1.0).abs() < 1e-15);
        assert!((spearman(&x, &falling) + 1.0).abs() < 1e-15);
        // Two tied values; by hand: ranks 0, 1.5, 1.5, 3 against 0, 1, 2, 3.
        let tied = spearman(&[1.0, 2.0, 2.0, 3.0], &[1.0, 2.0, 3.0, 4.0]);
        assert!((tied - 4.5 / (4.5_f64 * 5.0).sqrt()).abs() < 1e-15);
        assert!(spearman(&[1.0, 1.0], &[1.0, 2.0]).is_nan());
    }
}
