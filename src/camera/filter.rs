//! The sensor's correlation over a 9x9 window of projected dots: which dots give a disparity, and
//! how their disparities spread to the pixels around them.
//!
//! Disparities are integer codes, counted in steps of the sensor; 0 = none.

use super::dots::{DotPattern, FILL_RADIUS, HALF_WINDOW, fill_offsets, window_offsets};

/// A dot is accepted when more than this share of its window's dots agrees with the window's mean.
const SHARE: f32 = 1.0 / 1.5;

/// How far the disparity of the centre may be from the mean of its window, px. For a dot at
/// distance r from the centre it is 1.44 r^2 times as much.
const INLIER_DISPARITY: f32 = 0.1;

/// Rows that the fill may look at beyond the image.
const PADDING: usize = FILL_RADIUS as usize;

/// The window filter of BlenSor and render_kinect. Its scratch memory is kept from frame to frame.
pub struct WindowFilter {
    width: usize,
    height: usize,
    pattern: DotPattern,
    /// For each offset of the window, its distance in a disparity image, and how far from the mean
    /// a disparity may be there, in codes.
    window: Vec<(isize, f32)>,
    /// For each offset of the fill, its distance in a disparity image.
    fill_strides: Vec<isize>,
    /// For each column, the sum over the rows of the window; then the running sum of those.
    column_sums: Vec<u64>,
    running_sums: Vec<u64>,
    /// The output code of each accepted dot at its pixel, else 0; with [`PADDING`] rows of 0 above
    /// and below.
    accepted: Vec<u16>,
}

/// A disparity in a sum: how many there are in the upper half, what they add up to in the lower.
fn counted(code: u16) -> u64 {
    u64::from(code > 0) << 32 | u64::from(code)
}

impl WindowFilter {
    /// For disparity images of `width x height` pixels in steps of `step` px.
    pub fn new(width: usize, height: usize, step: f64) -> WindowFilter {
        let stride = |(x, y): (i32, i32)| y as isize * width as isize + x as isize;
        let tolerance = |(x, y): (i32, i32)| {
            let weakening = if (x, y) == (0, 0) {
                1.0
            } else {
                1.44 * (x * x + y * y) as f32
            };
            INLIER_DISPARITY / step as f32 * weakening
        };
        WindowFilter {
            width,
            height,
            pattern: DotPattern::new(),
            window: window_offsets()
                .into_iter()
                .map(|o| (stride(o), tolerance(o)))
                .collect(),
            fill_strides: fill_offsets().into_iter().map(stride).collect(),
            column_sums: vec![0; width],
            running_sums: vec![0; width + 1],
            accepted: vec![0; width * (height + 2 * PADDING)],
        }
    }

    /// Filters `codes` and calls `visit(pixel, code)` for every pixel that ends with a disparity.
    ///
    /// A dot whose 9x9 window lies inside the image is accepted when its own disparity is known and
    /// enough dots of the window have one near the mean of all the window's pixels. It carries its own disparity, changed by
    /// `disturb(column, row, code)`. Every pixel takes the disparity of the nearest accepted dot
    /// within 3 px; of equally near ones, the first in raster order.
    pub fn apply(
        &mut self,
        codes: &[u16],
        mut disturb: impl FnMut(usize, usize, u16) -> u16,
        mut visit: impl FnMut(usize, u16),
    ) {
        self.accepted.fill(0);
        let rows = HALF_WINDOW..self.height.saturating_sub(HALF_WINDOW);
        if rows.is_empty() || self.width <= 2 * HALF_WINDOW {
            return;
        }
        self.column_sums.fill(0);
        for row in 0..2 * HALF_WINDOW {
            self.add_row(codes, row);
        }
        for row in rows {
            self.add_row(codes, row + HALF_WINDOW);
            let mut sum = 0u64;
            for (running, &column) in self.running_sums[1..].iter_mut().zip(&self.column_sums) {
                sum = sum.wrapping_add(column);
                *running = sum;
            }
            let accepted = &mut self.accepted[(PADDING + row) * self.width..];
            self.pattern
                .for_each_dot(row, self.width, |column, window| {
                    let centre = row * self.width + column;
                    let total = self.running_sums[column + HALF_WINDOW + 1]
                        .wrapping_sub(self.running_sums[column - HALF_WINDOW]);
                    if codes[centre] > 0 && is_accepted(codes, &self.window, centre, window, total)
                    {
                        accepted[column] = disturb(column, row, codes[centre]);
                    }
                });
            self.remove_row(codes, row - HALF_WINDOW);
        }
        self.fill(&mut visit);
    }

    fn add_row(&mut self, codes: &[u16], row: usize) {
        let codes = &codes[row * self.width..(row + 1) * self.width];
        for (sum, &code) in self.column_sums.iter_mut().zip(codes) {
            *sum = sum.wrapping_add(counted(code));
        }
    }

    fn remove_row(&mut self, codes: &[u16], row: usize) {
        let codes = &codes[row * self.width..(row + 1) * self.width];
        for (sum, &code) in self.column_sums.iter_mut().zip(codes) {
            *sum = sum.wrapping_sub(counted(code));
        }
    }

    fn fill(&self, visit: &mut impl FnMut(usize, u16)) {
        for row in 0..self.height {
            let masks = self.pattern.fill_masks(row);
            for left in (0..self.width).step_by(masks.len()) {
                let columns = left..self.width.min(left + masks.len());
                for (column, &mask) in columns.zip(masks) {
                    let pixel = row * self.width + column;
                    let mut offsets = mask;
                    while offsets != 0 {
                        let stride = self.fill_strides[offsets.trailing_zeros() as usize];
                        // A stride past the end of a row leads to the margin of its neighbour,
                        // where no dot has a whole window.
                        let dot = (PADDING * self.width + pixel).wrapping_add_signed(stride);
                        if self.accepted[dot] > 0 {
                            visit(pixel, self.accepted[dot]);
                            break;
                        }
                        offsets &= offsets - 1;
                    }
                }
            }
        }
    }
}

/// Whether enough of a window's dots agree with the mean of its pixels. `window` are the indices of
/// its dots among the offsets, `total` the sum of its pixels as [`counted`].
fn is_accepted(
    codes: &[u16],
    offsets: &[(isize, f32)],
    centre: usize,
    window: &[u8],
    total: u64,
) -> bool {
    let mean = (total as u32) as f32 / (total >> 32) as f32;
    let mut inliers = 0u32;
    for &offset in window {
        let (stride, tolerance) = offsets[offset as usize];
        let code = codes[centre.wrapping_add_signed(stride)];
        let near = (f32::from(code) - mean).abs() < tolerance;
        inliers += u32::from(code > 0) & u32::from(near);
    }
    inliers as f32 > window.len() as f32 * SHARE
}
