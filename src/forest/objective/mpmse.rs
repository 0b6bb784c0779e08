//! Mapped point mean squared error: eq. 5 on m(y) in place of y (eq. 10), for several maps m. Splits
//! do not depend on the scale of a map.

use super::{Made, mse::mse_of};
use crate::distances::DistanceMatrix;
use crate::forest::grow::TargetTable;
use crate::pose_space::classical_scaling::classical_scaling;
use crate::pose_space::kernel_pca::kernel_pca;
use crate::pose_space::tsne::{self, TsneSpec};
use std::borrow::Cow;

/// t-SNE with at most a third of the other poses for neighbours, since with more of them there is
/// little choice.
pub fn tsne(distances: &DistanceMatrix, dimensions: usize, perplexity: f64) -> Made<'_> {
    let others = distances.count().saturating_sub(1) as f64;
    let spec = TsneSpec {
        dimensions,
        perplexity: perplexity.min(others / 3.0),
        degrees_of_freedom: 1,
    };
    mpmse(tsne::tsne(distances, spec)?, dimensions)
}

/// Kernel PCA with the kernel of eq. 11, `sigma` in square metres.
pub fn kpca(distances: &DistanceMatrix, dimensions: usize, sigma: f64) -> Made<'_> {
    mpmse(kernel_pca(distances, sigma, dimensions)?, dimensions)
}

/// Classical scaling, which kernel PCA nearly is when sigma is large.
pub fn mds(distances: &DistanceMatrix, dimensions: usize) -> Made<'_> {
    mpmse(classical_scaling(distances, dimensions)?, dimensions)
}

/// Eq. 10 on `points`, which holds m(y) for each target y, `dimensions` numbers each.
fn mpmse<'a>(points: Vec<f64>, dimensions: usize) -> Made<'a> {
    mse_of(Cow::Owned(TargetTable::new(dimensions, points)?))
}
