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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{below, stream, unit};

    const WIDTH: usize = 230; // more than a tile of the pattern
    const HEIGHT: usize = 60;

    /// Slanted surfaces with a jump between them, holes, and wrong values.
    fn disparities() -> Vec<u16> {
        let mut s = stream(1, "filter test", &[]);
        let mut code = |row: usize, column: usize| {
            let surface = if column + row / 2 > 110 {
                300 + column / 9
            } else {
                180 + row / 3
            };
            match unit(&mut s) {
                x if x < 0.1 => 0,
                x if x < 0.15 => below(&mut s, 600) as u16,
                _ => surface as u16,
            }
        };
        let pixels = (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (row, column)));
        pixels.map(|(row, column)| code(row, column)).collect()
    }

    /// The definition, pixel by pixel.
    fn by_definition(codes: &[u16]) -> Vec<u16> {
        let pattern = DotPattern::new();
        let at = |row: usize, column: usize| codes[row * WIDTH + column];
        let is_dot = |row: usize, column: usize| {
            let masks = pattern.fill_masks(row);
            masks[column % masks.len()] & 1 == 1
        };
        let mut accepted = Vec::new();
        for row in 4..HEIGHT - 4 {
            for column in (4..WIDTH - 4).filter(|&c| is_dot(row, c) && at(row, c) > 0) {
                let window = || {
                    (row - 4..=row + 4).flat_map(|r| (column - 4..=column + 4).map(move |c| (r, c)))
                };
                let valid: Vec<f32> = window()
                    .map(|(r, c)| f32::from(at(r, c)))
                    .filter(|&d| d > 0.0)
                    .collect();
                let mean = valid.iter().sum::<f32>() / valid.len() as f32;
                let inlier = |&(r, c): &(usize, usize)| {
                    let square = (r.abs_diff(row).pow(2) + c.abs_diff(column).pow(2)) as f32;
                    let tolerance = 0.1 / 0.125 * if square == 0.0 { 1.0 } else { 1.44 * square };
                    at(r, c) > 0 && (f32::from(at(r, c)) - mean).abs() < tolerance
                };
                let dots: Vec<(usize, usize)> = window().filter(|&(r, c)| is_dot(r, c)).collect();
                if dots.iter().filter(|dot| inlier(dot)).count() * 3 > dots.len() * 2 {
                    accepted.push((row, column));
                }
            }
        }
        let nearest = |row: usize, column: usize| {
            let square =
                |&(r, c): &(usize, usize)| r.abs_diff(row).pow(2) + c.abs_diff(column).pow(2);
            let dots = accepted.iter().filter(|dot| square(dot) <= 9);
            dots.min_by_key(|dot| (square(dot), **dot))
                .map_or(0, |&(r, c)| at(r, c))
        };
        (0..HEIGHT * WIDTH)
            .map(|pixel| nearest(pixel / WIDTH, pixel % WIDTH))
            .collect()
    }

    #[test]
    fn the_filter_does_what_its_definition_says() {
        let codes = disparities();
        let mut filter = WindowFilter::new(WIDTH, HEIGHT, 0.125);
        // Twice, since memory is used again.
        for _ in 0..2 {
            let mut filtered = vec![0; WIDTH * HEIGHT];
            filter.apply(
                &codes,
                |_, _, code| code,
                |pixel, code| filtered[pixel] = code,
            );
            assert!(filtered == by_definition(&codes));
            let valid = filtered.iter().filter(|&&code| code > 0).count();
            assert!(valid > filtered.len() / 2 && valid < filtered.len() * 9 / 10);
        }
    }

    #[test]
    fn images_smaller_than_the_window_stay_empty() {
        for (width, height) in [(8, 20), (20, 8), (1, 1)] {
            let mut filter = WindowFilter::new(width, height, 0.125);
            let codes = vec![100; width * height];
            filter.apply(&codes, |_, _, code| code, |_, _| panic!("no window fits"));
        }
    }
}
