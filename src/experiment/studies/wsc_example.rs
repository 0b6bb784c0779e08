//! What WSC does at the nodes of real trees (section III-B3, Fig. 3).

use super::cross_validation;
use crate::experiment::claims::{Claim, ClaimResult, Verdict};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::protocol::CrossValidation;
use crate::experiment::statistics::{Interval, bootstrap_mean, mean, standard_deviation};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::{Cell, Table};
use crate::experiment::task::Task;
use crate::experiment::tasks::wsc_nodes::{Example, Level, Sample, WscNodes, WscNodesTask};
use crate::forest::objective::ObjectiveKind;
use crate::random::stream;
use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The cross-validation whose first forest on WSC is looked at.
    pub study: String,
    /// The example is the node of the first tree that has the median share of wrong samples among
    /// those of so many samples, at least and at most.
    pub example_samples: (usize, usize),
    /// Nodes below so many splits are taken together.
    pub deepest: usize,
}

/// How a claim is tested. All rest on the means of the trees.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// Splits leave more than this share of the wrong samples that sides of the same sizes would
    /// have by chance.
    LeftOfChance(f64),
    /// The clusters would take away more of eq. 6 than the splits do, by more than this share of it.
    ClustersRemoveMore(f64),
    /// The rank correlation over leaves between H of eq. 8 and that of eq. 6 is below this.
    LeavesCorrelateBelow(f64),
}

struct WscExample {
    specification: Specification<Parameters, Test>,
    task: Arc<WscNodesTask>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let Parameters {
        study,
        example_samples: (least, most),
        deepest,
    } = &specification.parameters;
    let (root, profile) = (&specification.root, specification.profile);
    let other: cross_validation::Parameters = parameters_of(root, profile, study)
        .with_context(|| format!("study = \"{study}\" must name a cross-validation"))?;
    ensure!(
        least <= most,
        "example_samples = [{least}, {most}]: the first must not be above the second"
    );
    ensure!(*deepest > 0, "deepest = 0: choose at least 1");
    let validation = CrossValidation::new(root, specification.seed, other.protocol)?;
    let wsc = ObjectiveKind::named("wsc").context("there is no objective wsc")?;
    let tasks = validation.estimates(wsc)?;
    let task = Arc::new(WscNodesTask {
        forest: tasks.first().context("there are no folds")?.forest.clone(),
        example: (*least, *most),
    });
    Ok(Box::new(WscExample {
        specification,
        task,
    }))
}

impl Study for WscExample {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        Ok(vec![self.task.clone()])
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let nodes = WscNodesTask::read(&done(&*self.task)?)?;
        let (least, most) = self.task.example;
        let example = nodes.example.as_ref().with_context(|| {
            format!("no node of the first tree has {least} to {most} samples: choose others")
        })?;
        let rows = self.rows(&nodes);
        let summary = summary(&rows);
        let claims = self.specification.claims.iter();
        Ok(Report {
            data: data(example),
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), self.figure(example, &rows))],
            claims: claims.map(|claim| self.judge(claim, &nodes)).collect(),
        })
    }
}

/// The nodes of some depths, by tree.
struct Row {
    depth: String,
    /// As in [`Level::default`] where a tree has no such nodes.
    levels: Vec<Level>,
}

/// What is told of a level.
type Quantity = fn(&Level) -> f64;
const WRONG: Quantity = |level| level.wrong / level.samples;
const BY_CHANCE: Quantity = |level| level.by_chance / level.samples;
const REMOVED_BY_CLUSTERS: Quantity = |level| level.removed_by_clusters / level.samples;
const REMOVED_BY_SPLIT: Quantity = |level| level.removed_by_split / level.samples;

impl Row {
    fn values(&self, quantity: Quantity) -> Vec<f64> {
        let levels = self.levels.iter().filter(|level| level.nodes > 0);
        levels.map(quantity).collect()
    }

    fn mean(&self, quantity: Quantity) -> f64 {
        mean(&self.values(quantity))
    }
}

fn sum<'a>(levels: impl IntoIterator<Item = &'a Level>) -> Level {
    let mut sum = Level::default();
    levels.into_iter().for_each(|&level| sum += level);
    sum
}

impl WscExample {
    /// A row for each depth and, last, one for all.
    fn rows(&self, nodes: &WscNodes) -> Vec<Row> {
        let deepest = self.specification.parameters.deepest;
        let row = |depth: String, from: usize, to: usize| Row {
            depth,
            levels: (nodes.trees.iter())
                .map(|tree| sum(tree.levels.iter().take(to).skip(from)))
                .collect(),
        };
        let each = (0..deepest).map(|depth| row(depth.to_string(), depth, depth + 1));
        let rest = row(format!("{deepest}+"), deepest, usize::MAX);
        let all = row("all".to_owned(), 0, usize::MAX);
        let rows = each.chain([rest, all]);
        rows.filter(|row| row.levels.iter().any(|level| level.nodes > 0))
            .collect()
    }

    fn figure(&self, example: &Example, rows: &[Row]) -> Figure {
        let by_depth = &rows[..rows.len() - 1];
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Above, a node {} splits below the root, the one with the median share of wrong samples \
                 among nodes of {} to {} samples (of which the bootstrap drew some more than once): its \
                 split, which sends what is left of the dashed line to the left, and its poses, which \
                 were clustered. Samples of one image share its pose. Below, all nodes of {} trees; \
                 bands: one standard deviation over trees.",
                example.depth,
                self.task.example.0,
                self.task.example.1,
                rows.last().map_or(0, |all| all.levels.len()),
            ),
            panels: vec![
                the_split(example),
                the_clusters(example),
                curves(
                    "Samples on the wrong side",
                    "share of the node's samples",
                    by_depth,
                    [("as split", WRONG, 2), ("by chance", BY_CHANCE, 7)],
                ),
                curves(
                    "Mean squared pairwise DISP taken away",
                    "share of H (eq. 6) of the node",
                    by_depth,
                    [
                        ("as split", REMOVED_BY_SPLIT, 2),
                        ("if the clusters were the sides", REMOVED_BY_CLUSTERS, 3),
                    ],
                ),
            ],
            columns: 2,
            size: (1800, 1500),
        }
    }

    fn judge(&self, claim: &Claim<Test>, nodes: &WscNodes) -> ClaimResult {
        let Some(test) = claim.test else {
            return claim.without_test();
        };
        let trees = nodes.trees.iter();
        let all = || trees.clone().map(|tree| sum(&tree.levels));
        let mean_of =
            |quantity: Quantity| 100.0 * mean(&all().map(|l| quantity(&l)).collect::<Vec<_>>());
        let over_trees = |values: Vec<f64>| -> Interval {
            bootstrap_mean(&values, &mut stream(self.specification.seed, "trees", &[]))
        };
        let (verdict, ours) = match test {
            Test::LeftOfChance(share) => {
                let interval = over_trees(all().map(|l| l.wrong / l.by_chance).collect());
                let ours = format!(
                    "{:.0} % of the samples are on the wrong side, {:.0} % by chance: {:.2} of it",
                    mean_of(WRONG),
                    mean_of(BY_CHANCE),
                    interval.mean
                );
                (Verdict::of(&interval, share, f64::INFINITY), ours)
            }
            Test::ClustersRemoveMore(share) => {
                let more = |l: Level| REMOVED_BY_CLUSTERS(&l) - REMOVED_BY_SPLIT(&l);
                let interval = over_trees(all().map(more).collect());
                let ours = format!(
                    "clusters would take away {:.0} % of a node's H of eq. 6, splits take {:.0} %",
                    mean_of(REMOVED_BY_CLUSTERS),
                    mean_of(REMOVED_BY_SPLIT)
                );
                (Verdict::of(&interval, share, f64::INFINITY), ours)
            }
            Test::LeavesCorrelateBelow(limit) => {
                let correlations: Option<Vec<f64>> = trees.clone().map(|t| t.correlation).collect();
                let Some(correlations) = correlations else {
                    return claim.not_checkable("all leaves of a tree are alike");
                };
                let interval = over_trees(correlations);
                let leaves: usize = trees.clone().map(|tree| tree.leaves).sum();
                let falsely_pure: usize = trees.clone().map(|tree| tree.falsely_pure).sum();
                let ours = format!(
                    "rank correlation {:.2} with eq. 6; zero for {:.0} % of the leaves although \
                     their poses differ",
                    interval.mean,
                    100.0 * falsely_pure as f64 / leaves as f64
                );
                (Verdict::of(&interval, f64::NEG_INFINITY, limit), ours)
            }
        };
        claim.result(ours, nodes.trees.len(), verdict)
    }
}

/// The samples of the example.
fn data(example: &Example) -> Table {
    let mut table = Table::new([
        "image",
        "weight",
        "feature_mm",
        "side",
        "cluster",
        "to_centre_0_m",
        "to_centre_1_m",
    ]);
    for sample in &example.samples {
        let [to_first, to_second] = sample.to_centres_m;
        table.push([
            sample.image.into(),
            usize::from(sample.weight).into(),
            f64::from(sample.feature_mm).into(),
            if sample.goes_left { "left" } else { "right" }.into(),
            sample.cluster.into(),
            to_first.into(),
            to_second.into(),
        ]);
    }
    table
}

fn summary(rows: &[Row]) -> Table {
    let mut table = Table::new([
        "depth",
        "nodes",
        "samples",
        "wrong",
        "wrong_sd",
        "wrong_by_chance",
        "removed_by_split",
        "removed_by_clusters",
        "trees",
    ]);
    for row in rows {
        let trees = row.levels.len();
        let total = sum(&row.levels);
        let cells: [Cell; 9] = [
            row.depth.clone().into(),
            (total.nodes as f64 / trees as f64).into(),
            (total.samples / trees as f64).into(),
            row.mean(WRONG).into(),
            standard_deviation(&row.values(WRONG)).into(),
            row.mean(BY_CHANCE).into(),
            row.mean(REMOVED_BY_SPLIT).into(),
            row.mean(REMOVED_BY_CLUSTERS).into(),
            trees.into(),
        ];
        table.push(cells);
    }
    table
}

/// A kind of sample: its cluster, whether it goes left, what it is called, and its colour. Those on
/// the wrong side have a lighter colour of the same kind.
const KINDS: [(usize, bool, &str, usize); 4] = [
    (0, true, "C_0, meant to go left", 0),
    (1, false, "C_1, meant to go right", 1),
    (1, true, "W_l: C_1 on the left", 4),
    (0, false, "W_r: C_0 on the right", 5),
];

fn the_split(example: &Example) -> Panel {
    let samples = &example.samples;
    let height = |s: &Sample| s.to_centres_m[0] - s.to_centres_m[1];
    let heights: Vec<f64> = samples.iter().map(height).collect();
    let low = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let high = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // Between values: features are whole millimetres.
    let threshold = f64::from(example.threshold_mm) + 0.5;
    let line = Shape::Dashed(vec![(threshold, low), (threshold, high)]);
    let marks = KINDS.map(|(cluster, left, label, colour)| {
        let of_kind = samples
            .iter()
            .filter(|s| (s.cluster, s.goes_left) == (cluster, left));
        let points = of_kind.map(|s| (f64::from(s.feature_mm), height(s)));
        Mark::new(label, colour, Shape::Scatter(points.collect()))
    });
    let split = Mark::new("threshold", 7, line);
    Panel::Plot(Plot {
        title: "The samples of a node and their split".to_owned(),
        x: Axis::new(&format!("feature {} (mm)", example.feature)),
        y: Axis::new("DISP to c_0 less DISP to c_1 (m)"),
        marks: marks.into_iter().chain([split]).collect(),
    })
}

fn the_clusters(example: &Example) -> Panel {
    let marks = [0, 1].map(|cluster| {
        let of_cluster = example.samples.iter().filter(|s| s.cluster == cluster);
        let mut poses: Vec<(usize, [f64; 2])> =
            of_cluster.map(|s| (s.image, s.to_centres_m)).collect();
        poses.sort_by_key(|pose| pose.0);
        poses.dedup_by_key(|pose| pose.0);
        let points = poses.into_iter().map(|(_, [x, y])| (x, y));
        Mark::new("", cluster, Shape::Scatter(points.collect()))
    });
    Panel::Plot(Plot {
        title: "Its poses and their clusters".to_owned(),
        x: Axis::new("DISP to c_0, the central pose of C_0 (m)").including(0.0, 0.0),
        y: Axis::new("DISP to c_1 (m)").including(0.0, 0.0),
        marks: marks.into(),
    })
}

fn curves(title: &str, y: &str, rows: &[Row], quantities: [(&str, Quantity, usize); 2]) -> Panel {
    let marks = quantities
        .into_iter()
        .flat_map(|(label, quantity, colour)| {
            let points = |offset: f64| {
                let at = move |(depth, row): (usize, &Row)| {
                    let spread = standard_deviation(&row.values(quantity));
                    (depth as f64, row.mean(quantity) + offset * spread)
                };
                rows.iter().enumerate().map(at)
            };
            let band = points(-1.0)
                .zip(points(1.0))
                .map(|((x, low), (_, high))| (x, low, high));
            [
                Mark::new(label, colour, Shape::Band(band.collect())),
                Mark::new(label, colour, Shape::Line(points(0.0).collect())),
            ]
        });
    Panel::Plot(Plot {
        title: title.to_owned(),
        x: Axis::of(
            "depth of the node (splits)",
            rows.iter().map(|row| row.depth.as_str()),
        ),
        y: Axis::new(y).including(0.0, 0.0),
        marks: marks.collect(),
    })
}
