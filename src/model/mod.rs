//! A model: all that estimates an arm's pose in images of one camera, in one folder.
//!
//! ```text
//! model.json         what the model is for and how it came about
//! presence-*.bin     the forests that tell whether there is a robot, by the whole image and by what is taken
//!                    for the arm; absent when the training images all showed it
//! segmentation.bin   the forest that finds the arm; absent when trained without segmentation
//! pose.bin           the forest that estimates its pose in what is left
//! ```
//!
//! [`train`](training::train) -> [`Model::save`] -> [`Model::load`] -> [`Model::estimate`].

mod record;
pub mod training;

pub use record::{FORMAT, JointRecord, ModelRecord, TrainedOn, Unit};

use crate::camera::{DepthImage, Lens, Resampling};
use crate::dataset::isometry;
use crate::estimator::error::angle_error;
use crate::estimator::image::ImageEstimate;
use crate::estimator::look::Look;
use crate::estimator::segmentation::{Segmentation, masked, segment};
use crate::feature::{Extra, PaddedDepth};
use crate::forest::ForestError;
use crate::forest::model_file::ModelError;
use crate::forest::pose_forest::PoseForest;
use crate::forest::segmentation_forest::SegmentationForest;
use crate::training::presence::{CLASSES, centre};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A folder that cannot be written or used as a model.
#[derive(Debug, thiserror::Error)]
pub enum ModelFolderError {
    #[error("{path} exists already; choose another name or remove it", path = path.display())]
    Exists { path: PathBuf },
    #[error("cannot write {path}: {cause}", path = path.display())]
    Write {
        path: PathBuf,
        cause: std::io::Error,
    },
    #[error("cannot read {path}: {cause}", path = path.display())]
    Read {
        path: PathBuf,
        cause: std::io::Error,
    },
    #[error("{path}: {message}", path = path.display())]
    Invalid { path: PathBuf, message: String },
    #[error(transparent)]
    Forest(#[from] ModelError),
    #[error(
        "the images cover {percent:.0} % of what the model's camera sees, but it takes {:.0} %; train a \
         model for their camera",
        100.0 * LEAST_COVERED
    )]
    View { percent: f64 },
}

/// A trained model.
#[derive(Debug, Clone)]
pub struct Model {
    record: ModelRecord,
    presence: Option<Presence>,
    segmentation: Option<SegmentationForest>,
    pose: PoseForest,
    camera_from_root: Isometry3<f64>,
    /// The class of the arm in the segmentation; 0 without one.
    class: usize,
}

/// What a model says of one image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The share of trees that say that the image shows the robot, 0 to 1; absent when the model has learnt
    /// from images of the robot only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub presence: Option<f64>,
    /// How many pixels surely show the arm; absent when the model does not segment.
    pub sure_pixels: Option<usize>,
    /// Absent when these are fewer than [`ModelRecord::least_arm_pixels`], when `presence` is less than
    /// [`ModelRecord::least_presence`], or when the image has no valid pixel: then the arm is not visible
    /// and nothing can be said of its pose.
    pub pose: Option<PoseEstimate>,
}

/// A pose, and how far it can be trusted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseEstimate {
    /// Eq. 13 at the model's threshold t_r, in the order and the units of [`ModelRecord::joints`].
    pub values: Vec<f64>,
    /// For each joint, how far the chosen pixels' estimates are from `values`: the root of their mean
    /// squared difference, weighted by their confidences. It tells how much the pixels disagree, and not
    /// how far they are wrong together.
    pub spread: Vec<f64>,
    /// The mean confidence c_p (eq. 2) of the pixels of the arm, 0 to 1. It compares images of one model.
    pub confidence: f64,
    /// How many pixels are chosen by t_r.
    pub pixels: usize,
}

/// Median depths may be so many times less or greater than those of the training images.
const FAR_FROM_TRAINING: f64 = 3.0;

/// The share of a model's view that images must cover.
const LEAST_COVERED: f64 = 0.9;

const RECORD: &str = "model.json";
const PRESENCE: [&str; 2] = ["presence-whole.bin", "presence-arm.bin"];
const SEGMENTATION: &str = "segmentation.bin";
const POSE: &str = "pose.bin";

impl Model {
    /// Joins the parts. Fails with a sentence when they do not fit together.
    fn new(
        record: ModelRecord,
        presence: Option<Presence>,
        segmentation: Option<SegmentationForest>,
        mut pose: PoseForest,
    ) -> Result<Model, String> {
        record.check()?;
        let is_presence = |forest: &SegmentationForest| {
            forest.classes() == CLASSES && forest.features().extra() == Extra::Nothing
        };
        let forests = presence.iter().flat_map(|p| [&p.whole, &p.arm]);
        if let Some((name, _)) = PRESENCE.iter().zip(forests).find(|(_, f)| !is_presence(f)) {
            return Err(format!(
                "{name} does not tell images with the robot from others"
            ));
        }
        let names = record.joints.iter().map(|joint| &joint.name);
        if !names.eq(pose.names()) {
            return Err(format!(
                "{POSE} estimates the joints {}, not those of {RECORD}",
                pose.names().join(", ")
            ));
        }
        if pose.features().extra() != Extra::Nothing {
            return Err(format!("{POSE} asks for a context that a model lacks"));
        }
        let sigma = |e: ForestError| e.to_string();
        pose.set_sigma(record.sigma).map_err(sigma)?;
        let mut class = 0;
        if let Some(forest) = &segmentation {
            let name = format!("{} arm", record.arm);
            let place = forest.classes().iter().position(|class| *class == name);
            let usable =
                forest.features().extra() != Extra::Context && forest.classes().len() <= 256;
            class = place
                .filter(|_| usable)
                .ok_or_else(|| format!("{SEGMENTATION} does not tell the {name} from the rest"))?;
        }
        let camera_from_root = isometry(&record.camera_from_root)
            .ok_or_else(|| format!("camera_from_root of {RECORD} is no rigid motion"))?;
        Ok(Model {
            record,
            presence,
            segmentation,
            pose,
            camera_from_root,
            class,
        })
    }

    /// What `model.json` holds.
    pub fn record(&self) -> &ModelRecord {
        &self.record
    }

    /// The pose of the robot's root in the camera's optical frame, as in the training images.
    pub fn camera_from_root(&self) -> Isometry3<f64> {
        self.camera_from_root
    }

    /// What the model's camera would have seen of the images of another one, whose distortion is taken out.
    /// Fails when the other sees
    /// too little of it.
    pub fn view_of(&self, camera: impl Into<Lens>) -> Result<Resampling, ModelFolderError> {
        let resampling = Resampling::new(&camera.into(), &self.record.intrinsics);
        match resampling.covered() {
            share if share < LEAST_COVERED => Err(ModelFolderError::View {
                percent: 100.0 * share,
            }),
            _ => Ok(resampling),
        }
    }

    /// Writes the model into a new folder, at one stroke: it is there as a whole or not at all.
    pub fn save(&self, folder: &Path) -> Result<(), ModelFolderError> {
        let path = || folder.to_owned();
        if folder.exists() {
            return Err(ModelFolderError::Exists { path: path() });
        }
        let failed = |cause| ModelFolderError::Write {
            path: path(),
            cause,
        };
        let mut name = folder.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}.tmp", std::process::id()));
        let unfinished = folder.with_file_name(name);
        let written = std::fs::create_dir_all(&unfinished)
            .map_err(failed)
            .and_then(|()| self.write(&unfinished))
            .and_then(|()| std::fs::rename(&unfinished, folder).map_err(failed));
        if written.is_err() {
            // That what is unfinished could not be removed matters to no one.
            let _ = std::fs::remove_dir_all(&unfinished);
        }
        written
    }

    fn write(&self, folder: &Path) -> Result<(), ModelFolderError> {
        let mut record = self.record.clone();
        record.files.clear();
        let mut note = |name: &str| {
            let hash = hash(&folder.join(name))?;
            record.files.insert(name.to_owned(), hash);
            Ok::<(), ModelFolderError>(())
        };
        let presences = self.presence.iter().flat_map(|p| [&p.whole, &p.arm]);
        let finders = PRESENCE.into_iter().zip(presences);
        for (name, forest) in finders.chain(self.segmentation.iter().map(|f| (SEGMENTATION, f))) {
            forest.save(&folder.join(name))?;
            note(name)?;
        }
        self.pose.save(&folder.join(POSE))?;
        note(POSE)?;
        record.write(&folder.join(RECORD))
    }

    /// Reads what [`Self::save`] wrote, and checks all of it.
    pub fn load(folder: &Path) -> Result<Model, ModelFolderError> {
        let record = ModelRecord::read(&folder.join(RECORD))?;
        let invalid = |message: String| ModelFolderError::Invalid {
            path: folder.to_owned(),
            message,
        };
        let finder = |name: &str| SegmentationForest::load(&folder.join(name));
        let presence = match record.least_presence {
            Some(_) => Some(Presence {
                whole: finder(PRESENCE[0])?,
                arm: finder(PRESENCE[1])?,
            }),
            None => None,
        };
        let segmentation = match record.segmentation {
            Some(_) => Some(finder(SEGMENTATION)?),
            None => None,
        };
        let pose = PoseForest::load(&folder.join(POSE))?;
        // Each forest is whole by now, but it may be that of another model.
        let presences = presence.iter().flat_map(|_| PRESENCE);
        let forests = presences
            .chain(segmentation.iter().map(|_| SEGMENTATION))
            .chain([POSE]);
        for name in forests {
            if record.files.get(name) != Some(&hash(&folder.join(name))?) {
                let message = format!("{name} belongs to another model than {RECORD}");
                return Err(invalid(message));
            }
        }
        Model::new(record, presence, segmentation, pose).map_err(invalid)
    }

    /// Estimates the pose of the arm in an image of the model's camera. Depths that the camera of the
    /// training images would not report count as invalid. Only the pixels of every `stride`-th row and
    /// column take part: 2 takes a third of the time of 1. Panics when the image's size is another.
    pub fn estimate(&self, depth: &DepthImage, stride: usize) -> Estimate {
        let camera = &self.record.intrinsics;
        assert_eq!(
            (depth.width, depth.height),
            (camera.width, camera.height),
            "size of the image"
        );
        let in_range = masked(depth, |at| self.record.range.holds(depth.pixels[at]));
        let mut left = in_range.clone();
        let mut sure_pixels = None;
        if let Some(forest) = &self.segmentation {
            let found: Segmentation = segment(forest, &left, self.class, stride);
            let is_arm = |at: usize| usize::from(found.classes.pixels[at]) == self.class;
            left = masked(&left, is_arm);
            sure_pixels = Some(found.sure_pixels());
        }
        let presence = (self.presence.as_ref()).map(|forests| forests.share(&in_range, &left));
        let is_there = presence >= self.record.least_presence;
        let is_visible = is_there && sure_pixels.is_none_or(|n| n >= self.record.least_arm_pixels);
        Estimate {
            presence,
            sure_pixels,
            pose: is_visible.then(|| self.pose_in(&left, stride)).flatten(),
        }
    }

    /// Fails when the median of the valid depths in range is far from those of the training images: then the
    /// unit is another, or the scene. The error is the rest of a sentence about the image.
    pub fn check_depths(&self, depth: &DepthImage) -> Result<(), String> {
        let in_range = masked(depth, |at| self.record.range.holds(depth.pixels[at]));
        let [low, high] = self.record.median_depth_m;
        let median = in_range
            .median_mm()
            .map_or(0.0, |mm| f64::from(mm) / 1000.0);
        match (low / FAR_FROM_TRAINING..=high * FAR_FROM_TRAINING).contains(&median) {
            true => Ok(()),
            false => Err(format!(
                "the median of its depths is {median:.2} m, but those of the images that the model learnt \
                 from are {low:.2} to {high:.2} m; is the unit right (--depth-scale)?"
            )),
        }
    }

    /// How an image must be turned over for the arm to show clearly better than in what
    /// [`Model::estimate`] made of it as it is: visible where it was not, or in twice as many pixels. `None`
    /// for models that do not segment.
    pub fn seen_better(
        &self,
        depth: &DepthImage,
        as_it_is: &Estimate,
        stride: usize,
    ) -> Option<&'static str> {
        let pixels = |estimate: &Estimate| match estimate.pose {
            Some(_) => estimate.sure_pixels.unwrap_or(0),
            None => 0,
        };
        as_it_is.sure_pixels?;
        let turns = [
            ("turned upside down", true, true),
            ("mirrored left to right", true, false),
            ("mirrored top to bottom", false, true),
        ];
        let seen =
            turns.map(|(name, x, y)| (pixels(&self.estimate(&flipped(depth, x, y), stride)), name));
        let (most, name) = seen.into_iter().max_by_key(|(pixels, _)| *pixels)?;
        (most > 2 * pixels(as_it_is)).then_some(name)
    }

    /// The pose by the valid pixels of every `stride`-th row and column; `None` when there are none.
    fn pose_in(&self, depth: &DepthImage, stride: usize) -> Option<PoseEstimate> {
        let padded = PaddedDepth::every(stride, depth, self.pose.features().reach());
        let look = Look::new(&self.pose, depth, &padded, stride);
        let estimate = look.estimate(|_| true)?;
        let step = self.record.step();
        let chosen = &estimate.thresholds[step];
        Some(PoseEstimate {
            spread: spread(&look, &estimate, step),
            values: chosen.pose.clone(),
            confidence: estimate.mean_confidence,
            pixels: chosen.pixels,
        })
    }
}

/// The forests that tell whether an image shows the robot, see [`crate::training::presence`].
#[derive(Debug, Clone)]
struct Presence {
    /// By the whole image: surest where the room is one as in training.
    whole: SegmentationForest,
    /// By what the segmentation takes for the arm: whatever the room.
    arm: SegmentationForest,
}

impl Presence {
    /// The share of trees that say that there is a robot, 0 to 1, those of `self.arm` nine times. `arm` is what the
    /// segmentation leaves of `whole`.
    fn share(&self, whole: &DepthImage, arm: &DepthImage) -> f64 {
        let share = |forest: &SegmentationForest, depth: &DepthImage| {
            let padded = PaddedDepth::new(depth, forest.features().reach());
            let image = forest.features().on(&padded);
            f64::from(forest.shares(&image, &[centre(&padded, depth)])[1])
        };
        // Real rooms are unlike those of training: the whole image has a small say.
        (share(&self.whole, whole) + 9.0 * share(&self.arm, arm)) / 10.0
    }
}

/// The image with its columns, its rows or both in reverse order.
fn flipped(depth: &DepthImage, columns: bool, rows: bool) -> DepthImage {
    let mut flipped = depth.clone();
    if rows != columns {
        let lines = flipped.pixels.chunks_exact_mut(depth.width);
        lines.for_each(<[u16]>::reverse);
    }
    if rows {
        flipped.pixels.reverse();
    }
    flipped
}

/// See [`PoseEstimate::spread`].
fn spread(look: &Look, estimate: &ImageEstimate, step: usize) -> Vec<f64> {
    let mean = &estimate.thresholds[step].pose;
    let mut pose = vec![0.0; mean.len()];
    let (mut weight, mut squares) = (0.0, vec![0.0; mean.len()]);
    for (pixel, (confidence, chosen)) in look.chosen(estimate, step).into_iter().enumerate() {
        if chosen {
            look.leaves.pose(pixel, &mut pose);
            weight += f64::from(confidence);
            for ((sum, &y), &mean) in squares.iter_mut().zip(&pose).zip(mean) {
                *sum += f64::from(confidence) * angle_error(y, mean).powi(2);
            }
        }
    }
    squares.iter().map(|sum| (sum / weight).sqrt()).collect()
}

/// BLAKE3 of a file, in hexadecimal.
fn hash(path: &Path) -> Result<String, ModelFolderError> {
    let bytes = std::fs::read(path).map_err(|cause| ModelFolderError::Read {
        path: path.to_owned(),
        cause,
    })?;
    Ok(blake3::hash(&bytes).to_hex().to_string())
}
