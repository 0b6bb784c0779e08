//! Where the file is that a URDF names.

use super::{files, xml};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Folders of packages by name.
pub type Packages = BTreeMap<String, PathBuf>;

/// A `package.xml` is smaller than this (bytes).
const MAX_MANIFEST: u64 = 1 << 20;
/// How deep packages lie in a folder of ROS_PACKAGE_PATH, and how many folders are looked at.
const SEARCH_DEPTH: usize = 3;
const MAX_FOLDERS: usize = 20_000;

/// Finds files for one URDF.
pub struct Finder<'a> {
    /// The URDF's.
    folder: PathBuf,
    given: &'a Packages,
    /// Folders found so far; `None` for packages that are nowhere.
    found: BTreeMap<String, Option<PathBuf>>,
    /// What was assumed, one sentence each.
    pub notes: BTreeSet<String>,
}

impl Finder<'_> {
    pub fn new<'a>(urdf: &Path, given: &'a Packages) -> Finder<'a> {
        // The parent of a bare file name is the empty path.
        let folder = urdf.parent().filter(|folder| *folder != Path::new(""));
        Finder {
            folder: folder.unwrap_or(Path::new(".")).to_owned(),
            given,
            found: BTreeMap::new(),
            notes: BTreeSet::new(),
        }
    }

    /// The file that a name or an address (`package://`, `model://`, `file://`) stands for; the error
    /// says where it was looked for. Names may be percent-encoded.
    pub fn find(&mut self, address: &str) -> Result<PathBuf, String> {
        let decoded = percent_decoded(address);
        let first = self.find_as_written(address);
        match decoded {
            Some(decoded) if first.is_err() => self.find_as_written(&decoded).or(first),
            _ => first,
        }
    }

    fn find_as_written(&mut self, address: &str) -> Result<PathBuf, String> {
        match address.split_once("://") {
            _ if address.trim().is_empty() => Err("it has no file name".to_owned()),
            _ if address.contains("$(") || address.contains("${") => Err(
                "its name has a $(...) or ${...} in it, which xacro replaces; make a URDF with it first"
                    .to_owned(),
            ),
            None => existing(self.folder.join(address)),
            // A path after file:// that is not absolute starts at the URDF.
            Some(("file", path)) => existing(self.folder.join(path)),
            Some(("package" | "model", path)) => match path.trim_start_matches('/').split_once('/') {
                Some((name, inside)) if !name.is_empty() => self.in_package(name, inside),
                _ => Err("its address names no file in a package".to_owned()),
            },
            Some((scheme, _)) => Err(format!(
                "addresses of \"{scheme}://\" are not read; use package://, file:// or a file name"
            )),
        }
    }

    fn in_package(&mut self, name: &str, inside: &str) -> Result<PathBuf, String> {
        if let Some(folder) = self.package(name)? {
            return existing(folder.join(inside));
        }
        // The package may have no manifest, and its folder another name; what lies below the manifest
        // of another package belongs to that.
        let above = self.folder.canonicalize();
        let above = above.map_err(|e| files::one_line(&e))?;
        let of_none = |folder: &&Path| manifest_name(folder).is_none();
        let folder = above
            .ancestors()
            .take_while(of_none)
            .find(|folder| folder.join(inside).is_file());
        match folder {
            Some(folder) => {
                self.notes.insert(format!(
                    "package \"{name}\" is taken to be {}; if it is elsewhere, {}",
                    folder.display(),
                    how_to_say_where(name)
                ));
                Ok(folder.join(inside))
            }
            None => Err(format!(
                "package \"{name}\" is not found; {}",
                how_to_say_where(name)
            )),
        }
    }

    /// The folder of a package: the one given for it, else what the variables ROS_PACKAGE_PATH and
    /// AMENT_PREFIX_PATH lead to, else a folder above the URDF, or one beside these.
    fn package(&mut self, name: &str) -> Result<Option<PathBuf>, String> {
        if let Some(folder) = self.given.get(name) {
            return match folder.is_dir() {
                true => Ok(Some(folder.clone())),
                false => Err(format!(
                    "the folder given for package \"{name}\", {}, does not exist",
                    folder.display()
                )),
            };
        }
        if let Some(found) = self.found.get(name) {
            return Ok(found.clone());
        }
        let listed = |variable| {
            let paths = std::env::var_os(variable).unwrap_or_default();
            std::env::split_paths(&paths)
                .filter(|path| path.is_absolute())
                .collect::<Vec<_>>()
        };
        let mut left = MAX_FOLDERS;
        let mut below = |folder: PathBuf| package_below(&folder, name, SEARCH_DEPTH, &mut left);
        let found = (listed("ROS_PACKAGE_PATH").into_iter().find_map(&mut below))
            .or_else(|| {
                let prefixes = listed("AMENT_PREFIX_PATH").into_iter();
                let mut shares = prefixes.map(|prefix| prefix.join("share").join(name));
                shares.find(|share| share.is_dir())
            })
            .or_else(|| {
                let folder = self.folder.canonicalize().ok()?;
                let mut candidates =
                    (folder.ancestors()).flat_map(|above| [above.to_owned(), above.join(name)]);
                candidates.find(|folder| is_package(folder, name))
            });
        self.found.insert(name.to_owned(), found.clone());
        Ok(found)
    }
}

fn how_to_say_where(name: &str) -> String {
    format!(
        "say where it is with --package {name}=DIR, in a robot.toml with [packages] {name} = \"DIR\", or \
         by ROS_PACKAGE_PATH"
    )
}

fn existing(path: PathBuf) -> Result<PathBuf, String> {
    match path.is_file() {
        true => Ok(path),
        false => Err(format!("there is no file {}", path.display())),
    }
}

/// Whether a folder is the package, by its own name or by its manifest.
fn is_package(folder: &Path, name: &str) -> bool {
    let called = folder.file_name().is_some_and(|n| n == name) && folder.is_dir();
    called || manifest_name(folder).is_some_and(|said| said == name)
}

/// The name in a folder's `package.xml`; empty if that cannot be read.
fn manifest_name(folder: &Path) -> Option<String> {
    let path = folder.join("package.xml");
    if !path.is_file() {
        return None;
    }
    let text = files::read_text(&path, MAX_MANIFEST).unwrap_or_default();
    let name = xml::read(text, |root| {
        let name = xml::child(root, "name")?.text()?;
        Some(name.trim().to_owned())
    });
    Some(name.ok().flatten().unwrap_or_default())
}

/// The package in a folder or below it, in the order of names.
fn package_below(folder: &Path, name: &str, depth: usize, left: &mut usize) -> Option<PathBuf> {
    *left = left.checked_sub(1)?;
    if is_package(folder, name) {
        return Some(folder.to_owned());
    }
    // Packages do not lie in packages.
    if depth == 0 || folder.join("package.xml").is_file() {
        return None;
    }
    let entries = std::fs::read_dir(folder).ok()?;
    let mut folders: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.is_dir())
        .collect();
    folders.sort();
    folders
        .iter()
        .find_map(|folder| package_below(folder, name, depth - 1, left))
}

/// With each %20 or the like replaced; `None` if there is none.
fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let [first, more @ ..] = rest {
        let code = more.get(..2).filter(|_| *first == b'%');
        let code = code.and_then(|hex| u8::from_str_radix(std::str::from_utf8(hex).ok()?, 16).ok());
        bytes.push(code.unwrap_or(*first));
        rest = if code.is_some() { &more[2..] } else { more };
    }
    (bytes.len() < text.len()).then(|| String::from_utf8_lossy(&bytes).into_owned())
}
