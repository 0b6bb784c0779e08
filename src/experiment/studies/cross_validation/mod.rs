//! Training objectives compared by cross-validation (section IV-D, Fig. 9).

mod images;
pub mod report;
pub mod verdicts;

use crate::dataset::DataSet;
use crate::experiment::protocol::{
    CrossValidation, FLOOR_COLOUR, Outcome, PoseError, Protocol, Ruler, colour, step_of,
};
use crate::experiment::statistics::mean;
use crate::experiment::studies::segmentation::sight;
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::task::Task;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::experiment::tasks::sight::SegmentationKind;
use crate::forest::objective::ObjectiveKind;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
pub use verdicts::Test;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    pub objectives: Vec<&'static ObjectiveKind>,
    /// How images are segmented before; every objective with every way.
    #[serde(default = "unsegmented")]
    pub segmentation: Vec<SegmentationKind>,
    /// The study whose segmentation forest is used.
    #[serde(default = "table1")]
    pub segmentation_study: String,
    /// The relative threshold of eq. 12.
    pub t_r: f64,
    /// The method, as claims call it, whose best, median and worst image are shown; none if it is not
    /// among those compared.
    #[serde(default)]
    pub shown: String,
    pub protocol: Protocol,
}

fn unsegmented() -> Vec<SegmentationKind> {
    vec![SegmentationKind::None]
}

fn table1() -> String {
    "table1".to_owned()
}

struct CrossValidationStudy {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    tasks: Vec<Compared>,
    step: usize,
}

/// The tasks of an objective, on images segmented in one way.
struct Compared {
    objective: &'static ObjectiveKind,
    segmentation: SegmentationKind,
    estimates: Vec<Arc<EstimatesTask>>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let Parameters {
        objectives,
        segmentation,
        segmentation_study,
        t_r,
        shown,
        protocol,
    } = &specification.parameters;
    if !shown.is_empty() {
        verdicts::known(shown).context("`shown`")?;
    }
    if objectives.is_empty() || segmentation.is_empty() {
        bail!("`objectives` and `segmentation` must name at least one each");
    }
    let step = step_of(*t_r)?;
    let validation =
        CrossValidation::new(&specification.root, specification.seed, protocol.clone())?;
    let mut tasks = Vec::new();
    for &segmentation in segmentation {
        let place = (
            &*specification.root,
            specification.profile,
            specification.seed,
        );
        let sight = sight(segmentation, segmentation_study, place, &validation.set)?;
        for &objective in objectives {
            tasks.push(Compared {
                objective,
                segmentation,
                estimates: validation.estimates_seen(objective, &sight)?,
            });
        }
    }
    Ok(Box::new(CrossValidationStudy {
        specification,
        validation,
        tasks,
        step,
    }))
}

/// A row of the comparison: an objective on images segmented in one way, or the floor or the ceiling
/// beside them.
struct Method {
    id: &'static str,
    title: &'static str,
    segmentation: SegmentationKind,
    colour: usize,
    /// In the order of the images.
    results: Vec<Tested>,
}

/// One image by one method.
struct Tested {
    outcome: Outcome,
    estimate: Vec<f64>,
    error: PoseError,
}

impl Tested {
    fn all(
        outcomes: &[Outcome],
        ruler: &Ruler,
        estimate: impl Fn(&Outcome) -> Vec<f64>,
    ) -> Vec<Tested> {
        let test = |outcome: &Outcome| {
            let estimate = estimate(outcome);
            let error = ruler.measure(&outcome.truth, &estimate);
            Tested {
                outcome: outcome.clone(),
                estimate,
                error,
            }
        };
        outcomes.iter().map(test).collect()
    }
}

impl Method {
    /// As claims call it: "mse", or "mse/forest" with segmentation.
    fn name(&self) -> String {
        match self.segmentation {
            SegmentationKind::None => self.id.to_owned(),
            kind => format!("{}/{}", self.id, kind.id()),
        }
    }

    /// Whether it is the truth or the constant pose.
    fn is_reference(&self) -> bool {
        matches!(self.id, "truth" | "constant-pose")
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

impl Study for CrossValidationStudy {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let estimates = self.tasks.iter().flat_map(|compared| &compared.estimates);
        Ok(self.validation.tasks(estimates))
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let (rig, arm) = self.validation.set.rig()?;
        let ruler = Ruler::new(&rig, arm)?;
        let mut methods = Vec::new();
        for compared in &self.tasks {
            let outcomes = self.validation.outcomes(&compared.estimates, done)?;
            if methods.is_empty() {
                methods.push(Method {
                    id: "truth",
                    title: "truth",
                    segmentation: SegmentationKind::None,
                    colour: FLOOR_COLOUR,
                    results: Tested::all(&outcomes, &ruler, |o| o.truth.clone()),
                });
                methods.push(Method {
                    id: "constant-pose",
                    title: "constant pose",
                    segmentation: SegmentationKind::None,
                    colour: FLOOR_COLOUR,
                    results: Tested::all(&outcomes, &ruler, |o| o.constant.clone()),
                });
            }
            let chosen = |o: &Outcome| o.estimate.thresholds[self.step].pose.clone();
            methods.push(Method {
                id: compared.objective.id,
                title: compared.objective.title,
                segmentation: compared.segmentation,
                colour: colour(compared.objective),
                results: Tested::all(&outcomes, &ruler, chosen),
            });
        }
        let set = DataSet::open(&done(&*self.validation.set)?)?;
        self.report_on(&methods, ruler.joints(), (&set, &rig))
    }
}
