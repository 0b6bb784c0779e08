//! How well maps of the poses keep neighbourhoods (section IV-D, Fig. 10).

use crate::dataset::DataSet;
use crate::distances::DistanceMatrix;
use crate::experiment::claims::{Claim, ClaimResult, Verdict, difference};
use crate::experiment::figure::{Axis, Figure, Mark, Panel, Plot, Shape};
use crate::experiment::statistics::{bootstrap_mean, mean, standard_deviation};
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::table::{Cell, Table};
use crate::experiment::task::Task;
use crate::experiment::tasks::data_set::DataSetTask;
use crate::experiment::tasks::distances::DistancesTask;
use crate::experiment::tasks::pose_maps::{Method, PoseMap, PoseMapsTask};
use crate::pose_space::co_ranking::CoRanking;
use crate::random::stream;
use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// A file of `data/sets/`, without its extension.
    pub set: String,
    pub images: usize,
    /// Ascending. Claims compare the first with the last.
    pub dimensions: Vec<usize>,
    pub perplexity: f64,
    /// The sigma of eq. 11, in square metres.
    pub sigma_m2: f64,
    /// Up to this many neighbours are near ones.
    pub near: usize,
    /// How often t-SNE is repeated from random points.
    pub random_starts: usize,
}

/// How a claim is tested, by paired differences over the poses.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// One map has a higher measure than another.
    Order {
        higher: Which,
        lower: Which,
        measure: Measure,
    },
    /// From the fewest to the most dimensions a map gains less than this share of what another gains.
    GainsLess {
        map: String,
        than: String,
        share: f64,
        measure: Measure,
    },
}

/// A map in the fewest or the most of the study's dimensions.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Which {
    map: String,
    d: End,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum End {
    Fewest,
    Most,
}

/// One number for the neighbourhoods of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Measure {
    /// Q_NX(K) averaged over K = 1 to `near`.
    Near,
    /// Q_NX(K) averaged over all K, as the eye does on an even axis.
    Mean,
    /// The area below R_NX(K) over ln K.
    Area,
}

const MEASURES: [(Measure, &str); 3] = [
    (Measure::Near, "near"),
    (Measure::Mean, "mean"),
    (Measure::Area, "area"),
];

/// The families of maps: name in the files, name in figures.
const FAMILIES: [(&str, &str); 4] = [
    ("tsne", "t-SNE"),
    ("tsne-dof", "t-SNE, d - 1 degrees of freedom"),
    ("kpca", "KPCA"),
    ("mds", "classical scaling"),
];
/// No map, but the distance that MSE uses.
const ANGLES: (&str, &str) = ("angles", "joint angles");

struct MapQuality {
    specification: Specification<Parameters, Test>,
    maps: Arc<PoseMapsTask>,
    /// The families' names beside `maps`.
    names: Vec<&'static str>,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let p = &specification.parameters;
    if p.dimensions.is_empty() || !p.dimensions.is_sorted_by(|a, b| a < b) || p.dimensions[0] == 0 {
        bail!("dimensions = {:?}: choose some, ascending", p.dimensions);
    }
    if !(1..p.images).contains(&p.near) {
        bail!(
            "near = {}, images = {}: choose 1 to one less than the images",
            p.near,
            p.images
        );
    }
    let set = DataSetTask::new(&specification.root, &p.set, p.images, specification.seed)?;
    let mut maps = Vec::new();
    let mut names = Vec::new();
    for &dimensions in &p.dimensions {
        let mut push = |name: &'static str, method: Method| {
            names.push(name);
            maps.push(PoseMap { method, dimensions });
        };
        let tsne = |degrees_of_freedom: usize, start: Option<u64>| Method::Tsne {
            perplexity: p.perplexity,
            degrees_of_freedom: degrees_of_freedom as u32,
            start,
        };
        push("tsne", tsne(1, None));
        if dimensions > 2 {
            push("tsne-dof", tsne(dimensions - 1, None));
        }
        push(
            "kpca",
            Method::KernelPca {
                sigma_m2: p.sigma_m2,
            },
        );
        push("mds", Method::ClassicalScaling);
        for start in 0..p.random_starts as u64 {
            push("tsne-random", tsne(1, Some(start)));
        }
    }
    Ok(Box::new(MapQuality {
        maps: Arc::new(PoseMapsTask::new(set, maps)?),
        names,
        specification,
    }))
}

/// A map, or the joint angles themselves, beside DISP.
struct Candidate {
    name: &'static str,
    dimensions: usize,
    quality: CoRanking,
}

impl Candidate {
    /// The measure of each pose.
    fn each(&self, measure: Measure, near: usize) -> Vec<f64> {
        let q = &self.quality;
        let mean_to =
            |i: usize, most: usize| (1..=most).map(|k| q.q_nx_of(i, k)).sum::<f64>() / most as f64;
        let of = |i: usize| match measure {
            Measure::Near => mean_to(i, near),
            Measure::Mean => mean_to(i, q.count() - 1),
            Measure::Area => q.area_of(i),
        };
        (0..q.count()).map(of).collect()
    }
}

impl Study for MapQuality {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        let distances = &self.maps.distances;
        Ok(vec![
            distances.set.clone(),
            distances.clone(),
            self.maps.clone(),
        ])
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let disp = DistancesTask::read(&done(&*self.maps.distances)?)?;
        let points = PoseMapsTask::read(&done(&*self.maps)?)?;
        let candidate = |name, points: &[f64], dimensions| Candidate {
            name,
            dimensions,
            quality: CoRanking::new(&disp, &DistanceMatrix::euclidean(points, dimensions)),
        };
        let maps = self.maps.maps.iter().zip(&self.names).zip(&points);
        let mut candidates: Vec<Candidate> = maps
            .map(|((map, name), points)| candidate(name, points, map.dimensions))
            .collect();
        let set = DataSet::open(&done(&*self.maps.distances.set)?)?;
        let angles: Vec<f64> = (0..set.len()).flat_map(|i| set.pose(i)).copied().collect();
        candidates.push(candidate(ANGLES.0, &angles, set.target_joints().len()));

        let summary = self.summary(&candidates);
        let claims = self.specification.claims.iter();
        Ok(Report {
            data: data(&candidates),
            text: summary.to_text(),
            summary,
            tables: Vec::new(),
            figures: vec![(self.specification.id.clone(), self.figure(&candidates))],
            claims: claims
                .map(|claim| self.judge(claim, &candidates))
                .collect::<Result<_>>()?,
        })
    }
}

/// A row for each candidate and K.
fn data(candidates: &[Candidate]) -> Table {
    let columns = ["map", "d", "start", "k", "q_nx", "standard_error", "r_nx"];
    let mut table = Table::new(columns);
    let mut start = 0;
    for (at, candidate) in candidates.iter().enumerate() {
        let q = &candidate.quality;
        let is_random = candidate.name == "tsne-random";
        let follows = at > 0 && candidates[at - 1].name == candidate.name;
        start = if is_random && follows { start + 1 } else { 0 };
        for k in 1..q.count() - 1 {
            table.push([
                candidate.name.into(),
                candidate.dimensions.into(),
                is_random.then_some(start).into(),
                k.into(),
                q.q_nx(k).into(),
                standard_error(q, k).into(),
                q.r_nx(k).into(),
            ]);
        }
    }
    table
}

/// Of Q_NX(K) over the poses.
fn standard_error(quality: &CoRanking, k: usize) -> f64 {
    let each: Vec<f64> = (0..quality.count())
        .map(|i| quality.q_nx_of(i, k))
        .collect();
    standard_deviation(&each) / (each.len() as f64).sqrt()
}

impl MapQuality {
    /// A row for each candidate and measure; t-SNE from random starts is a range beside t-SNE.
    fn summary(&self, candidates: &[Candidate]) -> Table {
        let Specification {
            parameters, seed, ..
        } = &self.specification;
        let columns = [
            "map",
            "d",
            "measure",
            "value",
            "low",
            "high",
            "starts_low",
            "starts_high",
        ];
        let mut table = Table::new(columns);
        for candidate in candidates.iter().filter(|c| c.name != "tsne-random") {
            let dimensions = candidate.dimensions;
            for (measure, name) in MEASURES {
                let each = candidate.each(measure, parameters.near);
                let mut stream = stream(*seed, "interval of map quality", &[dimensions as u64]);
                let interval = bootstrap_mean(&each, &mut stream);
                let starts = candidates.iter().filter(|c| {
                    (c.name, c.dimensions) == ("tsne-random", dimensions)
                        && candidate.name == "tsne"
                });
                let starts: Vec<f64> = starts
                    .map(|c| mean(&c.each(measure, parameters.near)))
                    .collect();
                let bound = |better: fn(f64, f64) -> f64| -> Cell {
                    starts.iter().copied().reduce(better).into()
                };
                table.push([
                    candidate.name.into(),
                    dimensions.into(),
                    name.into(),
                    interval.mean.into(),
                    interval.low.into(),
                    interval.high.into(),
                    bound(f64::min),
                    bound(f64::max),
                ]);
            }
        }
        table
    }

    fn judge(&self, claim: &Claim<Test>, candidates: &[Candidate]) -> Result<ClaimResult> {
        let Parameters {
            dimensions, near, ..
        } = &self.specification.parameters;
        let at = |end: End| match end {
            End::Fewest => dimensions[0],
            End::Most => dimensions[dimensions.len() - 1],
        };
        let each = |map: &str, end: End, measure: Measure| {
            let of = |c: &&Candidate| c.name == map && c.dimensions == at(end);
            match candidates.iter().find(of) {
                Some(candidate) => Ok(candidate.each(measure, *near)),
                None => bail!("claim {}: there is no map `{map}`", claim.id),
            }
        };
        let gain = |map: &str, factor: f64, measure: Measure| -> Result<Vec<f64>> {
            let before = each(map, End::Fewest, measure)?;
            let after = each(map, End::Most, measure)?;
            let pairs = before.iter().zip(&after);
            Ok(pairs.map(|(b, a)| factor * (a - b)).collect())
        };
        let (higher, lower, what) = match &claim.test {
            None => return Ok(claim.without_test()),
            Some(Test::Order {
                higher: a,
                lower: b,
                measure,
            }) => (
                each(&a.map, a.d, *measure)?,
                each(&b.map, b.d, *measure)?,
                format!(
                    "{} at d = {} - {} at d = {}",
                    a.map,
                    at(a.d),
                    b.map,
                    at(b.d)
                ),
            ),
            Some(Test::GainsLess {
                map,
                than,
                share,
                measure,
            }) => (
                gain(than, *share, *measure)?,
                gain(map, 1.0, *measure)?,
                format!("{share} of the gain of {than} - that of {map}"),
            ),
        };
        let mut stream = stream(self.specification.seed, "order of maps", &[]);
        let gap = difference(&higher, &lower, &mut stream);
        let ours = format!(
            "{what} = {:.3} ({:.3} to {:.3}); 95 % interval",
            gap.mean, gap.low, gap.high
        );
        let verdict = Verdict::of(&gap, 0.0, f64::INFINITY);
        Ok(claim.result(ours, higher.len(), verdict))
    }

    fn figure(&self, candidates: &[Candidate]) -> Figure {
        const SHOWN: usize = 25;
        let Parameters {
            dimensions, near, ..
        } = &self.specification.parameters;
        let floor = &candidates[candidates.len() - 1];
        let most = floor.quality.count() - 2;
        // Evenly on a logarithmic axis, every K once.
        let step = |i: usize| (most as f64).powf(i as f64 / (SHOWN - 1) as f64).round() as usize;
        let mut ks: Vec<usize> = (0..SHOWN).map(step).collect();
        ks.dedup();
        let curve = |quality: &CoRanking| -> Vec<(f64, f64)> {
            ks.iter().map(|&k| (k as f64, quality.q_nx(k))).collect()
        };
        let band = |quality: &CoRanking| {
            let limits = ks.iter().map(|&k| {
                let (q, error) = (quality.q_nx(k), 1.96 * standard_error(quality, k));
                (k as f64, q - error, q + error)
            });
            Shape::Band(limits.collect())
        };
        let of = |name: &str, d: usize| {
            candidates
                .iter()
                .find(move |c| c.name == name && c.dimensions == d)
        };
        let neighbourhoods = |d: usize| {
            let mut marks = vec![Mark::new(ANGLES.1, 7, Shape::Dashed(curve(&floor.quality)))];
            for (colour, (name, title)) in FAMILIES.iter().enumerate() {
                let Some(map) = of(name, d) else { continue };
                if *name == "mds" {
                    // On top of the line of KPCA, as a rule.
                    let line = Shape::Dashed(curve(&map.quality));
                    marks.push(Mark::new(title, colour, line));
                } else {
                    marks.push(Mark::new(title, colour, band(&map.quality)));
                    marks.push(Mark::new(title, colour, Shape::Line(curve(&map.quality))));
                }
            }
            Panel::Plot(Plot {
                title: format!("d = {d}"),
                x: Axis::new("neighbours K").log(),
                y: Axis::new("Q_NX(K)").including(0.0, 1.0),
                marks,
            })
        };
        // The fewest, a middle and the most dimensions.
        let mut shown = vec![dimensions[0], dimensions[dimensions.len() / 2]];
        shown.push(dimensions[dimensions.len() - 1]);
        shown.dedup();
        let mut panels: Vec<Panel> = shown.into_iter().map(neighbourhoods).collect();

        let mut marks = vec![Mark::new(ANGLES.1, 7, Shape::Level(floor.quality.area()))];
        for (colour, (name, title)) in FAMILIES.iter().enumerate() {
            let maps = || dimensions.iter().filter_map(|&d| Some((d, of(name, d)?)));
            let limits = maps().map(|(d, map)| {
                let each = map.each(Measure::Area, *near);
                let error = 1.96 * standard_deviation(&each) / (each.len() as f64).sqrt();
                (d as f64, mean(&each) - error, mean(&each) + error)
            });
            if *name != "mds" {
                marks.push(Mark::new(title, colour, Shape::Errors(limits.collect())));
            }
            let areas = maps().map(|(d, map)| (d as f64, map.quality.area()));
            let areas = areas.collect();
            let line = match *name {
                "mds" => Shape::Dashed(areas),
                _ => Shape::Line(areas),
            };
            marks.push(Mark::new(title, colour, line));
        }
        panels.push(Panel::Plot(Plot {
            title: "All neighbourhoods at once".to_owned(),
            x: Axis::new("dimensions d").log(),
            y: Axis::new("area below R_NX(K) over ln K").including(0.0, 0.0),
            marks,
        }));
        Figure {
            title: self.specification.title.clone(),
            caption: format!(
                "{} poses of set {}. Q_NX(K): the share of a pose's K nearest by DISP that are among \
                 its K nearest in the map; R_NX(K): the same, scaled from chance (0) to perfect (1). \
                 Bands and bars: 95 % over the poses.",
                floor.quality.count(),
                self.specification.parameters.set
            ),
            panels,
            columns: 2,
            size: (1900, 1500),
        }
    }
}
