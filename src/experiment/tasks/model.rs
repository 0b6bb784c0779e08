//! Models, and what they say of images that they were not trained on.

use super::data_set::DataSetTask;
use crate::Progress;
use crate::dataset::{DataSet, RealFrames};
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::model::training::{ModelSpec, train};
use crate::model::{Estimate, Model};
use crate::scene::Rig;
use anyhow::{Result, ensure};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Trains a model on all images of a set, as `armpose train` does: the folder [`MODEL`].
pub struct ModelTask {
    pub set: Arc<DataSetTask>,
    pub spec: ModelSpec,
}

/// The model in the folder of a [`ModelTask`].
pub const MODEL: &str = "model";

impl Task for ModelTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "model".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        let sees = match self.spec.segmentation {
            Some(_) => "segmented",
            None => "as they are",
        };
        let (images, set) = (self.set.spec.images, &self.set.spec.name);
        format!("model of {images} images of {set}, {sees}")
    }

    fn parameters(&self) -> serde_json::Value {
        let ModelSpec {
            objective,
            pose,
            segmentation,
            learn_absence: _,
            sigma,
            t_r,
        } = &self.spec;
        serde_json::json!({
            "objective": objective,
            "pose": pose,
            "segmentation": segmentation,
            "sigma": sigma,
            "t_r": t_r,
        })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        vec![self.set.clone()]
    }

    fn cost(&self) -> Cost {
        let images = self.set.spec.images as f64;
        let forests = self.spec.segmentation.iter().chain([&self.spec.pose]);
        let (mut seconds, mut most) = (0.05 * images, 0.0f64);
        for training in forests {
            let samples = images * training.samples_per_image() as f64;
            let forest = &training.forest;
            let levels = (samples / f64::from(forest.min_leaf)).log2().max(1.0);
            seconds += 1e-9 * samples * levels * (forest.features_per_node * forest.trees) as f64;
            most = most.max(samples * training.features.count as f64);
        }
        Cost {
            seconds,
            megabytes: 700.0 + 2.2 * most / 1e6,
        }
    }

    fn steps(&self) -> u64 {
        self.spec.steps(self.set.spec.images, self.set.spec.images)
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[0])?;
        let rig = Rig::read(&self.set.spec.robot_path())?;
        // Not where it lies on this machine.
        let robot = &self.set.spec.robot;
        let model = train(&set, (&rig, robot), &self.spec, progress)?;
        Ok(model.save(&out.join(MODEL))?)
    }
}

/// Images with known joints.
#[derive(Clone)]
pub enum Known {
    /// Those of a set that shares none with the model's.
    Set(Arc<DataSetTask>),
    /// Real ones: the file that [`RealFrames`] reads.
    Real(PathBuf),
}

/// Estimates the pose in all of some images with a model: the file `estimates.json`.
pub struct ModelEstimatesTask {
    pub model: Arc<ModelTask>,
    pub images: Known,
}

/// What came out for one image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelEstimated {
    pub truth: Vec<f64>,
    pub estimate: Estimate,
}

const FILE: &str = "estimates.json";

impl ModelEstimatesTask {
    /// Reads the result from the folder that [`Task::run`] wrote: in the order of the images.
    pub fn read(folder: &Path) -> Result<Vec<ModelEstimated>> {
        read_json(&folder.join(FILE))
    }
}

impl Task for ModelEstimatesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "model-estimates".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        let images = match &self.images {
            Known::Set(set) => format!("{} images of {}", set.spec.images, set.spec.name),
            Known::Real(path) => path.file_stem().unwrap_or_default().display().to_string(),
        };
        format!("estimates of {images}: {}", self.model.label())
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({})
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        let mut inputs: Vec<Arc<dyn Task>> = vec![self.model.clone()];
        if let Known::Set(set) = &self.images {
            inputs.push(set.clone());
        }
        inputs
    }

    fn files(&self) -> Vec<PathBuf> {
        match &self.images {
            Known::Set(_) => Vec::new(),
            Known::Real(path) => {
                let real = RealFrames::read(path).map_or(Vec::new(), |real| real.frames);
                let images = real.into_iter().map(|frame| frame.depth);
                std::iter::once(path.clone()).chain(images).collect()
            }
        }
    }

    fn cost(&self) -> Cost {
        let images = match &self.images {
            Known::Set(set) => set.spec.images,
            Known::Real(_) => 10,
        };
        Cost {
            seconds: 0.1 * images as f64,
            megabytes: 500.0,
        }
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, _: Progress<'_>) -> Result<()> {
        let model = Model::load(&inputs[0].join(MODEL))?;
        let estimated: Vec<ModelEstimated> = match &self.images {
            Known::Set(_) => {
                let set = DataSet::open(&inputs[1])?;
                let of_image = |image: usize| {
                    anyhow::Ok(ModelEstimated {
                        truth: set.pose(image).to_vec(),
                        estimate: model.estimate(&set.frame(image)?.depth, 1),
                    })
                };
                let images = (0..set.len()).into_par_iter();
                images.map(of_image).collect::<Result<_>>()?
            }
            Known::Real(path) => {
                let real = RealFrames::read(path)?;
                let joints = model.record().joints.iter().map(|joint| &joint.name);
                ensure!(
                    joints.eq(&real.joints),
                    "{}: its joints are not those of the model",
                    path.display()
                );
                let view = model.view_of(&real.camera)?;
                let of_frame = |frame: usize| {
                    anyhow::Ok(ModelEstimated {
                        truth: real.frames[frame].encoders.clone(),
                        estimate: model.estimate(&view.apply(&real.depth(frame)?), 1),
                    })
                };
                (0..real.frames.len())
                    .map(of_frame)
                    .collect::<Result<_>>()?
            }
        };
        std::fs::write(out.join(FILE), serde_json::to_vec(&estimated)?)?;
        Ok(())
    }
}
