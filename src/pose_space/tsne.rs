//! t-SNE (van der Maaten and Hinton 2008), exact: all pairs, sums in a fixed order. With a few
//! hundred things it takes less than a second.

use super::MapError;
use super::classical_scaling::{classical_scaling, require_finite};
use crate::distances::DistanceMatrix;

/// What t-SNE is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TsneSpec {
    pub dimensions: usize,
    /// The effective number of neighbours.
    pub perplexity: f64,
    /// nu of the t-distribution in the map, at least 1: always 1 in the paper of 2008, `dimensions - 1`
    /// in van der Maaten (2009).
    pub degrees_of_freedom: u32,
}

// Gradient descent with momentum and early exaggeration as in the paper of 2008, but without its
// gains: a gain hangs on the sign of a slope, so that rounding would grow into another map. The rate
// rises with the number of things, since slopes fall with it (Belkina et al. 2019).
const ITERATIONS: usize = 1000;
const RATE: f64 = 0.5;
const MOMENTUM: (f64, f64) = (0.5, 0.8);
const MOMENTUM_RISES_AT: usize = 250;
const EXAGGERATION: f64 = 4.0;
const EXAGGERATED: usize = 50;
/// The standard deviation of the first coordinate at the start.
const START: f64 = 1e-4;

/// Points that have the neighbours of `distances`: `spec.dimensions` coordinates for each thing, row
/// by row, centred. Neighbours are found by exp(-beta_i D_ij^2), so that the unit of the distances
/// does not matter. Starts from [`classical_scaling`], so that nothing is random; where that has
/// fewer dimensions the map stays in them.
pub fn tsne(distances: &DistanceMatrix, spec: TsneSpec) -> Result<Vec<f64>, MapError> {
    tsne_from(
        distances,
        spec,
        classical_scaling(distances, spec.dimensions)?,
    )
}

/// t-SNE from a start of one's own, a row for each thing, whose scale does not matter. Panics when
/// it is not of that size, or without degrees of freedom.
pub fn tsne_from(
    distances: &DistanceMatrix,
    spec: TsneSpec,
    start: Vec<f64>,
) -> Result<Vec<f64>, MapError> {
    let (count, width) = (distances.count(), spec.dimensions);
    assert_eq!(start.len(), count * width, "coordinates to start from");
    assert!(spec.degrees_of_freedom > 0, "degrees of freedom");
    let joint = joint_probabilities(distances, spec.perplexity)?;
    let mut points = start;
    centre(&mut points, width);
    let first = points.iter().step_by(width.max(1));
    let deviation = (first.map(|x| x * x).sum::<f64>() / count as f64).sqrt();
    if deviation > 0.0 {
        points.iter_mut().for_each(|x| *x *= START / deviation);
    }
    descend(&joint, spec, &mut points, ITERATIONS);
    centre(&mut points, width);
    Ok(points)
}

fn descend(joint: &[f64], spec: TsneSpec, points: &mut [f64], iterations: usize) {
    let mut slope = Slope::new(joint, spec);
    let mut velocities = vec![0.0; points.len()];
    for iteration in 0..iterations {
        let exaggeration = if iteration < EXAGGERATED {
            EXAGGERATION
        } else {
            1.0
        };
        let late = iteration >= MOMENTUM_RISES_AT;
        let momentum = if late { MOMENTUM.1 } else { MOMENTUM.0 };
        let rate = RATE * slope.count as f64 / exaggeration;
        let steepness = slope.at(points, exaggeration);
        for ((x, dx), velocity) in points.iter_mut().zip(steepness).zip(&mut velocities) {
            *velocity = momentum * *velocity - rate * dx;
            *x += *velocity;
        }
    }
}

/// Whether each of `count` things can have that many neighbours. It takes more others than that, for
/// with all of them alike there is no bandwidth.
pub fn require_perplexity(perplexity: f64, count: usize) -> Result<(), MapError> {
    match perplexity >= 1.0 && perplexity + 1.0 < count as f64 {
        true => Ok(()),
        false => Err(MapError::Perplexity { perplexity, count }),
    }
}

/// p_ij = (p_j|i + p_i|j) / 2n, both halves, row by row.
fn joint_probabilities(distances: &DistanceMatrix, perplexity: f64) -> Result<Vec<f64>, MapError> {
    require_finite(distances)?;
    let count = distances.count();
    require_perplexity(perplexity, count)?;
    let mut conditional = vec![0.0; count * count];
    for (i, row) in conditional.chunks_exact_mut(count).enumerate() {
        let squares = distances.row(i).iter().map(|d| d * d);
        row.iter_mut()
            .zip(squares)
            .for_each(|(p, square)| *p = square);
        neighbour_probabilities(row, i, perplexity);
    }
    let joint = |at: usize| {
        let (i, j) = (at / count, at % count);
        (conditional[at] + conditional[j * count + i]) / (2.0 * count as f64)
    };
    Ok((0..count * count).map(joint).collect())
}

/// Turns the squared distances of thing `own` into p_j|own, which falls as exp(-beta D^2) with the
/// beta at which the entropy is ln(perplexity). Where more things than that are equally near, they
/// share the probability.
fn neighbour_probabilities(row: &mut [f64], own: usize, perplexity: f64) {
    row[own] = f64::INFINITY;
    let nearest = row.iter().copied().fold(f64::INFINITY, f64::min);
    row.iter_mut().for_each(|square| *square -= nearest);
    let entropy = |beta: f64| {
        let (mut sum, mut energy) = (0.0, 0.0);
        for &excess in row.iter().filter(|excess| excess.is_finite()) {
            let weight = (-beta * excess).exp();
            sum += weight;
            energy += weight * beta * excess;
        }
        sum.ln() + energy / sum
    };
    let finite = row.iter().filter(|excess| excess.is_finite());
    let mean = finite.sum::<f64>() / (row.len() - 1) as f64;
    let mut beta = 1.0;
    if mean > 0.0 {
        beta /= mean;
        let (mut low, mut high) = (0.0, f64::INFINITY);
        // Bisection to the last bit, once an upper bound is found.
        for _ in 0..100 {
            if entropy(beta) > perplexity.ln() {
                low = beta;
            } else {
                high = beta;
            }
            beta = if high.is_finite() {
                (low + high) / 2.0
            } else {
                2.0 * low
            };
        }
    }
    let mut sum = 0.0;
    for p in row.iter_mut() {
        *p = (-beta * *p).exp();
        sum += *p;
    }
    row.iter_mut().for_each(|p| *p /= sum);
}

fn centre(points: &mut [f64], width: usize) {
    let count = (points.len() / width.max(1)) as f64;
    for k in 0..width {
        let mean = points.iter().skip(k).step_by(width).sum::<f64>() / count;
        points
            .iter_mut()
            .skip(k)
            .step_by(width)
            .for_each(|x| *x -= mean);
    }
}

/// The slope of KL(P || Q), with memory for its sums.
struct Slope<'a> {
    joint: &'a [f64],
    spec: TsneSpec,
    count: usize,
    /// For each pair j < i: 1 / (1 + |y_i - y_j|^2 / nu), and that to the power (nu + 1) / 2.
    weights: Vec<(f64, f64)>,
    slopes: Vec<f64>,
}

impl<'a> Slope<'a> {
    fn new(joint: &'a [f64], spec: TsneSpec) -> Self {
        let count = joint.len().isqrt();
        Self {
            joint,
            spec,
            count,
            weights: vec![(0.0, 0.0); count * count.saturating_sub(1) / 2],
            slopes: vec![0.0; count * spec.dimensions],
        }
    }

    /// 2 (nu + 1) / nu sum_j (p_ij - q_ij) w_ij (y_i - y_j) for every thing i, w_ij being
    /// 1 / (1 + |y_i - y_j|^2 / nu), q_ij proportional to w_ij^((nu + 1) / 2), and P multiplied by
    /// `exaggeration`.
    fn at(&mut self, points: &[f64], exaggeration: f64) -> &[f64] {
        let width = self.spec.dimensions;
        let freedom = f64::from(self.spec.degrees_of_freedom);
        let point = |i: usize| &points[i * width..(i + 1) * width];
        let pairs = (0..self.count).flat_map(|i| (0..i).map(move |j| (i, j)));

        let mut total = 0.0;
        for ((i, j), weights) in pairs.clone().zip(&mut self.weights) {
            let squares = point(i)
                .iter()
                .zip(point(j))
                .map(|(a, b)| (a - b) * (a - b));
            let weight = 1.0 / (1.0 + squares.sum::<f64>() / freedom);
            let power = weight.powi(self.spec.degrees_of_freedom as i32 + 1).sqrt();
            total += 2.0 * power;
            *weights = (weight, power);
        }
        let factor = 2.0 * (freedom + 1.0) / freedom;
        self.slopes.fill(0.0);
        for ((i, j), (weight, power)) in pairs.zip(&self.weights) {
            let p = exaggeration * self.joint[i * self.count + j];
            let pull = factor * (p - power / total) * weight;
            for k in 0..width {
                let step = pull * (points[i * width + k] - points[j * width + k]);
                self.slopes[i * width + k] += step;
                self.slopes[j * width + k] -= step;
            }
        }
        &self.slopes
    }
}

#[cfg(test)]
mod tests {
    use super::super::classical_scaling::tests::random_points;
    use super::super::co_ranking::CoRanking;
    use super::*;
    use crate::random::{shuffle, stream};

    const SPEC: TsneSpec = TsneSpec {
        dimensions: 2,
        perplexity: 10.0,
        degrees_of_freedom: 1,
    };

    fn distances(seed: u64, count: usize) -> DistanceMatrix {
        DistanceMatrix::euclidean(&random_points(seed, count, 5), 5)
    }

    /// KL(P || Q) from its definition.
    fn divergence(joint: &[f64], points: &[f64], spec: TsneSpec) -> f64 {
        let map = DistanceMatrix::euclidean(points, spec.dimensions);
        let freedom = f64::from(spec.degrees_of_freedom);
        let kernel = |i: usize, j: usize| match i == j {
            true => 0.0,
            false => (1.0 + map.get(i, j).powi(2) / freedom).powf(-(freedom + 1.0) / 2.0),
        };
        let n = map.count();
        let pairs = || (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let total: f64 = pairs().map(|(i, j)| kernel(i, j)).sum();
        let terms = pairs().filter(|&(i, j)| i != j && joint[i * n + j] > 0.0);
        terms
            .map(|(i, j)| {
                let p = joint[i * n + j];
                p * (p * total / kernel(i, j)).ln()
            })
            .sum()
    }

    #[test]
    fn probabilities_have_the_perplexity() {
        let distances = distances(1, 60);
        for perplexity in [1.5, 5.0, 30.0, 58.0] {
            for i in 0..60 {
                let mut row: Vec<f64> = distances.row(i).iter().map(|d| d * d).collect();
                neighbour_probabilities(&mut row, i, perplexity);
                let terms = row.iter().filter(|&&p| p > 0.0).map(|p| -p * p.ln());
                assert!((terms.sum::<f64>().exp() - perplexity).abs() < 1e-9);
                assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12 && row[i] == 0.0);
                // The nearer, the more probable.
                let mut order: Vec<usize> = (0..60).filter(|&j| j != i).collect();
                order.sort_by(|&a, &b| distances.get(i, a).total_cmp(&distances.get(i, b)));
                assert!(order.windows(2).all(|w| row[w[0]] >= row[w[1]]));
            }
        }
        let joint = joint_probabilities(&distances, 10.0).unwrap();
        assert!((joint.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!((0..60 * 60).all(|at| joint[at] == joint[at % 60 * 60 + at / 60]));
    }

    #[test]
    fn equally_near_things_share_the_probability() {
        let mut row = [0.0, 0.0, 0.0, 0.0, 4.0, 9.0];
        neighbour_probabilities(&mut row, 0, 2.0);
        assert!(
            row[1..4].iter().all(|p| (p - 1.0 / 3.0).abs() < 1e-12),
            "{row:?}"
        );
        let mut all_the_same = [0.0; 4];
        neighbour_probabilities(&mut all_the_same, 1, 2.0);
        assert!((all_the_same[0] - 1.0 / 3.0).abs() < 1e-12 && all_the_same[1] == 0.0);
    }

    #[test]
    fn slopes_are_those_of_the_divergence() {
        let joint = joint_probabilities(&distances(2, 20), 6.0).unwrap();
        for (dimensions, degrees_of_freedom) in [(1, 1), (2, 1), (3, 2), (5, 4), (5, 1)] {
            let spec = TsneSpec {
                dimensions,
                degrees_of_freedom,
                ..SPEC
            };
            let points = random_points(3, 20, dimensions);
            let mut slope = Slope::new(&joint, spec);
            let slopes = slope.at(&points, 1.0).to_vec();
            for at in 0..points.len() {
                let moved = |by: f64| {
                    let mut points = points.clone();
                    points[at] += by;
                    divergence(&joint, &points, spec)
                };
                let numerical = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                assert!(
                    (slopes[at] - numerical).abs() < 1e-8,
                    "{} {numerical}",
                    slopes[at]
                );
            }
        }
    }

    /// Four clusters on the corners of a simplex: everyone's nearest are of the same cluster, and
    /// the map is better than the one it starts from.
    #[test]
    fn clusters_are_separated() {
        let mut points = random_points(4, 80, 5);
        for (i, x) in points.iter_mut().enumerate() {
            *x = 0.2 * *x + if i % 5 == i / 5 % 4 { 3.0 } else { 0.0 };
        }
        let distances = DistanceMatrix::euclidean(&points, 5);
        let start = classical_scaling(&distances, 2).unwrap();
        let joint = joint_probabilities(&distances, SPEC.perplexity).unwrap();
        for start in [start, random_points(5, 80, 2)] {
            let found = tsne_from(&distances, SPEC, start.clone()).unwrap();
            let map = DistanceMatrix::euclidean(&found, 2);
            for i in 0..80 {
                let of = |same: bool| {
                    let others = (0..80).filter(move |&j| j != i && (j % 4 == i % 4) == same);
                    others.map(|j| map.get(i, j))
                };
                assert!(of(true).fold(0.0, f64::max) < of(false).fold(f64::MAX, f64::min));
            }
            assert!(divergence(&joint, &found, SPEC) < 0.5 * divergence(&joint, &start, SPEC));
            // Once the exaggeration is over it only gets better.
            let course = [100, 200, 400, 700, 1000].map(|iterations| {
                let mut points: Vec<f64> = start.iter().map(|x| 1e-4 * x).collect();
                descend(&joint, SPEC, &mut points, iterations);
                divergence(&joint, &points, SPEC)
            });
            assert!(course.windows(2).all(|w| w[1] <= w[0]), "{course:?}");
        }
    }

    #[test]
    fn the_unit_and_the_order_do_not_matter() {
        let distances = distances(6, 60);
        let found = tsne(&distances, SPEC).unwrap();
        // A power of two changes no bit of what is computed.
        let doubled = DistanceMatrix::new(60, |a, b| 2.0 * distances.get(a, b));
        assert_eq!(tsne(&doubled, SPEC).unwrap(), found);
        // Another order changes the rounding only.
        let mut order: Vec<usize> = (0..60).collect();
        shuffle(&mut stream(7, "order", &[]), &mut order);
        let shuffled = tsne(&distances.subset(&order), SPEC).unwrap();
        for (row, &i) in shuffled.chunks(2).zip(&order) {
            let same = &found[2 * i..2 * i + 2];
            assert!(
                (0..2).all(|k| (row[k] - same[k]).abs() < 1e-3),
                "{row:?} {same:?}"
            );
        }
    }

    #[test]
    fn threads_do_not_matter() {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| tsne(&distances(8, 60), SPEC).unwrap())
        };
        assert_eq!(on(1), on(2));
    }

    /// Neighbours in a space of two dimensions can be kept in two.
    #[test]
    fn a_plane_is_kept() {
        let plane = DistanceMatrix::euclidean(&random_points(9, 100, 2), 2);
        let map = DistanceMatrix::euclidean(&tsne(&plane, SPEC).unwrap(), 2);
        let kept = CoRanking::new(&plane, &map).area();
        assert!(kept > 0.7, "{kept}");
    }

    #[test]
    fn perplexity_must_fit() {
        let distances = distances(10, 12);
        let with = |perplexity: f64| tsne(&distances, TsneSpec { perplexity, ..SPEC });
        assert_eq!(
            with(11.0),
            Err(MapError::Perplexity {
                perplexity: 11.0,
                count: 12
            })
        );
        assert!(with(0.5).is_err() && with(f64::NAN).is_err() && with(10.9).is_ok());
    }
}
