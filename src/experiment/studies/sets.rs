//! What the data sets are like (section IV-A, Table I).

use crate::dataset::DataSet;
use crate::experiment::claims::{Claim, ClaimResult, Scalar, Verdict};
use crate::experiment::figure::{Axis, DepthPanel, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::{Cell, Table};
use crate::experiment::task::Task;
use crate::experiment::tasks::data_set::DataSetTask;
use crate::scene::Rig;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    pub sets: Vec<SetSize>,
    /// An image shows little of an arm when fewer of its valid pixels show it.
    pub little_px: usize,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SetSize {
    /// A file of `data/sets/`, without its extension.
    pub name: String,
    pub images: usize,
}

/// How a claim is tested: a class ("background" or an arm) makes up the paper's share of the valid
/// pixels of a set, *reproduced* within the factor `within`, *partly* within its square.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Test {
    set: String,
    class: String,
    within: f64,
}

struct Sets {
    specification: Specification<Parameters, Test>,
    tasks: Vec<Arc<DataSetTask>>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let sets = &specification.parameters.sets;
    if sets.is_empty() {
        bail!("`sets` names none");
    }
    let task = |set: &SetSize| {
        let task = DataSetTask::new(
            &specification.root,
            &set.name,
            set.images,
            specification.seed,
        )?;
        Ok(Arc::new(task))
    };
    let tasks = sets.iter().map(task).collect::<Result<_>>()?;
    Ok(Box::new(Sets {
        specification,
        tasks,
    }))
}

/// Pixels of each image by class, background first, then the arms as in the robot's description.
struct Counts {
    set: String,
    classes: Vec<String>,
    images: Vec<Vec<usize>>,
    little: usize,
}

impl Counts {
    fn new(set: &DataSet, little_px: usize) -> Counts {
        let record = set.record();
        let arms = record.arms.iter().map(|arm| arm.name.clone());
        let images = record.images.iter().map(|image| {
            let background = image.valid - image.arms.iter().sum::<usize>();
            std::iter::once(background)
                .chain(image.arms.iter().copied())
                .collect()
        });
        let shows_little =
            |image: &&crate::dataset::ImageRecord| image.arms[set.target()] < little_px;
        Counts {
            set: record.name.clone(),
            classes: std::iter::once("background".to_owned())
                .chain(arms)
                .collect(),
            images: images.collect(),
            little: record.images.iter().filter(shows_little).count(),
        }
    }

    /// The class's share of all valid pixels of the set.
    fn share(&self, class: usize) -> f64 {
        let of_class: usize = self.images.iter().map(|image| image[class]).sum();
        of_class as f64 / self.images.iter().flatten().sum::<usize>() as f64
    }
}

impl Study for Sets {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        Ok(self
            .tasks
            .iter()
            .map(|task| task.clone() as Arc<dyn Task>)
            .collect())
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let open = |task: &Arc<DataSetTask>| Ok(DataSet::open(&done(&**task)?)?);
        let sets = self.tasks.iter().map(open).collect::<Result<Vec<_>>>()?;
        let little = self.specification.parameters.little_px;
        let counts: Vec<Counts> = sets.iter().map(|set| Counts::new(set, little)).collect();
        let summary = summary(&sets, &counts, little);
        let mut figures = vec![(self.specification.id.clone(), self.figure(&sets)?)];
        for set in &sets {
            figures.push((
                format!("{}-{}", self.specification.id, set.record().name),
                contact_sheet(set)?,
            ));
        }
        let claims = self
            .specification
            .claims
            .iter()
            .map(|claim| judge(claim, &counts));
        Ok(Report {
            data: data(&sets, &counts)?,
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures,
            claims: claims.collect::<Result<_>>()?,
        })
    }
}

/// A row for each image.
fn data(sets: &[DataSet], counts: &[Counts]) -> Result<Table> {
    let (classes, joints) = (&counts[0].classes, sets[0].target_joints());
    let mut columns = vec!["set".to_owned(), "image".to_owned(), "valid_px".to_owned()];
    columns.extend(classes.iter().map(|class| format!("{class}_px")));
    columns.extend(["collided_frames", "hidden_frames"].map(str::to_owned));
    columns.extend(joints.iter().map(|joint| format!("{joint}_rad")));
    let mut table = Table::new(columns);
    for (set, counts) in sets.iter().zip(counts) {
        if counts.classes != *classes || set.target_joints() != joints {
            bail!(
                "sets {} and {} show different robots",
                counts.set,
                sets[0].record().name
            );
        }
        for (image, record) in set.record().images.iter().enumerate() {
            let mut row: Vec<Cell> = vec![
                counts.set.as_str().into(),
                image.into(),
                record.valid.into(),
            ];
            row.extend(counts.images[image].iter().map(|&pixels| pixels.into()));
            row.extend([record.collided.into(), record.hidden.into()]);
            row.extend(set.pose(image).iter().map(|&angle| angle.into()));
            table.push(row);
        }
    }
    Ok(table)
}

fn summary(sets: &[DataSet], counts: &[Counts], little: usize) -> Table {
    let mut table = Table::new(["set", "quantity", "value", "unit"]);
    for (set, counts) in sets.iter().zip(counts) {
        let mut push = |quantity: String, value: f64, unit: &str| {
            table.push([
                counts.set.as_str().into(),
                quantity.into(),
                value.into(),
                unit.into(),
            ]);
        };
        let images = set.len() as f64;
        push("images".to_owned(), images, "images");
        let intrinsics = &set.camera().intrinsics;
        let valid: usize = set.record().images.iter().map(|image| image.valid).sum();
        let all = images * (intrinsics.width * intrinsics.height) as f64;
        push(
            "valid pixels".to_owned(),
            100.0 * valid as f64 / all,
            "% of all",
        );
        for (class, name) in counts.classes.iter().enumerate() {
            push(
                format!("{name} pixels"),
                100.0 * counts.share(class),
                "% of valid",
            );
        }
        let target = &set.record().arms[set.target()].name;
        push(
            format!("images with fewer than {little} pixels of the {target} arm"),
            100.0 * counts.little as f64 / images,
            "% of images",
        );
        for (name, count) in [
            (
                "drawn frames rejected for a collision",
                set.record()
                    .images
                    .iter()
                    .map(|i| i.collided)
                    .sum::<usize>(),
            ),
            (
                "drawn frames rejected for showing too little",
                set.record().images.iter().map(|i| i.hidden).sum(),
            ),
        ] {
            push(name.to_owned(), count as f64 / images, "per image");
        }
    }
    table
}

/// Twelve images spread over the set.
fn contact_sheet(set: &DataSet) -> Result<Figure> {
    const PANELS: usize = 12;
    let shown = set.len().min(PANELS);
    let panel = |at: usize| {
        // Not only multiples of a number that the visibility rule may treat apart.
        let image = (at * set.len() / shown + at % 5).min(set.len() - 1);
        let record = &set.record().images[image];
        let arms = set.record().arms.iter().zip(&record.arms);
        let arms: Vec<String> = arms
            .map(|(arm, pixels)| format!("{} {pixels}", arm.name))
            .collect();
        let frame = set.frame(image).with_context(|| format!("image {image}"))?;
        Ok(Panel::Depth(DepthPanel {
            title: format!("{image}: {}", arms.join(", ")),
            image: frame.depth,
            range_mm: (500, 5000),
        }))
    };
    Ok(Figure {
        title: format!("Set {}: depth images", set.record().name),
        caption: "Bright is near (0.5 m), dark is far (5 m), black is invalid. Titles: number of the image, \
                  valid pixels of each arm."
            .to_owned(),
        panels: (0..shown).map(panel).collect::<Result<_>>()?,
        columns: 4,
        size: (1500, 900),
    })
}

impl Sets {
    /// How the joints of the first set are distributed, and how much of the arm is seen.
    fn figure(&self, sets: &[DataSet]) -> Result<Figure> {
        let rig = Rig::read(&self.tasks[0].spec.robot_path())?;
        let limits: Vec<(f64, f64)> = rig.robot.dof_joints().map(|joint| joint.limits).collect();
        let arm = rig
            .arms
            .iter()
            .find(|arm| arm.name == sets[0].record().specification.target);
        let joints = arm.map_or(&[][..], |arm| &arm.joints);
        let limits: Vec<(f64, f64)> = joints.iter().map(|&dof| limits[dof]).collect();

        let histogram = |values: &[f64], edges: Vec<f64>| {
            let bins = edges.len() - 1;
            let mut heights = vec![0.0; bins];
            for value in values {
                let above = edges.partition_point(|edge| edge <= value);
                heights[above.saturating_sub(1).min(bins - 1)] += 100.0 / values.len() as f64;
            }
            Shape::Histogram { edges, heights }
        };
        let spread = |low: f64, high: f64| -> Vec<f64> {
            const BINS: usize = 12;
            (0..=BINS)
                .map(|i| low + (high - low) * i as f64 / BINS as f64)
                .collect()
        };
        let set = &sets[0];
        let mut panels = Vec::new();
        for (at, joint) in set.target_joints().iter().enumerate() {
            let values: Vec<f64> = (0..set.len())
                .map(|i| set.pose(i)[at].to_degrees())
                .collect();
            let (low, high) = limits[at];
            let edges = spread(low.to_degrees(), high.to_degrees());
            let uniform = 100.0 / (edges.len() - 1) as f64;
            panels.push(Panel::Plot(Plot {
                title: joint.clone(),
                x: Axis::new("joint angle (deg)"),
                y: Axis::new("share of images (%)").including(0.0, 0.0),
                marks: vec![
                    Mark::new("", 0, histogram(&values, edges)),
                    Mark::new("uniform", 7, Shape::Level(uniform)),
                ],
            }));
        }
        let arms = set.record().arms.iter().enumerate().map(|(arm, record)| {
            let pixels: Vec<f64> = set
                .record()
                .images
                .iter()
                .map(|i| i.arms[arm] as f64)
                .collect();
            let most = pixels.iter().copied().fold(1.0, f64::max);
            Mark::new(
                &format!("{} arm", record.name),
                arm,
                histogram(&pixels, spread(0.0, most)),
            )
        });
        panels.push(Panel::Plot(Plot {
            title: "What is seen of the arms".to_owned(),
            x: Axis::new("valid pixels in an image"),
            y: Axis::new("share of images (%)").including(0.0, 0.0),
            marks: arms.collect(),
        }));
        Ok(Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Set {}: {} images. The axes of the joints span their limits.",
                set.record().name,
                set.len()
            ),
            panels,
            columns: 4,
            size: (2000, 1700),
        })
    }
}

fn judge(claim: &Claim<Test>, counts: &[Counts]) -> Result<ClaimResult> {
    let Some(Test { set, class, within }) = &claim.test else {
        return Ok(claim.without_test());
    };
    let Some(counts) = counts.iter().find(|counts| counts.set == *set) else {
        bail!(
            "claim {}: set {set} is not among the study's sets",
            claim.id
        );
    };
    let Some(class) = counts.classes.iter().position(|known| known == class) else {
        bail!(
            "claim {}: there is no class {class} (there are {})",
            claim.id,
            counts.classes.join(", ")
        );
    };
    let Scalar::Number(paper) = claim.paper else {
        bail!(
            "claim {}: `paper` must be the paper's share, a number",
            claim.id
        );
    };
    let ours = counts.share(class);
    let factor = (ours / paper).max(paper / ours);
    let verdict = match factor {
        f if f <= *within => Verdict::Reproduced,
        f if f <= within * within => Verdict::Partly,
        _ => Verdict::Not,
    };
    Ok(claim.result(ours, counts.images.len(), verdict))
}
