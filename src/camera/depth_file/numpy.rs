//! Depth images that NumPy saved: `np.save("depth.npy", depth)` and `np.savez("depth.npz", depth=depth)`.

use super::{Grid, Kind, Size, Source};
use npyz::{NpyFile, NpyHeader, Order, TypeChar};
use std::fs::File;
use std::io::{BufReader, Read};
use zip::ZipArchive;

/// The headers of plain arrays are at most 128 bytes long; longer ones are not parsed.
const LONGEST_HEADER: u32 = 512;

/// Reads an array of shape (rows, columns), or with an axis of length 1 beside these.
pub(super) fn read_npy((file, length): Source, size: Size) -> Result<Grid, String> {
    array(&mut BufReader::new(file), length, size)
}

/// Reads the only array, or that which is called `depth` (or `arr_0`, as NumPy calls it itself).
pub(super) fn read_npz(file: File, size: Size) -> Result<Grid, String> {
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|e| e.to_string())?;
    let arrays: Vec<String> = (archive.file_names())
        .filter_map(|name| Some(name.ok()?.strip_suffix(".npy")?.to_owned()))
        .collect();
    let called = |name: &str| arrays.iter().any(|array| array == name);
    let name = match &arrays[..] {
        [] => return Err("it holds no array".to_owned()),
        [only] => only,
        _ if called("depth") => "depth",
        _ if called("arr_0") && !called("arr_1") => "arr_0",
        several => {
            let shown = several[..several.len().min(8)].join(", ");
            let names: String = shown
                .chars()
                .filter(|c| !c.is_control())
                .take(200)
                .collect();
            return Err(format!(
                "it holds {} arrays ({names}) and none of them is called depth; save that one alone",
                several.len()
            ));
        }
    };
    let mut member = archive
        .by_name(&format!("{name}.npy"))
        .map_err(|e| e.to_string())?;
    let length = member.size();
    array(&mut member, length, size)
}

/// Reads an array from a file of `length` bytes.
fn array(file: &mut dyn Read, length: u64, size: Size) -> Result<Grid, String> {
    // Magic, version and the length of the header, which is looked at before anybody takes memory for it.
    let mut start = [0; 12];
    file.read_exact(&mut start).map_err(cut_off)?;
    let header_length = match start[6] {
        1 => u32::from(u16::from_le_bytes([start[8], start[9]])) + 10,
        2 | 3 => u32::from_le_bytes([start[8], start[9], start[10], start[11]]).saturating_add(12),
        // Of no version that is known.
        _ => 0,
    };
    if start.starts_with(b"\x93NUMPY") && header_length > LONGEST_HEADER {
        return Err(format!(
            "its header has {header_length} bytes, but that of a plain array has few"
        ));
    }
    let mut file = start.chain(file);
    let header = NpyHeader::from_reader(&mut file).map_err(|e| match e.kind() {
        std::io::ErrorKind::UnexpectedEof => cut_off(e),
        _ => one_line(&e.to_string()),
    })?;

    let shape = header.shape();
    let sides: Vec<u64> = match shape {
        [_, _] => shape.to_vec(),
        [1, rows, columns] | [rows, columns, 1] => vec![*rows, *columns],
        _ => {
            return Err(format!(
                "its shape is {shape:?}, but depth has one of (rows, columns)"
            ));
        }
    };
    let (rows, columns) = (sides[0], sides[1]);
    let [width, height] = size.check(columns, rows)?;
    let npyz::DType::Plain(dtype) = header.dtype() else {
        return Err("its values are records, but depth must be plain numbers".to_owned());
    };
    let (letter, bytes) = (dtype.type_char(), dtype.size_field());
    let kind = match (letter, bytes) {
        (TypeChar::Uint | TypeChar::Int, 2) => Kind::Integer16,
        (TypeChar::Uint | TypeChar::Int, 4) => Kind::Integer32,
        (TypeChar::Float, 2 | 4 | 8) => Kind::Float,
        _ => {
            return Err(format!(
                "its values have the type '{dtype}', but depth must be integers of 16 or 32 bits or \
                 floats"
            ));
        }
    };
    let count = width * height;
    let there = length.saturating_sub(u64::from(header_length));
    let wanted = (count as u64) * bytes;
    if there != wanted {
        return Err(format!(
            "{there} bytes of values stand in it, but its shape asks for {wanted}"
        ));
    }
    let order = header.order();
    let values = match (letter, bytes) {
        (TypeChar::Uint, 2) => values::<u16>(header, file),
        (TypeChar::Uint, _) => values::<u32>(header, file),
        (TypeChar::Int, 2) => values::<i16>(header, file),
        (TypeChar::Int, _) => values::<i32>(header, file),
        (_, 2) => values::<half::f16>(header, file),
        (_, 4) => values::<f32>(header, file),
        _ => values::<f64>(header, file),
    }?;
    let values = match order {
        Order::C => values,
        Order::Fortran => (0..count)
            .map(|at| values[at % width * height + at / width])
            .collect(),
    };
    Ok(Grid {
        width,
        height,
        kind,
        values,
    })
}

/// All values of an array, whose length was checked.
fn values<T: npyz::Deserialize + Into<f64>>(
    header: NpyHeader,
    file: impl Read,
) -> Result<Vec<f64>, String> {
    let data = NpyFile::with_header(header, file).data::<T>();
    let values = data.map_err(|e| e.to_string())?;
    let value = |value: std::io::Result<T>| value.map(T::into).map_err(cut_off);
    values.map(value).collect()
}

fn cut_off(_: std::io::Error) -> String {
    "it is cut off".to_owned()
}

/// A message of the parser, which shows in several lines where it stopped.
fn one_line(message: &str) -> String {
    let line = message.lines().next().unwrap_or_default();
    format!("its header cannot be read: {line}")
}
