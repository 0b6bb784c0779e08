//! COLLADA: the triangles of the geometry that its scene instances, each instance where the nodes
//! above it put it.
//!
//! The asset's unit counts, its up axis does not: coordinates are used as they are, as RViz, MoveIt and
//! Gazebo do. Robots are made to look right in these, and many files say Y_UP, which is what some
//! exporters write whatever the mesh.

mod geometry;
mod transform;

use super::{MAX_TRIANGLES, MeshFile};
use crate::robot::Mesh;
use crate::robot::xml::{self, child, children};
use nalgebra::{Matrix4, Point3};
use roxmltree::Node;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::str::FromStr;

/// The most nodes of a scene, instances counted each time, and how deep they may nest.
const MAX_INSTANCES: usize = 100_000;
const MAX_DEPTH: usize = 100;

/// Reads the text of a COLLADA file.
pub fn read(text: String) -> Result<MeshFile, String> {
    xml::read(text, |root| {
        if root.tag_name().name() != "COLLADA" {
            return Err("it is no COLLADA file".to_owned());
        }
        let asset = child(root, "asset");
        let of_asset = |name| child(asset?, name);
        let meter = of_asset("unit").and_then(|unit| unit.attribute("meter"));
        let unit: f64 = meter
            .map_or(Some(1.0), |text| text.trim().parse().ok())
            .unwrap_or(0.0);
        if !(1e-9..=1e9).contains(&unit) {
            return Err(format!(
                "its unit of {} m is none",
                shown(meter.unwrap_or(""))
            ));
        }
        let up_axis = of_asset("up_axis").and_then(|axis| axis.text());
        let up_axis = up_axis.map(|axis| shown(axis.trim()));
        Ok(MeshFile {
            mesh: Scene::of(root).draw(Matrix4::new_scaling(unit))?,
            in_metres: true,
            up_axis: up_axis.filter(|axis| axis != "Z_UP"),
        })
    })?
}

/// The start of a text, for messages.
fn shown(text: &str) -> String {
    text.chars().take(40).collect()
}

/// The numbers that an element holds.
fn numbers<'a, T: FromStr>(element: Node<'a, '_>) -> Result<Vec<T>, String> {
    let texts = element.children().filter(Node::is_text);
    let texts = texts.filter_map(|child| child.text());
    let words = texts.flat_map(str::split_ascii_whitespace);
    let number = |word: &str| {
        let name = element.tag_name().name();
        let wrong = || {
            format!(
                "<{name}> holds \"{}\", which is no number that fits",
                shown(word)
            )
        };
        word.parse().map_err(|_| wrong())
    };
    words.map(number).collect()
}

/// Elements by tag and id; the first of those that share both.
type ById<'a, 'i> = BTreeMap<(&'a str, &'a str), Node<'a, 'i>>;

fn by_id<'a, 'i>(above: Node<'a, 'i>) -> ById<'a, 'i> {
    let mut by_id = BTreeMap::new();
    for node in above.descendants() {
        if let Some(id) = node.attribute("id") {
            by_id.entry((node.tag_name().name(), id)).or_insert(node);
        }
    }
    by_id
}

/// The element of the tag `tag` that an attribute such as `url="#id"` refers to.
fn referred<'a, 'i>(
    ids: &[&ById<'a, 'i>],
    element: Node<'a, 'i>,
    attribute: &str,
    tag: &str,
) -> Result<Node<'a, 'i>, String> {
    let name = element.tag_name().name();
    let url = element.attribute(attribute).unwrap_or("");
    let id = url.trim().strip_prefix('#').ok_or_else(|| {
        format!(
            "<{name}> refers to \"{}\", which is not in the same file",
            shown(url)
        )
    })?;
    let found = ids.iter().find_map(|ids| ids.get(&(tag, id))).copied();
    found.ok_or_else(|| {
        format!(
            "<{name}> refers to a <{tag}> \"{}\" that does not exist",
            shown(id)
        )
    })
}

struct Scene<'a, 'i> {
    root: Node<'a, 'i>,
    by_id: ById<'a, 'i>,
    /// The geometries read so far, by the number of their element.
    meshes: BTreeMap<u32, Rc<Mesh>>,
    drawn: Mesh,
    instances: usize,
}

impl<'a, 'i> Scene<'a, 'i> {
    fn of(root: Node<'a, 'i>) -> Self {
        Scene {
            root,
            by_id: by_id(root),
            meshes: BTreeMap::new(),
            drawn: Mesh::default(),
            instances: 0,
        }
    }

    fn draw(mut self, metres: Matrix4<f64>) -> Result<Mesh, String> {
        let instance = child(self.root, "scene").and_then(|s| child(s, "instance_visual_scene"));
        let scene = match instance {
            Some(instance) => referred(&[&self.by_id], instance, "url", "visual_scene")?,
            // Some exporters write one scene and forget to say that it is the one.
            None => child(self.root, "library_visual_scenes")
                .and_then(|library| child(library, "visual_scene"))
                .ok_or("it has no scene")?,
        };
        for node in children(scene, "node") {
            self.draw_node(node, &metres, &mut Vec::new())?;
        }
        Ok(self.drawn)
    }

    /// Draws what a node instances; `above` are the nodes that it stands in.
    fn draw_node(
        &mut self,
        node: Node<'a, 'i>,
        parent: &Matrix4<f64>,
        above: &mut Vec<Node<'a, 'i>>,
    ) -> Result<(), String> {
        self.instances += 1;
        if self.instances > MAX_INSTANCES || above.len() > MAX_DEPTH {
            return Err("its scene has too many nodes".to_owned());
        }
        if above.contains(&node) {
            let id = shown(node.attribute("id").unwrap_or(""));
            return Err(format!("its node \"{id}\" instances itself"));
        }
        above.push(node);
        let mut matrix = *parent;
        for element in node.children() {
            if let Some(transform) = transform::read(element)? {
                matrix *= transform;
            }
        }
        for element in node.children() {
            match element.tag_name().name() {
                "node" => self.draw_node(element, &matrix, above)?,
                "instance_node" => {
                    let instanced = referred(&[&self.by_id], element, "url", "node")?;
                    self.draw_node(instanced, &matrix, above)?;
                }
                "instance_geometry" => {
                    let geometry = referred(&[&self.by_id], element, "url", "geometry")?;
                    self.draw_geometry(geometry, &matrix)?;
                }
                "instance_controller" => self.draw_controller(element, &matrix)?,
                _ => {}
            }
        }
        above.pop();
        Ok(())
    }

    /// Draws the geometry that a skin or a morph deforms, in the shape that it is given in.
    fn draw_controller(
        &mut self,
        instance: Node<'a, 'i>,
        matrix: &Matrix4<f64>,
    ) -> Result<(), String> {
        let mut matrix = *matrix;
        let mut controller = referred(&[&self.by_id], instance, "url", "controller")?;
        for _ in 0..MAX_DEPTH {
            let skin = child(controller, "skin");
            let deformed = skin.or_else(|| child(controller, "morph"));
            let deformed = deformed.ok_or("its controller is neither a skin nor a morph")?;
            if let Some(shape) = skin.and_then(|skin| child(skin, "bind_shape_matrix")) {
                matrix *= transform::affine(shape)?;
            }
            match referred(&[&self.by_id], deformed, "source", "geometry") {
                Ok(geometry) => return self.draw_geometry(geometry, &matrix),
                Err(_) => controller = referred(&[&self.by_id], deformed, "source", "controller")?,
            }
        }
        Err("its controllers deform each other".to_owned())
    }

    fn draw_geometry(
        &mut self,
        geometry: Node<'a, 'i>,
        matrix: &Matrix4<f64>,
    ) -> Result<(), String> {
        self.instances += 1;
        let mesh = match self.meshes.get(&geometry.id().get()) {
            Some(mesh) => mesh.clone(),
            None => {
                let mesh = Rc::new(geometry::read(geometry, &self.by_id).map_err(|why| {
                    let id = shown(geometry.attribute("id").unwrap_or(""));
                    format!("its geometry \"{id}\": {why}")
                })?);
                self.meshes.insert(geometry.id().get(), mesh.clone());
                mesh
            }
        };
        if self.drawn.triangles.len() + mesh.triangles.len() > MAX_TRIANGLES {
            return Err(format!(
                "it draws more than {MAX_TRIANGLES} triangles; simplify it"
            ));
        }
        let start = self.drawn.vertices.len() as u32;
        let moved = mesh.vertices.iter().map(|v| {
            let moved = matrix.transform_point(&Point3::from(v.map(f64::from)));
            [moved.x as f32, moved.y as f32, moved.z as f32]
        });
        self.drawn.vertices.extend(moved);
        // A mirrored mesh is inside out until its triangles are turned round.
        let mirrored = matrix.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        let triangles = mesh.triangles.iter().map(|&[a, b, c]| match mirrored {
            true => [a, c, b],
            false => [a, b, c],
        });
        let triangles = triangles.map(|t| t.map(|i| i + start));
        self.drawn.triangles.extend(triangles);
        Ok(())
    }
}
