//! `armpose diff`: what two runs have in common, and what not.

use super::say;
use anyhow::{Context, Result, ensure};
use armpose::experiment::comparison::differences;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Compare the results of two runs: parameters, program, numbers
///
/// Example: armpose experiment all --out again && armpose diff results/paper again
///
/// OLD and NEW are the results of one study each, or folders of such results, which are then compared
/// study by study. The exit code is 0 when all results are the same to the last bit, 1 when not. Studies
/// of times (table2, fig5, runtime) never are.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    old: PathBuf,
    new: PathBuf,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let Arguments { old, new } = arguments;
    let mut all_same = true;
    let pairs = match is_study(old) && is_study(new) {
        true => vec![(old.clone(), new.clone())],
        false => pairs(old, new)?,
    };
    for (old, new) in pairs {
        let name = old.file_name().unwrap_or_default().display().to_string();
        let lines = match (is_study(&old), is_study(&new)) {
            (true, true) => differences(&old, &new)?,
            (true, false) => vec![format!("not in {}", arguments.new.display())],
            _ => vec![format!("not in {}", arguments.old.display())],
        };
        if lines.is_empty() {
            say(&format!("{name}: the same\n"))?;
        }
        for line in &lines {
            say(&format!("{name}: {line}\n"))?;
        }
        all_same &= lines.is_empty();
    }
    Ok(ExitCode::from(u8::from(!all_same)))
}

fn is_study(folder: &Path) -> bool {
    folder.join("manifest.json").is_file()
}

/// The studies in either folder, by name.
fn pairs(old: &Path, new: &Path) -> Result<Vec<(PathBuf, PathBuf)>> {
    let mut names = Vec::new();
    for folder in [old, new] {
        let entries = folder.read_dir();
        let entries = entries.with_context(|| format!("cannot read {}", folder.display()))?;
        for entry in entries {
            let path = entry.with_context(|| folder.display().to_string())?.path();
            if is_study(&path) {
                names.extend(path.file_name().map(|name| name.to_owned()));
            }
        }
    }
    names.sort();
    names.dedup();
    ensure!(
        !names.is_empty(),
        "neither {} nor {} holds results of a study (a manifest.json)",
        old.display(),
        new.display()
    );
    let pair = |name: &std::ffi::OsString| (old.join(name), new.join(name));
    Ok(names.iter().map(pair).collect())
}
