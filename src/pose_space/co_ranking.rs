//! How well a map keeps neighbourhoods: Q_NX(K) and its relatives (Lee and Verleysen 2009).

use crate::distances::DistanceMatrix;

/// The neighbourhoods of all things before and after mapping, compared. A thing's K-neighbourhood
/// are the K others that are nearest to it, of equals those of lower index.
#[derive(Debug, Clone, PartialEq)]
pub struct CoRanking {
    count: usize,
    /// How many of thing i's K nearest are among its K nearest in the map, at i (n - 1) + K - 1.
    shared: Vec<u32>,
}

impl CoRanking {
    /// Compares `distances` with those in a map of the same things. Panics when these are not as
    /// many, or fewer than 3.
    pub fn new(distances: &DistanceMatrix, mapped: &DistanceMatrix) -> CoRanking {
        let count = distances.count();
        assert_eq!(count, mapped.count(), "things and mapped things");
        assert!(count >= 3, "no neighbourhoods among {count} things");
        let mut shared = vec![0; count * (count - 1)];
        for (i, shared) in shared.chunks_exact_mut(count - 1).enumerate() {
            let (before, after) = (ranks(distances.row(i), i), ranks(mapped.row(i), i));
            for j in (0..count).filter(|&j| j != i) {
                // j is in both neighbourhoods from the larger of its ranks on.
                shared[before[j].max(after[j]) - 1] += 1;
            }
            let mut sum = 0;
            for shared in shared {
                sum += *shared;
                *shared = sum;
            }
        }
        CoRanking { count, shared }
    }

    /// How many things there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Q_NX(K): the share of the K nearest that stay among the K nearest, averaged over all things.
    /// About K / (n - 1) for a random map; 1 at K = n - 1. Panics unless 1 <= K < n.
    pub fn q_nx(&self, k: usize) -> f64 {
        let shared: u32 = (0..self.count).map(|i| self.shared(i, k)).sum();
        f64::from(shared) / (self.count * k) as f64
    }

    /// R_NX(K): Q_NX(K) scaled so that a random map has 0 and a perfect one 1. Panics unless
    /// 1 <= K < n - 1.
    pub fn r_nx(&self, k: usize) -> f64 {
        self.beyond_chance(k, self.q_nx(k))
    }

    /// The area below R_NX(K) over ln K, as a share of the whole: near neighbours count most.
    pub fn area(&self) -> f64 {
        self.area_below(|k| self.q_nx(k))
    }

    /// Q_NX(K) for the neighbourhood of thing i alone. The mean over all things is [`Self::q_nx`].
    pub fn q_nx_of(&self, i: usize, k: usize) -> f64 {
        f64::from(self.shared(i, k)) / k as f64
    }

    /// The area for the neighbourhoods of thing i alone. The mean over all things is [`Self::area`].
    pub fn area_of(&self, i: usize) -> f64 {
        self.area_below(|k| self.q_nx_of(i, k))
    }

    fn shared(&self, i: usize, k: usize) -> u32 {
        assert!(
            (1..self.count).contains(&k),
            "{k} neighbours of {}",
            self.count
        );
        self.shared[i * (self.count - 1) + k - 1]
    }

    fn beyond_chance(&self, k: usize, q: f64) -> f64 {
        assert!(k + 1 < self.count, "{k} neighbours of {}", self.count);
        let others = (self.count - 1) as f64;
        (others * q - k as f64) / (others - k as f64)
    }

    fn area_below(&self, q: impl Fn(usize) -> f64) -> f64 {
        let (mut area, mut weights) = (0.0, 0.0);
        for k in 1..self.count - 1 {
            area += self.beyond_chance(k, q(k)) / k as f64;
            weights += 1.0 / k as f64;
        }
        area / weights
    }
}

/// The rank of every thing by its distance from `own`, from 1, equals by index; 0 for `own` itself.
fn ranks(distances: &[f64], own: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..distances.len()).filter(|&j| j != own).collect();
    order.sort_by(|&a, &b| distances[a].total_cmp(&distances[b])); // stable
    let mut ranks = vec![0; distances.len()];
    for (before, j) in order.into_iter().enumerate() {
        ranks[j] = before + 1;
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::super::classical_scaling::{classical_scaling, tests::random_points};
    use super::*;

    fn euclidean(points: &[f64], width: usize) -> DistanceMatrix {
        DistanceMatrix::euclidean(points, width)
    }

    /// The co-ranking matrix: q_kl = how often a thing of rank k has rank l in the map.
    fn matrix(distances: &DistanceMatrix, mapped: &DistanceMatrix) -> Vec<Vec<u32>> {
        let count = distances.count();
        let mut q = vec![vec![0; count - 1]; count - 1];
        for i in 0..count {
            let (before, after) = (ranks(distances.row(i), i), ranks(mapped.row(i), i));
            for j in (0..count).filter(|&j| j != i) {
                q[before[j] - 1][after[j] - 1] += 1;
            }
        }
        q
    }

    fn close(found: impl IntoIterator<Item = f64>, expected: &[f64]) {
        let found: Vec<f64> = found.into_iter().collect();
        assert_eq!(found.len(), expected.len());
        let pairs = found.iter().zip(expected);
        assert!(
            pairs.clone().all(|(f, e)| (f - e).abs() < 1e-6),
            "{found:?} {expected:?}"
        );
    }

    /// The fixture of R's package coRanking; some distances are equal.
    #[test]
    fn four_points_with_ties() {
        let before = euclidean(&[2.0, 1.0, 3.0, 2.0, 4.0, 3.0, 5.0, 4.0], 2);
        let after = euclidean(&[2.0, 3.0, 3.0, 2.0, 4.0, 4.0, 5.0, 2.0], 2);
        assert_eq!(matrix(&before, &after), [[2, 2, 0], [1, 1, 2], [1, 1, 2]]);
        let found = CoRanking::new(&before, &after);
        close((1..4).map(|k| found.q_nx(k)), &[0.5, 0.75, 1.0]);
        close((1..3).map(|k| found.r_nx(k)), &[0.25, 0.25]);
    }

    #[test]
    fn five_points_on_a_line() {
        let before = euclidean(&[0.0, 1.0, 3.0, 7.0, 12.0], 1);
        let after = euclidean(&[0.0, 3.0, 1.0, 12.0, 7.0], 1);
        let q = [[0, 4, 1, 0], [4, 0, 1, 0], [1, 1, 0, 3], [0, 0, 3, 2]];
        assert_eq!(matrix(&before, &after), q);
        let found = CoRanking::new(&before, &after);
        close((1..5).map(|k| found.q_nx(k)), &[0.0, 0.8, 0.8, 1.0]);
        close((1..4).map(|k| found.r_nx(k)), &[-1.0 / 3.0, 0.6, 0.2]);
        // By hand: (-1/3 + 0.6 / 2 + 0.2 / 3) / (1 + 1/2 + 1/3).
        close([found.area()], &[(1.0 / 30.0) / (11.0 / 6.0)]);
    }

    /// Principal components of Fisher's iris data (149 distinct rows; a trend over the rows breaks
    /// ties): values computed with numpy, some confirmed by the package pyDRMetrics.
    #[test]
    fn iris_on_its_principal_components() {
        let text = include_str!("../../tests/fixtures/iris.csv");
        let mut points: Vec<f64> = (text.split([',', '\n']).filter(|cell| !cell.is_empty()))
            .map(|cell| cell.parse().unwrap())
            .collect();
        for (row, values) in points.chunks_exact_mut(4).enumerate() {
            let trend = [1e-6, 2e-6, 3e-6, 5e-6].map(|step| step * row as f64);
            values
                .iter_mut()
                .zip(trend)
                .for_each(|(value, t)| *value += t);
        }
        let distances = euclidean(&points, 4);
        for (dimensions, q, area) in [
            (
                1,
                [0.114094, 0.312752, 0.476510, 0.681879, 0.932483],
                0.476115,
            ),
            (
                2,
                [0.362416, 0.644295, 0.736913, 0.855369, 0.965906],
                0.690285,
            ),
        ] {
            let map = classical_scaling(&distances, dimensions).unwrap();
            let found = CoRanking::new(&distances, &euclidean(&map, dimensions));
            close([1, 5, 10, 20, 50].map(|k| found.q_nx(k)), &q);
            close([found.area()], &[area]);
        }
    }

    #[test]
    fn identities() {
        let (before, after) = (random_points(1, 40, 3), random_points(2, 40, 2));
        let (before, after) = (euclidean(&before, 3), euclidean(&after, 2));
        let (found, back) = (
            CoRanking::new(&before, &after),
            CoRanking::new(&after, &before),
        );
        let q = matrix(&before, &after);
        for k in 1..40 {
            // The definition by the co-ranking matrix, and the symmetry of the two spaces.
            let corner: u32 = q[..k].iter().flat_map(|row| &row[..k]).sum();
            close(
                [found.q_nx(k), back.q_nx(k)],
                &[f64::from(corner) / (40 * k) as f64; 2],
            );
            let alone: f64 = (0..40).map(|i| found.q_nx_of(i, k)).sum();
            close([alone / 40.0], &[found.q_nx(k)]);
        }
        let alone: f64 = (0..40).map(|i| found.area_of(i)).sum();
        close([alone / 40.0], &[found.area()]);
        assert_eq!(found.q_nx(39), 1.0);
        // Unrelated points are no better than chance, the same ones are perfect.
        assert!(found.area().abs() < 0.1, "{}", found.area());
        let same = CoRanking::new(&before, &before);
        close([same.area(), same.q_nx(1)], &[1.0, 1.0]);
    }
}
