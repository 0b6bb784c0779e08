//! The DISP distances between the poses of a set.

use super::data_set::DataSetTask;
use crate::Progress;
use crate::dataset::DataSet;
use crate::distances::DistanceMatrix;
use crate::experiment::task::{Cost, Stage, Task};
use crate::pose_space::disp::Disp;
use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Computes eq. 3 for all pairs of images of a set: the file `distances.bin`, metres as
/// little-endian `f64`, image 0 to images 1, 2, ..., then image 1 to images 2, 3, ..., and so on.
pub struct DistancesTask {
    pub set: Arc<DataSetTask>,
}

const FILE: &str = "distances.bin";

impl DistancesTask {
    /// Reads the result from the folder that [`Task::run`] wrote.
    pub fn read(folder: &Path) -> Result<DistanceMatrix> {
        let path = folder.join(FILE);
        let bytes =
            std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let (pairs, rest) = bytes.as_chunks::<8>();
        // n (n - 1) / 2 pairs, so that n lies between the root of twice as many and that plus one.
        let count = 1 + (2 * pairs.len()).isqrt();
        if !rest.is_empty() || count * (count - 1) / 2 != pairs.len() {
            bail!("{} does not hold the pairs of anything", path.display());
        }
        // Row a begins after those before it.
        let place = |a: usize, b: usize| a * (2 * count - a - 1) / 2 + (b - a - 1);
        Ok(DistanceMatrix::new(count, |a, b| {
            f64::from_le_bytes(pairs[place(a, b)])
        }))
    }
}

impl Task for DistancesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "distances".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        format!("distances between the poses of set {}", self.set.spec.name)
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({ "arm": self.set.spec.target })
    }

    fn inputs(&self) -> Vec<Arc<dyn Task>> {
        vec![self.set.clone()]
    }

    fn cost(&self) -> Cost {
        let pairs = (self.set.spec.images as f64).powi(2) / 2.0;
        Cost {
            seconds: 0.1 + 2e-6 * pairs,
            megabytes: 50.0 + 16e-6 * pairs,
        }
    }

    fn run(&self, inputs: &[PathBuf], out: &Path, _: Progress<'_>) -> Result<()> {
        let set = DataSet::open(&inputs[0])?;
        let (rig, _) = self.set.rig()?;
        let disp = Disp::new(&rig.robot, set.target_joints())?;
        let poses: Vec<&[f64]> = (0..set.len()).map(|image| set.pose(image)).collect();
        write(&disp.matrix(&poses), out)
    }
}

fn write(distances: &DistanceMatrix, folder: &Path) -> Result<()> {
    let path = folder.join(FILE);
    let after = |a: usize| &distances.row(a)[a + 1..];
    let pairs = (0..distances.count()).flat_map(after);
    let bytes: Vec<u8> = pairs.flat_map(|distance| distance.to_le_bytes()).collect();
    std::fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{stream, unit};

    #[test]
    fn what_is_written_is_read_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        for count in [1, 2, 3, 50, 51] {
            let mut random = stream(1, "distances", &[count as u64]);
            let points: Vec<f64> = (0..count * 2).map(|_| unit(&mut random)).collect();
            let distances = DistanceMatrix::euclidean(&points, 2);
            write(&distances, folder.path()).unwrap();
            assert_eq!(DistancesTask::read(folder.path()).unwrap(), distances);
        }
        std::fs::write(folder.path().join(FILE), [0; 16]).unwrap();
        assert!(DistancesTask::read(folder.path()).is_err());
    }
}
