//! `armpose bounds`: make the bounds that `armpose check` holds.

use super::{cache, command_line, request, say, use_threads};
use anyhow::{Context, Result, bail};
use armpose::experiment::bounds::{self, StudyBounds};
use armpose::experiment::kinds;
use armpose::experiment::runner::Run;
use armpose::experiment::study::Profile;
use armpose::experiment::study_file::{self, LoadedStudy, Request};
use std::collections::BTreeMap;
use std::process::ExitCode;

/// Write the bounds that `check` holds
///
/// Runs studies with several seeds and writes tests/bounds/<PROFILE>.toml: for each number, the mean
/// and a margin of four standard deviations. With --as-it-is nothing runs: each number of results/<PROFILE>
/// may be off by a hundredth of it.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// The studies that the file holds; by default all that say what is to be bounded
    studies: Vec<String>,
    /// Which sizes
    #[arg(long, value_enum, default_value = "smoke")]
    profile: Profile,
    /// How many seeds, beginning with 1
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u64).range(10..))]
    seeds: u64,
    /// Take the results that are there
    #[arg(long, conflicts_with = "seeds")]
    as_it_is: bool,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    use_threads(None)?;
    let profile = arguments.profile.name();
    let root = request(arguments.profile, 1)?.root;
    let (made_by, all) = match arguments.as_it_is {
        true => ("each number\n# give or take a hundredth", found(arguments)?),
        false => (
            "mean and four standard\n# deviations over the seeds",
            calibrated(arguments)?,
        ),
    };
    let command = command_line().join(" ");
    let text = format!(
        "# Written by `{command}`: {made_by}.\n\n{}",
        toml::to_string(&all)?
    );
    let file = bounds::file(&root, profile);
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot write {}", folder.display()))?;
    }
    std::fs::write(&file, text).with_context(|| format!("cannot write {}", file.display()))?;
    say(&format!("wrote {}\n", file.display()))?;
    Ok(ExitCode::SUCCESS)
}

/// The studies that are asked for, by a request, and what of them is to be bounded.
fn studies(arguments: &Arguments, request: &Request) -> Result<Vec<LoadedStudy>> {
    let kinds = kinds();
    let all = study_file::ids(&request.root)?;
    let asked = &arguments.studies;
    let ids = if asked.is_empty() { &all } else { asked };
    let mut studies = Vec::new();
    for id in ids {
        let study = study_file::read(&kinds, request, id)?;
        if !study.bounds.columns.is_empty() {
            studies.push(study);
        } else if !asked.is_empty() {
            bail!("study {id} does not say what is to be bounded; give its file a [bounds]");
        }
    }
    Ok(studies)
}

/// Bounds from runs with several seeds.
fn calibrated(arguments: &Arguments) -> Result<BTreeMap<String, StudyBounds>> {
    let mut runs: BTreeMap<String, Vec<BTreeMap<String, f64>>> = BTreeMap::new();
    for seed in 1..=arguments.seeds {
        let request = request(arguments.profile, seed)?;
        let name = format!("results/bounds/{}-{seed}", arguments.profile.name());
        let run = Run {
            request: &request,
            cache: &cache(&request),
            out: &request.root.join(name),
            command: &command_line(),
        };
        run.execute(&studies(arguments, &request)?, |study, _, folder| {
            let values = bounds::values(&folder.join("summary.csv"), &study.bounds)?;
            runs.entry(study.id.clone()).or_default().push(values);
            say(&format!("seed {seed}: {}\n", study.id))
        })?;
    }
    let bounds = runs.into_iter().map(|(id, runs)| {
        let bounds = bounds::calibrate(&runs).with_context(|| id.clone())?;
        Ok((id, bounds))
    });
    bounds.collect()
}

/// Bounds around the results that are there.
fn found(arguments: &Arguments) -> Result<BTreeMap<String, StudyBounds>> {
    let request = request(arguments.profile, 1)?;
    let bounds = studies(arguments, &request)?.into_iter().map(|study| {
        let folder = format!("results/{}/{}", arguments.profile.name(), study.id);
        let summary = request.root.join(folder).join("summary.csv");
        let values = bounds::values(&summary, &study.bounds)?;
        let bounds = bounds::around(&values).with_context(|| study.id.clone())?;
        Ok((study.id, bounds))
    });
    bounds.collect()
}
