//! Cameras as other tools describe them.
//!
//! JSON or YAML, told apart by what they hold rather than by their name:
//!
//! - `width`, `height`, `fx`, `fy`, `cx`, `cy`, alone or as `intrinsics`: ours, the `camera.json` of a data
//!   set, BOP's `camera.json`; with `ppx`, `ppy`, `model`, `coeffs`: librealsense's
//! - a matrix `K`, `k`, `camera_matrix`, `cam_K` or `intrinsic_matrix`, by rows or (as Open3D's) by
//!   columns: ROS `CameraInfo`, ROS `camera_calibration`, OpenCV's `FileStorage`
//! - an object for each image, by its number, with `cam_K` and `depth_scale`: BOP's `scene_camera.json`

mod parts;

use super::{Distortion, Intrinsics, Lens, open};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A file that no camera can be read from.
#[derive(Debug, thiserror::Error)]
pub enum CameraFileError {
    #[error("cannot read {path}: {cause}", path = path.display())]
    Read {
        path: PathBuf,
        cause: std::io::Error,
    },
    #[error("{path}: {message}", path = path.display())]
    Invalid { path: PathBuf, message: String },
}

/// Files of cameras are shorter than this; the longest are those with an entry for each image.
const LONGEST: u64 = 1 << 24;

/// A camera as a file tells of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FileCamera {
    /// Width and height; unknown where the file only holds a matrix.
    size: Option<[usize; 2]>,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: Distortion,
    unit_m: Option<f64>,
}

impl FileCamera {
    /// Width and height of its images, if the file tells them.
    pub fn size(&self) -> Option<[usize; 2]> {
        self.size
    }

    /// Metres that one unit of an integer depth stands for, if the file tells it.
    pub fn unit_m(&self) -> Option<f64> {
        self.unit_m
    }

    /// The camera of images of this width and height. The error is a sentence.
    pub fn lens(&self, [width, height]: [usize; 2]) -> Result<Lens, String> {
        let intrinsics = Intrinsics {
            width,
            height,
            fx: self.fx,
            fy: self.fy,
            cx: self.cx,
            cy: self.cy,
        };
        match intrinsics.mistake() {
            Some(mistake) => Err(mistake),
            None => Ok(Lens {
                intrinsics,
                distortion: self.distortion,
            }),
        }
    }
}

/// The cameras of a file.
#[derive(Debug, Clone)]
pub struct CameraFile {
    path: PathBuf,
    cameras: Cameras,
}

#[derive(Debug, Clone)]
enum Cameras {
    One(FileCamera),
    /// By the number of the image.
    Each(BTreeMap<u64, FileCamera>),
}

/// Reads cameras; what is known of them is checked. Several documents in a YAML file, as `ros2 topic echo`
/// writes them: the first is read.
pub fn read(path: &Path) -> Result<CameraFile, CameraFileError> {
    let text = read_text(path)?;
    let invalid = |message: String| CameraFileError::Invalid {
        path: path.to_owned(),
        message,
    };
    let cameras = parse(&text).and_then(cameras).map_err(invalid)?;
    let file = CameraFile {
        path: path.to_owned(),
        cameras,
    };
    let all: Vec<&FileCamera> = match &file.cameras {
        Cameras::One(camera) => vec![camera],
        Cameras::Each(cameras) => cameras.values().collect(),
    };
    for camera in all {
        if let Some(size) = camera.size {
            camera.lens(size).map_err(invalid)?;
        }
    }
    Ok(file)
}

impl CameraFile {
    /// The camera of all images; `None` when the file has different ones.
    pub fn sole(&self) -> Option<&FileCamera> {
        match &self.cameras {
            Cameras::One(camera) => Some(camera),
            Cameras::Each(cameras) => {
                let first = cameras.values().next()?;
                cameras.values().all(|c| c == first).then_some(first)
            }
        }
    }

    /// The camera of an image: where each has its own, the last number in the image's name tells which.
    pub fn of(&self, image: &Path) -> Result<&FileCamera, CameraFileError> {
        if let Some(sole) = self.sole() {
            return Ok(sole);
        }
        let Cameras::Each(cameras) = &self.cameras else {
            unreachable!("one camera is the sole one");
        };
        let stem = image.file_stem().unwrap_or_default().to_string_lossy();
        let number = (stem.rsplit(|c: char| !c.is_ascii_digit()))
            .find(|digits| !digits.is_empty())
            .and_then(|digits| digits.parse::<u64>().ok());
        let camera = number.and_then(|number| cameras.get(&number));
        camera.ok_or_else(|| CameraFileError::Invalid {
            path: self.path.clone(),
            message: match number {
                Some(number) => format!("it has no camera for image {number}, {}", image.display()),
                None => format!(
                    "its cameras differ by the image's number, but {} has none",
                    image.display()
                ),
            },
        })
    }
}

fn read_text(path: &Path) -> Result<String, CameraFileError> {
    let failed = |cause| CameraFileError::Read {
        path: path.to_owned(),
        cause,
    };
    let (file, length) = open(path).map_err(failed)?;
    if length > LONGEST {
        return Err(failed(std::io::Error::other(format!(
            "{length} bytes are too many for a file of cameras"
        ))));
    }
    let mut text = String::new();
    let mut file = file.take(LONGEST);
    file.read_to_string(&mut text).map_err(failed)?;
    Ok(text)
}

/// JSON when it begins like that, else YAML.
fn parse(text: &str) -> Result<Value, String> {
    let text = text.trim_start_matches('\u{feff}');
    match text.trim_start().chars().next() {
        None => Err("it is empty".to_owned()),
        Some('{' | '[') => serde_json::from_str(text).map_err(|e| e.to_string()),
        Some('<') => Err("it is XML; save the camera as YAML or JSON".to_owned()),
        Some(_) => {
            // OpenCV's first line, with its colon, is no YAML.
            let text = match text.strip_prefix("%YAML:") {
                Some(rest) => rest.split_once('\n').map_or("", |(_, rest)| rest),
                None => text,
            };
            let documents: Vec<Value> = serde_saphyr::from_multiple(text).map_err(|e| {
                let message = e.to_string();
                format!("it is neither JSON nor YAML: {}", first_line(&message))
            })?;
            documents
                .into_iter()
                .find(|document| !document.is_null())
                .ok_or_else(|| "it is empty".to_owned())
        }
    }
}

fn first_line(message: &str) -> &str {
    message.lines().next().unwrap_or_default()
}

fn cameras(value: Value) -> Result<Cameras, String> {
    let Value::Object(object) = &value else {
        return Err("it holds no camera, but a list or a single value".to_owned());
    };
    let numbers: Option<Vec<u64>> = object.keys().map(|key| key.parse().ok()).collect();
    match numbers {
        Some(numbers) if !numbers.is_empty() => {
            let of_image = |(number, camera): (u64, &Value)| {
                let camera = parts::camera(camera);
                let camera = camera.map_err(|message| format!("image {number}: {message}"))?;
                Ok((number, camera))
            };
            let cameras = numbers.into_iter().zip(object.values()).map(of_image);
            Ok(Cameras::Each(cameras.collect::<Result<_, String>>()?))
        }
        _ => {
            let inner = object.get("intrinsics").filter(|inner| inner.is_object());
            Ok(Cameras::One(parts::camera(inner.unwrap_or(&value))?))
        }
    }
}
