//! `armpose bounds`: calibrate the bounds that `armpose check` holds.

use super::{cache, command_line, request, say, use_threads};
use anyhow::{Context, Result};
use armpose::experiment::bounds::{self, StudyBounds};
use armpose::experiment::runner::Run;
use armpose::experiment::study::Profile;
use armpose::experiment::{kinds, study_file};
use std::collections::BTreeMap;
use std::process::ExitCode;

/// Write the bounds that `check` holds, from runs with several seeds
///
/// Runs all studies with each seed and writes tests/bounds/<PROFILE>.toml: for each number, the mean
/// and a margin of four standard deviations.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Which sizes
    #[arg(long, value_enum, default_value = "smoke")]
    profile: Profile,
    /// How many seeds, beginning with 1
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u64).range(10..))]
    seeds: u64,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    use_threads(None)?;
    let profile = arguments.profile.name();
    let kinds = kinds();
    let root = request(arguments.profile, 1)?.root;
    let mut runs: BTreeMap<String, Vec<BTreeMap<String, f64>>> = BTreeMap::new();
    for seed in 1..=arguments.seeds {
        let request = request(arguments.profile, seed)?;
        let mut studies = Vec::new();
        for id in study_file::ids(&root)? {
            let study = study_file::read(&kinds, &request, &id)?;
            if !study.bounds.columns.is_empty() {
                studies.push(study);
            }
        }
        let run = Run {
            request: &request,
            cache: &cache(&request),
            out: &root.join(format!("results/bounds/{profile}-{seed}")),
            command: &command_line(),
        };
        run.execute(&studies, |study, _, folder| {
            let values = bounds::values(&folder.join("summary.csv"), &study.bounds)?;
            runs.entry(study.id.clone()).or_default().push(values);
            say(&format!("seed {seed}: {}\n", study.id))
        })?;
    }
    let mut all: BTreeMap<String, StudyBounds> = BTreeMap::new();
    for (id, runs) in &runs {
        all.insert(
            id.clone(),
            bounds::calibrate(runs).with_context(|| id.clone())?,
        );
    }
    let seeds = arguments.seeds;
    let text = format!(
        "# Written by `armpose bounds --profile {profile} --seeds {seeds}`: mean and four standard\n\
         # deviations over the seeds.\n\n{}",
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
