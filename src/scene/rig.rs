//! The rig: a robot, the arms whose poses are of interest, and the camera that looks at them, as a
//! `robot.toml` declares them.

use super::SceneError;
use super::mount::CameraMount;
use crate::robot::{Packages, Robot};
use crate::strict_toml;
use nalgebra::Isometry3;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// One arm: a link with all that hangs on it.
#[derive(Debug, Clone)]
pub struct Arm {
    pub name: String,
    /// Indices of its links, from the root of the arm outward.
    pub links: Vec<usize>,
    /// Where the joints of its pose y stand in a configuration, in the order of y: those of the arm
    /// and then those of the hand.
    pub joints: Vec<usize>,
    /// How many of `joints` come before the hand's.
    pub arm_joints: usize,
    /// The link whose origin is the tip, by which errors of a pose are told in millimetres.
    pub tip: usize,
}

/// A robot with its arms and its camera.
#[derive(Debug, Clone)]
pub struct Rig {
    pub robot: Robot,
    pub arms: Vec<Arm>,
    /// The link that carries the camera.
    pub camera_link: usize,
    /// The pose of that link in the camera's optical frame.
    pub camera_from_link: Isometry3<f64>,
    /// What that pose would be if a convention was mistaken for another, and for which.
    pub camera_misreadings: Vec<(String, Isometry3<f64>)>,
    /// What in the file was put right.
    pub notes: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    urdf: PathBuf,
    camera: CameraMount,
    arm: Vec<ArmFile>,
    /// The folders of packages that the URDF names, relative to this file.
    #[serde(default)]
    packages: Packages,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ArmFile {
    name: String,
    root: String,
    tip: String,
    joints: Vec<String>,
    #[serde(default)]
    hand: Vec<String>,
}

impl Rig {
    /// Reads a `robot.toml`. The paths of the URDF and of packages are relative to it.
    pub fn read(path: &Path) -> Result<Rig, SceneError> {
        Self::read_with(path, &Packages::new())
    }

    /// The same, given folders of packages, which come before those in the file.
    pub fn read_with(path: &Path, packages: &Packages) -> Result<Rig, SceneError> {
        let file: RigFile = strict_toml::read(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let in_file = file.packages.iter();
        let mut all: Packages = in_file
            .map(|(name, path)| (name.clone(), folder.join(path)))
            .collect();
        all.extend(packages.clone());
        let robot = Robot::from_urdf_with(&folder.join(&file.urdf), &all)?;
        Self::assemble(robot, file).map_err(|message| SceneError::Rig {
            path: path.to_owned(),
            message,
        })
    }

    /// Where the URDF is that a `robot.toml` names.
    pub fn urdf_of(path: &Path) -> Result<PathBuf, SceneError> {
        let file: RigFile = strict_toml::read(path)?;
        Ok(path.parent().unwrap_or(Path::new("")).join(&file.urdf))
    }

    fn assemble(robot: Robot, file: RigFile) -> Result<Rig, String> {
        if robot.links.len() > 255 {
            let links = robot.links.len();
            return Err(format!(
                "the robot has {links} links, but 8-bit labels can tell only 255 apart"
            ));
        }
        let link = |name: &str| {
            let unknown = || format!("the robot has no link \"{name}\"");
            robot.link(name).ok_or_else(unknown)
        };
        let mut arms: Vec<Arm> = Vec::new();
        for arm in file.arm {
            let links = robot.descendants(link(&arm.root)?);
            for other in &arms {
                if other.name == arm.name || other.links.iter().any(|l| links.contains(l)) {
                    let (a, b) = (&other.name, &arm.name);
                    return Err(format!(
                        "the arms \"{a}\" and \"{b}\" share their name or a link"
                    ));
                }
            }
            let tip = link(&arm.tip)?;
            if !links.contains(&tip) {
                let (arm, tip) = (&arm.name, &arm.tip);
                return Err(format!(
                    "the tip \"{tip}\" of arm \"{arm}\" does not hang on its root"
                ));
            }
            let joints = arm.joints.iter().chain(&arm.hand).map(|name| {
                let joint = robot.joints.iter().find(|j| &j.name == name);
                joint
                    .filter(|j| links.contains(&j.child))
                    .and_then(|j| j.dof)
                    .ok_or_else(|| {
                        format!("arm \"{}\" has no joint \"{name}\" that moves", arm.name)
                    })
            });
            let joints = joints.collect::<Result<Vec<_>, _>>()?;
            if let Some(twice) = (1..joints.len()).find(|&i| joints[..i].contains(&joints[i])) {
                let mut all = arm.joints.iter().chain(&arm.hand);
                let name = all.nth(twice).map_or("", String::as_str);
                return Err(format!("arm \"{}\" lists joint \"{name}\" twice", arm.name));
            }
            if joints.is_empty() {
                return Err(format!("arm \"{}\" lists no joints", arm.name));
            }
            arms.push(Arm {
                name: arm.name,
                links,
                joints,
                arm_joints: arm.joints.len(),
                tip,
            });
        }
        if arms.is_empty() {
            return Err("there must be at least one [[arm]]".to_owned());
        }
        let camera_link = link(&file.camera.link)?;
        let mounted = file.camera.read()?;
        Ok(Rig {
            robot,
            arms,
            camera_link,
            camera_from_link: mounted.camera_from_link,
            camera_misreadings: mounted.misreadings,
            notes: mounted.note.into_iter().collect(),
        })
    }

    /// A hash of all there is to know of the rig, meshes included: caches use it to see whether any
    /// of the files it was read from has changed its meaning.
    pub fn fingerprint(&self) -> String {
        let Rig {
            robot,
            arms,
            camera_link,
            camera_from_link,
            camera_misreadings: _,
            notes: _,
        } = self;
        // Notes are about the files, not about the robot.
        let Robot {
            name,
            links,
            joints,
            warnings: _,
            notes: _,
        } = robot;
        // The debug form has every field, and floats in full precision. It is that of an older `Rig`:
        // models and caches hold hashes of it.
        let text = format!(
            "Rig {{ robot: Robot {{ name: {name:?}, links: {links:?}, joints: {joints:?} }}, arms: {arms:?}, \
             camera_link: {camera_link:?}, camera_from_link: {camera_from_link:?} }}"
        );
        blake3::hash(text.as_bytes()).to_hex().to_string()
    }

    /// The index of the arm `name`.
    pub fn arm(&self, name: &str) -> Option<usize> {
        self.arms.iter().position(|arm| arm.name == name)
    }

    /// The arm that a link belongs to; `None` for torso, pillar, head and the like.
    pub fn arm_of_link(&self, link: usize) -> Option<usize> {
        self.arms.iter().position(|arm| arm.links.contains(&link))
    }

    /// What the pixels of a link are labelled with: 1 + its index for links of the arms, else 0.
    pub fn label(&self, link: usize) -> u8 {
        // At most 255 links: checked on reading.
        self.arm_of_link(link).map_or(0, |_| link as u8 + 1)
    }

    /// `camera_from_root`, given the poses of all links.
    pub fn camera_from_root(&self, root_from_link: &[Isometry3<f64>]) -> Isometry3<f64> {
        self.camera_from_link * root_from_link[self.camera_link].inverse()
    }
}
