//! Estimates of single images, from the best to the worst, with the confidence of their pixels
//! (Fig. 6).

use super::{ESTIMATE, TRUTH, look, overlay};
use crate::dataset::DataSet;
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{DepthPanel, Figure, Panel};
use crate::experiment::protocol::{CrossValidation, Outcome, Ruler, step_of};
use crate::experiment::statistics::bootstrap_mean;
use crate::experiment::studies::cross_validation::Parameters as Comparison;
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::experiment::tasks::pose_forest::FOREST_FILE;
use crate::forest::objective::ObjectiveKind;
use crate::forest::pose_forest::PoseForest;
use crate::random::stream;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The cross-validation whose forest is looked at: that of its first fold, without segmentation.
    pub study: String,
    pub objective: &'static ObjectiveKind,
    /// How many test images are shown: spread evenly from the best to the worst.
    pub images: usize,
}

/// How a claim is tested.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// The share of foreground among the chosen pixels of an image is above that among all.
    ChosenOnArm,
}

struct Estimates {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    task: Arc<EstimatesTask>,
    step: usize,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let Specification {
        root,
        profile,
        seed,
        parameters,
        ..
    } = &specification;
    let of: Comparison = parameters_of(root, *profile, &parameters.study)?;
    let step = step_of(of.t_r)?;
    let validation = CrossValidation::new(root, *seed, of.protocol)?;
    let tasks = validation.estimates(parameters.objective)?;
    let task = tasks[0].clone();
    if !(2..=task.images.len()).contains(&parameters.images) {
        bail!(
            "images = {}: choose 2 to {}, the number of test images of a fold",
            parameters.images,
            task.images.len()
        );
    }
    Ok(Box::new(Estimates {
        specification,
        validation,
        task,
        step,
    }))
}

impl Study for Estimates {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let mut tasks = self.validation.tasks([&self.task]);
        tasks.push(self.task.forest.clone());
        Ok(tasks)
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let (rig, arm) = self.validation.set.rig()?;
        let ruler = Ruler::new(&rig, arm)?;
        let set = DataSet::open(&done(&*self.validation.set)?)?;
        let mut forest = PoseForest::load(&done(&*self.task.forest)?.join(FOREST_FILE))?;
        forest.set_sigma(self.task.sigma)?;
        let outcomes = self
            .validation
            .outcomes(std::slice::from_ref(&self.task), done)?;
        let chosen = |o: &Outcome| o.estimate.thresholds[self.step].clone();
        let error = |o: &Outcome| ruler.measure(&o.truth, &chosen(o).pose).all_deg;
        let mut from_best: Vec<(f64, &Outcome)> = outcomes.iter().map(|o| (error(o), o)).collect();
        from_best.sort_by(|a, b| a.0.total_cmp(&b.0));

        let shown = self.specification.parameters.images;
        let place = |at: usize| from_best[at * (from_best.len() - 1) / (shown - 1)];
        let mut panels = Vec::new();
        let mut summary = Table::new([
            "place",
            "image",
            "error_deg",
            "constant_error_deg",
            "visible_px",
            "chosen_px",
            "chosen_foreground_px",
        ]);
        for at in 0..shown {
            let (error, outcome) = place(at);
            let image = outcome.image;
            let seen = self.task.forest.sight.look(&set, None, image)?;
            let looked = look(&forest, &seen, self.step)?;
            let chosen = chosen(outcome);
            let poses = [(&*outcome.truth, TRUTH), (&*chosen.pose, ESTIMATE)];
            let title = format!("(b) image {image}: error {error:.1} deg");
            let depth = &seen.frame.depth;
            panels.push(Panel::Depth(DepthPanel {
                title: "(a) depth".to_owned(),
                image: depth.clone(),
                range_mm: (500, 5000),
            }));
            let drawn = overlay(&title, &set, &rig, image, &seen.frame, &poses)?;
            panels.push(Panel::Picture(drawn));
            for (title, chosen_only) in [("(c) confidence", false), ("(d) chosen pixels", true)] {
                let map = looked.confidence_map(title, depth, chosen_only);
                panels.push(Panel::Picture(map));
            }
            let constant = ruler.measure(&outcome.truth, &outcome.constant).all_deg;
            summary.push([
                at.into(),
                image.into(),
                error.into(),
                constant.into(),
                outcome.visible.into(),
                chosen.pixels.into(),
                chosen.foreground.into(),
            ]);
        }
        let mut data = Table::new([
            "image",
            "error_deg",
            "visible_px",
            "valid_px",
            "valid_foreground_px",
            "chosen_px",
            "chosen_foreground_px",
        ]);
        for outcome in &outcomes {
            let (all, chosen) = (&outcome.estimate.thresholds[0], chosen(outcome));
            data.push([
                outcome.image.into(),
                error(outcome).into(),
                outcome.visible.into(),
                outcome.valid.into(),
                all.foreground.into(),
                chosen.pixels.into(),
                chosen.foreground.into(),
            ]);
        }
        let claims = self.specification.claims.iter();
        let figure = Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Test images from the best to the worst, estimated by a forest trained on {} images. (b) \
                 blue: true pose, orange: estimate. (c) red: the image's highest confidence, blue: its \
                 lowest. (d) pixels above the threshold.",
                self.task.forest.images.len()
            ),
            panels,
            columns: 4,
            size: (1500, 250 * shown as u32 + 110),
        };
        Ok(Report {
            data,
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), figure)],
            claims: claims.map(|claim| self.judge(claim, &outcomes)).collect(),
        })
    }
}

impl Estimates {
    fn judge(&self, claim: &Claim<Test>, outcomes: &[Outcome]) -> ClaimResult {
        let Some(Test::ChosenOnArm) = claim.test else {
            return claim.without_test();
        };
        let share = |outcome: &Outcome, step: usize| {
            let at = &outcome.estimate.thresholds[step];
            at.foreground as f64 / at.pixels as f64
        };
        let gains: Vec<f64> = outcomes
            .iter()
            .map(|outcome| 100.0 * (share(outcome, self.step) - share(outcome, 0)))
            .collect();
        let mut stream = stream(self.specification.seed, "claim", &[]);
        let gap = bootstrap_mean(&gains, &mut stream);
        let ours = format!(
            "the share of foreground among the chosen pixels is {:.0} points above that among all, 95 % \
             interval {:.0} to {:.0}",
            gap.mean, gap.low, gap.high
        );
        claim.result(ours, gains.len(), Verdict::of(&gap, 0.0, f64::INFINITY))
    }
}
