//! Draws the images of a data set and writes them.

use super::record::{CameraRecord, ImageRecord, SetRecord, hash, rows, write_json};
use super::{DEPTH, DataSet, DataSetError, LABEL, SetSpec, depth_file, label_file};
use crate::Progress;
use crate::camera::png::{write_depth, write_labels};
use crate::camera::{Camera, Photo, Photographer};
use crate::random::{Stream, stream};
use crate::robot::{Motion, Robot};
use crate::scene::{
    OrientedBox, PoseSampler, Rig, SelfCollision, check_view, furnish, robot_bodies, room_body,
};
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// So many frames are drawn for an image before its specification is given up.
const TRIES: usize = 2_000;

/// Draws a data set into `folder`, which must be empty or not exist yet, and is empty again when that
/// fails. Images are independent of each other: the same whatever their number and the number of
/// threads. `progress` counts images.
pub fn generate(
    spec: &SetSpec,
    seed: u64,
    folder: &Path,
    progress: Progress,
) -> Result<DataSet, DataSetError> {
    let studio = Studio::new(spec)?;
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
    move |source| DataSetError::Write { path, source }
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
        let streams = Streams::new(seed, &spec.name, image);
        let shot = studio.shoot(image, photographer, streams)?;
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

/// Everything that stays the same from frame to frame.
struct Studio<'a> {
    spec: &'a SetSpec,
    rig: Rig,
    camera: Camera,
    /// Index of the target arm.
    target: usize,
    poses: PoseSampler,
    collision: SelfCollision,
    /// The nominal one.
    camera_from_root: Isometry3<f64>,
}

/// What an image is drawn from. The jitter has a stream of its own, so that poses do not depend on it.
struct Streams {
    frames: Stream,
    jitter: Stream,
}

impl Streams {
    fn new(seed: u64, set: &str, image: usize) -> Self {
        let of = |what: &str| stream(seed, &format!("{what} of {set}"), &[image as u64]);
        Streams {
            frames: of("frames"),
            jitter: of("camera jitter"),
        }
    }
}

struct Shot {
    configuration: Vec<f64>,
    photo: Photo,
    record: ImageRecord,
}

impl<'a> Studio<'a> {
    fn new(spec: &'a SetSpec) -> Result<Self, DataSetError> {
        spec.check()?;
        let rig = Rig::read(&spec.robot_path())?;
        let camera = Camera::read(&spec.camera_path())?;
        let target = rig.arm(&spec.target).ok_or_else(|| DataSetError::Spec {
            set: spec.name.clone(),
            message: format!("the robot has no arm \"{}\" to be the target", spec.target),
        })?;
        let poses = PoseSampler::new(&rig, &spec.poses)?;
        let sample = |stream: &mut Stream| poses.sample(&rig.robot, stream);
        let some: Vec<Vec<f64>> = (0..64)
            .map(|i| sample(&mut stream(0, "view", &[i])))
            .collect();
        check_view(&rig, target, &camera.intrinsics, &some)?;
        let collision = SelfCollision::new(&rig.robot, sample);
        // The camera stands still, so that any configuration tells where.
        let any = sample(&mut stream(0, "camera", &[]));
        let camera_from_root = rig.camera_from_root(&rig.robot.forward_kinematics(&any));
        let height = camera_from_root.inverse().translation.z - spec.room.floor;
        if !(height > 0.0 && height < spec.room.height[0]) {
            return Err(DataSetError::Spec {
                set: spec.name.clone(),
                message: format!(
                    "the camera stands {height:.2} m above room.floor, which is not between floor and \
                     ceiling; room.floor is a height in the robot's root frame, room.height the least \
                     and greatest height of the ceiling above it"
                ),
            });
        }
        Ok(Studio {
            spec,
            rig,
            camera,
            target,
            poses,
            collision,
            camera_from_root,
        })
    }

    /// Draws frames until one is free of collision and shows what the specification demands.
    fn shoot(
        &self,
        image: usize,
        photographer: &mut Photographer,
        mut streams: Streams,
    ) -> Result<Shot, DataSetError> {
        let Streams { frames, jitter } = &mut streams;
        let admits = |pixels: &[usize]| self.spec.admits(image, pixels, self.target);
        let mut record = ImageRecord::default();
        for _ in 0..TRIES {
            let camera_from_root = match &self.spec.camera_jitter {
                Some(spec) => spec.sample(jitter) * self.camera_from_root,
                None => self.camera_from_root,
            };
            let root_from_camera = camera_from_root.inverse();
            let configuration = self.poses.sample(&self.rig.robot, frames);
            let root_from_link = self.rig.robot.forward_kinematics(&configuration);
            let boxes = self.collision.boxes(&root_from_link);
            let camera = Point3::from(root_from_camera.translation.vector);
            if self.collision.first(&root_from_link, &boxes).is_some()
                || self.is_near(&camera, &boxes)
                || self.is_below_floor(&boxes)
            {
                record.collided += 1;
                continue;
            }
            // Most poses are out of view: the exact drawing of the robot alone tells it cheaply.
            let mut bodies = robot_bodies(&self.rig, &root_from_link, &camera_from_root);
            let alone = photographer.draw(&bodies);
            let in_range = |&z: &f32| {
                (self.camera.range.near_m..=self.camera.range.far_m).contains(&f64::from(z))
            };
            let visible = alone.depth.pixels.iter().map(in_range);
            if !admits(&self.arm_pixels(visible, &alone.labels.pixels)) {
                record.hidden += 1;
                continue;
            }
            let (room, furniture) = (&self.spec.room, &self.spec.furniture);
            let background = furnish(room, furniture, &root_from_camera, &boxes, frames);
            bodies.push(room_body(&background, &camera_from_root));
            let photo = photographer.photograph(&bodies, frames);
            let valid = photo.depth.pixels.iter().map(|&mm| mm > 0);
            record.valid = valid.clone().filter(|&v| v).count();
            record.arms = self.arm_pixels(valid, &photo.labels.pixels);
            if admits(&record.arms) {
                record.camera_from_root = (self.spec.camera_jitter.as_ref())
                    .map(|_| rows(&camera_from_root.to_homogeneous()));
                return Ok(Shot {
                    configuration,
                    photo,
                    record,
                });
            }
            record.hidden += 1;
        }
        Err(DataSetError::NoFrame {
            set: self.spec.name.clone(),
            image,
            tries: TRIES,
            collided: record.collided,
        })
    }

    /// Whether an arm comes nearer to the camera than the specification allows.
    fn is_near(&self, camera: &Point3<f64>, boxes: &[Vec<OrientedBox>]) -> bool {
        let clearance = self.spec.poses.camera_clearance;
        let arms = self.rig.arms.iter().flat_map(|arm| &arm.links);
        arms.flat_map(|&link| &boxes[link])
            .any(|part| part.distance(camera) < clearance)
    }

    /// Whether an arm reaches through the floor. Its root link may: that is what it is mounted by.
    fn is_below_floor(&self, boxes: &[Vec<OrientedBox>]) -> bool {
        let links = self.rig.arms.iter().flat_map(|arm| &arm.links[1..]);
        let corners = links
            .flat_map(|&link| &boxes[link])
            .flat_map(|part| part.corners());
        corners
            .into_iter()
            .any(|corner| corner.z < self.spec.room.floor)
    }

    /// How many of the valid pixels show each arm.
    fn arm_pixels(&self, valid: impl Iterator<Item = bool>, labels: &[u8]) -> Vec<usize> {
        let mut by_label = [0; 256];
        for (valid, &label) in valid.zip(labels) {
            by_label[usize::from(label)] += usize::from(valid);
        }
        let pixels = |arm: &crate::scene::Arm| {
            arm.links
                .iter()
                .map(|&link| by_label[usize::from(self.rig.label(link))])
                .sum()
        };
        self.rig.arms.iter().map(pixels).collect()
    }
}

/// joints.csv: values in full precision, so that the robot can be posed again exactly.
fn joints_csv(studio: &Studio, configurations: &[Vec<f64>]) -> String {
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
            table.push_str(&format!(",{}", configuration[dof]));
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
