//! The extreme points of a set: the corners of its convex hull.

use std::collections::BTreeSet;

/// Points are rounded to a grid of so many steps along the longest side of their bounding box: few
/// enough that `i64` holds a face's normal and `i128` its scalar product with a difference.
const GRID: f64 = (1u64 << 29) as f64;

/// The indices, ascending, of points whose convex hull is that of all `points`. They are the hull's
/// corners, and in rare cases of ties points on its edges and faces. All indices are returned when
/// the points lie in a plane.
///
/// Quickhull on a grid of integers, where every test is exact: only a point that sticks out of the
/// others' hull by less than 4e-9 of the set's extent can be missing.
pub fn extreme_points(points: &[[f64; 3]]) -> Vec<usize> {
    let grid = on_grid(points);
    let Some(corners) = tetrahedron(&grid) else {
        return (0..points.len()).collect();
    };
    let [a, b, c, d] = corners;
    let mut faces: Vec<Face> = [[a, b, c], [a, c, d], [a, d, b], [d, c, b]]
        .map(|corners| Face::new(&grid, corners))
        .into();
    share_out(&grid, 0..grid.len(), &mut faces);
    // The farthest point above some face is a corner of the hull. It replaces all faces that it
    // sees by a fan over the edges round them.
    while let Some(face) = faces.iter().find(|face| !face.above.is_empty()) {
        let height = |&&point: &&usize| face.height(&grid[point]);
        let Some(&apex) = face.above.iter().max_by_key(height) else {
            break;
        };
        let mut seen = Vec::new();
        let mut at = 0;
        while at < faces.len() {
            match faces[at].height(&grid[apex]) > 0 {
                true => seen.push(faces.swap_remove(at)),
                false => at += 1,
            }
        }
        let edges = |face: &Face| {
            let [a, b, c] = face.corners;
            [(a, b), (b, c), (c, a)]
        };
        let inner: BTreeSet<_> = seen.iter().flat_map(edges).collect();
        let horizon = inner.iter().filter(|&&(a, b)| !inner.contains(&(b, a)));
        let mut fan: Vec<Face> = horizon
            .map(|&(a, b)| Face::new(&grid, [a, b, apex]))
            .collect();
        let orphans = seen.into_iter().flat_map(|face| face.above);
        share_out(&grid, orphans, &mut fan);
        faces.append(&mut fan);
    }
    let corners: BTreeSet<usize> = faces.iter().flat_map(|face| face.corners).collect();
    corners.into_iter().collect()
}

type GridPoint = [i64; 3];

fn on_grid(points: &[[f64; 3]]) -> Vec<GridPoint> {
    let coordinates = |axis: usize| points.iter().map(move |point| point[axis]);
    let low: [f64; 3] = [0, 1, 2].map(|axis| coordinates(axis).fold(f64::INFINITY, f64::min));
    let high: [f64; 3] = [0, 1, 2].map(|axis| coordinates(axis).fold(f64::NEG_INFINITY, f64::max));
    let extent = (0..3).fold(0.0, |most: f64, axis| most.max(high[axis] - low[axis]));
    let step = if extent > 0.0 { extent / GRID } else { 1.0 };
    let rounded = |point: &[f64; 3]| {
        std::array::from_fn(|axis| ((point[axis] - low[axis]) / step).round() as i64)
    };
    points.iter().map(rounded).collect()
}

/// A triangle of the hull, its corners counter-clockwise seen from outside.
struct Face {
    corners: [usize; 3],
    /// A corner and the outward normal, of any length.
    origin: GridPoint,
    normal: GridPoint,
    /// Points above this face that no other face has.
    above: Vec<usize>,
}

impl Face {
    fn new(grid: &[GridPoint], corners: [usize; 3]) -> Self {
        let [a, b, c] = corners.map(|corner| grid[corner]);
        Self {
            corners,
            origin: a,
            normal: cross(difference(b, a), difference(c, a)),
            above: Vec::new(),
        }
    }

    /// The height of a point above the face's plane, in a unit of the face's own.
    fn height(&self, point: &GridPoint) -> i128 {
        dot(self.normal, difference(*point, self.origin))
    }
}

/// Gives each point to the first face that it lies above; those above none are inside.
fn share_out(grid: &[GridPoint], points: impl Iterator<Item = usize>, faces: &mut [Face]) {
    for point in points {
        if let Some(face) = faces.iter_mut().find(|f| f.height(&grid[point]) > 0) {
            face.above.push(point);
        }
    }
}

/// Four of the points that span a space, the fourth below the plane of the others; `None` when all
/// lie in a plane.
fn tetrahedron(grid: &[GridPoint]) -> Option<[usize; 4]> {
    let all = || 0..grid.len();
    let square = |v: GridPoint| dot(v, v);
    let a = all().min_by_key(|&i| grid[i])?;
    let b = all().max_by_key(|&i| square(difference(grid[i], grid[a])))?;
    let ab = difference(grid[b], grid[a]);
    // A normal's components reach 2^60: its length squared fits i128.
    let c = all().max_by_key(|&i| square(cross(ab, difference(grid[i], grid[a]))))?;
    let base = Face::new(grid, [a, b, c]);
    let d = all().max_by_key(|&i| base.height(&grid[i]).abs())?;
    match base.height(&grid[d]) {
        0 => None,
        below if below < 0 => Some([a, b, c, d]),
        _ => Some([a, c, b, d]),
    }
}

fn difference(a: GridPoint, b: GridPoint) -> GridPoint {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: GridPoint, b: GridPoint) -> GridPoint {
    let component = |i: usize, j: usize| a[i] * b[j] - a[j] * b[i];
    [component(1, 2), component(2, 0), component(0, 1)]
}

fn dot(a: GridPoint, b: GridPoint) -> i128 {
    (0..3).map(|i| i128::from(a[i]) * i128::from(b[i])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{normal, stream, uniform};

    /// How far the points reach in a direction.
    fn reach(points: impl Iterator<Item = [f64; 3]>, direction: [f64; 3]) -> f64 {
        let along = |p: [f64; 3]| (0..3).map(|i| p[i] * direction[i]).sum();
        points.map(along).fold(f64::NEG_INFINITY, f64::max)
    }

    #[test]
    fn the_extreme_points_reach_as_far_as_all() {
        let mut s = stream(1, "hull", &[]);
        for count in [4, 5, 10, 300, 2000] {
            // A cloud much longer than wide, partly on a grid, so that many points share planes.
            let points: Vec<[f64; 3]> = (0..count)
                .map(|i| {
                    let point = [5.0, 0.5, 0.2].map(|size| size * normal(&mut s));
                    let rounded = point.map(|x| (x * 10.0).round() / 10.0);
                    if i % 2 == 0 { point } else { rounded }
                })
                .collect();
            let corners = extreme_points(&points);
            assert!(corners.is_sorted() && corners.len() >= 4);
            assert!(count < 300 || corners.len() < count / 2, "{count}");
            for _ in 0..500 {
                let direction = [0; 3].map(|_| normal(&mut s));
                let all = reach(points.iter().copied(), direction);
                let few = reach(corners.iter().map(|&i| points[i]), direction);
                assert!(few <= all && all - few < 1e-6, "{count}: {few} {all}");
            }
        }
    }

    #[test]
    fn all_points_of_a_sphere_are_extreme_and_none_within() {
        let mut s = stream(2, "hull", &[]);
        let mut points: Vec<[f64; 3]> = (0..200)
            .map(|_| {
                let point = [0; 3].map(|_| normal(&mut s));
                let length = point.iter().map(|x| x * x).sum::<f64>().sqrt();
                point.map(|x| x / length)
            })
            .collect();
        let within = (0..200).map(|_| [0; 3].map(|_| uniform(&mut s, -0.4, 0.4)));
        points.extend(within.collect::<Vec<_>>());
        assert_eq!(extreme_points(&points), (0..200).collect::<Vec<_>>());
    }

    #[test]
    fn of_a_lattice_the_corners_suffice() {
        let points: Vec<[f64; 3]> = (0..216)
            .map(|i| [i % 6, i / 6 % 6, i / 36].map(|x| 0.1 * f64::from(x)))
            .collect();
        let corners = extreme_points(&points);
        for x in [0, 5] {
            for y in [0, 30] {
                for z in [0, 180] {
                    assert!(corners.contains(&(x + y + z)));
                }
            }
        }
        assert!(corners.len() < 60, "{}", corners.len());
    }

    #[test]
    fn flat_sets_are_returned_whole() {
        for points in [
            vec![],
            vec![[1.0, 2.0, 3.0]],
            vec![[1.0, 2.0, 3.0]; 7],
            (0..9).map(|i| [f64::from(i); 3]).collect(),
            (0..9)
                .map(|i| [f64::from(i % 3), f64::from(i / 3), 4.0])
                .collect(),
        ] {
            assert_eq!(extreme_points(&points).len(), points.len());
        }
    }
}
