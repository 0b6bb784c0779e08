//! The best, the median and the worst image of a method.

use super::{Method, Tested};
use crate::dataset::DataSet;
use crate::experiment::figure::{DepthPanel, Figure, Panel};
use crate::experiment::studies::pictures::{ESTIMATE, TRUTH, overlay};
use crate::scene::Rig;
use anyhow::Result;

/// By the mean joint error: depth above, below it the arm as it is and as it was estimated. `method` has
/// at least one result.
pub(super) fn best_median_worst(method: &Method, set: &DataSet, rig: &Rig) -> Result<Figure> {
    let mut from_best: Vec<&Tested> = method.results.iter().collect();
    from_best.sort_by(|a, b| a.error.all_deg.total_cmp(&b.error.all_deg));
    let last = from_best.len() - 1;
    let places = [("best", 0), ("median", last / 2), ("worst", last)];
    let (mut depths, mut poses) = (Vec::new(), Vec::new());
    for (name, at) in places {
        let Tested {
            outcome,
            estimate,
            error,
        } = from_best[at];
        let frame = set.frame(outcome.image)?;
        let title = format!("{:.1} deg, DISP {:.2} m", error.all_deg, error.disp_m);
        let drawn = [(&*outcome.truth, TRUTH), (&**estimate, ESTIMATE)];
        poses.push(Panel::Picture(overlay(
            &title,
            set,
            rig,
            outcome.image,
            &frame,
            &drawn,
        )?));
        depths.push(Panel::Depth(DepthPanel {
            title: format!("{name}: image {}", outcome.image),
            image: frame.depth,
            range_mm: (500, 5000),
        }));
    }
    Ok(Figure {
        title: format!(
            "{}, {}: the best, the median and the worst of {} images",
            method.title,
            method.segmentation.title(),
            from_best.len()
        ),
        caption: "Above: depth. Below: the true pose in blue, the estimate in orange, with its mean joint \
                  error and DISP. Images are ordered by their mean joint error."
            .to_owned(),
        panels: depths.into_iter().chain(poses).collect(),
        columns: places.len(),
        size: (1500, 890),
    })
}
