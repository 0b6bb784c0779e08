//! Kernel PCA on distances (Schoelkopf et al. 1999) with the kernel of section III-B4.

use super::MapError;
use super::classical_scaling::positive_coordinates;
use crate::distances::DistanceMatrix;

/// `dimensions` coordinates for each thing, row by row: the eigenvectors v_k of the centred Gram
/// matrix G_ab = exp(-D_ab^2 / sigma) (eq. 11), times sqrt(lambda_k), the largest lambda_k first.
/// Sigma has the unit of D^2. In each dimension the coordinate of the largest magnitude is positive.
///
/// DISP is not Euclidean, so that some eigenvalues are negative; they are left out. Where there are
/// fewer than `dimensions` positive ones the rest are zeros.
///
/// When sigma is large against D^2 this is classical scaling times sqrt(2 / sigma): G is then
/// 1 - D^2 / sigma, and centring removes the 1.
pub fn kernel_pca(
    distances: &DistanceMatrix,
    sigma: f64,
    dimensions: usize,
) -> Result<Vec<f64>, MapError> {
    if !(sigma.is_finite() && sigma > 0.0) {
        return Err(MapError::Sigma(sigma));
    }
    positive_coordinates(distances, |d| (-d * d / sigma).exp(), dimensions)
}

#[cfg(test)]
mod tests {
    use super::super::classical_scaling::classical_scaling;
    use super::super::classical_scaling::tests::{deviation, random_points};
    use super::*;

    /// With all dimensions the distance between two points is that of the feature space of the
    /// kernel, which is positive definite for Euclidean distances: |a - b|^2 = 2 - 2 G_ab.
    #[test]
    fn all_dimensions_give_the_distances_of_the_feature_space() {
        let distances = DistanceMatrix::euclidean(&random_points(1, 40, 3), 3);
        let points = kernel_pca(&distances, 0.7, 40).unwrap();
        let expected = DistanceMatrix::new(40, |a, b| {
            (2.0 - 2.0 * (-distances.get(a, b).powi(2) / 0.7).exp()).sqrt()
        });
        assert!(deviation(&DistanceMatrix::euclidean(&points, 40), &expected) < 1e-9);
    }

    #[test]
    fn small_distances_give_classical_scaling() {
        let distances = DistanceMatrix::euclidean(&random_points(2, 50, 4), 4);
        let deviation = |sigma: f64| {
            let mapped = kernel_pca(&distances, sigma, 4).unwrap();
            let flat = classical_scaling(&distances, 4).unwrap();
            let scale = (2.0 / sigma).sqrt();
            let pairs = mapped.iter().zip(&flat);
            pairs
                .map(|(x, y)| (x / scale - y).abs())
                .fold(0.0, f64::max)
        };
        assert!(deviation(1e3) > 1e-4);
        // The next term of the kernel is D^2 / sigma smaller.
        assert!(deviation(1e8) < 1e-6);
    }

    #[test]
    fn sigma_must_be_positive() {
        let distances = DistanceMatrix::new(3, |_, _| 1.0);
        assert_eq!(kernel_pca(&distances, 0.0, 2), Err(MapError::Sigma(0.0)));
        assert!(kernel_pca(&distances, f64::NAN, 2).is_err());
    }
}
