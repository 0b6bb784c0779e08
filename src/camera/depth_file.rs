//! Depth images of any camera: PNG in millimetres or any other unit, and NumPy's arrays.

use super::npy::read_npy;
use super::png::{PngError, check_unit, read_depth, read_grey16};
use super::{DepthImage, Intrinsics};
use std::path::{Path, PathBuf};

/// A depth image that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum DepthFileError {
    #[error(transparent)]
    Png(#[from] PngError),
    #[error("cannot read {path}: {source}", path = path.display())]
    Read {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{path} is not a usable NPY file: {message}", path = path.display())]
    Npy { path: PathBuf, message: String },
}

/// One unit of an integer is a millimetre, unless somebody says otherwise.
pub const MILLIMETRE: f64 = 0.001;

/// The names of depth images end with one of these.
pub const EXTENSIONS: [&str; 2] = ["png", "npy"];

/// Reads a depth image of the camera's size: 16-bit grey PNG, or NPY where the name ends with `.npy`
/// (`uint16`, or floats in metres). `unit_m` is what one unit of an integer stands for. Depths that are
/// no number, not above zero or beyond 65.535 m are invalid. An image whose median says that the unit is
/// another is an error.
pub fn read_depth_file(
    path: &Path,
    camera: &Intrinsics,
    unit_m: f64,
) -> Result<DepthImage, DepthFileError> {
    let is_npy = path.extension().is_some_and(|end| end == "npy");
    let depth = match is_npy {
        true => read_npy(path, camera, unit_m)?,
        false if unit_m == MILLIMETRE => return Ok(read_depth(path, camera)?),
        false => {
            let mut image = read_grey16(path, camera)?;
            for pixel in &mut image.pixels {
                *pixel = millimetres(f64::from(*pixel) * unit_m);
            }
            image
        }
    };
    check_unit(path, &depth.pixels)?;
    Ok(depth)
}

/// Metres as an image holds them.
pub(super) fn millimetres(metres: f64) -> u16 {
    let mm = (1000.0 * metres).round();
    match (1.0..=f64::from(u16::MAX)).contains(&mm) {
        true => mm as u16,
        false => 0,
    }
}
