//! Random forests over binned integer features. Knows nothing of robots, and while it grows nothing of
//! images: targets come in as tables, or as the distances between them.
//!
//! The way through: a [`SampleMatrix`](crate::feature::SampleMatrix) becomes [`bins`]; [`grow`]
//! grows [`tree`]s from them on an [`objective`]; [`leaves`] holds what the leaves say; a
//! [`PoseForest`](pose_forest::PoseForest), a
//! [`SegmentationForest`](segmentation_forest::SegmentationForest) or, for the baseline, a
//! [`PartForest`](part_forest::PartForest), whose leaves are [`retrofit`]ted, answers for pixels;
//! [`model_file`] keeps it all.

pub mod bins;
pub mod grow;
pub mod leaves;
pub mod model_file;
pub mod objective;
pub mod part_forest;
pub mod pose_forest;
pub mod retrofit;
pub mod segmentation_forest;
pub mod tree;

use crate::pose_space::MapError;

/// What cannot be learnt from. (What is wrong with a model file says
/// [`ModelError`](model_file::ModelError).)
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ForestError {
    #[error("there are no samples or no features to train on")]
    Empty,
    #[error("{what}: {got} given, {expected} expected")]
    Size {
        what: &'static str,
        got: usize,
        expected: usize,
    },
    #[error("{what}: {got} given, at most {most} can be handled")]
    TooMany {
        what: &'static str,
        got: usize,
        most: usize,
    },
    #[error("{0} must be at least 1")]
    Zero(&'static str),
    #[error("value {column} of target {target} is not a finite number")]
    NotFinite { target: usize, column: usize },
    #[error("forests of different features or classes cannot be joined")]
    Different,
    #[error("the confidence's bandwidth sigma is {0}; it must be a positive number")]
    Sigma(f64),
    #[error("the places of a pose's circular values must ascend and be less than {0}")]
    Circular(usize),
    #[error(transparent)]
    Map(#[from] MapError),
}
