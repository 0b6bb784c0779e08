//! The error over the relative confidence threshold t_r (section IV-B, Fig. 7).

use super::cross_validation;
use crate::estimator::error::mean_angle_error;
use crate::estimator::image::{STEPS, ThresholdEstimate};
use crate::experiment::claims::{Claim, ClaimResult, Verdict, difference};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{CrossValidation, FLOOR_COLOUR, Outcome, colour, step_of};
use crate::experiment::statistics::{bootstrap_mean, mean, spearman};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::forest::objective::ObjectiveKind;
use crate::random::stream;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The cross-validation whose folds and forests are used.
    pub study: String,
}

/// How a claim is tested.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// For each of the objectives the error falls with t_r up to its lowest point, which is at least
    /// `from`: their rank correlation up to there is at most -0.9.
    FallsUntil {
        from: f64,
        objectives: Vec<&'static ObjectiveKind>,
    },
    /// For each of the objectives the error at `t_r` is the lowest one as far as the images can tell:
    /// the 95 % interval of the paired difference to the lowest contains zero.
    GoodAt {
        t_r: f64,
        objectives: Vec<&'static ObjectiveKind>,
    },
}

/// The steps of the threshold that are looked at: the curves turn near the end.
fn steps() -> impl Iterator<Item = usize> {
    (0..=STEPS).filter(|step| step.is_multiple_of(5) || *step >= 80)
}

/// Where a relative threshold stands among [`steps`].
fn place_of(t_r: f64) -> Result<usize> {
    let step = step_of(t_r)?;
    let place = steps().position(|s| s == step);
    place.with_context(|| format!("t_r = {t_r}: below 0.8 choose a multiple of 0.05"))
}

struct ThresholdSweep {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    tasks: Vec<(&'static ObjectiveKind, Vec<Arc<EstimatesTask>>)>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let study = &specification.parameters.study;
    let (root, profile) = (&specification.root, specification.profile);
    let other: cross_validation::Parameters = parameters_of(root, profile, study)
        .with_context(|| format!("study = \"{study}\" must name a cross-validation"))?;
    let validation = CrossValidation::new(root, specification.seed, other.protocol)?;
    let tasks = other
        .objectives
        .iter()
        .map(|&objective| Ok((objective, validation.estimates(objective)?)))
        .collect::<Result<_>>()?;
    Ok(Box::new(ThresholdSweep {
        specification,
        validation,
        tasks,
    }))
}

/// One objective: for each of [`steps`], a value for each image.
struct Sweep {
    objective: &'static ObjectiveKind,
    error_deg: Vec<Vec<f64>>,
    foreground_share: Vec<Vec<f64>>,
    chosen_share: Vec<Vec<f64>>,
}

fn thresholds() -> Vec<f64> {
    steps().map(|step| step as f64 / STEPS as f64).collect()
}

impl Sweep {
    fn new(objective: &'static ObjectiveKind, outcomes: &[Outcome]) -> Sweep {
        let each = |of: &dyn Fn(&Outcome, &ThresholdEstimate) -> f64| {
            let images = |step: usize| {
                let image = |o: &Outcome| of(o, &o.estimate.thresholds[step]);
                outcomes.iter().map(image).collect()
            };
            steps().map(images).collect()
        };
        Sweep {
            objective,
            error_deg: each(&|o, at| mean_angle_error(&o.truth, &at.pose).to_degrees()),
            foreground_share: each(&|_, at| at.foreground as f64 / at.pixels as f64),
            chosen_share: each(&|o, at| at.pixels as f64 / o.valid as f64),
        }
    }

    fn curve(&self) -> Vec<f64> {
        self.error_deg.iter().map(|images| mean(images)).collect()
    }

    /// The place of the lowest error.
    fn lowest(&self) -> usize {
        let curve = self.curve();
        (0..curve.len())
            .min_by(|&a, &b| curve[a].total_cmp(&curve[b]))
            .unwrap_or(0)
    }
}

impl Study for ThresholdSweep {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let estimates = self.tasks.iter().flat_map(|(_, tasks)| tasks);
        Ok(self.validation.tasks(estimates))
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let mut data = Table::new([
            "image",
            "fold",
            "objective",
            "t_r",
            "error_deg",
            "chosen_px",
            "chosen_foreground_px",
        ]);
        let mut sweeps = Vec::new();
        let mut floor = f64::NAN;
        for (objective, tasks) in &self.tasks {
            let outcomes = self.validation.outcomes(tasks, done)?;
            let constant = outcomes
                .iter()
                .map(|o| mean_angle_error(&o.truth, &o.constant).to_degrees());
            floor = mean(&constant.collect::<Vec<_>>());
            let sweep = Sweep::new(objective, &outcomes);
            for (image, outcome) in outcomes.iter().enumerate() {
                for (place, (step, t_r)) in steps().zip(thresholds()).enumerate() {
                    let chosen = &outcome.estimate.thresholds[step];
                    data.push([
                        outcome.image.into(),
                        outcome.fold.into(),
                        objective.id.into(),
                        t_r.into(),
                        sweep.error_deg[place][image].into(),
                        chosen.pixels.into(),
                        chosen.foreground.into(),
                    ]);
                }
            }
            sweeps.push(sweep);
        }
        let text = sweeps.iter().map(|sweep| {
            let (curve, lowest) = (sweep.curve(), sweep.lowest());
            let (first, last) = (curve[0], curve[curve.len() - 1]);
            format!(
                "{}: {first:.2} deg at t_r = 0, lowest {:.2} at {:.2}, {last:.2} at 1; constant pose {floor:.2}\n",
                sweep.objective.title, curve[lowest], thresholds()[lowest]
            )
        });
        let claims = self.specification.claims.iter();
        Ok(Report {
            text: text.collect(),
            summary: self.summary(&sweeps),
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), self.figure(&sweeps, floor))],
            claims: claims
                .map(|claim| {
                    self.judge(claim, &sweeps)
                        .with_context(|| format!("claim {}", claim.id))
                })
                .collect::<Result<_>>()?,
            data,
        })
    }
}

impl ThresholdSweep {
    fn summary(&self, sweeps: &[Sweep]) -> Table {
        let mut table = Table::new([
            "objective",
            "t_r",
            "error_deg",
            "low_deg",
            "high_deg",
            "foreground_share",
            "chosen_share",
            "images",
        ]);
        for sweep in sweeps {
            for (place, t_r) in thresholds().into_iter().enumerate() {
                // Every tenth, and 0.95.
                let step = (t_r * STEPS as f64).round() as usize;
                if !step.is_multiple_of(10) && step != 95 {
                    continue;
                }
                let images = &sweep.error_deg[place];
                let mut stream = stream(
                    self.specification.seed,
                    "threshold interval",
                    &[step as u64],
                );
                let interval = bootstrap_mean(images, &mut stream);
                table.push([
                    sweep.objective.id.into(),
                    t_r.into(),
                    interval.mean.into(),
                    interval.low.into(),
                    interval.high.into(),
                    mean(&sweep.foreground_share[place]).into(),
                    mean(&sweep.chosen_share[place]).into(),
                    images.len().into(),
                ]);
            }
        }
        table
    }

    fn figure(&self, sweeps: &[Sweep], floor: f64) -> Figure {
        let over_steps = |values: &[Vec<f64>], scale: f64| -> Vec<(f64, f64)> {
            let means = values.iter().map(|images| scale * mean(images));
            thresholds().into_iter().zip(means).collect()
        };
        let plot = |title: &str, axis: Axis, values: &dyn Fn(&Sweep) -> Vec<(f64, f64)>| Plot {
            title: title.to_owned(),
            x: Axis::new("relative threshold t_r"),
            y: axis,
            marks: sweeps
                .iter()
                .map(|sweep| {
                    let line = Shape::Line(values(sweep));
                    Mark::new(sweep.objective.title, colour(sweep.objective), line)
                })
                .collect(),
        };
        let mut error = plot(
            "Test error",
            Axis::new("mean absolute joint error (deg)"),
            &|s| over_steps(&s.error_deg, 1.0),
        );
        error.marks.push(Mark::new(
            "constant pose",
            FLOOR_COLOUR,
            Shape::Level(floor),
        ));
        let foreground = plot(
            "Foreground among the chosen",
            Axis::new("share of chosen pixels (%)").including(0.0, 100.0),
            &|s| over_steps(&s.foreground_share, 100.0),
        );
        let chosen = plot(
            "Pixels chosen",
            Axis::new("share of valid pixels (%)").log(),
            &|s| over_steps(&s.chosen_share, 100.0),
        );
        Figure {
            title: self.specification.title.clone(),
            caption: "Means over all test images of the cross-validation.".to_owned(),
            panels: [error, foreground, chosen].map(Panel::Plot).into(),
            columns: 3,
            size: (2100, 760),
        }
    }

    fn judge(&self, claim: &Claim<Test>, sweeps: &[Sweep]) -> Result<ClaimResult> {
        let Some(test) = &claim.test else {
            return Ok(claim.without_test());
        };
        let (Test::FallsUntil { objectives, .. } | Test::GoodAt { objectives, .. }) = test;
        let mut worst = Verdict::Reproduced;
        let mut ours = Vec::new();
        for kind in objectives {
            let Some(sweep) = sweeps.iter().find(|sweep| sweep.objective.id == kind.id) else {
                return Ok(claim.not_checkable(&format!("this run is without {}", kind.id)));
            };
            let (verdict, what) = match *test {
                Test::GoodAt { t_r, .. } => self.good_at(sweep, place_of(t_r)?),
                Test::FallsUntil { from, .. } => falls_until(sweep, from),
            };
            ours.push(format!("{}: {what}", sweep.objective.title));
            worst = worst.max(verdict);
        }
        let images = sweeps.first().map_or(0, |s| s.error_deg[0].len());
        Ok(claim.result(ours.join("; "), images, worst))
    }

    fn good_at(&self, sweep: &Sweep, place: usize) -> (Verdict, String) {
        let (lowest, thresholds) = (sweep.lowest(), thresholds());
        let mut stream = stream(self.specification.seed, "claim", &[]);
        let (here, there) = (&sweep.error_deg[place], &sweep.error_deg[lowest]);
        let gap = difference(here, there, &mut stream);
        let curve = sweep.curve();
        let verdict = if place == lowest || gap.low <= 0.0 {
            Verdict::Reproduced
        } else if curve[place] < curve[0] {
            Verdict::Partly
        } else {
            Verdict::Not
        };
        let what = format!(
            "{:.2} deg at {}, lowest at {:.2}, difference {:.2} (95 % interval {:.2} to {:.2})",
            curve[place], thresholds[place], thresholds[lowest], gap.mean, gap.low, gap.high
        );
        (verdict, what)
    }
}

fn falls_until(sweep: &Sweep, from: f64) -> (Verdict, String) {
    let (curve, lowest, thresholds) = (sweep.curve(), sweep.lowest(), thresholds());
    let correlation = spearman(&thresholds[..=lowest], &curve[..=lowest]);
    let verdict = if thresholds[lowest] >= from && correlation <= -0.9 {
        Verdict::Reproduced
    } else if curve[lowest] < curve[0] && correlation <= -0.5 {
        Verdict::Partly
    } else {
        Verdict::Not
    };
    let what = format!(
        "falls from {:.2} to {:.2} deg at t_r = {:.2}, rank correlation {correlation:.2}",
        curve[0], curve[lowest], thresholds[lowest]
    );
    (verdict, what)
}
