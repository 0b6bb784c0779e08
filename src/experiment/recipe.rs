//! Recipes: all that a result depends on, and the hash of it that names the result.

use super::task::{Stage, Task};
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A blake3 hash in hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Hash(String);

impl Hash {
    /// Of bytes in memory.
    pub fn of(bytes: &[u8]) -> Hash {
        Hash(blake3::hash(bytes).to_hex().to_string())
    }

    /// Of the contents of a file.
    pub fn of_file(path: &Path) -> std::io::Result<Hash> {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(std::fs::File::open(path)?)?;
        Ok(Hash(hasher.finalize().to_hex().to_string()))
    }
}

impl std::str::FromStr for Hash {
    type Err = blake3::HexError;

    fn from_str(text: &str) -> Result<Hash, Self::Err> {
        Ok(Hash(blake3::Hash::from_hex(text)?.to_hex().to_string()))
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
    pub parameters: Value,
    pub files: Vec<FileHash>,
    /// The stages and keys of the inputs.
    pub inputs: Vec<Key>,
}

/// A source file: its path inside the repository, or its mere name outside, and the hash of its
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
    /// Where the result is kept. Any change of the recipe changes it.
    pub fn key(&self) -> Key {
        // A `Value` keeps its keys sorted, whatever the order of the fields above.
        let json = serde_json::json!(self).to_string();
        Key {
            stage: self.stage.name.clone(),
            hash: Hash::of(json.as_bytes()),
        }
    }

    /// What of this recipe is not as in `old`, for people: `forest.trees 10 -> 3`.
    pub fn differences_from(&self, old: &Recipe) -> Vec<String> {
        const LONGEST: usize = 30;
        let (old, new) = (flatten(old), flatten(self));
        let names: BTreeSet<&String> = old.keys().chain(new.keys()).collect();
        let describe = |name: &String| match (old.get(name), new.get(name)) {
            (Some(old), Some(new)) if old == new => None,
            (Some(old), Some(new)) if old.len().max(new.len()) <= LONGEST => {
                Some(format!("{name} {old} -> {new}"))
            }
            (Some(_), Some(_)) => Some(format!("{name} changed")),
            (None, _) => Some(format!("{name} is new")),
            (_, None) => Some(format!("{name} is gone")),
        };
        names.into_iter().filter_map(describe).collect()
    }
}

/// A recipe as names and values that people can compare.
fn flatten(recipe: &Recipe) -> BTreeMap<String, String> {
    let mut flat = BTreeMap::new();
    flat.insert("stage version".to_owned(), recipe.stage.version.to_string());
    for file in &recipe.files {
        flat.insert(file.path.clone(), file.blake3.to_string());
    }
    for (position, input) in recipe.inputs.iter().enumerate() {
        let name = format!("input {} {position}", input.stage);
        flat.insert(name, input.hash.to_string());
    }
    flatten_value("", &recipe.parameters, &mut flat);
    flat
}

fn flatten_value(prefix: &str, value: &Value, flat: &mut BTreeMap<String, String>) {
    if let Value::Object(members) = value {
        for (name, member) in members {
            let dot = if prefix.is_empty() { "" } else { "." };
            flatten_value(&format!("{prefix}{dot}{name}"), member, flat);
        }
    } else {
        flat.insert(prefix.to_owned(), value.to_string());
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

    /// The recipe of a task, with those of its inputs below. Fails when a source file cannot be read.
    pub fn recipe(&self, task: &dyn Task) -> Result<Recipe> {
        let mut files = Vec::new();
        for path in task.files() {
            for path in files_below(&path)? {
                let hash = self.hash(&path)?;
                // Where a repository or outside data lies on this machine must not matter.
                let name = path.file_name().map_or(&*path, Path::new);
                let shown = path.strip_prefix(&self.root).unwrap_or(name);
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

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn recipe(parameters: Value) -> Recipe {
        Recipe {
            stage: Stage {
                name: "test".to_owned(),
                version: 1,
            },
            parameters,
            files: Vec::new(),
            inputs: Vec::new(),
        }
    }

    #[test]
    fn the_key_is_golden_and_depends_on_everything() {
        let first = recipe(json!({ "b": 1, "a": [0.5, "x"] }));
        assert_eq!(first.key().hash.to_string()[..16], *GOLDEN_KEY);
        let reordered = recipe(json!({ "a": [0.5, "x"], "b": 1 }));
        assert_eq!(first.key(), reordered.key());

        let mut others = vec![first.clone(); 5];
        others[0].parameters["b"] = json!(2);
        others[1].stage.version = 2;
        others[2].stage.name = "other".to_owned();
        others[3].inputs = vec![first.key()];
        others[4].files = vec![FileHash {
            path: "a".to_owned(),
            blake3: Hash::of(b"a"),
        }];
        let keys: BTreeSet<Key> = others.iter().chain([&first]).map(Recipe::key).collect();
        assert_eq!(keys.len(), 6);
    }
    const GOLDEN_KEY: &str = "ef2a23b693eb3cd6";

    struct OfFiles(Vec<PathBuf>);

    impl Task for OfFiles {
        fn stage(&self) -> Stage {
            recipe(Value::Null).stage
        }
        fn label(&self) -> String {
            "of files".to_owned()
        }
        fn parameters(&self) -> Value {
            Value::Null
        }
        fn files(&self) -> Vec<PathBuf> {
            self.0.clone()
        }
        fn cost(&self) -> crate::experiment::task::Cost {
            crate::experiment::task::Cost {
                seconds: 0.0,
                megabytes: 0.0,
            }
        }
        fn run(&self, _: &[PathBuf], _: &Path, _: crate::Progress<'_>) -> Result<()> {
            Ok(())
        }
    }

    #[test]
    fn contents_of_files_count_and_their_place_on_the_machine_does_not() {
        let key = |contents: &str| {
            let root = tempfile::tempdir().unwrap();
            let outside = tempfile::tempdir().unwrap();
            std::fs::create_dir(root.path().join("meshes")).unwrap();
            std::fs::write(root.path().join("meshes/a.stl"), contents).unwrap();
            std::fs::write(outside.path().join("frame.png"), "frame").unwrap();
            let task = OfFiles(vec![
                root.path().join("meshes"),
                outside.path().join("frame.png"),
            ]);
            let recipe = Cook::new(root.path()).recipe(&task).unwrap();
            let paths: Vec<&str> = recipe.files.iter().map(|f| f.path.as_str()).collect();
            assert_eq!(paths, ["meshes/a.stl", "frame.png"]);
            recipe.key()
        };
        assert_eq!(key("one"), key("one"));
        assert_ne!(key("one"), key("two"));
        let missing = Cook::new(Path::new("/")).recipe(&OfFiles(vec![PathBuf::from("/no/such")]));
        assert!(format!("{:#}", missing.unwrap_err()).starts_with("cannot read /no/such: "));
    }
}
