//! The way of one image from depth to pose, and what each step costs (Fig. 5).

use super::{ESTIMATE, TRUTH, look, overlay};
use crate::dataset::DataSet;
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{DepthPanel, Figure, Panel, PicturePanel};
use crate::experiment::protocol::{CrossValidation, Outcome, Ruler, step_of};
use crate::experiment::statistics::{bootstrap_mean, mean};
use crate::experiment::studies::cross_validation::Parameters as Comparison;
use crate::experiment::studies::segmentation::{class_colours, class_legend, sight};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::experiment::tasks::estimation_times::{EstimationTimesTask, Timed};
use crate::experiment::tasks::pose_forest::FOREST_FILE;
use crate::experiment::tasks::segmentation::SegmentationTask;
use crate::experiment::tasks::sight::SegmentationKind;
use crate::forest::objective::ObjectiveKind;
use crate::forest::pose_forest::PoseForest;
use crate::random::stream;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The cross-validation whose first fold is looked at.
    pub study: String,
    pub objective: &'static ObjectiveKind,
    /// Each time is the shortest of so many.
    pub repetitions: usize,
}

/// How a claim is tested: over images, the time of the first thing less that of the second is above
/// zero.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Test {
    longer: Step,
    shorter: Step,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Step {
    /// Nothing at all.
    Nothing,
    Segmenting,
    /// Estimating from all pixels.
    Whole,
    /// Estimating from the pixels that segmentation leaves.
    Segmented,
    /// Segmenting and then estimating from what is left.
    Both,
}

impl Step {
    fn title(self) -> &'static str {
        match self {
            Step::Nothing => "nothing",
            Step::Segmenting => "segmenting",
            Step::Whole => "estimating from the whole image",
            Step::Segmented => "estimating from the segmented image",
            Step::Both => "segmenting and estimating",
        }
    }

    fn of(self, timed: &Timed) -> f64 {
        match self {
            Step::Nothing => 0.0,
            Step::Segmenting => timed.segmenting_s,
            Step::Whole => timed.whole_s,
            Step::Segmented => timed.segmented_s,
            Step::Both => timed.segmenting_s + timed.segmented_s,
        }
    }
}

struct Pipeline {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    task: Arc<EstimatesTask>,
    times: Arc<EstimationTimesTask>,
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
    let place = (&**root, *profile, *seed);
    let kind = SegmentationKind::Forest;
    let sight = sight(kind, &of.segmentation_study, place, &validation.set)?;
    let Some(segmentation) = sight.segmentation() else {
        bail!("there is no segmentation to look at");
    };
    let task = validation.estimates_seen(parameters.objective, &sight)?[0].clone();
    let whole = validation.estimates(parameters.objective)?[0].clone();
    Ok(Box::new(Pipeline {
        times: Arc::new(EstimationTimesTask {
            whole,
            segmented: task.clone(),
            segmentation,
            parts: None,
            repetitions: parameters.repetitions,
            threads: None,
        }),
        specification,
        validation,
        task,
        step,
    }))
}

impl Study for Pipeline {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let mut tasks = self.validation.tasks([&self.task]);
        tasks.push(self.task.forest.clone());
        tasks.push(self.times.segmentation.clone());
        tasks.push(self.times.clone());
        Ok(tasks)
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let times = EstimationTimesTask::read(&done(&*self.times)?)?;
        let mut data = Table::new(["image", "segmenting_s", "whole_s", "segmented_s"]);
        for timed in &times {
            data.push([
                timed.image.into(),
                timed.segmenting_s.into(),
                timed.whole_s.into(),
                timed.segmented_s.into(),
            ]);
        }
        let mut summary = Table::new(["step", "ms_per_image", "of_whole"]);
        let mean_of = |step: Step| mean(&times.iter().map(|t| step.of(t)).collect::<Vec<_>>());
        for step in [Step::Whole, Step::Segmenting, Step::Segmented, Step::Both] {
            let share = mean_of(step) / mean_of(Step::Whole);
            summary.push([
                step.title().into(),
                (1e3 * mean_of(step)).into(),
                share.into(),
            ]);
        }
        let claims = self.specification.claims.iter();
        Ok(Report {
            data,
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), self.figure(done)?)],
            claims: claims.map(|claim| self.judge(claim, &times)).collect(),
        })
    }
}

impl Pipeline {
    /// The test image with the median error, among the half that shows most of the arm, step by step.
    fn figure(&self, done: Done<'_>) -> Result<Figure> {
        let (rig, arm) = self.validation.set.rig()?;
        let ruler = Ruler::new(&rig, arm)?;
        let set = DataSet::open(&done(&*self.validation.set)?)?;
        let mut forest = PoseForest::load(&done(&*self.task.forest)?.join(FOREST_FILE))?;
        forest.set_sigma(self.task.sigma)?;
        let segmented = done(&*self.times.segmentation)?;
        let outcomes = self
            .validation
            .outcomes(std::slice::from_ref(&self.task), done)?;
        let pose = |o: &Outcome| o.estimate.thresholds[self.step].pose.clone();
        let mut visible: Vec<usize> = outcomes.iter().map(|outcome| outcome.visible).collect();
        visible.sort_unstable();
        let median = visible.get(visible.len() / 2).copied().unwrap_or(0);
        let mut from_best: Vec<(f64, &Outcome)> = outcomes
            .iter()
            .filter(|outcome| outcome.arm_seen && outcome.visible >= median)
            .map(|o| (ruler.measure(&o.truth, &pose(o)).all_deg, o))
            .collect();
        from_best.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (error, outcome) = from_best
            .get(from_best.len() / 2)
            .context("no test image shows the arm")?;
        let image = outcome.image;
        let frame = set.frame(image)?;
        let seen = self.task.forest.sight.look(&set, Some(&segmented), image)?;
        let looked = look(&forest, &seen, self.step)?;
        let found = SegmentationTask::read(&segmented, image, &set.camera().intrinsics)?;
        let depth = |title: &str, image| {
            Panel::Depth(DepthPanel {
                title: title.to_owned(),
                image,
                range_mm: (500, 5000),
            })
        };
        let left = &seen.frame.depth;
        let confidence = looked.confidence_map("confidence of the pose forest", left, false);
        let estimate = pose(outcome);
        let poses = [(&*outcome.truth, TRUTH), (&*estimate, ESTIMATE)];
        let title = format!("pose (orange), truth (blue): {error:.1} deg");
        let drawn = overlay(&title, &set, &rig, image, &frame, &poses)?;
        Ok(Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Image {image}: of the test images of a fold, among the half that shows most of the arm, \
                 the one with the median error. {} All but the pixels of the estimated arm become \
                 invalid; features are computed after that. Confidence: red is the image's highest, \
                 blue its lowest.",
                class_legend(&set)
            ),
            panels: vec![
                depth("depth image", frame.depth.clone()),
                Panel::Picture(PicturePanel {
                    title: "classes of the segmentation forest".to_owned(),
                    image: class_colours(&found.classes, &frame.depth),
                }),
                depth("segmented image", left.clone()),
                Panel::Picture(confidence),
                Panel::Picture(drawn),
            ],
            columns: 5,
            size: (2600, 500),
        })
    }

    fn judge(&self, claim: &Claim<Test>, times: &[Timed]) -> ClaimResult {
        let Some(Test { longer, shorter }) = claim.test else {
            return claim.without_test();
        };
        let gaps: Vec<f64> = times
            .iter()
            .map(|timed| 1e3 * (longer.of(timed) - shorter.of(timed)))
            .collect();
        let mut stream = stream(self.specification.seed, "claim", &[]);
        let gap = bootstrap_mean(&gaps, &mut stream);
        let ours = format!(
            "{} less {}: {:.1} ms an image, 95 % interval {:.1} to {:.1}",
            longer.title(),
            shorter.title(),
            gap.mean,
            gap.low,
            gap.high
        );
        claim.result(ours, gaps.len(), Verdict::of(&gap, 0.0, f64::INFINITY))
    }
}
