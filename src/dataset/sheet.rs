//! Contact sheets: all images of a data set on one, to be looked at.

use super::{DataSet, DataSetError, Frame};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// How a contact sheet looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SheetStyle {
    /// Images side by side.
    pub columns: usize,
    /// Every n-th column and row of an image is shown.
    pub shrink: usize,
    /// Whether the arms are tinted: the target orange, others blue.
    pub tint: bool,
}

impl Default for SheetStyle {
    fn default() -> Self {
        SheetStyle {
            columns: 10,
            shrink: 4,
            tint: false,
        }
    }
}

/// Writes some images of a data set as one PNG, row by row: near is bright, far is dark, invalid
/// is black.
pub fn contact_sheet(
    set: &DataSet,
    images: &[usize],
    style: SheetStyle,
    path: &Path,
) -> Result<(), DataSetError> {
    let intrinsics = &set.camera().intrinsics;
    let shrink = style.shrink.max(1);
    let columns = style.columns.clamp(1, images.len().max(1));
    let tile = (
        intrinsics.width.div_ceil(shrink),
        intrinsics.height.div_ceil(shrink),
    );
    // A line of one pixel between images.
    let width = columns * (tile.0 + 1) - 1;
    let height = images.len().div_ceil(columns).max(1) * (tile.1 + 1) - 1;
    let mut sheet = vec![255u8; width * height * 3];
    let far_mm = set.record().camera.range.far_m * 1000.0;
    for (place, &image) in images.iter().enumerate() {
        let frame = set.frame(image)?;
        let (left, top) = (
            place % columns * (tile.0 + 1),
            place / columns * (tile.1 + 1),
        );
        for y in 0..tile.1 {
            for x in 0..tile.0 {
                let pixel = y * shrink * intrinsics.width + x * shrink;
                let at = ((top + y) * width + left + x) * 3;
                sheet[at..at + 3].copy_from_slice(&colour(set, &frame, pixel, far_mm, style.tint));
            }
        }
    }
    write_rgb(path, width, height, &sheet).map_err(|cause| DataSetError::Write {
        path: path.to_owned(),
        cause,
    })
}

fn colour(set: &DataSet, frame: &Frame, pixel: usize, far_mm: f64, tint: bool) -> [u8; 3] {
    let depth = frame.depth.pixels[pixel];
    if depth == 0 {
        return [0; 3];
    }
    let [r, g, b] = viridis(1.0 - f64::from(depth) / far_mm);
    let label = frame.labels.pixels[pixel];
    let arm = set
        .record()
        .labels
        .iter()
        .find(|entry| entry.label == label);
    match arm.filter(|_| tint) {
        None => [r, g, b],
        Some(entry) => {
            let light = (f64::from(r) + f64::from(g) + f64::from(b)) / (3.0 * 255.0);
            let target = entry.arm == set.record().specification.target;
            // Vermilion and sky blue of the Okabe-Ito palette, shaded by depth.
            let base = if target {
                [213.0, 94.0, 0.0]
            } else {
                [86.0, 180.0, 233.0]
            };
            base.map(|c: f64| (c * (0.4 + 0.9 * light)).min(255.0) as u8)
        }
    }
}

/// The colour map viridis, linear between nine of its colours; 0 is dark, 1 bright.
pub fn viridis(x: f64) -> [u8; 3] {
    const COLOURS: [[f64; 3]; 9] = [
        [68.0, 1.0, 84.0],
        [71.0, 44.0, 122.0],
        [59.0, 81.0, 139.0],
        [44.0, 113.0, 142.0],
        [33.0, 144.0, 141.0],
        [39.0, 173.0, 129.0],
        [92.0, 200.0, 99.0],
        [170.0, 220.0, 50.0],
        [253.0, 231.0, 37.0],
    ];
    let place = x.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let below = (place as usize).min(COLOURS.len() - 2);
    let part = place - below as f64;
    std::array::from_fn(|i| {
        ((1.0 - part) * COLOURS[below][i] + part * COLOURS[below + 1][i]).round() as u8
    })
}

/// Writes an 8-bit PNG: red, green and blue of each pixel, row by row.
pub(super) fn write_rgb(
    path: &Path,
    width: usize,
    height: usize,
    pixels: &[u8],
) -> std::io::Result<()> {
    let file = BufWriter::new(File::create(path)?);
    let mut encoder = png::Encoder::new(file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    Ok(writer.finish()?)
}
