//! The cache: results of tasks, kept under `<root>/<stage>/<hash of the recipe>/`.
//!
//! A result is made in a temporary folder and renamed when it is whole, so a process that is killed
//! leaves at most a temporary folder, which is thrown away later. Whoever makes a result holds a
//! lock on it; the operating system frees the lock when the process ends, however it ends. Every
//! file of a result is checked against its hash before it is used.

use super::recipe::{Hash, Key, Recipe, files_below};
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fmt::Display;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

const ENTRY: &str = "entry.json";
const FORMAT: u32 = 1;

/// A folder of results, shared by whatever processes use it at once.
pub struct Cache {
    root: PathBuf,
    /// Results found whole by this process; they are not read again.
    checked: Mutex<BTreeSet<Key>>,
}

/// What the cache holds under a key.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    Ready,
    Missing,
    /// The result cannot be used; the text says which file is why.
    Damaged(String),
}

/// A result in the cache, as [`Cache::kept`] lists it.
#[derive(Debug)]
pub struct Kept {
    pub key: Key,
    /// Absent when its `entry.json` cannot be read.
    pub entry: Option<Entry>,
    pub bytes: u64,
}

/// How a result was made: its `entry.json`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    format: u32,
    /// Of the task that made it.
    pub label: String,
    pub recipe: Recipe,
    /// Wall-clock time that making it took.
    pub seconds: f64,
    files: Vec<KeptFile>,
}

/// A file of a result, its path relative to the result's folder.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptFile {
    path: String,
    bytes: u64,
    blake3: Hash,
}

impl Cache {
    /// The cache in the folder `root`, which is created when something is first made.
    pub fn new(root: &Path) -> Cache {
        Cache {
            root: root.to_owned(),
            checked: Mutex::default(),
        }
    }

    /// Where the result of `key` is or will be.
    pub fn folder(&self, key: &Key) -> PathBuf {
        self.root.join(&key.stage).join(key.hash.to_string())
    }

    /// Checks every file of the result against its size and hash, once for each process.
    pub fn state(&self, key: &Key) -> State {
        let known = |cache: &Cache| cache.checked.lock().is_ok_and(|c| c.contains(key));
        if known(self) {
            return State::Ready;
        }
        let folder = self.folder(key);
        if !folder.is_dir() {
            return State::Missing;
        }
        match check(&folder, key) {
            Ok(()) => {
                self.remember(key);
                State::Ready
            }
            Err(error) => State::Damaged(format!("{error:#}")),
        }
    }

    fn remember(&self, key: &Key) {
        if let Ok(mut checked) = self.checked.lock() {
            checked.insert(key.clone());
        }
    }

    /// Makes the result of `recipe` by letting `produce` write into an empty folder, unless another
    /// process has made it by now. Takes the place of a damaged result.
    pub fn make(
        &self,
        recipe: &Recipe,
        label: &str,
        produce: impl FnOnce(&Path) -> Result<()>,
    ) -> Result<()> {
        let key = recipe.key();
        let folder = self.folder(&key);
        let stage = self.root.join(&key.stage);
        fs::create_dir_all(&stage).with_context(|| cannot_write(&stage))?;
        let _lock = lock(&lock_of(&stage, &key.hash))?;
        if self.state(&key) == State::Ready {
            return Ok(());
        }
        let temporary = stage.join(format!(".{}.tmp", key.hash));
        remove_folder(&temporary)?;
        fs::create_dir(&temporary).with_context(|| cannot_write(&temporary))?;
        let start = std::time::Instant::now();
        produce(&temporary)?;
        let entry = Entry {
            format: FORMAT,
            label: label.to_owned(),
            recipe: recipe.clone(),
            seconds: start.elapsed().as_secs_f64(),
            files: kept_files(&temporary)?,
        };
        write_entry(&temporary.join(ENTRY), &entry)?;
        remove_folder(&folder)?;
        fs::rename(&temporary, &folder).with_context(|| cannot_write(&folder))?;
        self.remember(&key);
        Ok(())
    }

    /// How the result of `key` was made. Fails when there is none.
    pub fn entry(&self, key: &Key) -> Result<Entry> {
        read_entry(&self.folder(key))
    }

    /// All results, whole or not, by stage and hash.
    pub fn kept(&self) -> Result<Vec<Kept>> {
        let name = |path: &Path| path.file_name().map(|name| name.display().to_string());
        let mut kept = Vec::new();
        for stage in folders(&self.root) {
            for folder in folders(&stage) {
                let hash = name(&folder).and_then(|name| name.parse().ok());
                let (Some(stage), Some(hash)) = (name(&stage), hash) else {
                    continue;
                };
                let mut bytes = 0;
                for file in files_below(&folder)? {
                    bytes += file.metadata().map_or(0, |file| file.len());
                }
                kept.push(Kept {
                    key: Key { stage, hash },
                    entry: read_entry(&folder).ok(),
                    bytes,
                });
            }
        }
        Ok(kept)
    }

    /// Removes a result, once nobody is making it.
    pub fn remove(&self, key: &Key) -> Result<()> {
        let _lock = lock(&lock_of(&self.root.join(&key.stage), &key.hash))?;
        if let Ok(mut checked) = self.checked.lock() {
            checked.remove(key);
        }
        remove_folder(&self.folder(key))
    }

    /// Throws away what killed processes have left, so long as nobody is working on it.
    pub fn sweep(&self) -> Result<()> {
        for stage in folders(&self.root) {
            for temporary in folders(&stage) {
                let Some(hash) = temporary_of(&temporary) else {
                    continue;
                };
                let path = lock_of(&stage, hash);
                let file = File::create(&path).with_context(|| cannot_write(&path))?;
                if file.try_lock().is_ok() {
                    remove_folder(&temporary)?;
                }
            }
        }
        Ok(())
    }

    /// Fails with one clear sentence when nothing can be written here.
    pub fn check_writable(&self) -> Result<()> {
        fs::create_dir_all(&self.root).with_context(|| cannot_write(&self.root))?;
        let probe = self.root.join(".probe");
        File::create(&probe).with_context(|| cannot_write(&self.root))?;
        fs::remove_file(&probe).or_else(|error| match error.kind() {
            std::io::ErrorKind::NotFound => Ok(()), // another process's probe
            _ => Err(error).with_context(|| cannot_write(&self.root)),
        })
    }

    /// Waits for the exclusive right to `name` among all processes that use this cache. The right
    /// ends when the file is dropped.
    pub fn exclusive(&self, name: &str) -> Result<File> {
        fs::create_dir_all(&self.root).with_context(|| cannot_write(&self.root))?;
        lock(&self.root.join(format!(".{name}.lock")))
    }

    /// Why there is no result for `recipe`: in what it differs from the nearest result of its stage.
    pub fn why_missing(&self, recipe: &Recipe) -> String {
        folders(&self.root.join(&recipe.stage.name))
            .iter()
            .filter_map(|folder| read_entry(folder).ok())
            .map(|entry| recipe.differences_from(&entry.recipe))
            .min_by_key(Vec::len)
            .map_or("nothing like it yet".to_owned(), |found| {
                let more = found.len().saturating_sub(3);
                let mut text = found.into_iter().take(3).collect::<Vec<_>>().join(", ");
                if more > 0 {
                    text.push_str(&format!(" and {more} more"));
                }
                text
            })
    }
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

fn lock_of(stage: &Path, hash: impl Display) -> PathBuf {
    stage.join(format!(".{hash}.lock"))
}

fn lock(path: &Path) -> Result<File> {
    let file = File::create(path).with_context(|| cannot_write(path))?;
    file.lock()
        .with_context(|| format!("cannot lock {}", path.display()))?;
    Ok(file)
}

fn remove_folder(path: &Path) -> Result<()> {
    match fs::remove_dir_all(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", path.display()))
        }
        _ => Ok(()),
    }
}

/// The folders in `path` in the order of their names; none when it cannot be read.
fn folders(path: &Path) -> Vec<PathBuf> {
    let entries = path.read_dir().into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = entries.map(|e| e.path()).filter(|p| p.is_dir()).collect();
    folders.sort();
    folders
}

fn temporary_of(folder: &Path) -> Option<&str> {
    folder
        .file_name()?
        .to_str()?
        .strip_prefix('.')?
        .strip_suffix(".tmp")
}

/// Power may fail between the rename and the writing back of other files. Their hashes would tell,
/// so the entry alone is forced to the disk.
fn write_entry(path: &Path, entry: &Entry) -> Result<()> {
    let json = serde_json::to_vec_pretty(entry)?;
    let mut file = File::create(path).with_context(|| cannot_write(path))?;
    file.write_all(&json)
        .and_then(|()| file.sync_all())
        .with_context(|| cannot_write(path))
}

fn read_entry(folder: &Path) -> Result<Entry> {
    let path = folder.join(ENTRY);
    let bytes = fs::read(&path).with_context(|| format!("{} is missing", path.display()))?;
    serde_json::from_slice(&bytes).with_context(|| format!("{} is broken", path.display()))
}

/// All files below `folder` but its entry, in the order of their paths.
fn kept_files(folder: &Path) -> Result<Vec<KeptFile>> {
    let mut files = Vec::new();
    for path in files_below(folder)? {
        let relative = path.strip_prefix(folder).unwrap_or(&path);
        if relative == Path::new(ENTRY) {
            continue;
        }
        let unreadable = || format!("cannot read {}", path.display());
        files.push(KeptFile {
            path: relative.display().to_string(),
            bytes: path.metadata().with_context(unreadable)?.len(),
            blake3: Hash::of_file(&path).with_context(unreadable)?,
        });
    }
    Ok(files)
}

fn check(folder: &Path, key: &Key) -> Result<()> {
    let entry = read_entry(folder)?;
    if entry.format != FORMAT || entry.recipe.key() != *key {
        bail!("{} does not belong here", folder.join(ENTRY).display());
    }
    let found = kept_files(folder)?;
    let named = |files: &'_ [KeptFile]| -> BTreeSet<String> {
        files.iter().map(|f| f.path.clone()).collect()
    };
    let (expected_names, found_names) = (named(&entry.files), named(&found));
    if let Some(name) = expected_names.difference(&found_names).next() {
        bail!("{} is missing", folder.join(name).display());
    }
    if let Some(name) = found_names.difference(&expected_names).next() {
        bail!("{} should not be there", folder.join(name).display());
    }
    for (expected, found) in entry.files.iter().zip(&found) {
        let path = folder.join(&found.path);
        if expected.bytes != found.bytes {
            let (was, is) = (expected.bytes, found.bytes);
            bail!("{} has {is} bytes instead of {was}", path.display());
        }
        if expected != found {
            bail!("{} was altered", path.display());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::task::Stage;
    use serde_json::{Value, json};

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

    fn write_two(out: &Path) -> Result<()> {
        fs::write(out.join("a.bin"), [1, 2, 3])?;
        fs::create_dir(out.join("sub"))?;
        fs::write(out.join("sub/b.bin"), [4])?;
        Ok(())
    }

    #[test]
    fn a_result_is_kept_and_found_again() {
        let folder = tempfile::tempdir().unwrap();
        let recipe = recipe(json!({ "x": 0.1, "y": 1e-7, "z": 2.0_f64.sqrt() }));
        assert_eq!(
            Cache::new(folder.path()).state(&recipe.key()),
            State::Missing
        );
        Cache::new(folder.path())
            .make(&recipe, "two", write_two)
            .unwrap();
        let again = Cache::new(folder.path());
        assert_eq!(again.state(&recipe.key()), State::Ready);
        assert_eq!(
            fs::read(again.folder(&recipe.key()).join("sub/b.bin")).unwrap(),
            [4]
        );
        again.make(&recipe, "two", |_| bail!("not needed")).unwrap();
    }

    #[test]
    fn what_is_kept_is_listed_and_can_be_removed() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path());
        assert!(cache.kept().unwrap().is_empty());
        let recipes = [recipe(json!({ "x": 1 })), recipe(json!({ "x": 2 }))];
        for recipe in &recipes {
            cache.make(recipe, "two", write_two).unwrap();
        }
        fs::remove_file(cache.folder(&recipes[1].key()).join(ENTRY)).unwrap();
        let mut keys: Vec<Key> = recipes.iter().map(Recipe::key).collect();
        keys.sort();
        let kept = cache.kept().unwrap();
        assert!(kept.iter().map(|k| &k.key).eq(&keys));
        for one in &kept {
            let is_whole = one.key == recipes[0].key();
            assert_eq!(one.entry.is_some(), is_whole);
            assert_eq!(one.bytes == 4, !is_whole);
        }
        cache.remove(&recipes[0].key()).unwrap();
        assert_eq!(cache.state(&recipes[0].key()), State::Missing);
        assert_eq!(cache.kept().unwrap().len(), 1);
    }

    #[test]
    fn damage_of_any_kind_is_found_and_named() {
        type Damage = fn(&Path);
        let kinds: [(Damage, &str); 7] = [
            (
                |f| fs::write(f.join("a.bin"), [1, 2]).unwrap(),
                "a.bin has 2 bytes instead of 3",
            ),
            (
                |f| fs::write(f.join("a.bin"), [1, 2, 4]).unwrap(),
                "a.bin was altered",
            ),
            (
                |f| fs::remove_file(f.join("sub/b.bin")).unwrap(),
                "b.bin is missing",
            ),
            (
                |f| fs::write(f.join("c"), []).unwrap(),
                "c should not be there",
            ),
            (
                |f| fs::remove_file(f.join(ENTRY)).unwrap(),
                "entry.json is missing",
            ),
            (
                |f| fs::write(f.join(ENTRY), "{\"format\": 1").unwrap(),
                "entry.json is broken",
            ),
            (
                |f| {
                    let text = fs::read_to_string(f.join(ENTRY)).unwrap();
                    fs::write(f.join(ENTRY), text.replace("\"x\": 1", "\"x\": 2")).unwrap();
                },
                "entry.json does not belong here",
            ),
        ];
        for (damage, message) in kinds {
            let folder = tempfile::tempdir().unwrap();
            let recipe = recipe(json!({ "x": 1 }));
            Cache::new(folder.path())
                .make(&recipe, "two", write_two)
                .unwrap();
            let cache = Cache::new(folder.path());
            damage(&cache.folder(&recipe.key()));
            match cache.state(&recipe.key()) {
                State::Damaged(found) => assert!(found.contains(message), "{found}"),
                other => panic!("{message}: {other:?}"),
            }
            cache.make(&recipe, "two", write_two).unwrap();
            assert_eq!(Cache::new(folder.path()).state(&recipe.key()), State::Ready);
        }
    }

    #[test]
    fn a_failure_leaves_no_result_and_what_it_left_is_swept() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path());
        let recipe = recipe(json!({ "x": 1 }));
        let half = |out: &Path| {
            fs::write(out.join("a.bin"), [1])?;
            bail!("stopped midway")
        };
        assert!(cache.make(&recipe, "half", half).is_err());
        assert_eq!(cache.state(&recipe.key()), State::Missing);
        let stage = folder.path().join("test");
        assert_eq!(folders(&stage).len(), 1);
        cache.sweep().unwrap();
        assert_eq!(folders(&stage).len(), 0);
        cache.make(&recipe, "two", write_two).unwrap();
        assert_eq!(cache.state(&recipe.key()), State::Ready);
    }

    #[test]
    fn one_of_two_who_want_the_same_result_makes_it() {
        let folder = tempfile::tempdir().unwrap();
        let recipe = recipe(json!({ "x": 1 }));
        let made = std::sync::atomic::AtomicU32::new(0);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    let produce = |out: &Path| {
                        made.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                        std::thread::sleep(std::time::Duration::from_millis(20));
                        write_two(out)
                    };
                    // Each has a cache of its own, like another process.
                    Cache::new(folder.path())
                        .make(&recipe, "two", produce)
                        .unwrap();
                });
            }
        });
        assert_eq!(made.into_inner(), 1);
    }

    #[test]
    fn the_reason_names_what_differs_from_the_nearest_result() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path());
        let with =
            |trees: u32, leaf: u32| recipe(json!({ "forest": { "trees": trees, "leaf": leaf } }));
        assert_eq!(cache.why_missing(&with(10, 5)), "nothing like it yet");
        cache.make(&with(10, 5), "a", write_two).unwrap();
        cache.make(&with(20, 6), "b", write_two).unwrap();
        assert_eq!(cache.why_missing(&with(3, 5)), "forest.trees 10 -> 3");
        assert_eq!(cache.why_missing(&with(20, 7)), "forest.leaf 6 -> 7");
        let mut newer = with(10, 5);
        newer.stage.version = 2;
        assert_eq!(cache.why_missing(&newer), "stage version 1 -> 2");
    }
}
