//! One pose from the estimates of many pixels (section III-C).

use crate::forest::pose_forest::{PixelLeaves, PoseForest};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The relative threshold t_r of eq. 12 is looked at in steps of `1 / STEPS`.
pub const STEPS: usize = 100;

/// How many values of a pose are summed by one thread.
const COLUMNS: usize = 8;

/// An image's estimate at every relative threshold, and the range of its confidences.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImageEstimate {
    /// Of the pixels' confidences.
    pub min_confidence: f32,
    pub mean_confidence: f64,
    pub max_confidence: f32,
    /// Entry j belongs to t_r = j / [`STEPS`]; there are `STEPS + 1`.
    pub thresholds: Vec<ThresholdEstimate>,
}

/// What the pixels with `c_p >= t` (eq. 12) say.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ThresholdEstimate {
    /// Eq. 13, in the units and the order of the forest's poses.
    pub pose: Vec<f64>,
    /// How many pixels were chosen, at least 1; 0 in a [guess](ImageEstimate::guess).
    pub pixels: usize,
    /// How many of them are foreground.
    pub foreground: usize,
}

impl ImageEstimate {
    /// A pose that stands for an estimate where nothing can be said: of no pixel, without confidence,
    /// the same at every threshold.
    pub fn guess(pose: &[f64]) -> Self {
        let guess = ThresholdEstimate {
            pose: pose.to_vec(),
            pixels: 0,
            foreground: 0,
        };
        Self {
            min_confidence: 0.0,
            mean_confidence: 0.0,
            max_confidence: 0.0,
            thresholds: vec![guess; STEPS + 1],
        }
    }
}

/// Combines the pixels whose leaves are given; `foreground[p]` says whether pixel p shows an arm,
/// which is only counted. `None` when there are no pixels.
///
/// All thresholds cost no more than one. A pixel's estimate times its confidence is the mean over
/// the trees of leaf confidence times leaf pose, because the pixel's estimate is the mean of the
/// leaves' poses weighted by their confidences, and its confidence the mean of theirs. So eq. 13 is
/// a quotient of sums over pixels and trees; circular values are averaged by their cosines and sines. They are gathered by the highest threshold that a pixel
/// reaches, each in the order of trees and pixels, and then added up from the top.
pub fn combine(
    forest: &PoseForest,
    leaves: &PixelLeaves,
    foreground: &[bool],
) -> Option<ImageEstimate> {
    let confidences = leaves.confidences();
    let min = confidences.par_iter().copied().reduce_with(f32::min)?;
    let max = confidences.par_iter().copied().reduce_with(f32::max)?;
    let reached: Vec<u8> = confidences
        .par_iter()
        .map(|&c| highest_step(c, min, max) as u8)
        .collect();
    let mut counts = vec![(0, 0); STEPS + 1];
    for (&step, &shows_arm) in reached.iter().zip(foreground) {
        counts[usize::from(step)].0 += 1;
        counts[usize::from(step)].1 += usize::from(shows_arm);
    }

    // By step, the sums of the leaves' confidences, and of their products with the values of the poses
    // from the `first` on.
    let circular = forest.circular();
    let width = circular.columns(forest.names().len());
    let add_up = |first: usize| {
        let mut sums = vec![(0.0f64, [0.0f64; COLUMNS]); STEPS + 1];
        for (tree, table) in forest.leaves().iter().enumerate() {
            let of_leaf = &forest.confidences()[tree];
            for (&leaf, &step) in leaves.of_tree(tree).iter().zip(&reached) {
                let confidence = f64::from(of_leaf[leaf as usize]);
                let (weight, sums) = &mut sums[usize::from(step)];
                *weight += confidence;
                for (sum, &y) in sums.iter_mut().zip(&table.row(leaf as usize)[first..]) {
                    *sum += confidence * f64::from(y);
                }
            }
        }
        sums
    };
    let firsts: Vec<usize> = (0..width).step_by(COLUMNS).collect();
    let sums: Vec<_> = firsts.par_iter().map(|&first| add_up(first)).collect();

    let (mut weight, mut total) = (0.0, vec![0.0; width]);
    let (mut pixels, mut arm) = (0, 0);
    let mut thresholds = Vec::with_capacity(STEPS + 1);
    for step in (0..=STEPS).rev() {
        weight += sums.first()?[step].0;
        let sums = sums.iter().flat_map(|columns| &columns[step].1);
        total.iter_mut().zip(sums).for_each(|(t, s)| *t += s);
        pixels += counts[step].0;
        arm += counts[step].1;
        thresholds.push(ThresholdEstimate {
            pose: circular.decode(total.iter().map(|sum| sum / weight).collect()),
            pixels,
            foreground: arm,
        });
    }
    thresholds.reverse();
    let sum: f64 = confidences.iter().map(|&c| f64::from(c)).sum();
    Some(ImageEstimate {
        min_confidence: min,
        mean_confidence: sum / confidences.len() as f64,
        max_confidence: max,
        thresholds,
    })
}

/// The step of [`ImageEstimate::thresholds`] for a relative threshold; `None` when it is not a multiple of
/// 1 / [`STEPS`] from 0 to 1.
pub fn step_of(t_r: f64) -> Option<usize> {
    let step = (t_r * STEPS as f64).round();
    let is_step = (0.0..=STEPS as f64).contains(&step) && (step / STEPS as f64 - t_r).abs() <= 1e-9;
    is_step.then_some(step as usize)
}

/// The largest j with `c >= min + (max - min) j / STEPS`. The most confident pixel reaches `STEPS`,
/// so no threshold is without pixels.
pub fn highest_step(c: f32, min: f32, max: f32) -> usize {
    let (above, range) = (
        f64::from(c) - f64::from(min),
        f64::from(max) - f64::from(min),
    );
    let reaches = |step: usize| above * STEPS as f64 >= range * step as f64;
    if reaches(STEPS) {
        return STEPS;
    }
    let mut step = (above / range * STEPS as f64) as usize;
    while !reaches(step) {
        step -= 1;
    }
    while reaches(step + 1) {
        step += 1;
    }
    step
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highest_step_is_the_highest() {
        let mut stream = crate::random::stream(1, "thresholds", &[]);
        for _ in 0..10_000 {
            let mut draw = || crate::random::uniform(&mut stream, 0.6, 1.0) as f32;
            let mut three = [draw(), draw(), draw()];
            three.sort_by(f32::total_cmp);
            let [min, c, max] = three;
            let step = highest_step(c, min, max);
            let (min, c, max) = (f64::from(min), f64::from(c), f64::from(max));
            let reaches = |j: usize| (c - min) * 100.0 >= (max - min) * j as f64;
            assert!(reaches(step));
            assert!(step == STEPS || !reaches(step + 1));
        }
    }

    #[test]
    fn the_extremes_reach_nothing_and_everything() {
        assert_eq!(highest_step(0.7, 0.7, 0.9), 0);
        assert_eq!(highest_step(0.9, 0.7, 0.9), STEPS);
        assert_eq!(highest_step(0.8, 0.8, 0.8), STEPS);
    }
}
