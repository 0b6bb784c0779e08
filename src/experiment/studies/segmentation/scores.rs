//! How well the segmentation forest classifies pixels (Table I).

use super::{Parameters, class_colour};
use crate::dataset::DataSet;
use crate::estimator::segmentation::{Confusion, LEAST_ARM_PIXELS};
use crate::experiment::claims::{Claim, ClaimResult, Scalar, Verdict};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::statistics::{Interval, bootstrap, mean};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::segmentation::SegmentationTask;
use crate::random::stream;
use anyhow::{Result, bail};
use rayon::prelude::*;
use serde::Deserialize;
use std::sync::Arc;

/// How a claim is tested.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// A score lies within `within` of the paper's (*reproduced*) or twice that (*partly*).
    Score {
        class: String,
        score: Score,
        within: f64,
    },
    /// The number of pixels lies within the factor `within` of the paper's (*reproduced*) or its
    /// square (*partly*).
    Pixels { class: String, within: f64 },
    /// The f1 score of the first class is at least 0.99 and above that of all others, of whose
    /// pixels at least a hundredth is taken for another of them. *Partly* when only one holds.
    MixedUp,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Score {
    Precision,
    Recall,
    F1,
}

impl Score {
    const ALL: [Score; 3] = [Score::Precision, Score::Recall, Score::F1];

    fn title(self) -> &'static str {
        match self {
            Score::Precision => "precision",
            Score::Recall => "recall",
            Score::F1 => "f1",
        }
    }

    fn of(self, confusion: &Confusion, class: usize) -> f64 {
        match self {
            Score::Precision => confusion.precision(class),
            Score::Recall => confusion.recall(class),
            Score::F1 => confusion.f1(class),
        }
    }
}

struct Scores {
    specification: Specification<Parameters, Test>,
    task: Arc<SegmentationTask>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let Specification {
        root,
        seed,
        parameters,
        ..
    } = &specification;
    let forest = parameters.forest(root, *seed)?;
    let test = super::set(root, &parameters.test, *seed)?;
    Ok(Box::new(Scores {
        task: Arc::new(SegmentationTask::new(forest, test)?),
        specification,
    }))
}

/// What came out: of each image, and of all.
struct Found {
    classes: Vec<String>,
    images: Vec<Confusion>,
    /// Of the arm whose pose is to be estimated: its class, and how many pixels of each image surely
    /// show it.
    target: usize,
    sure: Vec<usize>,
    all: Confusion,
}

impl Found {
    fn sum<'a>(&self, images: impl Iterator<Item = &'a Confusion>) -> Confusion {
        let mut sum = Confusion::new(self.classes.len());
        images.for_each(|image| sum.add(image));
        sum
    }

    /// How well images with fewer than 50 and with more than 1,000 pixels of the target arm are told
    /// apart by the pixels that surely show it: the mean of the shares told rightly.
    fn balanced_accuracy(&self) -> f64 {
        let share_seen = |is_meant: &dyn Fn(usize) -> bool| {
            let images = self.images.iter().zip(&self.sure);
            let meant = images.filter(|(image, _)| is_meant(image.pixels(self.target)));
            let seen = meant.map(|(_, &sure)| f64::from(u8::from(sure >= LEAST_ARM_PIXELS)));
            mean(&seen.collect::<Vec<_>>())
        };
        (1.0 - share_seen(&|pixels| pixels < 50) + share_seen(&|pixels| pixels > 1000)) / 2.0
    }

    /// A measure of the whole test set with its 95 % interval, images drawn with replacement.
    fn interval(&self, seed: u64, measure: impl Fn(&Confusion) -> f64) -> Interval {
        let mut random = stream(seed, "segmentation interval", &[]);
        let of =
            |drawn: &[usize]| measure(&self.sum(drawn.iter().map(|&image| &self.images[image])));
        bootstrap(self.images.len(), of, &mut random)
    }
}

impl Study for Scores {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        Ok(vec![self.task.set.clone(), self.task.clone()])
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let folder = done(&*self.task)?;
        let set = DataSet::open(&done(&*self.task.set)?)?;
        let images = SegmentationTask::confusions(&folder)?;
        let classes = set.classes();
        let mut all = Confusion::new(classes.len());
        images.iter().for_each(|image| all.add(image));
        let sure = (0..images.len()).into_par_iter().map(|image| {
            let found = SegmentationTask::read(&folder, image, &set.camera().intrinsics)?;
            Ok(found.sure_pixels())
        });
        let found = Found {
            sure: sure.collect::<Result<_>>()?,
            target: set.target() + 1,
            classes,
            images,
            all,
        };
        let claims = self.specification.claims.iter();
        Ok(Report {
            data: data(&found),
            summary: summary(&found),
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), self.figure(&found))],
            claims: claims
                .map(|claim| self.judge(claim, &found))
                .collect::<Result<_>>()?,
            text: self.text(&found),
        })
    }
}

/// A row for each class of each image: how many of its pixels were given each class, and for the
/// target arm how many pixels of the image surely show it.
fn data(found: &Found) -> Table {
    let given = found
        .classes
        .iter()
        .map(|class| format!("given_{class}_px"));
    let columns = ["image", "class", "sure_px"].map(str::to_owned);
    let mut table = Table::new(columns.into_iter().chain(given));
    for (image, confusion) in found.images.iter().enumerate() {
        for (at, (class, row)) in found.classes.iter().zip(&confusion.0).enumerate() {
            let sure = (at == found.target).then_some(found.sure[image]);
            let cells = [image.into(), class.as_str().into(), sure.into()];
            let given = row.iter().map(|&pixels| pixels.into());
            table.push(cells.into_iter().chain(given));
        }
    }
    table
}

fn summary(found: &Found) -> Table {
    let mut table = Table::new(["class", "precision", "recall", "f1", "pixels"]);
    for (at, class) in found.classes.iter().enumerate() {
        let scores = Score::ALL.map(|score| score.of(&found.all, at).into());
        let pixels = [found.all.pixels(at).into()];
        table.push(
            [class.as_str().into()]
                .into_iter()
                .chain(scores)
                .chain(pixels),
        );
    }
    table
}

impl Scores {
    /// The paper's value of a cell, from the claims.
    fn paper(&self, class: &str, score: Score) -> Option<f64> {
        self.specification.claims.iter().find_map(|claim| {
            let is_cell = matches!(&claim.test, Some(Test::Score { class: c, score: s, .. })
                if c == class && *s == score);
            match claim.paper {
                Scalar::Number(paper) if is_cell => Some(paper),
                _ => None,
            }
        })
    }

    fn figure(&self, found: &Found) -> Figure {
        let ours = |(at, class): (usize, &String)| {
            let bar = |score: Score| {
                let interval = found.interval(self.specification.seed, |c| score.of(c, at));
                (interval.mean, Some((interval.low, interval.high)))
            };
            Mark::new(
                class,
                class_colour(at),
                Shape::Bars(Score::ALL.map(bar).into()),
            )
        };
        let of_paper = |class: &String| {
            let bar = |score| (self.paper(class, score).unwrap_or(f64::NAN), None);
            Mark::new("paper", 7, Shape::Bars(Score::ALL.map(bar).into()))
        };
        let classes = || found.classes.iter().enumerate();
        let scores = classes().flat_map(|(at, class)| [ours((at, class)), of_paper(class)]);
        let shares = classes().map(|(given, class)| {
            let share = |truth: usize| {
                100.0 * found.all.0[truth][given] as f64 / found.all.pixels(truth) as f64
            };
            // Beside what is right, what is wrong could not be seen.
            let wrong = |truth| {
                if truth == given {
                    f64::NAN
                } else {
                    share(truth)
                }
            };
            let bars = (0..found.classes.len()).map(|truth| (wrong(truth), None));
            Mark::new(class, class_colour(given), Shape::Bars(bars.collect()))
        });
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "{} test images, {} pixels. Whiskers: 95 % bootstrap interval over images. Right: which \
                 other class pixels of a class were given.",
                found.images.len(),
                found
                    .images
                    .iter()
                    .map(|c| c.0.concat().iter().sum::<usize>())
                    .sum::<usize>()
            ),
            panels: vec![
                Panel::Plot(Plot {
                    title: "Scores beside the paper's".to_owned(),
                    x: Axis::of("", Score::ALL.map(Score::title)),
                    y: Axis::new("score").including(0.0, 1.0),
                    marks: scores.collect(),
                }),
                Panel::Plot(Plot {
                    title: "Mistakes".to_owned(),
                    x: Axis::of("true class", found.classes.clone()),
                    y: Axis::new("share of the class's pixels (%)").including(0.0, 0.0),
                    marks: shares.collect(),
                }),
            ],
            columns: 2,
            size: (1800, 800),
        }
    }

    /// Scores with the paper's in brackets.
    fn text(&self, found: &Found) -> String {
        let mut table = Table::new(["class", "precision", "recall", "f1", "pixels"]);
        for (at, class) in found.classes.iter().enumerate() {
            let cell = |score: Score| {
                let Interval { mean, low, high } =
                    found.interval(self.specification.seed, |c| score.of(c, at));
                let paper = self.paper(class, score);
                let paper = paper.map_or("-".to_owned(), |paper| format!("{paper:.2}"));
                format!("{mean:.3} [{low:.3}, {high:.3}] (paper {paper})").into()
            };
            let cells = Score::ALL.map(cell).into_iter();
            let pixels = [found.all.pixels(at).into()];
            table.push(
                [class.as_str().into()]
                    .into_iter()
                    .chain(cells)
                    .chain(pixels),
            );
        }
        format!(
            "{}images with fewer than 50 and with more than 1000 pixels of the {}: told apart with a \
             balanced accuracy of {:.1} %\n",
            table.to_text(),
            found.classes[found.target],
            100.0 * found.balanced_accuracy()
        )
    }

    fn judge(&self, claim: &Claim<Test>, found: &Found) -> Result<ClaimResult> {
        let class = |name: &str| match found.classes.iter().position(|class| class == name) {
            Some(class) => Ok(class),
            None => bail!(
                "claim {}: there is no class {name} (there are {})",
                claim.id,
                found.classes.join(", ")
            ),
        };
        let paper = || match claim.paper {
            Scalar::Number(paper) => Ok(paper),
            Scalar::Text(_) => bail!("claim {}: `paper` must be a number", claim.id),
        };
        let graded = |distance: f64, near: f64, far: f64| match distance {
            d if d <= near => Verdict::Reproduced,
            d if d <= far => Verdict::Partly,
            _ => Verdict::Not,
        };
        let images = found.images.len();
        Ok(match &claim.test {
            None => claim.not_checkable("nothing here can test it"),
            Some(Test::Score {
                class: name,
                score,
                within,
            }) => {
                let ours = score.of(&found.all, class(name)?);
                // Half a unit of the digit to which the paper rounds is forgiven.
                let distance = (ours - paper()?).abs() - 0.005;
                claim.result(ours, images, graded(distance, *within, 2.0 * within))
            }
            Some(Test::Pixels {
                class: name,
                within,
            }) => {
                let (ours, paper) = (found.all.pixels(class(name)?) as f64, paper()?);
                let factor = (ours / paper).max(paper / ours);
                claim.result(ours, images, graded(factor, *within, within * within))
            }
            Some(Test::MixedUp) => self.mixed_up(claim, found),
        })
    }

    fn mixed_up(&self, claim: &Claim<Test>, found: &Found) -> ClaimResult {
        let arms = 1..found.classes.len();
        let share = |confusion: &Confusion| {
            let mixed = arms.clone().map(|truth| {
                let others = arms.clone().filter(|&given| given != truth);
                others.map(|given| confusion.0[truth][given]).sum::<usize>()
            });
            let pixels = arms.clone().map(|arm| confusion.pixels(arm));
            mixed.sum::<usize>() as f64 / pixels.sum::<usize>() as f64
        };
        let Interval { mean, low, high } = found.interval(self.specification.seed, share);
        let background = found.all.f1(0);
        let is_reliable =
            background >= 0.99 && arms.clone().all(|arm| found.all.f1(arm) < background);
        let verdict = match (is_reliable, low >= 0.01) {
            (true, true) => Verdict::Reproduced,
            (false, false) => Verdict::Not,
            _ => Verdict::Partly,
        };
        let ours = format!(
            "background f1 {background:.4}; {:.2} % of the arms' pixels are taken for the other arm, 95 % \
             interval {:.2} to {:.2}",
            100.0 * mean,
            100.0 * low,
            100.0 * high
        );
        claim.result(ours, found.images.len(), verdict)
    }
}
