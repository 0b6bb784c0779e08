//! Reading TOML strictly: an unknown, misspelt or missing key is an error that says where it is.

use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// A TOML file that cannot be used. The message carries file, line, the line's text with a caret
/// below the mistake, and the nearest known key.
#[derive(Debug, thiserror::Error)]
pub enum TomlError {
    #[error("cannot read {path}: {source}", path = path.display())]
    Read {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{path}: {message}", path = path.display())]
    Invalid { path: PathBuf, message: String },
}

/// Reads `path` into `T`, whose structs say `#[serde(deny_unknown_fields)]` and never `flatten`
/// (which loses the place of a mistake).
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, TomlError> {
    let text = std::fs::read_to_string(path).map_err(|source| TomlError::Read {
        path: path.to_owned(),
        source,
    })?;
    toml::from_str(&text).map_err(|e| TomlError::Invalid {
        path: path.to_owned(),
        message: e.to_string(),
    })
}
