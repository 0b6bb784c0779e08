//! Recipes: all that a result depends on, and the hash of it that names the result.

use super::task::{Stage, Task};
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A blake3 hash in hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Hash(String);

impl Hash {
    pub fn of(bytes: &[u8]) -> Hash {
        Hash(blake3::hash(bytes).to_hex().to_string())
    }

    pub fn of_file(path: &Path) -> std::io::Result<Hash> {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(std::fs::File::open(path)?)?;
        Ok(Hash(hasher.finalize().to_hex().to_string()))
    }
}

impl std::fmt::Display for Hash {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Everything that a task's result depends on. Its hash is the task's key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    pub stage: Stage,
    pub parameters: serde_json::Value,
    pub files: Vec<FileHash>,
    /// The stages and keys of the inputs.
    pub inputs: Vec<Key>,
}

/// A source file, its path relative to the repository where it lies inside, and the hash of its
/// contents.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileHash {
    pub path: String,
    pub blake3: Hash,
}

/// The name of a result in the cache.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Key {
    pub stage: String,
    /// blake3 of the [`Recipe`] as JSON with sorted keys.
    pub hash: Hash,
}

impl Recipe {
    pub fn key(&self) -> Key {
        // A `Value` keeps its keys sorted, whatever the order of the fields above.
        let json = serde_json::json!(self).to_string();
        Key {
            stage: self.stage.name.clone(),
            hash: Hash::of(json.as_bytes()),
        }
    }
}

/// Writes the recipes of tasks. Every source file is read once.
pub struct Cook {
    root: PathBuf,
    hashes: RefCell<BTreeMap<PathBuf, Hash>>,
}

impl Cook {
    /// `root` is the repository, to which paths of source files are relative.
    pub fn new(root: &Path) -> Cook {
        Cook {
            root: root.to_owned(),
            hashes: RefCell::default(),
        }
    }

    pub fn recipe(&self, task: &dyn Task) -> Result<Recipe> {
        let mut files = Vec::new();
        for path in task.files() {
            for path in files_below(&path)? {
                let hash = self.hash(&path)?;
                let shown = path.strip_prefix(&self.root).unwrap_or(&path);
                files.push(FileHash {
                    path: shown.display().to_string(),
                    blake3: hash,
                });
            }
        }
        let inputs = task.inputs();
        let inputs = inputs.iter().map(|input| Ok(self.recipe(&**input)?.key()));
        Ok(Recipe {
            stage: task.stage(),
            parameters: task.parameters(),
            files,
            inputs: inputs.collect::<Result<_>>()?,
        })
    }

    fn hash(&self, path: &Path) -> Result<Hash> {
        if let Some(hash) = self.hashes.borrow().get(path) {
            return Ok(hash.clone());
        }
        let hash = Hash::of_file(path).with_context(|| cannot_read(path))?;
        self.hashes
            .borrow_mut()
            .insert(path.to_owned(), hash.clone());
        Ok(hash)
    }
}

/// The file itself, or all files below a folder, in the order of their paths.
pub fn files_below(path: &Path) -> Result<Vec<PathBuf>> {
    let metadata = path.metadata().with_context(|| cannot_read(path))?;
    if !metadata.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut entries = Vec::new();
    for entry in path.read_dir().with_context(|| cannot_read(path))? {
        entries.push(entry.with_context(|| cannot_read(path))?.path());
    }
    entries.sort();
    let nested = entries.iter().map(|entry| files_below(entry));
    Ok(nested.collect::<Result<Vec<_>>>()?.concat())
}

fn cannot_read(path: &Path) -> String {
    format!("cannot read {}", path.display())
}
