//! What an estimate costs either way, stage by stage (sections IV-E and V).

use super::{Compared, Parameters};
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::statistics::{bootstrap_mean, mean};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::estimation_times::{EstimationTimesTask, Timed};
use crate::random::stream;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct RuntimeParameters {
    /// The study whose methods are timed, with the forests of its first fold.
    pub study: String,
    /// Each time is the shortest of so many.
    pub repetitions: usize,
    pub threads: usize,
}

/// How a claim is tested: the time of an image by `slower` less that by `faster` is above zero.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Test {
    faster: String,
    slower: String,
}

struct Runtime {
    specification: Specification<RuntimeParameters, Test>,
    /// One for each baseline, with its id; the regression is timed beside each, and its own times
    /// are those beside the first.
    tasks: Vec<(String, Arc<EstimationTimesTask>)>,
}

pub fn define(specification: Specification<RuntimeParameters, Test>) -> Result<Box<dyn Study>> {
    let RuntimeParameters {
        study,
        repetitions,
        threads,
    } = &specification.parameters;
    if *threads == 0 {
        bail!("threads = 0: choose at least 1");
    }
    let place = (
        &*specification.root,
        specification.profile,
        specification.seed,
    );
    let parameters: Parameters = parameters_of(place.0, place.1, study)?;
    let compared = Compared::new(place, &parameters)?;
    let whole = compared.validation.estimates(parameters.objective)?[0].clone();
    let segmented = compared.ours[0].clone();
    let segmentation = segmented.forest.sight.segmentation();
    let segmentation = segmentation.with_context(|| format!("{study} segments no images"))?;
    let task = |baseline: &super::Baseline| {
        let task = EstimationTimesTask {
            whole: whole.clone(),
            segmented: segmented.clone(),
            segmentation: segmentation.clone(),
            parts: Some(baseline.tasks[0].clone()),
            repetitions: *repetitions,
            threads: Some(*threads),
        };
        (baseline.id.clone(), Arc::new(task))
    };
    // That trained on more images differs in nothing that costs time here.
    let baselines = &compared.baselines[..parameters.baselines.len()];
    let tasks = baselines.iter().map(task).collect();
    Ok(Box::new(Runtime {
        specification,
        tasks,
    }))
}

/// The stages of a method, each with its seconds for every image.
struct Method {
    id: String,
    stages: Vec<(&'static str, Vec<f64>)>,
}

impl Method {
    /// The whole method, seconds for every image.
    fn total(&self) -> Vec<f64> {
        let images = self.stages.first().map_or(0, |(_, seconds)| seconds.len());
        let total = |image: usize| self.stages.iter().map(|(_, seconds)| seconds[image]).sum();
        (0..images).map(total).collect()
    }
}

impl Study for Runtime {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let tasks = self.tasks.iter();
        Ok(tasks
            .map(|(_, task)| task.clone() as Arc<dyn Task>)
            .collect())
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let mut methods: Vec<Method> = Vec::new();
        let mut images = Vec::new();
        for (id, task) in &self.tasks {
            let times = EstimationTimesTask::read(&done(&**task)?)?;
            let of = |stage: fn(&Timed) -> f64| times.iter().map(stage).collect::<Vec<f64>>();
            if methods.is_empty() {
                images = times.iter().map(|timed| timed.image).collect();
                let objective = task.whole.forest.objective.id;
                methods.push(Method {
                    id: objective.to_owned(),
                    stages: vec![("estimating", of(|t| t.whole_s))],
                });
                methods.push(Method {
                    id: format!("{objective}/{}", task.segmented.forest.sight.kind.id()),
                    stages: vec![
                        ("segmenting", of(|t| t.segmenting_s)),
                        ("estimating", of(|t| t.segmented_s)),
                    ],
                });
            }
            let stage = |of: fn(&crate::experiment::tasks::estimation_times::PartTimes) -> f64| {
                let seconds = times.iter().map(|timed| timed.parts.as_ref().map(of));
                seconds
                    .collect::<Option<Vec<f64>>>()
                    .context("the baseline was not timed")
            };
            methods.push(Method {
                id: id.clone(),
                stages: vec![
                    ("classifying", stage(|parts| parts.classifying_s)?),
                    ("voting", stage(|parts| parts.voting_s)?),
                    ("aligning", stage(|parts| parts.aligning_s)?),
                ],
            });
        }
        let mut data = Table::new(["image", "method", "stage", "seconds"]);
        let mut summary = Table::new(["method", "stage", "ms_per_image"]);
        for method in &methods {
            let total = method.total();
            let stages = method.stages.iter().map(|(name, seconds)| (*name, seconds));
            for (stage, seconds) in stages.chain([("all", &total)]) {
                summary.push([
                    method.id.as_str().into(),
                    stage.into(),
                    (1e3 * mean(seconds)).into(),
                ]);
                for (&image, &seconds) in images.iter().zip(seconds) {
                    let id = method.id.as_str();
                    data.push([image.into(), id.into(), stage.into(), seconds.into()]);
                }
            }
        }
        let claims = self.specification.claims.iter();
        Ok(Report {
            data,
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(
                self.specification.id.clone(),
                self.figure(&methods, images.len()),
            )],
            claims: claims
                .map(|claim| self.judge(claim, &methods))
                .collect::<Result<_>>()?,
        })
    }
}

impl Runtime {
    fn figure(&self, methods: &[Method], images: usize) -> Figure {
        // A stage has the same colour in every method.
        const STAGES: [&str; 5] = [
            "estimating",
            "segmenting",
            "classifying",
            "voting",
            "aligning",
        ];
        let marks = STAGES.iter().enumerate().map(|(colour, &stage)| {
            let bar = |method: &Method| {
                let of = method.stages.iter().find(|(name, _)| *name == stage);
                (
                    of.map_or(f64::NAN, |(_, seconds)| 1e3 * mean(seconds)),
                    None,
                )
            };
            let bars = methods.iter().map(bar).collect();
            Mark::new(stage, colour, Shape::Bars(bars))
        });
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Mean over {images} images of the shortest of {} times on {} thread, every valid pixel, \
                 in memory.",
                self.specification.parameters.repetitions, self.specification.parameters.threads
            ),
            panels: vec![Panel::Plot(Plot {
                title: String::new(),
                x: Axis::of("", methods.iter().map(|method| method.id.clone())),
                y: Axis::new("time of an image (ms)").including(0.0, 0.0),
                marks: marks.collect(),
            })],
            columns: 1,
            size: (1500, 800),
        }
    }

    fn judge(&self, claim: &Claim<Test>, methods: &[Method]) -> Result<ClaimResult> {
        let Some(Test { faster, slower }) = &claim.test else {
            return Ok(claim.without_test());
        };
        let total = |id: &String| {
            let method = methods.iter().find(|method| method.id == *id);
            let method = method.with_context(|| format!("claim {}: no method {id}", claim.id))?;
            anyhow::Ok(method.total())
        };
        let (fast, slow) = (total(faster)?, total(slower)?);
        let gaps: Vec<f64> = slow.iter().zip(&fast).map(|(s, f)| 1e3 * (s - f)).collect();
        let gap = bootstrap_mean(&gaps, &mut stream(self.specification.seed, "claim", &[]));
        let ours = format!(
            "{slower} {:.0} ms, {faster} {:.0} ms an image: difference {:.0} ms (95 % interval {:.0} to \
             {:.0})",
            1e3 * mean(&slow),
            1e3 * mean(&fast),
            gap.mean,
            gap.low,
            gap.high
        );
        Ok(claim.result(ours, gaps.len(), Verdict::of(&gap, 0.0, f64::INFINITY)))
    }
}
