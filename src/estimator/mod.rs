//! Estimating: from the pixels' estimates to one pose of the arm, and how wrong it is.

pub mod error;
pub mod image;
pub mod inverse_kinematics;
