//! Depth images of any camera, in the formats that people have.

mod exr;
mod netpbm;
mod numpy;
mod tiff;
mod units;

use super::png::{PngError, read_grey16};
use super::{DepthImage, MAX_SIDE, open};
use std::fs::File;
use std::path::{Path, PathBuf};
pub use units::{RangeError, Units, check_range};

/// A depth image that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DepthFileError {
    #[error(transparent)]
    Png(#[from] PngError),
    #[error("cannot read {path}: {cause}", path = path.display())]
    Read {
        path: PathBuf,
        cause: std::io::Error,
    },
    #[error("{path}: the name of a depth image ends with one of {endings}", path = path.display(), endings = endings())]
    Ending { path: PathBuf },
    #[error("{path} is not a usable {format} file: {message}", path = path.display())]
    Format {
        path: PathBuf,
        format: &'static str,
        message: String,
    },
    /// The values cannot be depths in the unit that they are read in.
    #[error("{path}: {message}", path = path.display())]
    Values { path: PathBuf, message: String },
}

/// The names of depth images end with one of these, in small or capital letters.
pub const EXTENSIONS: [&str; 8] = ["png", "npy", "npz", "tif", "tiff", "exr", "pgm", "pfm"];

/// [`EXTENSIONS`] as a text.
pub fn endings() -> String {
    EXTENSIONS.map(|end| format!(".{end}")).join(", ")
}

/// The one of [`EXTENSIONS`] that a file's name has.
pub fn extension(path: &Path) -> Option<&'static str> {
    let end = path.extension()?;
    let same = |known: &&'static str| end.eq_ignore_ascii_case(known);
    EXTENSIONS.into_iter().find(same)
}

/// Reads a depth image; the name's ending says the format:
///
/// - PNG: 16-bit grey
/// - NPY, and NPZ with one array or one called `depth`: NumPy's integers of 16 or 32 bits or floats
/// - TIFF: one channel of 16- or 32-bit integers or floats
/// - OpenEXR: the channel `Z`, `depth`, `Y` or `R`, or the only one
/// - PGM with values of 16 bits, PFM with one channel
///
/// `size` is the width and height that it must have, if that is known. Zero, what is below zero or no
/// finite number, 65535 where integers have 16 bits, and depths from 65.535 m on are invalid pixels. An
/// image whose values cannot be depths in their unit, or without a valid one, is an error.
pub fn read_depth_file(
    path: &Path,
    size: Option<[usize; 2]>,
    units: Units,
) -> Result<DepthImage, DepthFileError> {
    let wrong = |format: &'static str| {
        move |message: String| DepthFileError::Format {
            path: path.to_owned(),
            format,
            message,
        }
    };
    let failed = |cause| DepthFileError::Read {
        path: path.to_owned(),
        cause,
    };
    let size = Size(size);
    let Some(end) = extension(path) else {
        return Err(DepthFileError::Ending {
            path: path.to_owned(),
        });
    };
    let source = open(path).map_err(failed)?;
    let grid = match end {
        "png" => png(path, size)?,
        "npy" => numpy::read_npy(source, size).map_err(wrong("NPY"))?,
        "npz" => numpy::read_npz(source.0, size).map_err(wrong("NPZ"))?,
        "exr" => exr::read_exr(source.0, size).map_err(wrong("OpenEXR"))?,
        "pgm" => netpbm::read_pgm(source, size).map_err(wrong("PGM"))?,
        "pfm" => netpbm::read_pfm(source, size).map_err(wrong("PFM"))?,
        _ => tiff::read_tiff(source.0, size).map_err(wrong("TIFF"))?,
    };
    units::millimetres(grid, units).map_err(|message| DepthFileError::Values {
        path: path.to_owned(),
        message,
    })
}

fn png(path: &Path, size: Size) -> Result<Grid, DepthFileError> {
    let image = read_grey16(path, size.0)?;
    Ok(Grid {
        width: image.width,
        height: image.height,
        kind: Kind::Integer16,
        values: image.pixels.into_iter().map(f64::from).collect(),
    })
}

/// A file and its length in bytes.
type Source = (File, u64);

/// An image as a file holds it, row by row from the top left.
struct Grid {
    width: usize,
    height: usize,
    kind: Kind,
    values: Vec<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Its greatest value stands for invalid pixels.
    Integer16,
    Integer32,
    Float,
}

/// The width and height that an image must have, if that is known.
#[derive(Debug, Clone, Copy)]
struct Size(Option<[usize; 2]>);

impl Size {
    /// The width and height that a file tells of, if they will do: asked before memory is taken.
    fn check(self, width: u64, height: u64) -> Result<[usize; 2], String> {
        let most = MAX_SIDE as u64;
        match self.0 {
            Some(size) if size.map(|side| side as u64) == [width, height] => Ok(size),
            Some([w, h]) => Err(format!(
                "it is {width} x {height} pixels, but the camera's images are {w} x {h}"
            )),
            None if [width, height].iter().all(|side| (1..=most).contains(side)) => {
                Ok([width as usize, height as usize])
            }
            None => Err(format!(
                "it is {width} x {height} pixels; each side must be 1 to {most}"
            )),
        }
    }
}
