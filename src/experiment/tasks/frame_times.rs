//! How long it takes to photograph a scene.

use crate::Progress;
use crate::camera::{Body, Camera, Photographer};
use crate::dataset::SetSpec;
use crate::experiment::manifest::timing_conditions;
use crate::experiment::task::{Cost, Stage, Task, read_json};
use crate::random::stream;
use crate::robot::Mesh;
use crate::scene::{PoseSampler, Rig, RobotPlace, furnish, robot_bodies, room_body};
use anyhow::Result;
use serde::{Deserialize, Serialize};
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The robot of the data sets in a furnished room, its meshes subdivided until it has more than
/// [`ROBOT_TRIANGLES`]: what the speed of a frame is measured on.
pub struct CrowdedScene {
    rig: Rig,
    pose: Vec<f64>,
    room: Mesh,
}

/// As many triangles as detailed CAD meshes of a robot have.
pub const ROBOT_TRIANGLES: usize = 50_000;

impl CrowdedScene {
    /// Reads the robot and the room from the repository `root`. Always the same scene.
    pub fn read(root: &Path) -> Result<CrowdedScene> {
        let data = root.join("data");
        let spec = SetSpec::read(&data.join("sets/pef.toml"))?;
        let mut rig = Rig::read(&spec.robot_path())?;
        for link in 0..rig.robot.links.len() {
            if triangles(&rig) < ROBOT_TRIANGLES {
                rig.robot.links[link].mesh = subdivided(&rig.robot.links[link].mesh);
            }
        }
        let mut random = stream(1, "crowded scene", &[]);
        let pose = PoseSampler::new(&rig, &spec.poses)?.sample(&rig.robot, &mut random);
        let root_from_link = rig.robot.forward_kinematics(&pose);
        let root_from_camera = rig.camera_from_root(&root_from_link).inverse();
        let (room, furniture) = (&spec.room, &spec.furniture);
        let nobody = RobotPlace::Taken(&[]);
        let room = furnish(room, furniture, &root_from_camera, nobody, &mut random).mesh;
        Ok(CrowdedScene { rig, pose, room })
    }

    /// Poses the robot.
    pub fn bodies(&self) -> Vec<Body<'_>> {
        let root_from_link = self.rig.robot.forward_kinematics(&self.pose);
        let camera_from_root = self.rig.camera_from_root(&root_from_link);
        let mut bodies = robot_bodies(&self.rig, &root_from_link, &camera_from_root);
        bodies.push(room_body(&self.room, &camera_from_root));
        bodies
    }

    /// The milliseconds of each of so many frames of the realistic camera on this thread: posing, both
    /// raster passes and the sensor.
    pub fn time(&self, root: &Path, frames: usize) -> Result<Vec<f64>> {
        let camera = Camera::read(&root.join("data/cameras/realistic.toml"))?;
        let mut photographer = Photographer::new(&camera);
        let mut noise = stream(1, "noise", &[]);
        // The first frames find no memory in the caches.
        let frames = (0..frames + WARM_UP).map(|_| {
            let clock = Instant::now();
            black_box(photographer.photograph(&self.bodies(), &mut noise));
            1e3 * clock.elapsed().as_secs_f64()
        });
        Ok(frames.skip(WARM_UP).collect())
    }
}

const WARM_UP: usize = 3;

fn triangles(rig: &Rig) -> usize {
    let links = rig.robot.links.iter();
    links.map(|link| link.mesh.triangles.len()).sum()
}

/// The same surface with every triangle cut into four at the midpoints of its edges.
fn subdivided(mesh: &Mesh) -> Mesh {
    let mut fine = Mesh::default();
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|i| mesh.vertices[i as usize]);
        let middle = |p: [f32; 3], q: [f32; 3]| [0, 1, 2].map(|i| (p[i] + q[i]) / 2.0);
        let i = fine.vertices.len() as u32;
        fine.vertices
            .extend([a, b, c, middle(a, b), middle(b, c), middle(c, a)]);
        let parts = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]];
        fine.triangles
            .extend(parts.map(|part| part.map(|corner| i + corner)));
    }
    fine.welded()
}

/// Photographs the [`CrowdedScene`] on one thread: the file `times.json`, milliseconds a frame. A
/// measured time is never the same twice; see
/// [`TrainingTimesTask`](super::training_times::TrainingTimesTask).
pub struct FrameTimesTask {
    /// The repository.
    pub root: PathBuf,
    pub frames: usize,
}

/// Milliseconds a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameTimes {
    /// Of the robot alone.
    pub triangles: usize,
    pub ms: Vec<f64>,
}

const FILE: &str = "times.json";

impl FrameTimesTask {
    /// Reads the result from the folder that [`Task::run`] wrote.
    pub fn read(folder: &Path) -> Result<FrameTimes> {
        read_json(&folder.join(FILE))
    }
}

impl Task for FrameTimesTask {
    fn stage(&self) -> Stage {
        Stage {
            name: "frame-times".to_owned(),
            version: 1,
        }
    }

    fn label(&self) -> String {
        format!("times of {} frames", self.frames)
    }

    fn parameters(&self) -> serde_json::Value {
        serde_json::json!({ "frames": self.frames, "conditions": timing_conditions() })
    }

    fn files(&self) -> Vec<PathBuf> {
        let files = ["robots/arm", "cameras/realistic.toml", "sets/pef.toml"];
        let data = self.root.join("data");
        files.map(|file| data.join(file)).into()
    }

    fn cost(&self) -> Cost {
        Cost {
            seconds: 1.0 + 0.015 * self.frames as f64,
            megabytes: 100.0,
        }
    }

    fn run(&self, _inputs: &[PathBuf], out: &Path, _progress: Progress<'_>) -> Result<()> {
        let scene = CrowdedScene::read(&self.root)?;
        let times = FrameTimes {
            triangles: triangles(&scene.rig),
            ms: scene.time(&self.root, self.frames)?,
        };
        std::fs::write(out.join(FILE), serde_json::to_vec_pretty(&times)?)?;
        Ok(())
    }
}
