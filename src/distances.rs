//! Distances between poses, whatever the metric.

use rayon::prelude::*;

/// All distances between n things: symmetric, not negative, zero on the diagonal.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceMatrix {
    count: usize,
    /// Row by row, both halves.
    values: Vec<f64>,
}

impl DistanceMatrix {
    /// Asks `distance(a, b)` once for each a < b, in parallel.
    pub fn new(count: usize, distance: impl Fn(usize, usize) -> f64 + Sync) -> Self {
        let mut values = vec![0.0; count * count];
        let rows = values.par_chunks_mut(count.max(1)).enumerate();
        rows.for_each(|(a, row)| {
            for (b, value) in row.iter_mut().enumerate().skip(a + 1) {
                *value = distance(a, b);
            }
        });
        for a in 0..count {
            for b in 0..a {
                values[a * count + b] = values[b * count + a];
            }
        }
        Self { count, values }
    }

    /// The Euclidean distances between the rows of `points`, `width` numbers each.
    pub fn euclidean(points: &[f64], width: usize) -> Self {
        let row = |i: usize| &points[i * width..(i + 1) * width];
        Self::new(points.len() / width, |a, b| {
            let squares = row(a).iter().zip(row(b)).map(|(x, y)| (x - y).powi(2));
            squares.sum::<f64>().sqrt()
        })
    }

    /// How many things there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The distances of one to all.
    #[inline]
    pub fn row(&self, a: usize) -> &[f64] {
        &self.values[a * self.count..(a + 1) * self.count]
    }

    /// Between two. Panics beyond [`Self::count`].
    #[inline]
    pub fn get(&self, a: usize, b: usize) -> f64 {
        self.values[a * self.count + b]
    }

    /// The matrix of some of the things, in the order given.
    pub fn subset(&self, chosen: &[usize]) -> Self {
        let values = chosen
            .iter()
            .flat_map(|&a| chosen.iter().map(move |&b| self.get(a, b)))
            .collect();
        Self {
            count: chosen.len(),
            values,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn euclidean_distances_of_a_right_triangle() {
        let all = DistanceMatrix::euclidean(&[0.0, 0.0, 3.0, 0.0, 0.0, 4.0], 2);
        assert_eq!((all.count(), all.row(1)), (3, &[3.0, 0.0, 5.0][..]));
        assert_eq!(all.subset(&[2, 1]).row(0), [0.0, 5.0]);
        assert_eq!(all.get(2, 0), 4.0);
    }
}
