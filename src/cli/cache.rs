//! `armpose cache`: what is kept of earlier runs.

use super::{cache, command_line, request, say};
use anyhow::{Result, ensure};
use armpose::experiment::cache::{Kept, State};
use armpose::experiment::progress::duration;
use armpose::experiment::runner::Run;
use armpose::experiment::study::Profile;
use armpose::experiment::table::Table;
use armpose::experiment::{kinds, study_file};
use clap::ValueEnum;
use std::collections::{BTreeMap, BTreeSet};
use std::process::ExitCode;

/// List, check or clear what is kept of earlier runs, in data/cache
///
/// A result is kept under the hash of all that it depends on. Nothing in the cache is lost for good:
/// what is removed is made again when a study asks for it, with the same bits.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// List the results: how many of each stage, or all of one
    Ls {
        /// Such as pose-forest
        stage: Option<String>,
    },
    /// Remove what no study asks for any more, in any profile, with seed 1
    Gc {
        /// Only say what would go
        #[arg(long)]
        dry_run: bool,
    },
    /// Check every file of every result against its hash; exit code 1 when any is damaged
    Verify,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let cache = cache(&request(Profile::Paper, 1)?);
    let kept = cache.kept()?;
    match &arguments.command {
        Command::Ls { stage: None } => say(&stages(&kept).to_text())?,
        Command::Ls { stage: Some(stage) } => {
            let of_stage: Vec<&Kept> = kept.iter().filter(|k| k.key.stage == *stage).collect();
            ensure!(
                !of_stage.is_empty(),
                "nothing of a stage `{stage}` is kept; `armpose cache ls` shows all stages"
            );
            say(&results(&of_stage).to_text())?;
        }
        Command::Gc { dry_run } => {
            let asked_for = asked_for()?;
            let gone: Vec<&Kept> = kept
                .iter()
                .filter(|k| !asked_for.contains(&k.key))
                .collect();
            if !dry_run {
                for one in &gone {
                    cache.remove(&one.key)?;
                }
            }
            let bytes: u64 = gone.iter().map(|one| one.bytes).sum();
            say(&format!(
                "{} {} of {} results, {}\n",
                if *dry_run { "would remove" } else { "removed" },
                gone.len(),
                kept.len(),
                megabytes(bytes)
            ))?;
        }
        Command::Verify => {
            let mut damaged = 0;
            for one in &kept {
                if let State::Damaged(why) = cache.state(&one.key) {
                    damaged += 1;
                    say(&format!("{why}\n"))?;
                }
            }
            say(&format!("{} results, {damaged} damaged\n", kept.len()))?;
            return Ok(ExitCode::from(u8::from(damaged > 0)));
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// What the studies ask for, at all sizes.
fn asked_for() -> Result<BTreeSet<armpose::experiment::recipe::Key>> {
    let kinds = kinds();
    let mut keys = BTreeSet::new();
    for &profile in Profile::value_variants() {
        let request = request(profile, 1)?;
        let mut studies = Vec::new();
        for id in study_file::ids(&request.root)? {
            studies.push(study_file::read(&kinds, &request, &id)?);
        }
        let run = Run {
            request: &request,
            cache: &cache(&request),
            out: &request.root.join("results").join(profile.name()),
            command: &command_line(),
        };
        keys.extend(run.keys(&studies)?);
    }
    Ok(keys)
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

fn stages(kept: &[Kept]) -> Table {
    let mut stages: BTreeMap<&str, (usize, u64, f64)> = BTreeMap::new();
    for one in kept {
        let (count, bytes, seconds) = stages.entry(&one.key.stage).or_default();
        *count += 1;
        *bytes += one.bytes;
        *seconds += one.entry.as_ref().map_or(0.0, |entry| entry.seconds);
    }
    let mut table = Table::new(["stage", "results", "size", "made in"]);
    for (stage, (count, bytes, seconds)) in stages {
        table.push([
            stage.into(),
            count.into(),
            megabytes(bytes).into(),
            duration(seconds).into(),
        ]);
    }
    table
}

fn results(kept: &[&Kept]) -> Table {
    let mut table = Table::new(["hash", "size", "made in", "task"]);
    for one in kept {
        let (label, seconds) = match &one.entry {
            Some(entry) => (entry.label.clone(), duration(entry.seconds)),
            None => ("damaged".to_owned(), String::new()),
        };
        table.push([
            one.key.hash.to_string()[..12].into(),
            megabytes(one.bytes).into(),
            seconds.into(),
            label.into(),
        ]);
    }
    table
}
