//! Which images and which pixels a forest is trained on.

use super::{DataSetError, Frame};
use crate::random::{Stream, sample_sorted, shuffle, stream};

/// Column and row.
pub type Pixel = (u16, u16);

/// Splits images into `k` folds at random: sets of images, ascending, whose sizes differ by at most
/// one. All studies of one seed share their folds.
pub fn folds(images: usize, k: usize, seed: u64) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..images).collect();
    shuffle(
        &mut stream(seed, "folds", &[images as u64, k as u64]),
        &mut order,
    );
    let fold = |first: usize| {
        let mut fold: Vec<usize> = order.iter().copied().skip(first).step_by(k).collect();
        fold.sort_unstable();
        fold
    };
    (0..k).map(fold).collect()
}

/// Draws pixels of a frame (paper, IV-A): first `foreground` pixels that show any arm, then
/// `background` others, all with valid depth, as [`draw_pixels`] does.
/// `arm_of_label` comes from [`super::DataSet::arm_of_label`].
pub fn sample_pixels(
    frame: &Frame,
    arm_of_label: &[Option<usize>; 256],
    foreground: usize,
    background: usize,
    stream: &mut Stream,
) -> Result<Vec<Pixel>, DataSetError> {
    let (mut robot, mut other) = (Vec::new(), Vec::new());
    let width = frame.depth.width;
    let pixels = frame.depth.pixels.iter().zip(&frame.labels.pixels);
    for (index, (&depth, &label)) in pixels.enumerate() {
        if depth > 0 {
            let pixel = ((index % width) as u16, (index / width) as u16);
            match arm_of_label[usize::from(label)] {
                Some(_) => robot.push(pixel),
                None => other.push(pixel),
            }
        }
    }
    let mut drawn = draw_pixels(&robot, foreground, stream)
        .ok_or(DataSetError::NoPixels { what: "foreground" })?;
    drawn.extend(
        draw_pixels(&other, background, stream)
            .ok_or(DataSetError::NoPixels { what: "background" })?,
    );
    Ok(drawn)
}

/// Draws `count` of the candidates without replacement, in their order. When there are fewer, all
/// are taken and the rest is drawn again, so that every candidate is taken as often as any other,
/// give or take one. `None` when pixels are asked for and there is no candidate.
pub fn draw_pixels(candidates: &[Pixel], count: usize, stream: &mut Stream) -> Option<Vec<Pixel>> {
    if candidates.is_empty() {
        return (count == 0).then(Vec::new);
    }
    let mut drawn = Vec::with_capacity(count);
    while count - drawn.len() >= candidates.len() {
        drawn.extend_from_slice(candidates);
    }
    let rest = sample_sorted(stream, candidates.len(), count - drawn.len());
    drawn.extend(rest.into_iter().map(|i| candidates[i]));
    Some(drawn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Image;
    use crate::random::below;
    use std::collections::BTreeMap;

    #[test]
    fn folds_part_the_images_evenly() {
        for (images, k) in [(200, 5), (7, 3), (12, 12), (10, 1)] {
            let folds = folds(images, k, 1);
            assert_eq!(folds.len(), k);
            let mut all: Vec<usize> = folds.concat();
            all.sort_unstable();
            assert_eq!(all, (0..images).collect::<Vec<_>>());
            for fold in &folds {
                assert!(fold.is_sorted());
                assert!((images / k..=images.div_ceil(k)).contains(&fold.len()));
            }
        }
        assert_ne!(folds(200, 5, 1), folds(200, 5, 2));
        assert_eq!(folds(200, 5, 1), folds(200, 5, 1));
    }

    /// Label 1 is one arm, 2 the other, 3 nobody's.
    fn arms() -> [Option<usize>; 256] {
        let mut table = [None; 256];
        (table[1], table[2]) = (Some(0), Some(1));
        table
    }

    fn frame(s: &mut Stream) -> Frame {
        let (width, height) = (40, 30);
        let mut pixels = |n: usize| (0..width * height).map(|_| below(s, n)).collect::<Vec<_>>();
        let valid = pixels(3).into_iter().map(|x| 1000 * x as u16).collect();
        let labels = pixels(4).into_iter().map(|x| x as u8).collect();
        Frame {
            depth: Image {
                width,
                height,
                pixels: valid,
            },
            labels: Image {
                width,
                height,
                pixels: labels,
            },
            joints: vec![],
        }
    }

    #[test]
    fn samples_are_valid_of_their_class_and_drawn_evenly() {
        let mut s = stream(1, "sampling test", &[]);
        // 1200 pixels, of which about 400 are valid foreground and 400 valid background.
        for (foreground, background) in [(100, 50), (1500, 20), (0, 3000), (300, 0)] {
            let frame = frame(&mut s);
            let drawn = sample_pixels(&frame, &arms(), foreground, background, &mut s).unwrap();
            assert_eq!(drawn.len(), foreground + background);
            let at = |&(x, y): &Pixel| usize::from(y) * frame.depth.width + usize::from(x);
            for (i, pixel) in drawn.iter().enumerate() {
                assert!(frame.depth.pixels[at(pixel)] > 0);
                let label = frame.labels.pixels[at(pixel)];
                assert_eq!(matches!(label, 1 | 2), i < foreground);
            }
            for (class, wanted) in [(&drawn[..foreground], true), (&drawn[foreground..], false)] {
                let mut times: BTreeMap<Pixel, usize> = BTreeMap::new();
                class
                    .iter()
                    .for_each(|&p| *times.entry(p).or_default() += 1);
                let there = (0..1200)
                    .filter(|&i| frame.depth.pixels[i] > 0)
                    .filter(|&i| matches!(frame.labels.pixels[i], 1 | 2) == wanted)
                    .count();
                let most = class.len().div_ceil(there);
                let least = class.len() / there;
                assert!(times.values().all(|t| (least..=most).contains(t)));
                assert_eq!(times.len(), there.min(class.len()));
            }
        }
    }

    #[test]
    fn nothing_to_draw_from_is_an_error() {
        let mut s = stream(2, "sampling test", &[]);
        let mut empty = frame(&mut s);
        empty.labels.pixels.fill(3);
        let drawn = sample_pixels(&empty, &arms(), 10, 10, &mut s);
        assert!(matches!(
            drawn,
            Err(DataSetError::NoPixels { what: "foreground" })
        ));
        assert!(sample_pixels(&empty, &arms(), 0, 10, &mut s).is_ok());
    }

    #[test]
    fn every_candidate_is_as_likely() {
        let mut s = stream(3, "sampling test", &[]);
        let candidates: Vec<Pixel> = (0..10).map(|x| (x, 0)).collect();
        let mut times = [0; 10];
        for _ in 0..10_000 {
            for (x, _) in draw_pixels(&candidates, 13, &mut s).unwrap() {
                times[usize::from(x)] += 1;
            }
        }
        assert!(
            times.iter().all(|t| (12_700..13_300).contains(t)),
            "{times:?}"
        );
    }
}
