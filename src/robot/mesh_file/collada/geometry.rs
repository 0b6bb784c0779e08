//! The polygons of one geometry, in its own coordinates.

use super::{ById, by_id, numbers, referred};
use crate::robot::Mesh;
use crate::robot::mesh_file::surface::Surface;
use crate::robot::xml::{child, children};
use roxmltree::Node;
use std::collections::btree_map::{BTreeMap, Entry};

/// The most numbers that one corner of a polygon may take in an index list.
const MAX_STRIDE: usize = 1000;

/// Reads a `<geometry>`; lines and splines are no surface. `elsewhere` are the ids of the whole file.
pub fn read<'a, 'i>(geometry: Node<'a, 'i>, elsewhere: &ById<'a, 'i>) -> Result<Mesh, String> {
    let mesh = child(geometry, "mesh").or_else(|| child(geometry, "convex_mesh"));
    let Some(mesh) = mesh else {
        return match child(geometry, "spline") {
            Some(_) => Ok(Mesh::default()),
            None => Err("it has no <mesh>".to_owned()),
        };
    };
    // Ids within the mesh come first: some exporters use the same ones in every mesh.
    let within = by_id(mesh);
    let ids = [&within, elsewhere];
    let mut surfaces = BTreeMap::new();
    for primitive in mesh.children() {
        let kind = primitive.tag_name().name();
        if !["triangles", "polylist", "polygons", "tristrips", "trifans"].contains(&kind) {
            continue;
        }
        let failed = |why: String| format!("<{kind}>: {why}");
        let (source, corners) = Corners::of(primitive, &ids).map_err(failed)?;
        let surface = match surfaces.entry(source.id().get()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(Surface::over(points(source, &ids)?)),
        };
        add(primitive, &corners, surface).map_err(failed)?;
    }
    let mut whole = Mesh::default();
    for surface in surfaces.into_values() {
        whole.append(&surface.into_mesh());
    }
    Ok(whole)
}

/// How a primitive's lists of indices are read.
struct Corners {
    stride: usize,
    offset: usize,
}

impl Corners {
    /// And the source of the points.
    fn of<'a, 'i>(
        primitive: Node<'a, 'i>,
        ids: &[&ById<'a, 'i>],
    ) -> Result<(Node<'a, 'i>, Corners), String> {
        let mut stride = 1;
        let mut found = None;
        for input in children(primitive, "input") {
            let offset = number(input, "offset", 0)?;
            if offset >= MAX_STRIDE {
                return Err(format!("it has an input at offset {offset}"));
            }
            stride = stride.max(offset + 1);
            match input.attribute("semantic") {
                Some("VERTEX") => {
                    let vertices = referred(ids, input, "source", "vertices")?;
                    let is_position = |i: &Node| i.attribute("semantic") == Some("POSITION");
                    let position = children(vertices, "input").find(is_position);
                    let position = position.ok_or("its <vertices> have no positions")?;
                    found = Some((position, offset));
                }
                Some("POSITION") if found.is_none() => found = Some((input, offset)),
                _ => {}
            }
        }
        let (input, offset) = found.ok_or("it has no vertices")?;
        let source = referred(ids, input, "source", "source")?;
        Ok((source, Corners { stride, offset }))
    }

    /// The points that an element lists.
    fn listed(&self, element: Node) -> Result<Vec<u32>, String> {
        let numbers: Vec<u32> = numbers(element)?;
        if !numbers.len().is_multiple_of(self.stride) {
            return Err("its list of indices is cut off".to_owned());
        }
        let corners = numbers.chunks_exact(self.stride).map(|c| c[self.offset]);
        Ok(corners.collect())
    }

    /// The corners that all lists of a primitive name together.
    fn all(&self, primitive: Node) -> Result<Vec<u32>, String> {
        let mut all = Vec::new();
        for list in children(primitive, "p") {
            all.append(&mut self.listed(list)?);
        }
        Ok(all)
    }
}

/// Adds the polygons of a primitive.
fn add(primitive: Node, corners: &Corners, surface: &mut Surface) -> Result<(), String> {
    let mut listed = 0;
    match primitive.tag_name().name() {
        "polylist" => {
            let mut rest = &corners.all(primitive)?[..];
            let sizes = child(primitive, "vcount").map_or(Ok(Vec::new()), numbers::<usize>)?;
            for size in sizes {
                let cut = "its polygons have more corners than it lists";
                let (polygon, others) = rest.split_at_checked(size).ok_or(cut)?;
                surface.polygon(polygon)?;
                rest = others;
                listed += 1;
            }
        }
        "triangles" => {
            let corners = corners.all(primitive)?;
            if !corners.len().is_multiple_of(3) {
                return Err("its list of indices is cut off".to_owned());
            }
            for triangle in corners.as_chunks::<3>().0 {
                surface.polygon(triangle)?;
                listed += 1;
            }
        }
        kind => {
            // A polygon with holes lists its outline first.
            let outlines =
                primitive
                    .children()
                    .filter_map(|element| match element.tag_name().name() {
                        "p" => Some(element),
                        "ph" => child(element, "p"),
                        _ => None,
                    });
            for outline in outlines {
                let corners = corners.listed(outline)?;
                listed += 1;
                match kind {
                    "tristrips" => {
                        for (i, window) in corners.windows(3).enumerate() {
                            let &[a, b, c] = window else { continue };
                            surface.polygon(&if i % 2 == 0 { [a, b, c] } else { [a, c, b] })?;
                        }
                    }
                    "trifans" => {
                        for window in corners.windows(2).skip(1) {
                            surface.polygon(&[corners[0], window[0], window[1]])?;
                        }
                    }
                    _ => surface.polygon(&corners)?,
                }
            }
        }
    }
    let count = number(primitive, "count", listed)?;
    if count > listed {
        return Err(format!(
            "it says that it has {count} of them, but lists {listed}"
        ));
    }
    Ok(())
}

/// The points of a `<source>`.
fn points<'a, 'i>(source: Node<'a, 'i>, ids: &[&ById<'a, 'i>]) -> Result<Vec<[f32; 3]>, String> {
    let accessor = child(source, "technique_common").and_then(|t| child(t, "accessor"));
    let accessor = accessor.ok_or("its positions have no <accessor>")?;
    let array: Vec<f32> = numbers(referred(ids, accessor, "source", "float_array")?)?;
    let stride = number(accessor, "stride", 1)?;
    let offset = number(accessor, "offset", 0)?;
    let count = number(accessor, "count", 0)?;
    let mut axes = [0, 1, 2];
    for (at, parameter) in children(accessor, "param").enumerate() {
        let axis = ["X", "Y", "Z"]
            .map(Some)
            .iter()
            .position(|&n| n == parameter.attribute("name"));
        if let Some(axis) = axis {
            axes[axis] = at;
        }
    }
    let end = count
        .checked_mul(stride)
        .and_then(|n| n.checked_add(offset));
    let fits = axes.iter().all(|&axis| axis < stride) && end.is_some_and(|n| n <= array.len());
    if !fits {
        return Err("its positions are not as its <accessor> says".to_owned());
    }
    let point = |i: usize| axes.map(|axis| array[offset + i * stride + axis]);
    Ok((0..count).map(point).collect())
}

/// A whole number that an attribute holds.
fn number(element: Node, attribute: &str, default: usize) -> Result<usize, String> {
    let Some(text) = element.attribute(attribute) else {
        return Ok(default);
    };
    text.trim().parse().map_err(|_| {
        let name = element.tag_name().name();
        format!("the {attribute} of its <{name}> is no count")
    })
}
