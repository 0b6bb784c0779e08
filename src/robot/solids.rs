//! Closed surfaces of simple solids, centred at the origin. Metres.

use super::Mesh;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Sides of the polygon that stands for a circle: the chord of a 0.2 m circle is 0.4 mm off.
const SEGMENTS: usize = 48;

/// An axis-aligned box with the given edge lengths.
pub fn cuboid(size: [f64; 3]) -> Mesh {
    let corner = |i: usize| {
        std::array::from_fn(|axis| {
            let sign = if i >> axis & 1 == 1 { 0.5 } else { -0.5 };
            (sign * size[axis]) as f32
        })
    };
    let quads: [[u32; 4]; 6] = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    Mesh {
        vertices: (0..8).map(corner).collect(),
        triangles: quads
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect(),
    }
}

/// A cylinder about the z axis.
pub fn cylinder(radius: f64, length: f64) -> Mesh {
    let half = length / 2.0;
    lathe(
        &[[0.0, -half], [radius, -half], [radius, half], [0.0, half]],
        SEGMENTS,
    )
}

/// A ball about the origin, metres.
pub fn sphere(radius: f64) -> Mesh {
    capsule(radius, 0.0)
}

/// A cylinder of the given length about the z axis with a half ball on either end.
pub fn capsule(radius: f64, length: f64) -> Mesh {
    let steps = SEGMENTS / 4;
    let arc = |end: f64| {
        (0..=steps).map(move |i| {
            let latitude = FRAC_PI_2 * (i as f64 / steps as f64 + (end - 1.0) / 2.0);
            [
                radius * latitude.cos(),
                radius * latitude.sin() + end * length / 2.0,
            ]
        })
    };
    let mut profile: Vec<[f64; 2]> = arc(-1.0).chain(arc(1.0)).collect();
    profile.dedup();
    lathe(&profile, SEGMENTS)
}

/// The solid swept by turning a profile of `[radius, z]` points about the z axis. The profile
/// starts and ends on the axis, touches it nowhere else, and has the solid on its left, so that it
/// goes up on the outside.
pub fn lathe(profile: &[[f64; 2]], segments: usize) -> Mesh {
    let rings = profile.len() - 2;
    let mut vertices = vec![[0.0, 0.0, profile[0][1] as f32]];
    for &[radius, z] in &profile[1..=rings] {
        vertices.extend((0..segments).map(|i| {
            let (sin, cos) = (TAU * i as f64 / segments as f64).sin_cos();
            [(radius * cos) as f32, (radius * sin) as f32, z as f32]
        }));
    }
    vertices.push([0.0, 0.0, profile[rings + 1][1] as f32]);

    let at = |ring: usize, i: usize| (1 + ring * segments + i % segments) as u32;
    let top = vertices.len() as u32 - 1;
    let mut triangles = Vec::with_capacity(2 * rings * segments);
    for i in 0..segments {
        triangles.push([0, at(0, i + 1), at(0, i)]);
        for ring in 0..rings - 1 {
            let (a, b) = (at(ring, i), at(ring, i + 1));
            let (c, d) = (at(ring + 1, i + 1), at(ring + 1, i));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        triangles.push([at(rings - 1, i), at(rings - 1, i + 1), top]);
    }
    Mesh {
        vertices,
        triangles,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Signed volume by the divergence theorem: positive only when triangles face outward.
    fn volume(mesh: &Mesh) -> f64 {
        let corner = |i: u32| nalgebra::Vector3::from(mesh.vertices[i as usize].map(f64::from));
        let six_volumes = |t: &[u32; 3]| corner(t[0]).cross(&corner(t[1])).dot(&corner(t[2]));
        mesh.triangles.iter().map(six_volumes).sum::<f64>() / 6.0
    }

    #[test]
    fn solids_are_closed_and_have_the_volume_of_their_formula() {
        let (r, l) = (0.3, 0.7);
        for (mesh, formula) in [
            (cuboid([0.1, 0.2, 0.5]), 0.01),
            (cylinder(r, l), PI * r * r * l),
            (sphere(r), 4.0 / 3.0 * PI * r.powi(3)),
            (capsule(r, l), PI * r * r * l + 4.0 / 3.0 * PI * r.powi(3)),
        ] {
            assert!((volume(&mesh) / formula - 1.0).abs() < 0.01, "{formula}");
            let mut edges: Vec<_> = (mesh.triangles.iter())
                .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
                .collect();
            let mut opposite: Vec<_> = edges.iter().map(|&(a, b)| (b, a)).collect();
            edges.sort_unstable();
            opposite.sort_unstable();
            assert_eq!(edges, opposite, "every edge has its opposite");
            assert!(edges.windows(2).all(|w| w[0] != w[1]));
        }
    }
}
