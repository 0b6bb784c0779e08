//! Draws the images of a data set and writes them.

use super::record::{CameraRecord, SetRecord, hash, write_json};
use super::{DEPTH, DataSet, DataSetError, LABEL, SetSpec, Studio, depth_file, label_file};
use crate::Progress;
use crate::camera::Photographer;
use crate::camera::png::{write_depth, write_labels};
use crate::robot::{Motion, Robot};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Draws a data set into `folder`, which must be empty or not exist yet, and is empty again when that
/// fails. Images are independent of each other: the same whatever their number and the number of
/// threads. `progress` counts images.
pub fn generate(
    spec: &SetSpec,
    seed: u64,
    folder: &Path,
    progress: Progress,
) -> Result<DataSet, DataSetError> {
    let studio = Studio::read(spec)?;
    prepare(folder)?;
    fill(&studio, seed, folder, progress).inspect_err(|_| {
        // What cannot be removed is reported by the next attempt.
        for part in [DEPTH, LABEL] {
            let _ = std::fs::remove_dir_all(folder.join(part));
        }
        for file in ["joints.csv", "camera.json", "set.json"] {
            let _ = std::fs::remove_file(folder.join(file));
        }
    })
}

fn write_error(path: &Path) -> impl FnOnce(std::io::Error) -> DataSetError {
    let path = path.to_owned();
    move |cause| DataSetError::Write { path, cause }
}

/// Makes the folders of a data set. Whatever is there already belongs to somebody.
fn prepare(folder: &Path) -> Result<(), DataSetError> {
    std::fs::create_dir_all(folder).map_err(write_error(folder))?;
    let mut entries = folder.read_dir().map_err(write_error(folder))?;
    if entries.next().is_some() {
        let is_there = |name: &str| folder.join(name).exists();
        return Err(DataSetError::NotEmpty {
            path: folder.to_owned(),
            holds: if is_there("set.json") {
                "already holds a data set; choose another folder, or delete this one first"
            } else if is_there(DEPTH) && is_there(LABEL) {
                "holds a data set that was never finished; delete the folder and try again"
            } else {
                "is not empty; a data set needs a folder of its own"
            },
        });
    }
    for part in [DEPTH, LABEL] {
        let part = folder.join(part);
        std::fs::create_dir(&part).map_err(write_error(&part))?;
    }
    Ok(())
}

fn fill(
    studio: &Studio,
    seed: u64,
    folder: &Path,
    progress: Progress,
) -> Result<DataSet, DataSetError> {
    let spec = studio.spec;
    let draw = |photographer: &mut Photographer, image: usize| {
        let shot = studio.shoot(image, photographer, seed)?;
        let (depth, label) = (depth_file(image), label_file(image));
        write_depth(&folder.join(&depth), &shot.photo.depth)?;
        write_labels(&folder.join(&label), &shot.photo.labels)?;
        let mut hashes = Vec::new();
        for file in [depth, label] {
            hashes.push((hash(&folder.join(&file))?, file));
        }
        progress(1);
        Ok((shot.configuration, shot.record, hashes))
    };
    let images = (0..spec.images)
        .into_par_iter()
        .map_init(|| Photographer::new(&studio.camera), draw)
        .collect::<Result<Vec<_>, DataSetError>>()?;

    let mut record = SetRecord::new(spec, seed, &studio.rig, &studio.camera);
    let mut configurations = Vec::new();
    for (configuration, image, hashes) in images {
        configurations.push(configuration);
        record.images.push(image);
        record
            .files
            .extend(hashes.into_iter().map(|(hash, file)| (file, hash)));
    }
    let joints_path = folder.join("joints.csv");
    let table = joints_csv(studio, &configurations);
    std::fs::write(&joints_path, table).map_err(write_error(&joints_path))?;
    let camera = CameraRecord::new(&studio.rig, &studio.camera, &studio.camera_from_root);
    write_json(&folder.join("camera.json"), &camera)?;
    for file in ["joints.csv", "camera.json"] {
        record
            .files
            .insert(file.to_owned(), hash(&folder.join(file))?);
    }
    // Last, since it says that all is there.
    write_json(&folder.join("set.json"), &record)?;
    DataSet::open(folder)
}

/// joints.csv: values in full precision, so that the robot can be posed again exactly.
/// Cells are empty where an image does not show the robot.
fn joints_csv(studio: &Studio, configurations: &[Option<Vec<f64>>]) -> String {
    let columns = columns(&studio.rig.robot, &studio.rig.arms[studio.target].joints);
    let mut table = "image".to_owned();
    for (name, _) in &columns {
        table.push(',');
        table.push_str(name);
    }
    table.push('\n');
    for (image, configuration) in configurations.iter().enumerate() {
        table.push_str(&image.to_string());
        for &(_, dof) in &columns {
            table.push(',');
            if let Some(configuration) = configuration {
                table.push_str(&configuration[dof].to_string());
            }
        }
        table.push('\n');
    }
    table
}

/// The header of each column and where its joint stands in a configuration: the target's pose y
/// first, then the other joints.
fn columns(robot: &Robot, target: &[usize]) -> Vec<(String, usize)> {
    let names: BTreeMap<usize, String> = robot
        .dof_joints()
        .enumerate()
        .map(|(dof, joint)| match joint.motion {
            Motion::Prismatic(_) => (dof, format!("{}_m", joint.name)),
            _ => (dof, format!("{}_rad", joint.name)),
        })
        .collect();
    let others = names.keys().filter(|dof| !target.contains(dof));
    let order = target.iter().chain(others);
    order.map(|&dof| (names[&dof].clone(), dof)).collect()
}
