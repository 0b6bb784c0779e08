//! The kinds of studies.

pub mod confidence;
pub mod cross_validation;
pub mod sensor;
pub mod sets;
pub mod threshold_sweep;
pub mod training_time;
pub mod tuning;
