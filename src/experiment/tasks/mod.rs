//! The tasks that studies share.

pub mod data_set;
pub mod distances;
pub mod estimates;
pub mod estimation_times;
pub mod frame_times;
pub mod growth_times;
pub mod model;
pub mod part_estimates;
pub mod part_forest;
pub mod pose_forest;
pub mod pose_maps;
pub mod segmentation;
pub mod segmentation_forest;
pub mod sight;
pub mod training_times;
pub mod walk_times;
pub mod wsc_nodes;
