//! Things that are neither furniture nor robot: heaps of boxes, cylinders and balls, boards with heaps on
//! them, and limbs of things that are jointed as an arm is (lamps, stands, people).

use super::furniture::Piece;
use super::oriented_box::OrientedBox;
use crate::random::{Stream, below, uniform};
use crate::robot::{Mesh, solids};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{PI, TAU};

impl Piece {
    /// A heap, limbs, or a board with heaps on it, each as often.
    pub fn clutter(s: &mut Stream) -> Self {
        match below(s, 3) {
            0 => Self::heap(s),
            1 => Self::limbs(s),
            _ => Self::laid_board(s),
        }
    }

    /// A board of 60 to 160 cm on a foot, with up to four heaps on it.
    fn laid_board(s: &mut Stream) -> Self {
        let mut board = Piece::default();
        let (wide, deep) = (uniform(s, 0.3, 0.8), uniform(s, 0.3, 0.8));
        let top = uniform(s, 0.1, 1.0);
        let foot = [uniform(s, 0.03, 0.2), uniform(s, 0.03, 0.2), top / 2.0];
        let at = |x: f64, y: f64, z: f64| Isometry3::translation(x, y, z);
        board.put(Solid::Box(foot), &at(0.0, 0.0, top / 2.0));
        board.put(Solid::Box([wide, deep, 0.02]), &at(0.0, 0.0, top + 0.02));
        for _ in 0..below(s, 5) {
            let place = at(uniform(s, -wide, wide), uniform(s, -deep, deep), top + 0.04);
            board.join(Self::heap(s).placed(&place));
        }
        board
    }

    /// One to four solids of 4 to 35 cm, each on top of the one before.
    fn heap(s: &mut Stream) -> Self {
        let mut heap = Piece::default();
        let mut top = 0.0;
        for _ in 0..1 + below(s, 4) {
            let half = [0; 3].map(|_| uniform(s, 0.02, 0.175));
            let solid = match below(s, 3) {
                0 => Solid::Box(half),
                1 => Solid::Cylinder(half[0], half[2]),
                _ => Solid::Ball(half[0]),
            };
            let half = solid.half().z;
            let place =
                Translation3::new(uniform(s, -0.05, 0.05), uniform(s, -0.05, 0.05), top + half);
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), uniform(s, 0.0, TAU));
            heap.put(solid, &Isometry3::from_parts(place, turn));
            top += 2.0 * half;
        }
        heap
    }

    /// Two to five limbs of 10 to 45 cm end to end, the first upright, each next one bent by up to 110
    /// degrees against the one before; none reaches below the floor.
    fn limbs(s: &mut Stream) -> Self {
        let mut limbs = Piece::default();
        let (mut end, mut along) = (Point3::origin(), Vector3::z());
        for _ in 0..2 + below(s, 4) {
            let half = uniform(s, 0.05, 0.225);
            let thick = uniform(s, 0.02, 0.09).min(half);
            let solid = match below(s, 3) {
                0 => Solid::Box([thick, uniform(s, 0.5, 1.0) * thick, half]),
                1 => Solid::Cylinder(thick, half),
                _ => Solid::Capsule(thick, half),
            };
            let turn = UnitQuaternion::rotation_between(&Vector3::z(), &along)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
            let middle = end + along * half;
            limbs.put(solid, &Isometry3::from_parts(middle.coords.into(), turn));
            end += along * (2.0 * half);
            let bend = uniform(s, 0.0, 110f64.to_radians());
            let round = uniform(s, 0.0, TAU);
            let bent = Vector3::new(
                bend.sin() * round.cos(),
                bend.sin() * round.sin(),
                bend.cos(),
            );
            along = turn * bent;
            along.z = along.z.abs();
        }
        // What leans over may dip below the floor by its thickness.
        let lowest = limbs
            .mesh
            .bounds()
            .map_or(0.0, |(low, _)| f64::from(low[2]));
        limbs.placed(&Isometry3::translation(0.0, 0.0, -lowest))
    }

    /// Adds a solid, whose centre is its origin.
    fn put(&mut self, solid: Solid, place: &Isometry3<f64>) {
        let half = solid.half();
        self.boxes.push(OrientedBox {
            centre: place.translation.vector.into(),
            axes: Rotation3::from(place.rotation).into_inner(),
            half,
        });
        self.mesh.append(&solid.mesh().transformed(place));
    }
}

/// A solid about its centre, by half its sizes (m): the radius first, then half of what it measures along z.
enum Solid {
    Box([f64; 3]),
    Cylinder(f64, f64),
    Ball(f64),
    Capsule(f64, f64),
}

impl Solid {
    fn half(&self) -> Vector3<f64> {
        match *self {
            Solid::Box(half) => half.into(),
            Solid::Ball(r) => Vector3::repeat(r),
            Solid::Cylinder(r, half) | Solid::Capsule(r, half) => Vector3::new(r, r, half),
        }
    }

    fn mesh(&self) -> Mesh {
        match *self {
            Solid::Box(half) => solids::cuboid(half.map(|h| 2.0 * h)),
            Solid::Cylinder(r, half) => solids::cylinder(r, 2.0 * half),
            Solid::Ball(r) => solids::sphere(r),
            Solid::Capsule(r, half) => solids::capsule(r, 2.0 * (half - r)),
        }
    }
}
