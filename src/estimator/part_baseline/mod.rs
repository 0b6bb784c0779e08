//! The baseline: pose estimation by way of parts and joint positions, as in \[3\], Bohg et al., *Robot
//! Arm Pose Estimation through Pixel-Wise Part Classification*, ICRA 2014 (section IV-E).
//!
//! A part forest gives every pixel a [part](parts); the pixels of the arm cast the [votes] of their
//! leaves for the [joints]; where most votes for a joint meet, there it is. The arm is then aligned
//! with the joints by [inverse kinematics](super::inverse_kinematics).

pub mod joints;
pub mod parts;
pub mod votes;

use super::inverse_kinematics::Settings;
use super::segmentation::largest;
use crate::camera::{DepthImage, Intrinsics};
use crate::feature::{FeaturesOnImage, PaddedDepth};
use crate::forest::grow::GrowSpec;
use crate::forest::part_forest::{PartClass, PartForest};
use crate::forest::retrofit::RetrofitSpec;
use crate::forest::tree::find_leaves;
use crate::strict_toml;
use nalgebra::Point3;
use parts::{PartSpec, PartsError, read_parts};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use votes::{Ballot, FoundJoint, PixelPoint, VoteSpec};

/// All numbers of the baseline, from a file such as `data/baselines/literature.toml`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BaselineSpec {
    pub parts: Vec<PartSpec>,
    /// How trees are grown.
    pub forest: GrowSpec,
    /// How their leaves learn votes.
    pub leaves: RetrofitSpec,
    /// How an image's votes are pooled.
    pub votes: VoteSpec,
    /// How the arm is aligned with the joints that were found.
    pub alignment: Settings,
}

impl BaselineSpec {
    /// Reads a file, and the parts whose file it names, relative to itself.
    pub fn read(path: &Path) -> Result<Self, PartsError> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct BaselineFile {
            parts: PathBuf,
            forest: GrowSpec,
            leaves: RetrofitSpec,
            votes: VoteSpec,
            alignment: Settings,
        }
        let file: BaselineFile = strict_toml::read(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Ok(Self {
            parts: read_parts(&folder.join(&file.parts))?,
            forest: file.forest,
            leaves: file.leaves,
            votes: file.votes,
            alignment: file.alignment,
        })
    }
}

/// What the baseline sees in an image.
#[derive(Debug, Clone, PartialEq)]
pub struct PartEstimate {
    /// The class of each pixel.
    pub classes: Vec<u8>,
    /// For each joint of the forest where it was found; `None` when nobody voted for it.
    pub joints: Vec<Option<FoundJoint>>,
}

/// The pixels with valid depth and the points they show; of every `stride`-th row and column.
pub fn pixel_points(depth: &DepthImage, camera: &Intrinsics, stride: usize) -> Vec<PixelPoint> {
    let rows = (0..depth.height).step_by(stride);
    let places = rows.flat_map(|y| (0..depth.width).step_by(stride).map(move |x| (x, y)));
    let point = |(x, y)| {
        let pixel = y * depth.width + x;
        let mm = depth.pixels[pixel];
        (mm > 0).then(|| PixelPoint {
            pixel: pixel as u32,
            at: camera.point(x, y, mm).coords.map(|x| x as f32).into(),
        })
    };
    places.filter_map(point).collect()
}

/// Classifies pixels, and finds the joints by the votes of those that show the arm. `image` is the one
/// that `pixels` are of, with the margin that the forest's features need.
pub fn estimate(
    forest: &PartForest,
    image: &PaddedDepth,
    pixels: &[PixelPoint],
    spec: &VoteSpec,
) -> PartEstimate {
    let image = (image, &forest.features().on(image));
    let classes = classify(forest, image, pixels);
    let voters = voters(forest.classes(), pixels, &classes);
    let joints = find_joints(forest, image, &voters, spec);
    PartEstimate { classes, joints }
}

/// The class with the largest share at each pixel, of equals the first. `image` is an image and the
/// forest's features on it.
pub fn classify(
    forest: &PartForest,
    (image, features): (&PaddedDepth, &FeaturesOnImage),
    pixels: &[PixelPoint],
) -> Vec<u8> {
    let shares = forest.shares(features, &positions(image, pixels));
    let of_pixel = shares.chunks_exact(forest.classes().len());
    of_pixel.map(|shares| largest(shares) as u8).collect()
}

/// The pixels whose class votes.
pub fn voters(classes: &[PartClass], pixels: &[PixelPoint], given: &[u8]) -> Vec<PixelPoint> {
    let with_class = pixels.iter().zip(given);
    let voters = with_class.filter(|&(_, &class)| classes[usize::from(class)].votes);
    voters.map(|(&pixel, _)| pixel).collect()
}

/// Lets every voter cast the votes of its leaves, and finds each joint; joints in parallel. `image`
/// is an image and the forest's features on it.
pub fn find_joints(
    forest: &PartForest,
    (image, features): (&PaddedDepth, &FeaturesOnImage),
    voters: &[PixelPoint],
    spec: &VoteSpec,
) -> Vec<Option<FoundJoint>> {
    let positions = positions(image, voters);
    let leaves = find_leaves(forest.trees(), features, &positions);
    let find = |joint: usize| {
        let mut ballot = Ballot::new(spec);
        let of_trees = leaves.chunks_exact(positions.len().max(1));
        for (tree, leaves) in of_trees.enumerate() {
            for (voter, &leaf) in voters.iter().zip(leaves) {
                for &[x, y, z, weight] in forest.votes(tree, leaf as usize, joint) {
                    ballot.cast(voter, [x, y, z], weight);
                }
            }
        }
        ballot.joint()
    };
    let joints = 0..forest.joints().len();
    joints.into_par_iter().map(find).collect()
}

/// The same by true votes, of weight 1, for joints whose positions in the camera's frame are known:
/// what a forest without fault would make of the voters.
pub fn find_true_joints(
    truth: &[Point3<f64>],
    voters: &[PixelPoint],
    spec: &VoteSpec,
) -> Vec<Option<FoundJoint>> {
    let find = |joint: &Point3<f64>| {
        let mut ballot = Ballot::new(spec);
        for voter in voters {
            let way = |axis: usize| (joint[axis] - f64::from(voter.at[axis])) as f32;
            ballot.cast(voter, std::array::from_fn(way), 1.0);
        }
        ballot.joint()
    };
    truth.iter().map(find).collect()
}

fn positions(image: &PaddedDepth, pixels: &[PixelPoint]) -> Vec<u32> {
    let position = |point: &PixelPoint| image.position_of(point.pixel as usize);
    pixels.iter().map(position).collect()
}
