//! Polygons become triangles.

use super::MAX_TRIANGLES;
use crate::robot::Mesh;
use nalgebra::Vector3;

/// The most comparisons of corners that all concave polygons of a file may take: seconds.
const MAX_WORK: usize = 1_000_000_000;

/// Triangles over the points of a file.
#[derive(Default)]
pub struct Surface {
    pub points: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    work: usize,
}

impl Surface {
    pub fn over(points: Vec<[f32; 3]>) -> Surface {
        Surface {
            points,
            ..Surface::default()
        }
    }

    /// Adds a polygon, given by the indices of its corners. Fewer than three corners are no surface.
    pub fn polygon(&mut self, corners: &[u32]) -> Result<(), String> {
        if corners.iter().any(|&i| i as usize >= self.points.len()) {
            return Err("a triangle names a vertex that does not exist".to_owned());
        }
        if self.triangles.len() + corners.len() > MAX_TRIANGLES {
            return Err(format!(
                "it has more than {MAX_TRIANGLES} triangles; simplify it"
            ));
        }
        match corners {
            [a, b, c] => self.triangles.push([*a, *b, *c]),
            _ => self.cut_up(corners)?,
        }
        Ok(())
    }

    /// The vertices that are used, and the triangles.
    pub fn into_mesh(self) -> Mesh {
        let mesh = Mesh {
            vertices: self.points,
            triangles: self.triangles,
        };
        mesh.welded()
    }

    fn point(&self, i: u32) -> Vector3<f64> {
        Vector3::from(self.points[i as usize].map(f64::from))
    }

    /// Cuts off one corner after the other: the next one whose triangle is inside the polygon. Of a
    /// convex polygon these are the triangles that share its first corner.
    fn cut_up(&mut self, corners: &[u32]) -> Result<(), String> {
        let Some((&first, _)) = corners.split_first() else {
            return Ok(());
        };
        // Twice the area as a vector (Newell): it sums over the whole outline, so that straight or
        // hollow corners do not matter.
        let from_first = |i: u32| self.point(i) - self.point(first);
        let area: Vector3<f64> = corners
            .windows(2)
            .map(|pair| from_first(pair[0]).cross(&from_first(pair[1])))
            .sum();
        let turn = |a: u32, b: u32, c: u32| {
            let (a, b, c) = (self.point(a), self.point(b), self.point(c));
            (b - a).cross(&(c - a)).dot(&area)
        };
        let slack = 1e-9 * area.norm_squared();
        let count = corners.len();
        let hollow: Vec<u32> = (0..count)
            .filter(|&i| {
                let next = |by: usize| corners[(i + by) % count];
                turn(next(count - 1), next(0), next(1)) < -slack
            })
            .map(|i| corners[i])
            .collect();
        let mut triangles = Vec::with_capacity(count);
        let mut work = self.work;
        if hollow.is_empty() {
            let fan = corners[1..]
                .windows(2)
                .map(|pair| [first, pair[0], pair[1]]);
            triangles.extend(fan);
        } else {
            let mut left = corners.to_vec();
            let mut at = 0;
            let mut failed = 0;
            while left.len() > 2 {
                let count = left.len();
                let [a, b, c] = [0, 1, 2].map(|by| left[(at + by) % count]);
                work += hollow.len();
                if work > MAX_WORK {
                    return Err("its polygons have too many corners; triangulate it".to_owned());
                }
                let inside = |&p: &u32| {
                    ![a, b, c].contains(&p)
                        && [[a, b], [b, c], [c, a]]
                            .iter()
                            .all(|&[i, k]| turn(i, k, p) >= 0.0)
                };
                // Of a polygon that crosses itself no corner may be left to cut: then any is taken.
                if failed >= count || turn(a, b, c) >= 0.0 && !hollow.iter().any(inside) {
                    triangles.push([a, b, c]);
                    left.remove((at + 1) % count);
                    failed = 0;
                    at = if at + 1 >= count { 0 } else { at };
                } else {
                    at = (at + 1) % count;
                    failed += 1;
                }
            }
        }
        self.work = work;
        self.triangles.extend(triangles);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[[f32; 3]]) -> (usize, f64) {
        let mut surface = Surface::over(corners.to_vec());
        let all: Vec<u32> = (0..corners.len() as u32).collect();
        surface.polygon(&all).unwrap();
        let twice = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| surface.point(i));
            (b - a).cross(&(c - a)).norm()
        };
        let sum: f64 = surface.triangles.iter().map(twice).sum();
        (surface.triangles.len(), sum / 2.0)
    }

    #[test]
    fn a_polygon_is_covered_once() {
        let square = [
            [0.0, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [2.0, 2.0, 0.0],
            [0.0, 2.0, 0.0],
        ];
        assert_eq!(area(&square), (2, 4.0));
        // An L, a comb and an arrow, from each of their corners, both ways round: of the triangles
        // that share a corner some would lie outside.
        let shapes: [(&[[f32; 2]], f64); 3] = [
            (
                &[[0., 0.], [3., 0.], [3., 1.], [1., 1.], [1., 3.], [0., 3.]],
                5.0,
            ),
            (
                &[
                    [0., 0.],
                    [5., 0.],
                    [5., 3.],
                    [4., 3.],
                    [4., 1.],
                    [3., 1.],
                    [3., 3.],
                    [2., 3.],
                    [2., 1.],
                    [1., 1.],
                    [1., 3.],
                    [0., 3.],
                ],
                11.0,
            ),
            (&[[0., 0.], [2., -2.], [0., 4.], [-2., -2.]], 8.0),
        ];
        for (outline, expected) in shapes {
            for start in 0..outline.len() {
                for mirror in [1.0, -1.0] {
                    let mut corners: Vec<[f32; 3]> =
                        outline.iter().map(|p| [mirror * p[0], 0.5, p[1]]).collect();
                    corners.rotate_left(start);
                    let (triangles, sum) = area(&corners);
                    assert_eq!(triangles, outline.len() - 2);
                    assert!((sum - expected).abs() < 1e-6, "{sum} is not {expected}");
                }
            }
        }
    }

    #[test]
    fn a_polygon_without_area_or_that_crosses_itself_ends() {
        let bow = [
            [0., 0., 0.],
            [1., 1., 0.],
            [1., 0., 0.],
            [0., 1., 0.],
            [0.5, 3., 0.],
        ];
        assert_eq!(area(&bow).0, 3);
        assert_eq!(area(&[[1.0; 3]; 6]).1, 0.0);
        assert_eq!(area(&[[0.0; 3], [1.0, 0.0, 0.0]]).0, 0);
    }
}
