//! The kinds of studies.

pub mod cross_validation;
pub mod sensor;
pub mod sets;
pub mod threshold_sweep;
pub mod tuning;
