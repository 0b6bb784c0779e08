//! Studies of the paper: what they ask for, running and caching their work, and what came out.
//!
//! # Adding a study
//! Write `experiments/<id>.toml`; its parts are those of [`study_file`]. If no kind fits, write a new one
//! in `studies/<kind>.rs`: a `Parameters` struct (serde, `deny_unknown_fields`), a struct for what
//! the tests of claims need, a type that implements [`study::Study`], and a function
//! `define(Specification<Parameters, Test>) -> Result<Box<dyn Study>>`. Then add one line to
//! [`kinds`]. A profile or `--set` can only override what the parameters have: give optional ones a
//! default instead of an `Option`.
//!
//! # Adding a task
//! Implement [`task::Task`] in `tasks/<name>.rs`. The runner hands it the folders of its inputs and an
//! empty folder to write into; [`cache`] does the rest. When the code changes what comes out, raise
//! the version in its [`task::Stage`].

pub mod bounds;
pub mod cache;
pub mod claims;
pub mod comparison;
pub mod figure;
pub mod manifest;
pub mod plan;
pub mod progress;
pub mod protocol;
pub mod recipe;
pub mod report;
pub mod runner;
pub mod statistics;
pub mod studies;
pub mod study;
pub mod study_file;
pub mod table;
pub mod task;
pub mod tasks;

use std::path::{Path, PathBuf};

/// The folder of data that is too large or not ours to be in the repository: `ARMPOSE_SHARED`, or else
/// `shared` beside the repository. It need not be there.
pub fn shared(root: &Path) -> PathBuf {
    std::env::var_os("ARMPOSE_SHARED").map_or_else(|| root.join("../shared"), PathBuf::from)
}

/// Every kind of study.
pub fn kinds() -> Vec<study_file::Kind> {
    use studies::*;
    vec![
        study_file::Kind::new("confidence", confidence::define),
        study_file::Kind::new("cross-validation", cross_validation::define),
        study_file::Kind::new("learning-curve", learning_curve::define),
        study_file::Kind::new("map-quality", map_quality::define),
        study_file::Kind::new("metric-example", metric_example::define),
        study_file::Kind::new("part-baseline", part_baseline::angles::define),
        study_file::Kind::new("part-classes", part_baseline::parts::define),
        study_file::Kind::new("part-tuning", tuning::parts::define),
        study_file::Kind::new("pose-map", pose_map::define),
        study_file::Kind::new("pipeline", pictures::pipeline::define),
        study_file::Kind::new("pixel-estimates", pictures::estimates::define),
        study_file::Kind::new("real-images", real_images::define),
        study_file::Kind::new("runtime", part_baseline::runtime::define),
        study_file::Kind::new("segmentation", segmentation::scores::define),
        study_file::Kind::new("segmentation-images", segmentation::gallery::define),
        study_file::Kind::new("sensor", sensor::define),
        study_file::Kind::new("sets", sets::define),
        study_file::Kind::new("speed", speed::define),
        study_file::Kind::new("threshold-sweep", threshold_sweep::define),
        study_file::Kind::new("training-time", training_time::define),
        study_file::Kind::new("tuning", tuning::forest::define),
        study_file::Kind::new("wsc-example", wsc_example::define),
    ]
}
