//! The poses of a set in the plane of a map (section III-B4, Fig. 4).

use crate::dataset::{DataSet, viridis};
use crate::distances::DistanceMatrix;
use crate::experiment::claims::{Claim, ClaimResult, Verdict, difference};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Picture, Plot, Shape};
use crate::experiment::statistics::{bootstrap_mean, mean};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::Table;
use crate::experiment::task::Task;
use crate::experiment::tasks::data_set::DataSetTask;
use crate::experiment::tasks::distances::DistancesTask;
use crate::experiment::tasks::pose_maps::{Method, PoseMap, PoseMapsTask};
use crate::random::stream;
use anyhow::{Result, bail};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// A file of `data/sets/`, without its extension.
    pub set: String,
    pub images: usize,
    pub perplexity: f64,
    /// How many neighbours of a pose count as near.
    pub neighbours: usize,
}

/// How the claim is tested: the nearest neighbours of a pose in the map are nearer by DISP than its
/// nearest neighbours by joint angles, over the poses.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    NearerThanByAngles,
}

struct PoseMapStudy {
    specification: Specification<Parameters, Test>,
    map: Arc<PoseMapsTask>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let p = &specification.parameters;
    if !(1..p.images).contains(&p.neighbours) {
        bail!(
            "neighbours = {}, images = {}: choose 1 to one less than the images",
            p.neighbours,
            p.images
        );
    }
    let set = DataSetTask::new(&specification.root, &p.set, p.images, specification.seed)?;
    let method = Method::Tsne {
        perplexity: p.perplexity,
        degrees_of_freedom: 1,
        start: None,
    };
    let map = PoseMap {
        method,
        dimensions: 2,
    };
    Ok(Box::new(PoseMapStudy {
        map: Arc::new(PoseMapsTask::new(set, vec![map])?),
        specification,
    }))
}

impl Study for PoseMapStudy {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let distances = &self.map.distances;
        Ok(vec![
            distances.set.clone(),
            distances.clone(),
            self.map.clone(),
        ])
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let set = DataSet::open(&done(&*self.map.distances.set)?)?;
        let disp = DistancesTask::read(&done(&*self.map.distances)?)?;
        let maps = PoseMapsTask::read(&done(&*self.map)?)?;
        let Some(points) = maps.first().filter(|points| points.len() == 2 * set.len()) else {
            bail!("the map does not hold the {} poses of the set", set.len());
        };
        let angles: Vec<f64> = (0..set.len()).flat_map(|i| set.pose(i)).copied().collect();
        let angles = DistanceMatrix::euclidean(&angles, set.target_joints().len());
        let neighbours = self.specification.parameters.neighbours;
        let all = set.len() - 1;
        let near = [
            ("DISP", mean_disp(&disp, &disp, neighbours)),
            (
                "map",
                mean_disp(&disp, &DistanceMatrix::euclidean(points, 2), neighbours),
            ),
            ("joint angles", mean_disp(&disp, &angles, neighbours)),
            ("nothing", mean_disp(&disp, &disp, all)),
        ];

        let mut data = Table::new([
            "image",
            "x",
            "y",
            "visible_px",
            "near_by_disp_m",
            "near_in_map_m",
            "near_by_angles_m",
            "all_m",
        ]);
        for (i, point) in points.chunks_exact(2).enumerate() {
            let visible = set.record().images[i].arms[set.target()];
            let mut row = vec![i.into(), point[0].into(), point[1].into(), visible.into()];
            row.extend(near.iter().map(|(_, each)| each[i].into()));
            data.push(row);
        }
        let mut summary = Table::new(["nearest_by", "neighbours", "disp_m", "low_m", "high_m"]);
        for (name, each) in &near {
            let mut stream = stream(self.specification.seed, "interval of neighbours", &[]);
            let interval = bootstrap_mean(each, &mut stream);
            let count = if *name == "nothing" { all } else { neighbours };
            summary.push([
                (*name).into(),
                count.into(),
                interval.mean.into(),
                interval.low.into(),
                interval.high.into(),
            ]);
        }
        let claims = self.specification.claims.iter();
        Ok(Report {
            data,
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), self.figure(&set, points)?)],
            claims: claims
                .map(|claim| self.judge(claim, &near[1].1, &near[2].1))
                .collect(),
        })
    }
}

/// For each pose the mean of `disp` to its nearest neighbours by `distances`, equals by index.
fn mean_disp(disp: &DistanceMatrix, distances: &DistanceMatrix, neighbours: usize) -> Vec<f64> {
    let of = |i: usize| {
        let mut others: Vec<usize> = (0..disp.count()).filter(|&j| j != i).collect();
        others.sort_by(|&a, &b| distances.get(i, a).total_cmp(&distances.get(i, b)));
        let nearest: Vec<f64> = others[..neighbours]
            .iter()
            .map(|&j| disp.get(i, j))
            .collect();
        mean(&nearest)
    };
    (0..disp.count()).map(of).collect()
}

impl PoseMapStudy {
    fn judge(&self, claim: &Claim<Test>, in_map: &[f64], by_angles: &[f64]) -> ClaimResult {
        let Some(Test::NearerThanByAngles) = &claim.test else {
            return claim.without_test();
        };
        let mut stream = stream(self.specification.seed, "order of neighbours", &[]);
        let gap = difference(by_angles, in_map, &mut stream);
        let ours = format!(
            "{:.3} m by angles - {:.3} m in the map = {:.3} m ({:.3} to {:.3}); 95 % interval",
            mean(by_angles),
            mean(in_map),
            gap.mean,
            gap.low,
            gap.high
        );
        let verdict = Verdict::of(&gap, 0.0, f64::INFINITY);
        claim.result(ours, in_map.len(), verdict)
    }

    /// Where room is short, images that show more of the arm come first.
    fn figure(&self, set: &DataSet, points: &[f64]) -> Result<Figure> {
        let mut order: Vec<usize> = (0..set.len()).collect();
        let visible = |image: usize| set.record().images[image].arms[set.target()];
        order.sort_by_key(|&image| std::cmp::Reverse(visible(image)));
        let place = |image: usize| (points[2 * image], points[2 * image + 1]);
        let picture = |&image: &usize| Ok((place(image), thumbnail(set, image)?));
        let pictures: Vec<((f64, f64), Picture)> =
            order.par_iter().map(picture).collect::<Result<_>>()?;
        // With room for the pictures at the edge.
        let axis = |label: &str, coordinate: usize| {
            let values = || points.iter().skip(coordinate).step_by(2).copied();
            let (low, high) = (values().fold(0.0, f64::min), values().fold(0.0, f64::max));
            Axis::new(label).including(1.1 * low, 1.1 * high)
        };
        Ok(Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "Each of the {} poses of set {} at its point of the map; its depth image stands there \
                 where there is room, else a dot. The arm whose pose it is: coloured from 0.5 m \
                 (yellow) to {FAR_M} m (violet). All else: grey, from 0.5 m (light) to 5 m. No depth: \
                 black. The axes of t-SNE have no unit.",
                set.len(),
                self.specification.parameters.set
            ),
            panels: vec![Panel::Plot(Plot {
                title: String::new(),
                x: axis("first coordinate of t-SNE", 0).to_scale(),
                y: axis("second coordinate of t-SNE", 1),
                marks: vec![Mark::new("", 1, Shape::Pictures(pictures))],
            })],
            columns: 1,
            size: (2000, 1540),
        })
    }
}

/// Where the colours of the arm end.
const FAR_M: f64 = 1.5;

/// The depth image at 7 / 20 of its size.
fn thumbnail(set: &DataSet, image: usize) -> Result<Picture> {
    let frame = set.frame(image)?;
    let arm_of_label = set.arm_of_label();
    let (width, height) = (frame.depth.width * 7 / 20, frame.depth.height * 7 / 20);
    let pixel = |at: usize| {
        let (x, y) = (at % width * 20 / 7, at / width * 20 / 7);
        let source = y * frame.depth.width + x;
        let depth = f64::from(frame.depth.pixels[source]) / 1000.0;
        let label = frame.labels.pixels[source];
        if depth == 0.0 {
            [0; 3]
        } else if arm_of_label[usize::from(label)] == Some(set.target()) {
            viridis(1.0 - (depth - 0.5) / (FAR_M - 0.5))
        } else {
            [(235.0 - 130.0 * (depth - 0.5) / 4.5) as u8; 3]
        }
    };
    Ok(Picture {
        width,
        pixels: (0..width * height).map(pixel).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_chosen_by_one_distance_and_measured_by_another() {
        let disp = DistanceMatrix::euclidean(&[0.0, 1.0, 3.0, 7.0], 1);
        let others = DistanceMatrix::euclidean(&[0.0, 5.0, 2.0, 1.0], 1);
        assert_eq!(mean_disp(&disp, &disp, 2), [2.0, 1.5, 2.5, 5.0]);
        // Nearest to the first are the last (7) and the third (3).
        assert_eq!(mean_disp(&disp, &others, 2), [5.0, 4.0, 3.5, 5.5]);
        assert_eq!(mean_disp(&disp, &others, 3), mean_disp(&disp, &disp, 3));
    }
}
