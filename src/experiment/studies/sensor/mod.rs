//! The study of the simulated sensor: noise, depth steps, shadows and edges beside the published
//! formulas and real frames.

mod measure;
mod real_frames;
mod report;

use crate::camera::Camera;
use crate::experiment::shared;
use crate::experiment::study::{Done, Report, Specification, Study};
use crate::experiment::task::{Cost, Stage, Task, read_json};
use anyhow::{Context, Result, bail};
use measure::Bench;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// Camera presets, relative to the repository.
    cameras: Vec<PathBuf>,
    /// Photos of each condition.
    frames: usize,
    /// Distances of the wall.
    distances_m: Vec<f64>,
    /// Slants of the wall at 1 m.
    slants_deg: Vec<f64>,
    /// Distances of a plate and of the wall behind it.
    plates_m: Vec<(f64, f64)>,
    /// The most real frames to set beside the simulated ones, where the shared data has any.
    real_frames: usize,
}

/// What a claim's test demands. Each says how far the worst condition may be off; up to twice that
/// is "partly".
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Test {
    /// The shadow's width is f b (1 / z_near - 1 / z_far), to so many pixels.
    ShadowWidth(f64),
    /// Depths are z^2 / (8 f b) apart from 1 m on, to such a share.
    DepthStep(f64),
    /// The noise at 1 to 3 m lies between the two published curves, or outside by such a share.
    AxialNoise(f64),
    /// The noise is that of planes in real frames, to such a share.
    RealNoise(f64),
}

/// One measurement. What was not measured is empty.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
pub struct Observation {
    /// "wall", "slant", "plate", "real plane" or "real step".
    measurement: String,
    /// The camera preset or the real frame.
    source: String,
    distance_m: f64,
    frame: usize,
    background_m: Option<f64>,
    slant_deg: Option<f64>,
    axial_sd_mm: Option<f64>,
    depth_step_mm: Option<f64>,
    shadow_px: Option<f64>,
    left_gap_px: Option<f64>,
    right_gap_px: Option<f64>,
    lateral_sd_px: Option<f64>,
    valid_share: Option<f64>,
    pixels: usize,
}

pub fn define(specification: Specification<Parameters, Test>) -> Result<Box<dyn Study>> {
    let parameters = &specification.parameters;
    if parameters.frames == 0 || parameters.cameras.is_empty() {
        bail!("`frames` must be at least 1 and `cameras` must name a preset");
    }
    let sound = |z: f64| z > 0.2 && z < 20.0;
    if !(parameters.distances_m.iter().all(|&z| sound(z))
        && parameters
            .plates_m
            .iter()
            .all(|&(near, far)| sound(near) && far > near + 0.02 && sound(far)))
    {
        bail!("distances must lie between 0.2 and 20 m, and walls behind their plates");
    }
    if !parameters
        .slants_deg
        .iter()
        .all(|&slant| (0.0..89.0).contains(&slant))
    {
        bail!("`slants_deg` must lie between 0 and 89");
    }
    let mut real_frames = real_frames(&specification.root)?;
    real_frames.truncate(parameters.real_frames);
    let task = Measurements {
        root: specification.root.clone(),
        seed: specification.seed,
        parameters: parameters.clone(),
        real_frames,
    };
    Ok(Box::new(SensorStudy {
        specification,
        task: Arc::new(task),
    }))
}

/// The real frames, when the folder of shared data (`ARMPOSE_SHARED`, else `../shared`) has them.
fn real_frames(root: &Path) -> Result<Vec<PathBuf>> {
    let folder = shared(root).join("realdata/kinect_static");
    let Ok(entries) = folder.read_dir() else {
        return Ok(Vec::new());
    };
    let mut frames = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        if path.extension().is_some_and(|e| e == "png") {
            frames.push(path);
        }
    }
    frames.sort();
    Ok(frames)
}

struct SensorStudy {
    specification: Specification<Parameters, Test>,
    task: Arc<Measurements>,
}

impl Study for SensorStudy {
    fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
        Ok(vec![self.task.clone()])
    }

    fn report(&self, done: Done<'_>) -> Result<Report> {
        let observations: Vec<Observation> = read_json(&done(&*self.task)?.join(RESULT))?;
        report::report(&self.specification, &observations)
    }
}

const RESULT: &str = "observations.json";

struct Measurements {
    root: PathBuf,
    seed: u64,
    parameters: Parameters,
    real_frames: Vec<PathBuf>,
}

impl Task for Measurements {
    fn stage(&self) -> Stage {
        Stage {
            name: "sensor-measurements".to_owned(),
            version: 2,
        }
    }

    fn label(&self) -> String {
        "measurements of the sensor".to_owned()
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({ "seed": self.seed, "parameters": self.parameters })
    }

    fn files(&self) -> Vec<PathBuf> {
        let presets = self
            .parameters
            .cameras
            .iter()
            .map(|preset| self.root.join(preset));
        presets.chain(self.real_frames.iter().cloned()).collect()
    }

    fn cost(&self) -> Cost {
        Cost {
            seconds: 0.02 * self.steps() as f64,
            megabytes: 100.0,
        }
    }

    fn steps(&self) -> u64 {
        let p = &self.parameters;
        let conditions = p.distances_m.len() + p.slants_deg.len() + p.plates_m.len();
        (p.cameras.len() * p.frames * conditions) as u64
    }

    fn run(&self, _: &[PathBuf], out: &Path, progress: crate::Progress<'_>) -> Result<()> {
        let p = &self.parameters;
        let mut jobs = Vec::new();
        for preset in &p.cameras {
            let camera = Camera::read(&self.root.join(preset))?;
            let name = file_stem(preset);
            jobs.extend((0..p.frames).map(|frame| (name.clone(), camera, frame)));
        }
        let measure = |(name, camera, frame): &(String, Camera, usize)| {
            let mut bench = Bench {
                name,
                photographer: crate::camera::Photographer::new(camera),
                seed: self.seed,
            };
            let mut found = Vec::new();
            let mut note = |observation| {
                found.push(observation);
                progress(1);
            };
            for &distance in &p.distances_m {
                // Slightly slanted, so that all fractions of a disparity step occur.
                note(bench.wall("wall", distance, 3.0, *frame));
            }
            for &slant in &p.slants_deg {
                note(bench.wall("slant", 1.0, slant, *frame));
            }
            for &(distance, background) in &p.plates_m {
                note(bench.plate(distance, background, *frame));
            }
            found
        };
        let mut observations: Vec<Observation> = jobs.par_iter().flat_map_iter(measure).collect();
        for path in &self.real_frames {
            observations.extend(real_frames::measure(path, &file_stem(path))?);
        }
        std::fs::write(out.join(RESULT), serde_json::to_vec(&observations)?)?;
        Ok(())
    }
}

fn file_stem(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}
