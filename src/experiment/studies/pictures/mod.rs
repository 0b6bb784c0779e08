//! Single images and what is made of them: [`estimates`] for Fig. 6, [`pipeline`] for Fig. 5.

pub mod estimates;
pub mod pipeline;

use crate::camera::{DepthImage, Image, Photographer};
use crate::dataset::{DataSet, Frame};
use crate::estimator::image::ImageEstimate;
use crate::estimator::look::Look;
use crate::experiment::figure::PicturePanel;
use crate::forest::pose_forest::PoseForest;
use crate::scene::{Rig, draw_arm};
use crate::training::seen::Seen;
use anyhow::{Context, Result};

/// The colours of the true pose and of the estimate: far apart for all readers.
pub(super) const TRUTH: [u8; 3] = [0, 114, 178];
pub(super) const ESTIMATE: [u8; 3] = [230, 159, 0];

/// What a forest says of every pixel of an image, and of the image.
struct Looked {
    /// The confidence of each pixel, and whether it is at least the threshold of eq. 12; `None` where
    /// depth is invalid.
    pixels: Vec<Option<(f32, bool)>>,
    estimate: ImageEstimate,
}

/// Estimates an image as [`EstimatesTask`](crate::experiment::tasks::estimates::EstimatesTask) does,
/// keeping what the pixels say; `step` is that of the relative threshold.
fn look(forest: &PoseForest, seen: &Seen, step: usize) -> Result<Looked> {
    let padded = seen.padded(forest.features());
    let depth = &seen.frame.depth;
    let look = Look::new(forest, depth, &padded, 1);
    let estimate = look
        .estimate(|_| false)
        .context("the image has no valid pixel")?;
    let mut pixels = vec![None; depth.pixels.len()];
    for (&at, looked) in look.pixels.iter().zip(look.chosen(&estimate, step)) {
        pixels[at] = Some(looked);
    }
    Ok(Looked { pixels, estimate })
}

impl Looked {
    /// Confidences from dark blue (the image's lowest) to red (its highest); black where depth is invalid
    /// or, with `chosen_only`, below the threshold.
    fn confidence_map(&self, title: &str, depth: &DepthImage, chosen_only: bool) -> PicturePanel {
        let (min, max) = (self.estimate.min_confidence, self.estimate.max_confidence);
        let colour = |pixel: &Option<(f32, bool)>| match pixel {
            Some((confidence, chosen)) if *chosen || !chosen_only => {
                let range = f64::from(max - min).max(f64::MIN_POSITIVE);
                warm(f64::from(confidence - min) / range)
            }
            _ => [0; 3],
        };
        PicturePanel {
            title: title.to_owned(),
            image: Image {
                width: depth.width,
                height: depth.height,
                pixels: self.pixels.iter().map(colour).collect(),
            },
        }
    }
}

/// From dark blue over white to red.
fn warm(x: f64) -> [u8; 3] {
    const COLOURS: [[f64; 3]; 5] = [
        [20.0, 30.0, 90.0],
        [90.0, 140.0, 200.0],
        [240.0, 240.0, 235.0],
        [240.0, 150.0, 100.0],
        [200.0, 20.0, 30.0],
    ];
    let place = x.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let below = (place as usize).min(COLOURS.len() - 2);
    let part = place - below as f64;
    std::array::from_fn(|i| {
        ((1.0 - part) * COLOURS[below][i] + part * COLOURS[below + 1][i]).round() as u8
    })
}

/// The depth image in grey, near is bright, with the arm drawn over it in given poses: filled
/// lightly, with a strong outline.
pub(super) fn overlay(
    title: &str,
    set: &DataSet,
    rig: &Rig,
    image: usize,
    frame: &Frame,
    poses: &[(&[f64], [u8; 3])],
) -> Result<PicturePanel> {
    let far = set.record().camera.range.far_m * 1000.0;
    let grey = |&mm: &u16| match mm {
        0 => [0; 3],
        mm => [(60.0 + 180.0 * (1.0 - f64::from(mm) / far)) as u8; 3],
    };
    let mut picture = Image {
        width: frame.depth.width,
        height: frame.depth.height,
        pixels: frame.depth.pixels.iter().map(grey).collect(),
    };
    let mut photographer = Photographer::new(&set.record().camera);
    let arm = (rig, set.target());
    for &(pose, colour) in poses {
        let mut configuration = set.configuration(image, &rig.robot)?;
        for (&dof, &value) in rig.arms[arm.1].joints.iter().zip(pose) {
            configuration[dof] = value;
        }
        let camera_from_root = set.camera_from_root_of(image);
        draw_arm(
            &mut picture,
            &mut photographer,
            arm,
            &configuration,
            camera_from_root,
            colour,
        );
    }
    Ok(PicturePanel {
        title: title.to_owned(),
        image: picture,
    })
}
