//! Estimating the pose with the part-classification baseline in images that its forest was not trained
//! on.

use super::data_set::DataSetTask;
use super::part_forest::PartForestTask;
use super::pose_forest::FOREST_FILE;
use super::sight::Sight;
use crate::Progress;
use crate::dataset::DataSet;
use crate::estimator::error::mean_pose;
use crate::estimator::inverse_kinematics::{Alignment, Settings, Target, VirtualArm};
use crate::estimator::part_baseline::joints::{JointPoint, joint_points, joint_positions};
use crate::estimator::part_baseline::parts::Parts;
use crate::estimator::part_baseline::votes::{FoundJoint, PixelPoint};
use crate::estimator::part_baseline::{
    PartEstimate, estimate, find_true_joints, pixel_points, voters,
};
use crate::estimator::segmentation::Confusion;
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::forest::part_forest::{PartClass, PartForest};
use crate::scene::Rig;
use anyhow::{Result, bail};
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Who classifies the pixels and votes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Voting {
    /// The part forest.
    Forest,
    /// The truth: every pixel has its true part and votes for the true joints. So the later stages are
    /// tested alone. Since the joints are found without error, the pose needs no prior and the arm is
    /// aligned by the default settings.
    Oracle,
}

/// Estimates the pose in some images: the file `estimates.json`.
pub struct PartEstimatesTask {
    pub forest: Arc<PartForestTask>,
    /// The set of the test images.
    pub set: Arc<DataSetTask>,
    /// The test images, ascending.
    pub images: Vec<usize>,
    pub voting: Voting,
    /// Only the pixels of every such row and column take part; 1 for all.
    pub stride: usize,
}

/// What came out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartEstimates {
    pub classes: Vec<PartClass>,
    /// The joints that are looked for; those that sit in one place are one, their names joined by `+`.
    pub joints: Vec<String>,
    /// In the order of the images.
    pub images: Vec<PartEstimated>,
}

/// What came out for one image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartEstimated {
    pub image: usize,
    /// How the valid pixels of each class were classified.
    pub confusion: Confusion,
    /// Where each joint is, camera frame, metres.
    pub truth: Vec<[f64; 3]>,
    /// Where it was found; absent when no pixel voted for it.
    pub found: Vec<Option<FoundJoint>>,
    /// How far the aligned arm's joint is from where it was found, metres.
    pub residuals_m: Vec<Option<f64>>,
    /// The pose of the arm that was aligned with what was found; the mean pose of the training images
    /// where that tells nothing.
    pub pose: Vec<f64>,
    /// Which of the pose's joints what was found can tell, by the rank of the Jacobian.
    pub observed: Vec<bool>,
}

const FILE: &str = "estimates.json";

impl PartEstimatesTask {
    /// Fails when an image is among those that the forest was trained on, or when the forest sees
    /// segmented images, but those of another set.
    pub fn new(
        forest: Arc<PartForestTask>,
        set: Arc<DataSetTask>,
        images: Vec<usize>,
        voting: Voting,
        stride: usize,
    ) -> Result<PartEstimatesTask> {
        let samples = &forest.samples;
        let name = &set.spec.name;
        if *name == samples.set.spec.name {
            if let Some(image) = images.iter().find(|image| samples.images.contains(image)) {
                bail!("image {image} of set {name} is in the training and in the test images");
            }
        } else if samples.sight.input().is_some() {
            let other = &samples.set.spec.name;
            bail!("the part forest sees the segmentation of set {other}, but is tested on {name}");
        }
        Ok(PartEstimatesTask {
            forest,
            set,
            images,
            voting,
            stride,
        })
    }

    /// Reads the result from the folder that [`Task::run`] wrote.
    pub fn read(folder: &Path) -> Result<PartEstimates> {
        read_json(&folder.join(FILE))
    }
}

impl Task for PartEstimatesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "part-estimates".to_owned(),
            version: 2,
        }
    }

    fn label(&self) -> String {
        let by = match self.voting {
            Voting::Forest => "estimates",
            Voting::Oracle => "estimates by true parts and votes",
        };
        format!("{by}: {}", self.forest.label())
    }

    fn parameters(&self) -> serde_json::Value {
        let baseline = &self.forest.baseline;
        serde_json::json!({
            "training": self.forest.samples.images,
            "images": self.images,
            "voting": self.voting,
            "parts": baseline.parts,
            "votes": baseline.votes,
            "alignment": baseline.alignment,
            "stride": self.stride,
        })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        let samples = &self.forest.samples;
        let mut inputs: Vec<Arc<dyn Task>> = vec![samples.set.clone(), self.set.clone()];
        if self.voting == Voting::Forest {
            inputs.push(self.forest.clone());
            inputs.extend(samples.sight.input());
        }
        inputs
    }

    fn cost(&self) -> Cost {
        let images = self.images.len() as f64;
        let pixels = 270_000.0 / self.stride.pow(2) as f64;
        let walks = images * pixels * self.forest.baseline.forest.trees as f64;
        Cost {
            seconds: 60e-9 * walks + 0.1 * images,
            megabytes: 500.0,
        }
    }

    fn steps(&self) -> u64 {
        self.images.len() as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let baseline = &self.forest.baseline;
        let (rig, arm) = self.set.rig()?;
        let work = Work {
            set: DataSet::open(&inputs[1])?,
            forest: match self.voting {
                Voting::Forest => Some(PartForest::load(&inputs[2].join(FOREST_FILE))?),
                Voting::Oracle => None,
            },
            segmented: inputs.get(3).map(PathBuf::as_path),
            aligner: self.aligner(&DataSet::open(&inputs[0])?)?,
            joints: joint_points(&rig, arm),
            rig,
        };
        let parts = Parts::new(&baseline.parts, work.set.record())?;
        let of_image = |&image: &usize| {
            let estimated = self.image(&work, &parts, image);
            progress(1);
            estimated
        };
        let images = self
            .images
            .par_iter()
            .map(of_image)
            .collect::<Result<_>>()?;
        let estimates = PartEstimates {
            classes: parts.classes,
            joints: work.joints.into_iter().map(|joint| joint.name).collect(),
            images,
        };
        std::fs::write(out.join(FILE), serde_json::to_vec(&estimates)?)?;
        Ok(())
    }
}

/// What all images share.
struct Work<'a> {
    set: DataSet,
    /// Absent when the truth votes.
    forest: Option<PartForest>,
    segmented: Option<&'a Path>,
    rig: Rig,
    joints: Vec<JointPoint>,
    aligner: Aligner,
}

/// What turns found joints into a pose.
pub struct Aligner {
    virtual_arm: VirtualArm,
    /// The mean pose of the training images.
    reference: Vec<f64>,
    /// The nominal one: an estimate knows no better.
    root_from_camera: Isometry3<f64>,
}

impl PartEstimatesTask {
    /// `training` is the result of the training images' set.
    pub fn aligner(&self, training: &DataSet) -> Result<Aligner> {
        let (rig, arm) = self.set.rig()?;
        let links: Vec<usize> = joint_points(&rig, arm).iter().map(|j| j.link).collect();
        let images = self.forest.samples.images.iter();
        Ok(Aligner {
            virtual_arm: VirtualArm::new(&rig.robot, &rig.arms[arm].joints, &links),
            reference: mean_pose(
                images.map(|&image| training.pose(image)),
                training.circular(),
            ),
            root_from_camera: training.camera_from_root().inverse(),
        })
    }

    /// The arm aligned with joints that were found.
    pub fn align(&self, aligner: &Aligner, joints: &[Option<FoundJoint>]) -> Alignment {
        let target = |found: &Option<FoundJoint>| {
            found.map(|found| Target {
                position: aligner.root_from_camera * Point3::from(found.at),
                weight: found.confidence,
            })
        };
        let targets: Vec<Option<Target>> = joints.iter().map(target).collect();
        let exact = Settings::default();
        let settings = match self.voting {
            Voting::Forest => &self.forest.baseline.alignment,
            Voting::Oracle => &exact,
        };
        (aligner.virtual_arm).align(&targets, &aligner.reference, settings)
    }

    fn image(&self, work: &Work, parts: &Parts, image: usize) -> Result<PartEstimated> {
        let baseline = &self.forest.baseline;
        let set = &work.set;
        let seen = match &work.forest {
            Some(_) => self.forest.samples.sight.look(set, work.segmented, image)?,
            None => Sight::WHOLE.look(set, None, image)?,
        };
        let frame = &seen.frame;
        let pixels = pixel_points(&frame.depth, &set.camera().intrinsics, self.stride);
        let true_class = |point: &PixelPoint| {
            parts.of_label[usize::from(frame.labels.pixels[point.pixel as usize])]
        };
        let true_classes: Vec<u8> = pixels.iter().map(true_class).collect();
        let configuration = set.configuration(image, &work.rig.robot)?;
        let camera_from_root = set.camera_from_root_of(image);
        let truth = joint_positions(
            &work.joints,
            &work.rig.robot,
            &configuration,
            camera_from_root,
        );
        let PartEstimate { classes, joints } = match &work.forest {
            Some(forest) => {
                let padded = seen.padded(forest.features());
                estimate(forest, &padded, &pixels, &baseline.votes)
            }
            None => {
                let voters = voters(&parts.classes, &pixels, &true_classes);
                PartEstimate {
                    joints: find_true_joints(&truth, &voters, &baseline.votes),
                    classes: true_classes.clone(),
                }
            }
        };
        let mut confusion = Confusion::new(parts.classes.len());
        for (&truth, &given) in true_classes.iter().zip(&classes) {
            confusion.0[usize::from(truth)][usize::from(given)] += 1;
        }
        let alignment = self.align(&work.aligner, &joints);
        Ok(PartEstimated {
            image,
            confusion,
            truth: truth.iter().map(|at| at.coords.into()).collect(),
            found: joints,
            residuals_m: alignment.residuals,
            pose: alignment.pose,
            observed: alignment.observed,
        })
    }
}
