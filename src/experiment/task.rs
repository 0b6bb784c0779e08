//! A task: a unit of work whose result is worth keeping in the [cache](super::cache).

use anyhow::Context;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A stage of the work, such as "data-set". Raise `version` whenever the code changes what comes
/// out, so that older cache entries are not taken for the new result.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stage {
    /// Also the name of a folder: lower case and hyphens.
    pub name: String,
    pub version: u32,
}

/// What a task is expected to need: wall-clock seconds on two cores, and peak megabytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost {
    pub seconds: f64,
    pub megabytes: f64,
}

/// Turns the results of its inputs into a folder of files, always into the same bytes.
pub trait Task: Send + Sync {
    fn stage(&self) -> Stage;

    /// What people call it, for example "forest, MSE, fold 3".
    fn label(&self) -> String;

    /// Everything the result depends on apart from [`inputs`](Task::inputs) and
    /// [`files`](Task::files): settings and seeds, but no paths of this machine.
    fn parameters(&self) -> serde_json::Value;

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        Vec::new()
    }

    /// Source files whose contents the result depends on. A folder stands for all files below it.
    fn files(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    fn cost(&self) -> Cost;

    /// The sum of what [`run`](Task::run) reports to its progress; 0 when it reports nothing.
    fn steps(&self) -> u64 {
        0
    }

    /// Writes the result into the empty folder `out`. `inputs` are the folders of the inputs'
    /// results, in their order.
    fn run(
        &self,
        inputs: &[PathBuf],
        out: &Path,
        progress: crate::Progress<'_>,
    ) -> anyhow::Result<()>;
}

/// Reads what a task, a study or the report wrote.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    let shown = || format!("cannot read {}", path.display());
    let text = std::fs::read_to_string(path).with_context(shown)?;
    serde_json::from_str(&text).with_context(shown)
}
