//! Training: from the images of a data set to a forest.
//!
//! Pixels are drawn from every image, their features binned, and trees grown on the bins:
//! [`pose`] for the forest that estimates, [`segmentation`] for the one that finds the arm first.
//! [`presence`] is the forest that tells whether there is a robot at all. [`seen`] is what is left of an image for the first by what the second says.

pub mod pose;
pub mod presence;
pub mod seen;
pub mod segmentation;

use crate::Progress;
use crate::dataset::DataSetError;
use crate::feature::{DepthFeatures, FeatureError, FeatureSpec, PaddedDepth, SampleMatrix};
use crate::forest::ForestError;
use crate::forest::bins::{BinCounter, BinnedMatrix};
use crate::forest::grow::GrowSpec;
use crate::pose_space::disp::DispError;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::ops::Range;

/// How a forest is trained on images, whichever they are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Training {
    /// Pixels of either arm drawn from each image.
    pub foreground: usize,
    /// Other valid pixels drawn from each image.
    pub background: usize,
    pub features: FeatureSpec,
    pub forest: GrowSpec,
}

impl Training {
    /// Pixels drawn from each image.
    pub fn samples_per_image(&self) -> usize {
        self.foreground + self.background
    }

    /// The sum of what training on so many images reports to its progress.
    pub fn steps(&self, images: usize) -> u64 {
        2 * images as u64 + tree_steps(images) * self.forest.trees as u64
    }
}

/// Why a forest cannot be trained.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    #[error(transparent)]
    Set(#[from] DataSetError),
    #[error(transparent)]
    Feature(#[from] FeatureError),
    #[error(transparent)]
    Forest(#[from] ForestError),
    #[error(transparent)]
    Disp(#[from] DispError),
    #[error("{0}")]
    Unsuitable(String),
}

/// The pixels drawn from one image.
struct Drawn {
    depth: PaddedDepth,
    /// Where they stand in `depth`.
    positions: Vec<u32>,
    /// The target of each.
    targets: Vec<u16>,
}

/// Images whose samples are computed together.
const PART: usize = 32;
/// Samples up to so many bytes are kept as they are between counting and binning; those of further
/// images are computed again.
const KEPT_BYTES: usize = 1 << 29;

/// What a grown tree counts in [`Training::steps`]: about as long as reading a fifth of the images.
pub fn tree_steps(images: usize) -> u64 {
    images.div_ceil(5) as u64
}

/// Bins the features of what is drawn from the images `0..images`, and lists the targets, both in the
/// order of the images. `draw` must return the same for an image each time: it may be asked twice, once
/// to count values and once to bin them, so that samples need a fifth of the memory they would as they
/// are. `progress` hears of two units an image. Of several errors any one is returned.
fn bin<E: From<TrainingError> + Send>(
    features: &DepthFeatures,
    images: usize,
    draw: impl Fn(usize) -> Result<Drawn, E> + Sync,
    progress: Progress,
) -> Result<(BinnedMatrix, Vec<u16>), E> {
    bin_keeping(KEPT_BYTES, features, images, draw, progress)
}

fn bin_keeping<E: From<TrainingError> + Send>(
    kept_bytes: usize,
    features: &DepthFeatures,
    images: usize,
    draw: impl Fn(usize) -> Result<Drawn, E> + Sync,
    progress: Progress,
) -> Result<(BinnedMatrix, Vec<u16>), E> {
    let samples = |part: Range<usize>| {
        let drawn: Vec<Drawn> = part.into_par_iter().map(&draw).collect::<Result<_, E>>()?;
        let counts: Vec<usize> = drawn.iter().map(|image| image.positions.len()).collect();
        let fill = |image: usize, columns: &mut [&mut [i16]]| {
            let Drawn {
                depth, positions, ..
            } = &drawn[image];
            features.fill(depth, positions, columns);
            Ok::<(), Infallible>(())
        };
        let Ok(matrix) = SampleMatrix::fill(features.count(), &counts, fill);
        let targets = drawn.iter().flat_map(|image| &image.targets).copied();
        Ok::<_, E>((matrix, targets.collect::<Vec<u16>>()))
    };
    let parts = || {
        let first = (0..images).step_by(PART);
        first.map(|first| first..images.min(first + PART))
    };
    let mut counter = BinCounter::default();
    let (mut targets, mut kept, mut bytes) = (Vec::new(), VecDeque::new(), 0);
    for part in parts() {
        let steps = part.len() as u64;
        let (matrix, of_part) = samples(part)?;
        counter.add(&matrix).map_err(TrainingError::from)?;
        targets.extend(of_part);
        bytes += size_of::<i16>() * features.count() * matrix.samples();
        if bytes <= kept_bytes {
            kept.push_back(matrix);
        }
        progress(steps);
    }
    let mut binned = counter.finish().map_err(TrainingError::from)?;
    for part in parts() {
        let steps = part.len() as u64;
        let matrix = match kept.pop_front() {
            Some(matrix) => matrix,
            None => samples(part)?.0,
        };
        binned.push(&matrix);
        progress(steps);
    }
    Ok((binned, targets))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Image;
    use crate::feature::Extra;
    use crate::random::{below, stream};
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// However much is kept, the bins are those of the whole, and images without samples have none.
    #[test]
    fn what_is_kept_changes_nothing() {
        const IMAGES: usize = 3 * PART + 5;
        let mut random = stream(1, "features", &[]);
        let spec = FeatureSpec {
            count: 7,
            window: 9,
        };
        let features = DepthFeatures::draw(&spec, Extra::Nothing, &mut random).unwrap();
        let draws = AtomicUsize::new(0);
        let draw = |image: usize| {
            draws.fetch_add(1, Ordering::Relaxed);
            let mut random = stream(2, "image", &[image as u64]);
            let depth = Image {
                width: 20,
                height: 15,
                pixels: (0..300)
                    .map(|_| 1 + below(&mut random, 4000) as u16)
                    .collect(),
            };
            let depth = PaddedDepth::new(&depth, features.reach());
            let count = image % 4;
            let positions = (0..count).map(|_| depth.position_of(below(&mut random, 300)));
            Ok::<_, TrainingError>(Drawn {
                positions: positions.collect(),
                targets: vec![image as u16; count],
                depth,
            })
        };
        let steps = AtomicUsize::new(0);
        let progress = |n: u64| {
            steps.fetch_add(n as usize, Ordering::Relaxed);
        };
        let of_part = 2 * 7 * 48;
        let bin = |kept: usize| bin_keeping(kept, &features, IMAGES, draw, &progress).unwrap();
        let (whole, targets) = bin(usize::MAX);
        assert_eq!(draws.swap(0, Ordering::Relaxed), IMAGES);
        let expected = (0..IMAGES).flat_map(|image| vec![image as u16; image % 4]);
        assert_eq!(targets, expected.collect::<Vec<_>>());
        for (kept, read_again) in [(0, IMAGES), (2 * of_part, IMAGES - 2 * PART)] {
            let (binned, same) = bin(kept);
            assert_eq!(draws.swap(0, Ordering::Relaxed), IMAGES + read_again);
            assert_eq!(same, targets);
            for feature in 0..features.count() {
                assert_eq!(binned.column(feature), whole.column(feature));
            }
        }
        assert_eq!(steps.into_inner(), 3 * 2 * IMAGES);
    }
}
