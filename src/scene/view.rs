//! Whether the camera sees an arm at all, before images are drawn in vain.

use super::{Rig, SceneError};
use crate::camera::Intrinsics;
use nalgebra::{Isometry3, Point3, Vector3};

/// How much of an arm is where the camera looks, over some configurations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmView {
    /// The share of the arm's vertices before the camera, and of those inside its image.
    pub in_front: f64,
    pub inside: f64,
    /// The mean of the vertices in the camera's optical frame, m.
    pub middle: Point3<f64>,
}

/// An arm of which less is inside the image is not in view.
const LEAST_INSIDE: f64 = 1e-3;
/// A convention is advised if it puts so much of the arm inside the image.
const ADVISED_INSIDE: f64 = 0.2;
/// So many vertices of each link are looked at.
const VERTICES: usize = 500;

impl ArmView {
    /// Of arm `arm` of the rig, seen by a camera whose pose in its link's frame is `camera_from_link`.
    /// What hides the arm does not count.
    pub fn new(
        (rig, arm): (&Rig, usize),
        camera_from_link: &Isometry3<f64>,
        camera: &Intrinsics,
        configurations: &[Vec<f64>],
    ) -> ArmView {
        let (mut all, mut in_front, mut inside) = (0.0, 0.0, 0.0);
        let mut sum = Vector3::zeros();
        for configuration in configurations {
            let root_from_link = rig.robot.forward_kinematics(configuration);
            let camera_from_root = camera_from_link * root_from_link[rig.camera_link].inverse();
            for &link in &rig.arms[arm].links {
                let camera_from_mesh = camera_from_root * root_from_link[link];
                let vertices = &rig.robot.links[link].mesh.vertices;
                for vertex in vertices.iter().step_by(vertices.len() / VERTICES + 1) {
                    let at = camera_from_mesh * Point3::from(vertex.map(f64::from));
                    let (column, row) = (
                        at.x / at.z * camera.fx + camera.cx,
                        at.y / at.z * camera.fy + camera.cy,
                    );
                    let within = |at: f64, side: usize| (-0.5..side as f64 - 0.5).contains(&at);
                    let seen = within(column, camera.width) && within(row, camera.height);
                    all += 1.0;
                    sum += at.coords;
                    in_front += f64::from(at.z > 0.0);
                    inside += f64::from(at.z > 0.0 && seen);
                }
            }
        }
        ArmView {
            in_front: in_front / all,
            inside: inside / all,
            middle: (sum / all).into(),
        }
    }
}

/// Fails when arm `arm` is hardly ever in the camera's image; says where it is instead, and which reading of
/// the camera's pose would put it there.
pub fn check_view(
    rig: &Rig,
    arm: usize,
    camera: &Intrinsics,
    configurations: &[Vec<f64>],
) -> Result<(), SceneError> {
    let of = |pose: &Isometry3<f64>| ArmView::new((rig, arm), pose, camera, configurations);
    let view = of(&rig.camera_from_link);
    // Without any vertex there is nothing to be said.
    if view.inside.is_nan() || view.inside >= LEAST_INSIDE {
        return Ok(());
    }
    let Point3 { coords: middle } = view.middle;
    let place = match middle.z < 0.0 {
        true => format!("{:.2} m behind the camera", -middle.z),
        false => format!("{:.2} m before the camera but beside its image", middle.z),
    };
    let better = (rig.camera_misreadings.iter())
        .map(|(reading, pose)| (of(pose).inside, reading))
        .filter(|(inside, _)| *inside >= ADVISED_INSIDE)
        .max_by(|(a, _), (b, _)| a.total_cmp(b));
    let advice = match better {
        Some((_, reading)) => format!("{reading}, it would be in view"),
        None => {
            "check [camera] in robot.toml: in the camera's frame, x is right, y down, z forward"
                .to_owned()
        }
    };
    Err(SceneError::View {
        arm: rig.arms[arm].name.clone(),
        message: format!(
            "it lies {place}, about x {:.2}, y {:.2}, z {:.2} m in the camera's frame; {advice}",
            middle.x, middle.y, middle.z
        ),
    })
}
