//! Depth images as TIFF.

use super::{Grid, Kind, Size};
use std::fs::File;
use std::io::BufReader;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::{ColorType, tags::Tag};

/// Reads the only image of a file, which has one channel.
pub(super) fn read_tiff(file: File, size: Size) -> Result<Grid, String> {
    let failed = |e: tiff::TiffError| e.to_string();
    let mut decoder = Decoder::new(BufReader::new(file)).map_err(failed)?;
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let [width, height] = size.check(width.into(), height.into())?;
    match decoder.colortype().map_err(failed)? {
        ColorType::Gray(16 | 32 | 64) => {}
        other => {
            return Err(format!(
                "it holds {other:?} values, but depth must be one channel of 16 or 32 bits"
            ));
        }
    }
    let turned = decoder.find_tag_unsigned::<u16>(Tag::Orientation);
    if turned.map_err(failed)?.is_some_and(|how| how != 1) {
        return Err("its orientation is not that of rows from the top left".to_owned());
    }
    if decoder.more_images() {
        return Err("it holds several images, but each needs a file of its own".to_owned());
    }
    let (kind, values): (Kind, Vec<f64>) = match decoder.read_image().map_err(failed)? {
        DecodingResult::U16(v) => (Kind::Integer16, v.into_iter().map(f64::from).collect()),
        DecodingResult::I16(v) => (Kind::Integer16, v.into_iter().map(f64::from).collect()),
        DecodingResult::U32(v) => (Kind::Integer32, v.into_iter().map(f64::from).collect()),
        DecodingResult::I32(v) => (Kind::Integer32, v.into_iter().map(f64::from).collect()),
        DecodingResult::F16(v) => (Kind::Float, v.into_iter().map(f64::from).collect()),
        DecodingResult::F32(v) => (Kind::Float, v.into_iter().map(f64::from).collect()),
        DecodingResult::F64(v) => (Kind::Float, v),
        _ => {
            return Err(
                "its values must be integers of 16 or 32 bits or floats to be depth".to_owned(),
            );
        }
    };
    match values.len() == width * height {
        true => Ok(Grid {
            width,
            height,
            kind,
            values,
        }),
        false => Err("it is cut off".to_owned()),
    }
}
