//! The bodies of the links of a URDF file.

use super::packages::Finder;
use super::urdf::{UrdfProblem, name_of, pose, values};
use super::xml::{child, children};
use super::{Mesh, mesh_file, solids};
use roxmltree::Node;
use std::collections::BTreeSet;

/// No body of an arm is larger than this (m); those that are have another unit.
const MAX_EXTENT: f64 = 20.0;
/// Shapes thinner than this (m) stand for no body.
const MIN_SIZE: f64 = 1e-6;
/// The most triangles of a robot.
const MAX_TRIANGLES: usize = 8_000_000;

/// Reads one link after the other.
pub struct Bodies<'a, 'p> {
    finder: &'a mut Finder<'p>,
    /// What was read, shape by shape.
    pub shapes: Vec<Shape>,
    pub notes: Vec<String>,
    /// The COLLADA files whose up axis is not z.
    turned: BTreeSet<String>,
    triangles: usize,
}

/// A shape of a link.
pub struct Shape {
    pub link: String,
    /// The longest edge of its bounding box, m.
    pub extent: f64,
    /// The name of its mesh file, where nothing says in which unit that is.
    pub unsure: Option<String>,
}

impl<'a, 'p> Bodies<'a, 'p> {
    pub fn new(finder: &'a mut Finder<'p>) -> Self {
        Bodies {
            finder,
            shapes: Vec::new(),
            notes: Vec::new(),
            turned: BTreeSet::new(),
            triangles: 0,
        }
    }

    /// The visuals of a link as one mesh; its collision shapes if it has none, or one that cannot be
    /// read.
    pub fn read(&mut self, link: Node) -> Result<Mesh, UrdfProblem> {
        let name = name_of(link)?;
        let visuals: Vec<Node> = children(link, "visual").collect();
        let collisions: Vec<Node> = children(link, "collision").collect();
        if visuals.is_empty() {
            return self.merged(name, &collisions);
        }
        let known = (self.shapes.len(), self.notes.len());
        let problem = match self.merged(name, &visuals) {
            Err(problem @ (UrdfProblem::Mesh { .. } | UrdfProblem::Geometry { .. })) => problem,
            read => return read,
        };
        self.shapes.truncate(known.0);
        self.notes.truncate(known.1);
        match self.merged(name, &collisions) {
            Ok(mesh) if !mesh.is_empty() => {
                self.notes
                    .push(format!("{problem}; its collision shape stands in"));
                Ok(mesh)
            }
            _ => Err(problem),
        }
    }

    /// What all links have in common to remark.
    pub fn finish(mut self) -> (Vec<Shape>, Vec<String>) {
        if let Some(mesh) = self.turned.first() {
            self.notes.push(format!(
                "{} COLLADA file(s), such as \"{mesh}\", say that up is not z: their coordinates are taken \
                 as they are, as in RViz and Gazebo",
                self.turned.len()
            ));
        }
        (self.shapes, self.notes)
    }

    fn merged(&mut self, link: &str, elements: &[Node]) -> Result<Mesh, UrdfProblem> {
        let mut merged = Mesh::default();
        for element in elements {
            let Some(mesh) = self.shape(link, *element)? else {
                continue;
            };
            merged.append(&mesh);
        }
        self.triangles += merged.triangles.len();
        if self.triangles > MAX_TRIANGLES {
            return Err(UrdfProblem::TooMany {
                what: "triangles",
                most: MAX_TRIANGLES,
            });
        }
        Ok(merged)
    }

    /// The mesh of a visual or collision shape, in the link's frame; `None` if it has no size.
    fn shape(&mut self, link: &str, element: Node) -> Result<Option<Mesh>, UrdfProblem> {
        let what = format!("a body of link \"{link}\"");
        let geometry = child(element, "geometry");
        let geometry = geometry.and_then(|g| g.children().find(Node::is_element));
        let Some(geometry) = geometry else {
            self.notes
                .push(format!("{what} has no geometry: it is left out"));
            return Ok(None);
        };
        let kind = geometry.tag_name().name();
        // Negative sizes are mistakes. Sizes of zero stand for no body.
        let sizes = |names: &[&str]| -> Result<Vec<f64>, UrdfProblem> {
            let size = |name: &&str| match values(geometry, name, &what)? {
                Some([size]) if size >= 0.0 => Ok(size),
                Some(_) => Err(UrdfProblem::Size { what: what.clone() }),
                None => Err(UrdfProblem::NoAttribute {
                    what: what.clone(),
                    attribute: (*name).to_owned(),
                }),
            };
            names.iter().map(size).collect()
        };
        let mut unsure = None;
        let mut advice = "check its size, which is in metres".to_owned();
        let mesh = match kind {
            "box" => {
                let size: [f64; 3] =
                    values(geometry, "size", &what)?.ok_or_else(|| UrdfProblem::NoAttribute {
                        what: what.clone(),
                        attribute: "size".to_owned(),
                    })?;
                if size.iter().any(|&x| x < 0.0) {
                    return Err(UrdfProblem::Size { what });
                }
                has_size(&size).then(|| solids::cuboid(size))
            }
            "cylinder" => {
                let sizes = sizes(&["radius", "length"])?;
                has_size(&sizes).then(|| solids::cylinder(sizes[0], sizes[1]))
            }
            "capsule" => {
                let sizes = sizes(&["radius", "length"])?;
                has_size(&sizes[..1]).then(|| solids::capsule(sizes[0], sizes[1]))
            }
            "sphere" => {
                let sizes = sizes(&["radius"])?;
                has_size(&sizes).then(|| solids::sphere(sizes[0]))
            }
            "mesh" => {
                let name = geometry.attribute("filename").unwrap_or("");
                let scale = values(geometry, "scale", &what)?;
                let file = self
                    .finder
                    .find(name)
                    .and_then(|path| mesh_file::read(&path));
                let file = file.map_err(|why| UrdfProblem::Mesh {
                    link: link.to_owned(),
                    mesh: name.chars().take(300).collect(),
                    why,
                })?;
                if file.up_axis.is_some() {
                    self.turned.insert(name.to_owned());
                }
                let scale = scale.unwrap_or([1.0; 3]);
                advice = match (file.in_metres, scale == [1.0; 3]) {
                    (true, _) => "look at its mesh and scale; the file says its unit",
                    (_, true) => {
                        "if its mesh file is in millimetres, give it a scale: <mesh filename=\"...\" \
                         scale=\"0.001 0.001 0.001\"/>"
                    }
                    (_, false) => "check the scale of its mesh",
                }
                .to_owned();
                unsure = (!file.in_metres && scale == [1.0; 3]).then(|| name.to_owned());
                (!scale.contains(&0.0)).then(|| scaled(file.mesh, scale))
            }
            _ => {
                return Err(UrdfProblem::Geometry {
                    link: link.to_owned(),
                    kind: kind.chars().take(40).collect(),
                });
            }
        };
        let Some(mesh) = mesh else {
            self.notes
                .push(format!("{what}, a {kind}, has a size of 0: it is no body"));
            return Ok(None);
        };
        let (low, high) = mesh.bounds().unwrap_or_default();
        let edges = [0, 1, 2].map(|i| f64::from(high[i] - low[i]));
        let extent = edges.into_iter().fold(0.0, f64::max);
        if extent.is_nan() || extent > MAX_EXTENT {
            return Err(UrdfProblem::TooLarge {
                link: link.to_owned(),
                size: edges.map(|x| format!("{x:.1}")).join(" x "),
                advice,
            });
        }
        self.shapes.push(Shape {
            link: link.to_owned(),
            extent,
            unsure,
        });
        Ok(Some(mesh.transformed(&pose(element, &what)?)))
    }
}

fn has_size(sizes: &[f64]) -> bool {
    sizes.iter().all(|&size| size >= MIN_SIZE)
}

fn scaled(mut mesh: Mesh, scale: [f64; 3]) -> Mesh {
    for v in &mut mesh.vertices {
        *v = std::array::from_fn(|i| (f64::from(v[i]) * scale[i]) as f32);
    }
    // A mirrored mesh is inside out until its triangles are turned round.
    if scale.iter().product::<f64>() < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    mesh
}
