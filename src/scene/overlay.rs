//! An arm drawn over an image, to see whether a pose fits.

use super::{Rig, robot_bodies};
use crate::camera::{DepthImage, Image, Photographer, Range};
use nalgebra::Isometry3;

/// The colours of Fig. 12: the arm as it is known to be, grey, and as it is estimated, blue. Both are bright
/// enough for a black background.
pub const KNOWN: [u8; 3] = [215, 215, 215];
pub const ESTIMATED: [u8; 3] = [60, 140, 255];

/// A depth image in orange: near is bright, what is invalid or beyond the range is black.
pub fn cloud(depth: &DepthImage, range: &Range) -> Image<[u8; 3]> {
    let colour = |&mm: &u16| {
        if !range.holds(mm) {
            return [0; 3];
        }
        let share = (f64::from(mm) / 1000.0 - range.near_m) / (range.far_m - range.near_m);
        let light = 1.0 - 0.75 * share.sqrt();
        [255.0, 170.0, 80.0].map(|c: f64| (c * light) as u8)
    };
    Image {
        width: depth.width,
        height: depth.height,
        pixels: depth.pixels.iter().map(colour).collect(),
    }
}

/// Draws an arm of a robot over a picture of the photographer's size: filled lightly, with a strong
/// outline. `configuration` poses the whole robot.
pub fn draw_arm(
    picture: &mut Image<[u8; 3]>,
    photographer: &mut Photographer,
    (rig, arm): (&Rig, usize),
    configuration: &[f64],
    camera_from_root: &Isometry3<f64>,
    colour: [u8; 3],
) {
    let links = rig.robot.forward_kinematics(configuration);
    let mut bodies = robot_bodies(rig, &links, camera_from_root);
    let arm = &rig.arms[arm];
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
            let pixel = &mut picture.pixels[y * width + x];
            *pixel = std::array::from_fn(|i| {
                (f64::from(pixel[i]) * (1.0 - share) + f64::from(colour[i]) * share) as u8
            });
        }
    }
}
