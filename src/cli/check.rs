//! `armpose check`: our own results against their bounds.

use super::{request, say};
use anyhow::{Context, Result, ensure};
use armpose::experiment::bounds::{self, StudyBounds};
use armpose::experiment::study::Profile;
use armpose::experiment::{kinds, study_file};
use armpose::strict_toml;
use std::collections::BTreeMap;
use std::process::ExitCode;

/// Check that results lie within the bounds of tests/bounds/<PROFILE>.toml
#[derive(clap::Args)]
pub struct Arguments {
    /// Which results
    #[arg(long, value_enum, default_value = "smoke")]
    profile: Profile,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let request = request(arguments.profile, 1)?;
    let profile = arguments.profile.name();
    let file = bounds::file(&request.root, profile);
    let all: BTreeMap<String, StudyBounds> = strict_toml::read(&file).with_context(|| {
        format!("no bounds to check against (`armpose bounds --profile {profile}` makes them)")
    })?;
    ensure!(!all.is_empty(), "{} holds no bounds", file.display());
    let kinds = kinds();
    let mut all_hold = true;
    for (id, bounds) in &all {
        let study = study_file::read(&kinds, &request, id)?;
        let summary = request
            .root
            .join(format!("results/{profile}/{id}/summary.csv"));
        let values = bounds::values(&summary, &study.bounds).with_context(|| {
            format!("no results to check; run `armpose experiment all --profile {profile}`")
        })?;
        let (text, holds) = bounds::judge(id, bounds, &values);
        say(&text)?;
        all_hold &= holds;
    }
    Ok(ExitCode::from(u8::from(!all_hold)))
}
