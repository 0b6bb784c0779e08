//! Classical scaling (Torgerson 1952; Gower 1966, principal coordinates): points whose Euclidean
//! distances are the given ones, as far as these are Euclidean.

use super::MapError;
use crate::distances::DistanceMatrix;
use faer::{Mat, Side};

/// Points in a space where some dimensions count negatively.
#[derive(Debug, Clone, PartialEq)]
pub struct SignedPoints {
    /// +1 or -1 for each dimension, those of the largest eigenvalues by magnitude first.
    pub signs: Vec<f64>,
    /// A row of coordinates for each thing, as long as `signs`.
    pub points: Vec<f64>,
}

/// Points in at most `dimensions` of the dimensions in which D_ab^2 = sum_k s_k (x_ak - x_bk)^2
/// holds exactly when all are taken. The signs s_k are those of the eigenvalues of -J D^2 J / 2,
/// J = I - 11^T / n; distances that no Euclidean space has show in negative ones. Points are centred;
/// in each dimension the coordinate of the largest magnitude is positive.
pub fn signed_scaling(
    distances: &DistanceMatrix,
    dimensions: usize,
) -> Result<SignedPoints, MapError> {
    let mut axes = principal_axes(distances, half_square)?;
    axes.sort_by(|a, b| b.value.abs().total_cmp(&a.value.abs()));
    axes.truncate(dimensions);
    Ok(SignedPoints {
        signs: axes.iter().map(|axis| axis.value.signum()).collect(),
        points: coordinates(&axes, distances.count(), axes.len()),
    })
}

/// `dimensions` coordinates for each thing, row by row: the positive part of [`signed_scaling`],
/// the largest eigenvalue first. Where there are fewer positive eigenvalues the rest are zeros.
pub fn classical_scaling(
    distances: &DistanceMatrix,
    dimensions: usize,
) -> Result<Vec<f64>, MapError> {
    positive_coordinates(distances, half_square, dimensions)
}

/// The inner product of two points at distance D, but for terms that centring removes.
fn half_square(distance: f64) -> f64 {
    -0.5 * distance * distance
}

/// The leading coordinates of things whose inner products are `product(D)`, as
/// [`classical_scaling`] wants them.
pub(super) fn positive_coordinates(
    distances: &DistanceMatrix,
    product: impl Fn(f64) -> f64,
    dimensions: usize,
) -> Result<Vec<f64>, MapError> {
    let mut axes = principal_axes(distances, product)?;
    axes.retain(|axis| axis.value > 0.0);
    Ok(coordinates(&axes, distances.count(), dimensions))
}

/// An eigenvalue and its unit vector, whose largest component (the first of equals) is positive.
struct Axis {
    value: f64,
    vector: Vec<f64>,
}

/// The axes of J G J with G_ab = `product(D_ab)`, falling eigenvalues, without those that are zero
/// but for rounding.
fn principal_axes(
    distances: &DistanceMatrix,
    product: impl Fn(f64) -> f64,
) -> Result<Vec<Axis>, MapError> {
    let count = distances.count();
    require_finite(distances)?;
    let mut matrix = Mat::from_fn(count, count, |a, b| product(distances.get(a, b)));
    let means: Vec<f64> = (0..count)
        .map(|a| (0..count).map(|b| matrix[(a, b)]).sum::<f64>() / count as f64)
        .collect();
    let mean = means.iter().sum::<f64>() / count as f64;
    for a in 0..count {
        for b in 0..count {
            matrix[(a, b)] += mean - (means[a] + means[b]);
        }
    }
    let eigen = matrix
        .self_adjoint_eigen(Side::Lower)
        .map_err(|_| MapError::Eigenvalues { count })?;
    let values = eigen.S().column_vector();
    let largest = values.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let noise = count as f64 * f64::EPSILON * largest;
    let axis = |k: usize| {
        let vector: Vec<f64> = eigen.U().col(k).iter().copied().collect();
        let tip = vector.iter().fold(
            0.0,
            |tip: f64, &v| if v.abs() > tip.abs() { v } else { tip },
        );
        let sign = tip.signum();
        Axis {
            value: values[k],
            vector: vector.iter().map(|v| sign * v).collect(),
        }
    };
    let kept = (0..count).rev().filter(|&k| values[k].abs() > noise);
    Ok(kept.map(axis).collect())
}

/// v_k sqrt|lambda_k|, a row of `width` for each thing, padded with zeros.
fn coordinates(axes: &[Axis], count: usize, width: usize) -> Vec<f64> {
    let mut points = vec![0.0; count * width];
    for (k, axis) in axes.iter().take(width).enumerate() {
        let scale = axis.value.abs().sqrt();
        for (a, v) in axis.vector.iter().enumerate() {
            points[a * width + k] = scale * v;
        }
    }
    points
}

pub(super) fn require_finite(distances: &DistanceMatrix) -> Result<(), MapError> {
    for a in 0..distances.count() {
        if let Some(b) = distances.row(a).iter().position(|d| !d.is_finite()) {
            return Err(MapError::NotFinite { a, b });
        }
    }
    Ok(())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::random::{normal, stream, uniform};

    pub fn random_points(seed: u64, count: usize, width: usize) -> Vec<f64> {
        let mut s = stream(seed, "points", &[]);
        (0..count * width).map(|_| normal(&mut s)).collect()
    }

    /// The largest difference between two matrices of distances.
    pub fn deviation(one: &DistanceMatrix, other: &DistanceMatrix) -> f64 {
        let rows = (0..one.count()).flat_map(|a| one.row(a).iter().zip(other.row(a)));
        rows.map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn euclidean_distances_are_recovered() {
        for (seed, width) in [(1, 1), (2, 3), (3, 15)] {
            let distances = DistanceMatrix::euclidean(&random_points(seed, 60, width), width);
            let points = classical_scaling(&distances, width).unwrap();
            let again = DistanceMatrix::euclidean(&points, width);
            assert!(deviation(&distances, &again) < 1e-9);
            // More dimensions than the points have change nothing, and none of them is negative.
            let signed = signed_scaling(&distances, width + 5).unwrap();
            assert_eq!((&signed.points, signed.signs), (&points, vec![1.0; width]));
            let padded = classical_scaling(&distances, width + 2).unwrap();
            assert!(
                padded
                    .chunks(width + 2)
                    .all(|row| row[width..] == [0.0, 0.0])
            );
        }
    }

    #[test]
    fn points_are_centred_on_their_principal_axes_and_the_signs_are_fixed() {
        let points = random_points(4, 50, 4);
        let scaled: Vec<f64> = (points.iter().enumerate())
            .map(|(i, x)| x * [5.0, 1.0, 3.0, 2.0][i % 4] + 7.0)
            .collect();
        let found = classical_scaling(&DistanceMatrix::euclidean(&scaled, 4), 4).unwrap();
        let column = |k: usize| -> Vec<f64> { found.iter().skip(k).step_by(4).copied().collect() };
        let product = |k: usize, l: usize| -> f64 {
            column(k).iter().zip(column(l)).map(|(x, y)| x * y).sum()
        };
        for k in 0..4 {
            assert!(column(k).iter().sum::<f64>().abs() < 1e-9);
            let tip = column(k)
                .into_iter()
                .max_by(|x, y| x.abs().total_cmp(&y.abs()));
            assert!(tip.unwrap() > 0.0);
            assert!(k == 0 || product(k, k) < product(k - 1, k - 1));
            assert!((0..k).all(|l| product(k, l).abs() < 1e-9));
        }
    }

    /// Any symmetric matrix with a zero diagonal is a signed sum of squares.
    #[test]
    fn all_signed_dimensions_give_any_distances_exactly() {
        let mut s = stream(5, "signed", &[]);
        let values: Vec<f64> = (0..40 * 40).map(|_| uniform(&mut s, 0.1, 2.0)).collect();
        let distances = DistanceMatrix::new(40, |a, b| values[a * 40 + b]);
        let signed = signed_scaling(&distances, 40).unwrap();
        let width = signed.signs.len();
        assert!(signed.signs.contains(&-1.0) && signed.signs.contains(&1.0));
        let row = |a: usize| &signed.points[a * width..(a + 1) * width];
        for a in 0..40 {
            for b in 0..40 {
                let terms = signed.signs.iter().zip(row(a)).zip(row(b));
                let square: f64 = terms.map(|((s, x), y)| s * (x - y).powi(2)).sum();
                assert!((square - distances.get(a, b).powi(2)).abs() < 1e-12);
            }
        }
        // Eigenvalues fall in magnitude, and classical scaling takes the positive ones in order.
        let square = |k: usize| -> f64 { (0..40).map(|a| row(a)[k].powi(2)).sum() };
        assert!((1..width).all(|k| square(k) <= square(k - 1) * (1.0 + 1e-12)));
        let positive: Vec<usize> = (0..width).filter(|&k| signed.signs[k] > 0.0).collect();
        let classical = classical_scaling(&distances, 6).unwrap();
        for (a, found) in classical.chunks(6).enumerate() {
            assert!((0..6).all(|k| found[k] == row(a)[positive[k]]));
        }
    }

    #[test]
    fn few_things_and_unusable_distances() {
        let none = DistanceMatrix::new(0, |_, _| 0.0);
        assert!(classical_scaling(&none, 2).unwrap().is_empty());
        let same = DistanceMatrix::new(3, |_, _| 0.0);
        assert_eq!(classical_scaling(&same, 2).unwrap(), [0.0; 6]);
        let broken = DistanceMatrix::new(3, |a, b| if (a, b) == (0, 2) { f64::NAN } else { 1.0 });
        let error = classical_scaling(&broken, 2);
        assert_eq!(error, Err(MapError::NotFinite { a: 0, b: 2 }));
    }
}
