//! What stands before the camera: the robot in a random pose, in a random furnished room.

mod clutter;
mod collision;
mod furniture;
pub mod inspect;
mod jitter;
mod mount;
mod oriented_box;
mod overlay;
mod pose;
pub mod proposal;
mod rig;
mod room;
mod view;

pub use collision::SelfCollision;
pub use jitter::CameraJitter;
pub use oriented_box::OrientedBox;
pub use overlay::{ESTIMATED, KNOWN, cloud, draw_arm};
pub use pose::{PoseSampler, PoseSpec};
pub use rig::{Arm, Rig};
pub use room::{Background, FurnitureSpec, RobotPlace, RoomSpec, furnish};
pub use view::{ArmView, check_view};

use crate::camera::Body;
use crate::robot::{Mesh, RobotError};
use crate::strict_toml::TomlError;
use nalgebra::Isometry3;
use std::path::PathBuf;

/// Why a robot cannot be put before a camera.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error(transparent)]
    Toml(#[from] TomlError),
    #[error(transparent)]
    Robot(#[from] RobotError),
    #[error("{path}: {message}", path = path.display())]
    Rig { path: PathBuf, message: String },
    #[error("joint \"{joint}\": {message}")]
    Pose { joint: String, message: String },
    #[error("the camera does not see arm \"{arm}\": {message}")]
    View { arm: String, message: String },
}

/// The links of a posed robot, as the camera draws them: labels as [`Rig::label`] says.
/// `root_from_link` is what forward kinematics gives, `camera_from_root` tells from where the robot
/// is seen.
pub fn robot_bodies<'a>(
    rig: &'a Rig,
    root_from_link: &[Isometry3<f64>],
    camera_from_root: &Isometry3<f64>,
) -> Vec<Body<'a>> {
    let links = rig.robot.links.iter().zip(root_from_link).enumerate();
    links
        .filter(|(_, (link, _))| !link.mesh.is_empty())
        .map(|(index, (link, root_from_link))| Body {
            mesh: &link.mesh,
            camera_from_mesh: camera_from_root * root_from_link,
            label: rig.label(index),
        })
        .collect()
}

/// The room with its furniture as the camera draws it; `mesh` comes from [`furnish`].
pub fn room_body<'a>(mesh: &'a Mesh, camera_from_root: &Isometry3<f64>) -> Body<'a> {
    Body {
        mesh,
        camera_from_mesh: *camera_from_root,
        label: 0,
    }
}
