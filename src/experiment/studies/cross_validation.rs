//! Training objectives compared by cross-validation (section IV-D, Fig. 9).

use crate::experiment::claims::{Claim, ClaimResult, Verdict, order};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{CrossValidation, Outcome, PoseError, Protocol, Ruler, step_of};
use crate::experiment::statistics::{mean, quantile, spearman, standard_deviation};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::{Cell, Table};
use crate::experiment::task::Task;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::experiment::tasks::pose_forest::ObjectiveName;
use crate::random::stream;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    pub objectives: Vec<ObjectiveName>,
    /// The relative threshold of eq. 12.
    pub t_r: f64,
    pub protocol: Protocol,
}

/// How a claim is tested.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// The error of method `smaller` is below that of `larger`, image by image.
    Order { smaller: String, larger: String },
    /// Of the tenth of images with the largest errors, more than half are among the fifth that
    /// shows the least of the arm.
    WorstShowLittle { method: String },
    /// In most images most of the chosen pixels are foreground.
    ChosenAreForeground { method: String },
}

struct CrossValidationStudy {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    /// The tasks of each objective.
    tasks: Vec<(ObjectiveName, Vec<Arc<EstimatesTask>>)>,
    step: usize,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let Parameters {
        objectives,
        t_r,
        protocol,
    } = &specification.parameters;
    if objectives.is_empty() {
        bail!("`objectives` names none");
    }
    let step = step_of(*t_r)?;
    let validation =
        CrossValidation::new(&specification.root, specification.seed, protocol.clone())?;
    let tasks = objectives
        .iter()
        .map(|&objective| Ok((objective, validation.estimates(objective)?)))
        .collect::<Result<_>>()?;
    Ok(Box::new(CrossValidationStudy {
        specification,
        validation,
        tasks,
        step,
    }))
}

/// A row of the comparison: an objective, or the floor or the ceiling beside them.
struct Method {
    id: &'static str,
    title: &'static str,
    results: Vec<Tested>,
}

/// One image by one method.
struct Tested {
    outcome: Outcome,
    estimate: Vec<f64>,
    error: PoseError,
}

impl Method {
    fn new(
        id: &'static str,
        title: &'static str,
        outcomes: &[Outcome],
        ruler: &Ruler,
        estimate: impl Fn(&Outcome) -> Vec<f64>,
    ) -> Method {
        let test = |outcome: &Outcome| {
            let estimate = estimate(outcome);
            let error = ruler.measure(&outcome.truth, &estimate);
            Tested {
                outcome: outcome.clone(),
                estimate,
                error,
            }
        };
        Method {
            id,
            title,
            results: outcomes.iter().map(test).collect(),
        }
    }

    /// A measure of each image, in the order of the images.
    fn images(&self, measure: impl Fn(&PoseError) -> f64) -> Vec<f64> {
        self.results.iter().map(|r| measure(&r.error)).collect()
    }

    /// Mean over images within each fold.
    fn folds(&self, measure: &dyn Fn(&PoseError) -> f64) -> Vec<f64> {
        let folds = self
            .results
            .iter()
            .map(|r| r.outcome.fold + 1)
            .max()
            .unwrap_or(0);
        let of_fold = |fold| {
            let results = self.results.iter().filter(|r| r.outcome.fold == fold);
            mean(&results.map(|r| measure(&r.error)).collect::<Vec<_>>())
        };
        (0..folds).map(of_fold).collect()
    }
}

/// What is measured, as a column value of the summary and its unit.
type Measure<'a> = (String, &'static str, Box<dyn Fn(&PoseError) -> f64 + 'a>);

fn measures<'a>(joints: &[&str]) -> Vec<Measure<'a>> {
    let mut measures: Vec<Measure> = vec![
        ("all joints".to_owned(), "deg", Box::new(|e| e.all_deg)),
        ("arm joints".to_owned(), "deg", Box::new(|e| e.arm_deg)),
        ("hand joints".to_owned(), "deg", Box::new(|e| e.hand_deg)),
        ("fingertip".to_owned(), "mm", Box::new(|e| e.tip_mm)),
    ];
    for (at, joint) in joints.iter().enumerate() {
        measures.push((
            (*joint).to_owned(),
            "deg",
            Box::new(move |e| e.joints_deg[at]),
        ));
    }
    measures
}

impl Study for CrossValidationStudy {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let estimates = self.tasks.iter().flat_map(|(_, tasks)| tasks);
        Ok(self.validation.tasks(estimates))
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let ruler = self.validation.ruler()?;
        let mut methods = Vec::new();
        for (objective, tasks) in &self.tasks {
            let outcomes = self.validation.outcomes(tasks, done)?;
            if methods.is_empty() {
                let truth = |o: &Outcome| o.truth.clone();
                methods.push(Method::new("truth", "truth", &outcomes, &ruler, truth));
                let constant = |o: &Outcome| o.constant.clone();
                let title = "constant pose";
                methods.push(Method::new(
                    "constant-pose",
                    title,
                    &outcomes,
                    &ruler,
                    constant,
                ));
            }
            let chosen = |o: &Outcome| o.estimate.thresholds[self.step].pose.clone();
            methods.push(Method::new(
                objective.id(),
                objective.title(),
                &outcomes,
                &ruler,
                chosen,
            ));
        }
        let joints = ruler.joints();
        Ok(Report {
            data: self.data(&methods, &joints),
            summary: summary(&methods, &measures(&joints)),
            figures: vec![(
                self.specification.id.clone(),
                self.figure(&methods, &joints),
            )],
            claims: self.claims(&methods)?,
            text: text(&methods, &joints),
        })
    }
}

impl CrossValidationStudy {
    /// A row for each joint of each image by each method but the truth.
    fn data(&self, methods: &[Method], joints: &[&str]) -> Table {
        let mut table = Table::new([
            "image",
            "fold",
            "method",
            "segmentation",
            "joint",
            "truth_rad",
            "estimate_rad",
            "error_deg",
            "visible_px",
            "valid_px",
            "chosen_px",
            "chosen_foreground_px",
            "min_confidence",
            "mean_confidence",
            "max_confidence",
        ]);
        for method in methods.iter().filter(|m| m.id != "truth") {
            let is_constant = method.id == "constant-pose";
            for Tested {
                outcome,
                estimate,
                error,
            } in &method.results
            {
                let confidence = &outcome.estimate;
                let chosen = &confidence.thresholds[self.step];
                let ours = |cell: Cell| if is_constant { Cell::Empty } else { cell };
                for (at, joint) in joints.iter().enumerate() {
                    table.push([
                        outcome.image.into(),
                        outcome.fold.into(),
                        method.id.into(),
                        "none".into(),
                        (*joint).into(),
                        outcome.truth[at].into(),
                        estimate[at].into(),
                        error.joints_deg[at].into(),
                        outcome.visible.into(),
                        outcome.valid.into(),
                        ours(chosen.pixels.into()),
                        ours(chosen.foreground.into()),
                        ours(confidence.min_confidence.into()),
                        ours(confidence.mean_confidence.into()),
                        ours(confidence.max_confidence.into()),
                    ]);
                }
            }
        }
        table
    }

    fn figure(&self, methods: &[Method], joints: &[&str]) -> Figure {
        // The truth has no error to draw.
        let drawn = || methods.iter().skip(1).enumerate();
        let bars = |measure: &dyn Fn(&PoseError) -> f64, method: &Method| {
            let folds = method.folds(measure);
            let (centre, spread) = (mean(&folds), standard_deviation(&folds));
            (centre, Some((centre - spread, centre + spread)))
        };
        let all = measures(joints);
        let plot = |title: &str, axis: &str, of: &[Measure]| {
            let marks = drawn().map(|(at, method)| {
                let heights = of
                    .iter()
                    .map(|(_, _, measure)| bars(measure, method))
                    .collect();
                Mark::new(method.title, colour(at), Shape::Bars(heights))
            });
            Panel::Plot(Plot {
                title: title.to_owned(),
                x: Axis::of("", of.iter().map(|(name, _, _)| name.clone())),
                y: Axis::new(axis).including(0.0, 0.0),
                marks: marks.collect(),
            })
        };
        // By the pixels that show the arm: each image, and the mean of each fifth of the images. A
        // logarithmic axis has no place for none.
        let seen = |r: &Tested| (r.outcome.visible.max(1) as f64, r.error.all_deg);
        let scatter = drawn()
            .filter(|(_, m)| m.id != "constant-pose")
            .map(|(at, method)| {
                let points = method.results.iter().map(seen);
                Mark::new("", colour(at), Shape::Scatter(points.collect()))
            });
        let fifths = drawn().map(|(at, method)| {
            let mut points: Vec<(f64, f64)> = method.results.iter().map(seen).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let fifth = |points: &[(f64, f64)]| {
                let errors: Vec<f64> = points.iter().map(|p| p.1).collect();
                (points[points.len() / 2].0, mean(&errors))
            };
            let size = points.len().div_ceil(5);
            let line = points.chunks(size).map(fifth).collect();
            Mark::new(method.title, colour(at), Shape::Line(line))
        });
        let visibility = Panel::Plot(Plot {
            title: "Error by what is seen of the arm".to_owned(),
            x: Axis::new("visible pixels of the arm").log(),
            y: Axis::new("mean joint error of the image (deg)").including(0.0, 0.0),
            marks: scatter.chain(fifths).collect(),
        });
        let Protocol { images, folds, .. } = &self.specification.parameters.protocol;
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Images without segmentation. Bars: mean over {images} images, each tested by a \
                 forest that had not seen it; whiskers: one standard deviation over {folds} folds. \
                 Last panel: a dot is an image, a line joins the means of its fifths."
            ),
            panels: vec![
                plot("Joint error", "mean absolute error (deg)", &all[..3]),
                plot("Error of the fingertip", "distance (mm)", &all[3..4]),
                plot(
                    "Error of each joint",
                    "mean absolute error (deg)",
                    &all[4..],
                ),
                visibility,
            ],
            columns: 2,
            size: (1800, 1200),
        }
    }

    fn claims(&self, methods: &[Method]) -> Result<Vec<ClaimResult>> {
        let method = |claim: &Claim<Test>, id: &str| {
            let known = || methods.iter().map(|m| m.id).collect::<Vec<_>>().join(", ");
            match methods.iter().find(|m| m.id == id) {
                Some(method) => Ok(method),
                None => bail!(
                    "claim {}: there is no method {id} (there are {})",
                    claim.id,
                    known()
                ),
            }
        };
        let judge = |claim: &Claim<Test>| {
            let images = self.specification.parameters.protocol.images;
            Ok(match &claim.test {
                None => claim.not_checkable("nothing here can test it"),
                Some(Test::Order { smaller, larger }) => {
                    let error =
                        |id| Ok::<_, anyhow::Error>(method(claim, id)?.images(|e| e.all_deg));
                    let mut stream = stream(self.specification.seed, "claim", &[]);
                    let (gap, verdict) = order(&error(smaller)?, &error(larger)?, &mut stream);
                    let ours = format!(
                        "{larger} - {smaller} = {:.2} deg, 95 % interval {:.2} to {:.2}",
                        gap.mean, gap.low, gap.high
                    );
                    claim.result(ours, images, verdict)
                }
                Some(Test::WorstShowLittle { method: id }) => {
                    worst_show_little(claim, method(claim, id)?)
                }
                Some(Test::ChosenAreForeground { method: id }) => {
                    chosen_are_foreground(claim, method(claim, id)?, self.step)
                }
            })
        };
        self.specification.claims.iter().map(judge).collect()
    }
}

fn colour(at: usize) -> usize {
    // The constant pose comes first and is black.
    if at == 0 { 7 } else { at - 1 }
}

fn worst_show_little(claim: &Claim<Test>, method: &Method) -> ClaimResult {
    let visible: Vec<f64> = method
        .results
        .iter()
        .map(|r| r.outcome.visible as f64)
        .collect();
    let errors = method.images(|e| e.all_deg);
    let mut ascending = visible.clone();
    ascending.sort_by(f64::total_cmp);
    let little = quantile(&ascending, 0.2);
    let mut by_error: Vec<usize> = (0..errors.len()).collect();
    by_error.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]));
    let worst = &by_error[..errors.len().div_ceil(10)];
    let share = worst.iter().filter(|&&i| visible[i] <= little).count() as f64 / worst.len() as f64;
    let verdict = match share {
        s if s > 0.5 => Verdict::Reproduced,
        // More than their part of all images.
        s if s > 0.2 => Verdict::Partly,
        _ => Verdict::Not,
    };
    let ours = format!(
        "{:.0} % of the worst tenth are among the fifth with at most {little:.0} pixels of the arm; \
         rank correlation of error and pixels {:.2}",
        100.0 * share,
        spearman(&errors, &visible)
    );
    claim.result(ours, errors.len(), verdict)
}

fn chosen_are_foreground(claim: &Claim<Test>, method: &Method, step: usize) -> ClaimResult {
    let chosen = method
        .results
        .iter()
        .map(|r| &r.outcome.estimate.thresholds[step]);
    let shares: Vec<f64> = chosen
        .map(|c| c.foreground as f64 / c.pixels as f64)
        .collect();
    let all = method
        .results
        .iter()
        .map(|r| &r.outcome.estimate.thresholds[0]);
    let anyway: Vec<f64> = all.map(|c| c.foreground as f64 / c.pixels as f64).collect();
    let mostly = shares.iter().filter(|&&share| share > 0.5).count() as f64 / shares.len() as f64;
    let verdict = match mostly {
        m if m > 0.5 => Verdict::Reproduced,
        _ if mean(&shares) > mean(&anyway) => Verdict::Partly,
        _ => Verdict::Not,
    };
    let ours = format!(
        "in {:.0} % of the images most chosen pixels are foreground; mean share {:.0} % of the chosen, \
         {:.0} % of all valid pixels",
        100.0 * mostly,
        100.0 * mean(&shares),
        100.0 * mean(&anyway)
    );
    claim.result(ours, shares.len(), verdict)
}

/// A row for each measure of each method.
fn summary(methods: &[Method], measures: &[Measure]) -> Table {
    let mut table = Table::new([
        "method",
        "segmentation",
        "measure",
        "unit",
        "error",
        "fold_sd",
        "median_image",
        "images",
    ]);
    for method in methods {
        for (name, unit, measure) in measures {
            let mut images = method.images(measure);
            images.sort_by(f64::total_cmp);
            let folds = method.folds(measure);
            table.push([
                method.id.into(),
                "none".into(),
                name.as_str().into(),
                (*unit).into(),
                mean(&images).into(),
                standard_deviation(&folds).into(),
                quantile(&images, 0.5).into(),
                images.len().into(),
            ]);
        }
    }
    table
}

fn text(methods: &[Method], joints: &[&str]) -> String {
    let measures = measures(joints);
    let mut table = Table::new(
        std::iter::once("mean error (sd over folds)".to_owned())
            .chain(methods.iter().map(|m| m.title.to_owned())),
    );
    for (name, unit, measure) in &measures {
        let row = methods.iter().map(|method| {
            let (centre, spread) = (
                mean(&method.images(measure)),
                standard_deviation(&method.folds(measure)),
            );
            Cell::from(format!("{centre:.2} ({spread:.2})"))
        });
        table.push(std::iter::once(Cell::from(format!("{name} ({unit})"))).chain(row));
    }
    table.to_text()
}
