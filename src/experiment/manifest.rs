//! `manifest.json`: how results came about. Times and machines stand here, and nowhere else but in
//! the results of studies that measure time.

use super::figure::Figure;
use super::plan::TaskRecord;
use super::recipe::Hash;
use super::runner::Run;
use super::study::Report;
use super::study_file::LoadedStudy;
use anyhow::{Context, Result};
use serde::Serialize;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

const FORMAT: u32 = 1;

/// How the results of a study came about: `manifest.json`.
#[derive(Debug, Serialize)]
pub struct Manifest {
    format: u32,
    id: String,
    profile: &'static str,
    command: Vec<String>,
    study: Study,
    seed: u64,
    threads: usize,
    machine: Machine,
    /// UTC.
    started: String,
    wall_seconds: f64,
    /// Of the whole process so far.
    peak_megabytes: Option<f64>,
    tasks: Vec<TaskRecord>,
    outputs: Vec<Output>,
    figures: Vec<Caption>,
}

#[derive(Debug, Serialize)]
struct Study {
    file: String,
    /// Of the file.
    blake3: Hash,
    settings: Vec<String>,
    /// With profile and settings applied.
    parameters: toml::Table,
    parameters_blake3: Hash,
}

/// A file of the results.
#[derive(Debug, Serialize)]
pub struct Output {
    pub name: String,
    pub bytes: usize,
    pub blake3: Hash,
}

/// What the pictures show, for those who cannot see them.
#[derive(Debug, Serialize)]
struct Caption {
    /// Of the files, without extension.
    name: String,
    title: String,
    caption: String,
}

/// The program and what it runs on. Unknown things are null.
#[derive(Debug, Clone, Serialize)]
pub struct Machine {
    git_revision: Option<String>,
    /// Whether files other than results differ from the revision.
    git_dirty: Option<bool>,
    cargo_lock_blake3: Option<Hash>,
    rustc: &'static str,
    target: &'static str,
    cpu: Option<String>,
    cores: Option<usize>,
    memory_megabytes: Option<f64>,
}

impl Machine {
    pub fn inspect(root: &Path) -> Machine {
        let git = |arguments: &[&str]| {
            let output = Command::new("git")
                .arg("-C")
                .arg(root)
                .args(arguments)
                .output()
                .ok()?;
            let text = String::from_utf8_lossy(&output.stdout).trim().to_owned();
            output.status.success().then_some(text)
        };
        Machine {
            git_revision: git(&["rev-parse", "HEAD"]),
            git_dirty: git(&["status", "--porcelain", "--", ".", ":!results"])
                .map(|changes| !changes.is_empty()),
            cargo_lock_blake3: Hash::of_file(&root.join("Cargo.lock")).ok(),
            rustc: env!("ARMPOSE_RUSTC"),
            target: env!("ARMPOSE_TARGET"),
            cpu: field("/proc/cpuinfo", "model name"),
            cores: std::thread::available_parallelism().ok().map(usize::from),
            memory_megabytes: field("/proc/meminfo", "MemTotal").and_then(|t| megabytes(&t)),
        }
    }
}

impl Manifest {
    pub fn new(
        run: &Run,
        study: &LoadedStudy,
        machine: &Machine,
        (started, wall): (SystemTime, Duration),
        tasks: Vec<TaskRecord>,
        outputs: Vec<Output>,
        report: &Report,
    ) -> Result<Manifest> {
        let caption = |(name, figure): &(String, Figure)| Caption {
            name: name.clone(),
            title: figure.title.clone(),
            caption: figure.caption.clone(),
        };
        let path = run.request.root.join(&study.file);
        let blake3 = Hash::of_file(&path);
        Ok(Manifest {
            format: FORMAT,
            id: study.id.clone(),
            profile: run.request.profile.name(),
            command: run.command.to_vec(),
            study: Study {
                file: study.file.display().to_string(),
                blake3: blake3.with_context(|| format!("cannot read {}", path.display()))?,
                settings: run.request.overrides.clone(),
                parameters_blake3: Hash::of(toml::to_string(&study.parameters)?.as_bytes()),
                parameters: study.parameters.clone(),
            },
            seed: run.request.seed,
            threads: rayon::current_num_threads(),
            machine: machine.clone(),
            started: utc(started),
            wall_seconds: wall.as_secs_f64(),
            peak_megabytes: field("/proc/self/status", "VmHWM").and_then(|t| megabytes(&t)),
            tasks,
            outputs,
            figures: report.figures.iter().map(caption).collect(),
        })
    }
}

/// What a measured time depends on besides the work: the processor, the threads, and this very
/// program.
pub fn timing_conditions() -> serde_json::Value {
    let program = std::env::current_exe().and_then(|path| Hash::of_file(&path));
    serde_json::json!({
        "cpu": field("/proc/cpuinfo", "model name"),
        "threads": rayon::current_num_threads(),
        "program": program.ok(),
    })
}

/// The first value of `name` in a file of lines `name : value`.
fn field(path: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let mut fields = text.lines().filter_map(|line| line.split_once(':'));
    let (_, value) = fields.find(|(key, _)| key.trim() == name)?;
    Some(value.trim().to_owned())
}

/// Of a text such as `8123456 kB`.
fn megabytes(text: &str) -> Option<f64> {
    let kilobytes: f64 = text.strip_suffix("kB")?.trim().parse().ok()?;
    Some((kilobytes / 1024.0).round())
}

/// As `2016-05-16T09:30:00Z`.
fn utc(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let (mut days, clock) = (seconds / 86400, seconds % 86400);
    let is_leap = |y: u64| y.is_multiple_of(4) && (!y.is_multiple_of(100) || y.is_multiple_of(400));
    let mut year = 1970;
    while days >= 365 + u64::from(is_leap(year)) {
        days -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let february = 28 + u64::from(is_leap(year));
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30] {
        if days < length {
            break;
        }
        days -= length;
        month += 1;
    }
    let (hour, minute, second) = (clock / 3600, clock / 60 % 60, clock % 60);
    format!(
        "{year}-{month:02}-{:02}T{hour:02}:{minute:02}:{second:02}Z",
        days + 1
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_right() {
        let at = |seconds| utc(UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(at(0), "1970-01-01T00:00:00Z");
        assert_eq!(at(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(at(1_463_391_000), "2016-05-16T09:30:00Z");
        assert_eq!(at(1_483_228_799), "2016-12-31T23:59:59Z");
    }
}
