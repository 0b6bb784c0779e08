//! Drawing triangles into z-buffers of inverse depth. Inverse depth is affine on the screen, so one
//! gradient a triangle is exact, and a larger value is a nearer surface.

use super::{Body, Intrinsics, LabelImage};
use nalgebra::Vector3;
use std::ops::Range;

/// What lies nearer to the optical centre than this plane is cut off, metres.
pub const NEAR_PLANE: f64 = 0.05;

/// Columns of the projector's buffer per pixel column. At 2 the borders of shadows are found to
/// half a pixel; more costs time and changes hardly any pixel.
const PROJECTOR_OVERSAMPLING: usize = 2;

/// A vertex as the camera sees it.
#[derive(Clone, Copy, Default)]
struct ScreenVertex {
    /// Pixel column and row.
    x: f64,
    y: f64,
    /// 1/m; 0 marks a vertex in front of the near plane, which has no place on the screen.
    inverse_depth: f64,
}

/// What the camera sees: inverse depth in 1/m (0 = nothing) and the label of the nearest surface.
pub struct CameraView {
    pub inverse_depth: Vec<f32>,
    pub labels: LabelImage,
}

/// What the projector sees: inverse depth in the columns of a camera shifted to its place. Rows and
/// inverse depths are the camera's own; only columns differ, by the disparity.
pub struct ProjectorView {
    /// Disparity times depth, px m.
    focal_baseline: f64,
    /// Columns left of the camera's column 0, so that all disparities of the range fit.
    margin: f64,
    /// The largest inverse depth that has a disparity.
    nearest: f32,
    width: usize,
    inverse_depth: Vec<f32>,
}

impl ProjectorView {
    /// What is nearer to the camera than `near` metres gets no disparity.
    pub fn new(intrinsics: &Intrinsics, baseline: f64, near: f64) -> ProjectorView {
        let focal_baseline = intrinsics.fx * baseline;
        let margin = (focal_baseline / near).ceil() + 1.0;
        let width = (intrinsics.width + margin as usize + 1) * PROJECTOR_OVERSAMPLING;
        ProjectorView {
            focal_baseline,
            margin,
            nearest: (1.0 / near) as f32,
            width,
            inverse_depth: vec![0.0; width * intrinsics.height],
        }
    }

    fn from_camera(&self, v: ScreenVertex) -> ScreenVertex {
        let x = v.x - self.focal_baseline * v.inverse_depth + self.margin;
        ScreenVertex {
            x: x * PROJECTOR_OVERSAMPLING as f64,
            ..v
        }
    }

    /// The disparities of the camera's row `row`, whose inverse depths are given, in whole steps of
    /// `step` px; 0 where there is none, because nothing is there, or it is too near or in shadow.
    ///
    /// A surface is in shadow when both projector samples beside it are nearer to the projector,
    /// by more than 0.2 % of inverse depth. Asking for both keeps steep sides free of false shadow.
    pub fn disparities(&self, row: usize, seen: &[f32], step: f64, codes: &mut [u16]) {
        const TOLERANCE: f32 = 1.002;
        let scale = PROJECTOR_OVERSAMPLING as f32;
        let shift = self.focal_baseline as f32 * scale;
        let margin = self.margin as f32 * scale;
        let steps = (self.focal_baseline / step) as f32;
        let samples = &self.inverse_depth[row * self.width..(row + 1) * self.width];
        for ((column, &inverse_depth), code) in (0i32..).zip(seen).zip(codes) {
            *code = 0;
            if inverse_depth > 0.0 && inverse_depth <= self.nearest {
                let left = column as f32 * scale + margin - shift * inverse_depth;
                let left = left as i32 as usize;
                let threshold = inverse_depth * TOLERANCE;
                if samples[left] <= threshold || samples[left + 1] <= threshold {
                    *code = (inverse_depth * steps + 0.5) as u16;
                }
            }
        }
    }
}

/// Draws scenes. Its scratch memory is kept from frame to frame.
pub struct Rasteriser {
    intrinsics: Intrinsics,
    vertices: Vec<ScreenVertex>,
}

impl Rasteriser {
    pub fn new(intrinsics: Intrinsics) -> Rasteriser {
        Rasteriser {
            intrinsics,
            vertices: Vec::new(),
        }
    }

    /// Draws `bodies` as the camera sees them, and into `projector` as the projector does. Both
    /// are cleared first. Triangles seen from behind are left out, so bodies should be closed.
    /// Where two surfaces are equally near, the first one drawn stays.
    pub fn draw(
        &mut self,
        bodies: &[Body],
        camera: &mut CameraView,
        mut projector: Option<&mut ProjectorView>,
    ) {
        camera.inverse_depth.fill(0.0);
        camera.labels.pixels.fill(0);
        if let Some(projector) = projector.as_deref_mut() {
            projector.inverse_depth.fill(0.0);
        }
        for body in bodies {
            let rotation = body.camera_from_mesh.rotation.to_rotation_matrix();
            let translation = body.camera_from_mesh.translation.vector;
            let in_camera = |[x, y, z]: [f32; 3]| {
                rotation * Vector3::new(x.into(), y.into(), z.into()) + translation
            };
            let mut vertices = std::mem::take(&mut self.vertices);
            vertices.clear();
            vertices.extend(body.mesh.vertices.iter().map(|&vertex| {
                let point = in_camera(vertex);
                if point.z >= NEAR_PLANE {
                    self.on_screen(point)
                } else {
                    ScreenVertex::default()
                }
            }));
            for corners in &body.mesh.triangles {
                let triangle = corners.map(|i| vertices[i as usize]);
                if triangle.iter().all(|v| v.inverse_depth > 0.0) {
                    self.fill(triangle, body.label, camera, projector.as_deref_mut());
                } else if triangle.iter().any(|v| v.inverse_depth > 0.0) {
                    let points = corners.map(|i| in_camera(body.mesh.vertices[i as usize]));
                    let (cut, count) = clip_near(points);
                    let cut = cut.map(|p| self.on_screen(p));
                    for second in 1..count - 1 {
                        let part = [cut[0], cut[second], cut[second + 1]];
                        self.fill(part, body.label, camera, projector.as_deref_mut());
                    }
                }
            }
            self.vertices = vertices;
        }
    }

    fn on_screen(&self, point: Vector3<f64>) -> ScreenVertex {
        let camera = &self.intrinsics;
        let inverse_depth = 1.0 / point.z;
        ScreenVertex {
            x: camera.fx * point.x * inverse_depth + camera.cx,
            y: camera.fy * point.y * inverse_depth + camera.cy,
            inverse_depth,
        }
    }

    fn fill(
        &self,
        triangle: [ScreenVertex; 3],
        label: u8,
        camera: &mut CameraView,
        projector: Option<&mut ProjectorView>,
    ) {
        let (width, height) = (self.intrinsics.width, self.intrinsics.height);
        let depths = &mut camera.inverse_depth;
        let labels = &mut camera.labels.pixels;
        for_each_span(width, height, triangle, |span, first, step| {
            let labels = &mut labels[span.clone()];
            for ((i, old), old_label) in (0i32..).zip(&mut depths[span]).zip(labels) {
                let new = first + step * i as f32;
                let nearer = new > *old;
                *old = if nearer { new } else { *old };
                *old_label = if nearer { label } else { *old_label };
            }
        });
        if let Some(projector) = projector {
            let triangle = triangle.map(|v| projector.from_camera(v));
            let depths = &mut projector.inverse_depth;
            for_each_span(projector.width, height, triangle, |span, first, step| {
                for (i, old) in (0i32..).zip(&mut depths[span]) {
                    let new = first + step * i as f32;
                    *old = if new > *old { new } else { *old };
                }
            });
        }
    }
}

/// The part behind the near plane of a triangle that crosses it: its corners, in order, and their
/// number, three or four.
/// An edge is always cut from the inside outwards, so that neighbours share the new corner exactly.
fn clip_near(points: [Vector3<f64>; 3]) -> ([Vector3<f64>; 4], usize) {
    let mut cut = [Vector3::new(0.0, 0.0, NEAR_PLANE); 4];
    let mut count = 0;
    let mut push = |point| {
        cut[count] = point;
        count += 1;
    };
    let crossing = |inside: Vector3<f64>, outside: Vector3<f64>| {
        let mut point =
            inside + (outside - inside) * ((inside.z - NEAR_PLANE) / (inside.z - outside.z));
        point.z = NEAR_PLANE;
        point
    };
    for (i, &here) in points.iter().enumerate() {
        let next = points[(i + 1) % 3];
        let (here_inside, next_inside) = (here.z >= NEAR_PLANE, next.z >= NEAR_PLANE);
        if here_inside {
            push(here);
        }
        match (here_inside, next_inside) {
            (true, false) => push(crossing(here, next)),
            (false, true) => push(crossing(next, here)),
            _ => {}
        }
    }
    (cut, count)
}

/// Calls `span(indices, first, step)` for every row of a front-facing triangle on a screen of
/// `width x height` pixels: the run of pixels whose centres it covers, the inverse depth of the
/// first one and its growth per pixel. A centre on a left or top edge belongs to the triangle, one
/// on a right or bottom edge to its neighbour.
#[inline(always)]
fn for_each_span(
    width: usize,
    height: usize,
    [a, b, c]: [ScreenVertex; 3],
    mut span: impl FnMut(Range<usize>, f32, f32),
) {
    // Twice the area, negative for a triangle seen from outside, since y points down.
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if area >= 0.0 {
        return;
    }
    let by_row = |p: ScreenVertex, q: ScreenVertex| if q.y < p.y { (q, p) } else { (p, q) };
    let (top, bottom) = by_row(a, b);
    let (top, middle) = by_row(top, c);
    let (middle, bottom) = by_row(middle, bottom);
    let rows = first_centre(top.y, height)..first_centre(bottom.y, height);
    let left_most = a.x.min(b.x).min(c.x);
    let right_most = a.x.max(b.x).max(c.x);
    if rows.is_empty() || first_centre(left_most, width) == first_centre(right_most, width) {
        return;
    }
    let (ab, ac) = (
        b.inverse_depth - a.inverse_depth,
        c.inverse_depth - a.inverse_depth,
    );
    let along_x = (ab * (c.y - a.y) - ac * (b.y - a.y)) / area;
    let along_y = (ac * (b.x - a.x) - ab * (c.x - a.x)) / area;
    let at_origin = a.inverse_depth - along_x * a.x - along_y * a.y;

    let slope = |p: ScreenVertex, q: ScreenVertex| (q.x - p.x) / (q.y - p.y);
    let long = slope(top, bottom);
    let middle_row = first_centre(middle.y, height);
    let middle_is_left = middle.x < top.x + (middle.y - top.y) * long;
    for (from, to, rows) in [
        (top, middle, rows.start..middle_row),
        (middle, bottom, middle_row..rows.end),
    ] {
        if rows.is_empty() {
            continue;
        }
        let short = slope(from, to);
        for row in rows {
            let y = row as i32 as f64;
            let on_long = top.x + (y - top.y) * long;
            let on_short = from.x + (y - from.y) * short;
            let (left, right) = if middle_is_left {
                (on_short, on_long)
            } else {
                (on_long, on_short)
            };
            let (start, end) = (first_centre(left, width), first_centre(right, width));
            if start < end {
                let first = at_origin + along_x * start as i32 as f64 + along_y * y;
                span(
                    row * width + start..row * width + end,
                    first as f32,
                    along_x as f32,
                );
            }
        }
    }
}

/// The first integer at or after `x`, held within `0..=limit`. (`f64::ceil` is a function call on
/// the baseline instruction set.)
#[inline(always)]
fn first_centre(x: f64, limit: usize) -> usize {
    let limit = limit as i32;
    if x <= 0.0 {
        0
    } else if x >= f64::from(limit) {
        limit as usize
    } else {
        let whole = x as i32;
        (whole + i32::from(f64::from(whole) < x)) as usize
    }
}
