//! Estimating: which pixels show the arm, from the pixels' estimates to one pose of it, and how wrong
//! that is.

pub mod error;
pub mod image;
pub mod inverse_kinematics;
pub mod look;
pub mod part_baseline;
pub mod segmentation;
