//! How fast everything is, and beside others.

use super::cross_validation::Parameters as Comparison;
use super::segmentation::sight;
use crate::dataset::DataSet;
use crate::experiment::claims::Claim;
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{CrossValidation, Ruler, step_of};
use crate::experiment::statistics::{mean, median};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::data_set::DataSetTask;
use crate::experiment::tasks::frame_times::FrameTimesTask;
use crate::experiment::tasks::growth_times::{Grown, GrowthTimesTask};
use crate::experiment::tasks::pose_forest::PoseForestTask;
use crate::experiment::tasks::sight::{SegmentationKind, Sight};
use crate::experiment::tasks::walk_times::{STRIDES, Timed, WalkTimes, WalkTimesTask};
use crate::forest::objective::ObjectiveKind;
use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The cross-validation whose first fold is estimated, by its forests and with its t_r.
    pub study: String,
    pub objective: &'static ObjectiveKind,
    pub repetitions: usize,
    pub frames: usize,
    /// The images that trees are grown on: a file of `data/sets/`, without extension, and how many
    /// pixels are drawn from each.
    pub set: String,
    pub pixels: usize,
    /// Numbers of samples that trees are grown on, ascending, and how many trees.
    pub samples: Vec<usize>,
    pub trees: usize,
    pub growth_repetitions: usize,
    pub targets: Targets,
    pub beside: Vec<Beside>,
}

/// What is aimed at.
#[derive(Debug, Clone, Copy, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Targets {
    /// At most: e of a time that grows as n^e, over the sizes in `samples`.
    pub growth_exponent: f64,
    pub frame_ms: f64,
    /// At least, by every pixel and by every second in x and y.
    pub images_per_s: [f64; 2],
    /// At most: by how many percent the mean error is another by fewer pixels.
    pub error_change_percent: f64,
    pub walk_ns: f64,
    pub load_ms: f64,
}

/// A comparison with another program, made by a script: see its file.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Beside {
    pub what: String,
    /// A CSV of the repository with a row for each repetition. Its last line is none of them.
    pub file: String,
    /// Its columns with our times and theirs.
    pub ours: String,
    pub theirs: String,
    pub unit: String,
    /// How many times as fast we are, at least.
    pub target: f64,
}

/// No statement of the paper is tested.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Test {}

struct Speed {
    specification: Specification<Parameters, Test>,
    validation: CrossValidation,
    step: usize,
    frames: Arc<FrameTimesTask>,
    growth: Arc<GrowthTimesTask>,
    walk: Arc<WalkTimesTask>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let Specification {
        root,
        profile,
        seed,
        parameters,
        ..
    } = &specification;
    ensure!(
        parameters.pixels > 0 && parameters.repetitions > 0 && parameters.growth_repetitions > 0,
        "pixels, repetitions and growth_repetitions: choose at least 1"
    );
    if parameters.samples.len() < 2 || !parameters.samples.is_sorted_by(|a, b| 0 < *a && a < b) {
        bail!("samples: choose two numbers or more that ascend");
    }
    let of: Comparison = parameters_of(root, *profile, &parameters.study)?;
    let step = step_of(of.t_r)?;
    let mut training = of.protocol.training.clone();
    let validation = CrossValidation::new(root, *seed, of.protocol)?;
    let place = (&**root, *profile, *seed);
    let kind = SegmentationKind::Forest;
    let sight = sight(kind, &of.segmentation_study, place, &validation.set)?;
    let segmentation = sight.segmentation().context("there is no segmentation")?;

    let images = |samples: usize| samples.div_ceil(parameters.pixels);
    let most = parameters.samples.last().copied().map_or(0, images);
    let set = Arc::new(DataSetTask::new(root, &parameters.set, most, *seed)?);
    training.foreground = training.foreground * parameters.pixels / training.samples_per_image();
    training.background = parameters.pixels - training.foreground;
    training.forest.trees = parameters.trees;
    let forests = parameters.samples.iter().map(|&samples| PoseForestTask {
        set: set.clone(),
        images: (0..images(samples)).collect(),
        objective: parameters.objective,
        training: training.clone(),
        sight: Sight::WHOLE,
        fold: 0,
    });
    Ok(Box::new(Speed {
        frames: Arc::new(FrameTimesTask {
            root: root.clone(),
            frames: parameters.frames,
        }),
        growth: Arc::new(GrowthTimesTask {
            forests: forests.collect(),
            repetitions: parameters.growth_repetitions,
        }),
        walk: Arc::new(WalkTimesTask {
            whole: validation.estimates(parameters.objective)?[0].clone(),
            segmented: validation.estimates_seen(parameters.objective, &sight)?[0].clone(),
            segmentation,
            repetitions: parameters.repetitions,
        }),
        specification,
        validation,
        step,
    }))
}

/// A line of the summary: what was measured, and whether it is as fast as it should be.
struct Row {
    what: String,
    ours: f64,
    theirs: Option<f64>,
    unit: String,
    target: f64,
    /// Whether the target is the least that will do. It is one of the ratio where there is one.
    at_least: bool,
}

impl Row {
    fn ratio(&self) -> Option<f64> {
        self.theirs.map(|theirs| theirs / self.ours)
    }

    fn is_met(&self) -> bool {
        let value = self.ratio().unwrap_or(self.ours);
        match self.at_least {
            true => value >= self.target,
            false => value <= self.target,
        }
    }
}

impl Study for Speed {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let set = self.validation.set.clone();
        Ok(vec![
            set,
            self.frames.clone(),
            self.growth.clone(),
            self.walk.clone(),
        ])
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let frames = FrameTimesTask::read(&done(&*self.frames)?)?;
        let growth = GrowthTimesTask::read(&done(&*self.growth)?)?;
        let walk = WalkTimesTask::read(&done(&*self.walk)?)?;
        let set = DataSet::open(&done(&*self.validation.set)?)?;
        let errors = self.errors(&set, &walk)?;
        let Parameters {
            targets, beside, ..
        } = &self.specification.parameters;

        let mut data = Table::new(["what", "case", "repetition", "value", "unit"]);
        let mut rows = Vec::new();
        for comparison in beside {
            let (ours, theirs) = read_beside(&self.specification.root, comparison)?;
            for (who, times) in [("armpose", &ours), ("other", &theirs)] {
                note(&mut data, &comparison.what, who, times, &comparison.unit);
            }
            // The ratio of the row is that of each repetition, which noise of the machine disturbs less.
            let ratios: Vec<f64> = ours.iter().zip(&theirs).map(|(o, t)| t / o).collect();
            let ours = median(&ours);
            rows.push(Row {
                what: comparison.what.clone(),
                ours,
                theirs: Some(ours * median(&ratios)),
                unit: comparison.unit.clone(),
                target: comparison.target,
                at_least: true,
            });
        }
        let mut own = |what: &str, ours: f64, unit: &str, target: f64, at_least: bool| {
            rows.push(Row {
                what: what.to_owned(),
                ours,
                theirs: None,
                unit: unit.to_owned(),
                target,
                at_least,
            });
        };
        let exponent = exponent(&curve(&growth));
        let most = targets.growth_exponent;
        own(
            "time of growing over samples, exponent",
            exponent,
            "",
            most,
            false,
        );
        own(
            "a frame on one core",
            median(&frames.ms),
            "ms",
            targets.frame_ms,
            false,
        );
        for (stride, least) in STRIDES.into_iter().zip(targets.images_per_s) {
            let of_stride = walk.estimates.iter().filter(|timed| timed.stride == stride);
            let ms: Vec<f64> = of_stride.map(|timed| median(&timed.ms)).collect();
            let what = format!("segmenting and estimating, {}", by_pixels(stride));
            own(&what, 1e3 / mean(&ms), "images/s", least, true);
        }
        let [every, fewer] = errors.map(|errors| mean(&errors));
        let change = 100.0 * (fewer / every - 1.0).abs();
        let what = "change of the mean error by fewer pixels";
        own(what, change, "%", targets.error_change_percent, false);
        let what = "finding a pixel's leaf in one tree on one core";
        own(what, median(&walk.walk_ns), "ns", targets.walk_ns, false);
        let what = "loading a pose forest";
        own(what, median(&walk.load_ms), "ms", targets.load_ms, false);

        note(&mut data, "a frame on one core", "", &frames.ms, "ms");
        note(&mut data, "finding a leaf", "", &walk.walk_ns, "ns");
        note(&mut data, "loading a pose forest", "", &walk.load_ms, "ms");
        for Timed {
            image, stride, ms, ..
        } in &walk.estimates
        {
            let case = format!("image {image}, stride {stride}");
            note(&mut data, "segmenting and estimating", &case, ms, "ms");
        }
        let mut grown = Table::new(["samples", "repetition", "seconds", "leaves", "depth"]);
        for g in &growth {
            grown.push([
                g.samples.into(),
                g.repetition.into(),
                g.seconds.into(),
                g.leaves.into(),
                g.depth.into(),
            ]);
        }
        let columns = ["what", "ours", "theirs", "unit", "ratio", "target", "met"];
        let mut summary = Table::new(columns);
        for row in &rows {
            let sign = if row.at_least { ">=" } else { "<=" };
            summary.push([
                row.what.as_str().into(),
                row.ours.into(),
                row.theirs.into(),
                row.unit.as_str().into(),
                row.ratio().into(),
                format!("{sign} {}", row.target).into(),
                if row.is_met() { "yes" } else { "no" }.into(),
            ]);
        }
        let claims = self.specification.claims.iter().map(Claim::without_test);
        Ok(Report {
            data,
            text: summary.to_text(),
            summary,
            tables: vec![("growth".to_owned(), grown)],
            figures: vec![(self.specification.id.clone(), self.figure(&growth))],
            claims: claims.collect(),
        })
    }
}

impl Speed {
    /// The mean absolute joint errors in the images that both strides estimate, for each stride.
    fn errors(&self, set: &DataSet, walk: &WalkTimes) -> Result<[Vec<f64>; STRIDES.len()]> {
        let (rig, arm) = self.validation.set.rig()?;
        let ruler = Ruler::new(&rig, arm)?;
        let mut errors = STRIDES.map(|_| Vec::new());
        for of_image in walk.estimates.chunks(STRIDES.len()) {
            let poses = of_image.iter().map(|timed| {
                let estimate = timed.estimate.as_ref()?;
                Some((timed.image, &estimate.thresholds[self.step].pose))
            });
            let Some(poses) = poses.collect::<Option<Vec<_>>>() else {
                continue;
            };
            for (errors, (image, pose)) in errors.iter_mut().zip(poses) {
                errors.push(ruler.measure(set.pose(image), pose).all_deg);
            }
        }
        Ok(errors)
    }

    fn figure(&self, growth: &[Grown]) -> Figure {
        let curve = curve(growth);
        let ends = curve.iter().map(|&(samples, _)| {
            let times = growth.iter().filter(|g| g.samples as f64 == samples);
            let seconds = times.map(|g| g.seconds);
            let (low, high) = seconds.fold((f64::MAX, 0.0f64), |(l, h), s| (l.min(s), h.max(s)));
            (samples, low, high)
        });
        // n log n through the first point.
        let (n, t) = curve.first().copied().unwrap_or((1.0, 1.0));
        let n_log_n =
            |&(samples, _): &(f64, f64)| (samples, t * samples * samples.ln() / (n * n.ln()));
        let Parameters {
            trees,
            growth_repetitions,
            ..
        } = &self.specification.parameters;
        Figure {
            title: format!("Growing {trees} trees on MSE, over the number of samples"),
            caption: format!(
                "Medians of {growth_repetitions} on {} threads; whiskers: shortest and longest. \
                 Features are binned already.",
                rayon::current_num_threads()
            ),
            panels: vec![Panel::Plot(Plot {
                title: String::new(),
                x: Axis::new("samples").log(),
                y: Axis::new("seconds").log(),
                marks: vec![
                    Mark::new(
                        "n log n",
                        7,
                        Shape::Dashed(curve.iter().map(n_log_n).collect()),
                    ),
                    Mark::new("", 0, Shape::Errors(ends.collect())),
                    Mark::new(
                        &format!("measured: n to the power of {:.2}", exponent(&curve)),
                        0,
                        Shape::Line(curve),
                    ),
                ],
            })],
            columns: 1,
            size: (1200, 900),
        }
    }
}

fn by_pixels(stride: usize) -> String {
    match stride {
        1 => "every pixel".to_owned(),
        n => format!("every {n}nd pixel in x and y"),
    }
}

/// A row for each repetition.
fn note(data: &mut Table, what: &str, case: &str, values: &[f64], unit: &str) {
    for (repetition, &value) in values.iter().enumerate() {
        data.push([
            what.into(),
            case.into(),
            repetition.into(),
            value.into(),
            unit.into(),
        ]);
    }
}

/// Numbers of samples, ascending, and the median of the seconds.
fn curve(growth: &[Grown]) -> Vec<(f64, f64)> {
    let mut sizes: Vec<usize> = growth.iter().map(|g| g.samples).collect();
    sizes.dedup();
    let of = |&samples: &usize| {
        let times = growth.iter().filter(|g| g.samples == samples);
        let seconds: Vec<f64> = times.map(|g| g.seconds).collect();
        (samples as f64, median(&seconds))
    };
    sizes.iter().map(of).collect()
}

/// The e of t = c n^e that comes nearest, in the least squares of the logarithms.
fn exponent(curve: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = curve.iter().map(|(n, t)| (n.ln(), t.ln())).collect();
    let mean_of = |of: fn(&(f64, f64)) -> f64| mean(&logs.iter().map(of).collect::<Vec<_>>());
    let (x, y) = (mean_of(|log| log.0), mean_of(|log| log.1));
    let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
        logs.iter().map(|log| of(log.0 - x, log.1 - y)).sum()
    };
    sum(&|x, y| x * y) / sum(&|x, _| x * x)
}

/// Our times and theirs.
fn read_beside(root: &Path, beside: &Beside) -> Result<(Vec<f64>, Vec<f64>)> {
    let path = root.join(&beside.file);
    let shown = || format!("cannot read {}", path.display());
    // The last line, "ratio,<median>", is shorter than the others.
    let mut reader = csv::ReaderBuilder::new()
        .flexible(true)
        .from_path(&path)
        .with_context(shown)?;
    let headers = reader.headers().with_context(shown)?.clone();
    let column = |name: &str| {
        let found = headers.iter().position(|header| header == name);
        found.with_context(|| format!("{}: there is no column {name}", path.display()))
    };
    let columns = [column(&beside.ours)?, column(&beside.theirs)?];
    let mut times = [Vec::new(), Vec::new()];
    for record in reader.records() {
        let record = record.with_context(shown)?;
        if record.len() < headers.len() {
            continue;
        }
        for (times, column) in times.iter_mut().zip(columns) {
            let value: f64 = record[column].parse().with_context(shown)?;
            times.push(value);
        }
    }
    ensure!(!times[0].is_empty(), "{}: it has no rows", path.display());
    let [ours, theirs] = times;
    Ok((ours, theirs))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_is_found_again() {
        let curve = [1e5, 1e6, 1e7].map(|n: f64| (n, 3e-6 * n.powf(1.15)));
        assert!((exponent(&curve) - 1.15).abs() < 1e-9);
    }

    #[test]
    fn targets_are_of_the_ratio_where_there_is_one() {
        let row = |ours, theirs, target, at_least| Row {
            what: String::new(),
            ours,
            theirs,
            unit: String::new(),
            target,
            at_least,
        };
        assert!(row(2.0, Some(40.0), 20.0, true).is_met());
        assert!(!row(2.1, Some(40.0), 20.0, true).is_met());
        assert!(row(9.0, None, 9.0, false).is_met());
        assert!(!row(9.1, None, 9.0, false).is_met());
    }
}
