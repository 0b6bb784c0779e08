//! How the confidences of an image's pixels vary from image to image (section IV-B).

use super::cross_validation;
use crate::estimator::image::STEPS;
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{CrossValidation, Outcome, step_of};
use crate::experiment::statistics::{Interval, bootstrap, mean, spearman};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::{Cell, Table};
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
    /// The cross-validation whose folds, forests and threshold are used.
    pub study: String,
}

/// How a claim is tested, for each of the objectives. Forests differ in the scale of their
/// confidences, so deviations over images are taken from the mean of the image's fold.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// The lowest and the highest confidence and the threshold have standard deviations of at most
    /// `share` of the mean range between lowest and highest; *partly* up to three times that.
    BoundsConstant {
        share: f64,
        objectives: Vec<&'static ObjectiveKind>,
    },
    /// The standard deviation of the mean confidence is above those of both bounds and of the
    /// threshold; *partly* when it is above that of the threshold only.
    MeanVariesMore {
        objectives: Vec<&'static ObjectiveKind>,
    },
    /// The mean confidence rises with the visible pixels of the arm: their rank correlation is
    /// positive.
    MeanRises {
        objectives: Vec<&'static ObjectiveKind>,
    },
}

struct ConfidenceStudy {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    tasks: Vec<(&'static ObjectiveKind, Vec<Arc<EstimatesTask>>)>,
    step: usize,
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
    Ok(Box::new(ConfidenceStudy {
        specification,
        validation,
        tasks,
        step: step_of(other.t_r)?,
    }))
}

/// What is looked at of an image's confidences.
const QUANTITIES: [&str; 4] = ["minimum", "threshold", "maximum", "mean"];
const MINIMUM: usize = 0;
const THRESHOLD: usize = 1;
const MAXIMUM: usize = 2;
const MEAN: usize = 3;

/// The images of one objective.
struct Images {
    objective: &'static ObjectiveKind,
    outcomes: Vec<Outcome>,
    /// Of each of [`QUANTITIES`], a value for each image.
    values: [Vec<f64>; 4],
    /// The same less the mean over the image's fold.
    deviations: [Vec<f64>; 4],
    /// Visible pixels of the arm that is estimated, and of both.
    visible: Vec<f64>,
    foreground: Vec<f64>,
}

impl Images {
    fn new(objective: &'static ObjectiveKind, outcomes: Vec<Outcome>, step: usize) -> Images {
        let values = [0, 1, 2, 3].map(|quantity| {
            let value = |outcome: &Outcome| {
                let estimate = &outcome.estimate;
                let low = f64::from(estimate.min_confidence);
                let high = f64::from(estimate.max_confidence);
                let threshold = low + (high - low) * step as f64 / STEPS as f64;
                [low, threshold, high, estimate.mean_confidence][quantity]
            };
            outcomes.iter().map(value).collect::<Vec<_>>()
        });
        let deviations = [0, 1, 2, 3].map(|quantity: usize| {
            let deviation = |(outcome, value): (&Outcome, &f64)| {
                let fold = outcomes.iter().zip(&values[quantity]);
                let fold = fold.filter(|(other, _)| other.fold == outcome.fold);
                value - mean(&fold.map(|(_, &value)| value).collect::<Vec<_>>())
            };
            let pairs = outcomes.iter().zip(&values[quantity]);
            pairs.map(deviation).collect::<Vec<_>>()
        });
        Images {
            objective,
            values,
            deviations,
            visible: outcomes.iter().map(|o| o.visible as f64).collect(),
            foreground: outcomes
                .iter()
                .map(|o| o.estimate.thresholds[0].foreground as f64)
                .collect(),
            outcomes,
        }
    }

    /// The standard deviation within folds, over the images drawn.
    fn spread(&self, quantity: usize, drawn: &[usize]) -> f64 {
        let squares = drawn.iter().map(|&i| self.deviations[quantity][i].powi(2));
        (squares.sum::<f64>() / drawn.len() as f64).sqrt()
    }

    fn spread_of_all(&self, quantity: usize) -> f64 {
        let all: Vec<usize> = (0..self.outcomes.len()).collect();
        self.spread(quantity, &all)
    }

    /// The rank correlation of a quantity with a number of pixels, over the images.
    fn correlation(&self, quantity: usize, pixels: &[f64], seed: u64) -> Interval {
        let of = |drawn: &[usize]| {
            let pick = |values: &[f64]| drawn.iter().map(|&i| values[i]).collect::<Vec<_>>();
            spearman(&pick(&self.deviations[quantity]), &pick(pixels))
        };
        bootstrap(
            self.outcomes.len(),
            of,
            &mut stream(seed, "correlation", &[]),
        )
    }
}

impl Study for ConfidenceStudy {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let estimates = self.tasks.iter().flat_map(|(_, tasks)| tasks);
        Ok(self.validation.tasks(estimates))
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let mut all = Vec::new();
        for (objective, tasks) in &self.tasks {
            let outcomes = self.validation.outcomes(tasks, done)?;
            all.push(Images::new(objective, outcomes, self.step));
        }
        let summary = self.summary(&all);
        let claims = self.specification.claims.iter();
        Ok(Report {
            data: data(&all),
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), self.figure(&all))],
            claims: claims.map(|claim| self.judge(claim, &all)).collect(),
        })
    }
}

/// A row for each image by each objective.
fn data(all: &[Images]) -> Table {
    let mut table = Table::new([
        "image",
        "fold",
        "objective",
        "min_confidence",
        "threshold",
        "max_confidence",
        "mean_confidence",
        "visible_px",
        "foreground_px",
        "valid_px",
    ]);
    for images in all {
        for (at, outcome) in images.outcomes.iter().enumerate() {
            let place: [Cell; 3] = [
                outcome.image.into(),
                outcome.fold.into(),
                images.objective.id.into(),
            ];
            let values = images.values.iter().map(|values| values[at].into());
            let pixels: [Cell; 3] = [
                outcome.visible.into(),
                outcome.estimate.thresholds[0].foreground.into(),
                outcome.valid.into(),
            ];
            table.push(place.into_iter().chain(values).chain(pixels));
        }
    }
    table
}

impl ConfidenceStudy {
    fn summary(&self, all: &[Images]) -> Table {
        let mut table = Table::new([
            "objective",
            "quantity",
            "mean",
            "sd_within_folds",
            "correlation_with_visible",
            "correlation_low",
            "correlation_high",
            "images",
        ]);
        for images in all {
            for (quantity, name) in QUANTITIES.into_iter().enumerate() {
                let seed = self.specification.seed;
                let correlation = images.correlation(quantity, &images.visible, seed);
                // What is the same in all images has none.
                let known = |number: f64| number.is_finite().then_some(number);
                table.push([
                    images.objective.id.into(),
                    name.into(),
                    mean(&images.values[quantity]).into(),
                    images.spread_of_all(quantity).into(),
                    known(correlation.mean).into(),
                    known(correlation.low).into(),
                    known(correlation.high).into(),
                    images.outcomes.len().into(),
                ]);
            }
        }
        table
    }

    /// A panel for each objective: all images by what they show of the arm.
    fn figure(&self, all: &[Images]) -> Figure {
        let panel = |images: &Images| {
            let mark = |(quantity, name): (usize, &str)| {
                let visible = images.visible.iter().copied();
                let points = visible.zip(images.values[quantity].iter().copied());
                Mark::new(name, quantity, Shape::Scatter(points.collect()))
            };
            Panel::Plot(Plot {
                title: images.objective.title.to_owned(),
                x: Axis::new("visible pixels of the arm"),
                y: Axis::new("confidence"),
                marks: QUANTITIES.into_iter().enumerate().map(mark).collect(),
            })
        };
        let spreads = |(quantity, name): (usize, &'static str)| {
            let bars = all.iter().map(|i| (i.spread_of_all(quantity), None));
            Mark::new(name, quantity, Shape::Bars(bars.collect()))
        };
        let spread = Panel::Plot(Plot {
            title: "Variation over images".to_owned(),
            x: Axis::of("", all.iter().map(|images| images.objective.id)),
            y: Axis::new("standard deviation within folds"),
            marks: QUANTITIES.into_iter().enumerate().map(spreads).collect(),
        });
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "A dot is a test image without segmentation: the lowest, the highest and the mean \
                 confidence of its valid pixels, and the threshold of eq. 12 for t_r = {}.",
                self.step as f64 / STEPS as f64
            ),
            panels: all.iter().map(panel).chain([spread]).collect(),
            columns: 4,
            size: (2600, 1300),
        }
    }

    fn judge(&self, claim: &Claim<Test>, all: &[Images]) -> ClaimResult {
        let Some(test) = &claim.test else {
            return claim.without_test();
        };
        let (Test::BoundsConstant { objectives, .. }
        | Test::MeanVariesMore { objectives }
        | Test::MeanRises { objectives }) = test;
        let mut worst = Verdict::Reproduced;
        let mut ours = Vec::new();
        for kind in objectives {
            let Some(images) = all.iter().find(|images| images.objective.id == kind.id) else {
                return claim.not_checkable(&format!("this run is without {}", kind.id));
            };
            let (verdict, what) = match test {
                Test::BoundsConstant { share, .. } => bounds_constant(images, *share),
                Test::MeanVariesMore { .. } => self.mean_varies_more(images),
                Test::MeanRises { .. } => self.mean_rises(images),
            };
            ours.push(format!("{}: {what}", images.objective.title));
            worst = worst.max(verdict);
        }
        let count = all.first().map_or(0, |images| images.outcomes.len());
        claim.result(ours.join("; "), count, worst)
    }

    fn mean_varies_more(&self, images: &Images) -> (Verdict, String) {
        let judge = |quantity: usize| {
            let more =
                |drawn: &[usize]| images.spread(MEAN, drawn) - images.spread(quantity, drawn);
            let mut stream = stream(self.specification.seed, "spread", &[]);
            let interval = bootstrap(images.outcomes.len(), more, &mut stream);
            Verdict::of(&interval, 0.0, f64::INFINITY)
        };
        let verdict = match (judge(MINIMUM).max(judge(MAXIMUM)), judge(THRESHOLD)) {
            (bounds, Verdict::Reproduced) => bounds.min(Verdict::Partly),
            (_, threshold) => threshold,
        };
        let spreads = QUANTITIES.into_iter().enumerate();
        let spreads = spreads.map(|(q, name)| format!("{name} {:.4}", images.spread_of_all(q)));
        let what = format!("sd of {}", spreads.collect::<Vec<_>>().join(", "));
        (verdict, what)
    }

    fn mean_rises(&self, images: &Images) -> (Verdict, String) {
        let seed = self.specification.seed;
        let arm = images.correlation(MEAN, &images.visible, seed);
        let both = images.correlation(MEAN, &images.foreground, seed);
        let what = format!(
            "rank correlation {:.2} (95 % interval {:.2} to {:.2}), {:.2} with the pixels of both arms",
            arm.mean, arm.low, arm.high, both.mean
        );
        (Verdict::of(&arm, 0.0, f64::INFINITY), what)
    }
}

fn bounds_constant(images: &Images, share: f64) -> (Verdict, String) {
    let range = mean(&images.values[MAXIMUM]) - mean(&images.values[MINIMUM]);
    let spreads = (MINIMUM..=MAXIMUM).map(|quantity| images.spread_of_all(quantity) / range);
    let spreads: Vec<f64> = spreads.collect();
    let largest = spreads.iter().copied().fold(0.0, f64::max);
    let verdict = match largest {
        l if l <= share => Verdict::Reproduced,
        l if l <= 3.0 * share => Verdict::Partly,
        _ => Verdict::Not,
    };
    let names = QUANTITIES.iter().zip(&spreads);
    let named: Vec<String> = names
        .map(|(name, spread)| format!("{name} {:.1} %", 100.0 * spread))
        .collect();
    (verdict, format!("sd of {} of the range", named.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::image::{ImageEstimate, ThresholdEstimate};
    use crate::random::unit;

    /// 30 images in 3 folds, whose forests' confidences lie apart by `offset`; the mean confidence
    /// rises with the visible pixels.
    fn images(offset: f32) -> Images {
        let mut random = stream(1, "confidences", &[]);
        let mut outcome = |image: usize| {
            let low = offset * (image % 3) as f32 + 0.1 * unit(&mut random) as f32;
            let thresholds = vec![ThresholdEstimate {
                pose: Vec::new(),
                pixels: 1000,
                foreground: 2 * image,
            }];
            Outcome {
                arm_seen: true,
                sure_pixels: None,
                image,
                fold: image % 3,
                truth: Vec::new(),
                estimate: ImageEstimate {
                    min_confidence: low,
                    mean_confidence: f64::from(offset) * (image % 3) as f64 + 0.01 * image as f64,
                    max_confidence: 4.0,
                    thresholds,
                },
                constant: Vec::new(),
                valid: 1000,
                visible: image,
            }
        };
        let outcomes = (0..30).map(&mut outcome).collect();
        Images::new(ObjectiveKind::named("mse").unwrap(), outcomes, 90)
    }

    #[test]
    fn the_scale_of_a_forest_does_not_count() {
        let (alike, apart) = (images(0.0), images(1.0));
        for quantity in 0..QUANTITIES.len() {
            let (one, other) = (alike.spread_of_all(quantity), apart.spread_of_all(quantity));
            assert!((one - other).abs() < 1e-6, "{one} {other}");
        }
        // The threshold lies nine tenths of the way from the minimum to the maximum.
        let (low, threshold) = (alike.spread_of_all(MINIMUM), alike.spread_of_all(THRESHOLD));
        assert!((threshold - 0.1 * low).abs() < 1e-7 && alike.spread_of_all(MAXIMUM) == 0.0);
        let rises = apart.correlation(MEAN, &apart.visible, 1);
        assert!(rises.mean > 0.9 && rises.low > 0.5 && rises.high <= 1.0);
    }

    #[test]
    fn bounds_are_judged_by_their_share_of_the_range() {
        let images = images(0.0);
        let range = 4.0 - mean(&images.values[MINIMUM]);
        let share = images.spread_of_all(MINIMUM) / range;
        let verdict = |factor: f64| bounds_constant(&images, factor * share).0;
        assert_eq!(verdict(1.01), Verdict::Reproduced);
        assert_eq!(verdict(0.99), Verdict::Partly);
        assert_eq!(verdict(0.33), Verdict::Not);
    }
}
