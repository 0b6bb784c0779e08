//! Drawing triangles into z-buffers of inverse depth. Inverse depth is affine on the screen, so one
//! gradient a triangle is exact, and a larger value is a nearer surface.

use super::{Body, Intrinsics};
use nalgebra::Vector3;
use std::ops::Range;

/// What lies nearer to the optical centre than this plane is cut off, metres.
pub const NEAR_PLANE: f64 = 0.05;

/// Columns of the projector's buffer per pixel column. At 2 the borders of shadows are found to
/// half a pixel; more costs time and changes hardly any pixel.
const PROJECTOR_OVERSAMPLING: usize = 2;

/// Pixels are drawn in blocks of as many as one baseline vector instruction takes. A buffer is
/// longer than its image by a block, since the last one of a span may reach past it.
const LANES: usize = 4;

/// A vertex as the camera and the projector see it.
#[derive(Clone, Copy, Default)]
struct ScreenVertex {
    /// The camera's pixel column and row.
    x: f64,
    y: f64,
    /// Column of the projector's buffer; the row is the camera's. 0 without a projector.
    projector_x: f64,
    /// 1/m; 0 marks a vertex in front of the near plane, which has no place on the screen.
    inverse_depth: f64,
}

/// What the camera sees.
pub struct CameraView {
    pixels: usize,
    inverse_depth: Vec<f32>,
    /// As wide as the depths, so that both are handled by the same vector instructions.
    labels: Vec<u32>,
}

impl CameraView {
    pub fn new(intrinsics: &Intrinsics) -> CameraView {
        let pixels = intrinsics.width * intrinsics.height;
        CameraView {
            pixels,
            inverse_depth: vec![0.0; pixels + LANES],
            labels: vec![0; pixels + LANES],
        }
    }

    /// 1/m for each pixel; 0 where nothing is seen.
    pub fn inverse_depth(&self) -> &[f32] {
        &self.inverse_depth[..self.pixels]
    }

    /// The label of the nearest surface for each pixel; 0 where nothing is seen.
    pub fn labels(&self) -> Vec<u8> {
        self.labels[..self.pixels]
            .iter()
            .map(|&label| label as u8)
            .collect()
    }
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
    /// For each pixel of a row, the projector's sample left of it.
    left_samples: Vec<u32>,
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
            inverse_depth: vec![0.0; width * intrinsics.height + LANES],
            left_samples: vec![0; intrinsics.width],
        }
    }

    /// The column of its buffer for a place in the camera's image.
    fn column(&self, x: f64, inverse_depth: f64) -> f64 {
        (x - self.focal_baseline * inverse_depth + self.margin) * PROJECTOR_OVERSAMPLING as f64
    }

    /// The disparities of the camera's row `row`, whose inverse depths are given, in whole steps of
    /// `step` px; 0 where there is none, because nothing is there, or it is too near or in shadow.
    ///
    /// A surface is in shadow when both projector samples beside it are nearer to the projector,
    /// by more than 0.2 % of inverse depth. Asking for both keeps steep sides free of false shadow.
    pub fn disparities(&mut self, row: usize, seen: &[f32], step: f64, codes: &mut [u16]) {
        const TOLERANCE: f32 = 1.002;
        let scale = PROJECTOR_OVERSAMPLING as f32;
        let shift = self.focal_baseline as f32 * scale;
        let margin = self.margin as f32 * scale;
        let steps = (self.focal_baseline / step) as f32;
        let nearest = self.nearest;
        let results = self.left_samples.iter_mut().zip(codes.iter_mut());
        for (column, (&inverse_depth, (left, code))) in seen.iter().zip(results).enumerate() {
            let inverse_depth = if inverse_depth <= nearest {
                inverse_depth
            } else {
                0.0
            };
            let x = column as i32 as f32 * scale + margin - shift * inverse_depth;
            // Of two equally near samples either may be the left one: both pairs hold the nearest.
            *left = rounded(x - 0.5);
            *code = rounded(inverse_depth * steps) as u16;
        }
        let samples = &self.inverse_depth[row * self.width..(row + 1) * self.width];
        for ((&left, &inverse_depth), code) in self.left_samples.iter().zip(seen).zip(codes) {
            let threshold = inverse_depth * TOLERANCE;
            let beside = &samples[left as usize..left as usize + 2];
            if beside[0] > threshold && beside[1] > threshold {
                *code = 0;
            }
        }
    }
}

/// The nearest integer, for numbers from 0 to 2^22. (Adding 2^23 leaves no bits for a fraction.
/// Unlike a cast this needs no branches, and several run at once.)
#[inline(always)]
fn rounded(x: f32) -> u32 {
    const ONE_ULP_IS_ONE: f32 = (1 << 23) as f32;
    (x + ONE_ULP_IS_ONE).to_bits() - ONE_ULP_IS_ONE.to_bits()
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
        camera.labels.fill(0);
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
                    self.on_screen(point, projector.as_deref())
                } else {
                    ScreenVertex::default()
                }
            }));
            for corners in &body.mesh.triangles {
                let triangle = corners.map(|i| &vertices[i as usize]);
                if triangle.iter().all(|v| v.inverse_depth > 0.0) {
                    self.fill(
                        triangle,
                        body.label.into(),
                        camera,
                        projector.as_deref_mut(),
                    );
                } else if triangle.iter().any(|v| v.inverse_depth > 0.0) {
                    let points = corners.map(|i| in_camera(body.mesh.vertices[i as usize]));
                    let (cut, count) = clip_near(points);
                    let cut = cut.map(|p| self.on_screen(p, projector.as_deref()));
                    for second in 1..count - 1 {
                        let part = [&cut[0], &cut[second], &cut[second + 1]];
                        self.fill(part, body.label.into(), camera, projector.as_deref_mut());
                    }
                }
            }
            self.vertices = vertices;
        }
    }

    fn on_screen(&self, point: Vector3<f64>, projector: Option<&ProjectorView>) -> ScreenVertex {
        let camera = &self.intrinsics;
        let inverse_depth = 1.0 / point.z;
        let x = camera.fx * point.x * inverse_depth + camera.cx;
        ScreenVertex {
            x,
            y: camera.fy * point.y * inverse_depth + camera.cy,
            projector_x: projector.map_or(0.0, |projector| projector.column(x, inverse_depth)),
            inverse_depth,
        }
    }

    fn fill(
        &self,
        corners: [&ScreenVertex; 3],
        label: u32,
        camera: &mut CameraView,
        projector: Option<&mut ProjectorView>,
    ) {
        let in_camera = |v: &ScreenVertex| v.x;
        let in_projector = |v: &ScreenVertex| v.projector_x;
        let (camera_area, projector_area) = (area(corners, in_camera), area(corners, in_projector));
        if camera_area >= 0.0 && projector_area >= 0.0 {
            return;
        }
        let triangle = Triangle::new(corners, self.intrinsics.height);
        if triangle.rows.is_empty() {
            return;
        }
        let width = self.intrinsics.width;
        triangle.for_each_span(width, in_camera, camera_area, |start, mut run| {
            let (depths, _) = camera.inverse_depth[start..].as_chunks_mut::<LANES>();
            let (labels, _) = camera.labels[start..].as_chunks_mut::<LANES>();
            for (depths, labels) in depths.iter_mut().zip(labels) {
                let new = run.next();
                let nearer = compare(&new, depths);
                keep_larger(depths, &new);
                for k in 0..LANES {
                    labels[k] = (label & nearer[k]) | (labels[k] & !nearer[k]);
                }
                if run.is_over() {
                    break;
                }
            }
        });
        if let Some(projector) = projector {
            let width = projector.width;
            triangle.for_each_span(width, in_projector, projector_area, |start, mut run| {
                let (depths, _) = projector.inverse_depth[start..].as_chunks_mut::<LANES>();
                for depths in depths {
                    keep_larger(depths, &run.next());
                    if run.is_over() {
                        break;
                    }
                }
            });
        }
    }
}

#[inline(always)]
fn keep_larger(old: &mut [f32; LANES], new: &[f32; LANES]) {
    for k in 0..LANES {
        old[k] = if new[k] > old[k] { new[k] } else { old[k] };
    }
}

/// All bits are set where `new` is larger than `old`.
#[inline(always)]
fn compare(new: &[f32; LANES], old: &[f32; LANES]) -> [u32; LANES] {
    let mut larger = [0; LANES];
    for k in 0..LANES {
        larger[k] = if new[k] > old[k] { !0 } else { 0 };
    }
    larger
}

/// Inverse depths along a span, block by block.
struct Run {
    first: f32,
    step: f32,
    length: f32,
    /// Of the next block's pixels, counted from the start of the span. (Kept as floats, which also
    /// keeps the compiler from merging blocks, a loss for the short spans of small triangles.)
    position: [f32; LANES],
}

impl Run {
    #[inline(always)]
    fn new(first: f32, step: f32, length: i32) -> Run {
        Run {
            first,
            step,
            length: length as f32,
            position: [0.0, 1.0, 2.0, 3.0],
        }
    }

    /// The next block; 0 past the end of the span, where it changes nothing.
    #[inline(always)]
    fn next(&mut self) -> [f32; LANES] {
        let at = |i| {
            if i < self.length {
                self.first + self.step * i
            } else {
                0.0
            }
        };
        let block = self.position.map(at);
        self.position = self.position.map(|i| i + LANES as f32);
        block
    }

    #[inline(always)]
    fn is_over(&self) -> bool {
        self.position[0] >= self.length
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

/// Twice the area on the screen, negative for a triangle seen from outside, since y points down.
#[inline(always)]
fn area([a, b, c]: [&ScreenVertex; 3], x: impl Fn(&ScreenVertex) -> f64) -> f64 {
    (x(b) - x(a)) * (c.y - a.y) - (x(c) - x(a)) * (b.y - a.y)
}

/// What the camera and the projector share of a triangle.
struct Triangle<'a> {
    corners: [&'a ScreenVertex; 3],
    top: &'a ScreenVertex,
    middle: &'a ScreenVertex,
    bottom: &'a ScreenVertex,
    /// Those whose centres it covers.
    rows: Range<usize>,
    /// The first row below the middle corner.
    middle_row: usize,
}

impl<'a> Triangle<'a> {
    #[inline(always)]
    fn new(corners: [&'a ScreenVertex; 3], height: usize) -> Triangle<'a> {
        let by_row = |p: &'a ScreenVertex, q: &'a ScreenVertex| {
            if q.y < p.y { (q, p) } else { (p, q) }
        };
        let [a, b, c] = corners;
        let (top, bottom) = by_row(a, b);
        let (top, middle) = by_row(top, c);
        let (middle, bottom) = by_row(middle, bottom);
        Triangle {
            corners,
            top,
            middle,
            bottom,
            rows: first_centre(top.y, height)..first_centre(bottom.y, height),
            middle_row: first_centre(middle.y, height),
        }
    }

    /// Calls `span(index of its first pixel, run)` for every row of a triangle on a screen of
    /// `width` columns, unless it is seen from behind. `x` is the column of a vertex there, `area`
    /// the [`area`]. The run holds the pixels whose centres the triangle covers, and may be empty.
    /// A centre on a left or top edge belongs to the triangle, one on a right or bottom edge to its
    /// neighbour.
    #[inline(always)]
    fn for_each_span(
        &self,
        width: usize,
        x: impl Fn(&ScreenVertex) -> f64,
        area: f64,
        mut span: impl FnMut(usize, Run),
    ) {
        let &Triangle {
            corners: [a, b, c],
            top,
            middle,
            bottom,
            ref rows,
            middle_row,
        } = self;
        let left_most = x(a).min(x(b)).min(x(c));
        let right_most = x(a).max(x(b)).max(x(c));
        if area >= 0.0 || right_most <= 0.0 || left_most >= width as f64 {
            return;
        }
        let (ab, ac) = (
            b.inverse_depth - a.inverse_depth,
            c.inverse_depth - a.inverse_depth,
        );
        let along_x = (ab * (c.y - a.y) - ac * (b.y - a.y)) / area;
        let along_y = (ac * (x(b) - x(a)) - ab * (x(c) - x(a))) / area;
        // Inverse depth at column 0 of the current row.
        let mut at_column_0 =
            a.inverse_depth - along_x * x(a) + along_y * (rows.start as i32 as f64 - a.y);

        let long = Edge::new((x(top), top.y), (x(bottom), bottom.y), rows.start);
        // The middle corner lies left of the long edge when the way over it turns like the triangle.
        let middle_is_left =
            (x(middle) - x(top)) * (bottom.y - top.y) < (x(bottom) - x(top)) * (middle.y - top.y);
        let (mut left, mut right) = (long, long);
        for (from, to, rows) in [
            (top, middle, rows.start..middle_row),
            (middle, bottom, middle_row..rows.end),
        ] {
            if rows.is_empty() {
                continue;
            }
            let short = Edge::new((x(from), from.y), (x(to), to.y), rows.start);
            if middle_is_left {
                left = short;
            } else {
                right = short;
            }
            for row in rows {
                let (start, end) = (left.first_centre(width), right.first_centre(width));
                let first = at_column_0 + along_x * f64::from(start as i32);
                let run = Run::new(first as f32, along_x as f32, end as i32 - start as i32);
                span(row * width + start, run);
                at_column_0 += along_y;
                left.x = left.x.wrapping_add(left.step);
                right.x = right.x.wrapping_add(right.step);
            }
        }
    }
}

/// Where an edge crosses the rows, one after the other, in fixed point.
#[derive(Clone, Copy)]
struct Edge {
    x: i64,
    step: i64,
}

const FRACTION_BITS: u32 = 28;

impl Edge {
    /// From its upper end and its lower one, at the given row.
    #[inline(always)]
    fn new(top: (f64, f64), bottom: (f64, f64), row: usize) -> Edge {
        let slope = (bottom.0 - top.0) / (bottom.1 - top.1);
        let x = top.0 + (row as i32 as f64 - top.1) * slope;
        let one = f64::from(1 << FRACTION_BITS);
        Edge {
            x: (x * one) as i64,
            step: (slope * one) as i64,
        }
    }

    #[inline(always)]
    fn first_centre(self, limit: usize) -> usize {
        const ROUND_UP: i64 = (1 << FRACTION_BITS) - 1;
        (self.x.wrapping_add(ROUND_UP) >> FRACTION_BITS).clamp(0, limit as i64) as usize
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
