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
    /// the forest's features read it.
    pub fn new(
        forest: &'a PoseForest,
        depth: &DepthImage,
        padded: &PaddedDepth,
        stride: usize,
    ) -> Look<'a> {
        let takes_part = |&at: &usize| {
            let (x, y) = (at % depth.width, at / depth.width);
            depth.pixels[at] > 0 && x % stride == 0 && y % stride == 0
        };
        let pixels: Vec<usize> = (0..depth.pixels.len()).filter(takes_part).collect();
        let position = |&at: &usize| padded.position(at % depth.width, at / depth.width);
        let positions: Vec<u32> = pixels.iter().map(position).collect();
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
