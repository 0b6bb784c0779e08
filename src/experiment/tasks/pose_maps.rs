//! Maps of the poses of a set to points.

use super::data_set::DataSetTask;
use super::distances::DistancesTask;
use crate::Progress;
use crate::distances::DistanceMatrix;
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::pose_space::classical_scaling::classical_scaling;
use crate::pose_space::kernel_pca::kernel_pca;
use crate::pose_space::tsne::{TsneSpec, require_perplexity, tsne, tsne_from};
use crate::random::{normal, stream};
use anyhow::{Context, Result};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How poses become points, given their DISP distances in metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseMap {
    pub method: Method,
    pub dimensions: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    Tsne {
        perplexity: f64,
        degrees_of_freedom: u32,
        /// The number of a random start, instead of that from classical scaling.
        start: Option<u64>,
    },
    KernelPca {
        sigma_m2: f64,
    },
    ClassicalScaling,
}

impl PoseMap {
    fn points(self, distances: &DistanceMatrix, seed: u64) -> Result<Vec<f64>> {
        let dimensions = self.dimensions;
        Ok(match self.method {
            Method::KernelPca { sigma_m2 } => kernel_pca(distances, sigma_m2, dimensions)?,
            Method::ClassicalScaling => classical_scaling(distances, dimensions)?,
            Method::Tsne {
                perplexity,
                degrees_of_freedom,
                start,
            } => {
                let spec = TsneSpec {
                    dimensions,
                    perplexity,
                    degrees_of_freedom,
                };
                let Some(number) = start else {
                    return Ok(tsne(distances, spec)?);
                };
                let mut stream = stream(seed, "start of t-SNE", &[number]);
                let coordinates = distances.count() * dimensions;
                let start = (0..coordinates).map(|_| normal(&mut stream)).collect();
                tsne_from(distances, spec, start)?
            }
        })
    }
}

/// Maps all poses of a set, once for each of `maps`: the file `points.json`.
pub struct PoseMapsTask {
    pub distances: Arc<DistancesTask>,
    pub maps: Vec<PoseMap>,
}

const FILE: &str = "points.json";

impl PoseMapsTask {
    pub fn new(set: DataSetTask, maps: Vec<PoseMap>) -> Result<PoseMapsTask> {
        for map in &maps {
            if let Method::Tsne { perplexity, .. } = map.method {
                require_perplexity(perplexity, set.spec.images)?;
            }
        }
        Ok(PoseMapsTask {
            distances: Arc::new(DistancesTask { set: Arc::new(set) }),
            maps,
        })
    }

    /// For each map its points, a row of coordinates for each image, from the folder that
    /// [`Task::run`] wrote.
    pub fn read(folder: &Path) -> Result<Vec<Vec<f64>>> {
        read_json(&folder.join(FILE))
    }
}

impl Task for PoseMapsTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "pose-maps".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        let set = &self.distances.set.spec.name;
        format!("{} maps of the poses of set {set}", self.maps.len())
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({ "maps": self.maps, "seed": self.distances.set.seed })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        vec![self.distances.clone()]
    }

    fn cost(&self) -> Cost {
        let pairs = (self.distances.set.spec.images as f64).powi(2);
        // The thousand steps of t-SNE take nearly all of the time.
        let steps = |map: &PoseMap| match map.method {
            Method::Tsne { .. } => 1000.0,
            _ => 10.0,
        };
        Cost {
            seconds: 5e-9 * pairs * self.maps.iter().map(steps).sum::<f64>(),
            megabytes: 50.0 + 50e-6 * pairs,
        }
    }

    fn steps(&self) -> u64 {
        self.maps.len() as u64
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let distances = DistancesTask::read(&inputs[0])?;
        let points = self.maps.par_iter().map(|map| {
            let points = map.points(&distances, self.distances.set.seed)?;
            progress(1);
            anyhow::Ok(points)
        });
        let points: Vec<Vec<f64>> = points.collect::<Result<_>>()?;
        let path = out.join(FILE);
        std::fs::write(&path, serde_json::to_vec(&points)?)
            .with_context(|| format!("cannot write {}", path.display()))
    }
}
