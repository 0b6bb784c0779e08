//! The JSON files of a data set.

use super::{DataSetError, SetSpec};
use crate::camera::{Camera, Intrinsics};
use crate::scene::Rig;
use nalgebra::{Isometry3, Matrix4};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The number in `set.json` that says how a data set's files are to be read.
pub const FORMAT: u32 = 1;

/// `set.json`: what the data set is and how it came about. It is written last, so that a folder
/// that has one is complete.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SetRecord {
    /// The format version, [`FORMAT`].
    pub format: u32,
    pub name: String,
    pub seed: u64,
    pub specification: SetSpec,
    /// The camera preset that the specification names.
    pub camera: Camera,
    /// In the order of `robot.toml`.
    pub arms: Vec<ArmRecord>,
    /// What the labels of the images mean; 0 is background.
    pub labels: Vec<LabelRecord>,
    /// What each image shows.
    pub images: Vec<ImageRecord>,
    /// BLAKE3 of every other file, in hexadecimal.
    pub files: BTreeMap<String, String>,
}

/// An arm whose pose the set tells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArmRecord {
    pub name: String,
    /// The joints of its pose y, in order.
    pub joints: Vec<String>,
    /// Those of them that turn all round, see [`crate::robot::Joint::is_circular`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub circular: Vec<String>,
}

/// Which link a label stands for, and the arm that it belongs to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LabelRecord {
    pub label: u8,
    pub link: String,
    pub arm: String,
}

/// What there is to see in an image, and how it was found.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ImageRecord {
    /// Pixels with valid depth.
    pub valid: usize,
    /// Those of them that show each arm, in the order of `arms`.
    pub arms: Vec<usize>,
    /// Frames drawn in vain before this one because robot parts collided, with each
    /// other or the floor, or came too near to the camera.
    pub collided: usize,
    /// Frames drawn in vain before this one because too little of the robot was seen.
    pub hidden: usize,
    /// Whether the image shows the room without the robot: then nothing is known of its joints.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub without_robot: bool,
    /// Whether a wall of the room had to be moved back, so that it does not cut through the robot.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub walls_moved: bool,
    /// Where this image was taken from, as [`CameraRecord::camera_from_root`]; absent where the camera
    /// stands at its nominal place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_from_root: Option<[[f64; 4]; 4]>,
}

/// `camera.json`: the camera's geometry, for those who read the images without the robot. Where the
/// camera is jittered, its poses are the nominal one and `set.json` tells that of each image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraRecord {
    pub intrinsics: Intrinsics,
    /// In words, for the reader of the file.
    pub depth: String,
    /// The link that is the robot's root frame.
    pub root: String,
    /// Rows of the 4x4 matrix that takes coordinates in the camera's optical frame (x right,
    /// y down, z forward; m) to the root frame.
    pub root_from_camera: [[f64; 4]; 4],
    /// The inverse of `root_from_camera`.
    pub camera_from_root: [[f64; 4]; 4],
}

impl CameraRecord {
    pub(super) fn new(rig: &Rig, camera: &Camera, camera_from_root: &Isometry3<f64>) -> Self {
        CameraRecord {
            intrinsics: camera.intrinsics,
            depth: "16-bit PNG, z-depth in millimetres, 0 = invalid".to_owned(),
            root: rig.robot.links[rig.robot.root()].name.clone(),
            root_from_camera: rows(&camera_from_root.inverse().to_homogeneous()),
            camera_from_root: rows(&camera_from_root.to_homogeneous()),
        }
    }
}

/// The rows of a 4x4 matrix.
pub(super) fn rows(matrix: &Matrix4<f64>) -> [[f64; 4]; 4] {
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
}

impl SetRecord {
    /// The record of a set whose images have not been drawn yet.
    pub(super) fn new(spec: &SetSpec, seed: u64, rig: &Rig, camera: &Camera) -> Self {
        let name = |joint: &&crate::robot::Joint| joint.name.clone();
        let arm = |arm: &crate::scene::Arm| {
            let joint = |&dof: &usize| rig.robot.joints.iter().find(|j| j.dof == Some(dof));
            let joints: Vec<_> = arm.joints.iter().filter_map(joint).collect();
            ArmRecord {
                name: arm.name.clone(),
                joints: joints.iter().map(name).collect(),
                circular: joints
                    .iter()
                    .filter(|j| j.is_circular())
                    .map(name)
                    .collect(),
            }
        };
        let label = |(index, link): (usize, &crate::robot::Link)| {
            let arm = rig.arm_of_link(index)?;
            Some(LabelRecord {
                label: rig.label(index),
                link: link.name.clone(),
                arm: rig.arms[arm].name.clone(),
            })
        };
        SetRecord {
            format: FORMAT,
            name: spec.name.clone(),
            seed,
            specification: spec.clone(),
            camera: *camera,
            arms: rig.arms.iter().map(arm).collect(),
            labels: rig
                .robot
                .links
                .iter()
                .enumerate()
                .filter_map(label)
                .collect(),
            images: Vec::new(),
            files: BTreeMap::new(),
        }
    }
}

pub(super) fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), DataSetError> {
    let failed = |cause: std::io::Error| DataSetError::Write {
        path: path.to_owned(),
        cause,
    };
    let mut text = serde_json::to_string_pretty(value).map_err(|e| failed(e.into()))?;
    text.push('\n');
    std::fs::write(path, text).map_err(failed)
}

pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, DataSetError> {
    let text = std::fs::read_to_string(path).map_err(|cause| DataSetError::Read {
        path: path.to_owned(),
        cause,
    })?;
    serde_json::from_str(&text).map_err(|e| DataSetError::Invalid {
        path: path.to_owned(),
        message: e.to_string(),
    })
}

/// BLAKE3 of a file.
pub(super) fn hash(path: &Path) -> Result<String, DataSetError> {
    let bytes = std::fs::read(path).map_err(|cause| DataSetError::Read {
        path: path.to_owned(),
        cause,
    })?;
    Ok(blake3::hash(&bytes).to_hex().to_string())
}
