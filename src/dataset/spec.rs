//! What a data set is: a strict TOML file such as `data/sets/pef.toml`.

use super::DataSetError;
use crate::scene::{CameraJitter, FurnitureSpec, PoseSpec, RoomSpec};
use crate::strict_toml;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The specification of a data set. The tables may be left out, and so may any key of theirs: their
/// defaults suit an arm that stands on a floor or a table and is seen from one to two metres away.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetSpec {
    /// The name of the file, without its extension. Part of the seed: sets of different name share
    /// no image, and images of one set do not depend on how many there are.
    #[serde(skip)]
    pub name: String,
    /// The file's folder, where relative paths start.
    #[serde(skip)]
    pub folder: PathBuf,
    pub images: usize,
    /// A `robot.toml`, see [`crate::scene::Rig`].
    pub robot: PathBuf,
    /// A camera preset, see [`crate::camera::Camera`].
    pub camera: PathBuf,
    /// The arm whose pose is to be estimated.
    pub target: String,
    /// The share of images that show the room without the robot, and other things in its place: by them a
    /// model learns to see that there is no arm. 0 to 1; [`SetSpec::is_without_robot`] says which.
    #[serde(default = "one_in_ten", skip_serializing_if = "is_zero")]
    pub without_robot: f64,
    /// Without it the camera stands still.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_jitter: Option<CameraJitter>,
    #[serde(default)]
    pub poses: PoseSpec,
    #[serde(default)]
    pub visibility: VisibilitySpec,
    #[serde(default)]
    pub room: RoomSpec,
    #[serde(default)]
    pub furniture: FurnitureSpec,
}

/// What every image must show, in pixels with valid depth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VisibilitySpec {
    /// Pixels of any arm.
    pub robot_pixels: usize,
    /// Pixels of the target arm.
    pub target_pixels: usize,
    /// Images whose number is a multiple of this need not show the target arm; 0: all must.
    pub exempt_every: usize,
}

impl Default for VisibilitySpec {
    fn default() -> Self {
        VisibilitySpec {
            robot_pixels: 300,
            target_pixels: 300,
            exempt_every: 0,
        }
    }
}

impl SetSpec {
    /// Reads and checks a file; its name without `.toml` becomes the name of the set.
    pub fn read(path: &Path) -> Result<Self, DataSetError> {
        let mut spec: SetSpec = strict_toml::read(path)?;
        let stem = path.file_stem().unwrap_or_default();
        spec.name = stem.to_string_lossy().into_owned();
        spec.folder = path.parent().unwrap_or(Path::new("")).to_owned();
        spec.check()?;
        Ok(spec)
    }

    /// Fails on numbers that make no sense.
    pub(super) fn check(&self) -> Result<(), DataSetError> {
        let fail = |message: String| {
            let set = self.name.clone();
            Err(DataSetError::Spec { set, message })
        };
        if !(1..=MOST_IMAGES).contains(&self.images) {
            return fail(format!(
                "images = {} must be 1 to {MOST_IMAGES}",
                self.images
            ));
        }
        if let Some(CameraJitter {
            translation_m,
            rotation_deg,
        }) = self.camera_jitter
            && !((0.0..=10.0).contains(&translation_m) && (0.0..=180.0).contains(&rotation_deg))
        {
            return fail(format!(
                "camera_jitter must have translation_m = {translation_m} within 0 to 10 and \
                 rotation_deg = {rotation_deg} within 0 to 180"
            ));
        }
        if !(0.0..=1.0).contains(&self.without_robot) {
            return fail(format!(
                "without_robot = {} must be a share of the images, 0 to 1",
                self.without_robot
            ));
        }
        let room = &self.room;
        for (key, [low, high]) in [
            ("ahead", room.ahead),
            ("aside", room.aside),
            ("behind", room.behind),
            ("height", room.height),
        ] {
            if !(0.0 < low && low <= high && high < 100.0) {
                return fail(format!(
                    "room.{key} = [{low}, {high}] must be a range of positive distances in metres"
                ));
            }
        }
        let furniture = &self.furniture;
        for (key, [fewest, most]) in [
            ("closets", furniture.closets),
            ("shelves", furniture.shelves),
            ("tables", furniture.tables),
            ("chairs", furniture.chairs),
            ("clutter", furniture.clutter),
        ] {
            if !(fewest <= most && most <= 100) {
                return fail(format!(
                    "furniture.{key} = [{fewest}, {most}] must be the fewest and the most, up to 100"
                ));
            }
        }
        Ok(())
    }

    /// Whether an image shows the room without the robot. Images come in pairs with and without it, since
    /// a model's segmentation is trained in halves, on every second image; the pairs lie evenly.
    pub fn is_without_robot(&self, image: usize) -> bool {
        let pairs = |count: usize| (count as f64 * self.without_robot).floor();
        let pair = image / 2;
        pairs(pair + 1) > pairs(pair)
    }

    /// The `robot.toml` of the set.
    pub fn robot_path(&self) -> PathBuf {
        self.folder.join(&self.robot)
    }

    /// The camera preset of the set.
    pub fn camera_path(&self) -> PathBuf {
        self.folder.join(&self.camera)
    }

    /// Whether an image with so many valid pixels of each arm may be part of the set.
    pub(super) fn admits(&self, image: usize, arm_pixels: &[usize], target: usize) -> bool {
        let visibility = &self.visibility;
        let exempt = visibility.exempt_every > 0 && image.is_multiple_of(visibility.exempt_every);
        arm_pixels.iter().sum::<usize>() >= visibility.robot_pixels
            && (exempt || arm_pixels[target] >= visibility.target_pixels)
    }
}

fn one_in_ten() -> f64 {
    0.1
}

/// Sets without such images are written as they were before there were any: their hashes stay.
fn is_zero(share: &f64) -> bool {
    *share == 0.0
}

/// File names number images with six digits.
const MOST_IMAGES: usize = 1_000_000;
