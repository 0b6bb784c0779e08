//! Tables, figure and verdicts of the measurements.

use super::{Observation, Parameters, Test, file_stem};
use crate::camera::Camera;
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::statistics::mean;
use crate::experiment::study::{Report, Specification};
use crate::experiment::table::{Cell, Table, significant};
use anyhow::Result;
use std::collections::BTreeMap;

/// Khoshelham and Elberink 2012, mm.
fn khoshelham(z: f64) -> f64 {
    1.42 * z * z
}

/// Nguyen, Izadi and Lovell 2012, mm; the slant in degrees.
fn nguyen(z: f64, slant: f64) -> f64 {
    let slant = slant.to_radians();
    let grazing = (slant / (std::f64::consts::FRAC_PI_2 - slant)).powi(2);
    1.2 + 1.9 * (z - 0.4).powi(2) + 0.1 / z.sqrt() * grazing
}

/// Nguyen, Izadi and Lovell 2012: the sd of an edge's place on a surface seen from the front, px.
const NGUYEN_LATERAL: f64 = 0.8;

/// The mean over the frames of a condition, and what formulas say about it.
struct Condition {
    mean: Observation,
    frames: usize,
    /// f b in px m and the step of disparity in px; `None` without a projector.
    optics: Option<(f64, f64)>,
}

impl Condition {
    fn is_real(&self) -> bool {
        self.mean.measurement.starts_with("real")
    }

    /// z^2 / (f b) per step of disparity, mm.
    fn step_formula(&self) -> Option<f64> {
        self.optics
            .map(|(fb, step)| self.mean.distance_m.powi(2) / fb * step * 1000.0)
    }

    /// f b (1 / z_near - 1 / z_far), px.
    fn shadow_formula(&self) -> Option<f64> {
        let background = self.mean.background_m?;
        self.optics
            .map(|(fb, _)| fb * (1.0 / self.mean.distance_m - 1.0 / background))
    }
}

pub fn report(
    specification: &Specification<Parameters, Test>,
    observations: &[Observation],
) -> Result<Report> {
    let mut optics = BTreeMap::new();
    for preset in &specification.parameters.cameras {
        let camera = Camera::read(&specification.root.join(preset))?;
        let projector = camera.projector;
        optics.insert(
            file_stem(preset),
            projector.map(|p| (camera.intrinsics.fx * p.baseline_m, p.disparity_step_px)),
        );
    }
    let conditions = conditions(observations, &optics);
    let summary = summary(&conditions);
    Ok(Report {
        data: data(observations),
        text: summary.to_text(),
        summary,
        tables: Vec::new(),
        figures: vec![(
            specification.id.clone(),
            figure(&specification.title, &conditions),
        )],
        claims: specification
            .claims
            .iter()
            .map(|claim| judge(claim, &conditions))
            .collect(),
    })
}

/// In the order of their first observation. Real frames are taken together.
fn conditions(
    observations: &[Observation],
    optics: &BTreeMap<String, Option<(f64, f64)>>,
) -> Vec<Condition> {
    type Key = (String, String, u64, Option<u64>, Option<u64>);
    let mut groups: Vec<(Key, Vec<&Observation>)> = Vec::new();
    for o in observations {
        let real = o.measurement.starts_with("real");
        let key = (
            o.measurement.clone(),
            if real {
                "Kinect".to_owned()
            } else {
                o.source.clone()
            },
            o.distance_m.to_bits(),
            o.background_m.map(f64::to_bits),
            o.slant_deg.map(f64::to_bits),
        );
        match groups.iter_mut().find(|(k, _)| *k == key) {
            Some((_, members)) => members.push(o),
            None => groups.push((key, vec![o])),
        }
    }
    // Real planes by distance, like the simulated ones; sorting is stable.
    groups.sort_by_key(|(key, _)| key.0.starts_with("real").then_some((key.0.clone(), key.2)));
    let condition = |(key, members): (Key, Vec<&Observation>)| {
        let over = |value: fn(&Observation) -> Option<f64>| {
            let values: Vec<f64> = members.iter().filter_map(|o| value(o)).collect();
            (!values.is_empty()).then(|| mean(&values))
        };
        Condition {
            optics: optics.get(&key.1).copied().flatten(),
            frames: members.len(),
            mean: Observation {
                source: key.1,
                axial_sd_mm: over(|o| o.axial_sd_mm),
                depth_step_mm: over(|o| o.depth_step_mm),
                shadow_px: over(|o| o.shadow_px),
                left_gap_px: over(|o| o.left_gap_px),
                right_gap_px: over(|o| o.right_gap_px),
                lateral_sd_px: over(|o| o.lateral_sd_px),
                valid_share: over(|o| o.valid_share),
                ..members[0].clone()
            },
        }
    };
    groups.into_iter().map(condition).collect()
}

const MEASURED: [&str; 11] = [
    "distance_m",
    "background_m",
    "slant_deg",
    "axial_sd_mm",
    "depth_step_mm",
    "shadow_px",
    "left_gap_px",
    "right_gap_px",
    "lateral_sd_px",
    "valid_share",
    "pixels",
];

fn measured(o: &Observation) -> [Cell; 11] {
    [
        o.distance_m.into(),
        o.background_m.into(),
        o.slant_deg.into(),
        o.axial_sd_mm.into(),
        o.depth_step_mm.into(),
        o.shadow_px.into(),
        o.left_gap_px.into(),
        o.right_gap_px.into(),
        o.lateral_sd_px.into(),
        o.valid_share.into(),
        o.pixels.into(),
    ]
}

fn data(observations: &[Observation]) -> Table {
    let mut table = Table::new(
        ["measurement", "source", "frame"]
            .into_iter()
            .chain(MEASURED),
    );
    for o in observations {
        let first = [
            o.measurement.as_str().into(),
            o.source.as_str().into(),
            o.frame.into(),
        ];
        table.push(first.into_iter().chain(measured(o)));
    }
    table
}

fn summary(conditions: &[Condition]) -> Table {
    let formulas = [
        "khoshelham_mm",
        "nguyen_mm",
        "step_formula_mm",
        "shadow_formula_px",
    ];
    let first = ["measurement", "source", "frames"];
    let mut table = Table::new(first.into_iter().chain(MEASURED).chain(formulas));
    for c in conditions {
        let o = &c.mean;
        let has_noise = o.axial_sd_mm.is_some();
        let slant = o.slant_deg.unwrap_or(0.0);
        let formulas = [
            has_noise.then(|| khoshelham(o.distance_m)).into(),
            has_noise.then(|| nguyen(o.distance_m, slant)).into(),
            o.depth_step_mm.and(c.step_formula()).into(),
            o.shadow_px.and(c.shadow_formula()).into(),
        ];
        let first = [
            o.measurement.as_str().into(),
            o.source.as_str().into(),
            c.frames.into(),
        ];
        table.push(first.into_iter().chain(measured(o)).chain(formulas));
    }
    table
}

fn figure(title: &str, conditions: &[Condition]) -> Figure {
    let mut sources: Vec<&str> = Vec::new();
    for c in conditions {
        if !sources.contains(&c.mean.source.as_str()) {
            sources.push(&c.mean.source);
        }
    }
    // One line a source through the means of one measurement, in one colour in all panels.
    type Value = fn(&Observation) -> Option<f64>;
    let lines = |measurements: &[&str], x: Value, y: Value| -> Vec<Mark> {
        let mut marks = Vec::new();
        for (colour, &source) in sources.iter().enumerate() {
            let of_source = conditions
                .iter()
                .map(|c| &c.mean)
                .filter(|o| o.source == source && measurements.contains(&o.measurement.as_str()));
            let mut points: Vec<(f64, f64)> =
                of_source.filter_map(|o| Some((x(o)?, y(o)?))).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            if !points.is_empty() {
                // Plates differ in more than their distance.
                let shape = if source == "Kinect" || measurements == ["plate"] {
                    Shape::Scatter(points)
                } else {
                    Shape::Line(points)
                };
                let label = if source == "Kinect" {
                    "real Kinect frames"
                } else {
                    source
                };
                marks.push(Mark::new(label, colour, shape));
            }
        }
        marks
    };
    let curve = |label: &str, colour: usize, range: (f64, f64), y: &dyn Fn(f64) -> f64| {
        let at = |i: u32| range.0 + (range.1 - range.0) * f64::from(i) / 100.0;
        Mark::new(
            label,
            colour,
            Shape::Dashed((0..=100).map(|i| (at(i), y(at(i)))).collect()),
        )
    };
    let plot = |title: &str, x: Axis, y: Axis, marks: Vec<Mark>| {
        Panel::Plot(Plot {
            title: title.to_owned(),
            x,
            y,
            marks,
        })
    };
    let distance: Value = |o| Some(o.distance_m);
    let slant: Value = |o| o.slant_deg;
    let formulas = conditions
        .iter()
        .filter_map(|c| Some((c.shadow_formula()?, c)));
    let widest = formulas.map(|(formula, _)| formula).fold(0.0, f64::max);
    let step = conditions
        .iter()
        .find_map(|c| c.optics)
        .map(|(fb, step)| step / fb * 1000.0);

    let mut noise = lines(&["wall", "real plane"], distance, |o| o.axial_sd_mm);
    noise.push(curve("Khoshelham and Elberink", 7, (0.5, 5.0), &khoshelham));
    noise.push(curve("Nguyen et al.", 5, (0.5, 5.0), &|z| nguyen(z, 0.0)));
    let mut steps = lines(&["wall", "real step"], distance, |o| o.depth_step_mm);
    if let Some(step) = step {
        noise.push(curve("rounding alone", 4, (0.5, 5.0), &|z| {
            step * z * z / 12f64.sqrt()
        }));
        steps.push(curve("z² / (8 f b)", 7, (0.5, 5.0), &|z| step * z * z));
    }
    let mut shadows = Vec::new();
    for (colour, &source) in sources.iter().enumerate() {
        let of_source = conditions.iter().filter(|c| c.mean.source == source);
        let points: Vec<(f64, f64)> = of_source
            .filter_map(|c| Some((c.shadow_formula()?, c.mean.shadow_px?)))
            .collect();
        if !points.is_empty() {
            shadows.push(Mark::new(source, colour, Shape::Scatter(points)));
        }
    }
    shadows.push(curve("f b (1/z near - 1/z far)", 7, (0.0, widest), &|x| x));
    let mut grazing = lines(&["slant"], slant, |o| o.axial_sd_mm);
    grazing.push(curve("Nguyen et al.", 5, (0.0, 84.0), &|slant| {
        nguyen(1.0, slant)
    }));
    let mut edges = lines(&["plate"], distance, |o| o.lateral_sd_px);
    edges.push(Mark::new("Nguyen et al.", 5, Shape::Level(NGUYEN_LATERAL)));
    Figure {
        title: title.to_owned(),
        caption: "Markers are means over frames. Real planes: square patches of 24 px, in bins of 0.25 m."
            .to_owned(),
        panels: vec![
            plot("axial noise on a wall", Axis::new("distance (m)").log(), Axis::new("sd of depth (mm)").log(), noise),
            plot("step between depths", Axis::new("distance (m)").log(), Axis::new("step (mm)").log(), steps),
            plot("shadow beside a plate", Axis::new("formula (px)"), Axis::new("width (px)"), shadows),
            plot("noise on a slanted wall, 1 m", Axis::new("slant (deg)"), Axis::new("sd of depth (mm)").log(), grazing),
            plot(
                "valid pixels on a slanted wall, 1 m",
                Axis::new("slant (deg)"),
                Axis::new("share").including(0.0, 1.0),
                lines(&["slant"], slant, |o| o.valid_share),
            ),
            plot("place of an edge", Axis::new("distance (m)"), Axis::new("sd (px)").including(0.0, 1.0), edges),
        ],
        columns: 2,
        size: (1600, 1500),
    }
}

/// The worst deviation over the conditions that a test looks at, and the verdict.
fn judge(claim: &Claim<Test>, conditions: &[Condition]) -> ClaimResult {
    let Some(test) = &claim.test else {
        return claim.without_test();
    };
    // The paper's claim is about the sensor that the main sets use.
    let ours = |measurement: &str| {
        let measurement = measurement.to_owned();
        let is_ours =
            move |c: &&Condition| c.mean.source == "realistic" && c.mean.measurement == measurement;
        conditions.iter().filter(is_ours)
    };
    let in_reach = |c: &&Condition| (1.0..=3.0).contains(&c.mean.distance_m);
    let (limit, unit, deviations): (f64, &str, Vec<f64>) = match *test {
        Test::ShadowWidth(limit) => {
            let off = |c: &Condition| Some((c.mean.shadow_px? - c.shadow_formula()?).abs());
            (limit, "px", ours("plate").filter_map(off).collect())
        }
        Test::DepthStep(limit) => {
            let off = |c: &Condition| Some((c.mean.depth_step_mm? / c.step_formula()? - 1.0).abs());
            let far = ours("wall").filter(|c| c.mean.distance_m >= 1.0);
            (limit, "of the formula", far.filter_map(off).collect())
        }
        Test::AxialNoise(limit) => {
            let off = |c: &Condition| {
                let (a, b) = (
                    khoshelham(c.mean.distance_m),
                    nguyen(c.mean.distance_m, 0.0),
                );
                let sd = c.mean.axial_sd_mm?;
                Some((a.min(b) / sd - 1.0).max(sd / a.max(b) - 1.0).max(0.0))
            };
            (
                limit,
                "outside the curves",
                ours("wall").filter(in_reach).filter_map(off).collect(),
            )
        }
        Test::RealNoise(limit) => {
            // Noise grows with z^2, so that each real bin has a simulated counterpart.
            let simulated: Vec<f64> = ours("wall")
                .filter(in_reach)
                .filter_map(|c| Some(c.mean.axial_sd_mm? / c.mean.distance_m.powi(2)))
                .collect();
            let expected = mean(&simulated);
            let real = conditions
                .iter()
                .filter(|c| c.is_real() && c.frames >= 20)
                .filter(in_reach);
            let off = |c: &Condition| {
                let ratio = c.mean.axial_sd_mm? / c.mean.distance_m.powi(2) / expected;
                Some(ratio.max(1.0 / ratio) - 1.0)
            };
            (limit, "off the real planes", real.filter_map(off).collect())
        }
    };
    if deviations.is_empty() {
        return claim.not_checkable("what it compares with is not there");
    }
    let worst = deviations.iter().copied().fold(0.0, f64::max);
    let verdict = if worst <= limit {
        Verdict::Reproduced
    } else if worst <= 2.0 * limit {
        Verdict::Partly
    } else {
        Verdict::Not
    };
    let shown = format!("at most {} {unit}", significant(worst, 3));
    claim.result(shown, deviations.len(), verdict)
}
