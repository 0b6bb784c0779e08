//! Data sets: depth images with labels and joint values, in files that need no library of ours.
//!
//! ```text
//! depth/000000.png   16-bit grey, z-depth in mm, 0 = invalid
//! label/000000.png   8-bit grey, 0 = background, else 1 + link index, for links of the arms
//! joints.csv         image, then every joint in rad or m, the target arm's pose y first; empty cells
//!                    where the image does not show the robot
//! camera.json        intrinsics, and the camera's nominal pose in the robot's root frame
//! set.json           specification, seed, meaning of labels, pixel counts, the camera's pose in each
//!                    image where it is jittered, hashes of all files
//! ```
//!
//! [`SetSpec::read`] -> [`generate`](fn@generate) -> [`DataSet::open`] -> [`DataSet::frame`].

mod generate;
mod portrait;
mod real_frames;
mod record;
mod sampling;
mod sheet;
mod spec;
mod studio;

pub use generate::generate;
pub use portrait::portrait;
pub use real_frames::{RealFrame, RealFrames};
pub use record::{ArmRecord, CameraRecord, FORMAT, ImageRecord, LabelRecord, SetRecord};
pub use sampling::{Pixel, draw_pixels, folds, sample_pixels};
pub use sheet::{SheetStyle, contact_sheet, viridis};
pub use spec::{SetSpec, VisibilitySpec};
pub use studio::{Shot, Studio};

use crate::camera::png::{PngError, read_depth, read_labels};
use crate::camera::{CameraError, DepthImage, LabelImage};
use crate::circular::Circular;
use crate::robot::Robot;
use crate::scene::SceneError;
use crate::strict_toml::TomlError;
use nalgebra::{Isometry3, Matrix4};
use std::path::{Path, PathBuf};

/// Why a data set cannot be made or read.
#[derive(Debug, thiserror::Error)]
pub enum DataSetError {
    #[error(transparent)]
    Toml(#[from] TomlError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Camera(#[from] CameraError),
    #[error(transparent)]
    Png(#[from] PngError),
    #[error("data set \"{set}\": {message}")]
    Spec { set: String, message: String },
    #[error(
        "data set \"{set}\": of {tries} frames drawn for image {image}, {collided} have robot parts that \
         collide, come too near to the camera or reach through the floor, and all others show too little \
         of the robot; widen the poses, ask for fewer pixels, or move camera or floor"
    )]
    NoFrame {
        set: String,
        image: usize,
        tries: usize,
        collided: usize,
    },
    #[error("{path} {holds}", path = path.display())]
    NotEmpty {
        path: PathBuf,
        /// What is in the way, and what to do.
        holds: &'static str,
    },
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
    #[error(
        "{path} is not a complete data set: it has no {file}; generate it again",
        path = path.display()
    )]
    Missing { path: PathBuf, file: String },
    #[error("{path}: {message}", path = path.display())]
    Invalid { path: PathBuf, message: String },
    #[error("an image without {what} pixels cannot be sampled")]
    NoPixels { what: &'static str },
}

/// A data set on disk. Images are read when they are asked for.
#[derive(Debug, Clone)]
pub struct DataSet {
    folder: PathBuf,
    record: SetRecord,
    camera: CameraRecord,
    camera_from_root: Isometry3<f64>,
    /// By image; `None` where the camera stands at its nominal place.
    jittered: Vec<Option<Isometry3<f64>>>,
    target: usize,
    circular: Circular,
    /// The names of the columns of joints.csv, the target's pose y first.
    joints: Vec<String>,
    /// One row for each image, empty where it does not show the robot.
    values: Vec<Vec<f64>>,
}

/// One image of a data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    pub depth: DepthImage,
    pub labels: LabelImage,
    /// The target arm's pose y, rad (m for joints that slide); empty where there is no robot.
    pub joints: Vec<f64>,
}

impl DataSet {
    /// Opens a data set: reads everything but the images, of which it checks that all are there and
    /// that the first can be used. [`DataSet::verify`] checks every byte.
    pub fn open(folder: &Path) -> Result<Self, DataSetError> {
        for file in ["set.json", "camera.json", "joints.csv"] {
            if !folder.join(file).is_file() {
                return Err(missing(folder, file));
            }
        }
        let path = folder.join("set.json");
        let invalid = |file: &str, message: String| DataSetError::Invalid {
            path: folder.join(file),
            message,
        };
        // The version first: the rest of a file of another version may look different.
        let version: serde_json::Value = record::read_json(&path)?;
        match version.get("format").and_then(|f| f.as_u64()) {
            Some(v) if v == u64::from(FORMAT) => {}
            Some(v) => {
                let message = format!(
                    "the data set has format {v}, but this program reads format {FORMAT}; generate it again"
                );
                return Err(invalid("set.json", message));
            }
            None => {
                return Err(invalid(
                    "set.json",
                    "this is no data set of armpose: it has no \"format\"".to_owned(),
                ));
            }
        }
        let record: SetRecord = record::read_json(&path)?;
        let camera: CameraRecord = record::read_json(&folder.join("camera.json"))?;
        if let Some(mistake) = camera.intrinsics.mistake() {
            return Err(invalid("camera.json", format!("intrinsics: {mistake}")));
        }
        let camera_from_root = isometry(&camera.camera_from_root).ok_or_else(|| {
            invalid(
                "camera.json",
                "camera_from_root is no rigid motion".to_owned(),
            )
        })?;
        let is_jittered = record.specification.camera_jitter.is_some();
        let jittered = |image: &ImageRecord| match &image.camera_from_root {
            None => (!is_jittered).then_some(None),
            Some(rows) => isometry(rows).map(Some),
        };
        let jittered = (record.images.iter())
            .map(jittered)
            .collect::<Option<Vec<_>>>()
            .ok_or_else(|| {
                let message = "a camera_from_root of the images is missing or no rigid motion";
                invalid("set.json", message.to_owned())
            })?;
        let target = record
            .arms
            .iter()
            .position(|a| a.name == record.specification.target);
        let target = target.ok_or_else(|| {
            let target = &record.specification.target;
            invalid(
                "set.json",
                format!("the target \"{target}\" is none of the arms"),
            )
        })?;
        let arm = &record.arms[target];
        let place = |name: &String| arm.joints.iter().position(|joint| joint == name);
        let circular: Option<Vec<usize>> = arm.circular.iter().map(place).collect();
        let circular = circular.ok_or_else(|| {
            let message = "a circular joint is none of the arm's joints".to_owned();
            invalid("set.json", message)
        })?;
        let (joints, values) = read_joints(&folder.join("joints.csv"))?;
        if values.is_empty() || values.len() != record.images.len() {
            let (rows, images) = (values.len(), record.images.len());
            let message = format!("{rows} images, but set.json tells of {images}");
            return Err(invalid("joints.csv", message));
        }
        if !joints.starts_with(&record.arms[target].joints) {
            let message = "the columns do not start with the pose of the target arm".to_owned();
            return Err(invalid("joints.csv", message));
        }
        for (image, row) in values.iter().enumerate() {
            if row.is_empty() != record.images[image].without_robot {
                let message = format!(
                    "image {image} has joint values and no robot by set.json, or a robot and no values"
                );
                return Err(invalid("joints.csv", message));
            }
            for file in [depth_file(image), label_file(image)] {
                if !folder.join(&file).is_file() {
                    return Err(missing(folder, &file));
                }
            }
        }
        let folder = folder.to_owned();
        let set = DataSet {
            folder,
            record,
            camera,
            camera_from_root,
            jittered,
            target,
            circular: Circular::new(circular),
            joints,
            values,
        };
        set.frame(0)?;
        Ok(set)
    }

    /// The number of images, at least 1.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Where the set lies.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// `set.json`
    pub fn record(&self) -> &SetRecord {
        &self.record
    }

    /// `camera.json`
    pub fn camera(&self) -> &CameraRecord {
        &self.camera
    }

    /// The nominal pose of the robot's root in the camera's optical frame.
    pub fn camera_from_root(&self) -> &Isometry3<f64> {
        &self.camera_from_root
    }

    /// The pose of the robot's root in the camera's optical frame when an image was taken: the nominal
    /// one unless the camera stood elsewhere. Panics when there is no such image.
    pub fn camera_from_root_of(&self, image: usize) -> &Isometry3<f64> {
        self.jittered[image]
            .as_ref()
            .unwrap_or(&self.camera_from_root)
    }

    /// Index of the target arm in [`SetRecord::arms`].
    pub fn target(&self) -> usize {
        self.target
    }

    /// The names of the joints of the target's pose y, in order.
    pub fn target_joints(&self) -> &[String] {
        &self.record.arms[self.target].joints
    }

    /// Which values of the target's pose y are angles of joints that turn all round.
    pub fn circular(&self) -> &Circular {
        &self.circular
    }

    /// The images that show the robot, ascending. Only these have a pose.
    pub fn images_with_robot(&self) -> Vec<usize> {
        let shows = |&image: &usize| !self.record.images[image].without_robot;
        (0..self.len()).filter(shows).collect()
    }

    /// The target's pose y in an image. Panics when there is no such image, or no robot in it.
    pub fn pose(&self, image: usize) -> &[f64] {
        &self.values[image][..self.target_joints().len()]
    }

    /// The configuration of the whole robot in an image, from the names of the joints. Panics when
    /// there is no such image, or no robot in it.
    pub fn configuration(&self, image: usize, robot: &Robot) -> Result<Vec<f64>, DataSetError> {
        let value = |joint: &crate::robot::Joint| {
            let column = self.joints.iter().position(|name| *name == joint.name);
            column
                .map(|c| self.values[image][c])
                .ok_or_else(|| DataSetError::Invalid {
                    path: self.folder.join("joints.csv"),
                    message: format!(
                        "it has no joint \"{}\" of robot \"{}\"",
                        joint.name, robot.name
                    ),
                })
        };
        robot.dof_joints().map(value).collect()
    }

    /// For each of the 256 labels, the arm that it belongs to, as an index into [`SetRecord::arms`].
    pub fn arm_of_label(&self) -> [Option<usize>; 256] {
        let mut table = [None; 256];
        for entry in &self.record.labels {
            let arm = self.record.arms.iter().position(|a| a.name == entry.arm);
            table[usize::from(entry.label)] = arm;
        }
        table
    }

    /// The classes that a segmentation tells apart: the background and then the arms, in the order of
    /// [`SetRecord::arms`].
    pub fn classes(&self) -> Vec<String> {
        let arms = self.record.arms.iter().map(|a| format!("{} arm", a.name));
        std::iter::once("background".to_owned())
            .chain(arms)
            .collect()
    }

    /// Reads an image. Panics when there is no such image.
    pub fn frame(&self, image: usize) -> Result<Frame, DataSetError> {
        let intrinsics = &self.camera.intrinsics;
        Ok(Frame {
            depth: read_depth(&self.folder.join(depth_file(image)), intrinsics)?,
            labels: read_labels(&self.folder.join(label_file(image)), intrinsics)?,
            joints: match self.record.images[image].without_robot {
                true => Vec::new(),
                false => self.pose(image).to_vec(),
            },
        })
    }

    /// Reads every file and compares its hash with the one in `set.json`.
    pub fn verify(&self) -> Result<(), DataSetError> {
        for (file, expected) in &self.record.files {
            let path = self.folder.join(file);
            if record::hash(&path)? != *expected {
                let message = "the file was altered after the data set was made".to_owned();
                return Err(DataSetError::Invalid { path, message });
            }
        }
        Ok(())
    }
}

fn missing(folder: &Path, file: &str) -> DataSetError {
    DataSetError::Missing {
        path: folder.to_owned(),
        file: file.to_owned(),
    }
}

/// The folder of the depth images.
const DEPTH: &str = "depth";
/// The folder of the label images.
const LABEL: &str = "label";

fn depth_file(image: usize) -> String {
    format!("{DEPTH}/{image:06}.png")
}

fn label_file(image: usize) -> String {
    format!("{LABEL}/{image:06}.png")
}

/// The rigid motion with these rows, `None` if it is none.
pub(crate) fn isometry(rows: &[[f64; 4]; 4]) -> Option<Isometry3<f64>> {
    let matrix = Matrix4::from_fn(|row, column| rows[row][column]);
    nalgebra::try_convert(matrix)
}

/// Reads joints.csv: the names of the joints without their units, and a row for each image, which is
/// empty when all its cells are.
fn read_joints(path: &Path) -> Result<(Vec<String>, Vec<Vec<f64>>), DataSetError> {
    let invalid = |message: String| DataSetError::Invalid {
        path: path.to_owned(),
        message,
    };
    let mut reader = csv::Reader::from_path(path).map_err(|e| invalid(e.to_string()))?;
    let header = reader.headers().map_err(|e| invalid(e.to_string()))?;
    let name = |column: &str| {
        let name = column.strip_suffix("_rad").or(column.strip_suffix("_m"));
        name.map(str::to_owned).ok_or_else(|| {
            invalid(format!(
                "column \"{column}\" does not end with its unit, _rad or _m"
            ))
        })
    };
    let joints = header
        .iter()
        .skip(1)
        .map(name)
        .collect::<Result<Vec<_>, _>>()?;
    let mut values = Vec::new();
    for (image, row) in reader.records().enumerate() {
        let row = row.map_err(|e| invalid(e.to_string()))?;
        let number = |text: &str| text.parse().ok().filter(|x: &f64| x.is_finite());
        let is_empty = row.iter().skip(1).all(str::is_empty);
        let cells = if is_empty { 1 } else { row.len() };
        let row: Option<Vec<f64>> = row.iter().take(cells).map(number).collect();
        match row.as_deref() {
            Some([number, rest @ ..]) if *number == image as f64 => values.push(rest.to_vec()),
            _ => {
                return Err(invalid(format!(
                    "row {} is not image {image} and its finite joint values",
                    image + 1
                )));
            }
        }
    }
    Ok((joints, values))
}
