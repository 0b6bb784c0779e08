//! `armpose report`: what came out, in REPRODUCE.md.

use super::{repository, say};
use anyhow::{Context, Result};
use armpose::experiment::report;
use std::process::ExitCode;

/// Write what came out into REPRODUCE.md, from the results in results/paper
///
/// Only what stands between markers is written anew.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {}

pub fn run(_: &Arguments) -> Result<ExitCode> {
    let root = repository()?;
    let text = report::refreshed(&root)?;
    let file = report::file(&root);
    std::fs::write(&file, text).with_context(|| format!("cannot write {}", file.display()))?;
    say(&format!("wrote {}\n", file.display()))?;
    Ok(ExitCode::SUCCESS)
}
