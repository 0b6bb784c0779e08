//! armpose estimates the joint angles of a robot arm from one depth image, by pixel-wise regression
//! with a random forest, and reproduces every study of Widmaier, Kappler, Schaal and Bohg, *Robot
//! Arm Pose Estimation by Pixel-wise Regression of Joint Angles*, ICRA 2016.
//!
//! The modules follow the way data flows: [`robot`] description -> posed [`scene`] -> depth image
//! of a simulated [`camera`] -> [`dataset`] on disk -> [`feature`] samples -> [`forest`], by
//! [`training`] -> [`estimator`] -> [`experiment`]. A [`model`] is what robots use of it.
//!
//! Conventions everywhere: metres, radians and seconds in memory; depth images hold millimetres as
//! `u16` with 0 = invalid; camera frames are optical frames (x right, y down, z forward);
//! `a_from_b` is the transform that takes coordinates in frame b to frame a.

pub mod camera;
pub mod circular;
pub mod dataset;
pub mod distances;
pub mod estimator;
pub mod experiment;
pub mod feature;
pub mod forest;
pub mod mean_shift;
pub mod model;
pub mod pose_space;
pub mod random;
pub mod robot;
pub mod scene;
pub mod strict_toml;
pub mod training;

/// Told how many units of work have been finished since the last call. Called from any thread.
pub type Progress<'a> = &'a (dyn Fn(u64) + Sync);
