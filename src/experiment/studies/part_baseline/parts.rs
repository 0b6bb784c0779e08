//! How well the baseline's forest tells the parts of the arms apart (Fig. 11b).

use super::{Baseline, Compared, Parameters, SameAs};
use crate::estimator::segmentation::Confusion;
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::statistics::{Interval, bootstrap, mean};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::part_estimates::PartEstimatesTask;
use crate::random::stream;
use anyhow::{Context, Result};
use serde::Deserialize;
use std::sync::Arc;

/// How a claim is tested.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// The mean f1 score over the parts is with more training images within `margin` of that with
    /// fewer.
    MoreImagesNotBetter { margin: f64 },
}

struct Parts {
    specification: Specification<SameAs, Test>,
    parameters: Parameters,
    compared: Compared,
}

pub fn define(specification: Specification<SameAs, Test>) -> Result<Box<dyn Study>> {
    let place = (
        &*specification.root,
        specification.profile,
        specification.seed,
    );
    let parameters = parameters_of(place.0, place.1, &specification.parameters.study)?;
    Ok(Box::new(Parts {
        compared: Compared::new(place, &parameters)?,
        parameters,
        specification,
    }))
}

/// What a baseline's forest made of the pixels.
struct Classified<'a> {
    baseline: &'a Baseline,
    classes: Vec<String>,
    /// In the order of the images.
    images: Vec<Confusion>,
}

impl Classified<'_> {
    fn sum(&self, images: impl Iterator<Item = usize>) -> Confusion {
        let mut sum = Confusion::new(self.classes.len());
        images.for_each(|image| sum.add(&self.images[image]));
        sum
    }

    fn all(&self) -> Confusion {
        self.sum(0..self.images.len())
    }

    /// The f1 score of a class with its 95 % interval, images drawn with replacement.
    fn f1(&self, class: usize, seed: u64) -> Interval {
        let counts = self.images.iter().map(|image| {
            let either = image.pixels(class) + image.given(class);
            (2 * image.0[class][class], either)
        });
        let counts: Vec<(usize, usize)> = counts.collect();
        let of = |drawn: &[usize]| {
            let counts = drawn.iter().map(|&image| counts[image]);
            let (both, either) = counts.fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
            both as f64 / either as f64
        };
        bootstrap(counts.len(), of, &mut stream(seed, "parts interval", &[]))
    }
}

/// The mean f1 score over the parts, the background apart.
fn mean_f1(confusion: &Confusion) -> f64 {
    let parts = 1..confusion.0.len();
    mean(&parts.map(|part| confusion.f1(part)).collect::<Vec<_>>())
}

impl Parts {
    /// The baselines with different forests, the first of those that share one.
    fn baselines(&self) -> Vec<&Baseline> {
        let mut kept: Vec<&Baseline> = Vec::new();
        for baseline in &self.compared.baselines {
            let forest = |of: &Baseline| of.tasks.first().map(|task| task.forest.parameters());
            if !kept.iter().any(|other| forest(other) == forest(baseline)) {
                kept.push(baseline);
            }
        }
        kept
    }
}

impl Study for Parts {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let baselines = self.baselines().into_iter();
        let tasks = baselines.flat_map(|baseline| &baseline.tasks);
        Ok(tasks.map(|task| task.clone() as Arc<dyn Task>).collect())
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let mut all = Vec::new();
        for baseline in self.baselines() {
            let mut classes = Vec::new();
            let mut images = Vec::new();
            for task in &baseline.tasks {
                let estimates = PartEstimatesTask::read(&done(&**task)?)?;
                classes = estimates.classes.into_iter().map(|c| c.name).collect();
                images.extend(estimates.images.into_iter().map(|i| (i.image, i.confusion)));
            }
            images.sort_by_key(|&(image, _)| image);
            all.push(Classified {
                baseline,
                classes,
                images: images.into_iter().map(|(_, confusion)| confusion).collect(),
            });
        }
        let mut data = Table::new(["baseline", "class", "given", "pixels"]);
        let mut summary = Table::new(["baseline", "class", "precision", "recall", "f1", "pixels"]);
        for of in &all {
            let sum = of.all();
            for (truth, class) in of.classes.iter().enumerate() {
                let id = of.baseline.id.as_str();
                summary.push([
                    id.into(),
                    class.as_str().into(),
                    sum.precision(truth).into(),
                    sum.recall(truth).into(),
                    sum.f1(truth).into(),
                    sum.pixels(truth).into(),
                ]);
                for (given, name) in of.classes.iter().enumerate() {
                    let pixels = sum.0[truth][given].into();
                    data.push([
                        id.into(),
                        class.as_str().into(),
                        name.as_str().into(),
                        pixels,
                    ]);
                }
            }
        }
        let claims = self.specification.claims.iter();
        Ok(Report {
            data,
            summary,
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), self.figure(&all))],
            claims: claims
                .map(|claim| self.judge(claim, &all))
                .collect::<Result<_>>()?,
            text: text(&all),
        })
    }
}

/// f1 scores, a column for each baseline.
fn text(all: &[Classified]) -> String {
    let titles = all.iter().map(|of| of.baseline.title.clone());
    let mut table = Table::new(std::iter::once("f1".to_owned()).chain(titles));
    let sums: Vec<Confusion> = all.iter().map(Classified::all).collect();
    let classes = all.first().map_or(&[][..], |of| &of.classes);
    for (at, class) in classes.iter().enumerate() {
        let scores = sums.iter().map(|sum| format!("{:.3}", sum.f1(at)).into());
        table.push(std::iter::once(class.as_str().into()).chain(scores));
    }
    table.to_text()
}

impl Parts {
    fn figure(&self, all: &[Classified]) -> Figure {
        let seed = self.specification.seed;
        let marks = all.iter().enumerate().map(|(colour, of)| {
            let bar = |class: usize| {
                let f1 = of.f1(class, seed);
                (f1.mean, Some((f1.low, f1.high)))
            };
            let bars = (0..of.classes.len()).map(bar).collect();
            Mark::new(&of.baseline.title, colour, Shape::Bars(bars))
        });
        let classes = all.first().map_or(Vec::new(), |of| of.classes.clone());
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "All valid pixels of {} images, each classified by a forest that had not seen it. \
                 Whiskers: 95 % bootstrap interval over images.",
                self.compared.protocol.images
            ),
            panels: vec![Panel::Plot(Plot {
                title: String::new(),
                x: Axis::of("", classes),
                y: Axis::new("f1 score").including(0.0, 1.0),
                marks: marks.collect(),
            })],
            columns: 1,
            size: (1700, 800),
        }
    }

    fn judge(&self, claim: &Claim<Test>, all: &[Classified]) -> Result<ClaimResult> {
        let Some(Test::MoreImagesNotBetter { margin }) = claim.test else {
            return Ok(claim.without_test());
        };
        let large = all.last().context("there is no baseline")?;
        let name = format!("part-baseline-{}", self.parameters.large.baseline);
        let few = all.iter().find(|of| of.baseline.id == name);
        let few = few.with_context(|| format!("claim {}: there is no {name}", claim.id))?;
        let gain = |drawn: &[usize]| {
            let of = |all: &Classified| mean_f1(&all.sum(drawn.iter().copied()));
            of(large) - of(few)
        };
        let mut random = stream(self.specification.seed, "claim", &[]);
        let gain = bootstrap(large.images.len(), gain, &mut random);
        let ours = format!(
            "mean f1 of the parts {:.3}, with {} images {:.3} more (95 % interval {:.3} to {:.3})",
            mean_f1(&few.all()),
            self.parameters.large.set.images,
            gain.mean,
            gain.low,
            gain.high
        );
        let verdict = Verdict::of(&gain, f64::NEG_INFINITY, margin);
        Ok(claim.result(ours, large.images.len(), verdict))
    }
}
