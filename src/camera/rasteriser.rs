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

/// A vertex as the camera sees it.
#[derive(Clone, Copy, Default)]
struct ScreenVertex {
    /// Pixel column and row.
    x: f64,
    y: f64,
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

    fn shifted(&self, v: ScreenVertex) -> ScreenVertex {
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
                    self.on_screen(point)
                } else {
                    ScreenVertex::default()
                }
            }));
            for corners in &body.mesh.triangles {
                let triangle = corners.map(|i| vertices[i as usize]);
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
                    let cut = cut.map(|p| self.on_screen(p));
                    for second in 1..count - 1 {
                        let part = [cut[0], cut[second], cut[second + 1]];
                        self.fill(part, body.label.into(), camera, projector.as_deref_mut());
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
        label: u32,
        camera: &mut CameraView,
        projector: Option<&mut ProjectorView>,
    ) {
        let (width, height) = (self.intrinsics.width, self.intrinsics.height);
        for_each_span(width, height, triangle, |span, first, step| {
            let mut run = Run::new(first, step, span.len());
            let (depths, _) = camera.inverse_depth[whole_blocks(&span)].as_chunks_mut::<LANES>();
            let (labels, _) = camera.labels[whole_blocks(&span)].as_chunks_mut::<LANES>();
            for (depths, labels) in depths.iter_mut().zip(labels) {
                let new = run.next();
                let nearer = compare(&new, depths);
                for k in 0..LANES {
                    depths[k] = if new[k] > depths[k] {
                        new[k]
                    } else {
                        depths[k]
                    };
                }
                for k in 0..LANES {
                    labels[k] = (label & nearer[k]) | (labels[k] & !nearer[k]);
                }
            }
        });
        if let Some(projector) = projector {
            let triangle = triangle.map(|v| projector.shifted(v));
            for_each_span(projector.width, height, triangle, |span, first, step| {
                let mut run = Run::new(first, step, span.len());
                let blocks = &mut projector.inverse_depth[whole_blocks(&span)];
                for depths in blocks.as_chunks_mut::<LANES>().0 {
                    let new = run.next();
                    for k in 0..LANES {
                        depths[k] = if new[k] > depths[k] {
                            new[k]
                        } else {
                            depths[k]
                        };
                    }
                }
            });
        }
    }
}

#[inline(always)]
fn whole_blocks(span: &Range<usize>) -> Range<usize> {
    span.start..span.start + span.len().next_multiple_of(LANES)
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
    fn new(first: f32, step: f32, length: usize) -> Run {
        Run {
            first,
            step,
            length: length as i32 as f32,
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
    if rows.is_empty() || right_most <= 0.0 || left_most >= width as f64 {
        return;
    }
    let (ab, ac) = (
        b.inverse_depth - a.inverse_depth,
        c.inverse_depth - a.inverse_depth,
    );
    let along_x = (ab * (c.y - a.y) - ac * (b.y - a.y)) / area;
    let along_y = (ac * (b.x - a.x) - ab * (c.x - a.x)) / area;
    // Inverse depth at column 0 of the current row.
    let mut at_column_0 =
        a.inverse_depth - along_x * a.x + along_y * (rows.start as i32 as f64 - a.y);

    let middle_row = first_centre(middle.y, height);
    let long = Edge::new(top, bottom, rows.start);
    // The middle corner lies left of the long edge when the way over it turns like the triangle.
    let middle_is_left =
        (middle.x - top.x) * (bottom.y - top.y) < (bottom.x - top.x) * (middle.y - top.y);
    let (mut left, mut right) = (long, long);
    for (from, to, rows) in [
        (top, middle, rows.start..middle_row),
        (middle, bottom, middle_row..rows.end),
    ] {
        if rows.is_empty() {
            continue;
        }
        let short = Edge::new(from, to, rows.start);
        if middle_is_left {
            left = short;
        } else {
            right = short;
        }
        for row in rows {
            let (start, end) = (left.first_centre(width), right.first_centre(width));
            if start < end {
                let first = at_column_0 + along_x * f64::from(start as i32);
                span(
                    row * width + start..row * width + end,
                    first as f32,
                    along_x as f32,
                );
            }
            at_column_0 += along_y;
            left.x = left.x.wrapping_add(left.step);
            right.x = right.x.wrapping_add(right.step);
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
    fn new(top: ScreenVertex, bottom: ScreenVertex, row: usize) -> Edge {
        let slope = (bottom.x - top.x) / (bottom.y - top.y);
        let x = top.x + (row as i32 as f64 - top.y) * slope;
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
