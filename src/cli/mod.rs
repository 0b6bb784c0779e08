//! The command line. Results go to stdout, everything else to stderr. Exit codes: 0 all is well, 1 a
//! check failed, 2 a mistake of the user or a run that failed.

mod bounds;
mod cache;
mod check;
mod dataset;
mod diff;
mod estimate;
mod evaluate;
mod experiment;
mod init;
mod overlay;
mod report;
mod robot;
mod ruler;
mod train;

use anyhow::{Context, Result};
use armpose::experiment::cache::Cache;
use armpose::experiment::study::Profile;
use armpose::experiment::study_file::Request;
use armpose::scene::Rig;
use clap::{Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The pose of a robot arm from one depth image: the studies of Widmaier et al., ICRA 2016
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Experiment(experiment::Arguments),
    Check(check::Arguments),
    Bounds(bounds::Arguments),
    Report(report::Arguments),
    Cache(cache::Arguments),
    Diff(diff::Arguments),
    Init(init::Arguments),
    Dataset(dataset::Arguments),
    Robot(robot::Arguments),
    Train(train::Arguments),
    Estimate(estimate::Arguments),
    Evaluate(evaluate::Arguments),
}

pub fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Experiment(arguments) => experiment::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Bounds(arguments) => bounds::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Cache(arguments) => cache::run(&arguments),
        Command::Diff(arguments) => diff::run(&arguments),
        Command::Init(arguments) => init::run(&arguments),
        Command::Dataset(arguments) => dataset::run(&arguments),
        Command::Robot(arguments) => robot::run(&arguments),
        Command::Train(arguments) => train::run(&arguments),
        Command::Estimate(arguments) => estimate::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
    };
    result.unwrap_or_else(|error| {
        eprintln!("armpose: {error:#}");
        ExitCode::from(2)
    })
}

/// Writes to stdout. Nobody listening any more, as in `armpose ... | head`, is not an error.
fn say(text: &str) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout
        .write_all(text.as_bytes())
        .and_then(|()| stdout.flush())
    {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(error).context("cannot write to stdout")
        }
        _ => Ok(()),
    }
}

/// Tells on stderr what may surprise in a robot's files.
fn tell_notes(rig: &Rig) {
    for warning in &rig.robot.warnings {
        eprintln!("armpose: warning: {warning}");
    }
    for note in rig.robot.notes.iter().chain(&rig.notes) {
        eprintln!("armpose: note: {note}");
    }
}

/// The repository: the nearest folder from here upward that has studies, or else the one that this
/// program was built in.
fn repository() -> Result<PathBuf> {
    let here = std::env::current_dir().context("cannot tell the current folder")?;
    let is_repository =
        |p: &&Path| p.join("Cargo.toml").is_file() && p.join("experiments").is_dir();
    let found = here.ancestors().find(is_repository);
    Ok(found
        .unwrap_or(Path::new(env!("CARGO_MANIFEST_DIR")))
        .to_owned())
}

fn request(profile: Profile, seed: u64) -> Result<Request> {
    Ok(Request {
        root: repository()?,
        profile,
        overrides: Vec::new(),
        seed,
    })
}

fn cache(request: &Request) -> Cache {
    Cache::new(&request.root.join("data/cache"))
}

/// All work uses `threads` threads; without a number, one for each core.
fn use_threads(threads: Option<usize>) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0));
    pool.build_global().context("cannot start the threads")
}

/// A bar on stderr, if that is a terminal; `what` says in the plural what is counted.
fn progress_bar(steps: u64, what: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:20} {pos} of {len} {msg}, about {eta} left");
    ProgressBar::new(steps)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        .with_message(what.to_owned())
}

/// The program by its name, wherever it was started from, and its arguments.
fn command_line() -> Vec<String> {
    let arguments = std::env::args_os().skip(1);
    let arguments = arguments.map(|a| a.to_string_lossy().into_owned());
    std::iter::once(env!("CARGO_BIN_NAME").to_owned())
        .chain(arguments)
        .collect()
}
