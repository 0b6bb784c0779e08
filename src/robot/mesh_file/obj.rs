//! Wavefront OBJ: points and faces. Materials, normals, lines and groups do not matter here.

use super::surface::Surface;
use crate::robot::Mesh;

/// Reads the text of an OBJ file.
pub fn read(text: &str) -> Result<Mesh, String> {
    let mut surface = Surface::default();
    // Faces may name points that follow.
    let mut corners: Vec<u32> = Vec::new();
    // The line of each, and where its corners end.
    let mut faces: Vec<(usize, usize)> = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        let mut joined = String::new();
        let mut last = line;
        // A comment may end like that by chance, as in the name of a folder.
        while !line.trim_start().starts_with('#')
            && let Some(start) = last.trim_end().strip_suffix('\\')
        {
            joined.push_str(start);
            joined.push(' ');
            last = lines.next().unwrap_or_default().1;
        }
        let line = match joined.is_empty() {
            true => last,
            false => {
                joined.push_str(last);
                &joined
            }
        };
        let mut words = line.split('#').next().unwrap_or("").split_whitespace();
        let failed = |why: &str| format!("line {}: {why}", number + 1);
        match words.next() {
            Some("v") => surface.points.push(point(words).map_err(failed)?),
            Some("f") => {
                for word in words {
                    let corner = index(word, surface.points.len());
                    corners.push(corner.ok_or_else(|| failed("a face names no vertex"))?);
                }
                faces.push((number, corners.len()));
            }
            _ => {}
        }
    }
    let mut start = 0;
    for (number, end) in faces {
        let failed = |why| format!("line {}: {why}", number + 1);
        surface.polygon(&corners[start..end]).map_err(failed)?;
        start = end;
    }
    Ok(surface.into_mesh())
}

/// Three numbers; a fourth one divides them, and three more are a colour.
fn point<'a>(words: impl Iterator<Item = &'a str>) -> Result<[f32; 3], &'static str> {
    let numbers: Result<Vec<f32>, _> = words.map(str::parse).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z, w]) if w != 0.0 => Ok([x / w, y / w, z / w]),
        Ok(&[x, y, z] | &[x, y, z, _, _, _, ..]) => Ok([x, y, z]),
        _ => Err("a vertex is not three numbers"),
    }
}

/// The position, counted from 0, of the point that `7/2/3` or `-1//3` names, when `points` precede it.
fn index(word: &str, points: usize) -> Option<u32> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    let at = match number {
        ..0 => number.checked_add(i64::try_from(points).ok()?)?,
        _ => number - 1,
    };
    u32::try_from(at).ok()
}
