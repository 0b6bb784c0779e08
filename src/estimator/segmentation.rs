//! Which arm each pixel shows, and an image of nothing but one arm (section III-D).

use crate::camera::{DepthImage, Image, Intrinsics, LabelImage};
use crate::feature::PaddedDepth;
use crate::forest::segmentation_forest::SegmentationForest;
use serde::{Deserialize, Serialize};

/// A pixel surely shows the arm when the arm's share is at least 0.85, which is nine of ten trees that
/// know nothing else. In 255ths.
pub const SURE_SHARE: u8 = 217;
/// An image shows the arm when at least so many of its pixels surely do: fewer are what the forest takes
/// for the arm where there is none. See DEVIATIONS.md.
pub const LEAST_ARM_PIXELS: usize = 600;

/// [`LEAST_ARM_PIXELS`] is of images of 640 x 480 pixels; this is in proportion to the area, at least 1.
pub fn least_arm_pixels(camera: &Intrinsics) -> usize {
    (LEAST_ARM_PIXELS * camera.width * camera.height / (640 * 480)).max(1)
}

/// What the segmentation forest says of an image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Segmentation {
    /// The class with the largest share at each pixel, of equals the first; 0 where depth is invalid.
    pub classes: LabelImage,
    /// The share of one class, in 255ths; 0 where depth is invalid.
    pub share: Image<u8>,
}

impl Segmentation {
    /// How many pixels surely show the class whose share is given.
    pub fn sure_pixels(&self) -> usize {
        let shares = self.share.pixels.iter();
        shares.filter(|&&share| share >= SURE_SHARE).count()
    }
}

/// Classifies the valid pixels of every `stride`-th row and column of an image, in parallel; the valid
/// pixels right of and below each get the same. `of` is the class whose share is wanted. Panics when the
/// forest has no such class, or more than 256, or when the stride is 0.
pub fn segment(
    forest: &SegmentationForest,
    depth: &DepthImage,
    of: usize,
    stride: usize,
) -> Segmentation {
    let (width, height) = (depth.width, depth.height);
    let padded = PaddedDepth::every(stride, depth, forest.features().reach());
    let places = (0..height).step_by(stride);
    let places = places.flat_map(|y| (0..width).step_by(stride).map(move |x| (x, y)));
    let is_valid = |&(x, y): &(usize, usize)| depth.pixels[y * width + x] > 0;
    let valid: Vec<(usize, usize)> = places.filter(is_valid).collect();
    let positions: Vec<u32> = valid.iter().map(|&(x, y)| padded.position(x, y)).collect();
    let shares = forest.shares(&forest.features().on(&padded), &positions);
    let blank = || Image {
        width,
        height,
        pixels: vec![0; depth.pixels.len()],
    };
    let (mut classes, mut share) = (blank(), blank());
    for (&(left, top), shares) in valid
        .iter()
        .zip(shares.chunks_exact(forest.classes().len()))
    {
        let (class, of) = (largest(shares) as u8, (shares[of] * 255.0).round() as u8);
        for y in top..height.min(top + stride) {
            for x in left..width.min(left + stride) {
                let at = y * width + x;
                if depth.pixels[at] > 0 {
                    (classes.pixels[at], share.pixels[at]) = (class, of);
                }
            }
        }
    }
    Segmentation { classes, share }
}

/// The class with the largest share, of equals the first; 0 when there are none.
pub(super) fn largest(shares: &[f32]) -> usize {
    let better = |best: usize, class: usize| match shares[class] > shares[best] {
        true => class,
        false => best,
    };
    (0..shares.len()).fold(0, better)
}

/// The image without the pixels that are not `kept`: they become invalid.
pub fn masked(depth: &DepthImage, kept: impl Fn(usize) -> bool) -> DepthImage {
    let pixel = |(at, &mm): (usize, &u16)| if kept(at) { mm } else { 0 };
    DepthImage {
        width: depth.width,
        height: depth.height,
        pixels: depth.pixels.iter().enumerate().map(pixel).collect(),
    }
}

/// How many valid pixels of each class (first index) were given each class (second index).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Confusion(pub Vec<Vec<usize>>);

impl Confusion {
    /// Of no pixels.
    pub fn new(classes: usize) -> Confusion {
        Confusion(vec![vec![0; classes]; classes])
    }

    /// Adds the counts of other pixels, of the same classes.
    pub fn add(&mut self, other: &Confusion) {
        for (row, others) in self.0.iter_mut().zip(&other.0) {
            row.iter_mut().zip(others).for_each(|(sum, n)| *sum += n);
        }
    }

    /// Pixels that are of a class.
    pub fn pixels(&self, class: usize) -> usize {
        self.0[class].iter().sum()
    }

    /// Pixels that were given a class.
    pub fn given(&self, class: usize) -> usize {
        self.0.iter().map(|row| row[class]).sum()
    }

    /// The share of the pixels given a class that are of it; NaN when none was given it.
    pub fn precision(&self, class: usize) -> f64 {
        self.0[class][class] as f64 / self.given(class) as f64
    }

    /// The share of the pixels of a class that were given it; NaN when there are none.
    pub fn recall(&self, class: usize) -> f64 {
        self.0[class][class] as f64 / self.pixels(class) as f64
    }

    /// The harmonic mean of precision and recall: the share of the pixels both given and of the class
    /// in the mean of those given and those of it.
    pub fn f1(&self, class: usize) -> f64 {
        let both = self.0[class][class] as f64;
        2.0 * both / (self.pixels(class) + self.given(class)) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{below, stream};

    /// By hand, and f1 by its definition.
    #[test]
    fn scores_of_a_known_confusion() {
        let confusion = Confusion(vec![vec![90, 10, 0], vec![5, 40, 5], vec![0, 10, 40]]);
        assert_eq!(confusion.pixels(1), 50);
        assert_eq!(confusion.given(1), 60);
        assert_eq!(confusion.recall(1), 0.8);
        assert_eq!(confusion.precision(0), 90.0 / 95.0);
        for class in 0..3 {
            let (p, r) = (confusion.precision(class), confusion.recall(class));
            assert!((confusion.f1(class) - 2.0 * p * r / (p + r)).abs() < 1e-15);
        }
        let mut twice = confusion.clone();
        twice.add(&confusion);
        assert_eq!(twice.f1(2), confusion.f1(2));
        assert_eq!(twice.pixels(0), 200);
    }

    #[test]
    fn masks_only_take_away() {
        let mut random = stream(1, "mask", &[]);
        let depth = DepthImage {
            width: 8,
            height: 5,
            pixels: (0..40)
                .map(|_| below(&mut random, 3) as u16 * 900)
                .collect(),
        };
        assert_eq!(masked(&depth, |_| true), depth);
        let odd = masked(&depth, |at| at % 2 == 1);
        for (at, &mm) in odd.pixels.iter().enumerate() {
            assert_eq!(mm, if at % 2 == 1 { depth.pixels[at] } else { 0 });
        }
    }
}
