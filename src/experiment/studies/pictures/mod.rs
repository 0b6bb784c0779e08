//! Single images and what is made of them: [`estimates`] for Fig. 6, [`pipeline`] for Fig. 5.

pub mod estimates;
pub mod pipeline;

use crate::camera::{DepthImage, Image, Photographer};
use crate::dataset::{DataSet, Frame};
use crate::estimator::image::{ImageEstimate, combine, highest_step};
use crate::experiment::figure::PicturePanel;
use crate::forest::pose_forest::PoseForest;
use crate::scene::{Rig, robot_bodies};
use crate::training::seen::Seen;
use anyhow::{Context, Result};

/// The colours of the true pose and of the estimate: far apart for all readers.
const TRUTH: [u8; 3] = [0, 114, 178];
const ESTIMATE: [u8; 3] = [230, 159, 0];

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
    let valid: Vec<usize> = (0..depth.pixels.len())
        .filter(|&at| depth.pixels[at] > 0)
        .collect();
    let position = |&at: &usize| padded.position(at % depth.width, at / depth.width);
    let positions: Vec<u32> = valid.iter().map(position).collect();
    let leaves = forest.find_leaves(&forest.features().on(&padded), &positions);
    let estimate = combine(forest, &leaves, &vec![false; valid.len()])
        .context("the image has no valid pixel")?;
    let (min, max) = (estimate.min_confidence, estimate.max_confidence);
    let mut pixels = vec![None; depth.pixels.len()];
    for (&at, confidence) in valid.iter().zip(leaves.confidences()) {
        let is_chosen = highest_step(confidence, min, max) >= step;
        pixels[at] = Some((confidence, is_chosen));
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
fn overlay(
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
    let mut pixels: Vec<[u8; 3]> = frame.depth.pixels.iter().map(grey).collect();
    let arm = &rig.arms[set.target()];
    let mut photographer = Photographer::new(&set.record().camera);
    for (pose, colour) in poses {
        let mut configuration = set.configuration(image, &rig.robot)?;
        for (&dof, &value) in arm.joints.iter().zip(*pose) {
            configuration[dof] = value;
        }
        let links = rig.robot.forward_kinematics(&configuration);
        let mut bodies = robot_bodies(rig, &links, set.camera_from_root_of(image));
        bodies.retain(|body| arm.links.iter().any(|&link| rig.label(link) == body.label));
        let drawn = photographer.draw(&bodies).labels;
        let (width, height) = (drawn.width, drawn.height);
        let inside = |x: usize, y: usize| drawn.pixels[y * width + x] > 0;
        for y in 0..height {
            for x in 0..width {
                if !inside(x, y) {
                    continue;
                }
                let around = (y.saturating_sub(2)..height.min(y + 3))
                    .flat_map(|v| (x.saturating_sub(2)..width.min(x + 3)).map(move |u| (u, v)));
                let is_edge = around.into_iter().any(|(u, v)| !inside(u, v));
                let share = if is_edge { 1.0 } else { 0.3 };
                let pixel = &mut pixels[y * width + x];
                *pixel = std::array::from_fn(|i| {
                    (f64::from(pixel[i]) * (1.0 - share) + f64::from(colour[i]) * share) as u8
                });
            }
        }
    }
    Ok(PicturePanel {
        title: title.to_owned(),
        image: Image {
            width: frame.depth.width,
            height: frame.depth.height,
            pixels,
        },
    })
}
