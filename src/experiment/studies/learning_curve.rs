//! The error over the number of training images: is the method limited by data, by its features, or by
//! what is averaged?

use super::cross_validation::Parameters as Comparison;
use super::segmentation::sight;
use crate::dataset::DataSet;
use crate::estimator::error::mean_pose;
use crate::estimator::image::ImageEstimate;
use crate::experiment::claims::{Claim, ClaimResult, Verdict, difference};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{Ruler, step_of};
use crate::experiment::statistics::{Interval, bootstrap_mean, mean};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::data_set::DataSetTask;
use crate::experiment::tasks::estimates::EstimatesTask;
use crate::experiment::tasks::pose_forest::PoseForestTask;
use crate::experiment::tasks::sight::{SegmentationKind, Sight};
use crate::forest::objective::ObjectiveKind;
use crate::random::stream;
use crate::training::Training;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The cross-validation whose images are tested on, with its features, forest, sigma and t_r.
    pub study: String,
    /// The training images: a file of `data/sets/`, without extension, of other images than those.
    pub set: String,
    pub objective: &'static ObjectiveKind,
    /// Numbers of training images, ascending. They are segmented by the truth.
    pub images: Vec<usize>,
    /// Each forest is trained on at most so many pixels; fewer an image when there are more images.
    pub samples: usize,
    /// What the test images are segmented by.
    pub segmentation: Vec<SegmentationKind>,
    /// So many features a node are tried once more, on the most images.
    pub features_per_node: usize,
}

/// How a claim is tested: with the most images the error is smaller than with `than` images.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    SmallerThanWith(usize),
}

/// A forest and the ways in which the test images are segmented for it.
struct Tried {
    images: usize,
    features_per_node: usize,
    estimates: Vec<(SegmentationKind, Arc<EstimatesTask>)>,
}

struct LearningCurve {
    specification: Specification<Parameters, Test>,
    /// The set of the training images and that of the test images.
    training: Arc<DataSetTask>,
    test: Arc<DataSetTask>,
    tried: Vec<Tried>,
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
    let Some(&most) = parameters.images.last() else {
        bail!("`images` must name at least one number");
    };
    if !parameters.images.is_sorted() || parameters.images[0] == 0 {
        bail!("`images` must ascend from at least 1");
    }
    let of_training = &of.protocol.training;
    if !(1..=of_training.features.count).contains(&parameters.features_per_node) {
        let count = of_training.features.count;
        bail!("features_per_node: choose 1 to {count}, the number of features");
    }
    let set = Arc::new(DataSetTask::new(root, &parameters.set, most, *seed)?);
    let test = DataSetTask::new(root, &of.protocol.set, of.protocol.images, *seed)?;
    let test = Arc::new(test);
    let place = (&**root, *profile, *seed);
    let mut sights = Vec::new();
    for &kind in &parameters.segmentation {
        sights.push((kind, sight(kind, &of.segmentation_study, place, &test)?));
    }
    let truth = Sight::new(SegmentationKind::Truth, || bail!("not needed"))?;
    let usual = of_training.forest.features_per_node;
    let sizes = parameters.images.iter().map(|&images| (images, usual));
    let mut tried = Vec::new();
    for (images, features_per_node) in sizes.chain([(most, parameters.features_per_node)]) {
        let mut training: Training = of_training.clone();
        let pixels = training.samples_per_image();
        let fewer = pixels.min(parameters.samples / images).max(1);
        training.foreground = training.foreground * fewer / pixels;
        training.background = fewer - training.foreground;
        training.forest.features_per_node = features_per_node;
        let forest = Arc::new(PoseForestTask {
            set: set.clone(),
            images: (0..images).collect(),
            objective: parameters.objective,
            training,
            sight: truth.clone(),
            fold: 0,
        });
        let estimates = sights.iter().map(|(kind, sight)| {
            let (forest, set) = (forest.clone(), test.clone());
            let sigma = of.protocol.sigma;
            let task = EstimatesTask::of_other_set(forest, set, sight.clone(), sigma)?;
            Ok((*kind, Arc::new(task)))
        });
        tried.push(Tried {
            images,
            features_per_node,
            estimates: estimates.collect::<Result<_>>()?,
        });
    }
    Ok(Box::new(LearningCurve {
        specification,
        training: set,
        test,
        tried,
        step,
    }))
}

/// The errors of a forest in the test images, degrees.
struct Curve {
    images: usize,
    features_per_node: usize,
    segmentation: SegmentationKind,
    /// At t_r.
    error: Vec<f64>,
    /// At the threshold that is best for each image, which nobody can know: what a better choice of
    /// pixels could bring.
    best: Vec<f64>,
    disp_m: Vec<f64>,
}

impl Study for LearningCurve {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let mut tasks: Vec<Arc<dyn Task>> = vec![self.training.clone(), self.test.clone()];
        for (_, task) in self.tried.iter().flat_map(|tried| &tried.estimates) {
            tasks.push(task.clone());
        }
        Ok(tasks)
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let (rig, arm) = self.test.rig()?;
        let ruler = Ruler::new(&rig, arm)?;
        let test = DataSet::open(&done(&*self.test)?)?;
        let training = DataSet::open(&done(&*self.training)?)?;
        let mut curves = Vec::new();
        let mut constant = Vec::new();
        for tried in &self.tried {
            for (segmentation, task) in &tried.estimates {
                let poses = task.forest.images.iter().map(|&image| training.pose(image));
                let mean_pose = mean_pose(poses, training.circular());
                let mut curve = Curve {
                    images: tried.images,
                    features_per_node: tried.features_per_node,
                    segmentation: *segmentation,
                    error: Vec::new(),
                    best: Vec::new(),
                    disp_m: Vec::new(),
                };
                constant.clear();
                for estimated in EstimatesTask::read(&done(&**task)?)? {
                    let truth = test.pose(estimated.image);
                    let guess = || ImageEstimate::guess(&mean_pose);
                    let thresholds = estimated.estimate.unwrap_or_else(guess).thresholds;
                    let errors = thresholds.iter().map(|at| ruler.measure(truth, &at.pose));
                    let errors: Vec<_> = errors.collect();
                    let lowest = errors.iter().map(|e| e.all_deg).fold(f64::MAX, f64::min);
                    curve.error.push(errors[self.step].all_deg);
                    curve.disp_m.push(errors[self.step].disp_m);
                    curve.best.push(lowest);
                    constant.push(ruler.measure(truth, &mean_pose).all_deg);
                }
                curves.push(curve);
            }
        }
        let summary = self.summary(&curves, mean(&constant));
        let claims = self.specification.claims.iter();
        Ok(Report {
            data: data(&curves),
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(
                self.specification.id.clone(),
                self.figure(&curves, mean(&constant)),
            )],
            claims: claims.map(|claim| self.judge(claim, &curves)).collect(),
        })
    }
}

impl LearningCurve {
    /// 95 % interval of a mean over images.
    fn interval(&self, errors: &[f64]) -> Interval {
        let mut stream = stream(self.specification.seed, "learning curve", &[]);
        bootstrap_mean(errors, &mut stream)
    }

    fn is_usual(&self, curve: &Curve) -> bool {
        curve.features_per_node == self.tried[0].features_per_node
    }

    fn figure(&self, curves: &[Curve], constant: f64) -> Figure {
        let mut marks = Vec::new();
        let kinds = &self.specification.parameters.segmentation;
        for (colour, &kind) in kinds.iter().enumerate() {
            let of_kind = || curves.iter().filter(move |c| c.segmentation == kind);
            let usual = || of_kind().filter(|c| self.is_usual(c));
            let bars = usual().map(|c| {
                let Interval { low, high, .. } = self.interval(&c.error);
                (c.images as f64, low, high)
            });
            let points = |of: fn(&Curve) -> &Vec<f64>| {
                let points = usual().map(|c| (c.images as f64, mean(of(c))));
                points.collect::<Vec<_>>()
            };
            let more = of_kind().filter(|c| !self.is_usual(c));
            let more = more.map(|c| (c.images as f64, mean(&c.error)));
            let features = self.specification.parameters.features_per_node;
            let title = kind.title();
            marks.extend([
                Mark::new("", colour, Shape::Errors(bars.collect())),
                Mark::new(title, colour, Shape::Line(points(|c| &c.error))),
                Mark::new(
                    &format!("{title}, best threshold for each image"),
                    colour,
                    Shape::Dashed(points(|c| &c.best)),
                ),
                Mark::new(
                    &format!("{title}, {features} features a node"),
                    colour + 3,
                    Shape::Scatter(more.collect()),
                ),
            ]);
        }
        marks.push(Mark::new("constant pose", 7, Shape::Level(constant)));
        Figure {
            title: self.specification.title.clone(),
            caption: "Means over the test images of fig9; whiskers: 95 % bootstrap intervals."
                .to_owned(),
            panels: vec![Panel::Plot(Plot {
                title: String::new(),
                x: Axis::new("training images").log(),
                y: Axis::new("mean absolute joint error (deg)").including(0.0, 0.0),
                marks,
            })],
            columns: 1,
            size: (1200, 900),
        }
    }

    fn summary(&self, curves: &[Curve], constant: f64) -> Table {
        let mut table = Table::new([
            "images",
            "features_per_node",
            "segmentation",
            "error_deg",
            "error_low_deg",
            "error_high_deg",
            "best_threshold_deg",
            "disp_m",
            "constant_deg",
        ]);
        for curve in curves {
            let Interval {
                mean: of,
                low,
                high,
            } = self.interval(&curve.error);
            table.push([
                curve.images.into(),
                curve.features_per_node.into(),
                curve.segmentation.id().into(),
                of.into(),
                low.into(),
                high.into(),
                mean(&curve.best).into(),
                mean(&curve.disp_m).into(),
                constant.into(),
            ]);
        }
        table
    }

    fn judge(&self, claim: &Claim<Test>, curves: &[Curve]) -> ClaimResult {
        let Some(Test::SmallerThanWith(than)) = claim.test else {
            return claim.without_test();
        };
        // By the segmentation that is named first.
        let first = self.specification.parameters.segmentation.first();
        let of = |images: usize| {
            let found = curves
                .iter()
                .filter(|c| self.is_usual(c) && c.images == images);
            found.into_iter().find(|c| Some(&c.segmentation) == first)
        };
        let most = self.specification.parameters.images.last();
        let (Some(few), Some(many)) = (of(than), most.and_then(|&most| of(most))) else {
            return claim.not_checkable(&format!("no forest was trained on {than} images"));
        };
        let mut stream = stream(self.specification.seed, "claim", &[]);
        let gap = difference(&few.error, &many.error, &mut stream);
        let ours = format!(
            "{:.2} deg with {than} images, {:.2} deg with {}: {:.2} deg less, 95 % interval {:.2} to {:.2}",
            mean(&few.error),
            mean(&many.error),
            many.images,
            gap.mean,
            gap.low,
            gap.high
        );
        let verdict = Verdict::of(&gap, 0.0, f64::INFINITY);
        claim.result(ours, few.error.len(), verdict)
    }
}

fn data(curves: &[Curve]) -> Table {
    let mut table = Table::new([
        "images",
        "features_per_node",
        "segmentation",
        "image",
        "error_deg",
        "best_threshold_deg",
        "disp_m",
    ]);
    for curve in curves {
        for image in 0..curve.error.len() {
            table.push([
                curve.images.into(),
                curve.features_per_node.into(),
                curve.segmentation.id().into(),
                image.into(),
                curve.error[image].into(),
                curve.best[image].into(),
                curve.disp_m[image].into(),
            ]);
        }
    }
    table
}
