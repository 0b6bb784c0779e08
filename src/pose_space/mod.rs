//! The space of poses: how far one pose is from another, and maps of poses to points whose
//! Euclidean distances say the same.

pub mod classical_scaling;
pub mod co_ranking;
pub mod disp;
pub mod hull;
pub mod kernel_pca;
pub mod spectral;
pub mod tsne;

/// Distances that cannot be mapped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MapError {
    #[error("the distance between {a} and {b} is not a finite number")]
    NotFinite { a: usize, b: usize },
    #[error("the eigenvalues of a matrix of {count} x {count} numbers were not found")]
    Eigenvalues { count: usize },
    #[error("the kernel's bandwidth sigma is {0}; it must be a positive number")]
    Sigma(f64),
    #[error(
        "perplexity {perplexity} among {count} things: choose at least 1 and less than {count} - 1"
    )]
    Perplexity { perplexity: f64, count: usize },
}
