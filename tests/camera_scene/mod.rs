//! A room with boxes, balls and thin slanted rods, for the tests of the camera.

use armpose::camera::Body;
use armpose::random::{stream, uniform};
use armpose::robot::Mesh;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::f32::consts::{PI, TAU};

pub struct Thing {
    pub mesh: Mesh,
    pub camera_from_mesh: Isometry3<f64>,
}

pub fn bodies(things: &[Thing]) -> Vec<Body<'_>> {
    things
        .iter()
        .zip(1..)
        .map(|(thing, label)| Body {
            mesh: &thing.mesh,
            camera_from_mesh: thing.camera_from_mesh,
            label,
        })
        .collect()
}

/// A box around the origin; sizes are full lengths. With `inwards` it is seen from inside: a room.
pub fn cuboid(size: [f32; 3], inwards: bool) -> Mesh {
    let corner =
        |i: usize| [0, 1, 2].map(|axis| size[axis] * if i >> axis & 1 == 1 { 0.5 } else { -0.5 });
    let mut triangles = Vec::new();
    for axis in 0..3 {
        let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        for (base, outwards) in [(0, false), (1u32 << axis, true)] {
            let quad = [base, base + u, base + u + v, base + v];
            let turned = [base, base + v, base + u + v, base + u];
            let q = if outwards != inwards { quad } else { turned };
            triangles.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
        }
    }
    Mesh {
        vertices: (0..8).map(corner).collect(),
        triangles,
    }
}

/// A closed surface of revolution about z through the points (radius, z), which run from the lower
/// pole to the upper one.
fn revolved(profile: &[(f32, f32)], around: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for &(radius, z) in profile {
        mesh.vertices.extend((0..around).map(|i| {
            let angle = TAU * i as f32 / around as f32;
            [radius * angle.cos(), radius * angle.sin(), z]
        }));
    }
    for ring in 0..profile.len() as u32 - 1 {
        for i in 0..around {
            let (a, b) = (ring * around + i, ring * around + (i + 1) % around);
            mesh.triangles
                .extend([[a, b, b + around], [a, b + around, a + around]]);
        }
    }
    mesh
}

pub fn ball(radius: f32, around: u32) -> Mesh {
    let rings = around / 2;
    let point = |i| {
        let angle = PI * i as f32 / rings as f32;
        (radius * angle.sin(), -radius * angle.cos())
    };
    revolved(&(0..=rings).map(point).collect::<Vec<_>>(), around)
}

pub fn rod(radius: f32, length: f32, around: u32) -> Mesh {
    let half = length / 2.0;
    revolved(
        &[(0.0, -half), (radius, -half), (radius, half), (0.0, half)],
        around,
    )
}

/// A room with `count` balls, boxes and rods each, balls of about `around^2` triangles.
pub fn furnished_room(count: u64, around: u32) -> Vec<Thing> {
    let mut things = vec![Thing {
        mesh: cuboid([6.0, 4.0, 8.4], true),
        camera_from_mesh: Isometry3::from_parts(
            Translation3::identity(),
            UnitQuaternion::from_euler_angles(0.3, 0.2, 0.05),
        ),
    }];
    for i in 0..count {
        let mut s = stream(11, "camera scene", &[i]);
        let mut place = || {
            let z = uniform(&mut s, 0.8, 3.2);
            let turn = [0; 3].map(|_| uniform(&mut s, -3.0, 3.0));
            Isometry3::from_parts(
                Translation3::new(
                    z * uniform(&mut s, -0.5, 0.5),
                    z * uniform(&mut s, -0.38, 0.38),
                    z,
                ),
                UnitQuaternion::new(Vector3::from(turn)),
            )
        };
        things.extend([
            Thing {
                mesh: ball(0.16, around),
                camera_from_mesh: place(),
            },
            Thing {
                mesh: cuboid([0.5, 0.3, 0.2], false),
                camera_from_mesh: place(),
            },
            Thing {
                mesh: rod(0.01, 0.9, around),
                camera_from_mesh: place(),
            },
        ]);
    }
    things
}
