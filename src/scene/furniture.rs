//! The furniture that stands about in the background: chairs, tables, closets and shelves of
//! random size, made of boxes and cylinders.

use super::oriented_box::OrientedBox;
use crate::random::{Stream, below, uniform};
use crate::robot::{Mesh, solids};
use nalgebra::{Isometry3, Vector3};

/// A piece of furniture in its own frame: it stands on z = 0 about the origin, z is up, and its
/// front is towards -y. Metres.
#[derive(Debug, Clone, Default)]
pub struct Piece {
    /// Closed parts, triangles counter-clockwise seen from outside.
    pub mesh: Mesh,
    /// One box round each part.
    pub boxes: Vec<OrientedBox>,
}

impl Piece {
    /// A seat on four legs, and two posts that carry a back.
    pub fn chair(s: &mut Stream) -> Self {
        let (w, d) = (uniform(s, 0.19, 0.24), uniform(s, 0.19, 0.24));
        let seat = uniform(s, 0.42, 0.48);
        let thick = uniform(s, 0.03, 0.06);
        let leg = uniform(s, 0.018, 0.028);
        let top = seat + uniform(s, 0.38, 0.52);
        let back = uniform(s, 0.08, 0.2);

        let mut chair = Piece::default();
        chair.block([-w, w], [-d, d], [seat - thick, seat]);
        for x in [-w + leg, w - leg] {
            chair.post(x, -d + leg, leg, [0.0, seat - thick]);
            chair.post(x, d - leg, leg, [0.0, seat - thick]);
            chair.post(x, d - leg, leg, [seat, top]);
        }
        chair.block([-w, w], [d - 1.5 * leg, d - 0.5 * leg], [seat + back, top]);
        chair
    }

    /// A top on four legs.
    pub fn table(s: &mut Stream) -> Self {
        let (w, d) = (uniform(s, 0.4, 0.8), uniform(s, 0.3, 0.45));
        let top = uniform(s, 0.70, 0.78);
        let thick = uniform(s, 0.025, 0.05);
        let leg = uniform(s, 0.02, 0.04);
        let inset = leg + uniform(s, 0.0, 0.06);

        let mut table = Piece::default();
        table.block([-w, w], [-d, d], [top - thick, top]);
        for x in [-w + inset, w - inset] {
            for y in [-d + inset, d - inset] {
                table.post(x, y, leg, [0.0, top - thick]);
            }
        }
        table
    }

    /// An open carcass with boards inside, behind two doors with handles; one door stands open.
    pub fn closet(s: &mut Stream) -> Self {
        let (w, d) = (uniform(s, 0.3, 0.45), uniform(s, 0.19, 0.26));
        let height = uniform(s, 1.4, 2.0);
        let boards = 3 + below(s, 2);
        let mut closet = Self::carcass(w, d, height, boards);

        let gap = 0.008;
        let thick = 0.022;
        let open = [0.0, 0.0, uniform(s, 0.1, 0.9)];
        let first_open = below(s, 2);
        for (door, side) in [-1.0, 1.0].into_iter().enumerate() {
            // A door is built about its hinge, a corner of the front, and then turned outward.
            let angle = open[if door == first_open { 2 } else { 0 }];
            let hinge = Isometry3::new(
                Vector3::new(side * w, -d, 0.0),
                Vector3::z() * (side * angle),
            );
            let across = |from: f64, to: f64| {
                let (a, b) = (-side * from, -side * to);
                [a.min(b), a.max(b)]
            };
            let mut panel = Piece::default();
            panel.block(across(gap, w - gap), [-thick, 0.0], [0.09, height - gap]);
            let handle = uniform(s, 0.5, 0.7);
            let at = across(w - 0.09, w - 0.06);
            panel.block(at, [-thick - 0.045, -thick], [handle, handle + 0.25]);
            closet.join(panel.placed(&hinge));
        }
        closet
    }

    /// A carcass without doors, with books and boxes on its boards.
    pub fn shelf(s: &mut Stream) -> Self {
        let (w, d) = (uniform(s, 0.35, 0.6), uniform(s, 0.13, 0.2));
        let height = uniform(s, 0.9, 1.9);
        let boards = 2 + (height / 0.4) as usize;
        let mut shelf = Self::carcass(w, d, height, boards);
        let rise = (height - BOTTOM) / (boards - 1) as f64;
        for board in 0..boards - 1 {
            let bottom = BOTTOM + board as f64 * rise + BOARD;
            let room = rise - 2.0 * BOARD;
            let mut x = -w + BOARD;
            loop {
                // Books stand in rows, boxes alone, and some of the board stays free.
                x += if below(s, 4) == 0 {
                    uniform(s, 0.05, 0.3)
                } else {
                    0.003
                };
                let book = below(s, 6) > 0;
                let wide = if book {
                    uniform(s, 0.02, 0.06)
                } else {
                    uniform(s, 0.12, 0.3)
                };
                if x + wide > w - BOARD {
                    break;
                }
                let tall = room * uniform(s, 0.5, 0.95);
                let front = -d + uniform(s, 0.01, 0.08);
                shelf.block([x, x + wide], [front, d - BOARD], [bottom, bottom + tall]);
                x += wide;
            }
        }
        shelf
    }

    /// Two sides, a back, a plinth, and boards at equal heights from bottom to top.
    fn carcass(w: f64, d: f64, height: f64, boards: usize) -> Self {
        let mut carcass = Piece::default();
        carcass.block([-w, -w + BOARD], [-d, d], [0.0, height]);
        carcass.block([w - BOARD, w], [-d, d], [0.0, height]);
        let inside = [-w + BOARD, w - BOARD];
        carcass.block(inside, [d - BOARD, d], [0.0, height]);
        carcass.block(inside, [-d + 0.04, -d + 0.06], [0.0, BOTTOM]);
        for board in 0..boards {
            let z = BOTTOM + (height - BOTTOM - BOARD) * board as f64 / (boards - 1) as f64;
            carcass.block(inside, [-d, d - BOARD], [z, z + BOARD]);
        }
        carcass
    }

    fn block(&mut self, x: [f64; 2], y: [f64; 2], z: [f64; 2]) {
        let size = [x, y, z].map(|[low, high]| high - low);
        self.add(solids::cuboid(size), [x, y, z]);
    }

    /// An upright cylinder.
    fn post(&mut self, x: f64, y: f64, radius: f64, z: [f64; 2]) {
        let post = solids::cylinder(radius, z[1] - z[0]);
        self.add(
            post,
            [[x - radius, x + radius], [y - radius, y + radius], z],
        );
    }

    /// Adds a part that is given about its own centre and shall fill `bounds`.
    fn add(&mut self, part: Mesh, bounds: [[f64; 2]; 3]) {
        let block = OrientedBox::from_bounds(bounds.map(|b| b[0]), bounds.map(|b| b[1]));
        let place = Isometry3::from(block.centre);
        self.mesh.append(&part.transformed(&place));
        self.boxes.push(block);
    }

    /// Adds the parts of another piece that is given in the same frame.
    pub fn join(&mut self, other: Piece) {
        self.mesh.append(&other.mesh);
        self.boxes.extend(other.boxes);
    }

    /// The piece given in frame a, where it stands at `a_from_piece`.
    pub fn placed(self, a_from_piece: &Isometry3<f64>) -> Self {
        let boxes = self.boxes.iter().map(|b| b.transformed(a_from_piece));
        Piece {
            boxes: boxes.collect(),
            mesh: self.mesh.transformed(a_from_piece),
        }
    }
}

/// Thickness of the boards of closets and shelves.
const BOARD: f64 = 0.02;
/// Height of their lowest board.
const BOTTOM: f64 = 0.08;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::stream;
    use nalgebra::Point3;
    use std::collections::BTreeSet;

    fn pieces() -> Vec<Piece> {
        let kinds = [Piece::chair, Piece::table, Piece::closet, Piece::shelf];
        let many = (0..20).map(|i| stream(i, "furniture test", &[]));
        many.flat_map(|mut s| kinds.map(|build| build(&mut s)))
            .collect()
    }

    #[test]
    fn parts_are_closed_and_face_outward() {
        for piece in pieces() {
            let parts = piece.mesh.components();
            assert!(parts.len() > 4);
            for part in parts {
                let corners = |t: &[u32; 3]| t.map(|v| Vector3::from(part.vertices[v as usize]));
                let volume = |[a, b, c]: [Vector3<f32>; 3]| a.cross(&b).dot(&c) / 6.0;
                let volume: f32 = part.triangles.iter().map(|t| volume(corners(t))).sum();
                assert!(volume > 0.0);
                let edges = |&[a, b, c]: &[u32; 3]| [(a, b), (b, c), (c, a)];
                let edges: Vec<_> = part.triangles.iter().flat_map(edges).collect();
                let distinct: BTreeSet<_> = edges.iter().copied().collect();
                // Where boards touch along an edge the welded parts share it, in pairs.
                assert!(distinct.iter().all(|&(a, b)| distinct.contains(&(b, a))));
            }
        }
    }

    #[test]
    fn pieces_stand_on_the_floor_within_their_boxes() {
        for piece in pieces() {
            let vertices = || {
                piece
                    .mesh
                    .vertices
                    .iter()
                    .map(|v| Point3::from(v.map(f64::from)))
            };
            let lowest = vertices().map(|v| v.z).fold(f64::INFINITY, f64::min);
            assert!(lowest.abs() < 1e-6, "{lowest}");
            let covered = |v: Point3<f64>| piece.boxes.iter().any(|b| b.distance(&v) < 1e-5);
            assert!(vertices().all(covered));
        }
    }
}
