//! Depth images that NumPy saved: `np.save("depth.npy", depth)` with a `uint16`, `float32` or `float64`
//! array of shape (rows, columns).

use super::depth_file::{DepthFileError, millimetres};
use super::{DepthImage, Image, Intrinsics};
use std::fs::File;
use std::io::Read;
use std::path::Path;

const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// NumPy's own headers are shorter than this.
const LONGEST_HEADER: u32 = 1 << 16;

/// Reads an array of the camera's size, little-endian and in C order. Integers count `unit_m` metres
/// each, floats are metres; NaN, infinities and what is not above zero are invalid.
pub(super) fn read_npy(
    path: &Path,
    camera: &Intrinsics,
    unit_m: f64,
) -> Result<DepthImage, DepthFileError> {
    let failed = |source| DepthFileError::Read {
        path: path.to_owned(),
        source,
    };
    let invalid = |message: String| DepthFileError::Npy {
        path: path.to_owned(),
        message,
    };
    let mut file = File::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    let cut_off = || invalid("it is cut off".to_owned());
    let mut take = |bytes: &mut [u8]| file.read_exact(bytes).map_err(|_| cut_off());

    let mut start = [0; 8];
    take(&mut start)?;
    if !start.starts_with(MAGIC) {
        return Err(invalid("it does not begin as an NPY file does".to_owned()));
    }
    let (header_length, prefix) = match start[6] {
        1 => {
            let mut two = [0; 2];
            take(&mut two)?;
            (u32::from(u16::from_le_bytes(two)), 10)
        }
        2 | 3 => {
            let mut four = [0; 4];
            take(&mut four)?;
            (u32::from_le_bytes(four), 12)
        }
        version => {
            return Err(invalid(format!(
                "its format is version {version}, but only 1 to 3 are known"
            )));
        }
    };
    if header_length > LONGEST_HEADER {
        return Err(invalid(format!("its header has {header_length} bytes")));
    }
    let mut header = vec![0; header_length as usize];
    take(&mut header)?;
    let header = String::from_utf8_lossy(&header);
    let entry = |key: &str| {
        let at = header.find(&format!("'{key}':"))? + key.len() + 3;
        Some(header[at..].trim_start())
    };
    let (Some(descr), Some(order), Some(shape)) =
        (entry("descr"), entry("fortran_order"), entry("shape"))
    else {
        return Err(invalid(
            "its header does not tell type, order and shape".to_owned(),
        ));
    };
    let descr = descr.split('\'').nth(1).unwrap_or_default();
    let size = match descr {
        "<u2" => 2,
        "<f4" => 4,
        "<f8" => 8,
        other => {
            return Err(invalid(format!(
                "its values have the type '{other}', but depth must be '<u2' (uint16), '<f4' (float32) \
                 or '<f8' (float64)"
            )));
        }
    };
    if !order.starts_with("False") {
        return Err(invalid(
            "its values stand in Fortran order; save np.ascontiguousarray(depth)".to_owned(),
        ));
    }
    // Compared as text before anything is allocated: the numbers may be of any size.
    let expected = format!("({}, {})", camera.height, camera.width);
    let shape = shape.split_inclusive(')').next().unwrap_or_default();
    if shape != expected {
        return Err(invalid(format!(
            "its shape is {shape}, but the camera's images have (rows, columns) = {expected}"
        )));
    }
    let bytes = camera.width * camera.height * size;
    let there = length.saturating_sub(prefix + u64::from(header_length));
    if there != bytes as u64 {
        return Err(invalid(format!(
            "{there} bytes of values stand in it, but its shape asks for {bytes}"
        )));
    }
    let mut values = vec![0; bytes];
    take(&mut values)?;
    let pixels = match size {
        2 => numbers(&values, u16::from_le_bytes)
            .map(|v| millimetres(f64::from(v) * unit_m))
            .collect(),
        4 => numbers(&values, f32::from_le_bytes)
            .map(|v| millimetres(f64::from(v)))
            .collect(),
        _ => numbers(&values, f64::from_le_bytes)
            .map(millimetres)
            .collect(),
    };
    Ok(Image {
        width: camera.width,
        height: camera.height,
        pixels,
    })
}

/// The numbers that `bytes` hold, N bytes each.
fn numbers<T, const N: usize>(
    bytes: &[u8],
    read: impl Fn([u8; N]) -> T,
) -> impl Iterator<Item = T> {
    let (chunks, _) = bytes.as_chunks();
    chunks.iter().map(move |&chunk| read(chunk))
}
