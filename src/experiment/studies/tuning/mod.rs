//! Choosing parameters, on images that are used nowhere else: of the pose estimation [`forest`], and of
//! the [`parts`] baseline.

pub mod forest;
pub mod parts;
mod trial;
