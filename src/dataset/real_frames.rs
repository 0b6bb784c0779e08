//! Depth images that a real camera took of a robot whose encoders were read.

use super::DataSetError;
use crate::camera::png::read_depth;
use crate::camera::{DepthImage, Intrinsics};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A few real depth images, as one JSON file tells of them: `joint_names`, the intrinsics `width`,
/// `height`, `fx`, `fy`, `cx`, `cy`, and `frames`, each with its image `depth` (16-bit PNG, mm, relative
/// to the JSON file) and the joints' values `q`. What else there is is not read.
#[derive(Debug, Clone)]
pub struct RealFrames {
    pub joints: Vec<String>,
    pub camera: Intrinsics,
    pub frames: Vec<RealFrame>,
}

/// An image, and the joints by the encoders: rad (m), in the order of [`RealFrames::joints`].
#[derive(Debug, Clone)]
pub struct RealFrame {
    pub depth: PathBuf,
    pub encoders: Vec<f64>,
}

impl RealFrames {
    /// Reads the file; the images are not looked at yet.
    pub fn read(path: &Path) -> Result<RealFrames, DataSetError> {
        #[derive(Deserialize)]
        struct Frame {
            depth: PathBuf,
            q: Vec<f64>,
        }
        #[derive(Deserialize)]
        struct File {
            joint_names: Vec<String>,
            width: usize,
            height: usize,
            fx: f64,
            fy: f64,
            cx: f64,
            cy: f64,
            frames: Vec<Frame>,
        }
        let file: File = super::record::read_json(path)?;
        let invalid = |message: String| DataSetError::Invalid {
            path: path.to_owned(),
            message,
        };
        let camera = Intrinsics {
            width: file.width,
            height: file.height,
            fx: file.fx,
            fy: file.fy,
            cx: file.cx,
            cy: file.cy,
        };
        if let Some(mistake) = camera.mistake() {
            return Err(invalid(mistake));
        }
        let joints = file.joint_names.len();
        if let Some(at) = file.frames.iter().position(|f| f.q.len() != joints) {
            return Err(invalid(format!("frame {at} has not {joints} joints")));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let frame = |frame: Frame| RealFrame {
            depth: folder.join(frame.depth),
            encoders: frame.q,
        };
        Ok(RealFrames {
            joints: file.joint_names,
            camera,
            frames: file.frames.into_iter().map(frame).collect(),
        })
    }

    /// Reads an image. Panics when there is no such frame.
    pub fn depth(&self, frame: usize) -> Result<DepthImage, DataSetError> {
        Ok(read_depth(&self.frames[frame].depth, &self.camera)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"{
        "joint_names": ["a", "b"], "width": 4, "height": 3,
        "fx": 5.0, "fy": 5.5, "cx": 1.5, "cy": 1.0, "licence": "any",
        "frames": [{ "depth": "images/0.png", "q": [0.1, -0.2], "mask": "0.png" }]
    }"#;

    fn read(text: &str) -> Result<RealFrames, DataSetError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("real.json");
        std::fs::write(&path, text).unwrap();
        RealFrames::read(&path)
    }

    #[test]
    fn images_lie_relative_to_the_file() {
        let real = read(FILE).unwrap();
        assert_eq!(real.joints, ["a", "b"]);
        assert_eq!((real.camera.fy, real.camera.height), (5.5, 3));
        assert!(real.frames[0].depth.ends_with("images/0.png"));
        assert!(real.frames[0].depth.is_absolute());
        assert_eq!(real.frames[0].encoders, [0.1, -0.2]);
    }

    #[test]
    fn what_does_not_fit_together_is_told() {
        let told = |old: &str, new: &str| read(&FILE.replace(old, new)).unwrap_err().to_string();
        assert!(told("[0.1, -0.2]", "[0.1]").ends_with("frame 0 has not 2 joints"));
        assert!(told("\"fx\": 5.0", "\"fx\": -5.0").contains("real.json: "));
        assert!(told("\"width\": 4,", "").contains("width"));
    }
}
