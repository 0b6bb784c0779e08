//! The kinds of studies.

pub mod confidence;
pub mod cross_validation;
pub mod learning_curve;
pub mod map_quality;
pub mod metric_example;
pub mod part_baseline;
pub mod pictures;
pub mod pose_map;
pub mod real_images;
pub mod segmentation;
pub mod sensor;
pub mod sets;
pub mod speed;
pub mod threshold_sweep;
pub mod training_time;
pub mod tuning;
pub mod wsc_example;
