//! Named random streams. Every random choice in the project draws from a stream that is a pure
//! function of the master seed, the stage it belongs to and where it stands on the axes of that
//! stage (image, fold, tree, ...), so that results never depend on the order of execution.
//!
//! Integers, shuffles and normals are drawn by the functions below and not by those of `rand`,
//! whose value streams may change between its releases.

use rand::Rng;
pub use rand_chacha::ChaCha8Rng as Stream;
use rand_chacha::rand_core::SeedableRng;

/// The stream of `stage` at the point `axes`, for example `stream(seed, "bootstrap", &[fold, tree])`.
pub fn stream(master_seed: u64, stage: &str, axes: &[u64]) -> Stream {
    let mut hash = blake3::Hasher::new();
    hash.update(&master_seed.to_le_bytes());
    hash.update(&(stage.len() as u64).to_le_bytes());
    hash.update(stage.as_bytes());
    for axis in axes {
        hash.update(&axis.to_le_bytes());
    }
    Stream::from_seed(*hash.finalize().as_bytes())
}

/// A master seed of its own for a part of the work that draws many streams.
pub fn seed(master_seed: u64, stage: &str, axes: &[u64]) -> u64 {
    stream(master_seed, stage, axes).next_u64()
}

/// Uniform in `0..n`. The bias is below `n / 2^64`.
pub fn below(stream: &mut Stream, n: usize) -> usize {
    ((u128::from(stream.next_u64()) * n as u128) >> 64) as usize
}

/// Uniform in `[0, 1)`, with 53 random bits.
pub fn unit(stream: &mut Stream) -> f64 {
    (stream.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// Uniform in `[low, high)`.
pub fn uniform(stream: &mut Stream, low: f64, high: f64) -> f64 {
    low + (high - low) * unit(stream)
}

/// Standard normal (Box-Muller, one value a call).
pub fn normal(stream: &mut Stream) -> f64 {
    let radius = (-2.0 * (1.0 - unit(stream)).ln()).sqrt();
    radius * (std::f64::consts::TAU * unit(stream)).cos()
}

/// Fisher-Yates, in place.
pub fn shuffle<T>(stream: &mut Stream, items: &mut [T]) {
    for last in (1..items.len()).rev() {
        items.swap(last, below(stream, last + 1));
    }
}

/// `count` distinct numbers of `0..n` in ascending order. Panics when `count > n`.
pub fn sample_sorted(stream: &mut Stream, n: usize, count: usize) -> Vec<usize> {
    assert!(count <= n, "cannot draw {count} distinct numbers below {n}");
    // Floyd's algorithm: exact, and never more than `count` draws.
    let mut chosen = std::collections::BTreeSet::new();
    for upper in n - count..n {
        let candidate = below(stream, upper + 1);
        if !chosen.insert(candidate) {
            chosen.insert(upper);
        }
    }
    chosen.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The published results hang on these values: they must never change.
    #[test]
    fn streams_are_golden() {
        let mut s = stream(1, "golden", &[2, 3]);
        let drawn: Vec<usize> = (0..5).map(|_| below(&mut s, 1000)).collect();
        assert_eq!(drawn, GOLDEN_BELOW);
        let mut items: Vec<u8> = (0..6).collect();
        shuffle(&mut s, &mut items);
        assert_eq!(items, GOLDEN_SHUFFLE);
    }
    const GOLDEN_BELOW: [usize; 5] = [926, 551, 964, 52, 512];
    const GOLDEN_SHUFFLE: [u8; 6] = [2, 4, 1, 0, 3, 5];

    #[test]
    fn streams_differ_by_stage_and_axes() {
        let first = |stage: &str, axes: &[u64]| stream(7, stage, axes).next_u64();
        assert_ne!(first("a", &[0]), first("b", &[0]));
        assert_ne!(first("a", &[0]), first("a", &[1]));
        assert_ne!(first("a", &[0]), first("a", &[0, 0]));
    }

    #[test]
    fn normal_has_mean_zero_and_unit_variance() {
        let mut s = stream(3, "normal", &[]);
        let (mut sum, mut squares) = (0.0, 0.0);
        let n = 100_000;
        for _ in 0..n {
            let x = normal(&mut s);
            sum += x;
            squares += x * x;
        }
        assert!((sum / n as f64).abs() < 0.02);
        assert!((squares / n as f64 - 1.0).abs() < 0.02);
    }

    #[test]
    fn sample_sorted_is_distinct_ascending_and_uniform() {
        let mut s = stream(4, "sample", &[]);
        let mut hits = [0u32; 10];
        for _ in 0..10_000 {
            let drawn = sample_sorted(&mut s, 10, 3);
            assert!(drawn.windows(2).all(|w| w[0] < w[1]));
            drawn.iter().for_each(|&i| hits[i] += 1);
        }
        assert!(hits.iter().all(|&h| (2800..3200).contains(&h)), "{hits:?}");
    }
}
