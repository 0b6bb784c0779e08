//! Plane outlines and the closed solids that are drawn from them. Metres; outlines run
//! counter-clockwise. Every solid comes back closed and with outward triangles.

use armpose::robot::Mesh;
use std::f64::consts::{PI, TAU};

pub type Outline = Vec<[f64; 2]>;

/// How far a polygon may lie inside the circle that it stands for.
const SAGITTA: f64 = 0.0002;

/// Sides of the polygon that stands for a circle of this radius; a multiple of 4.
fn sides(radius: f64) -> usize {
    let least = PI / (2.0 * SAGITTA / radius).sqrt();
    ((least / 4.0).ceil() as usize).max(3) * 4
}

/// The direction in which an outline is extruded. Outlines across X are in (y, z), across Y in
/// (x, z), across Z in (x, y).
#[derive(Clone, Copy)]
pub enum Axis {
    X,
    Y,
    Z,
}

/// Points on a circle from one angle to another (degrees), both ends included.
pub fn arc(centre: [f64; 2], radius: f64, from: f64, to: f64) -> Outline {
    let steps = ((to - from).abs() / 360.0 * sides(radius) as f64)
        .ceil()
        .max(1.0) as usize;
    (0..=steps)
        .map(|i| {
            let angle = (from + (to - from) * i as f64 / steps as f64) * PI / 180.0;
            [
                centre[0] + radius * angle.cos(),
                centre[1] + radius * angle.sin(),
            ]
        })
        .collect()
}

pub fn disc(centre: [f64; 2], radius: f64) -> Outline {
    regular(centre, radius, sides(radius))
}

/// The regular polygon of `n` points on a circle, the first in the direction of u.
fn regular(centre: [f64; 2], radius: f64, n: usize) -> Outline {
    (0..n)
        .map(|i| {
            let (sin, cos) = (TAU * i as f64 / n as f64).sin_cos();
            [centre[0] + radius * cos, centre[1] + radius * sin]
        })
        .collect()
}

pub fn rectangle(u: [f64; 2], v: [f64; 2]) -> Outline {
    vec![[u[0], v[0]], [u[1], v[0]], [u[1], v[1]], [u[0], v[1]]]
}

/// The convex hull (Andrew's monotone chain).
pub fn hull(points: impl IntoIterator<Item = [f64; 2]>) -> Outline {
    let mut sorted: Outline = points.into_iter().collect();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let chain = |points: &mut dyn Iterator<Item = &[f64; 2]>| {
        let mut chain: Outline = Vec::new();
        for &p in points {
            while chain.len() > 1 && turn(chain[chain.len() - 2], chain[chain.len() - 1], p) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut outline = chain(&mut sorted.iter());
    outline.extend(chain(&mut sorted.iter().rev()));
    outline
}

/// Twice the signed area of a triangle: positive when it turns left.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// The prism over an outline between two heights.
pub fn extrude(axis: Axis, outline: &Outline, heights: [f64; 2]) -> Mesh {
    loft(axis, &heights.map(|height| (height, outline.clone())))
}

pub fn cuboid(x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> Mesh {
    extrude(Axis::Z, &rectangle(x, y), z)
}

pub fn cylinder(axis: Axis, centre: [f64; 2], radius: f64, heights: [f64; 2]) -> Mesh {
    extrude(axis, &disc(centre, radius), heights)
}

/// A ruled solid through outlines of equal numbers of points at ascending heights, with flat ends.
pub fn loft(axis: Axis, sections: &[(f64, Outline)]) -> Mesh {
    let n = sections[0].1.len();
    assert!(sections.iter().all(|(_, outline)| outline.len() == n));
    let mut triangles = walls(n, sections.len());
    let top = ((sections.len() - 1) * n) as u32;
    for [a, b, c] in clip_ears(&sections[0].1) {
        triangles.push([a, c, b]);
    }
    for triangle in clip_ears(&sections[sections.len() - 1].1) {
        triangles.push(triangle.map(|i| i + top));
    }
    place(axis, sections, triangles)
}

/// The loft and its mirror image at negative heights.
pub fn loft_both(axis: Axis, sections: &[(f64, Outline)]) -> [Mesh; 2] {
    let negative = sections.iter().rev().map(|(h, o)| (-h, o.clone()));
    [
        loft(axis, sections),
        loft(axis, &negative.collect::<Vec<_>>()),
    ]
}

/// A straight tube: a disc with a round bore, extruded.
pub fn ring(axis: Axis, centre: [f64; 2], [inner, outer]: [f64; 2], heights: [f64; 2]) -> Mesh {
    let [low, high] = heights;
    let walls = [(low, outer), (high, outer), (high, inner), (low, inner)];
    tube(
        axis,
        &walls.map(|(height, radius)| (height, regular(centre, radius, sides(outer)))),
    )
}

/// A solid with a hole through it: outlines of equal numbers of points, up along the outside and
/// down along the inside.
pub fn tube(axis: Axis, sections: &[(f64, Outline)]) -> Mesh {
    let mut closed = sections.to_vec();
    closed.push(sections[0].clone());
    place(axis, &closed, walls(sections[0].1.len(), closed.len())).welded()
}

/// The part of a disc within a rectangle about the same centre, by half widths: 32 points, the
/// rectangle's corners among their directions.
pub fn clipped_disc(half: [f64; 2], radius: f64) -> Outline {
    let corner = half[1].atan2(half[0]);
    let corners = [-corner, corner, PI - corner, PI + corner, TAU - corner];
    let steps = 8;
    (0..4 * steps)
        .map(|i| {
            let (side, part) = (i / steps, (i % steps) as f64 / steps as f64);
            let angle = corners[side] + (corners[side + 1] - corners[side]) * part;
            let (sin, cos) = angle.sin_cos();
            let r = radius.min(half[0] / cos.abs()).min(half[1] / sin.abs());
            [r * cos, r * sin]
        })
        .collect()
}

/// The part of a disc about the origin above `v = floor` and within `|u| <= half`; a half width
/// that the disc does not reach is cut to what it does.
pub fn segment(radius: f64, floor: f64, half: f64) -> Outline {
    let half = half.min((radius * radius - floor * floor).sqrt() * 0.999);
    let steps = 10;
    let mut outline: Outline = (0..=steps)
        .map(|i| {
            let u = half * (1.0 - 2.0 * i as f64 / steps as f64);
            [u, (radius * radius - u * u).sqrt()]
        })
        .collect();
    outline.extend([[-half, floor], [half, floor]]);
    outline
}

/// Every side moved inward by `depth`. Meant for depths that are small beside the sides' turns.
pub fn inset(outline: &Outline, depth: f64) -> Outline {
    let n = outline.len();
    let side = |i: usize| {
        let ([u, v], [s, t]) = (outline[i % n], outline[(i + 1) % n]);
        let length = (s - u).hypot(t - v);
        [(s - u) / length, (t - v) / length]
    };
    (0..n)
        .map(|i| {
            let (before, after) = (side(i + n - 1), side(i));
            // The corner of both moved sides lies along the sum of their normals.
            let scale = depth / (1.0 + before[0] * after[0] + before[1] * after[1]).max(0.5);
            [
                outline[i][0] - scale * (before[1] + after[1]),
                outline[i][1] + scale * (before[0] + after[0]),
            ]
        })
        .collect()
}

/// The triangles between successive sections of `n` points each.
fn walls(n: usize, sections: usize) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for section in 0..sections - 1 {
        for i in 0..n {
            let at = |section: usize, i: usize| (section * n + i % n) as u32;
            let (a, b) = (at(section, i), at(section, i + 1));
            let (c, d) = (at(section + 1, i + 1), at(section + 1, i));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

fn place(axis: Axis, sections: &[(f64, Outline)], mut triangles: Vec<[u32; 3]>) -> Mesh {
    let mut vertices = Vec::new();
    for (height, outline) in sections {
        vertices.extend(outline.iter().map(|&[u, v]| {
            let point = match axis {
                Axis::X => [*height, u, v],
                Axis::Y => [u, *height, v],
                Axis::Z => [u, v, *height],
            };
            point.map(|x| x as f32)
        }));
    }
    // (x, z, y) is a left-handed order, which turns the surface inside out.
    if matches!(axis, Axis::Y) {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Mesh {
        vertices,
        triangles,
    }
}

/// Triangulates a simple polygon by cutting off one ear after another.
fn clip_ears(outline: &Outline) -> Vec<[u32; 3]> {
    let point = |i: u32| outline[i as usize];
    let mut left: Vec<u32> = (0..outline.len() as u32).collect();
    let mut triangles = Vec::new();
    while left.len() > 3 {
        let n = left.len();
        let corner = |k: usize| [left[(k + n - 1) % n], left[k], left[(k + 1) % n]];
        let is_ear = |k: usize| {
            let ear = corner(k);
            let [a, b, c] = ear.map(point);
            let inside =
                |p: [f64; 2]| turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
            let free = |i: &u32| ear.contains(i) || !inside(point(*i));
            turn(a, b, c) > 1e-12 && left.iter().all(free)
        };
        let ear = (0..n)
            .find(|&k| is_ear(k))
            .expect("a simple polygon has an ear");
        triangles.push(corner(ear));
        left.remove(ear);
    }
    triangles.push([left[0], left[1], left[2]]);
    triangles
}

/// The solid of revolution through circles of `[radius, height]` about an axis of its own, with
/// flat ends; heights ascend.
pub fn turned(axis: Axis, centre: [f64; 2], profile: &[[f64; 2]]) -> Mesh {
    let widest = profile.iter().fold(0.0, |r: f64, p| r.max(p[0]));
    let n = sides(widest);
    let section = |&[radius, height]: &[f64; 2]| (height, regular(centre, radius, n));
    loft(axis, &profile.iter().map(section).collect::<Vec<_>>())
}
