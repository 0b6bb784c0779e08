//! Training the segmentation forest (sections III-D and IV-A).

use super::seen::Seen;
use super::{Drawn, Training, TrainingError, bin, tree_steps};
use crate::Progress;
use crate::dataset::{DataSet, Pixel};
use crate::feature::{DepthFeatures, Extra};
use crate::forest::grow::TargetTable;
use crate::forest::leaves::grow_means;
use crate::forest::objective::mse::mse;
use crate::forest::segmentation_forest::SegmentationForest;
use crate::random::stream;

/// A forest that tells the arms and the background apart, trained on some images of a set. `mistaken` are
/// pixels of the background, by the number of the image, of which up to half of its background pixels are
/// drawn; none where the slice is empty. Features and pixels are chosen by the set's seed, trees grown with
/// `seed`. `progress` hears of [`Training::steps`].
pub fn train(
    set: &DataSet,
    images: &[usize],
    training: &Training,
    mistaken: &[Vec<Pixel>],
    seed: u64,
    progress: Progress,
) -> Result<SegmentationForest, TrainingError> {
    let mut random = stream(set.record().seed, "segmentation features", &[]);
    let features = DepthFeatures::draw(&training.features, Extra::Pixel, &mut random)?;
    let arm_of_label = set.arm_of_label();
    let draw = |row: usize| {
        let image = images[row];
        let seen = Seen::whole(set.frame(image)?);
        let mistaken = mistaken.get(image).map_or(&[][..], Vec::as_slice);
        let pixels = seen.pixels(training, set, image, mistaken)?;
        let depth = seen.padded(&features);
        let position = |&(x, y): &(u16, u16)| depth.position(x.into(), y.into());
        let labels = &seen.frame.labels;
        let class = |&(x, y): &(u16, u16)| {
            let at = usize::from(y) * labels.width + usize::from(x);
            let arm = arm_of_label[usize::from(labels.pixels[at])];
            arm.map_or(0, |arm| arm as u16 + 1)
        };
        Ok::<_, TrainingError>(Drawn {
            positions: pixels.iter().map(position).collect(),
            targets: pixels.iter().map(class).collect(),
            depth,
        })
    };
    let (binned, classes) = bin(&features, images.len(), draw, progress)?;

    // One target a class, 1 for itself and 0 for the others: the mean over a leaf is the share of
    // each class, and the variance of eq. 5 a third of the Gini impurity 1 - sum of shares squared.
    let names = set.classes();
    let one_hot = |row: usize| (0..names.len()).map(move |at| f64::from(u8::from(at == row)));
    let table = TargetTable::new(names.len(), (0..names.len()).flat_map(one_hot).collect())?;
    let steps = tree_steps(images.len());
    let (trees, leaves) = grow_means(
        &binned,
        &classes,
        &table,
        &*mse(&table)?,
        &training.forest,
        seed,
        &|trees| progress(steps * trees),
    )?;
    Ok(SegmentationForest::new(features, names, trees, leaves)?)
}
