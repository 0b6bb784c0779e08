//! Oriented boxes: what collision is tested with.

use crate::robot::Mesh;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Vector3};

/// A solid box, anywhere and turned in any way; metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedBox {
    pub centre: Point3<f64>,
    /// The columns are the box's own x, y and z directions, orthonormal.
    pub axes: Matrix3<f64>,
    /// Half the extent along each of the axes.
    pub half: Vector3<f64>,
}

impl OrientedBox {
    /// The box with its sides along the axes of the frame.
    pub fn from_bounds(low: [f64; 3], high: [f64; 3]) -> Self {
        let (low, high) = (Point3::from(low), Point3::from(high));
        OrientedBox {
            centre: nalgebra::center(&low, &high),
            axes: Matrix3::identity(),
            half: (high - low) / 2.0,
        }
    }

    /// A small box round all vertices of a mesh that has at least one: the smallest of the boxes
    /// whose axes are the frame's, turned about one of them in steps of five degrees. Parts of
    /// robots are mostly made along, or slanted in a plane of, the frame they are drawn in, where
    /// principal axes would be undefined for everything round or square.
    pub fn around(mesh: &Mesh) -> Self {
        let steps = (0..18).map(|step| f64::from(step) * 5f64.to_radians());
        let turns = steps.flat_map(|angle| {
            [Vector3::z_axis(), Vector3::y_axis(), Vector3::x_axis()]
                .map(|axis| Rotation3::from_axis_angle(&axis, angle))
        });
        let boxes = turns.map(|turn| Self::aligned_with(turn.matrix(), mesh));
        let volume = |b: &OrientedBox| b.half.product();
        // Only a clearly smaller box replaces an earlier one, so that rounding decides nothing.
        boxes
            .reduce(|best, b| {
                if volume(&b) < 0.999 * volume(&best) {
                    b
                } else {
                    best
                }
            })
            .unwrap_or_else(|| Self::aligned_with(&Matrix3::identity(), mesh))
    }

    fn aligned_with(axes: &Matrix3<f64>, mesh: &Mesh) -> Self {
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for vertex in &mesh.vertices {
            let along = axes.tr_mul(&Vector3::from(vertex.map(f64::from)));
            low = low.inf(&along);
            high = high.sup(&along);
        }
        OrientedBox {
            centre: Point3::from(axes * ((low + high) / 2.0)),
            axes: *axes,
            half: (high - low) / 2.0,
        }
    }

    /// The same box given in frame a, from its coordinates in frame b.
    pub fn transformed(&self, a_from_b: &Isometry3<f64>) -> Self {
        OrientedBox {
            centre: a_from_b * self.centre,
            axes: a_from_b.rotation.to_rotation_matrix().matrix() * self.axes,
            half: self.half,
        }
    }

    /// The corners; bit 0, 1 and 2 of the index say which end of x, y and z.
    pub fn corners(&self) -> [Point3<f64>; 8] {
        std::array::from_fn(|corner| {
            let side = |bit: usize| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let signs = Vector3::new(side(0), side(1), side(2));
            self.centre + self.axes * self.half.component_mul(&signs)
        })
    }

    /// The distance from a point to the solid box; 0 inside.
    pub fn distance(&self, point: &Point3<f64>) -> f64 {
        let along = self.axes.tr_mul(&(point - self.centre)).abs() - self.half;
        along.sup(&Vector3::zeros()).norm()
    }

    /// Whether two solid boxes share more than a touch: the separating-axis theorem over the six
    /// face normals and the nine cross products of edges, after a test of the bounding spheres.
    pub fn overlaps(&self, other: &Self) -> bool {
        let between = other.centre - self.centre;
        let reach = self.half.norm() + other.half.norm();
        if between.norm_squared() >= reach * reach {
            return false;
        }
        // The other box seen from this one's axes.
        let turn = self.axes.tr_mul(&other.axes);
        let size = turn.abs();
        let offset = self.axes.tr_mul(&between);
        let separated_by_a_face = (0..3).any(|i| {
            let own = offset[i].abs() >= self.half[i] + size.row(i).tr_dot(&other.half);
            let others =
                offset.dot(&turn.column(i)).abs() >= other.half[i] + size.column(i).dot(&self.half);
            own || others
        });
        if separated_by_a_face {
            return false;
        }
        !(0..3).any(|i| {
            let (i1, i2) = ((i + 1) % 3, (i + 2) % 3);
            (0..3).any(|j| {
                let (j1, j2) = ((j + 1) % 3, (j + 2) % 3);
                let own = self.half[i1] * size[(i2, j)] + self.half[i2] * size[(i1, j)];
                let others = other.half[j1] * size[(i, j2)] + other.half[j2] * size[(i, j1)];
                let apart = offset[i2] * turn[(i1, j)] - offset[i1] * turn[(i2, j)];
                // Two parallel edges have no cross product: 0 >= 0 must not pass for separation.
                apart.abs() > own + others + 1e-9
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Stream, stream, uniform};
    use nalgebra::{Translation3, UnitQuaternion};

    fn somewhere(s: &mut Stream, spread: f64) -> Isometry3<f64> {
        let mut vector = |r: f64| {
            let mut draw = || uniform(s, -r, r);
            Vector3::new(draw(), draw(), draw())
        };
        Isometry3::from_parts(
            Translation3::from(vector(spread)),
            UnitQuaternion::from_scaled_axis(vector(2.0)),
        )
    }

    fn any_box(s: &mut Stream) -> OrientedBox {
        let mut draw = || uniform(s, 0.05, 0.6);
        let half = [draw(), draw(), draw()];
        OrientedBox::from_bounds(half.map(|h| -h), half).transformed(&somewhere(s, 0.7))
    }

    /// The distance of two boxes by alternating projection, which converges for convex sets.
    fn distance_by_projection(a: &OrientedBox, b: &OrientedBox) -> f64 {
        let onto = |b: &OrientedBox, p: Point3<f64>| {
            let along = b.axes.tr_mul(&(p - b.centre)).sup(&-b.half).inf(&b.half);
            b.centre + b.axes * along
        };
        let mut p = a.centre;
        for _ in 0..4000 {
            p = onto(a, onto(b, p));
        }
        b.distance(&p)
    }

    #[test]
    fn overlap_agrees_with_alternating_projection() {
        let mut s = stream(1, "boxes", &[]);
        let (mut apart, mut overlapping) = (0, 0);
        for _ in 0..400 {
            let (a, b) = (any_box(&mut s), any_box(&mut s));
            let distance = distance_by_projection(&a, &b);
            assert_eq!(a.overlaps(&b), b.overlaps(&a));
            if distance > 1e-3 {
                assert!(!a.overlaps(&b), "{distance} m apart: {a:?} {b:?}");
                apart += 1;
            } else if distance < 1e-9 {
                assert!(a.overlaps(&b), "overlapping: {a:?} {b:?}");
                overlapping += 1;
            }
        }
        assert!(apart > 80 && overlapping > 80, "{apart} {overlapping}");
    }

    #[test]
    fn overlap_does_not_depend_on_the_frame() {
        let mut s = stream(2, "boxes", &[]);
        for _ in 0..2000 {
            let (a, b, frame) = (any_box(&mut s), any_box(&mut s), somewhere(&mut s, 1.0));
            let moved = a.transformed(&frame).overlaps(&b.transformed(&frame));
            assert_eq!(a.overlaps(&b), moved);
        }
    }

    #[test]
    fn stacked_boxes_touch_without_overlap() {
        let below = OrientedBox::from_bounds([0.0; 3], [1.0, 1.0, 0.5]);
        let above = OrientedBox::from_bounds([0.0, 0.0, 0.5], [1.0, 1.0, 1.0]);
        let inside = OrientedBox::from_bounds([0.2; 3], [0.4; 3]);
        assert!(!below.overlaps(&above));
        assert!(below.overlaps(&inside));
    }

    #[test]
    fn a_slanted_box_is_found_again() {
        let part = OrientedBox::from_bounds([-0.3, -0.02, -0.05], [0.3, 0.02, 0.05]);
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let slant = Isometry3::new(Vector3::new(0.1, 0.2, 0.3), axis * 40f64.to_radians());
            let corners = part.transformed(&slant).corners();
            let vertices = corners
                .map(|p| [p.x as f32, p.y as f32, p.z as f32])
                .to_vec();
            let found = OrientedBox::around(&Mesh {
                vertices,
                triangles: vec![],
            });
            assert!((found.half.product() / part.half.product() - 1.0).abs() < 1e-4);
        }
    }
}
