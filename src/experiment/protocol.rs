//! Cross-validation over the images of a set: how forests are trained and tested in every study of
//! the pose estimation forest.

use super::statistics::mean;
use super::study::Done;
use super::task::Task;
use super::tasks::data_set::DataSetTask;
use super::tasks::estimates::EstimatesTask;
use super::tasks::part_estimates::{PartEstimatesTask, Voting};
use super::tasks::part_forest::PartForestTask;
use super::tasks::pose_forest::PoseForestTask;
use super::tasks::sight::Sight;
use crate::dataset::{DataSet, folds};
use crate::estimator::error::{angle_error, mean_pose, tip_error};
use crate::estimator::image::{self, ImageEstimate, STEPS};
use crate::estimator::part_baseline::BaselineSpec;
use crate::forest::objective::{OBJECTIVES, ObjectiveKind};
use crate::pose_space::disp::Disp;
use crate::robot::Robot;
use crate::scene::{Arm, Rig};
use crate::training::Training;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// What forests are trained and tested on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Protocol {
    /// A file of `data/sets/`, without its extension.
    pub set: String,
    pub images: usize,
    /// A fold is a set of images. Each is tested by a forest trained on all others.
    pub folds: usize,
    /// The bandwidth of eq. 2.
    pub sigma: f64,
    /// Test pixels are those of every such row and column; 1, as in the paper, for all.
    pub stride: usize,
    pub training: Training,
}

/// A protocol at work.
pub struct CrossValidation {
    pub set: Arc<DataSetTask>,
    /// The test images of each fold.
    folds: Vec<Vec<usize>>,
    protocol: Protocol,
}

/// An image, tested by a forest that had not seen it.
#[derive(Debug, Clone)]
pub struct Outcome {
    pub image: usize,
    pub fold: usize,
    pub truth: Vec<f64>,
    /// A guess, the mean pose of the training images, where no arm is seen.
    pub estimate: ImageEstimate,
    /// Whether the image's segmentation shows the arm; always without one.
    pub arm_seen: bool,
    /// Pixels that surely show the arm; absent without segmentation.
    pub sure_pixels: Option<usize>,
    /// The mean pose of the training images.
    pub constant: Vec<f64>,
    /// Valid pixels, and those of the arm that is estimated.
    pub valid: usize,
    pub visible: usize,
}

impl CrossValidation {
    /// With sets of images as described below `root`. Images, folds, pixels, features and trees follow from
    /// `seed`. Fails when there are fewer images than folds, or numbers that make no sense.
    pub fn new(root: &Path, seed: u64, protocol: Protocol) -> Result<CrossValidation> {
        let Protocol {
            images,
            folds: k,
            sigma,
            ..
        } = protocol;
        if !(2..=images).contains(&k) {
            bail!("folds = {k}, images = {images}: choose 2 folds up to one for each image");
        }
        if !(sigma > 0.0 && sigma.is_finite()) {
            bail!("sigma = {sigma}: choose a positive number");
        }
        if protocol.stride == 0 {
            bail!("stride = 0: choose at least 1, for all pixels");
        }
        let grow = &protocol.training.forest;
        let features = protocol.training.features.count;
        if !(1..=features).contains(&grow.features_per_node) {
            bail!(
                "features_per_node = {}: choose 1 to {features}, the number of features",
                grow.features_per_node
            );
        }
        Ok(CrossValidation {
            set: Arc::new(DataSetTask::new(root, &protocol.set, images, seed)?),
            folds: folds(images, k, seed),
            protocol,
        })
    }

    /// The tasks that test every image once, one for each fold, with the protocol's own training
    /// and bandwidth.
    pub fn estimates(&self, objective: &'static ObjectiveKind) -> Result<Vec<Arc<EstimatesTask>>> {
        self.estimates_seen(objective, &Sight::WHOLE)
    }

    /// The same by forests that see the images in another way.
    pub fn estimates_seen(
        &self,
        objective: &'static ObjectiveKind,
        sight: &Sight,
    ) -> Result<Vec<Arc<EstimatesTask>>> {
        let Protocol {
            training, sigma, ..
        } = &self.protocol;
        let trees = training.forest.trees;
        self.estimates_with(objective, sight, training, *sigma, trees)
    }

    /// The same with another training, bandwidth and number of trees that take part.
    pub fn estimates_with(
        &self,
        objective: &'static ObjectiveKind,
        sight: &Sight,
        training: &Training,
        sigma: f64,
        trees: usize,
    ) -> Result<Vec<Arc<EstimatesTask>>> {
        let stride = self.protocol.stride;
        let fold = |(fold, test): (usize, &Vec<usize>)| {
            let forest = self.forest(fold, objective, sight, training);
            let task = EstimatesTask::new(Arc::new(forest), test.clone(), sigma, trees, stride)?;
            Ok(Arc::new(task))
        };
        self.folds.iter().enumerate().map(fold).collect()
    }

    /// The tasks that test every image once with the part-classification baseline, whose forests are
    /// trained on the same images, pixels and features.
    pub fn part_estimates(
        &self,
        baseline: &BaselineSpec,
        voting: Voting,
    ) -> Result<Vec<Arc<PartEstimatesTask>>> {
        // Any objective will do: only the samples are taken.
        let any = &OBJECTIVES[0];
        let fold = |(fold, test): (usize, &Vec<usize>)| {
            let samples = self.forest(fold, any, &Sight::WHOLE, &self.protocol.training);
            let forest = PartForestTask {
                samples: Arc::new(samples),
                baseline: baseline.clone(),
            };
            let (set, stride) = (self.set.clone(), self.protocol.stride);
            let task = PartEstimatesTask::new(Arc::new(forest), set, test.clone(), voting, stride)?;
            Ok(Arc::new(task))
        };
        self.folds.iter().enumerate().map(fold).collect()
    }

    /// The forest that tests a fold: trained on all other images.
    fn forest(
        &self,
        fold: usize,
        objective: &'static ObjectiveKind,
        sight: &Sight,
        training: &Training,
    ) -> PoseForestTask {
        let is_training = |image: &usize| !self.folds[fold].contains(image);
        PoseForestTask {
            set: self.set.clone(),
            images: (0..self.protocol.images).filter(is_training).collect(),
            objective,
            training: training.clone(),
            sight: sight.clone(),
            fold,
        }
    }

    /// All tasks whose results [`CrossValidation::outcomes`] reads: the set and the estimates.
    pub fn tasks<'a>(
        &self,
        estimates: impl IntoIterator<Item = &'a Arc<EstimatesTask>>,
    ) -> Vec<Arc<dyn Task>> {
        let mut tasks: Vec<Arc<dyn Task>> = vec![self.set.clone()];
        tasks.extend(estimates.into_iter().map(|e| e.clone() as Arc<dyn Task>));
        tasks
    }

    /// The results of [`CrossValidation::estimates`] in the order of the images.
    pub fn outcomes(&self, tasks: &[Arc<EstimatesTask>], done: Done<'_>) -> Result<Vec<Outcome>> {
        let set = DataSet::open(&done(&*self.set)?)?;
        let mut outcomes = Vec::new();
        for task in tasks {
            let forest = &task.forest;
            let constant = mean_pose(
                forest.images.iter().map(|&image| set.pose(image)),
                set.circular(),
            );
            for estimated in EstimatesTask::read(&done(&**task)?)? {
                let record = &set.record().images[estimated.image];
                outcomes.push(Outcome {
                    image: estimated.image,
                    fold: forest.fold,
                    truth: set.pose(estimated.image).to_vec(),
                    arm_seen: estimated.estimate.is_some(),
                    sure_pixels: estimated.sure_pixels,
                    estimate: estimated
                        .estimate
                        .unwrap_or_else(|| ImageEstimate::guess(&constant)),
                    constant: constant.clone(),
                    valid: record.valid,
                    visible: record.arms[set.target()],
                });
            }
        }
        outcomes.sort_by_key(|outcome| outcome.image);
        Ok(outcomes)
    }
}

/// An objective has the same colour in every figure. Those beyond the palette take colours again,
/// beginning after those of WSC and t-SNE, beside which they stand.
pub fn colour(objective: &ObjectiveKind) -> usize {
    match objective.place() {
        place if place < FLOOR_COLOUR => place,
        place => (place + 4) % FLOOR_COLOUR,
    }
}

/// The colour of the constant pose: black.
pub const FLOOR_COLOUR: usize = 7;

/// The step of [`ImageEstimate::thresholds`] for a relative threshold.
pub fn step_of(t_r: f64) -> Result<usize> {
    image::step_of(t_r).with_context(|| {
        let multiple = 1.0 / STEPS as f64;
        format!("t_r = {t_r}: choose a multiple of {multiple} from 0 to 1")
    })
}

/// Measures how far a pose is from the truth, for one arm of one robot.
pub struct Ruler<'a> {
    robot: &'a Robot,
    arm: &'a Arm,
    joints: Vec<&'a str>,
    disp: Disp<'a>,
}

/// Errors of one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseError {
    pub joints_deg: Vec<f64>,
    /// Mean over all joints, over those of the arm, and over those of the hand (NaN without one).
    pub all_deg: f64,
    pub arm_deg: f64,
    pub hand_deg: f64,
    /// Root of the mean square over all joints.
    pub rms_deg: f64,
    /// Eq. 3: how far the farthest point of the arm is from where it should be.
    pub disp_m: f64,
    /// Distance between the true and the estimated fingertip.
    pub tip_m: f64,
}

impl<'a> Ruler<'a> {
    /// For an arm of `rig`.
    pub fn new(rig: &'a Rig, arm: usize) -> Result<Self> {
        let arm = &rig.arms[arm];
        let names: Vec<&str> = rig.robot.dof_joints().map(|j| j.name.as_str()).collect();
        let joints: Vec<&str> = arm.joints.iter().map(|&dof| names[dof]).collect();
        Ok(Self {
            robot: &rig.robot,
            arm,
            disp: Disp::new(&rig.robot, &joints)?,
            joints,
        })
    }

    /// The names of the joints of a pose, in order.
    pub fn joints(&self) -> &[&'a str] {
        &self.joints
    }

    /// Both poses in the order of [`Self::joints`], radians. Panics when one is of another length.
    pub fn measure(&self, truth: &[f64], estimate: &[f64]) -> PoseError {
        let pairs = truth.iter().zip(estimate);
        let joints_deg: Vec<f64> = pairs
            .map(|(&t, &e)| angle_error(t, e).to_degrees())
            .collect();
        let squares: Vec<f64> = joints_deg.iter().map(|e| e * e).collect();
        let (arm_deg, hand_deg) = joints_deg.split_at(self.arm.arm_joints);
        let Arm { tip, joints, .. } = self.arm;
        PoseError {
            all_deg: mean(&joints_deg),
            arm_deg: mean(arm_deg),
            hand_deg: mean(hand_deg),
            rms_deg: mean(&squares).sqrt(),
            disp_m: self.disp.distance(truth, estimate),
            tip_m: tip_error(self.robot, *tip, joints, truth, estimate),
            joints_deg,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::tasks::estimates::Estimated;
    use crate::random::{stream, uniform};
    use std::f64::consts::TAU;

    /// Every image is tested once, by a forest that has seen all others and learns their poses; and the
    /// constant pose knows as much as that forest.
    #[test]
    fn what_tests_an_image_has_not_seen_it() {
        const IMAGES: usize = 7;
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let protocol: Protocol = toml::from_str(
            "set = 'pef'\nimages = 7\nfolds = 3\nsigma = 1.0\nstride = 1\n[training]\n\
             foreground = 20\nbackground = 10\nfeatures = { count = 9, window = 50 }\n\
             forest = { trees = 1, min_leaf = 1, features_per_node = 3, bootstrap = true }",
        )
        .unwrap();
        let cross_validation = CrossValidation::new(root, 1, protocol).unwrap();
        let tasks = cross_validation.estimates(&OBJECTIVES[0]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let at = |task: &dyn Task| folder.path().join(task.label());
        let images = at(&*cross_validation.set);
        std::fs::create_dir(&images).unwrap();
        cross_validation.set.run(&[], &images, &|_| ()).unwrap();
        let set = DataSet::open(&images).unwrap();
        for task in &tasks {
            // Estimates of nothing: the constant pose takes their place.
            let nothing = |&image: &usize| Estimated {
                image,
                sure_pixels: None,
                estimate: None,
            };
            let nothing: Vec<Estimated> = task.images.iter().map(nothing).collect();
            std::fs::create_dir(at(&**task)).unwrap();
            let file = at(&**task).join("estimates.json");
            std::fs::write(file, serde_json::to_vec(&nothing).unwrap()).unwrap();

            let samples = task.forest.samples_of(&set, None, &|_| ()).unwrap();
            for (row, &image) in task.forest.images.iter().enumerate() {
                assert_eq!(samples.poses.row(row), set.pose(image));
            }
            assert_eq!(samples.poses.targets(), task.forest.images.len());
        }
        let outcomes = cross_validation.outcomes(&tasks, &|task| Ok(at(task)));
        let outcomes = outcomes.unwrap();
        assert!(outcomes.iter().map(|o| o.image).eq(0..IMAGES));
        for outcome in &outcomes {
            assert_eq!(outcome.truth, set.pose(outcome.image));
            let others = outcomes.iter().filter(|o| o.fold != outcome.fold);
            let others: Vec<&Outcome> = others.collect();
            assert_eq!(outcome.estimate, ImageEstimate::guess(&outcome.constant));
            for (joint, constant) in outcome.constant.iter().enumerate() {
                let of_others: Vec<f64> = others.iter().map(|o| o.truth[joint]).collect();
                assert!((constant - mean(&of_others)).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn errors_of_a_pose_hang_together() {
        let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm/robot.toml");
        let rig = Rig::read(&robot).unwrap();
        let arm = rig.arm("right").unwrap();
        let ruler = Ruler::new(&rig, arm).unwrap();
        let mut random = stream(1, "ruler", &[]);
        let mut pose = || -> Vec<f64> {
            let joints = ruler.joints().iter();
            joints.map(|_| uniform(&mut random, -1.0, 1.0)).collect()
        };
        for _ in 0..20 {
            let (truth, estimate) = (pose(), pose());
            let error = ruler.measure(&truth, &estimate);
            assert!(
                (15.0 * error.all_deg - 7.0 * error.arm_deg - 8.0 * error.hand_deg).abs() < 1e-9
            );
            assert!(error.all_deg <= error.rms_deg);
            // The tip is a point of the arm.
            assert!(0.0 < error.tip_m && error.tip_m <= error.disp_m);
            let turned: Vec<f64> = truth.iter().map(|angle| angle + TAU).collect();
            let none = ruler.measure(&truth, &turned);
            assert!(none.rms_deg < 1e-9 && none.disp_m < 1e-9 && none.tip_m < 1e-9);
        }
    }
}
