//! How long training takes on each objective (section IV-D, Table II).

use super::cross_validation;
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{CrossValidation, colour};
use crate::experiment::statistics::{median, quantile};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::{Cell, Table};
use crate::experiment::task::Task;
use crate::experiment::tasks::pose_forest::PoseForestTask;
use crate::experiment::tasks::training_times::{Form, Timed, TrainingTimesTask};
use crate::forest::objective::ObjectiveKind;
use crate::training::Training;
use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The cross-validation whose first forests are trained again.
    pub study: String,
    /// Each time all objectives one after the other.
    pub repetitions: usize,
    /// MSPD as published is measured with so many pixels an image, for each of these.
    pub published_pixels: Vec<usize>,
}

/// How a claim is tested: training on `slower` takes at least `factor` times as long as on each of
/// `than` in our exact form, in every repetition; *partly* when it takes longer.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Test {
    slower: Slower,
    than: Vec<&'static ObjectiveKind>,
    factor: f64,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Slower {
    objective: &'static ObjectiveKind,
    form: Form,
}

struct TrainingTime {
    specification: Specification<Parameters, Test>,
    task: Arc<TrainingTimesTask>,
}

/// The objective by which all others are measured, and the one that was published in another form.
const MSE: &str = "mse";
const MSPD: &str = "mspd";

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let Parameters {
        study,
        repetitions,
        published_pixels,
    } = &specification.parameters;
    let (root, profile) = (&specification.root, specification.profile);
    let other: cross_validation::Parameters = parameters_of(root, profile, study)
        .with_context(|| format!("study = \"{study}\" must name a cross-validation"))?;
    ensure!(*repetitions > 0, "repetitions = 0: choose at least 1");
    if published_pixels.len() < 2 || !published_pixels.is_sorted_by(|a, b| 0 < *a && a < b) {
        bail!("published_pixels = {published_pixels:?}: choose two numbers or more that ascend");
    }
    let validation = CrossValidation::new(root, specification.seed, other.protocol)?;
    let mut forests = Vec::new();
    for objective in &other.objectives {
        let tasks = validation.estimates(objective)?;
        let first = tasks.first().context("there are no folds")?;
        forests.push(first.forest.clone());
    }
    let find = |id: &str| {
        let found = forests.iter().find(|forest| forest.objective.id == id);
        found.with_context(|| format!("study {study} does not have the objective {id}"))
    };
    find(MSE)?;
    let whole = find(MSPD)?;
    let fewer = |&pixels: &usize| {
        let mut task = PoseForestTask::clone(whole);
        // The same shares of foreground and background.
        let Training {
            foreground,
            background,
            ..
        } = whole.training;
        task.training.foreground = pixels * foreground / (foreground + background);
        task.training.background = pixels - task.training.foreground;
        task
    };
    let task = Arc::new(TrainingTimesTask {
        published: published_pixels.iter().map(fewer).collect(),
        forests,
        repetitions: *repetitions,
    });
    Ok(Box::new(TrainingTime {
        specification,
        task,
    }))
}

/// A row of Table II: seconds on all samples, one for each repetition.
struct Row {
    objective: &'static ObjectiveKind,
    form: Form,
    seconds: Vec<f64>,
    /// Each repetition's time over that of MSE.
    ratios: Vec<f64>,
}

impl Row {
    fn new(objective: &'static ObjectiveKind, form: Form, seconds: Vec<f64>, mse: &[f64]) -> Row {
        let ratios = seconds.iter().zip(mse).map(|(s, mse)| s / mse);
        Row {
            objective,
            form,
            ratios: ratios.collect(),
            seconds,
        }
    }
}

/// A name, and the seconds of it.
type Stage = (&'static str, fn(&Timed) -> f64);

fn in_all(timed: &Timed) -> f64 {
    timed.distances_s + timed.preparation_s + timed.growing_s
}

/// From the first to the third quartile.
fn spread(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    quantile(&sorted, 0.75) - quantile(&sorted, 0.25)
}

/// A time that grows as `square n^2 + linear n`: pair sums, and all the rest.
#[derive(Debug, Clone, Copy)]
struct Growth {
    square: f64,
    linear: f64,
}

impl Growth {
    /// Least squares of the relative errors. A part that would be negative is left out.
    fn fit(points: &[(f64, f64)]) -> Growth {
        // Of (square n^2 / t + linear n / t - 1)^2.
        let sum = |of: &dyn Fn(f64, f64) -> f64| points.iter().map(|&(n, t)| of(n, t)).sum::<f64>();
        let (a, b) = (|n: f64, t: f64| n * n / t, |n: f64, t: f64| n / t);
        let aa = sum(&|n, t| a(n, t) * a(n, t));
        let ab = sum(&|n, t| a(n, t) * b(n, t));
        let bb = sum(&|n, t| b(n, t) * b(n, t));
        let (a1, b1) = (sum(&a), sum(&b));
        let determinant = aa * bb - ab * ab;
        let square = (a1 * bb - b1 * ab) / determinant;
        let linear = (b1 * aa - a1 * ab) / determinant;
        if square > 0.0 && linear >= 0.0 {
            Growth { square, linear }
        } else if square > 0.0 {
            let (square, linear) = (a1 / aa, 0.0);
            Growth { square, linear }
        } else {
            let (square, linear) = (0.0, b1 / bb);
            Growth { square, linear }
        }
    }

    fn seconds(&self, samples: f64) -> f64 {
        self.square * samples * samples + self.linear * samples
    }
}

impl Study for TrainingTime {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        Ok(vec![self.task.clone()])
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let times = TrainingTimesTask::read(&done(&*self.task)?)?;
        let measured = |objective: &ObjectiveKind| -> Vec<f64> {
            let of = |t: &&Timed| t.form == Form::Exact && t.objective == objective.id;
            times.iter().filter(of).map(in_all).collect()
        };
        let mut rows = Vec::new();
        let mse = measured(self.kind(MSE)?);
        for forest in &self.task.forests {
            let objective = forest.objective;
            rows.push(Row::new(objective, Form::Exact, measured(objective), &mse));
            if objective.id == MSPD {
                let seconds = (0..self.task.repetitions)
                    .map(|repetition| published(&times, repetition))
                    .map(|points| Growth::fit(&points).seconds(self.samples()))
                    .collect();
                rows.push(Row::new(objective, Form::Published, seconds, &mse));
            }
        }
        let summary = self.summary(&rows);
        let claims = self.specification.claims.iter();
        Ok(Report {
            data: self.data(&times, &rows),
            text: format!("{}\n{}\n", summary.to_text().trim_end(), self.check(&times)),
            summary,
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), self.figure(&times, &rows))],
            claims: claims.map(|claim| judge(claim, &rows)).collect(),
        })
    }
}

/// Samples and seconds of the published form in one repetition.
fn published(times: &[Timed], repetition: usize) -> Vec<(f64, f64)> {
    let of = |t: &&Timed| t.form == Form::Published && t.repetition == repetition;
    let point = |t: &Timed| (t.samples as f64, in_all(t));
    times.iter().filter(of).map(point).collect()
}

impl TrainingTime {
    fn kind(&self, id: &str) -> Result<&'static ObjectiveKind> {
        let mut all = self.task.forests.iter().map(|forest| forest.objective);
        all.find(|kind| kind.id == id)
            .with_context(|| format!("there is no objective {id}"))
    }

    /// Of a whole training.
    fn samples(&self) -> f64 {
        self.task.forests.first().map_or(0, |f| f.samples()) as f64
    }

    /// The most samples at which the published form was measured.
    fn most_published(&self) -> usize {
        let samples = self.task.published.iter().map(|task| task.samples());
        samples.max().unwrap_or(0)
    }

    /// How well the smaller sizes tell the time of the largest one, for people.
    fn check(&self, times: &[Timed]) -> String {
        let errors = (0..self.task.repetitions).filter_map(|repetition| {
            let points = published(times, repetition);
            let (&(samples, seconds), smaller) = points.split_last()?;
            Some(Growth::fit(smaller).seconds(samples) / seconds - 1.0)
        });
        let errors: Vec<f64> = errors.collect();
        format!(
            "MSPD as published is extrapolated from {} samples; the smaller sizes tell the time of \
             that one to {:+.0} % (median)",
            self.most_published(),
            100.0 * median(&errors)
        )
    }

    /// A row for each stage of each training, and one for each extrapolated time.
    fn data(&self, times: &[Timed], rows: &[Row]) -> Table {
        let mut table = Table::new([
            "objective",
            "form",
            "samples",
            "repetition",
            "stage",
            "seconds",
            "origin",
        ]);
        for timed in times {
            for (stage, seconds) in [
                ("distances", timed.distances_s),
                ("preparation", timed.preparation_s),
                ("growing", timed.growing_s),
            ] {
                table.push([
                    timed.objective.as_str().into(),
                    timed.form.id().into(),
                    timed.samples.into(),
                    timed.repetition.into(),
                    stage.into(),
                    seconds.into(),
                    "measured".into(),
                ]);
            }
        }
        for row in rows.iter().filter(|row| row.form == Form::Published) {
            for (repetition, &seconds) in row.seconds.iter().enumerate() {
                table.push([
                    row.objective.id.into(),
                    row.form.id().into(),
                    Cell::from(self.samples() as usize),
                    repetition.into(),
                    "all".into(),
                    seconds.into(),
                    "extrapolated".into(),
                ]);
            }
        }
        table
    }

    fn summary(&self, rows: &[Row]) -> Table {
        let mut table = Table::new([
            "objective",
            "form",
            "threads",
            "repetitions",
            "median_s",
            "spread_s",
            "ratio_to_mse",
            "extrapolated_from_samples",
        ]);
        for row in rows {
            let is_extrapolated = row.form == Form::Published;
            table.push([
                row.objective.id.into(),
                row.form.id().into(),
                rayon::current_num_threads().into(),
                row.seconds.len().into(),
                median(&row.seconds).into(),
                spread(&row.seconds).into(),
                median(&row.ratios).into(),
                is_extrapolated.then(|| self.most_published()).into(),
            ]);
        }
        table
    }

    fn figure(&self, times: &[Timed], rows: &[Row]) -> Figure {
        let exact = || rows.iter().filter(|row| row.form == Form::Exact);
        let stages: [Stage; 4] = [
            ("in all", in_all),
            ("distances", |t| t.distances_s),
            ("preparation", |t| t.preparation_s),
            ("growing", |t| t.growing_s),
        ];
        let bars = exact().map(|row| {
            let of = |t: &&Timed| t.form == Form::Exact && t.objective == row.objective.id;
            let bar = |(_, stage): Stage| {
                let seconds: Vec<f64> = times.iter().filter(of).map(stage).collect();
                let (low, high) = seconds
                    .iter()
                    .fold((f64::MAX, 0.0f64), |(l, h), &s| (l.min(s), h.max(s)));
                (median(&seconds), Some((low, high)))
            };
            let bars = Shape::Bars(stages.map(bar).into());
            Mark::new(row.objective.title, colour(row.objective), bars)
        });
        let whole = Panel::Plot(Plot {
            title: format!("{} samples", self.samples()),
            x: Axis::of("", stages.map(|(name, _)| name)),
            y: Axis::new("seconds").including(0.0, 0.0),
            marks: bars.collect(),
        });

        let at = exact().map(|row| {
            let point = vec![(self.samples(), median(&row.seconds))];
            Mark::new(
                row.objective.title,
                colour(row.objective),
                Shape::Scatter(point),
            )
        });
        let mut marks: Vec<Mark> = at.collect();
        for row in rows.iter().filter(|row| row.form == Form::Published) {
            let sizes = self.task.published.iter().map(|task| task.samples());
            let points: Vec<(f64, f64)> = sizes
                .map(|samples| {
                    let of = |t: &&Timed| t.form == Form::Published && t.samples == samples;
                    let seconds: Vec<f64> = times.iter().filter(of).map(in_all).collect();
                    (samples as f64, median(&seconds))
                })
                .collect();
            let last = points.last().copied();
            let end = (self.samples(), median(&row.seconds));
            marks.push(Mark::new(
                "MSPD as published, measured",
                7,
                Shape::Line(points),
            ));
            marks.push(Mark::new(
                "MSPD as published, extrapolated",
                7,
                Shape::Dashed(last.into_iter().chain([end]).collect()),
            ));
            marks.push(Mark::new("", 7, Shape::Scatter(vec![end])));
        }
        let growth = Panel::Plot(Plot {
            title: "MSPD as published".to_owned(),
            x: Axis::new("samples").log(),
            y: Axis::new("seconds").log(),
            marks,
        });
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Wall-clock time on {} threads: medians of {} repetitions side by side; whiskers: \
                 shortest and longest.",
                rayon::current_num_threads(),
                self.task.repetitions
            ),
            panels: vec![whole, growth],
            columns: 2,
            size: (2100, 900),
        }
    }
}

fn judge(claim: &Claim<Test>, rows: &[Row]) -> ClaimResult {
    let Some(Test {
        slower,
        than,
        factor,
    }) = &claim.test
    else {
        return claim.without_test();
    };
    let find = |kind: &ObjectiveKind, form: Form| {
        let mut rows = rows.iter();
        rows.find(|row| row.objective.id == kind.id && row.form == form)
    };
    let without =
        |kind: &ObjectiveKind| claim.not_checkable(&format!("this run is without {}", kind.id));
    let Some(slower) = find(slower.objective, slower.form) else {
        return without(slower.objective);
    };
    let mut worst = Verdict::Reproduced;
    let mut ours = Vec::new();
    for kind in than {
        let Some(faster) = find(kind, Form::Exact) else {
            return without(kind);
        };
        let pairs = slower.seconds.iter().zip(&faster.seconds);
        let ratios: Vec<f64> = pairs.map(|(slow, fast)| slow / fast).collect();
        let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
        worst = worst.max(match least {
            ratio if ratio >= *factor => Verdict::Reproduced,
            ratio if ratio > 1.0 => Verdict::Partly,
            _ => Verdict::Not,
        });
        ours.push(format!(
            "{:.1} times {}",
            median(&ratios),
            faster.objective.title
        ));
    }
    let origin = match slower.form {
        Form::Exact => "measured",
        Form::Published => "extrapolated",
    };
    let ours = format!("{} ({origin})", ours.join(", "));
    claim.result(ours, slower.seconds.len(), worst)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_is_found_again_and_parts_are_not_negative() {
        let sizes = [1000.0, 2000.0, 4000.0, 8000.0];
        let fit = |of: &dyn Fn(f64) -> f64| Growth::fit(&sizes.map(|n| (n, of(n))));
        let both = fit(&|n| 3e-6 * n * n + 2e-4 * n);
        assert!((both.square - 3e-6).abs() < 1e-14 && (both.linear - 2e-4).abs() < 1e-11);
        assert!((both.seconds(480_000.0) / 691_296.0 - 1.0).abs() < 1e-6);
        let steeper = fit(&|n| 1e-9 * n.powi(3));
        assert!(steeper.linear == 0.0 && steeper.square > 0.0);
        let flatter = fit(&|n| n.sqrt());
        assert!(flatter.square == 0.0 && flatter.linear > 0.0);
    }

    #[test]
    fn the_spread_is_that_of_the_middle_half() {
        let values = [9.0, 1.0, 3.0, 2.0, 4.0];
        assert_eq!((median(&values), spread(&values)), (3.0, 2.0));
    }
}
