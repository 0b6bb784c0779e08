//! The plan: which tasks must run, in which order, and why.

use super::cache::{Cache, State};
use super::progress::{Display, duration};
use super::recipe::{Cook, Key, Recipe};
use super::table::Table;
use super::task::Task;
use anyhow::{Context, Result};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

/// Tasks in an order in which they can run. The inputs of what is cached are not needed and do not
/// appear.
pub struct Plan {
    pub tasks: Vec<Planned>,
}

/// A task of a plan.
pub struct Planned {
    pub task: Arc<dyn Task>,
    pub recipe: Recipe,
    pub key: Key,
    pub state: State,
}

/// A task that the results of a run rest on.
#[derive(Debug, Clone, serde::Serialize)]
pub struct TaskRecord {
    pub label: String,
    pub key: Key,
    /// Whether an earlier run had made it.
    pub cached: bool,
    /// Wall-clock time that making it took, in this run or the earlier one.
    pub seconds: f64,
}

impl Plan {
    /// What it takes to have the results of `wanted`.
    pub fn new(wanted: &[Arc<dyn Task>], cook: &Cook, cache: &Cache) -> Result<Plan> {
        let mut plan = Plan { tasks: Vec::new() };
        let mut seen = BTreeSet::new();
        for task in wanted {
            plan.visit(task, cook, cache, &mut seen)?;
        }
        Ok(plan)
    }

    fn visit(
        &mut self,
        task: &Arc<dyn Task>,
        cook: &Cook,
        cache: &Cache,
        seen: &mut BTreeSet<Key>,
    ) -> Result<()> {
        let recipe = cook.recipe(&**task).with_context(|| task.label())?;
        let key = recipe.key();
        if !seen.insert(key.clone()) {
            return Ok(());
        }
        let state = cache.state(&key);
        if state != State::Ready {
            for input in task.inputs() {
                self.visit(&input, cook, cache, seen)?;
            }
        }
        self.tasks.push(Planned {
            task: task.clone(),
            recipe,
            key,
            state,
        });
        Ok(())
    }

    /// The keys of tasks and of all that they rest on, cached or not.
    pub fn keys(wanted: &[Arc<dyn Task>], cook: &Cook) -> Result<BTreeSet<Key>> {
        let mut keys = BTreeSet::new();
        let mut open: Vec<Arc<dyn Task>> = wanted.to_vec();
        while let Some(task) = open.pop() {
            if keys.insert(cook.recipe(&*task)?.key()) {
                open.extend(task.inputs());
            }
        }
        Ok(keys)
    }

    fn to_run(&self) -> impl Iterator<Item = &Planned> {
        self.tasks.iter().filter(|t| t.state != State::Ready)
    }

    /// Estimated seconds of what must run.
    pub fn seconds(&self) -> f64 {
        self.to_run().map(|t| t.task.cost().seconds).sum()
    }

    /// Damaged results in the cache, for a warning.
    pub fn damages(&self) -> impl Iterator<Item = &str> {
        self.tasks.iter().filter_map(|t| match &t.state {
            State::Damaged(why) => Some(why.as_str()),
            _ => None,
        })
    }

    /// For people: each task, whether it is cached and why not, the estimates, and their totals.
    pub fn describe(&self, cache: &Cache) -> String {
        let mut table = Table::new(["task", "state", "estimate", "why"]);
        let mut peak = 0.0_f64;
        for planned in &self.tasks {
            let cost = planned.task.cost();
            let (state, why) = match &planned.state {
                State::Ready => ("cached", String::new()),
                State::Missing => ("to run", cache.why_missing(&planned.recipe)),
                State::Damaged(why) => ("to run", why.clone()),
            };
            let mut estimate = String::new();
            if planned.state != State::Ready {
                estimate = format!("{}, {:.0} MB", duration(cost.seconds), cost.megabytes);
                peak = peak.max(cost.megabytes);
            }
            table.push([
                planned.task.label().into(),
                state.into(),
                estimate.into(),
                why.into(),
            ]);
        }
        let to_run = self.to_run().count();
        format!(
            "{}{to_run} to run, {} cached; about {} and {peak:.0} MB\n",
            table.to_text(),
            self.tasks.len() - to_run,
            duration(self.seconds()),
        )
    }

    /// Runs what must run, one task after the other; each uses all threads.
    pub fn execute(&self, cache: &Cache, display: &Display) -> Result<Vec<TaskRecord>> {
        for planned in self.to_run() {
            let task = &planned.task;
            let inputs: Vec<PathBuf> = planned
                .recipe
                .inputs
                .iter()
                .map(|key| cache.folder(key))
                .collect();
            display.start(&**task);
            cache
                .make(&planned.recipe, &task.label(), |out| {
                    task.run(&inputs, out, &|steps| display.advance(steps))
                })
                .with_context(|| task.label())?;
            display.finish();
        }
        Ok(self.records(cache))
    }

    /// The tasks of the plan in their order, then those that cached ones were made from, so far as
    /// their results are still there.
    fn records(&self, cache: &Cache) -> Vec<TaskRecord> {
        let run: BTreeSet<&Key> = self.to_run().map(|planned| &planned.key).collect();
        let mut keys: Vec<Key> = self.tasks.iter().map(|t| t.key.clone()).collect();
        let mut seen: BTreeSet<Key> = keys.iter().cloned().collect();
        let mut records = Vec::new();
        let mut next = 0;
        while let Some(key) = keys.get(next).cloned() {
            next += 1;
            let Ok(entry) = cache.entry(&key) else {
                continue;
            };
            let inputs = entry.recipe.inputs.into_iter();
            keys.extend(inputs.filter(|input| seen.insert(input.clone())));
            records.push(TaskRecord {
                label: entry.label,
                cached: !run.contains(&key),
                seconds: entry.seconds,
                key,
            });
        }
        records
    }
}
