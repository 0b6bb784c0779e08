//! Depth images as PGM (16-bit grey, the highest byte first) and PFM (floats, from the bottom row up).

use super::{Grid, Kind, Size, Source};
use std::fs::File;
use std::io::{BufReader, Read};

/// Headers, comments included, are shorter than this.
const LONGEST_HEADER: usize = 4096;

pub(super) fn read_pgm((file, length): Source, size: Size) -> Result<Grid, String> {
    let mut file = Header::new(file);
    match &*file.word()? {
        "P5" => {}
        "P2" => return Err("its values are text; save them as bytes (P5)".to_owned()),
        _ => return Err("it does not begin with P5".to_owned()),
    }
    let [width, height, most] = [file.number()?, file.number()?, file.number()?];
    let [width, height] = size.check(width, height)?;
    if !(256..=65535).contains(&most) {
        return Err(format!(
            "its values end at {most}, but depth must have 16 bits (256 to 65535)"
        ));
    }
    let values = file.values(width * height, length, |b| u16::from_be_bytes(b).into())?;
    Ok(Grid {
        width,
        height,
        kind: Kind::Integer16,
        values,
    })
}

/// The scale in the header tells the order of bytes by its sign; its size is ignored, as everywhere.
pub(super) fn read_pfm((file, length): Source, size: Size) -> Result<Grid, String> {
    let mut file = Header::new(file);
    match &*file.word()? {
        "Pf" => {}
        "PF" => return Err("it holds colours, not depth".to_owned()),
        _ => return Err("it does not begin with Pf".to_owned()),
    }
    let [width, height] = [file.number()?, file.number()?];
    let [width, height] = size.check(width, height)?;
    let scale: f64 = (file.word()?.parse())
        .ok()
        .filter(|scale: &f64| scale.is_finite() && *scale != 0.0)
        .ok_or("its scale is no number")?;
    let read = match scale < 0.0 {
        true => f32::from_le_bytes,
        false => f32::from_be_bytes,
    };
    let upward = file.values(width * height, length, |b| read(b).into())?;
    Ok(Grid {
        width,
        height,
        kind: Kind::Float,
        values: upward.chunks(width).rev().flatten().copied().collect(),
    })
}

/// A file that begins with words, each followed by white space.
struct Header {
    file: BufReader<File>,
    taken: usize,
}

impl Header {
    fn new(file: File) -> Header {
        Header {
            file: BufReader::new(file),
            taken: 0,
        }
    }

    fn byte(&mut self) -> Result<u8, String> {
        let mut byte = [0];
        self.taken += 1;
        match self.taken <= LONGEST_HEADER && self.file.read_exact(&mut byte).is_ok() {
            true => Ok(byte[0]),
            false => Err("its header does not end".to_owned()),
        }
    }

    /// The next word, with the one byte of white space behind it; comments go from # to the line's end.
    fn word(&mut self) -> Result<String, String> {
        let mut word = String::new();
        loop {
            match self.byte()? {
                b'#' => while self.byte()? != b'\n' {},
                byte if !byte.is_ascii_whitespace() => word.push(byte.into()),
                _ if word.is_empty() => {}
                _ => return Ok(word),
            }
        }
    }

    fn number(&mut self) -> Result<u64, String> {
        let wrong = |_| "its header has no whole number where one must be".to_owned();
        self.word()?.parse().map_err(wrong)
    }

    /// The rest of a file of `length` bytes: values of N bytes each.
    fn values<const N: usize>(
        mut self,
        count: usize,
        length: u64,
        read: impl Fn([u8; N]) -> f64,
    ) -> Result<Vec<f64>, String> {
        let there = length.saturating_sub(self.taken as u64);
        let wanted = (count * N) as u64;
        if there != wanted {
            return Err(format!(
                "{there} bytes of values stand in it, but its size asks for {wanted}"
            ));
        }
        let mut bytes = vec![0; count * N];
        (self.file.read_exact(&mut bytes)).map_err(|_| "it is cut off".to_owned())?;
        let (chunks, _) = bytes.as_chunks();
        Ok(chunks.iter().map(|&chunk| read(chunk)).collect())
    }
}
