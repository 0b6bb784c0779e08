//! What a pose estimation forest sees of an image: all of it, or one arm only (section III-D).

use super::Training;
use crate::camera::{DepthImage, Image, LabelImage};
use crate::dataset::{DataSet, DataSetError, Frame, Pixel, draw_pixels, sample_pixels};
use crate::estimator::segmentation::masked;
use crate::feature::{DepthFeatures, PaddedDepth};
use crate::random::stream;

/// An image as a forest sees it.
pub struct Seen {
    /// With its depth as it is, or with that of one arm only.
    pub frame: Frame,
    /// How many pixels surely show the arm that is estimated; absent without segmentation.
    pub sure_pixels: Option<usize>,
    context: Option<Image<u8>>,
    is_segmented: bool,
}

impl Seen {
    /// All of it.
    pub fn whole(frame: Frame) -> Seen {
        Seen {
            frame,
            sure_pixels: None,
            context: None,
            is_segmented: false,
        }
    }

    /// Only the pixels of class `arm`: all others become invalid. `sure_pixels` surely show it.
    pub fn segmented(frame: Frame, classes: &LabelImage, arm: u8, sure_pixels: usize) -> Seen {
        let depth = masked(&frame.depth, |at| classes.pixels[at] == arm);
        Seen {
            frame: Frame { depth, ..frame },
            sure_pixels: Some(sure_pixels),
            context: None,
            is_segmented: true,
        }
    }

    /// All of it, with the share of the arm as context for further features
    /// ([`Extra::Context`](crate::feature::Extra::Context)).
    pub fn with_context(frame: Frame, share: Image<u8>, sure_pixels: usize) -> Seen {
        Seen {
            frame,
            sure_pixels: Some(sure_pixels),
            context: Some(share),
            is_segmented: false,
        }
    }

    /// Draws training pixels, in the order of the samples: `foreground` of either arm and `background`
    /// others; as many in all of what is left where the image is segmented, and none where nothing is
    /// left; all of the background where the image does not show the robot. Up to half of the
    /// background is drawn from `mistaken`, where the image is not segmented. `image` is its number in `set`, whose name and seed choose the pixels: they are the same for
    /// all forests.
    pub fn pixels(
        &self,
        training: &Training,
        set: &DataSet,
        image: usize,
        mistaken: &[Pixel],
    ) -> Result<Vec<Pixel>, DataSetError> {
        let record = set.record();
        let stage = format!("pixels of {}", record.name);
        let mut stream = stream(record.seed, &stage, &[image as u64]);
        let (foreground, background) = match record.images[image].without_robot {
            true => (0, training.samples_per_image()),
            false => (training.foreground, training.background),
        };
        if !self.is_segmented {
            let arms = set.arm_of_label();
            let hard = (background / 2).min(mistaken.len());
            let easy = background - hard;
            let mut drawn = sample_pixels(&self.frame, &arms, foreground, easy, &mut stream)?;
            drawn.extend(draw_pixels(mistaken, hard, &mut stream).unwrap_or_default());
            return Ok(drawn);
        }
        let DepthImage { width, pixels, .. } = &self.frame.depth;
        let left: Vec<Pixel> = (0..pixels.len())
            .filter(|&at| pixels[at] > 0)
            .map(|at| ((at % width) as u16, (at / width) as u16))
            .collect();
        Ok(draw_pixels(&left, training.samples_per_image(), &mut stream).unwrap_or_default())
    }

    /// The image as features read it.
    pub fn padded(&self, features: &DepthFeatures) -> PaddedDepth {
        let padded = PaddedDepth::new(&self.frame.depth, features.reach());
        match &self.context {
            Some(map) => padded.with_context(map),
            None => padded,
        }
    }
}
