//! The depth camera: images, intrinsics, rasteriser, projector shadow, disparity filter, noise.
//!
//! A [`Camera`] is read from a preset; a [`Photographer`] draws bodies and photographs them with it.
//! The sensor follows BlenSor (Gschwandtner et al. 2011) and render_kinect (Bohg 2014), the
//! simulator that the paper's images most likely come from (section IV-A).

pub mod camera_file;
pub mod depth_file;
mod distortion;
mod dots;
mod filter;
mod noise;
mod photographer;
pub mod png;
mod rasteriser;
mod resample;

pub use distortion::{Distortion, Lens};
pub use noise::{Gaussian, Noise, Perlin};
pub use photographer::{Drawing, Photo, Photographer};
pub use resample::Resampling;

use crate::robot::Mesh;
use crate::strict_toml::{self, TomlError};
use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::path::{Path, PathBuf};

/// A dense image, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image<T> {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<T>,
}

/// z-depth in millimetres, 0 = invalid.
pub type DepthImage = Image<u16>;

impl DepthImage {
    /// The median of the valid depths, of two the larger; `None` when no pixel is valid.
    pub fn median_mm(&self) -> Option<u16> {
        let mut valid: Vec<u16> = self.pixels.iter().copied().filter(|&mm| mm > 0).collect();
        let middle = valid.len() / 2;
        (!valid.is_empty()).then(|| *valid.select_nth_unstable(middle).1)
    }
}

/// What is seen at a pixel: 0 = background, otherwise 1 + the index of a robot link.
pub type LabelImage = Image<u8>;

/// Pinhole model: the ray of pixel (column u, row v) is ((u - cx) / fx, (v - cy) / fy, 1), with
/// integer coordinates at pixel centres. Pixels; no distortion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Intrinsics {
    pub width: usize,
    pub height: usize,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
}

impl Intrinsics {
    /// The point that column `x`, row `y` shows at a depth in millimetres: optical frame, metres.
    pub fn point(&self, x: usize, y: usize, depth_mm: u16) -> Point3<f64> {
        let z = f64::from(depth_mm) / 1000.0;
        let along = |at: usize, centre: f64, focal: f64| (at as f64 - centre) / focal * z;
        Point3::new(along(x, self.cx, self.fx), along(y, self.cy, self.fy), z)
    }

    /// What makes the numbers unusable, as a sentence; anything read from outside is asked this before
    /// memory is taken for an image. (Comparisons are written so that a NaN fails them.)
    pub fn mistake(&self) -> Option<String> {
        let sides = [self.width, self.height];
        if !sides.iter().all(|side| (1..=MAX_SIDE).contains(side)) {
            return Some(format!(
                "an image of {} x {} pixels; each side must be 1 to {MAX_SIDE}",
                self.width, self.height
            ));
        }
        let Intrinsics { fx, fy, cx, cy, .. } = *self;
        let positive = |x: f64| x > 0.0 && x.is_finite();
        if !(positive(fx) && positive(fy) && cx.is_finite() && cy.is_finite()) {
            return Some("fx and fy must be positive, cx and cy finite".to_owned());
        }
        if [fx, fy].iter().all(|&f| f < 10.0) && [cx, cy].iter().all(|c| (0.0..=1.0).contains(c)) {
            return Some(format!(
                "fx = {fx}, fy = {fy}, cx = {cx}, cy = {cy} are normalised, but must be pixels: multiply fx \
                 and cx by the width, fy and cy by the height"
            ));
        }
        let axes = [
            ("fx", fx, "cx", cx, "width", self.width as f64),
            ("fy", fy, "cy", cy, "height", self.height as f64),
        ];
        for (f_name, f, c_name, c, side_name, side) in axes {
            if f < side / 20.0 || f > 50.0 * side {
                let degrees = 2.0 * (side / 2.0 / f).atan().to_degrees();
                return Some(format!(
                    "{f_name} = {f} would be a field of view of {degrees:.1} degrees for a {side_name} of \
                     {side}; it must be the focal length in pixels"
                ));
            }
            if c < -side || c > 2.0 * side {
                return Some(format!(
                    "{c_name} = {c} is far outside the image, whose {side_name} is {side}; it must be the \
                     principal point in pixels"
                ));
            }
        }
        (fx > 2.0 * fy || fy > 2.0 * fx).then(|| {
            format!(
                "fx = {fx} and fy = {fy} differ by more than a factor of 2: one of them is wrong"
            )
        })
    }
}

/// A file for reading and its length. Only regular files are opened: others may never end.
fn open(path: &Path) -> std::io::Result<(File, u64)> {
    let metadata = path.metadata()?;
    match metadata.is_file() {
        true => Ok((File::open(path)?, metadata.len())),
        false => Err(std::io::Error::other("it is no regular file")),
    }
}

/// Something to be drawn.
#[derive(Debug, Clone, Copy)]
pub struct Body<'a> {
    /// Closed, or only its front is seen.
    pub mesh: &'a Mesh,
    pub camera_from_mesh: Isometry3<f64>,
    pub label: u8,
}

/// A depth camera. Without a projector it measures depth exactly, but for rounding to millimetres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    pub intrinsics: Intrinsics,
    pub range: Range,
    pub projector: Option<Projector>,
}

/// The depths that the camera reports; all others are invalid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Range {
    pub near_m: f64,
    pub far_m: f64,
}

impl Range {
    /// Whether the camera reports this depth, mm.
    pub fn holds(&self, mm: u16) -> bool {
        (self.near_m..=self.far_m).contains(&(f64::from(mm) / 1000.0))
    }
}

/// The projector of a structured-light camera, beside it on its x axis (image right), so that
/// shadows fall on the left of near things.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Projector {
    /// Distance from the camera.
    pub baseline_m: f64,
    /// Disparities are multiples of this.
    pub disparity_step_px: f64,
    /// Added to the disparity of each dot before it is rounded again.
    pub noise: Option<Noise>,
}

/// A camera preset that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    #[error(transparent)]
    Toml(#[from] TomlError),
    #[error("{path}: {message}", path = path.display())]
    Invalid { path: PathBuf, message: String },
}

impl Camera {
    /// Reads a preset such as `data/cameras/realistic.toml`.
    pub fn read(path: &Path) -> Result<Camera, CameraError> {
        let camera: Camera = strict_toml::read(path)?;
        match camera.mistake() {
            None => Ok(camera),
            Some(message) => Err(CameraError::Invalid {
                path: path.to_owned(),
                message,
            }),
        }
    }

    /// What makes the numbers unusable, as a sentence. (Comparisons are written so that a NaN
    /// fails them.)
    fn mistake(&self) -> Option<String> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let Camera {
            intrinsics: i,
            range,
            projector,
        } = self;
        if let Some(mistake) = i.mistake() {
            return Some(format!("intrinsics: {mistake}"));
        }
        if !(range.near_m >= rasteriser::NEAR_PLANE && range.near_m < range.far_m) {
            return Some(format!(
                "range: near_m = {} must be at least {} and less than far_m = {}",
                range.near_m,
                rasteriser::NEAR_PLANE,
                range.far_m
            ));
        }
        if range.far_m > MAX_DEPTH_M {
            return Some(format!(
                "range: far_m = {} must be at most {MAX_DEPTH_M}, since depth is stored as 16-bit mm",
                range.far_m
            ));
        }
        let projector = projector.as_ref()?;
        if !(positive(projector.baseline_m) && positive(projector.disparity_step_px)) {
            return Some("projector: baseline_m and disparity_step_px must be positive".into());
        }
        let steps = i.fx * projector.baseline_m / range.near_m / projector.disparity_step_px;
        if steps >= MAX_DISPARITY_STEPS {
            return Some(format!(
                "projector: the disparity at near_m is {steps:.0} steps of disparity_step_px; \
                 it must be less than {MAX_DISPARITY_STEPS}"
            ));
        }
        let not_negative = |x: f64| x >= 0.0 && x.is_finite();
        let fine = match projector.noise {
            None => true,
            Some(Noise::Gaussian(gaussian)) => not_negative(gaussian.sd_px),
            Some(Noise::Perlin(perlin)) => {
                not_negative(perlin.sd_px)
                    && positive(perlin.cell_px)
                    && positive(perlin.persistence)
                    && (1..=16).contains(&perlin.octaves)
            }
        };
        (!fine).then(|| {
            "projector.noise: sd_px must not be negative, cell_px and persistence must be positive, \
             octaves 1 to 16"
                .into()
        })
    }
}

const MAX_SIDE: usize = 8192;
const MAX_DEPTH_M: f64 = 65.0;
const MAX_DISPARITY_STEPS: f64 = 60_000.0;
