//! ARCHITECTURE.md against the source.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn page() -> String {
    fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap()
}

/// What stands in backticks in a text.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// The source files of a module, or of a part of one.
fn files(path: &Path) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.to_owned()];
    }
    let entries = fs::read_dir(path).unwrap();
    let files = entries.flat_map(|entry| files(&entry.unwrap().path()));
    files.collect()
}

/// The modules of src/ and their source files.
fn modules() -> BTreeMap<String, Vec<PathBuf>> {
    let entries = fs::read_dir(root().join("src")).unwrap();
    let modules = entries.map(|entry| {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap();
        (name.to_owned(), files(&path))
    });
    modules
        .filter(|(name, _)| !["lib", "main"].contains(&name.as_str()))
        .collect()
}

/// The other modules that the code of one names, tests and comments apart.
fn knows_of(files: &[PathBuf]) -> BTreeSet<String> {
    let mut known = BTreeSet::new();
    for file in files.iter().filter(|file| !file.ends_with("tests.rs")) {
        let text = fs::read_to_string(file).unwrap();
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        let lines = code.lines().filter(|l| !l.trim_start().starts_with("//"));
        for line in lines {
            for path in line.split("crate::").skip(1) {
                let end = path.find(|c: char| !(c.is_ascii_lowercase() || c == '_'));
                known.insert(path[..end.unwrap_or(path.len())].to_owned());
            }
        }
    }
    known
}

#[test]
fn rooms_are_what_the_page_says() {
    let page = page();
    let tools = page.split("Five tools").nth(1).unwrap();
    let tools: BTreeSet<&str> = quoted(tools.split("\n\n").next().unwrap()).collect();
    assert_eq!(tools.len(), 5);
    let rows = page.lines().filter(|line| line.starts_with("| `"));
    let rooms: BTreeMap<&str, BTreeSet<&str>> = rows
        .map(|row| {
            let cells: Vec<&str> = row.split('|').collect();
            let room = quoted(cells[1]).next().unwrap().trim_end_matches('/');
            (room, quoted(cells[3]).collect())
        })
        .collect();
    let modules = modules();
    let named: BTreeSet<&str> = rooms.keys().copied().chain(tools.clone()).collect();
    assert!(named.iter().eq(modules.keys()), "{named:?}");
    for (name, files) in &modules {
        let known = knows_of(files);
        let others = known.iter().map(String::as_str);
        let others = others.filter(|other| modules.contains_key(*other) && other != name);
        let others: BTreeSet<&str> = others.collect();
        match rooms.get(name.as_str()) {
            None => assert!(others.is_empty(), "{name} knows of {others:?}"),
            Some(_) if name == "cli" => {}
            Some(said) => assert_eq!(
                said,
                &others.difference(&tools).copied().collect(),
                "{name}"
            ),
        }
        assert!(!known.contains("cli"));
    }
}

/// Files and folders that stand in backticks are there.
#[test]
fn what_the_page_points_to_exists() {
    let page = page();
    // Blocks of text aside.
    let prose: String = page.split("```").step_by(2).collect();
    for path in quoted(&prose).filter(|text| text.contains('/') && !text.contains('<')) {
        let generated = path == "data/cache/";
        let exists = root().join(path).exists() || root().join("src").join(path).exists();
        assert!(generated || exists, "{path}");
    }
}
