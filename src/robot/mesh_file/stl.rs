//! STL, binary and ASCII.

use super::MAX_TRIANGLES;
use crate::robot::Mesh;

const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Reads either kind. A file whose size fits its count of triangles is binary, even if its header says
/// "solid" as in ASCII files.
pub fn read(bytes: &[u8]) -> Result<Mesh, String> {
    let binary = Binary::of(bytes);
    if let Some(binary) = &binary
        && binary.triangles == binary.counted
        && bytes.len() == HEADER + TRIANGLE * binary.counted
    {
        return binary.read();
    }
    let start = bytes.iter().position(|b| !b.is_ascii_whitespace());
    let text = bytes.get(start.unwrap_or(0)..).unwrap_or_default();
    let looks_like_text = text.len() >= 5 && text[..5].eq_ignore_ascii_case(b"solid");
    let ascii = looks_like_text.then(|| read_ascii(text));
    match (ascii, binary) {
        (Some(Ok(mesh)), _) => Ok(mesh),
        (_, Some(binary)) if binary.is_whole() => binary.read(),
        (Some(Err(why)), _) => Err(why),
        (None, Some(binary)) => Err(format!(
            "it is cut off: its header says {} triangles, but there are bytes for {}",
            binary.counted, binary.triangles
        )),
        (None, None) => Err("it is too short for an STL file".to_owned()),
    }
}

struct Binary<'a> {
    /// As the header says.
    counted: usize,
    /// As many as there are bytes for.
    triangles: usize,
    bytes: &'a [u8],
}

impl Binary<'_> {
    fn of(bytes: &[u8]) -> Option<Binary<'_>> {
        let count = bytes.get(80..HEADER)?;
        Some(Binary {
            counted: u32::from_le_bytes(count.try_into().ok()?) as usize,
            triangles: (bytes.len() - HEADER) / TRIANGLE,
            bytes: &bytes[HEADER..],
        })
    }

    /// Whether all its triangles are there. Some exporters append bytes, and those that write triangles
    /// as they come leave the count at 0 or -1.
    fn is_whole(&self) -> bool {
        let unknown = self.counted == 0 || self.counted == u32::MAX as usize;
        match unknown {
            true => self.triangles > 0 && self.bytes.len().is_multiple_of(TRIANGLE),
            false => self.counted <= self.triangles,
        }
    }

    fn read(&self) -> Result<Mesh, String> {
        let triangles = match self.counted {
            0 => self.triangles,
            counted => counted.min(self.triangles),
        };
        if triangles > MAX_TRIANGLES {
            return Err(format!(
                "it has {triangles} triangles, more than {MAX_TRIANGLES}; simplify it"
            ));
        }
        let mut mesh = Mesh::default();
        for triangle in self.bytes.chunks_exact(TRIANGLE).take(triangles) {
            // A normal, which is not needed, three corners and two bytes.
            let numbers = triangle[12..48].as_chunks::<4>().0;
            let numbers: [f32; 9] = std::array::from_fn(|i| f32::from_le_bytes(numbers[i]));
            let [a, b, c, d, e, f, g, h, i] = numbers;
            push(&mut mesh, &[[a, b, c], [d, e, f], [g, h, i]]);
        }
        Ok(mesh)
    }
}

/// A polygon as the triangles that share its first corner.
fn push(mesh: &mut Mesh, corners: &[[f32; 3]]) {
    let start = mesh.vertices.len() as u32;
    mesh.vertices.extend_from_slice(corners);
    let fan = (1..corners.len() as u32 - 1).map(|i| [start, start + i, start + i + 1]);
    mesh.triangles.extend(fan);
}

/// The words may be in any case and on any lines; several solids make one mesh; normals are not
/// looked at, nor is what follows the last solid.
fn read_ascii(bytes: &[u8]) -> Result<Mesh, String> {
    let mut words = bytes
        .split(u8::is_ascii_whitespace)
        .filter(|word| !word.is_empty())
        .peekable();
    let is = |word: &&[u8], name: &str| word.eq_ignore_ascii_case(name.as_bytes());
    let mut mesh = Mesh::default();
    let mut corners = Vec::new();
    while let Some(word) = words.next() {
        if !is(&word, "facet") || words.next_if(|w| is(w, "normal")).is_none() {
            // The name of a solid, or the end of one.
            continue;
        }
        corners.clear();
        loop {
            let cut = || format!("triangle {} is cut off", mesh.triangles.len() + 1);
            let word = words.next().ok_or_else(cut)?;
            if is(&word, "endfacet") {
                break;
            } else if is(&word, "vertex") {
                let mut corner = [0.0; 3];
                for x in &mut corner {
                    let word = String::from_utf8_lossy(words.next().ok_or_else(cut)?);
                    *x = word.parse().map_err(|_| {
                        let shown: String = word.chars().take(30).collect();
                        format!(
                            "\"{shown}\" is not a number, in triangle {}",
                            mesh.triangles.len() + 1
                        )
                    })?;
                }
                corners.push(corner);
            } else if is(&word, "facet") {
                return Err(cut());
            }
        }
        if corners.len() < 3 {
            return Err(format!(
                "triangle {} lacks a corner",
                mesh.triangles.len() + 1
            ));
        }
        push(&mut mesh, &corners);
    }
    Ok(mesh)
}
