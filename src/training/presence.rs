//! Training the forest that tells whether an image shows the robot at all, which the paper does not have.

use super::{Drawn, TrainingError, bin};
use crate::Progress;
use crate::camera::{DepthImage, Photographer};
use crate::dataset::Studio;
use crate::feature::{DepthFeatures, Extra, FeatureSpec, PaddedDepth};
use crate::forest::grow::{GrowSpec, TargetTable};
use crate::forest::leaves::grow_means;
use crate::forest::objective::mse::mse;
use crate::forest::segmentation_forest::SegmentationForest;
use crate::random::{seed, stream};
use std::sync::{Mutex, PoisonError};

/// The classes of the forest, in the order of their numbers.
pub const CLASSES: [&str; 2] = ["no robot", "robot"];

/// A forest that looks at an image as a whole: its features (eq. 4) are taken at the centre of the image and
/// reach everywhere, so that each compares the depths of two fixed places. What is invalid or outside the
/// image counts as 5 m. It is trained on `images` new images of the studio, with and without the robot as
/// its specification says, each as `see` leaves it; `progress` hears of two units an image.
pub fn train(
    studio: &Studio,
    images: usize,
    see: impl Fn(&DepthImage) -> DepthImage + Sync,
    master: u64,
    progress: Progress,
) -> Result<SegmentationForest, TrainingError> {
    let camera = studio.camera();
    let side = camera.intrinsics.width.max(camera.intrinsics.height);
    let spec = FeatureSpec {
        count: 1000,
        window: (2 * side).min(LARGEST_WINDOW),
    };
    let mut random = stream(master, "presence features", &[]);
    let features = DepthFeatures::draw(&spec, Extra::Nothing, &mut random)?;
    // Each thread takes one and brings it back.
    let photographers: Mutex<Vec<Photographer>> = Mutex::default();
    let all = || photographers.lock().unwrap_or_else(PoisonError::into_inner);
    let draw = |image: usize| {
        let free = all().pop();
        let mut photographer = free.unwrap_or_else(|| Photographer::new(camera));
        let shot = studio.shoot(image, &mut photographer, master)?;
        all().push(photographer);
        let left = see(&shot.photo.depth);
        let depth = PaddedDepth::new(&left, features.reach());
        Ok::<_, TrainingError>(Drawn {
            positions: vec![centre(&depth, &left)],
            targets: vec![u16::from(shot.configuration.is_some())],
            depth,
        })
    };
    let (binned, classes) = bin(&features, images, draw, progress)?;
    let table = TargetTable::new(2, vec![1.0, 0.0, 0.0, 1.0])?;
    let forest = GrowSpec {
        trees: 200,
        min_leaf: 1,
        features_per_node: 60,
        max_depth: None,
        bootstrap: true,
    };
    let seed = seed(master, "presence forest", &[]);
    let objective = mse(&table)?;
    let (trees, leaves) = grow_means(
        &binned,
        &classes,
        &table,
        &*objective,
        &forest,
        seed,
        &|_| (),
    )?;
    let names = CLASSES.map(str::to_owned).to_vec();
    Ok(SegmentationForest::new(features, names, trees, leaves)?)
}

/// The widest that a feature may reach.
const LARGEST_WINDOW: usize = 2000;

/// Where the centre of an image stands in its padded form.
pub fn centre(padded: &PaddedDepth, depth: &DepthImage) -> u32 {
    padded.position(depth.width / 2, depth.height / 2)
}
