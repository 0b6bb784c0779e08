//! Tables and figure of the comparison.

use super::images::best_median_worst;
use super::{CrossValidationStudy, Method, Parameters, Tested};
use crate::dataset::DataSet;
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::{PoseError, Protocol};
use crate::experiment::statistics::{mean, quantile, standard_deviation};
use crate::experiment::study::Report;
use crate::experiment::table::{Cell, Table};
use crate::experiment::tasks::sight::SegmentationKind;
use crate::scene::Rig;
use anyhow::Result;

/// What is measured.
struct Measure {
    name: String,
    unit: &'static str,
    of: Box<dyn Fn(&PoseError) -> f64>,
}

fn measures(joints: &[&str]) -> Vec<Measure> {
    let measure = |name: &str, unit, of: fn(&PoseError) -> f64| Measure {
        name: name.to_owned(),
        unit,
        of: Box::new(of),
    };
    let joint = |(at, name): (usize, &&str)| Measure {
        name: (*name).to_owned(),
        unit: "deg",
        of: Box::new(move |e: &PoseError| e.joints_deg[at]),
    };
    [
        measure("all joints", "deg", |e| e.all_deg),
        measure("arm joints", "deg", |e| e.arm_deg),
        measure("hand joints", "deg", |e| e.hand_deg),
        measure("root mean square", "deg", |e| e.rms_deg),
        measure("DISP", "m", |e| e.disp_m),
        measure("fingertip", "m", |e| e.tip_m),
    ]
    .into_iter()
    .chain(joints.iter().enumerate().map(joint))
    .collect()
}

/// The measures before those of single joints: angles, and then distances.
const ANGLES: std::ops::Range<usize> = 0..4;
const DISTANCES: std::ops::Range<usize> = 4..6;

impl CrossValidationStudy {
    pub(super) fn report_on(
        &self,
        methods: &[Method],
        joints: &[&str],
        (set, rig): (&DataSet, &Rig),
    ) -> Result<Report> {
        let measures = measures(joints);
        let Parameters {
            segmentation,
            shown,
            ..
        } = &self.specification.parameters;
        let mut figures = vec![(
            self.specification.id.clone(),
            self.figure(methods, &measures),
        )];
        if let Some(method) = methods.iter().find(|method| method.name() == *shown) {
            figures.push(("images".to_owned(), best_median_worst(method, set, rig)?));
        }
        Ok(Report {
            data: self.data(methods, joints),
            summary: summary(methods, &measures),
            tables: vec![
                (
                    "joints".to_owned(),
                    by_joint(methods, segmentation, &measures),
                ),
                (
                    "visibility".to_owned(),
                    by_visibility(methods, segmentation, &measures),
                ),
            ],
            figures,
            claims: self.verdicts(methods)?,
            text: text(methods, segmentation, &measures),
        })
    }

    /// A row for each image by each method, with the pose in radians.
    fn data(&self, methods: &[Method], joints: &[&str]) -> Table {
        const COLUMNS: [&str; 15] = [
            "image",
            "fold",
            "method",
            "segmentation",
            "visible_px",
            "valid_px",
            "sure_px",
            "arm_seen",
            "chosen_px",
            "chosen_foreground_px",
            "error_deg",
            "arm_error_deg",
            "hand_error_deg",
            "disp_m",
            "tip_m",
        ];
        let poses = joints.iter().map(|joint| format!("{joint}_rad"));
        let mut table = Table::new(COLUMNS.map(str::to_owned).into_iter().chain(poses));
        for method in methods {
            for Tested {
                outcome,
                estimate,
                error,
            } in &method.results
            {
                let chosen = &outcome.estimate.thresholds[self.step];
                let ours = |cell: Cell| match method.is_reference() {
                    true => Cell::Empty,
                    false => cell,
                };
                let seen = if outcome.arm_seen { "yes" } else { "no" };
                let cells: [Cell; COLUMNS.len()] = [
                    outcome.image.into(),
                    outcome.fold.into(),
                    method.id.into(),
                    method.segmentation.id().into(),
                    outcome.visible.into(),
                    outcome.valid.into(),
                    ours(outcome.sure_pixels.into()),
                    ours(seen.into()),
                    ours(chosen.pixels.into()),
                    ours(chosen.foreground.into()),
                    error.all_deg.into(),
                    error.arm_deg.into(),
                    error.hand_deg.into(),
                    error.disp_m.into(),
                    error.tip_m.into(),
                ];
                let pose = estimate.iter().map(|&angle| Cell::from(angle));
                table.push(cells.into_iter().chain(pose));
            }
        }
        table
    }

    fn figure(&self, methods: &[Method], all: &[Measure]) -> Figure {
        let (groups, joints) = all.split_at(DISTANCES.end);
        let kinds = &self.specification.parameters.segmentation;
        let rows: [&dyn Fn(SegmentationKind) -> Panel; 4] = [
            &|kind| {
                let axis = "mean absolute error (deg)";
                bars("Joint error", axis, kind, methods, &groups[ANGLES], true)
            },
            &|kind| {
                let axis = "distance (m)";
                bars("Distance", axis, kind, methods, &groups[DISTANCES], true)
            },
            // Beside each other, whiskers of single joints would hide the bars.
            &|kind| {
                let axis = "mean absolute error (deg)";
                bars("Error of each joint", axis, kind, methods, joints, false)
            },
            &|kind| visibility(kind, methods),
        ];
        let panels: Vec<Panel> = rows
            .iter()
            .flat_map(|row| kinds.iter().map(move |&kind| row(kind)))
            .collect();
        let Protocol { images, folds, .. } = &self.specification.parameters.protocol;
        // One way of segmentation fills a square, several have a column each.
        let columns = kinds.len().max(2);
        let (width, height) = if kinds.len() > 2 {
            (900, 560)
        } else {
            (1200, 700)
        };
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Bars: mean over {images} images, each tested by a forest that had not seen it; \
                 whiskers: one standard deviation over {folds} folds. Lines join the means of fifths of \
                 the images."
            ),
            size: (
                width * columns as u32,
                height * panels.len().div_ceil(columns) as u32,
            ),
            panels,
            columns,
        }
    }
}

/// The methods that a panel compares. The truth has no error to draw; the constant pose is beside
/// every way of segmentation.
fn drawn(methods: &[Method], kind: SegmentationKind) -> impl Iterator<Item = &Method> {
    methods.iter().filter(move |method| {
        method.id == "constant-pose" || !method.is_reference() && method.segmentation == kind
    })
}

fn title(what: &str, kind: SegmentationKind) -> String {
    format!("{what}, {}", kind.title())
}

fn bars(
    what: &str,
    axis: &str,
    kind: SegmentationKind,
    methods: &[Method],
    measures: &[Measure],
    whiskers: bool,
) -> Panel {
    let marks = drawn(methods, kind).map(|method| {
        let bar = |measure: &Measure| {
            let folds = method.folds(&measure.of);
            let (centre, spread) = (mean(&folds), standard_deviation(&folds));
            (
                centre,
                whiskers.then_some((centre - spread, centre + spread)),
            )
        };
        let bars = Shape::Bars(measures.iter().map(bar).collect());
        Mark::new(method.title, method.colour, bars)
    });
    Panel::Plot(Plot {
        title: title(what, kind),
        x: Axis::of("", measures.iter().map(|measure| measure.name.clone())),
        y: Axis::new(axis).including(0.0, 0.0),
        marks: marks.collect(),
    })
}

/// Of (pixels, error) of images: the median pixels and the mean error of each fifth, by pixels.
pub fn fifths(mut points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let fifth = |points: &[(f64, f64)]| {
        let errors: Vec<f64> = points.iter().map(|p| p.1).collect();
        (points[points.len() / 2].0, mean(&errors))
    };
    points
        .chunks(points.len().div_ceil(5).max(1))
        .map(fifth)
        .collect()
}

/// The pixels of an image that show the arm, and its error. A logarithmic axis has no place for none.
fn seen(tested: &Tested, of: impl Fn(&PoseError) -> f64) -> (f64, f64) {
    (tested.outcome.visible.max(1) as f64, of(&tested.error))
}

/// Against the pixels that show the arm.
fn visibility(kind: SegmentationKind, methods: &[Method]) -> Panel {
    let fifths = drawn(methods, kind).map(|method| {
        let images = method.results.iter().map(|r| seen(r, |e| e.all_deg));
        let line = fifths(images.collect());
        Mark::new(method.title, method.colour, Shape::Line(line))
    });
    Panel::Plot(Plot {
        title: title("Error by what is seen of the arm", kind),
        x: Axis::new("visible pixels of the arm").log(),
        y: Axis::new("mean joint error (deg)"),
        marks: fifths.collect(),
    })
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
        for Measure { name, unit, of } in measures {
            let mut images = method.images(of);
            images.sort_by(f64::total_cmp);
            table.push([
                method.id.into(),
                method.segmentation.id().into(),
                name.as_str().into(),
                (*unit).into(),
                mean(&images).into(),
                standard_deviation(&method.folds(of)).into(),
                quantile(&images, 0.5).into(),
                images.len().into(),
            ]);
        }
    }
    table
}

/// The names of what is [`drawn`] for any way of segmentation: they have all the same objectives.
fn columns<'a>(
    methods: &'a [Method],
    kinds: &'a [SegmentationKind],
) -> impl Iterator<Item = String> + 'a {
    let first = kinds.iter().take(1);
    first.flat_map(|&kind| drawn(methods, kind).map(|method| method.id.to_owned()))
}

/// The mean error of each joint, in degrees: a row for each joint, a column for each method.
fn by_joint(methods: &[Method], kinds: &[SegmentationKind], measures: &[Measure]) -> Table {
    let methods_deg = columns(methods, kinds).map(|id| format!("{id}_deg"));
    let place = ["segmentation", "joint"].map(str::to_owned);
    let mut table = Table::new(place.into_iter().chain(methods_deg));
    for &kind in kinds {
        for Measure { name, of, .. } in &measures[DISTANCES.end..] {
            let errors = drawn(methods, kind).map(|method| Cell::from(mean(&method.images(of))));
            let place = [kind.id().into(), name.as_str().into()];
            table.push(place.into_iter().chain(errors));
        }
    }
    table
}

/// Mean errors by how much of the arm is seen: a row for each fifth of the images, beginning with those
/// that show the least, with the median of its visible pixels; a column for each method.
fn by_visibility(methods: &[Method], kinds: &[SegmentationKind], measures: &[Measure]) -> Table {
    let place = ["segmentation", "measure", "unit", "fifth", "visible_px"].map(str::to_owned);
    let mut table = Table::new(place.into_iter().chain(columns(methods, kinds)));
    let told = |measure: &&Measure| matches!(&*measure.name, "all joints" | "arm joints" | "DISP");
    for &kind in kinds {
        for Measure { name, unit, of } in measures.iter().filter(told) {
            let of_methods: Vec<Vec<(f64, f64)>> = drawn(methods, kind)
                .map(|method| fifths(method.results.iter().map(|r| seen(r, of)).collect()))
                .collect();
            let fifths = of_methods.first().map_or(0, Vec::len);
            for fifth in 0..fifths {
                let place: [Cell; 5] = [
                    kind.id().into(),
                    name.as_str().into(),
                    (*unit).into(),
                    (fifth + 1).into(),
                    of_methods[0][fifth].0.into(),
                ];
                let errors = of_methods.iter().map(|method| method[fifth].1.into());
                table.push(place.into_iter().chain(errors));
            }
        }
    }
    table
}

/// A table for each way of segmentation.
fn text(methods: &[Method], kinds: &[SegmentationKind], measures: &[Measure]) -> String {
    let mut text = String::new();
    for &kind in kinds {
        let shown: Vec<&Method> = drawn(methods, kind).collect();
        let mut table = Table::new(
            std::iter::once(format!("mean error (sd over folds), {}", kind.title()))
                .chain(shown.iter().map(|m| m.title.to_owned())),
        );
        for Measure { name, unit, of } in measures {
            let digits = if *unit == "m" { 3 } else { 2 };
            let row = shown.iter().map(|method| {
                let (centre, spread) = (
                    mean(&method.images(of)),
                    standard_deviation(&method.folds(of)),
                );
                Cell::from(format!("{centre:.digits$} ({spread:.digits$})"))
            });
            table.push(std::iter::once(Cell::from(format!("{name} ({unit})"))).chain(row));
        }
        text.push_str(&table.to_text());
    }
    text
}
