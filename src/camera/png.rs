//! Depth and label images as PNG files that other tools read too: 16-bit grey depth in mm with
//! 0 = invalid, and 8-bit grey labels.

use super::{DepthImage, Image, Intrinsics, LabelImage, MAX_SIDE, open};
use ::png::{
    BitDepth, ColorType, Compression, Decoder, DecodingError, Encoder, EncodingError, Filter,
};
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

/// An image file that cannot be read, written or used.
#[derive(Debug, thiserror::Error)]
pub enum PngError {
    #[error("cannot open {path}: {cause}", path = path.display())]
    Open {
        path: PathBuf,
        cause: std::io::Error,
    },
    #[error("cannot read {path} as a PNG image: {cause}", path = path.display())]
    Decode { path: PathBuf, cause: DecodingError },
    #[error("cannot write {path}: {cause}", path = path.display())]
    Write { path: PathBuf, cause: EncodingError },
    #[error(
        "{path} holds {found}, but {wanted} is needed; was it converted on the way?",
        path = path.display()
    )]
    Format {
        path: PathBuf,
        found: String,
        wanted: &'static str,
    },
    #[error(
        "{path} is {found_width} x {found_height} pixels, but the camera's images are {width} x {height}",
        path = path.display()
    )]
    Size {
        path: PathBuf,
        found_width: usize,
        found_height: usize,
        width: usize,
        height: usize,
    },
    #[error(
        "{path}: the median depth is {median_mm} mm, which no depth camera would see; \
         the values look like {guess}, but must be millimetres",
        path = path.display()
    )]
    Unit {
        path: PathBuf,
        median_mm: u16,
        guess: &'static str,
    },
}

/// Medians of valid depth outside this range are taken for a mistake of unit, mm.
const PLAUSIBLE_MEDIAN: std::ops::RangeInclusive<u16> = 200..=10_000;

/// Writes 16-bit PNG, mm, 0 = invalid.
pub fn write_depth(path: &Path, image: &DepthImage) -> Result<(), PngError> {
    let bytes: Vec<u8> = image
        .pixels
        .iter()
        .flat_map(|mm| mm.to_be_bytes())
        .collect();
    write(path, image.width, image.height, BitDepth::Sixteen, &bytes)
}

/// Writes 8-bit PNG.
pub fn write_labels(path: &Path, image: &LabelImage) -> Result<(), PngError> {
    write(
        path,
        image.width,
        image.height,
        BitDepth::Eight,
        &image.pixels,
    )
}

/// Reads a 16-bit grey depth image in millimetres. Images of another size than the camera's, and
/// such whose median valid depth says that the unit is not mm, are errors. An image without any
/// valid pixel is none.
pub fn read_depth(path: &Path, camera: &Intrinsics) -> Result<DepthImage, PngError> {
    let depth = read_grey16(path, Some([camera.width, camera.height]))?;
    check_unit(path, &depth.pixels)?;
    Ok(depth)
}

/// Reads a 16-bit grey image, of the width and height `size` if that is given, whatever its unit.
pub(super) fn read_grey16(path: &Path, size: Option<[usize; 2]>) -> Result<DepthImage, PngError> {
    let ([width, height], bytes) = read(path, size, BitDepth::Sixteen, "16-bit grey depth")?;
    let (values, _) = bytes.as_chunks();
    Ok(Image {
        width,
        height,
        pixels: values.iter().map(|&b| u16::from_be_bytes(b)).collect(),
    })
}

/// Fails when the median valid depth says that the unit is not mm.
fn check_unit(path: &Path, pixels: &[u16]) -> Result<(), PngError> {
    if let Some(median_mm) = median_valid(pixels)
        && !PLAUSIBLE_MEDIAN.contains(&median_mm)
    {
        let guess = match median_mm {
            0..20 => "metres",
            20..200 => "centimetres",
            _ => "tenths of a millimetre or raw disparities",
        };
        return Err(PngError::Unit {
            path: path.to_owned(),
            median_mm,
            guess,
        });
    }
    Ok(())
}

/// Reads an 8-bit grey label image of the camera's size.
pub fn read_labels(path: &Path, camera: &Intrinsics) -> Result<LabelImage, PngError> {
    let size = Some([camera.width, camera.height]);
    let ([width, height], pixels) = read(path, size, BitDepth::Eight, "8-bit grey labels")?;
    Ok(Image {
        width,
        height,
        pixels,
    })
}

fn median_valid(pixels: &[u16]) -> Option<u16> {
    let mut valid: Vec<u16> = pixels.iter().copied().filter(|&mm| mm > 0).collect();
    let middle = valid.len() / 2;
    (!valid.is_empty()).then(|| *valid.select_nth_unstable(middle).1)
}

fn write(
    path: &Path,
    width: usize,
    height: usize,
    depth: BitDepth,
    bytes: &[u8],
) -> Result<(), PngError> {
    let failed = |cause| PngError::Write {
        path: path.to_owned(),
        cause,
    };
    let file = File::create(path).map_err(|e| failed(e.into()))?;
    let mut file = BufWriter::new(file);
    let mut encoder = Encoder::new(&mut file, width as u32, height as u32);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(depth);
    encoder.set_compression(Compression::Fast);
    encoder.set_filter(Filter::Up);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(bytes).map_err(failed)?;
    writer.finish().map_err(failed)?;
    file.flush().map_err(|e| failed(e.into()))
}

fn read(
    path: &Path,
    size: Option<[usize; 2]>,
    depth: BitDepth,
    wanted: &'static str,
) -> Result<([usize; 2], Vec<u8>), PngError> {
    let failed = |cause| PngError::Decode {
        path: path.to_owned(),
        cause,
    };
    let (file, _) = open(path).map_err(|cause| PngError::Open {
        path: path.to_owned(),
        cause,
    })?;
    let mut reader = Decoder::new(BufReader::new(file))
        .read_info()
        .map_err(failed)?;
    let info = reader.info();
    let found = [info.width as usize, info.height as usize];
    if (info.color_type, info.bit_depth) != (ColorType::Grayscale, depth) {
        return Err(PngError::Format {
            path: path.to_owned(),
            found: format!("{}-bit {:?} values", info.bit_depth as u8, info.color_type),
            wanted,
        });
    }
    if size.is_some_and(|size| size != found) || found.iter().any(|&side| side > MAX_SIDE) {
        let [found_width, found_height] = found;
        let [width, height] = size.unwrap_or([MAX_SIDE; 2]);
        return Err(PngError::Size {
            path: path.to_owned(),
            found_width,
            found_height,
            width,
            height,
        });
    }
    let mut bytes = vec![0; found[0] * found[1] * (depth as usize / 8)];
    reader.next_frame(&mut bytes).map_err(failed)?;
    Ok((found, bytes))
}
