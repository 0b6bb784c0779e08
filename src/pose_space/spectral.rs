//! Spectral clustering into two clusters (von Luxburg 2007, normalised by Shi and Malik).
//!
//! Things have weights, a weight of c standing for c copies: the pixels of an image share its pose.
//! With affinities W, weights c and degrees d_a = sum_b c_b W_ab, the random walk on all copies has
//! the eigenvectors f of (1 / d_a) sum_b c_b W_ab f_b, and in addition only such as are zero on
//! average over every thing's copies, with the eigenvalue 0. So a problem of the size of the things
//! gives the clusters of the copies.
//!
//! * W_ab = exp(-D_ab^2 / (2 s^2)), where s^2 is the mean of D^2 over all pairs of copies: distances
//!   count relative to how far the set is spread, so that small sets are clustered as large ones.
//! * f is the eigenvector to the second largest eigenvalue. That of the largest is constant.
//! * The last step of the algorithm is k-means on (constant, f). On a line the best two clusters
//!   are those below and above a threshold, and all thresholds are tried.

use std::iter::once;

/// Memory for clustering, used again by the next call.
#[derive(Debug, Default)]
pub struct TwoClusters {
    /// W, and then (c_a / d_a)^1/2 W_ab (c_b / d_b)^1/2, which has the same eigenvalues.
    matrix: Vec<f64>,
    /// (c_a d_a)^1/2: the first eigenvector of `matrix`, and f times it is the second.
    scale: Vec<f64>,
    lanczos: Lanczos,
    fiedler: Vec<f64>,
    order: Vec<usize>,
    in_second: Vec<bool>,
}

impl TwoClusters {
    /// Which things are in the second cluster; the first thing is in the first. `distances` holds
    /// the distances between all, row by row, symmetric and zero on the diagonal; weights are
    /// positive. `None` when there is nothing to tell apart: all distances are zero.
    ///
    /// Where the second eigenvalue is a multiple one (all distances are equal, say) every vector of
    /// its space is as good, and the one we take depends on the order of the things. The same holds
    /// for thresholds that are equally good. Both clusters always have things in them.
    pub fn find(&mut self, distances: &[f64], weights: &[f64]) -> Option<&[bool]> {
        self.find_affinities(distances, weights)?;
        let second = self.lanczos.second_eigenvector(&self.matrix, &self.scale);
        self.fiedler.clear();
        let entries = second.iter().zip(&self.scale);
        self.fiedler.extend(entries.map(|(u, scale)| u / scale));
        self.split(weights);
        Some(&self.in_second)
    }

    /// f of the last call, of any length and sign.
    pub fn fiedler_vector(&self) -> &[f64] {
        &self.fiedler
    }

    fn find_affinities(&mut self, distances: &[f64], weights: &[f64]) -> Option<()> {
        let count = weights.len();
        let (mut squares, mut total) = (0.0, 0.0);
        for (row, weight) in distances.chunks_exact(count.max(1)).zip(weights) {
            let mut of_row = 0.0;
            for (distance, weight) in row.iter().zip(weights) {
                of_row += weight * (distance * distance);
            }
            squares += weight * of_row;
            total += weight;
        }
        let steepness = -0.5 * total * total / squares;
        if !steepness.is_finite() {
            return None;
        }
        self.matrix.resize(count * count, 0.0);
        for a in 0..count {
            for b in 0..a {
                let distance = distances[a * count + b];
                let affinity = (steepness * distance * distance).exp();
                self.matrix[a * count + b] = affinity;
                self.matrix[b * count + a] = affinity;
            }
            self.matrix[a * count + a] = 1.0;
        }
        self.scale.clear();
        for (row, weight) in self.matrix.chunks_exact(count).zip(weights) {
            self.scale.push((weight * dot(row, weights)).sqrt());
        }
        for (a, row) in self.matrix.chunks_exact_mut(count).enumerate() {
            let of_row = weights[a] / self.scale[a];
            for (entry, (weight, scale)) in row.iter_mut().zip(weights.iter().zip(&self.scale)) {
                *entry *= of_row * (weight / scale);
            }
        }
        Some(())
    }

    /// Two-means on f.
    fn split(&mut self, weights: &[f64]) {
        let f = &self.fiedler;
        self.order.clear();
        self.order.extend(0..f.len());
        self.order
            .sort_unstable_by(|&a, &b| f[a].total_cmp(&f[b]).then(a.cmp(&b)));
        let total: f64 = weights.iter().sum();
        let mean = dot(f, weights) / total;
        let (mut below, mut moment) = (0.0, 0.0);
        let (mut best, mut first) = (f64::NEG_INFINITY, 0);
        for (rank, &thing) in self.order[..f.len() - 1].iter().enumerate() {
            below += weights[thing];
            moment += weights[thing] * (f[thing] - mean);
            // The squares between the clusters: what is left within is least where they are most.
            let between = moment * moment / (below * (total - below));
            if between > best {
                (best, first) = (between, rank + 1);
            }
        }
        self.in_second.clear();
        self.in_second.resize(f.len(), false);
        for &thing in &self.order[first..] {
            self.in_second[thing] = true;
        }
        if self.in_second[0] {
            self.in_second.iter_mut().for_each(|second| *second ^= true);
        }
    }
}

/// Looks for the eigenvector in the space that powers of the matrix span from one vector on.
#[derive(Debug, Default)]
struct Lanczos {
    /// Orthonormal vectors; the first is the eigenvector that is known.
    basis: Vec<f64>,
    /// The matrix on the others.
    small: Tridiagonal,
    product: Vec<f64>,
}

/// What is left of an eigenvector of unit length when its eigenvalue is taken off.
const RESIDUAL: f64 = 1e-9;
/// Steps between two looks at the eigenvector so far.
const STRIDE: usize = 4;

impl Lanczos {
    /// The second eigenvector of a symmetric matrix whose eigenvalues are at most 1, that of `first`
    /// being 1. At least two rows.
    fn second_eigenvector(&mut self, matrix: &[f64], first: &[f64]) -> &[f64] {
        let count = first.len();
        self.basis.clear();
        self.basis.extend(first);
        normalise(&mut self.basis);
        self.small.clear();
        self.product.clear();
        // A start that no symmetry of the matrix makes orthogonal to what is sought.
        let golden = (1..=count).map(|i| (i as f64 * 0.618_033_988_749_894_9).fract() - 0.5);
        self.product.extend(golden);
        // What the start has of the first eigenvector is large: it is taken off twice.
        orthogonalise(&mut self.product, &self.basis);
        orthogonalise(&mut self.product, &self.basis);
        normalise(&mut self.product);
        for step in 1..count {
            self.basis.extend(&self.product);
            let last = &self.basis[step * count..];
            self.product.fill(0.0);
            for (row, &x) in matrix.chunks_exact(count).zip(last) {
                for (sum, entry) in self.product.iter_mut().zip(row) {
                    *sum += x * entry;
                }
            }
            self.small.diagonal.push(dot(&self.product, last));
            orthogonalise(&mut self.product, &self.basis);
            let beside = normalise(&mut self.product);
            if step + 1 == count || step % STRIDE == 0 || beside < RESIDUAL {
                self.small.find_top_eigenvector();
                let residual = beside * self.small.vector[step - 1].abs();
                if step + 1 == count || residual < RESIDUAL {
                    break;
                }
            }
            self.small.beside.push(beside);
        }
        self.product.fill(0.0);
        let vectors = self.basis.chunks_exact(count).skip(1);
        for (vector, share) in vectors.zip(&self.small.vector) {
            for (sum, x) in self.product.iter_mut().zip(vector) {
                *sum += share * x;
            }
        }
        &self.product
    }
}

/// A symmetric matrix of three diagonals, with no zero beside the main one.
#[derive(Debug, Default)]
struct Tridiagonal {
    diagonal: Vec<f64>,
    /// One shorter.
    beside: Vec<f64>,
    /// Of the elimination from the last row upward, in the same order.
    pivots: Vec<f64>,
    vector: Vec<f64>,
}

impl Tridiagonal {
    fn clear(&mut self) {
        self.diagonal.clear();
        self.beside.clear();
    }

    /// The eigenvector to the largest eigenvalue, which is at most 1, of unit length in `vector`.
    ///
    /// Laguerre's method goes down to the largest root of the characteristic polynomial and not
    /// below it. There the elimination has positive pivots, and the eigenvector follows without
    /// cancellation.
    fn find_top_eigenvector(&mut self) {
        const CLOSE: f64 = 1e-14;
        let mut x = 1.0 + 1e-6;
        for _ in 0..50 {
            let step = self.laguerre_step(x);
            if step < CLOSE {
                break;
            }
            x -= step;
        }
        x += CLOSE;
        self.pivots.clear();
        let mut pivot = 1.0;
        let besides = once(&0.0).chain(self.beside.iter().rev());
        for (diagonal, beside) in self.diagonal.iter().rev().zip(besides) {
            pivot = x - diagonal - beside * beside / pivot;
            self.pivots.push(pivot);
        }
        self.vector.clear();
        let mut entry = 1.0;
        self.vector.push(entry);
        for (beside, pivot) in self.beside.iter().zip(self.pivots.iter().rev().skip(1)) {
            entry *= beside / pivot;
            self.vector.push(entry);
        }
        normalise(&mut self.vector);
    }

    /// How far to go down from x, which is above all eigenvalues; 0 when it is so no longer.
    fn laguerre_step(&self, x: f64) -> f64 {
        // The polynomial is the product of the pivots. The first two derivatives of each, and those
        // of the polynomial's logarithm.
        let (mut pivot, mut slope, mut bend) = (1.0, 0.0, 0.0);
        let (mut log_slope, mut log_bend) = (0.0, 0.0);
        let besides = once(&0.0).chain(self.beside.iter().rev());
        for (diagonal, beside) in self.diagonal.iter().rev().zip(besides) {
            let ratio = beside * beside / (pivot * pivot);
            bend = ratio * (bend - 2.0 * slope * slope / pivot);
            slope = 1.0 + ratio * slope;
            pivot = x - diagonal - ratio * pivot;
            if pivot <= 0.0 {
                return 0.0;
            }
            let relative = slope / pivot;
            log_slope += relative;
            log_bend += relative * relative - bend / pivot;
        }
        let n = self.diagonal.len() as f64;
        let spread = (n - 1.0) * (n * log_bend - log_slope * log_slope);
        n / (log_slope + spread.max(0.0).sqrt())
    }
}

/// Takes off what `vector` has of each of the orthonormal `basis`.
fn orthogonalise(vector: &mut [f64], basis: &[f64]) {
    for other in basis.chunks_exact(vector.len()) {
        let share = dot(vector, other);
        for (x, y) in vector.iter_mut().zip(other) {
            *x -= share * y;
        }
    }
}

/// Gives the vector unit length and returns the length that it had.
fn normalise(vector: &mut [f64]) -> f64 {
    let length = dot(vector, vector).sqrt();
    if length > 0.0 {
        vector.iter_mut().for_each(|x| *x /= length);
    }
    length
}

/// Four sums at once: additions do not wait for each other.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a, b) = (a.chunks_exact(4), b.chunks_exact(4));
    let mut rest = 0.0;
    for (x, y) in a.remainder().iter().zip(b.remainder()) {
        rest += x * y;
    }
    for (x, y) in a.zip(b) {
        (0..4).for_each(|lane| sums[lane] += x[lane] * y[lane]);
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distances::DistanceMatrix;
    use crate::random::{below, normal, stream};
    use faer::{Mat, Side};

    /// Points in a few dimensions, in two clouds or one.
    fn points(count: usize, seed: u64) -> DistanceMatrix {
        let mut s = stream(seed, "points", &[]);
        let mut points = Vec::new();
        for i in 0..count {
            points.extend([1.0, 0.5, 0.3].map(|size| size * normal(&mut s)));
            points[3 * i] += (i % 2) as f64 * (seed % 3) as f64;
        }
        DistanceMatrix::euclidean(&points, 3)
    }

    fn rows(distances: &DistanceMatrix) -> Vec<f64> {
        let all = 0..distances.count();
        all.flat_map(|a| distances.row(a)).copied().collect()
    }

    /// The second eigenvalue and eigenvector of D^-1 W, and the third eigenvalue.
    fn by_faer(distances: &DistanceMatrix) -> (f64, Vec<f64>, f64) {
        let n = distances.count();
        let squares: f64 = rows(distances).iter().map(|d| d * d).sum();
        let s2 = squares / (n * n) as f64;
        let w = |a: usize, b: usize| (-distances.get(a, b).powi(2) / (2.0 * s2)).exp();
        let degrees: Vec<f64> = (0..n).map(|a| (0..n).map(|b| w(a, b)).sum()).collect();
        let matrix = Mat::from_fn(n, n, |a, b| w(a, b) / (degrees[a] * degrees[b]).sqrt());
        let eigen = matrix.self_adjoint_eigen(Side::Lower).unwrap();
        let (values, vectors) = (eigen.S(), eigen.U());
        let f = (0..n).map(|a| vectors[(a, n - 2)] / degrees[a].sqrt());
        let third = if n > 2 { values[n - 3] } else { 0.0 };
        (values[n - 2], f.collect(), third)
    }

    fn cosine(a: &[f64], b: &[f64]) -> f64 {
        (dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()).abs()
    }

    /// The clusters of things with weights are those of their copies, whose eigenvector is found by
    /// other means and whose threshold by trying all.
    #[test]
    fn weights_are_copies() {
        let mut clusters = TwoClusters::default();
        for (seed, count) in [2, 3, 4, 5, 9, 15, 16, 33, 60].into_iter().enumerate() {
            let things = points(count, seed as u64);
            let mut s = stream(seed as u64, "weights", &[]);
            let weights: Vec<usize> = (0..count).map(|_| 1 + below(&mut s, 4)).collect();
            let copies: Vec<usize> = (0..count)
                .flat_map(|thing| std::iter::repeat_n(thing, weights[thing]))
                .collect();
            let (second, expected, third) = by_faer(&things.subset(&copies));
            assert!(second - third > 1e-3, "the test needs a gap");

            let weights: Vec<f64> = weights.iter().map(|&c| c as f64).collect();
            let ours = clusters.find(&rows(&things), &weights).unwrap().to_vec();
            let f = clusters.fiedler_vector();
            let of_copies: Vec<f64> = copies.iter().map(|&thing| f[thing]).collect();
            let off = 1.0 - cosine(&of_copies, &expected);
            assert!(off < 1e-12, "{count} things: {off}");

            // Squares within two sets of copies, by a threshold on the expected vector.
            let within = |threshold: f64| {
                let set = |above: bool| {
                    let set = expected.iter().filter(|&&x| (x > threshold) == above);
                    let set: Vec<f64> = set.copied().collect();
                    let mean = set.iter().sum::<f64>() / set.len() as f64;
                    set.iter().map(|x| (x - mean).powi(2)).sum::<f64>()
                };
                set(false) + set(true)
            };
            let highest = expected.iter().copied().fold(f64::MIN, f64::max);
            let thresholds = expected.iter().filter(|&&x| x < highest - 1e-9);
            let best = thresholds.min_by(|&&x, &&y| within(x).total_cmp(&within(y)));
            let best = best.unwrap() + 1e-9;
            for (&thing, &x) in copies.iter().zip(&expected) {
                assert_eq!(ours[thing], (x > best) != (expected[0] > best));
            }
        }
    }

    #[test]
    fn the_size_of_the_whole_does_not_matter() {
        let mut clusters = TwoClusters::default();
        let rows = rows(&points(20, 5));
        let weights = [1.0; 20];
        let once = clusters.find(&rows, &weights).unwrap().to_vec();
        let far: Vec<f64> = rows.iter().map(|d| 1024.0 * d).collect();
        assert_eq!(clusters.find(&far, &weights).unwrap(), once);
        assert_eq!(clusters.find(&rows, &[3.0; 20]).unwrap(), once);
    }

    /// Also by a memory that has been used.
    #[test]
    fn two_clouds_are_found_whatever_their_weights() {
        let mut clusters = TwoClusters::default();
        for (count, heavy) in [(2, 1.0), (7, 1e5), (150, 1.0), (12, 100.0)] {
            let place = |i: usize| 10.0 * (i % 2) as f64 + 0.01 * i as f64;
            let line: Vec<f64> = (0..count).map(place).collect();
            let mut weights = vec![1.0; count];
            weights[0] = heavy;
            let rows = rows(&DistanceMatrix::euclidean(&line, 1));
            let found = clusters.find(&rows, &weights).unwrap();
            assert!((0..count).all(|i| found[i] == (i % 2 == 1)), "{count}");
        }
    }

    #[test]
    fn sets_that_do_not_fall_apart_are_cut_somewhere() {
        let mut clusters = TwoClusters::default();
        for count in [2, 3, 4, 10, 50] {
            let equal = DistanceMatrix::new(count, |_, _| 0.7);
            let weights = vec![2.0; count];
            let found = clusters.find(&rows(&equal), &weights).unwrap().to_vec();
            assert!(!found[0] && found.contains(&true));
            assert_eq!(clusters.find(&rows(&equal), &weights).unwrap(), found);
        }
        // A ring: the second eigenvalue is a double one.
        let angles = (0..12).map(|i| f64::from(i) * std::f64::consts::TAU / 12.0);
        let ring: Vec<f64> = angles.flat_map(|x| [x.cos(), x.sin()]).collect();
        let ring = rows(&DistanceMatrix::euclidean(&ring, 2));
        let found = clusters.find(&ring, &[1.0; 12]).unwrap();
        let changes = (0..12).filter(|&i| found[i] != found[(i + 1) % 12]).count();
        assert_eq!(changes, 2);
    }

    #[test]
    fn what_is_all_alike_has_no_clusters() {
        let mut clusters = TwoClusters::default();
        assert!(clusters.find(&[0.0; 9], &[1.0, 2.0, 3.0]).is_none());
        assert!(clusters.find(&[0.0], &[4.0]).is_none());
        assert!(clusters.find(&[], &[]).is_none());
    }
}
