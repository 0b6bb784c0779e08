//! Training a model on a data set: first the forest that finds the arm, then the one that estimates its
//! pose in what the first leaves of the images.

use super::record::{FORMAT, JointRecord, ModelRecord, TrainedOn, Unit};
use super::{Model, Presence};
use crate::Progress;
use crate::camera::{DepthImage, Photographer};
use crate::dataset::{DataSet, Pixel, SetSpec, Studio, draw_pixels};
use crate::estimator::error::mean_pose;
use crate::estimator::segmentation::{least_arm_pixels, masked, segment};
use crate::feature::{Extra, FeatureSpec};
use crate::forest::grow::GrowSpec;
use crate::forest::objective::{Make, OBJECTIVES, ObjectiveKind};
use crate::forest::pose_forest::PoseForest;
use crate::forest::segmentation_forest::SegmentationForest;
use crate::pose_space::disp::Disp;
use crate::random::{seed, stream};
use crate::robot::Motion;
use crate::scene::Rig;
use crate::training::pose::Samples;
use crate::training::seen::Seen;
use crate::training::{Training, TrainingError, presence, segmentation};
use rayon::prelude::*;
use std::path::Path;

/// How a model is trained.
#[derive(Debug, Clone)]
pub struct ModelSpec {
    pub objective: &'static ObjectiveKind,
    pub pose: Training,
    /// Absent to estimate images as they are.
    pub segmentation: Option<Training>,
    /// Whether to learn what an image without the arm looks like, which the paper does not: half of the
    /// background's samples are then pixels that a first small forest takes for the arm, and another forest
    /// tells whether there is a robot at all.
    pub learn_absence: bool,
    /// The bandwidth of eq. 2.
    pub sigma: f64,
    /// The relative threshold of eq. 12.
    pub t_r: f64,
}

impl ModelSpec {
    /// The paper's: MSE, sigma and t_r of section II-A and IV-B, the forests of sections IV-A and IV-C as
    /// in the studies `fig9` and `table1`. Windows are of images 640 pixels wide, and in proportion for
    /// others of `width`.
    pub fn of_paper(width: usize) -> ModelSpec {
        let window = |of_640: usize| (of_640 * width).div_ceil(640);
        let forest = |min_leaf, features_per_node| GrowSpec {
            trees: 10,
            min_leaf,
            features_per_node,
            max_depth: None,
            bootstrap: true,
        };
        ModelSpec {
            objective: &OBJECTIVES[0],
            pose: Training {
                foreground: 2000,
                background: 1000,
                features: FeatureSpec {
                    count: 500,
                    window: window(200),
                },
                forest: forest(5, 22),
            },
            segmentation: Some(Training {
                foreground: 1500,
                background: 1500,
                features: FeatureSpec {
                    count: 200,
                    window: window(100),
                },
                forest: forest(1, 14),
            }),
            learn_absence: false,
            sigma: 1.0,
            t_r: 0.9,
        }
    }

    /// The sum of what [`train`] reports to its progress, on so many images of which so many show the
    /// robot.
    pub fn steps(&self, images: usize, with_robot: usize) -> u64 {
        let of_halves = |training: &Training| {
            let half = |half| half_of(training, half).steps(images_of(images, half).count());
            half(0) + half(1)
        };
        let halves = self.segmentation.as_ref().map_or(0, |training| {
            let scouts = match self.learn_absence {
                true => of_halves(&scout(training)) + images as u64,
                false => 0,
            };
            of_halves(training) + scouts
        });
        let presence = match self.segmentation.is_some() && self.learn_absence {
            true => (4 * PRESENCE_IMAGES + CALIBRATION_ROOMS) as u64,
            false => 0,
        };
        halves + presence + self.pose.steps(with_robot)
    }
}

/// The images of a half: every second one.
fn images_of(images: usize, half: usize) -> impl Iterator<Item = usize> {
    (half..images).step_by(2)
}

/// The training of a half: with every second tree.
fn half_of(training: &Training, half: usize) -> Training {
    let mut training = training.clone();
    training.forest.trees = (training.forest.trees + 1 - half) / 2;
    training
}

/// Trains a model on all images of a set: to find the arm on every image, to estimate its pose on those that
/// show the robot. `robot` is the file of `rig`, the robot that the images show.
///
/// The pose forest must learn from segmentations with the faults that those of new images will have, and
/// a forest makes hardly any on images that it was trained on. So one half of the segmentation forest's
/// trees is trained on every second image and the other half on the rest, and each image is segmented by
/// the trees that have not seen it. New images are segmented by all of them.
pub fn train(
    set: &DataSet,
    (rig, robot): (&Rig, &Path),
    spec: &ModelSpec,
    progress: Progress,
) -> Result<Model, TrainingError> {
    let mut record = record(set, rig, robot, spec)?;
    let shown = set.images_with_robot();
    let halves = match &spec.segmentation {
        Some(training) => Some(train_halves(set, training, spec.learn_absence, progress)?),
        None => None,
    };
    let arm = set.target() + 1;
    let see = |image: usize| {
        let frame = set.frame(image)?;
        let Some(halves) = &halves else {
            return Ok::<_, TrainingError>(Seen::whole(frame));
        };
        let found = segment(&halves[1 - image % 2], &frame.depth, arm, 1);
        let sure_pixels = found.sure_pixels();
        Ok(Seen::segmented(
            frame,
            &found.classes,
            arm as u8,
            sure_pixels,
        ))
    };
    let samples = Samples::draw(set, &shown, &spec.pose, Extra::Nothing, see, progress)?;
    let distances;
    let objective = match spec.objective.make {
        Make::OfPoses(make) => make(&samples.poses)?,
        Make::OfDistances(make) => {
            let poses: Vec<&[f64]> = shown.iter().map(|&image| set.pose(image)).collect();
            distances = Disp::new(&rig.robot, set.target_joints())?.matrix(&poses);
            make(&distances)?
        }
    };
    let seed = seed(set.record().seed, "forest", &[]);
    let (trees, leaves) = samples.grow(&*objective, &spec.pose.forest, seed, progress)?;
    let names = set.target_joints().to_vec();
    let circular = set.circular().clone();
    let pose = PoseForest::new(samples.features, names, circular, trees, leaves, spec.sigma)?;
    let segmentation = match halves {
        Some([even, odd]) => Some(even.join(odd)?),
        None => None,
    };
    let mut presence = None;
    if let Some(segmentation) = segmentation.as_ref().filter(|_| spec.learn_absence) {
        let (forests, least) = train_presence(set, rig, segmentation, &record, progress)?;
        record.least_presence = Some(least);
        presence = Some(forests);
    }
    Model::new(record, presence, segmentation, pose).map_err(TrainingError::Unsuitable)
}

/// Segmentation forests trained on the even and on the odd images.
fn train_halves(
    set: &DataSet,
    training: &Training,
    learn_absence: bool,
    progress: Progress,
) -> Result<[SegmentationForest; 2], TrainingError> {
    if set.len() < 2 || training.forest.trees < 2 {
        return Err(TrainingError::Unsuitable(
            "segmenting takes at least two images and two trees, half of which are trained on half of \
             the images"
                .to_owned(),
        ));
    }
    let train = |training: &Training, mistaken: &[Vec<Pixel>], half: usize| {
        let images: Vec<usize> = images_of(set.len(), half).collect();
        let seed = seed(set.record().seed, "segmentation forest", &[half as u64]);
        let training = half_of(training, half);
        segmentation::train(set, &images, &training, mistaken, seed, progress)
    };
    let both = |training: &Training, mistaken: &[Vec<Pixel>]| {
        Ok([train(training, mistaken, 0)?, train(training, mistaken, 1)?])
    };
    if !learn_absence {
        return both(training, &[]);
    }
    let scouts = both(&scout(training), &[])?;
    both(training, &mistaken(set, &scouts, progress)?)
}

/// The training of a forest that only looks for what is hard.
fn scout(training: &Training) -> Training {
    let mut scout = training.clone();
    scout.forest.trees = 4;
    scout
}

/// At most so many pixels of an image are kept as mistaken.
const MOST_MISTAKEN: usize = 3000;

/// For each image, pixels of the background that the forest of the other half takes for an arm.
fn mistaken(
    set: &DataSet,
    halves: &[SegmentationForest; 2],
    progress: Progress,
) -> Result<Vec<Vec<Pixel>>, TrainingError> {
    let arm_of_label = set.arm_of_label();
    let of_image = |image: usize| {
        let frame = set.frame(image)?;
        let found = segment(&halves[1 - image % 2], &frame.depth, 0, 1).classes;
        let is_mistaken = |&at: &usize| {
            found.pixels[at] != 0 && arm_of_label[usize::from(frame.labels.pixels[at])].is_none()
        };
        let pixel = |at: usize| ((at % found.width) as u16, (at / found.width) as u16);
        let all: Vec<Pixel> = (0..found.pixels.len())
            .filter(is_mistaken)
            .map(pixel)
            .collect();
        let mut random = stream(set.record().seed, "mistaken pixels", &[image as u64]);
        progress(1);
        let kept = MOST_MISTAKEN.min(all.len());
        Ok(draw_pixels(&all, kept, &mut random).unwrap_or_default())
    };
    (0..set.len()).map(of_image).collect()
}

/// New images by which a presence forest is trained, half of them without the robot, and further ones
/// without it by which its threshold is chosen.
const PRESENCE_IMAGES: usize = 2000;
const CALIBRATION_ROOMS: usize = 400;
/// The first are segmented by every second row and column: four times as fast.
const PRESENCE_STRIDE: usize = 2;
/// The share of rooms without the robot in which an arm may be seen.
const FALSE_ARMS: f64 = 0.01;
/// The least share of the trees that must say that there is a robot, whatever the rooms: real rooms are
/// stranger than ours.
const LEAST_PRESENCE: f64 = 0.7;

/// The forests that tell whether there is a robot, and the share of their trees that must say so: at least
/// [`LEAST_PRESENCE`], and so many that of the rooms in which `segmentation` surely finds enough of the arm
/// no more than [`FALSE_ARMS`] of all rooms pass.
fn train_presence(
    set: &DataSet,
    rig: &Rig,
    segmentation: &SegmentationForest,
    record: &ModelRecord,
    progress: Progress,
) -> Result<(Presence, f64), TrainingError> {
    let of_set = set.record();
    let spec = |what: &str, without_robot: f64| SetSpec {
        name: format!("{} ({what})", of_set.name),
        without_robot,
        ..of_set.specification.clone()
    };
    let both = spec("presence", 0.5);
    let studio = Studio::new(&both, rig.clone(), of_set.camera)?;
    let arm = set.target() + 1;
    let left_by = |stride: usize| {
        move |depth: &DepthImage| {
            let found = segment(segmentation, depth, arm, stride).classes;
            masked(depth, |at| usize::from(found.pixels[at]) == arm)
        }
    };
    let train = |see: &(dyn Fn(&DepthImage) -> DepthImage + Sync)| {
        presence::train(&studio, PRESENCE_IMAGES, see, of_set.seed, progress)
    };
    let forests = Presence {
        whole: train(&DepthImage::clone)?,
        arm: train(&left_by(PRESENCE_STRIDE))?,
    };

    let rooms = spec("rooms", 1.0);
    let studio = Studio::new(&rooms, rig.clone(), of_set.camera)?;
    let mut photographer = Photographer::new(&of_set.camera);
    let mut shares = Vec::new();
    for image in 0..CALIBRATION_ROOMS {
        let shot = studio.shoot(image, &mut photographer, of_set.seed)?;
        let depth = &shot.photo.depth;
        let found = segment(segmentation, depth, arm, 1);
        if found.sure_pixels() >= record.least_arm_pixels {
            let left = masked(depth, |at| usize::from(found.classes.pixels[at]) == arm);
            shares.push(forests.share(depth, &left));
        }
        progress(1);
    }
    shares.sort_by(|a, b| f64::total_cmp(b, a));
    let allowed = (FALSE_ARMS * CALIBRATION_ROOMS as f64) as usize;
    let a_little = 1e-3;
    let least = shares.get(allowed).map_or(0.0, |share| share + a_little);
    Ok((forests, least.max(LEAST_PRESENCE)))
}

/// What is known before anything is trained.
fn record(
    set: &DataSet,
    rig: &Rig,
    robot: &Path,
    spec: &ModelSpec,
) -> Result<ModelRecord, TrainingError> {
    let of_set = set.record();
    let target = &of_set.specification.target;
    let unsuitable = |message: String| {
        TrainingError::Unsuitable(format!(
            "{} is not the robot of data set \"{}\": {message}",
            robot.display(),
            of_set.name
        ))
    };
    let arm = rig
        .arm(target)
        .ok_or_else(|| unsuitable(format!("it has no arm \"{target}\"")))?;
    let all: Vec<_> = rig.robot.dof_joints().collect();
    let joint = |&dof: &usize| JointRecord {
        name: all[dof].name.clone(),
        unit: match all[dof].motion {
            Motion::Prismatic(_) => Unit::M,
            _ => Unit::Rad,
        },
    };
    let joints: Vec<JointRecord> = rig.arms[arm].joints.iter().map(joint).collect();
    if !joints
        .iter()
        .map(|joint| &joint.name)
        .eq(set.target_joints())
    {
        let message = format!("its arm \"{target}\" has other joints");
        return Err(unsuitable(message));
    }
    let intrinsics = set.camera().intrinsics;
    let shown = set.images_with_robot();
    if shown.is_empty() {
        return Err(TrainingError::Unsuitable(format!(
            "no image of data set \"{}\" shows the robot; render one with a smaller without_robot",
            of_set.name
        )));
    }
    Ok(ModelRecord {
        format: FORMAT,
        intrinsics,
        range: of_set.camera.range,
        arm: target.clone(),
        joints,
        t_r: spec.t_r,
        sigma: spec.sigma,
        least_arm_pixels: least_arm_pixels(&intrinsics),
        least_presence: None,
        mean_pose: mean_pose(shown.iter().map(|&image| set.pose(image)), set.circular()),
        median_depth_m: median_depths(set)?,
        robot: robot.to_owned(),
        rig: rig.fingerprint(),
        camera_from_root: set.camera().camera_from_root,
        trained_on: TrainedOn {
            set: of_set.name.clone(),
            seed: of_set.seed,
            images: set.len(),
        },
        objective: spec.objective,
        pose: spec.pose.clone(),
        segmentation: spec.segmentation.clone(),
        files: Default::default(),
    })
}

/// The least and the greatest median depth of the images of the robot (m), of their valid pixels.
fn median_depths(set: &DataSet) -> Result<[f64; 2], TrainingError> {
    let median = |image| Ok(set.frame(image)?.depth.median_mm());
    let medians: Vec<Option<u16>> = set
        .images_with_robot()
        .into_par_iter()
        .map(median)
        .collect::<Result<_, TrainingError>>()?;
    let metres = |mm: Option<u16>| f64::from(mm.unwrap_or(0)) / 1000.0;
    let medians = medians.into_iter().flatten();
    Ok([metres(medians.clone().min()), metres(medians.max())])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every image and every tree belongs to one half.
    #[test]
    fn halves_make_the_whole() {
        let training = ModelSpec::of_paper(640).segmentation.unwrap();
        for trees in 2..6 {
            let mut training = training.clone();
            training.forest.trees = trees;
            let halves = [0, 1].map(|half| half_of(&training, half).forest.trees);
            assert!(halves[0] + halves[1] == trees && halves[1] > 0);
        }
        for images in 2..6 {
            let mut all: Vec<usize> = images_of(images, 0).collect();
            assert!(all.iter().all(|image| image % 2 == 0));
            all.extend(images_of(images, 1));
            all.sort_unstable();
            assert_eq!(all, (0..images).collect::<Vec<_>>());
        }
    }
}
