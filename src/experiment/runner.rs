//! Runs studies: plan, work, report, results folder.

use super::cache::Cache;
use super::manifest::{Machine, Manifest, Output};
use super::plan::Plan;
use super::progress::Display;
use super::recipe::{Cook, Hash, Key};
use super::study::Report;
use super::study_file::{LoadedStudy, Request};
use super::task::Task;
use anyhow::{Context, Result, ensure};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

/// Where the results go and how the run was asked for.
pub struct Run<'a> {
    pub request: &'a Request,
    pub cache: &'a Cache,
    /// Each study gets a folder of its own in here.
    pub out: &'a Path,
    /// As typed, for the manifest.
    pub command: &'a [String],
}

impl Run<'_> {
    /// What it takes to run the studies.
    pub fn plan(&self, studies: &[LoadedStudy]) -> Result<Plan> {
        self.plan_with(&Cook::new(&self.request.root), studies)
    }

    /// The keys of everything in the cache that the studies use.
    pub fn keys(&self, studies: &[LoadedStudy]) -> Result<BTreeSet<Key>> {
        let tasks = self.all_tasks(studies)?;
        Plan::keys(&tasks, &Cook::new(&self.request.root))
    }

    fn plan_with(&self, cook: &Cook, studies: &[LoadedStudy]) -> Result<Plan> {
        Plan::new(&self.all_tasks(studies)?, cook, self.cache)
    }

    fn all_tasks(&self, studies: &[LoadedStudy]) -> Result<Vec<Arc<dyn Task>>> {
        let mut tasks = Vec::new();
        for study in studies.iter().filter(|s| s.study.missing().is_none()) {
            tasks.extend(self.tasks(study)?);
        }
        Ok(tasks)
    }

    fn tasks(&self, study: &LoadedStudy) -> Result<Vec<Arc<dyn Task>>> {
        let tasks = study.study.tasks();
        tasks.with_context(|| study.file.display().to_string())
    }

    /// Runs the studies one after the other. `finished` is told of each, with its results folder.
    /// Finds out that a folder cannot be written before any work starts.
    pub fn execute(
        &self,
        studies: &[LoadedStudy],
        mut finished: impl FnMut(&LoadedStudy, &Report, &Path) -> Result<()>,
    ) -> Result<()> {
        check_writable(self.out)?;
        self.cache.check_writable()?;
        self.cache.sweep()?;
        let cook = Cook::new(&self.request.root);
        let plan = self.plan_with(&cook, studies)?;
        let machine = Machine::inspect(&self.request.root);
        let display = Display::new(plan.seconds());
        for damage in plan.damages() {
            display.print(&format!("warning: {damage}; this result is made again"));
        }
        for study in studies {
            if let Some(missing) = study.study.missing() {
                display.print(&format!("{}: skipped: {missing}", study.id));
                continue;
            }
            let (started, clock) = (SystemTime::now(), Instant::now());
            let plan = self.plan_with(&cook, std::slice::from_ref(study))?;
            let tasks = plan.execute(self.cache, &display)?;
            let mut listed = BTreeSet::new();
            for task in self.tasks(study)? {
                listed.insert(cook.recipe(&*task)?.key());
            }
            let done = |task: &dyn Task| {
                let key = cook.recipe(task)?.key();
                ensure!(
                    listed.contains(&key),
                    "the study does not list the task `{}`",
                    task.label()
                );
                Ok(self.cache.folder(&key))
            };
            let report = study
                .study
                .report(&done)
                .with_context(|| study.id.clone())?;
            let mut files = render(&study.id, &report)?;
            let outputs = files.iter().map(|(name, bytes)| Output {
                name: name.clone(),
                bytes: bytes.len(),
                blake3: Hash::of(bytes),
            });
            let manifest = Manifest::new(
                self,
                study,
                &machine,
                (started, clock.elapsed()),
                tasks,
                outputs.collect(),
                &report,
            )?;
            files.push((
                "manifest.json".to_owned(),
                serde_json::to_vec_pretty(&manifest)?,
            ));
            let folder = self.out.join(&study.id);
            self.write(&study.id, &files)?;
            finished(study, &report, &folder)?;
        }
        Ok(())
    }

    /// Writes all files into a temporary folder that then takes the place of the study's folder, so
    /// that nothing is ever half-written.
    fn write(&self, id: &str, files: &[(String, Vec<u8>)]) -> Result<()> {
        let _exclusive = self.cache.exclusive("results")?;
        let cannot_write = |path: &Path| format!("cannot write {}", path.display());
        let folder = self.out.join(id);
        let new = self.out.join(format!(".{id}.new"));
        let old = self.out.join(format!(".{id}.old"));
        for leftover in [&new, &old] {
            if leftover.exists() {
                fs::remove_dir_all(leftover).with_context(|| cannot_write(leftover))?;
            }
        }
        fs::create_dir_all(&new).with_context(|| cannot_write(&new))?;
        for (name, bytes) in files {
            let path = new.join(name);
            fs::write(&path, bytes).with_context(|| cannot_write(&path))?;
        }
        if folder.exists() {
            fs::rename(&folder, &old).with_context(|| cannot_write(&folder))?;
        }
        fs::rename(&new, &folder).with_context(|| cannot_write(&folder))?;
        if old.exists() {
            fs::remove_dir_all(&old).with_context(|| cannot_write(&old))?;
        }
        Ok(())
    }
}

/// All files of a report but the manifest, by name.
fn render(id: &str, report: &Report) -> Result<Vec<(String, Vec<u8>)>> {
    ensure!(
        report.figures.first().is_some_and(|(name, _)| name == id),
        "the first figure of study {id} must be called {id}"
    );
    let mut claims = serde_json::to_vec_pretty(&report.claims)?;
    claims.push(b'\n');
    let mut files = vec![
        ("data.csv".to_owned(), report.data.to_csv()),
        ("summary.csv".to_owned(), report.summary.to_csv()),
        ("claims.json".to_owned(), claims),
    ];
    for (name, table) in &report.tables {
        files.push((format!("{name}.csv"), table.to_csv()));
    }
    for (name, figure) in &report.figures {
        if name == id || !figure.is_of_images() {
            files.push((format!("{name}.svg"), figure.svg()?.into_bytes()));
        }
        files.push((format!("{name}.png"), figure.png()?));
    }
    Ok(files)
}

/// Fails with one clear sentence when nothing can be written into `folder`, which it creates.
fn check_writable(folder: &Path) -> Result<()> {
    let sentence = || format!("cannot write into the results folder {}", folder.display());
    fs::create_dir_all(folder).with_context(sentence)?;
    let probe: PathBuf = folder.join(format!(".probe-{}", std::process::id()));
    fs::write(&probe, []).with_context(sentence)?;
    fs::remove_file(&probe).with_context(sentence)
}
