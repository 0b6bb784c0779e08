//! `model.json`: what a model is for and how it came about.

use super::ModelFolderError;
use crate::camera::{Intrinsics, Range};
use crate::estimator::image::{STEPS, step_of};
use crate::forest::objective::ObjectiveKind;
use crate::training::Training;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The number in `model.json` that says how a model is to be read.
pub const FORMAT: u32 = 2;

/// `model.json`.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelRecord {
    /// The format version, [`FORMAT`].
    pub format: u32,
    /// The camera whose images the model knows.
    pub intrinsics: Intrinsics,
    /// The depths that it reports.
    pub range: Range,
    /// The arm that is estimated.
    pub arm: String,
    /// The joints of its pose, in order.
    pub joints: Vec<JointRecord>,
    /// The relative threshold of eq. 12: a multiple of 1 / [`STEPS`].
    pub t_r: f64,
    /// The bandwidth of eq. 2.
    pub sigma: f64,
    /// The arm is visible when so many pixels surely show it.
    pub least_arm_pixels: usize,
    /// And when at least this share of the trees of the presence forest say that there is a robot; absent
    /// without such a forest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub least_presence: Option<f64>,
    /// The mean pose of the training images: what to say without looking.
    pub mean_pose: Vec<f64>,
    /// The least and the greatest median depth of the training images of the robot, of their valid pixels
    /// (m).
    pub median_depth_m: [f64; 2],
    /// The `robot.toml` of the training images, where it was when the model was trained, and the
    /// [fingerprint](crate::scene::Rig::fingerprint) of what it said. Estimates do not need it; pictures
    /// and errors in millimetres do.
    pub robot: PathBuf,
    pub rig: String,
    /// Rows of the 4x4 matrix that takes coordinates in the robot's root frame to the camera's optical
    /// frame (m), as in the training images.
    pub camera_from_root: [[f64; 4]; 4],
    pub trained_on: TrainedOn,
    pub objective: &'static ObjectiveKind,
    pub pose: Training,
    /// Absent when images are estimated as they are.
    pub segmentation: Option<Training>,
    /// BLAKE3 of the forests, in hexadecimal.
    pub files: BTreeMap<String, String>,
}

/// A value of the estimated pose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointRecord {
    pub name: String,
    pub unit: Unit,
}

/// What the value of a joint is measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// It turns.
    Rad,
    /// It slides.
    M,
}

impl Unit {
    pub fn name(self) -> &'static str {
        match self {
            Unit::Rad => "rad",
            Unit::M => "m",
        }
    }
}

impl JointRecord {
    /// Name and unit, as columns of tables are called.
    pub fn column(&self) -> String {
        format!("{}_{}", self.name, self.unit.name())
    }
}

/// The data set of the training images: another with this name and seed shares images with it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainedOn {
    pub set: String,
    pub seed: u64,
    pub images: usize,
}

impl ModelRecord {
    /// The step of [`ImageEstimate::thresholds`](crate::estimator::image::ImageEstimate::thresholds) at
    /// t_r.
    pub fn step(&self) -> usize {
        (self.t_r * STEPS as f64).round() as usize
    }

    /// What makes the numbers unusable, as a sentence.
    pub(super) fn check(&self) -> Result<(), String> {
        if let Some(message) = self.intrinsics.mistake() {
            return Err(format!("intrinsics: {message}"));
        }
        if step_of(self.t_r).is_none() {
            return Err(format!(
                "t_r = {}: choose a multiple of {} from 0 to 1",
                self.t_r,
                1.0 / STEPS as f64
            ));
        }
        if self
            .least_presence
            .is_some_and(|share| !(0.0..=1.1).contains(&share))
        {
            return Err("least_presence must be a share, 0 to 1".to_owned());
        }
        let [low, high] = self.median_depth_m;
        if !(0.0 < low && low <= high && high <= 65.535) {
            return Err(format!(
                "median_depth_m = [{low}, {high}] must be depths in metres, the least first"
            ));
        }
        if self.mean_pose.len() != self.joints.len() {
            let (values, joints) = (self.mean_pose.len(), self.joints.len());
            return Err(format!("mean_pose has {values} values for {joints} joints"));
        }
        Ok(())
    }

    pub(super) fn read(path: &Path) -> Result<ModelRecord, ModelFolderError> {
        let text = std::fs::read_to_string(path).map_err(|cause| ModelFolderError::Read {
            path: path.to_owned(),
            cause,
        })?;
        let invalid = |message: String| ModelFolderError::Invalid {
            path: path.to_owned(),
            message,
        };
        // The version first: the rest of a file of another version may look different.
        let value: serde_json::Value =
            serde_json::from_str(&text).map_err(|e| invalid(e.to_string()))?;
        match value.get("format").and_then(serde_json::Value::as_u64) {
            Some(version) if version == u64::from(FORMAT) => {}
            Some(version) => {
                return Err(invalid(format!(
                    "the model has format {version}, but this program reads format {FORMAT}; train it \
                     again"
                )));
            }
            None => {
                return Err(invalid(
                    "this is no model of armpose: it has no \"format\"".to_owned(),
                ));
            }
        }
        serde_json::from_str(&text).map_err(|e| invalid(e.to_string()))
    }

    pub(super) fn write(&self, path: &Path) -> Result<(), ModelFolderError> {
        let failed = |cause: std::io::Error| ModelFolderError::Write {
            path: path.to_owned(),
            cause,
        };
        let mut text = serde_json::to_string_pretty(self).map_err(|e| failed(e.into()))?;
        text.push('\n');
        std::fs::write(path, text).map_err(failed)
    }
}
