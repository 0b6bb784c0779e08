//! Reading files of a bounded size.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The bytes of a regular file of at most `most` bytes; the error says why not.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, String> {
    let told = |error: std::io::Error| one_line(&error);
    // Before it is opened: to open a pipe waits for its writer.
    let metadata = std::fs::metadata(path).map_err(told)?;
    if !metadata.is_file() {
        return Err("it is not a regular file".to_owned());
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(told)?;
    file.take(most + 1).read_to_end(&mut bytes).map_err(told)?;
    if bytes.len() as u64 > most {
        return Err(format!("it has more than {} MiB", most >> 20));
    }
    Ok(bytes)
}

/// The same as text. Bytes that are not UTF-8 are replaced: they occur in names and comments of files
/// that say another encoding, never in numbers.
pub fn read_text(path: &Path, most: u64) -> Result<String, String> {
    let bytes = read(path, most)?;
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err("it is text in UTF-16; save it as UTF-8".to_owned());
    }
    let text = String::from_utf8(bytes);
    let text = text.unwrap_or_else(|e| String::from_utf8_lossy(e.as_bytes()).into_owned());
    match text.strip_prefix('\u{feff}') {
        Some(text) => Ok(text.to_owned()),
        None => Ok(text),
    }
}

/// A message without line breaks.
pub fn one_line(message: &impl ToString) -> String {
    let text = message.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
