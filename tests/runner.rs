//! The runner, driven by a small study of its own: resuming, damage, determinism, results folders.

use anyhow::{Result, bail};
use armpose::experiment::cache::Cache;
use armpose::experiment::claims::{Claim, Verdict};
use armpose::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use armpose::experiment::runner::Run;
use armpose::experiment::study::{Done, Profile, Report, Specification, Study};
use armpose::experiment::study_file::{self, Kind, LoadedStudy, Request};
use armpose::experiment::table::Table;
use armpose::experiment::task::{Cost, Stage, Task};
use armpose::random;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

#[derive(Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    count: usize,
    parts: usize,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BelowHalf {
    margin: f64,
}

struct Means {
    seed: u64,
    parameters: Parameters,
    claims: Vec<Claim<BelowHalf>>,
    id: String,
}

/// Draws numbers.
struct Draw {
    seed: u64,
    part: u64,
    count: usize,
}

/// The mean of what was drawn.
struct Mean(Arc<Draw>);

impl Task for Draw {
    fn stage(&self) -> Stage {
        Stage {
            name: "draw".to_owned(),
            version: 1,
        }
    }
    fn label(&self) -> String {
        format!("draw {}", self.part)
    }
    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({ "seed": self.seed, "part": self.part, "count": self.count })
    }
    fn cost(&self) -> Cost {
        Cost {
            seconds: 2.0,
            megabytes: 10.0,
        }
    }
    fn steps(&self) -> u64 {
        self.count as u64
    }
    fn run(&self, _: &[PathBuf], out: &Path, progress: armpose::Progress) -> Result<()> {
        if let Some(delay) = std::env::var_os("RUNNER_TEST_DELAY") {
            std::fs::write(out.join("half"), "half")?;
            std::thread::sleep(Duration::from_millis(delay.to_string_lossy().parse()?));
            std::fs::remove_file(out.join("half"))?;
        }
        if self.count == 13 {
            bail!("13 brings bad luck");
        }
        let bytes: Vec<u8> = (0..self.count as u64)
            .into_par_iter()
            .flat_map_iter(|i| {
                let mut stream = random::stream(self.seed, "draw", &[self.part, i]);
                progress(1);
                random::unit(&mut stream).to_le_bytes()
            })
            .collect();
        Ok(std::fs::write(out.join("numbers"), bytes)?)
    }
}

impl Task for Mean {
    fn stage(&self) -> Stage {
        Stage {
            name: "mean".to_owned(),
            version: 1,
        }
    }
    fn label(&self) -> String {
        format!("mean {}", self.0.part)
    }
    fn parameters(&self) -> serde_json::Value {
        serde_json::Value::Null
    }
    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        vec![self.0.clone()]
    }
    fn cost(&self) -> Cost {
        Cost {
            seconds: 1.0,
            megabytes: 20.0,
        }
    }
    fn run(&self, inputs: &[PathBuf], out: &Path, _: armpose::Progress) -> Result<()> {
        let bytes = std::fs::read(inputs[0].join("numbers"))?;
        let numbers = bytes.chunks_exact(8);
        let sum: f64 = numbers
            .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
            .sum();
        Ok(std::fs::write(
            out.join("mean"),
            (sum / self.0.count as f64).to_string(),
        )?)
    }
}

impl Means {
    fn parts(&self) -> Vec<Arc<Mean>> {
        let part = |part| {
            Arc::new(Mean(Arc::new(Draw {
                seed: self.seed,
                part,
                count: self.parameters.count,
            })))
        };
        (0..self.parameters.parts as u64).map(part).collect()
    }
}

impl Study for Means {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        Ok(self
            .parts()
            .into_iter()
            .map(|p| p as Arc<dyn Task>)
            .collect())
    }
    fn report(&self, done: Done) -> Result<Report> {
        let mut data = Table::new(["part", "mean"]);
        for part in self.parts() {
            let mean: f64 = std::fs::read_to_string(done(&*part)?.join("mean"))?.parse()?;
            // Not listed, and so not handed out, though it may be there.
            assert!(done(&*part.0).is_err());
            data.push([(part.0.part as usize).into(), mean.into()]);
        }
        let bars = Shape::Bars(
            (0..self.parameters.parts)
                .map(|i| (i as f64, None))
                .collect(),
        );
        let plot = Plot {
            title: String::new(),
            x: Axis::of("part", (0..self.parameters.parts).map(|i| i.to_string())),
            y: Axis::new("mean"),
            marks: vec![Mark::new("", 0, bars)],
        };
        let figure = Figure {
            title: "Means".to_owned(),
            caption: String::new(),
            panels: vec![Panel::Plot(plot)],
            columns: 1,
            size: (400, 300),
        };
        let verdict = |claim: &Claim<BelowHalf>| match &claim.test {
            Some(test) if test.margin > 0.0 => claim.result(0.25, 2, Verdict::Partly),
            _ => claim.not_checkable("no test"),
        };
        Ok(Report {
            text: data.to_text(),
            summary: data.clone(),
            data,
            tables: Vec::new(),
            figures: vec![(self.id.clone(), figure)],
            claims: self.claims.iter().map(verdict).collect(),
        })
    }
}

fn define(specification: Specification<Parameters, BelowHalf>) -> Result<Box<dyn Study>> {
    Ok(Box::new(Means {
        seed: specification.seed,
        parameters: specification.parameters,
        claims: specification.claims,
        id: specification.id,
    }))
}

const STUDY: &str = "title = 'Means'\nkind = 'means'\nquestion = 'q'\nanalysis = 'a'\n\
    paper = { section = 'V', exhibit = 'Fig. 0' }\n[parameters]\ncount = 1000\nparts = 3\n\
    [smoke]\nparts = 2\n[[claim]]\nid = 'half'\nquote = 'q'\nwhere = 'V'\nkind = 'number'\n\
    paper = 0.5\ntest = { margin = 0.1 }\n";

/// A repository with one study, and its results folder.
struct Repository(PathBuf);

impl Repository {
    fn new(folder: &Path) -> Repository {
        std::fs::create_dir_all(folder.join("experiments")).unwrap();
        std::fs::write(folder.join("experiments/means.toml"), STUDY).unwrap();
        Repository(folder.to_owned())
    }

    fn load(&self, settings: &[&str]) -> (Request, Vec<LoadedStudy>) {
        let request = Request {
            root: self.0.clone(),
            profile: Profile::Paper,
            overrides: settings.iter().map(|&s| s.to_owned()).collect(),
            seed: 1,
        };
        let kinds = [Kind::new("means", define)];
        let study = study_file::read(&kinds, &request, "means").unwrap();
        (request, vec![study])
    }

    fn cache(&self) -> Cache {
        Cache::new(&self.0.join("cache"))
    }

    fn run_to(&self, out: &Path, settings: &[&str]) -> Result<()> {
        let (request, studies) = self.load(settings);
        let run = Run {
            request: &request,
            cache: &self.cache(),
            out,
            command: &[],
        };
        run.execute(&studies, |_, _, _| Ok(()))
    }

    fn out(&self) -> PathBuf {
        self.0.join("results")
    }

    fn run(&self, settings: &[&str]) -> Result<()> {
        self.run_to(&self.out(), settings)
    }

    fn plan(&self, settings: &[&str]) -> String {
        let (request, studies) = self.load(settings);
        let run = Run {
            request: &request,
            cache: &self.cache(),
            out: Path::new("unused"),
            command: &[],
        };
        run.plan(&studies).unwrap().describe(run.cache)
    }

    /// All result files but the manifest.
    fn results(&self) -> BTreeMap<String, Vec<u8>> {
        let entries = self.out().join("means").read_dir().unwrap();
        let files = entries.map(|e| e.unwrap().path());
        let mut files: BTreeMap<String, Vec<u8>> = files
            .map(|p| {
                let name = p.file_name().unwrap().to_str().unwrap().to_owned();
                (name, std::fs::read(&p).unwrap())
            })
            .collect();
        files.remove("manifest.json").unwrap();
        files
    }

    fn manifest(&self) -> serde_json::Value {
        let text = std::fs::read(self.out().join("means/manifest.json")).unwrap();
        serde_json::from_slice(&text).unwrap()
    }

    fn cached(&self) -> Vec<bool> {
        let manifest = self.manifest();
        let tasks = manifest["tasks"].as_array().unwrap();
        tasks
            .iter()
            .map(|t| t["cached"].as_bool().unwrap())
            .collect()
    }
}

#[test]
fn a_run_leaves_results_that_its_manifest_vouches_for() {
    let folder = tempfile::tempdir().unwrap();
    let repository = Repository::new(folder.path());
    repository.run(&[]).unwrap();
    let results = repository.results();
    let names: Vec<&str> = results.keys().map(String::as_str).collect();
    assert_eq!(
        names,
        [
            "claims.json",
            "data.csv",
            "means.png",
            "means.svg",
            "summary.csv"
        ]
    );
    let manifest = repository.manifest();
    let outputs = manifest["outputs"].as_array().unwrap();
    assert_eq!(outputs.len(), 5);
    for output in outputs {
        let bytes = &results[output["name"].as_str().unwrap()];
        assert_eq!(output["blake3"], blake3::hash(bytes).to_hex().as_str());
    }
    assert_eq!(manifest["study"]["parameters"]["count"], 1000);
    assert_eq!(repository.cached(), [false; 6]);

    // Again: everything is cached.
    repository.run(&[]).unwrap();
    assert_eq!(repository.results(), results);
    assert_eq!(repository.cached(), [true; 6]);
    // What cached results were made from is not needed, and no longer told of.
    std::fs::remove_dir_all(folder.path().join("cache/draw")).unwrap();
    repository.run(&[]).unwrap();
    assert_eq!(repository.results(), results);
    assert_eq!(repository.cached(), [true; 3]);
    assert_eq!(
        repository.out().read_dir().unwrap().count(),
        1,
        "something is left over"
    );
}

#[test]
fn the_plan_says_what_runs_and_why() {
    let folder = tempfile::tempdir().unwrap();
    let repository = Repository::new(folder.path());
    let plan = repository.plan(&[]);
    assert!(
        plan.contains("draw 0  to run  2.0 s, 10 MB  nothing like it yet"),
        "{plan}"
    );
    assert!(
        plan.ends_with("6 to run, 0 cached; about 9.0 s and 20 MB\n"),
        "{plan}"
    );
    assert!(!folder.path().join("cache").exists());
    repository.run(&[]).unwrap();
    let plan = repository.plan(&[]);
    assert!(
        plan.ends_with("0 to run, 3 cached; about 0.0 s and 0 MB\n"),
        "{plan}"
    );
    let plan = repository.plan(&["count=999", "parts=1"]);
    assert!(
        plan.contains("draw 0  to run  2.0 s, 10 MB  count 1000 -> 999\n"),
        "{plan}"
    );
    assert!(
        plan.contains("mean 0  to run  1.0 s, 20 MB  input draw 0 changed\n"),
        "{plan}"
    );
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let results = [1, 2, 5].map(|threads| {
        let folder = tempfile::tempdir().unwrap();
        let repository = Repository::new(folder.path());
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| repository.run(&[])).unwrap();
        repository.results()
    });
    assert_eq!(results[0], results[1]);
    assert_eq!(results[0], results[2]);
}

/// This is the process that the next test kills.
#[test]
fn child_to_be_killed() {
    if let Some(folder) = std::env::var_os("RUNNER_TEST_FOLDER") {
        Repository::new(Path::new(&folder)).run(&[]).unwrap();
    }
}

#[test]
fn a_killed_run_goes_on_where_it_was_and_ends_with_the_same_bits() {
    let undisturbed = tempfile::tempdir().unwrap();
    let undisturbed = Repository::new(undisturbed.path());
    undisturbed.run(&[]).unwrap();

    let folder = tempfile::tempdir().unwrap();
    let repository = Repository::new(folder.path());
    let stage = folder.path().join("cache/draw");
    let count = |hidden: bool| {
        let entries = stage.read_dir().into_iter().flatten().flatten();
        let folders = entries.filter(|e| e.path().is_dir());
        let names = folders.map(|e| e.file_name().to_string_lossy().into_owned());
        names.filter(|n| n.starts_with('.') == hidden).count()
    };
    let mut child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "child_to_be_killed"])
        .env("RUNNER_TEST_FOLDER", folder.path())
        .env("RUNNER_TEST_DELAY", "400")
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    // In the middle of the second drawing.
    for _ in 0..2000 {
        if count(false) == 1 && count(true) == 1 {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!((count(false), count(true)), (1, 1));
    assert!(!repository.out().join("means").exists());

    repository.run(&[]).unwrap();
    assert_eq!(repository.results(), undisturbed.results());
    // The first mean, the other two and what they are of, and what the first is of.
    assert_eq!(
        repository.cached(),
        [true, false, false, false, false, true]
    );
    assert_eq!((count(false), count(true)), (3, 0));
}

#[test]
fn a_damaged_cache_file_is_reported_and_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let repository = Repository::new(folder.path());
    repository.run(&[]).unwrap();
    let results = repository.results();
    let mut means = folder
        .path()
        .join("cache/mean")
        .read_dir()
        .unwrap()
        .flatten();
    let damaged = means
        .find(|e| e.path().is_dir())
        .unwrap()
        .path()
        .join("mean");
    std::fs::write(&damaged, "0.1").unwrap();
    let expected = format!("{} has 3 bytes instead of", damaged.display());
    assert!(repository.plan(&[]).contains(&expected));
    repository.run(&[]).unwrap();
    assert_eq!(repository.results(), results);
    assert_eq!(repository.cached().iter().filter(|c| !**c).count(), 1);
    assert_ne!(std::fs::read_to_string(&damaged).unwrap(), "0.1");
}

#[test]
fn a_folder_that_cannot_be_written_is_found_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let repository = Repository::new(folder.path());
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let error = repository.run_to(&file, &[]).unwrap_err();
    let expected = format!("cannot write into the results folder {}", file.display());
    assert!(format!("{error:#}").starts_with(&expected), "{error:#}");
    assert!(!folder.path().join("cache").exists());

    std::fs::write(folder.path().join("cache"), "").unwrap();
    let error = format!("{:#}", repository.run(&[]).unwrap_err());
    assert!(
        error.starts_with("cannot write ") && error.contains("cache"),
        "{error}"
    );
}

#[test]
fn a_task_that_fails_leaves_the_old_results_alone() {
    let folder = tempfile::tempdir().unwrap();
    let repository = Repository::new(folder.path());
    repository.run(&[]).unwrap();
    let results = repository.results();
    let error = repository.run(&["count=13"]).unwrap_err();
    assert_eq!(format!("{error:#}"), "draw 0: 13 brings bad luck");
    assert_eq!(repository.results(), results);
}
