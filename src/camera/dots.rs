//! The pattern of dots that the projector throws. Its statistics are those of the Kinect's: one
//! pixel in nine carries a dot, no two dots touch, and it repeats after about 211 x 165 pixels.

use crate::random::{Stream, below, stream};

/// The period of the pattern in pixels, a whole number of cells.
const TILE_WIDTH: usize = 210;
const TILE_HEIGHT: usize = 165;
/// One dot stands somewhere in each cell of this many pixels squared. So no pixel is farther than
/// the diagonal of a cell less a pixel, 2.83 px, from a dot, and the filter's fill leaves no hole.
const CELL: usize = 3;

/// The window of the filter reaches this many pixels from its centre: 9x9.
pub const HALF_WINDOW: usize = 4;
/// A dot's disparity spreads to pixels nearer than this.
pub const FILL_RADIUS: f64 = 3.1;

/// The pattern, and for each of its pixels the dots nearby, on one tile.
pub struct DotPattern {
    /// For each row of the tile, its dots in ascending order.
    rows: Vec<Vec<Dot>>,
    /// For each pixel of the tile, bit k is set when [`fill_offsets`]`()[k]` leads to a dot.
    fill_masks: Vec<u32>,
}

/// A dot of the pattern, in its row.
pub struct Dot {
    pub column: usize,
    /// The dots of its window, itself included, as indices into [`window_offsets`].
    pub window: Vec<u8>,
}

/// The (column, row) offsets of the window in raster order.
pub fn window_offsets() -> Vec<(i32, i32)> {
    square(HALF_WINDOW as i32)
}

/// The (column, row) offsets of the fill, nearest first; of equally near ones, in raster order.
pub fn fill_offsets() -> Vec<(i32, i32)> {
    let mut offsets = square(FILL_RADIUS as i32);
    offsets.retain(|&(x, y)| f64::from(x * x + y * y) < FILL_RADIUS * FILL_RADIUS);
    offsets.sort_by_key(|&(x, y)| x * x + y * y);
    offsets
}

fn square(half: i32) -> Vec<(i32, i32)> {
    (-half..=half)
        .flat_map(|y| (-half..=half).map(move |x| (x, y)))
        .collect()
}

impl DotPattern {
    /// Always the same pattern.
    pub fn new() -> DotPattern {
        let is_dot = draw_dots(&mut stream(0, "dot pattern", &[]));
        let leads_to_dot = |column: usize, row: usize, (x, y): (i32, i32)| {
            is_dot[wrap(row, y, TILE_HEIGHT) * TILE_WIDTH + wrap(column, x, TILE_WIDTH)]
        };
        let window_offsets = window_offsets();
        let fill_offsets = fill_offsets();
        let dot = |column, row| Dot {
            column,
            window: (0..window_offsets.len() as u8)
                .filter(|&k| leads_to_dot(column, row, window_offsets[k as usize]))
                .collect(),
        };
        let mask = |column, row| {
            let bit = |k: usize| u32::from(leads_to_dot(column, row, fill_offsets[k])) << k;
            (0..fill_offsets.len()).map(bit).sum()
        };
        let rows = 0..TILE_HEIGHT;
        DotPattern {
            rows: rows
                .clone()
                .map(|row| {
                    (0..TILE_WIDTH)
                        .filter(|column| is_dot[row * TILE_WIDTH + column])
                        .map(|column| dot(column, row))
                        .collect()
                })
                .collect(),
            fill_masks: rows
                .flat_map(|row| (0..TILE_WIDTH).map(move |column| (column, row)))
                .map(|(column, row)| mask(column, row))
                .collect(),
        }
    }

    /// Calls `visit(column, dots of its window)` for the dots of an image's row whose windows lie
    /// within `width` columns, from left to right.
    pub fn for_each_dot(&self, row: usize, width: usize, mut visit: impl FnMut(usize, &[u8])) {
        for left in (0..width).step_by(TILE_WIDTH) {
            for dot in &self.rows[row % TILE_HEIGHT] {
                let column = left + dot.column;
                if (HALF_WINDOW..width - HALF_WINDOW).contains(&column) {
                    visit(column, &dot.window);
                }
            }
        }
    }

    /// For the pixels of an image's row and its columns modulo the length of the slice, which of
    /// [`fill_offsets`] lead to dots, as bits.
    pub fn fill_masks(&self, row: usize) -> &[u32] {
        let start = row % TILE_HEIGHT * TILE_WIDTH;
        &self.fill_masks[start..start + TILE_WIDTH]
    }
}

/// The tile, row by row: one dot in each cell at a uniform place where it touches no dot so far.
/// There always is one, since the centre of a cell touches no other cell.
fn draw_dots(stream: &mut Stream) -> Vec<bool> {
    let mut is_dot = vec![false; TILE_WIDTH * TILE_HEIGHT];
    for top in (0..TILE_HEIGHT).step_by(CELL) {
        for left in (0..TILE_WIDTH).step_by(CELL) {
            let place = loop {
                let (column, row) = (left + below(stream, CELL), top + below(stream, CELL));
                let touches = square(1).into_iter().any(|(x, y)| {
                    is_dot[wrap(row, y, TILE_HEIGHT) * TILE_WIDTH + wrap(column, x, TILE_WIDTH)]
                });
                if !touches {
                    break row * TILE_WIDTH + column;
                }
            };
            is_dot[place] = true;
        }
    }
    is_dot
}

fn wrap(position: usize, offset: i32, period: usize) -> usize {
    (position as i32 + offset).rem_euclid(period as i32) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_pixel_in_nine_is_a_dot_and_no_two_touch() {
        let pattern = DotPattern::new();
        let mut dots = 0;
        for row in 0..TILE_HEIGHT {
            pattern.for_each_dot(row, 4 * TILE_WIDTH, |_, window| {
                dots += 1;
                let offsets = window_offsets();
                let touching = window.iter().filter(|&&k| {
                    offsets[k as usize].0.abs() <= 1 && offsets[k as usize].1.abs() <= 1
                });
                assert_eq!(touching.count(), 1, "the dot itself");
                assert!((4..=14).contains(&window.len()), "as on the Kinect");
            });
        }
        // Four tiles side by side, less the margins of half a window.
        let whole = 4 * TILE_WIDTH * TILE_HEIGHT / 9;
        assert!(dots < whole && dots > whole - TILE_HEIGHT * 2);
    }

    #[test]
    fn every_pixel_is_near_a_dot_and_the_nearest_comes_first() {
        let pattern = DotPattern::new();
        let offsets = fill_offsets();
        assert_eq!(offsets.len(), 29);
        assert!(offsets.is_sorted_by_key(|&(x, y)| (x * x + y * y, y, x)));
        for row in 0..TILE_HEIGHT {
            for mask in pattern.fill_masks(row) {
                let (x, y) = offsets[mask.trailing_zeros() as usize];
                assert!(x * x + y * y <= 8);
            }
        }
    }
}
