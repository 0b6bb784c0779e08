//! Training the part forest of the baseline \[3\] (section IV-E).

use super::pose_forest::{FOREST_FILE, PoseForestTask};
use crate::Progress;
use crate::dataset::DataSet;
use crate::estimator::part_baseline::BaselineSpec;
use crate::estimator::part_baseline::joints::{joint_points, joint_positions};
use crate::estimator::part_baseline::parts::Parts;
use crate::experiment::task::{Cost, Stage, Task};
use crate::forest::part_forest::PartForest;
use crate::forest::retrofit::{PartSamples, grow_parts};
use crate::random::seed;
use anyhow::Result;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Trains a part forest on the images, pixels and features that a pose estimation forest is trained
/// on: the file [`FOREST_FILE`].
pub struct PartForestTask {
    /// Whose objective and trees do not matter here.
    pub samples: Arc<PoseForestTask>,
    pub baseline: BaselineSpec,
}

impl PartForestTask {
    /// What the samples show. `images` holds the row of each sample among the training images.
    fn part_samples(
        &self,
        set: &DataSet,
        segmented: Option<&Path>,
        parts: &Parts,
        images: Vec<u16>,
    ) -> Result<PartSamples> {
        let (rig, arm) = self.samples.set.rig()?;
        let points = joint_points(&rig, arm);
        let camera = &set.camera().intrinsics;
        let of_image = |&image: &usize| {
            let seen = self.samples.sight.look(set, segmented, image)?;
            let frame = &seen.frame;
            let sample = |&(x, y): &(u16, u16)| {
                let (x, y) = (usize::from(x), usize::from(y));
                let at = y * frame.depth.width + x;
                let class = parts.of_label[usize::from(frame.labels.pixels[at])];
                let point = camera.point(x, y, frame.depth.pixels[at]);
                (u16::from(class), point.coords.map(|x| x as f32).into())
            };
            let pixels = seen.pixels(&self.samples.training, set, image, &[])?;
            anyhow::Ok(pixels.iter().map(sample).collect::<Vec<(u16, [f32; 3])>>())
        };
        let rows = self.samples.images.par_iter();
        let samples = rows.map(of_image).collect::<Result<Vec<_>>>()?;
        let (classes, pixels) = samples.into_iter().flatten().unzip();
        let joints = |&image: &usize| {
            let configuration = set.configuration(image, &rig.robot)?;
            let camera_from_root = set.camera_from_root_of(image);
            let at = joint_positions(&points, &rig.robot, &configuration, camera_from_root);
            let position = |at: &nalgebra::Point3<f64>| at.coords.map(|x| x as f32).into();
            anyhow::Ok(at.iter().map(position).collect())
        };
        Ok(PartSamples {
            classes,
            points: pixels,
            images,
            joints: self
                .samples
                .images
                .iter()
                .map(joints)
                .collect::<Result<_>>()?,
        })
    }
}

impl Task for PartForestTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "part-forest".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        let forest = &self.baseline.forest;
        format!(
            "part forest{} ({} trees, leaves {}, features {}), fold {} of {}",
            self.samples.sight.label(),
            forest.trees,
            forest.min_leaf,
            forest.features_per_node,
            self.samples.fold + 1,
            self.samples.set.spec.name
        )
    }

    fn parameters(&self) -> serde_json::Value {
        let training = &self.samples.training;
        serde_json::json!({
            "images": self.samples.images,
            "foreground": training.foreground,
            "background": training.background,
            "features": training.features,
            "segmentation": self.samples.sight.kind,
            "parts": self.baseline.parts,
            "forest": self.baseline.forest,
            "leaves": self.baseline.leaves,
            "fold": self.samples.fold,
            "seed": self.samples.set.seed,
        })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        let mut inputs: Vec<Arc<dyn Task>> = vec![self.samples.set.clone()];
        inputs.extend(self.samples.sight.input());
        inputs
    }

    fn cost(&self) -> Cost {
        let samples = self.samples.samples() as f64;
        let forest = &self.baseline.forest;
        let levels = (samples / f64::from(forest.min_leaf)).log2().max(1.0);
        let visits = samples * levels * forest.features_per_node as f64 * forest.trees as f64;
        let bytes = samples * self.samples.training.features.count as f64 * 3.0;
        Cost {
            seconds: 1e-8 * visits + 4e-9 * bytes,
            megabytes: 200.0 + bytes / 1e6,
        }
    }

    fn steps(&self) -> u64 {
        self.baseline.forest.trees as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[0])?;
        let segmented = inputs.get(1).map(PathBuf::as_path);
        let parts = Parts::new(&self.baseline.parts, set.record())?;
        let samples = self.samples.samples_of(&set, segmented, &|_| ())?;
        let shown = self.part_samples(&set, segmented, &parts, samples.targets)?;
        let seed = seed(
            self.samples.set.seed,
            "part forest",
            &[self.samples.fold as u64],
        );
        let BaselineSpec { forest, leaves, .. } = &self.baseline;
        let binned = &samples.binned;
        let (trees, tables) = grow_parts(
            binned,
            &shown,
            &parts.classes,
            forest,
            leaves,
            seed,
            progress,
        )?;
        let (rig, arm) = self.samples.set.rig()?;
        let names = joint_points(&rig, arm).into_iter().map(|point| point.name);
        let (features, names) = (samples.features, names.collect());
        let forest = PartForest::new(features, parts.classes, names, trees, tables)?;
        forest.save(&out.join(FOREST_FILE))?;
        Ok(())
    }
}
