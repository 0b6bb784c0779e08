//! The tasks that studies share.

pub mod data_set;
pub mod estimates;
pub mod pose_forest;
