//! The error over the relative confidence threshold t_r (section IV-B, Fig. 7).

use super::cross_validation;
use crate::estimator::image::STEPS;
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{CrossValidation, Outcome, step_of};
use crate::experiment::statistics::{bootstrap_mean, mean, spearman};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::experiment::tasks::pose_forest::ObjectiveName;
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
    /// For every objective the error falls with t_r up to its lowest point, which is at least `from`:
    /// their rank correlation up to there is at most -0.9.
    FallsUntil { from: f64 },
    /// For every objective the error at `t_r` is the lowest one as far as the images can tell: the 95 %
    /// interval of the paired difference to the lowest contains zero.
    GoodAt { t_r: f64 },
}

struct ThresholdSweep {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    tasks: Vec<(ObjectiveName, Vec<Arc<EstimatesTask>>)>,
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
    for claim in &specification.claims {
        if let Some(Test::FallsUntil { from: t_r } | Test::GoodAt { t_r }) = claim.test {
            step_of(t_r).with_context(|| format!("claim {}", claim.id))?;
        }
    }
    Ok(Box::new(ThresholdSweep {
        specification,
        validation,
        tasks,
    }))
}

/// One objective: for each step of the threshold, a value for each image.
struct Sweep {
    objective: ObjectiveName,
    error_deg: Vec<Vec<f64>>,
    foreground_share: Vec<Vec<f64>>,
    chosen_share: Vec<Vec<f64>>,
}

fn t_r(step: usize) -> f64 {
    step as f64 / STEPS as f64
}

impl Sweep {
    fn curve(&self) -> Vec<f64> {
        self.error_deg.iter().map(|images| mean(images)).collect()
    }

    /// The step with the lowest error.
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
        let ruler = self.validation.ruler()?;
        let mut data = Table::new([
            "image",
            "fold",
            "objective",
            "t_r",
            "error_deg",
            "arm_error_deg",
            "hand_error_deg",
            "tip_error_mm",
            "chosen_px",
            "chosen_foreground_px",
        ]);
        let mut sweeps = Vec::new();
        let mut floor = Vec::new();
        for (objective, tasks) in &self.tasks {
            let outcomes = self.validation.outcomes(tasks, done)?;
            floor = outcomes
                .iter()
                .map(|o| ruler.measure(&o.truth, &o.constant).all_deg)
                .collect();
            let mut sweep = Sweep {
                objective: *objective,
                error_deg: vec![Vec::new(); STEPS + 1],
                foreground_share: vec![Vec::new(); STEPS + 1],
                chosen_share: vec![Vec::new(); STEPS + 1],
            };
            for Outcome {
                image,
                fold,
                truth,
                estimate,
                valid,
                ..
            } in &outcomes
            {
                for (step, at) in estimate.thresholds.iter().enumerate() {
                    let error = ruler.measure(truth, &at.pose);
                    data.push([
                        (*image).into(),
                        (*fold).into(),
                        objective.id().into(),
                        t_r(step).into(),
                        error.all_deg.into(),
                        error.arm_deg.into(),
                        error.hand_deg.into(),
                        error.tip_mm.into(),
                        at.pixels.into(),
                        at.foreground.into(),
                    ]);
                    sweep.error_deg[step].push(error.all_deg);
                    sweep.foreground_share[step].push(at.foreground as f64 / at.pixels as f64);
                    sweep.chosen_share[step].push(at.pixels as f64 / *valid as f64);
                }
            }
            sweeps.push(sweep);
        }
        let floor = mean(&floor);
        let summary = self.summary(&sweeps);
        let text = sweeps.iter().map(|sweep| {
            let (curve, lowest) = (sweep.curve(), sweep.lowest());
            format!(
                "{}: {:.2} deg at t_r = 0, {:.2} at 0.9, lowest {:.2} at {:.2}; constant pose {floor:.2}\n",
                sweep.objective.title(), curve[0], curve[STEPS * 9 / 10], curve[lowest], t_r(lowest)
            )
        });
        Ok(Report {
            data,
            summary,
            figures: vec![(self.specification.id.clone(), self.figure(&sweeps, floor))],
            claims: self
                .specification
                .claims
                .iter()
                .map(|c| self.judge(c, &sweeps))
                .collect(),
            text: text.collect(),
        })
    }
}

impl ThresholdSweep {
    /// Every tenth step, and 0.95.
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
            for step in (0..=STEPS).filter(|step| step % 10 == 0 || *step == 95) {
                let images = &sweep.error_deg[step];
                let mut stream = stream(
                    self.specification.seed,
                    "threshold interval",
                    &[step as u64],
                );
                let interval = bootstrap_mean(images, &mut stream);
                table.push([
                    sweep.objective.id().into(),
                    t_r(step).into(),
                    interval.mean.into(),
                    interval.low.into(),
                    interval.high.into(),
                    mean(&sweep.foreground_share[step]).into(),
                    mean(&sweep.chosen_share[step]).into(),
                    images.len().into(),
                ]);
            }
        }
        table
    }

    fn figure(&self, sweeps: &[Sweep], floor: f64) -> Figure {
        let over_steps = |values: &[Vec<f64>], scale: f64| -> Vec<(f64, f64)> {
            let mean = |(step, images): (usize, &Vec<f64>)| (t_r(step), scale * mean(images));
            values.iter().enumerate().map(mean).collect()
        };
        let plot = |title: &str, axis: Axis, values: &dyn Fn(&Sweep) -> Vec<(f64, f64)>| Plot {
            title: title.to_owned(),
            x: Axis::new("relative threshold t_r"),
            y: axis,
            marks: sweeps
                .iter()
                .enumerate()
                .map(|(at, s)| Mark::new(s.objective.title(), at, Shape::Line(values(s))))
                .collect(),
        };
        let mut error = plot(
            "Test error",
            Axis::new("mean absolute joint error (deg)"),
            &|s| over_steps(&s.error_deg, 1.0),
        );
        for (at, sweep) in sweeps.iter().enumerate() {
            let band = |(step, images): (usize, &Vec<f64>)| {
                let mut stream = stream(
                    self.specification.seed,
                    "threshold interval",
                    &[step as u64],
                );
                let interval = bootstrap_mean(images, &mut stream);
                (t_r(step), interval.low, interval.high)
            };
            let band = sweep.error_deg.iter().enumerate().map(band).collect();
            error.marks.insert(0, Mark::new("", at, Shape::Band(band)));
        }
        error
            .marks
            .push(Mark::new("constant pose", 7, Shape::Level(floor)));
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
            caption: "Means over all test images of the cross-validation; the band is the 95 % bootstrap \
                      interval of the mean over images."
                .to_owned(),
            panels: [error, foreground, chosen].map(Panel::Plot).into(),
            columns: 3,
            size: (2100, 760),
        }
    }

    fn judge(&self, claim: &Claim<Test>, sweeps: &[Sweep]) -> ClaimResult {
        let Some(test) = &claim.test else {
            return claim.not_checkable("nothing here can test it");
        };
        let mut worst = Verdict::Reproduced;
        let mut ours = Vec::new();
        for sweep in sweeps {
            let (verdict, what) = match *test {
                Test::FallsUntil { from } => falls_until(sweep, from),
                Test::GoodAt { t_r } => self.good_at(sweep, t_r),
            };
            ours.push(format!("{}: {what}", sweep.objective.title()));
            worst = if rank(verdict) > rank(worst) {
                verdict
            } else {
                worst
            };
        }
        let images = sweeps.first().map_or(0, |s| s.error_deg[0].len());
        claim.result(ours.join("; "), images, worst)
    }

    fn good_at(&self, sweep: &Sweep, at: f64) -> (Verdict, String) {
        let (step, lowest) = ((at * STEPS as f64).round() as usize, sweep.lowest());
        let differences: Vec<f64> = sweep.error_deg[step]
            .iter()
            .zip(&sweep.error_deg[lowest])
            .map(|(here, there)| here - there)
            .collect();
        let mut stream = stream(self.specification.seed, "claim", &[]);
        let gap = bootstrap_mean(&differences, &mut stream);
        let curve = sweep.curve();
        let verdict = if step == lowest || gap.low <= 0.0 {
            Verdict::Reproduced
        } else if curve[step] < curve[0] {
            Verdict::Partly
        } else {
            Verdict::Not
        };
        let what = format!(
            "{:.2} deg at {at}, lowest at {:.2}, difference {:.2} (95 % interval {:.2} to {:.2})",
            curve[step],
            t_r(lowest),
            gap.mean,
            gap.low,
            gap.high
        );
        (verdict, what)
    }
}

fn falls_until(sweep: &Sweep, from: f64) -> (Verdict, String) {
    let (curve, lowest) = (sweep.curve(), sweep.lowest());
    let steps: Vec<f64> = (0..=lowest).map(t_r).collect();
    let correlation = spearman(&steps, &curve[..=lowest]);
    let verdict = if t_r(lowest) >= from && correlation <= -0.9 {
        Verdict::Reproduced
    } else if curve[STEPS * 9 / 10] < curve[0] {
        Verdict::Partly
    } else {
        Verdict::Not
    };
    let what = format!(
        "falls from {:.2} to {:.2} deg at t_r = {:.2}, rank correlation {correlation:.2}",
        curve[0],
        curve[lowest],
        t_r(lowest)
    );
    (verdict, what)
}

fn rank(verdict: Verdict) -> usize {
    match verdict {
        Verdict::Reproduced => 0,
        Verdict::Partly => 1,
        Verdict::Not => 2,
        Verdict::NotCheckable => 3,
    }
}
