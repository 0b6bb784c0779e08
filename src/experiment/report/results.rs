//! The folder that a study's run has left.

use crate::experiment::claims::ClaimResult;
use crate::experiment::progress::duration;
use crate::experiment::task::read_json;
use anyhow::{Context, Result, ensure};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Its verdicts and its manifest, which may be of an older program and lack what newer ones have.
pub struct Results {
    /// The study, which the folder is named after.
    pub id: String,
    folder: PathBuf,
    pub claims: Vec<ClaimResult>,
    pub manifest: Value,
}

impl Results {
    pub fn read(folder: &Path) -> Result<Results> {
        let id = folder.file_name().unwrap_or_default();
        Ok(Results {
            id: id.to_string_lossy().into_owned(),
            folder: folder.to_owned(),
            claims: read_json(&folder.join("claims.json"))?,
            manifest: read_json(&folder.join("manifest.json"))?,
        })
    }

    /// Of all studies in a folder of results, in alphabetical order.
    pub fn all(folder: &Path) -> Result<Vec<Results>> {
        let unreadable = || format!("cannot read {}", folder.display());
        let mut folders = Vec::new();
        for entry in folder.read_dir().with_context(unreadable)? {
            let path = entry.with_context(unreadable)?.path();
            if path.join("manifest.json").is_file() {
                folders.push(path);
            }
        }
        ensure!(
            !folders.is_empty(),
            "{} holds no results: no folder in it has a manifest.json",
            folder.display()
        );
        folders.sort();
        folders.iter().map(|folder| Results::read(folder)).collect()
    }

    /// The names of its files of one kind, without extension; `first` before all others, which are in
    /// alphabetical order.
    pub fn files(&self, extensions: &[&str], first: &str) -> Result<Vec<String>> {
        let unreadable = || format!("cannot read {}", self.folder.display());
        let mut names = BTreeSet::new();
        for entry in self.folder.read_dir().with_context(unreadable)? {
            let path = entry.with_context(unreadable)?.path();
            let extension = path.extension().and_then(|extension| extension.to_str());
            let stem = path.file_stem().and_then(|stem| stem.to_str());
            if let (Some(extension), Some(stem)) = (extension, stem)
                && extensions.contains(&extension)
            {
                names.insert((stem != first, stem.to_owned()));
            }
        }
        Ok(names.into_iter().map(|(_, name)| name).collect())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// A text or number of the manifest, `unknown` when it has none.
    pub fn fact(&self, pointer: &str) -> String {
        match self.manifest.pointer(pointer) {
            Some(Value::String(text)) => text.clone(),
            None | Some(Value::Null) => "unknown".to_owned(),
            Some(other) => other.to_string(),
        }
    }

    /// As typed.
    pub fn command(&self) -> String {
        let words = self.manifest["command"].as_array().into_iter().flatten();
        let words: Vec<&str> = words.filter_map(Value::as_str).collect();
        words.join(" ")
    }

    /// What the run took, in words.
    pub fn cost(&self) -> String {
        let mut text = String::new();
        let steps = self.manifest["tasks"].as_array().into_iter().flatten();
        let is_cached = |step: &&Value| step["cached"] == true;
        let cached: Vec<&Value> = steps.filter(is_cached).collect();
        if !cached.is_empty() {
            let seconds = cached.iter().filter_map(|step| step["seconds"].as_f64());
            let (count, made) = (cached.len(), duration(seconds.sum()));
            let steps = if count == 1 { "step" } else { "steps" };
            text.push_str(&format!("{count} {steps} made before in {made}, then "));
        }
        match self.manifest["wall_seconds"].as_f64() {
            Some(seconds) => text.push_str(&duration(seconds)),
            None => text.push_str("unknown time"),
        }
        if let Some(megabytes) = self.manifest["peak_megabytes"].as_f64() {
            text.push_str(&format!(", {megabytes:.0} MB at most"));
        }
        text
    }
}
