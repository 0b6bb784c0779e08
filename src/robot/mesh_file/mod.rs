//! Reading mesh files: STL, OBJ and COLLADA.

mod collada;
mod obj;
mod stl;
mod surface;

use super::{Mesh, files};
use std::path::Path;

/// The most triangles that a mesh file may draw: a depth camera sees no more, and memory is bounded.
pub const MAX_TRIANGLES: usize = 4_000_000;
/// Files larger than this (bytes) are not read.
const MAX_BINARY: u64 = 1 << 28;
const MAX_TEXT: u64 = 1 << 27;

/// What a mesh file holds.
pub struct MeshFile {
    /// Welded, with at least one triangle. In metres if `in_metres`, else in the file's own unit.
    pub mesh: Mesh,
    /// Whether the file says its unit.
    pub in_metres: bool,
    /// A COLLADA file's up axis, if that is not z.
    pub up_axis: Option<String>,
}

/// Reads the mesh file at `path`; its extension, in upper or lower case, tells the format. The error
/// says why the file cannot be used.
pub fn read(path: &Path) -> Result<MeshFile, String> {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let unitless = |mesh| MeshFile {
        mesh,
        in_metres: false,
        up_axis: None,
    };
    let mut file = match extension.to_ascii_lowercase().as_str() {
        "stl" | "stlb" => unitless(stl::read(&files::read(path, MAX_BINARY)?)?),
        "obj" => unitless(obj::read(&files::read_text(path, MAX_TEXT)?)?),
        "dae" => collada::read(files::read_text(path, MAX_TEXT)?)?,
        "" => {
            return Err(format!(
                "a file without an extension is not read; {FORMATS}"
            ));
        }
        other => return Err(format!(".{other} files are not read; {FORMATS}")),
    };
    if file.mesh.triangles.len() > MAX_TRIANGLES {
        let triangles = file.mesh.triangles.len();
        return Err(format!(
            "it has {triangles} triangles, more than {MAX_TRIANGLES}; simplify it"
        ));
    }
    file.mesh = file.mesh.welded();
    if file.mesh.is_empty() {
        return Err("it has no triangles".to_owned());
    }
    if file.mesh.vertices.iter().flatten().any(|x| !x.is_finite()) {
        return Err("a vertex is not finite".to_owned());
    }
    Ok(file)
}

const FORMATS: &str = "convert the mesh to STL, OBJ or COLLADA (.dae)";
