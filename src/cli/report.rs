//! `armpose report`: what came out, in REPRODUCE.md or as a page.

use super::{repository, say};
use anyhow::{Context, Result};
use armpose::experiment::report;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write what came out: into REPRODUCE.md, or as a page for a browser
///
/// Examples: armpose report
///           armpose report --html paper.html
///           armpose report --html smoke.html --results results/smoke
///
/// REPRODUCE.md tells the results in results/paper; only what stands between markers is written anew. The
/// page has everything of any run in one file, which opens without network: verdicts, figures, tables,
/// and how each came about.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Write a page instead of REPRODUCE.md
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// The results that the page tells, a folder for each study [default: results/paper]
    #[arg(long, value_name = "FOLDER", requires = "html")]
    results: Option<PathBuf>,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let root = repository()?;
    let (file, text) = match &arguments.html {
        None => (report::file(&root), report::refreshed(&root)?),
        Some(file) => {
            let results = arguments.results.clone();
            let results = results.unwrap_or_else(|| root.join("results/paper"));
            (file.clone(), report::page(&root, &results)?)
        }
    };
    std::fs::write(&file, text).with_context(|| format!("cannot write {}", file.display()))?;
    say(&format!("wrote {}\n", file.display()))?;
    Ok(ExitCode::SUCCESS)
}
