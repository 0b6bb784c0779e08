//! Images beside their segmentation (Fig. 8).

use super::{Parameters as Segmentation, class_colours, class_legend};
use crate::dataset::DataSet;
use crate::estimator::segmentation::Confusion;
use crate::experiment::claims::Claim;
use crate::experiment::figure::{DepthPanel, Figure, Panel, PicturePanel};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::study_file::parameters_of;
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::segmentation::{SegmentationTask, true_classes};
use anyhow::{Result, bail};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The study whose forest and test images are shown.
    pub study: String,
    /// How many images are shown: spread evenly from the worst to the best.
    pub images: usize,
}

/// Pictures prove nothing.
#[derive(Debug, Clone, Deserialize)]
pub enum NoTest {}

struct Gallery {
    specification: Specification<Parameters, NoTest>,
    task: Arc<SegmentationTask>,
}

pub fn define(specification: Specification<Parameters, NoTest>) -> Result<Box<dyn Study>> {
    let Specification {
        root,
        profile,
        seed,
        parameters,
        ..
    } = &specification;
    let of: Segmentation = parameters_of(root, *profile, &parameters.study)?;
    if !(2..=of.test.images).contains(&parameters.images) {
        bail!(
            "images = {}: choose 2 to {}, the number of test images",
            parameters.images,
            of.test.images
        );
    }
    let forest = of.forest(root, *seed)?;
    let test = super::set(root, &of.test, *seed)?;
    Ok(Box::new(Gallery {
        task: Arc::new(SegmentationTask::new(forest, test)?),
        specification,
    }))
}

/// The mean f1 score over the arms that an image shows or that are found in it; 1 without any.
fn arms_f1(confusion: &Confusion) -> f64 {
    let scores = (1..confusion.0.len())
        .map(|arm| confusion.f1(arm))
        .filter(|f1| !f1.is_nan());
    let (sum, count) = scores.fold((0.0, 0), |(sum, n), f1| (sum + f1, n + 1));
    if count == 0 {
        1.0
    } else {
        sum / f64::from(count)
    }
}

impl Study for Gallery {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        Ok(vec![self.task.set.clone(), self.task.clone()])
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let folder = done(&*self.task)?;
        let set = DataSet::open(&done(&*self.task.set)?)?;
        let confusions = SegmentationTask::confusions(&folder)?;
        let scores: Vec<f64> = confusions.iter().map(arms_f1).collect();
        let mut from_worst: Vec<usize> = (0..scores.len()).collect();
        from_worst.sort_by(|&a, &b| scores[a].total_cmp(&scores[b]));
        let shown = self.specification.parameters.images;
        let place = |at: usize| from_worst[at * (from_worst.len() - 1) / (shown - 1)];
        let panels = |image: usize| {
            let frame = set.frame(image)?;
            let found = SegmentationTask::read(&folder, image, &set.camera().intrinsics)?;
            let truth = true_classes(&set, &frame.labels);
            let picture = |title: String, classes| {
                Panel::Picture(PicturePanel {
                    title,
                    image: class_colours(classes, &frame.depth),
                })
            };
            let score = format!("image {image}: f1 of the arms {:.2}", scores[image]);
            Ok([
                picture("truth".to_owned(), &truth),
                picture(score, &found.classes),
                Panel::Depth(DepthPanel {
                    title: "depth".to_owned(),
                    range_mm: (500, 5000),
                    image: frame.depth.clone(),
                }),
            ])
        };
        let panels = (0..shown)
            .into_par_iter()
            .map(|at| panels(place(at)))
            .collect::<Result<Vec<_>>>()?;
        let rows = shown.div_ceil(2) as u32;
        let figure = Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Depth, true and predicted classes of test images, from the worst to the best by the f1 \
                 score of the arms. {}",
                class_legend(&set)
            ),
            panels: panels
                .into_iter()
                .flat_map(|[truth, found, depth]| [depth, truth, found])
                .collect(),
            columns: 6,
            size: (2400, 290 * rows + 110),
        };
        let mut data = Table::new(["image", "arms_f1", "shown"]);
        let places: Vec<usize> = (0..shown).map(place).collect();
        for (image, &score) in scores.iter().enumerate() {
            let is_shown = if places.contains(&image) { "yes" } else { "no" };
            data.push([image.into(), score.into(), is_shown.into()]);
        }
        let mut summary = Table::new(["place", "image", "arms_f1"]);
        for (at, &image) in places.iter().enumerate() {
            summary.push([at.into(), image.into(), scores[image].into()]);
        }
        let claims = self.specification.claims.iter();
        Ok(Report {
            data,
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), figure)],
            claims: claims.map(Claim::without_test).collect(),
        })
    }
}
