//! The depth camera: images, intrinsics, rasteriser, projector shadow, disparity filter, noise.

use crate::robot::Mesh;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// A dense image, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image<T> {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<T>,
}

/// z-depth in millimetres, 0 = invalid.
pub type DepthImage = Image<u16>;
/// What is seen at a pixel: 0 = background, otherwise 1 + the index of a robot link.
pub type LabelImage = Image<u8>;

/// Pinhole model: the ray of pixel (column u, row v) is ((u - cx) / fx, (v - cy) / fy, 1), with
/// integer coordinates at pixel centres. Pixels; no distortion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Intrinsics {
    pub width: usize,
    pub height: usize,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
}

/// Something to be drawn.
#[derive(Debug, Clone, Copy)]
pub struct Body<'a> {
    pub mesh: &'a Mesh,
    pub camera_from_mesh: Isometry3<f64>,
    pub label: u8,
}
