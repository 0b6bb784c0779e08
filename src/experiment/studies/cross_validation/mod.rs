//! Training objectives compared by cross-validation (section IV-D, Fig. 9).

mod report;
mod verdicts;

use crate::experiment::protocol::{
    CrossValidation, FLOOR_COLOUR, Outcome, PoseError, Protocol, Ruler, colour, step_of,
};
use crate::experiment::statistics::mean;
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::task::Task;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::forest::objective::ObjectiveKind;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
pub use verdicts::Test;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    pub objectives: Vec<&'static ObjectiveKind>,
    /// The relative threshold of eq. 12.
    pub t_r: f64,
    pub protocol: Protocol,
}

struct CrossValidationStudy {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    /// The tasks of each objective.
    tasks: Vec<(&'static ObjectiveKind, Vec<Arc<EstimatesTask>>)>,
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
        let estimates = self.tasks.iter().flat_map(|(_, tasks)| tasks);
        Ok(self.validation.tasks(estimates))
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let (rig, arm) = self.validation.set.rig()?;
        let ruler = Ruler::new(&rig, arm)?;
        let mut methods = Vec::new();
        for (objective, tasks) in &self.tasks {
            let outcomes = self.validation.outcomes(tasks, done)?;
            if methods.is_empty() {
                methods.push(Method {
                    id: "truth",
                    title: "truth",
                    colour: FLOOR_COLOUR,
                    results: Tested::all(&outcomes, &ruler, |o| o.truth.clone()),
                });
                methods.push(Method {
                    id: "constant-pose",
                    title: "constant pose",
                    colour: FLOOR_COLOUR,
                    results: Tested::all(&outcomes, &ruler, |o| o.constant.clone()),
                });
            }
            let chosen = |o: &Outcome| o.estimate.thresholds[self.step].pose.clone();
            methods.push(Method {
                id: objective.id,
                title: objective.title,
                colour: colour(objective),
                results: Tested::all(&outcomes, &ruler, chosen),
            });
        }
        self.report_on(&methods, ruler.joints())
    }
}
