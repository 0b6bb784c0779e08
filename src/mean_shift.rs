//! Mean shift: where weighted points in space are densest.
//!
//! The density is `sum_i w_i max(0, 1 - |x - x_i|^2 / (9 b^2))^9`. It follows the usual
//! `sum_i w_i exp(-|x - x_i|^2 / b^2)` to 0.032 of each point's peak, but ends at 3 b and needs no
//! exponential, so that it is fast and has the same bits everywhere.

use std::cmp::Ordering;

/// A point and how much it counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeightedPoint {
    pub at: [f64; 3],
    pub weight: f64,
}

impl WeightedPoint {
    /// The heavier first; of equals the one with the lower coordinates.
    pub fn heavier_first(&self, other: &Self) -> Ordering {
        let axes = || self.at.iter().zip(&other.at);
        let places = axes().map(|(a, b)| a.total_cmp(b));
        let place = places.fold(Ordering::Equal, Ordering::then);
        other.weight.total_cmp(&self.weight).then(place)
    }
}

/// A climb ends when a step is shorter than so many bandwidths,
const STANDSTILL: f64 = 1e-3;
/// when it comes within so many bandwidths of a mode that is known,
const JOINED: f64 = 0.25;
/// or after so many steps.
const MOST_STEPS: usize = 200;

/// The local maxima of the density that are reached from the points, each weighing as much as the
/// points that climb to it: the heaviest first, of equals the one that was reached first. Climbs
/// begin at the heaviest points. The order of the points does not matter; those whose weight is not
/// positive are left out.
pub fn modes(points: &[WeightedPoint], bandwidth: f64) -> Vec<WeightedPoint> {
    let mut points = points.to_vec();
    points.retain(|point| point.weight > 0.0);
    points.sort_unstable_by(WeightedPoint::heavier_first);
    let near = (JOINED * bandwidth).powi(2);
    let mut modes: Vec<WeightedPoint> = Vec::new();
    for start in &points {
        let mut at = start.at;
        let mut known = None;
        for _ in 0..MOST_STEPS {
            known = modes.iter().position(|mode| square(mode.at, at) < near);
            let from = at;
            if known.is_none() {
                at = uphill(&points, from, bandwidth);
            }
            if known.is_some() || square(at, from) < (STANDSTILL * bandwidth).powi(2) {
                break;
            }
        }
        match known {
            Some(mode) => modes[mode].weight += start.weight,
            None => modes.push(WeightedPoint {
                at,
                weight: start.weight,
            }),
        }
    }
    modes.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    modes
}

fn square(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)
}

/// The mean of the points, weighted by the slope of their part of the density over their distance:
/// the density is nowhere lower there than at `from`.
fn uphill(points: &[WeightedPoint], from: [f64; 3], bandwidth: f64) -> [f64; 3] {
    let scale = 1.0 / (3.0 * bandwidth).powi(2);
    let (mut shift, mut sum) = ([0.0; 3], 0.0);
    for point in points {
        let way: [f64; 3] = std::array::from_fn(|axis| point.at[axis] - from[axis]);
        let distance = way[0] * way[0] + way[1] * way[1] + way[2] * way[2];
        let inside = (1.0 - distance * scale).max(0.0);
        let fourth = (inside * inside) * (inside * inside);
        let weight = point.weight * (fourth * fourth);
        sum += weight;
        (0..3).for_each(|axis| shift[axis] += weight * way[axis]);
    }
    std::array::from_fn(|axis| from[axis] + shift[axis] / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Stream, below, normal, shuffle, stream, uniform};

    fn density(points: &[WeightedPoint], b: f64, x: [f64; 3]) -> f64 {
        let part = |p: &WeightedPoint| {
            let inside = 1.0 - square(p.at, x) / (9.0 * b * b);
            p.weight * inside.max(0.0).powi(9)
        };
        points.iter().map(part).sum()
    }

    /// Some heaps of points, about as wide as a bandwidth of 0.05.
    fn cloud(random: &mut Stream) -> Vec<WeightedPoint> {
        let mut points = Vec::new();
        for _ in 0..1 + below(random, 3) {
            let centre: [f64; 3] = std::array::from_fn(|_| uniform(random, 0.0, 0.3));
            for _ in 0..10 + below(random, 30) {
                points.push(WeightedPoint {
                    at: centre.map(|x| x + 0.03 * normal(random)),
                    weight: uniform(random, 0.1, 1.0),
                });
            }
        }
        points
    }

    /// The densest place of a fine grid is within a cell of a mode, no place of the grid is denser
    /// than that mode, no mode can be left uphill, and all points have climbed to one.
    #[test]
    fn modes_are_the_maxima_of_the_density() {
        let (b, cell) = (0.05, 0.01);
        for seed in 0..10 {
            let points = cloud(&mut stream(seed, "cloud", &[]));
            let modes = modes(&points, b);
            let axis = |i: usize| -0.15 + cell * i as f64;
            let mut best = (0.0, [0.0; 3]);
            for i in 0..60usize.pow(3) {
                let x = [axis(i / 3600), axis(i / 60 % 60), axis(i % 60)];
                let density = density(&points, b, x);
                if density > best.0 {
                    best = (density, x);
                }
            }
            let nearest = modes
                .iter()
                .min_by(|m, n| square(m.at, best.1).total_cmp(&square(n.at, best.1)))
                .unwrap();
            assert!(square(nearest.at, best.1).sqrt() < 3f64.sqrt() * cell);
            assert!(density(&points, b, nearest.at) >= best.0);
            for mode in &modes {
                let here = density(&points, b, mode.at);
                for axis in 0..3 {
                    for step in [-0.1 * b, 0.1 * b] {
                        let mut beside = mode.at;
                        beside[axis] += step;
                        assert!(density(&points, b, beside) < here);
                    }
                }
            }
            let sum = |points: &[WeightedPoint]| points.iter().map(|p| p.weight).sum::<f64>();
            assert!((sum(&points) - sum(&modes)).abs() < 1e-9);
            assert!(modes.is_sorted_by(|a, b| a.weight >= b.weight));
        }
    }

    #[test]
    fn the_order_of_the_points_does_not_matter_and_modes_move_with_them() {
        let mut random = stream(1, "moved", &[]);
        for _ in 0..20 {
            let points = cloud(&mut random);
            let found = modes(&points, 0.05);
            let mut shuffled = points.clone();
            shuffle(&mut random, &mut shuffled);
            assert_eq!(modes(&shuffled, 0.05), found);

            let shift: [f64; 3] = std::array::from_fn(|_| uniform(&mut random, -2.0, 2.0));
            let moved: Vec<WeightedPoint> = points
                .iter()
                .map(|p| WeightedPoint {
                    at: std::array::from_fn(|axis| p.at[axis] + shift[axis]),
                    weight: 3.0 * p.weight,
                })
                .collect();
            let moved = modes(&moved, 0.05);
            assert_eq!(moved.len(), found.len());
            for (a, b) in found.iter().zip(&moved) {
                let back: [f64; 3] = std::array::from_fn(|axis| b.at[axis] - shift[axis]);
                assert!(square(a.at, back).sqrt() < 1e-9);
                assert!((3.0 * a.weight - b.weight).abs() < 1e-9);
            }
        }
    }

    /// Two heaps far from each other, and points that do not count.
    #[test]
    fn modes_weigh_what_climbs_to_them() {
        let point = |x: f64, weight| WeightedPoint {
            at: [x, 0.0, 1.0],
            weight,
        };
        let points = [
            point(0.00, 1.0),
            point(0.02, 1.0),
            point(1.0, 1.5),
            point(2.0, 0.0),
        ];
        let found = modes(&points, 0.05);
        assert_eq!(found.len(), 2);
        assert!(square(found[0].at, [0.01, 0.0, 1.0]) < 1e-8);
        assert_eq!((found[0].weight, found[1]), (2.0, point(1.0, 1.5)));
        assert!(modes(&points[3..], 0.05).is_empty());
    }
}
