//! What a pose estimation forest says of the valid pixels of an image.

use super::image::{ImageEstimate, combine, highest_step};
use crate::camera::DepthImage;
use crate::feature::PaddedDepth;
use crate::forest::pose_forest::{PixelLeaves, PoseForest};

/// The pixels that take part in an estimate.
pub struct Look<'a> {
    forest: &'a PoseForest,
    /// Their numbers, counted row by row, ascending.
    pub pixels: Vec<usize>,
    pub leaves: PixelLeaves<'a>,
}

impl<'a> Look<'a> {
    /// Finds the leaves of the valid pixels of every `stride`-th row and column. `padded` is `depth` as
    /// the forest's features read it, at every column that takes part.
    pub fn new(
        forest: &'a PoseForest,
        depth: &DepthImage,
        padded: &PaddedDepth,
        stride: usize,
    ) -> Look<'a> {
        let columns = || (0..depth.width).step_by(stride);
        let rows = (0..depth.height).step_by(stride);
        let (mut pixels, mut positions) = (Vec::new(), Vec::new());
        for (x, y) in rows.flat_map(|y| columns().map(move |x| (x, y))) {
            let at = y * depth.width + x;
            if depth.pixels[at] > 0 {
                pixels.push(at);
                positions.push(padded.position(x, y));
            }
        }
        Look {
            forest,
            pixels,
            leaves: forest.find_leaves(&forest.features().on(padded), &positions),
        }
    }

    /// One pose, see [`combine`]; `shows_arm` of a pixel's number is only counted. `None` when no pixel
    /// takes part.
    pub fn estimate(&self, shows_arm: impl Fn(usize) -> bool) -> Option<ImageEstimate> {
        let foreground: Vec<bool> = self.pixels.iter().map(|&at| shows_arm(at)).collect();
        combine(self.forest, &self.leaves, &foreground)
    }

    /// Of each pixel its confidence, and whether it is chosen at the `step` of `estimate`'s thresholds
    /// (eq. 12).
    pub fn chosen(&self, estimate: &ImageEstimate, step: usize) -> Vec<(f32, bool)> {
        let (min, max) = (estimate.min_confidence, estimate.max_confidence);
        let chosen = |c: f32| (c, highest_step(c, min, max) >= step);
        self.leaves.confidences().into_iter().map(chosen).collect()
    }
}
