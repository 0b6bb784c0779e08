//! The background: a room of random size round the robot, with furniture at random places.
//!
//! Places are given in the *floor frame*: its origin lies on the floor below the camera, y points
//! where the camera looks, x to the right, z up.

use super::collision::any_overlap;
use super::furniture::Piece;
use super::oriented_box::OrientedBox;
use crate::random::{Stream, below, uniform};
use crate::robot::{Mesh, solids};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;

/// The size of the room: each distance (m) is drawn from a range.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoomSpec {
    /// Height of the floor in the robot's root frame, z up.
    pub floor: f64,
    /// From the camera to the wall in front of it.
    pub ahead: [f64; 2],
    /// To the walls on the left and on the right, drawn apart.
    pub aside: [f64; 2],
    /// To the wall behind.
    pub behind: [f64; 2],
    /// From floor to ceiling.
    pub height: [f64; 2],
    /// Whether walls and ceiling are moved back where they would cut through the robot.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub give_way: bool,
}

impl Default for RoomSpec {
    fn default() -> Self {
        RoomSpec {
            floor: 0.0,
            ahead: [1.8, 3.5],
            aside: [1.0, 2.6],
            behind: [1.0, 2.0],
            height: [2.4, 3.0],
            give_way: true,
        }
    }
}

/// How many pieces of each kind there are: a number drawn from a range, both ends included. A
/// piece that finds no free place is left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FurnitureSpec {
    pub closets: [usize; 2],
    pub shelves: [usize; 2],
    pub tables: [usize; 2],
    pub chairs: [usize; 2],
    /// Heaps of boxes, cylinders and balls, and limbs of things that are jointed as an arm is.
    #[serde(skip_serializing_if = "is_none")]
    pub clutter: [usize; 2],
    /// No part of any piece comes nearer to the camera than this (m).
    pub clearance: f64,
}

impl Default for FurnitureSpec {
    fn default() -> Self {
        FurnitureSpec {
            closets: [0, 1],
            shelves: [0, 1],
            tables: [0, 1],
            chairs: [0, 3],
            clutter: [0, 3],
            clearance: 0.6,
        }
    }
}

/// Sets without clutter are written as they were before there was any: their hashes stay.
fn is_none(range: &[usize; 2]) -> bool {
    *range == [0, 0]
}

/// A wall that had to give way stands at least so far behind the robot (m).
const GAP: f64 = 0.02;

/// How often a place is drawn for a piece before it is left out.
const TRIES: usize = 20;

/// The boxes of all links of the robot, in the root frame.
#[derive(Debug, Clone, Copy)]
pub enum RobotPlace<'a> {
    /// The robot stands there.
    Taken(&'a [Vec<OrientedBox>]),
    /// The robot would stand there, but something else does.
    Free(&'a [Vec<OrientedBox>]),
}

/// A room with all that stands in it but the robot.
#[derive(Debug, Clone)]
pub struct Background {
    /// In the root frame.
    pub mesh: Mesh,
    /// Whether a wall or the ceiling as drawn would have cut through the robot, and was moved back.
    pub walls_moved: bool,
}

/// Builds the room and its furniture. Furniture stands on the floor within the walls and cuts neither the
/// robot nor other furniture. In the place of an absent robot stand or hang
/// one to three pieces of clutter, unless the furniture asks for none at all.
pub fn furnish(
    room: &RoomSpec,
    furniture: &FurnitureSpec,
    root_from_camera: &Isometry3<f64>,
    place: RobotPlace,
    s: &mut Stream,
) -> Background {
    let root_from_floor = floor_frame(root_from_camera, room.floor);
    let camera = root_from_floor.inverse() * Point3::from(root_from_camera.translation.vector);
    let floor_from_root = root_from_floor.inverse();
    let to_floor = |boxes: &Vec<OrientedBox>| -> Vec<OrientedBox> {
        boxes
            .iter()
            .map(|b| b.transformed(&floor_from_root))
            .collect()
    };
    let in_floor_frame = |boxes: &[Vec<OrientedBox>]| boxes.iter().map(to_floor).collect();
    let (robot, free): (Vec<_>, Vec<_>) = match place {
        RobotPlace::Taken(boxes) => (in_floor_frame(boxes), Vec::new()),
        RobotPlace::Free(boxes) => (Vec::new(), in_floor_frame(boxes)),
    };
    let mut walls = Walls::draw(room, s);
    let walls_moved = room.give_way && walls.give_way(robot.iter().flatten());

    let mut standing = Piece::default();
    let in_the_way = |b: &OrientedBox, walls: &Walls| {
        !walls.hold(b) || b.distance(&camera) < furniture.clearance
    };
    let stand_ins: Vec<&OrientedBox> = free.iter().flatten().collect();
    if !stand_ins.is_empty() && furniture.clutter[1] > 0 {
        for _ in 0..1 + below(s, 3) {
            let piece = Piece::clutter(s);
            for _ in 0..TRIES {
                let at = stand_ins[below(s, stand_ins.len())].centre;
                let hangs = below(s, 2) == 0;
                let mut place = stand(at.x, at.y, uniform(s, -2.0, 2.0) * FRAC_PI_2);
                place.translation.z = if hangs { at.z.max(0.0) } else { 0.0 };
                let placed = piece.clone().placed(&place);
                if !placed.boxes.iter().any(|b| in_the_way(b, &walls))
                    && !any_overlap(&placed.boxes, &standing.boxes)
                {
                    standing.join(placed);
                    break;
                }
            }
        }
    }
    type Build = fn(&mut Stream) -> Piece;
    let kinds = [
        (Piece::closet as Build, true, furniture.closets),
        (Piece::shelf, true, furniture.shelves),
        (Piece::table, false, furniture.tables),
        (Piece::chair, false, furniture.chairs),
        (Piece::clutter, false, furniture.clutter),
    ];
    for (build, by_the_wall, [fewest, most]) in kinds {
        // Nothing is drawn for what there is none of: rooms without clutter stay as they were.
        let count = match most {
            0 => 0,
            _ => fewest + below(s, most.saturating_sub(fewest) + 1),
        };
        for _ in 0..count {
            let piece = build(s);
            for _ in 0..TRIES {
                let place = if by_the_wall {
                    walls.place_along(&piece, s)
                } else {
                    walls.place_free(s)
                };
                let placed = piece.clone().placed(&place);
                if !placed.boxes.iter().any(|b| in_the_way(b, &walls))
                    && !any_overlap(&placed.boxes, &standing.boxes)
                    && !robot.iter().any(|link| any_overlap(&placed.boxes, link))
                {
                    standing.join(placed);
                    break;
                }
            }
        }
    }
    let mut background = walls.mesh();
    background.append(&standing.mesh);
    Background {
        mesh: background.transformed(&root_from_floor),
        walls_moved,
    }
}

/// `root_from_floor`, see the head of this module. Where the camera looks straight up or down, the
/// upper edge of its image points ahead.
fn floor_frame(root_from_camera: &Isometry3<f64>, floor: f64) -> Isometry3<f64> {
    let flat = |direction: Vector3<f64>| Vector3::new(direction.x, direction.y, 0.0);
    let looks = flat(root_from_camera * Vector3::z());
    let ahead = if looks.norm() > 0.05 {
        looks
    } else {
        flat(root_from_camera * -Vector3::y())
    };
    let yaw = (-ahead.x).atan2(ahead.y);
    let at = root_from_camera.translation.vector;
    Isometry3::new(Vector3::new(at.x, at.y, floor), Vector3::z() * yaw)
}

/// The inside of the room, in the floor frame.
struct Walls {
    low: Point3<f64>,
    high: Point3<f64>,
}

impl Walls {
    fn draw(room: &RoomSpec, s: &mut Stream) -> Self {
        let mut draw = |[low, high]: [f64; 2]| uniform(s, low, high);
        Walls {
            low: Point3::new(-draw(room.aside), -draw(room.behind), 0.0),
            high: Point3::new(draw(room.aside), draw(room.ahead), draw(room.height)),
        }
    }

    /// Moves walls and ceiling back until the boxes lie before them, and says whether any had to move.
    /// The floor stays.
    fn give_way<'a>(&mut self, boxes: impl Iterator<Item = &'a OrientedBox>) -> bool {
        let (low, high) = (self.low, self.high);
        for corner in boxes.flat_map(OrientedBox::corners) {
            for i in 0..3 {
                if i < 2 && corner[i] < self.low[i] {
                    self.low[i] = corner[i] - GAP;
                }
                if corner[i] > self.high[i] {
                    self.high[i] = corner[i] + GAP;
                }
            }
        }
        (low, high) != (self.low, self.high)
    }

    /// Whether a box lies within the walls, to a tenth of a millimetre.
    fn hold(&self, part: &OrientedBox) -> bool {
        let inside = |corner: Point3<f64>| {
            (0..3).all(|i| self.low[i] - 1e-4 <= corner[i] && corner[i] <= self.high[i] + 1e-4)
        };
        part.corners().into_iter().all(inside)
    }

    /// Anywhere on the floor about the camera's view, facing anywhere.
    fn place_free(&self, s: &mut Stream) -> Isometry3<f64> {
        let y = uniform(s, 0.4, self.high.y);
        let aside = SEEN_AT_FEET + SEEN_ASIDE * y;
        stand(
            uniform(s, -aside, aside),
            y,
            uniform(s, -2.0, 2.0) * FRAC_PI_2,
        )
    }

    /// With its back to the wall ahead or to one aside, a little askew.
    fn place_along(&self, piece: &Piece, s: &mut Stream) -> Isometry3<f64> {
        let back = piece
            .boxes
            .iter()
            .map(|b| b.centre.y + b.half.y)
            .fold(0.0, f64::max);
        let gap = back + uniform(s, 0.04, 0.15);
        let askew = uniform(s, -0.06, 0.06);
        let along = uniform(s, 0.3, self.high.y);
        match below(s, 6) {
            0 => stand(self.low.x + gap, along, FRAC_PI_2 + askew),
            1 => stand(self.high.x - gap, along, -FRAC_PI_2 + askew),
            _ => {
                let aside = SEEN_AT_FEET + SEEN_ASIDE * self.high.y;
                stand(uniform(s, -aside, aside), self.high.y - gap, askew)
            }
        }
    }

    /// A box that is seen from inside.
    fn mesh(&self) -> Mesh {
        let size = self.high - self.low;
        let centre = nalgebra::center(&self.low, &self.high);
        let mut mesh = solids::cuboid(size.into()).transformed(&Isometry3::from(centre));
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        mesh
    }
}

/// Furniture stands where a camera of usual opening angle sees it: at most this far aside (m) at
/// the foot of the camera, and so much more for each metre ahead.
const SEEN_AT_FEET: f64 = 0.4;
const SEEN_ASIDE: f64 = 0.55;

fn stand(x: f64, y: f64, yaw: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry3::from_parts(Translation3::new(x, y, 0.0), turn)
}
