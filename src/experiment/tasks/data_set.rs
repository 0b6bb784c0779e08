//! Generating a data set.

use crate::Progress;
use crate::dataset::{self, SetSpec};
use crate::experiment::task::{Cost, Stage, Task};
use crate::scene::Rig;
use anyhow::{Result, bail, ensure};
use std::path::{Path, PathBuf};

/// Generates the set that `data/sets/<name>.toml` specifies.
pub struct DataSetTask {
    pub spec: SetSpec,
    pub seed: u64,
}

impl DataSetTask {
    /// The set called `name`, cut or extended to `images` images.
    pub fn new(root: &Path, name: &str, images: usize, seed: u64) -> Result<DataSetTask> {
        let path = root.join("data/sets").join(format!("{name}.toml"));
        let mut spec = SetSpec::read(&path)?;
        spec.images = images;
        ensure!(
            spec.without_robot == 0.0,
            "{}: studies compare poses and need the robot in every image; set without_robot = 0",
            path.display()
        );
        Ok(DataSetTask { spec, seed })
    }

    /// Of the robot's files, the one that is not there.
    pub fn missing(&self) -> Result<Option<PathBuf>> {
        let urdf = Rig::urdf_of(&self.spec.robot_path())?;
        Ok((!urdf.is_file()).then_some(urdf))
    }

    /// The robot, and which of its arms is estimated.
    pub fn rig(&self) -> Result<(Rig, usize)> {
        let rig = Rig::read(&self.spec.robot_path())?;
        match rig.arm(&self.spec.target) {
            Some(arm) => Ok((rig, arm)),
            None => bail!(
                "set {}: the robot has no arm called {}",
                self.spec.name,
                self.spec.target
            ),
        }
    }
}

impl Task for DataSetTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "data-set".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        format!("{} images of set {}", self.spec.images, self.spec.name)
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({ "name": self.spec.name, "seed": self.seed, "specification": self.spec })
    }

    fn files(&self) -> Vec<PathBuf> {
        let robot = self.spec.robot_path();
        let folder = |path: &Path| path.parent().map_or(path.to_owned(), Path::to_owned);
        let mut files = vec![folder(&robot), self.spec.camera_path()];
        // A description elsewhere, with its meshes. One that cannot be found fails when it is read.
        match Rig::urdf_of(&robot) {
            Ok(urdf) if folder(&urdf) != files[0] => files.push(folder(&urdf)),
            _ => {}
        }
        files
    }

    fn cost(&self) -> Cost {
        Cost {
            seconds: 0.05 * self.spec.images as f64,
            megabytes: 150.0,
        }
    }

    fn steps(&self) -> u64 {
        self.spec.images as u64
    }

    fn run(&self, _inputs: &[PathBuf], out: &Path, progress: Progress<'_>) -> Result<()> {
        dataset::generate(&self.spec, self.seed, out, progress)?;
        Ok(())
    }
}
