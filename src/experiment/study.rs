//! Studies: what a kind of study makes of a specification, first tasks and then a report.

use super::claims::{Claim, ClaimResult};
use super::figure::Figure;
use super::table::Table;
use super::task::Task;
use anyhow::Result;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// What a study kind makes of a study file: first the work to be done, then what came out.
pub trait Study {
    /// The tasks whose results the report reads. Their inputs follow from them.
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>>;

    /// What must be there and is not, as a sentence: the study is skipped.
    fn missing(&self) -> Option<String> {
        None
    }

    /// Called when all tasks are done. The same results give the same report, to the last bit.
    fn report(&self, done: Done<'_>) -> Result<Report>;
}

/// The folder that holds a finished task's result.
pub type Done<'a> = &'a dyn Fn(&dyn Task) -> Result<PathBuf>;

/// What came out of a study.
#[derive(Debug, Clone)]
pub struct Report {
    /// Raw and tidy: one row for each observation. `data.csv`.
    pub data: Table,
    /// One row for each condition. `summary.csv`.
    pub summary: Table,
    /// Names and tables of what else is worth reading: `<name>.csv`.
    pub tables: Vec<(String, Table)>,
    /// Names and figures. The first is named like the study; of others that hold nothing but images there
    /// is only a PNG, since an SVG would hold the same pixels.
    pub figures: Vec<(String, Figure)>,
    /// `claims.json`.
    pub claims: Vec<ClaimResult>,
    /// The table that is printed in the terminal.
    pub text: String,
}

/// A study file, for one profile, as its kind receives it.
pub struct Specification<P, T> {
    /// The name of the file without `.toml`.
    pub id: String,
    pub title: String,
    /// The repository.
    pub root: PathBuf,
    pub profile: Profile,
    /// The master seed.
    pub seed: u64,
    pub parameters: P,
    pub claims: Vec<Claim<T>>,
}

/// Which sizes a study runs at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Profile {
    /// Seconds: everything runs once, on tiny data.
    Smoke,
    /// Minutes: the shape of the result shows.
    Quick,
    /// The sizes of the paper.
    Paper,
}

impl Profile {
    /// As files and folders call it.
    pub fn name(self) -> &'static str {
        match self {
            Profile::Smoke => "smoke",
            Profile::Quick => "quick",
            Profile::Paper => "paper",
        }
    }
}

/// Where the paper shows what the study reproduces.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PaperPlace {
    /// "V-A"
    pub section: String,
    /// "Fig. 9"
    pub exhibit: String,
}

/// Which numbers of `summary.csv` the [bounds](super::bounds) hold.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BoundedColumns {
    /// The columns that together name a row.
    pub key: Vec<String>,
    /// The columns with the numbers.
    pub columns: Vec<String>,
}

/// Makes a study of its specification, and refuses parameters that make no sense.
pub type Define<P, T> = fn(Specification<P, T>) -> Result<Box<dyn Study>>;
