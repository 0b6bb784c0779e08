//! `armpose experiment`: list, show and run studies.

use super::{cache, command_line, repository, request, say, use_threads};
use anyhow::{Context, Result, bail};
use armpose::experiment::claims::{ClaimResult, Verdict};
use armpose::experiment::comparison::{Numbers, spread};
use armpose::experiment::kinds;
use armpose::experiment::runner::Run;
use armpose::experiment::study::{Profile, Report};
use armpose::experiment::study_file::{self, LoadedStudy, Request};
use armpose::experiment::table::Table;
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Run, list or show the studies of the paper
///
/// Work that was done before is taken from data/cache. A run that was stopped goes on where it was.
/// For each study, results/<PROFILE>/<STUDY>/ holds data, tables, figures, the verdicts on the
/// paper's claims, and a manifest of how they came about.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
#[command(override_usage = "armpose experiment [OPTIONS] <STUDY>...\n       \
    armpose experiment [OPTIONS] all\n       \
    armpose experiment list\n       \
    armpose experiment show <STUDY>...")]
pub struct Arguments {
    /// Names of studies, or `all`, or `list`, or `show` and names
    #[arg(required = true, value_name = "STUDY")]
    words: Vec<String>,
    /// How much data: seconds, minutes, or the sizes of the paper
    #[arg(long, value_enum, default_value = "paper")]
    profile: Profile,
    /// Print what would run, what is cached and why not, and run nothing
    #[arg(long)]
    plan: bool,
    /// Change a parameter of the study, such as `protocol.images=100`; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Threads to use; the results do not depend on it [default: one for each core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Master seed of all random choices
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Run with each seed from FIRST to LAST; the spread of every number goes to <STUDY>-spread.csv
    #[arg(long, value_name = "FIRST..LAST", value_parser = seeds, conflicts_with_all = ["seed", "plan"])]
    seeds: Option<RangeInclusive<u64>>,
    /// Where the results go [default: results/<PROFILE>, or results/custom with --set or --seed, or
    /// results/seeds with --seeds]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let request = Request {
        overrides: arguments.set.clone(),
        ..request(arguments.profile, arguments.seed)?
    };
    let words: Vec<&str> = arguments.words.iter().map(String::as_str).collect();
    match words[..] {
        ["list"] => list(&request)?,
        ["list" | "all", _, ..] => bail!("`{}` stands alone, without names of studies", words[0]),
        ["show"] => bail!("which study? `armpose experiment list` shows all"),
        ["show", ref ids @ ..] => {
            for study in read(&request, ids)? {
                say(&show(&study)?)?;
            }
        }
        ["all"] => {
            let ids = study_file::ids(&request.root)?;
            let ids: Vec<&str> = ids.iter().map(String::as_str).collect();
            execute(arguments, &request, &ids)?;
        }
        ref ids => execute(arguments, &request, ids)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn read(request: &Request, ids: &[&str]) -> Result<Vec<LoadedStudy>> {
    let kinds = kinds();
    ids.iter()
        .map(|id| study_file::read(&kinds, request, id))
        .collect()
}

/// As `1..10`, both ends included.
fn seeds(text: &str) -> Result<RangeInclusive<u64>, String> {
    let ends = text.split_once("..");
    let ends = ends.and_then(|(first, last)| Some((first.parse().ok()?, last.parse().ok()?)));
    match ends {
        Some((first, last)) if first < last => Ok(first..=last),
        _ => Err("give the first and the last seed, such as 1..10".to_owned()),
    }
}

/// Runs the studies with each seed, each into a folder of its own, and tells how much they differ.
fn execute_with_seeds(
    arguments: &Arguments,
    request: &Request,
    ids: &[&str],
    seeds: RangeInclusive<u64>,
) -> Result<()> {
    use_threads(arguments.threads.map(usize::from))?;
    let default = || request.root.join("results/seeds");
    let out = arguments.out.clone().unwrap_or_else(default);
    let mut runs: BTreeMap<String, Vec<Numbers>> = BTreeMap::new();
    for seed in seeds {
        let request = Request {
            seed,
            ..request.clone()
        };
        let run = Run {
            request: &request,
            cache: &cache(&request),
            out: &out.join(seed.to_string()),
            command: &command_line(),
        };
        run.execute(&read(&request, ids)?, |study, _, folder| {
            let numbers = Numbers::read(&folder.join("summary.csv"))?;
            runs.entry(study.id.clone()).or_default().push(numbers);
            say(&format!("seed {seed}: {}\n", study.id))
        })?;
    }
    for (id, runs) in &runs {
        let (table, file) = (spread(runs), out.join(format!("{id}-spread.csv")));
        std::fs::write(&file, table.to_csv())
            .with_context(|| format!("cannot write {}", file.display()))?;
        say(&format!(
            "\n{id}\n{}\n{}\n",
            table.to_text(),
            file.display()
        ))?;
    }
    Ok(())
}

fn execute(arguments: &Arguments, request: &Request, ids: &[&str]) -> Result<()> {
    if let Some(seeds) = arguments.seeds.clone() {
        return execute_with_seeds(arguments, request, ids, seeds);
    }
    use_threads(arguments.threads.map(usize::from))?;
    let studies = read(request, ids)?;
    let is_custom = !request.overrides.is_empty() || request.seed != 1;
    let folder = if is_custom {
        "custom"
    } else {
        request.profile.name()
    };
    let default = || request.root.join("results").join(folder);
    let run = Run {
        request,
        cache: &cache(request),
        out: &arguments.out.clone().unwrap_or_else(default),
        command: &command_line(),
    };
    if arguments.plan {
        return say(&run.plan(&studies)?.describe(run.cache));
    }
    run.execute(&studies, |study, report, folder| {
        say(&describe(request, study, report, folder))
    })
}

/// What is printed when a study is done.
fn describe(request: &Request, study: &LoadedStudy, report: &Report, folder: &Path) -> String {
    let here = std::env::current_dir().unwrap_or_default();
    let folder = folder.strip_prefix(&here).unwrap_or(folder);
    let profile = request.profile.name();
    let mut text = format!("\n{}, profile {profile}: {}\n", study.id, study.title);
    text.push_str(&format!("\n{}\n", report.text.trim_end()));
    text.push_str(&format!("\n{}\n", study.analysis.trim()));
    for claim in &report.claims {
        text.push_str(&format!(
            "\nclaim {} ({}, n = {}): {}\n  paper: {}\n  ours: {}\n",
            claim.id, claim.place, claim.n, claim.verdict, claim.paper, claim.ours
        ));
    }
    text.push_str(&format!("\nresults: {}\n", folder.display()));
    for (name, _) in &report.figures {
        let figure = folder.join(format!("{name}.png"));
        text.push_str(&format!("figure: {}\n", figure.display()));
    }
    text
}

fn show(study: &LoadedStudy) -> Result<String> {
    Ok(format!(
        "{}: {}\npaper: section {}\nexhibit: {}\nkind: {}\nfile: {}\n\n{}\n\n{}\n\n{}\n",
        study.id,
        study.title,
        study.paper.section,
        study.paper.exhibit,
        study.kind,
        study.file.display(),
        study.question.trim(),
        study.analysis.trim(),
        toml::to_string(&study.parameters)?,
    ))
}

fn list(request: &Request) -> Result<()> {
    let ids = study_file::ids(&request.root)?;
    let ids: Vec<&str> = ids.iter().map(String::as_str).collect();
    let mut table = Table::new(["study", "paper", "title", "reproduced"]);
    for study in read(request, &ids)? {
        table.push([
            study.id.as_str().into(),
            study.paper.exhibit.into(),
            study.title.into(),
            verdicts(&study.id)?.into(),
        ]);
    }
    say(&table.to_text())
}

/// How many of the paper's claims were reproduced at the paper's scale, as "2 of 3".
fn verdicts(id: &str) -> Result<String> {
    let path = repository()?
        .join("results/paper")
        .join(id)
        .join("claims.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        return Ok("not run".to_owned());
    };
    let Ok(claims) = serde_json::from_str::<Vec<ClaimResult>>(&text) else {
        return Ok("unreadable".to_owned());
    };
    let is_reproduced = |claim: &&ClaimResult| claim.verdict == Verdict::Reproduced;
    let reproduced = claims.iter().filter(is_reproduced).count();
    Ok(format!("{reproduced} of {}", claims.len()))
}
