//! Triangle meshes.

use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::HashMap;

/// A triangle mesh, metres. Triangles are counter-clockwise seen from outside.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    pub vertices: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Whether there is no surface.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The least and greatest coordinates of the vertices; `None` without vertices.
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        let first = *self.vertices.first()?;
        let grow = |(low, high): ([f32; 3], [f32; 3]), v: &[f32; 3]| {
            (
                std::array::from_fn(|i| low[i].min(v[i])),
                std::array::from_fn(|i| high[i].max(v[i])),
            )
        };
        Some(self.vertices.iter().fold((first, first), grow))
    }

    /// The sum of the triangles' areas, m2.
    pub fn area(&self) -> f64 {
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| Vector3::from(self.vertices[i as usize].map(f64::from)));
            (b - a).cross(&(c - a)).norm() / 2.0
        };
        self.triangles.iter().map(area).sum()
    }

    /// Adds the triangles of `other`.
    pub fn append(&mut self, other: &Mesh) {
        let start = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        let shifted = other.triangles.iter().map(|t| t.map(|i| i + start));
        self.triangles.extend(shifted);
    }

    /// The same mesh in frame a, given in frame b.
    pub fn transformed(mut self, a_from_b: &Isometry3<f64>) -> Mesh {
        for v in &mut self.vertices {
            let moved = a_from_b * Point3::from(v.map(f64::from));
            *v = [moved.x as f32, moved.y as f32, moved.z as f32];
        }
        self
    }

    /// The same surface with every position stored once, in the order of first use. Triangles that
    /// name one position twice have no area and are left out.
    pub fn welded(&self) -> Mesh {
        weld(&self.vertices, &self.triangles)
    }

    /// The connected pieces: triangles that share a vertex position belong together. Pieces stand
    /// in the order of their first triangles and are welded.
    pub fn components(&self) -> Vec<Mesh> {
        let whole = self.welded();
        // A forest of vertices in which every tree is one piece.
        let mut parent: Vec<u32> = (0..whole.vertices.len() as u32).collect();
        fn find(parent: &mut [u32], mut i: u32) -> u32 {
            while parent[i as usize] != i {
                let above = parent[parent[i as usize] as usize];
                parent[i as usize] = above;
                i = above;
            }
            i
        }
        for &[a, b, c] in &whole.triangles {
            for other in [b, c] {
                let (from, to) = (find(&mut parent, other), find(&mut parent, a));
                parent[from as usize] = to;
            }
        }
        let mut pieces: Vec<Vec<[u32; 3]>> = Vec::new();
        let mut piece_of_root = HashMap::new();
        for triangle in &whole.triangles {
            let root = find(&mut parent, triangle[0]);
            let piece = *piece_of_root.entry(root).or_insert_with(|| {
                pieces.push(Vec::new());
                pieces.len() - 1
            });
            pieces[piece].push(*triangle);
        }
        let piece = |triangles: &Vec<_>| weld(&whole.vertices, triangles);
        pieces.iter().map(piece).collect()
    }
}

/// The vertices that the triangles use, each position once.
fn weld(vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> Mesh {
    let mut place = HashMap::new();
    let mut welded = Mesh::default();
    for triangle in triangles {
        let corners = triangle.map(|i| {
            let v = vertices[i as usize];
            // Adding zero makes -0 and 0 one position.
            let position = v.map(|x| (x + 0.0).to_bits());
            *place.entry(position).or_insert_with(|| {
                welded.vertices.push(v);
                welded.vertices.len() as u32 - 1
            })
        });
        let [a, b, c] = corners;
        if a != b && b != c && c != a {
            welded.triangles.push(corners);
        }
    }
    welded
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::solids;

    #[test]
    fn components_of_touching_and_separate_boxes() {
        let mut mesh = solids::cuboid([1.0, 1.0, 1.0]);
        let away = Isometry3::translation(5.0, 0.0, 0.0);
        let touching_at_a_corner = Isometry3::translation(1.0, 1.0, 1.0);
        mesh.append(&solids::cuboid([1.0; 3]).transformed(&away));
        mesh.append(&solids::cuboid([1.0; 3]).transformed(&touching_at_a_corner));
        let pieces = mesh.components();
        let sizes: Vec<_> = pieces
            .iter()
            .map(|p| (p.vertices.len(), p.triangles.len()))
            .collect();
        assert_eq!(sizes, [(15, 24), (8, 12)]);
        assert_eq!(
            pieces[1].bounds(),
            Some(([4.5, -0.5, -0.5], [5.5, 0.5, 0.5]))
        );
    }

    #[test]
    fn welding_a_triangle_soup_gives_the_mesh_back() {
        let ball = solids::sphere(0.3);
        let mut soup = Mesh::default();
        for t in &ball.triangles {
            let start = soup.vertices.len() as u32;
            soup.vertices.extend(t.map(|i| ball.vertices[i as usize]));
            soup.triangles.push([start, start + 1, start + 2]);
        }
        let welded = soup.welded();
        assert_eq!(welded.vertices.len(), ball.vertices.len());
        assert_eq!(welded.triangles.len(), ball.triangles.len());
        assert_eq!(welded.components().len(), 1);
    }
}
