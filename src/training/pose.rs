//! The samples of a pose estimation forest, and trees on them.

use super::seen::Seen;
use super::{Drawn, Training, TrainingError, bin, tree_steps};
use crate::Progress;
use crate::dataset::DataSet;
use crate::feature::{DepthFeatures, Extra};
use crate::forest::ForestError;
use crate::forest::bins::BinnedMatrix;
use crate::forest::grow::{GrowSpec, TargetTable};
use crate::forest::leaves::{LeafTable, grow_means};
use crate::forest::objective::Objective;
use crate::forest::tree::Tree;
use crate::random::stream;

/// The pixels that a forest is trained on. The pixels of an image share its pose as their target.
pub struct Samples {
    pub features: DepthFeatures,
    pub binned: BinnedMatrix,
    /// One row for each training image: the [columns](crate::circular::Circular::encode) of its pose.
    pub poses: TargetTable,
    /// The row of each sample.
    pub targets: Vec<u16>,
}

impl Samples {
    /// All that trees are grown from but the objective. `see` looks at an image of the set, which may
    /// happen twice. Features and pixels are chosen by the set's seed; they are the same for all
    /// objectives, and for whichever `images` are taken. `progress` hears of two units an image.
    pub fn draw<E: From<TrainingError> + Send>(
        set: &DataSet,
        images: &[usize],
        training: &Training,
        extra: Extra,
        see: impl Fn(usize) -> Result<Seen, E> + Sync,
        progress: Progress,
    ) -> Result<Samples, E> {
        let mut random = stream(set.record().seed, "features", &[]);
        let features = DepthFeatures::draw(&training.features, extra, &mut random)
            .map_err(TrainingError::from)?;
        let circular = set.circular();
        let columns = |&image: &usize| circular.encode(set.pose(image));
        let poses: Vec<f64> = images.iter().flat_map(columns).collect();
        let width = circular.columns(set.target_joints().len());
        let poses = TargetTable::new(width, poses).map_err(TrainingError::from)?;
        let draw = |row: usize| {
            let image = images[row];
            let seen = see(image)?;
            let pixels = seen
                .pixels(training, set, image, &[])
                .map_err(TrainingError::from)?;
            let depth = seen.padded(&features);
            let position = |&(x, y): &(u16, u16)| depth.position(x.into(), y.into());
            Ok::<_, E>(Drawn {
                positions: pixels.iter().map(position).collect(),
                targets: vec![row as u16; pixels.len()],
                depth,
            })
        };
        let (binned, targets) = bin(&features, images.len(), draw, progress)?;
        Ok(Samples {
            features,
            binned,
            poses,
            targets,
        })
    }

    /// Trees on these samples, and the tables of their leaves. `progress` hears of
    /// [`tree_steps`] a tree.
    pub fn grow(
        &self,
        objective: &dyn Objective,
        spec: &GrowSpec,
        seed: u64,
        progress: Progress,
    ) -> Result<(Vec<Tree>, Vec<LeafTable>), ForestError> {
        let steps = tree_steps(self.poses.targets());
        grow_means(
            &self.binned,
            &self.targets,
            &self.poses,
            objective,
            spec,
            seed,
            &|trees| progress(steps * trees),
        )
    }
}
