//! `armpose estimate`: joint angles from depth images.

use super::overlay::{Overlays, rig_of};
use super::{say, use_threads};
use anyhow::{Context, Result, anyhow, bail, ensure};
use armpose::camera::camera_file::{self, CameraFile};
use armpose::camera::depth_file::{Units, check_range, endings, extension, read_depth_file};
use armpose::camera::{DepthImage, Lens, Resampling};
use armpose::model::{Estimate, Model};
use serde_json::json;
use std::io::BufRead;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Estimate the joints of an arm in depth images, each by itself
///
/// Example: armpose estimate --model my_model frame.png --overlay pictures
///
/// An IMAGE is a depth image by the ending of its name, in small or capital letters:
///
///     .png         16-bit grey
///     .npy, .npz   NumPy's array of 16- or 32-bit integers or floats, (rows, columns); of several in an
///                  .npz the one called depth
///     .tif, .tiff  one channel of 16- or 32-bit integers or floats
///     .exr         OpenEXR: the channel Z, depth, V, Y or R, or the only one
///     .pgm, .pfm   16-bit grey; floats
///
/// Integers count millimetres and floats metres, unless --depth-scale says otherwise. Zero, what is
/// negative or not finite, and 65535 of 16 bits are invalid pixels. An image whose values cannot be depths
/// in their unit, or without a valid pixel, is an error. A folder stands for all such files in it, and -
/// for file names on stdin, one a line, each of which is answered before the next is read:
///
///     find . -name 'depth*.png' | armpose estimate --model my_model --json -
///
/// With --json each image is answered by one line of JSON:
///
///     image        the file's name
///     arm_visible  whether the arm is seen; null for models without segmentation. The least number of
///                  pixels for it is 600 of 640 x 480 and in proportion for others.
///     presence     the share of trees that say that the robot is there at all, 0 to 1; the arm is visible
///                  only if it is large enough. null for models trained on images of the robot only.
///     joints       for each joint its value, its name ending with the unit, _rad or _m; null when the
///                  arm is not visible
///     spread       for each joint how far the pixels' estimates are apart, in the same unit: their
///                  disagreement, and not a bound on the error
///     confidence   the mean confidence of the pixels, 0 to 1: compares images of one model. What
///                  spread and confidence are worth, `armpose evaluate` tells.
///     pixels       how many of the most confident pixels were averaged
///     arm_pixels   how many pixels surely show the arm
///     latency_ms   from the image in memory to the joints
///     error        in place of all others but image: why it could not be estimated
///
/// The exit code is 2 when an image could not be read; the others are estimated all the same.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Depth images, folders of them, or - for names on stdin
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// The model, as `armpose train` wrote it
    #[arg(long, value_name = "FOLDER")]
    model: PathBuf,
    /// The camera of the images, if it is not the model's. JSON with width, height, fx, fy, cx and cy in
    /// pixels, such as the camera.json of a data set; a ROS CameraInfo or camera_calibration, OpenCV's YAML,
    /// or the JSON of librealsense, Open3D and BOP (camera.json, scene_camera.json). Lens distortion is
    /// taken out, but for that of a fisheye. It must see nearly all that the model's does.
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Metres that one unit of a depth stands for [default: 1 for floats; for integers what a BOP file
    /// says, or else 0.001]
    #[arg(long, value_name = "METRES")]
    depth_scale: Option<f64>,
    /// Answer in JSON, one line an image
    #[arg(long)]
    json: bool,
    /// Draw the estimated arm over each image, into this folder
    #[arg(long, value_name = "FOLDER")]
    overlay: Option<PathBuf>,
    /// The robot.toml, if it is not where it was when the model was trained; only pictures need it
    #[arg(long, value_name = "FILE")]
    robot: Option<PathBuf>,
    /// Look only at the pixels of every N-th row and column: 2 takes a third of the time
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=64))]
    stride: u16,
    /// Threads to use; the estimates do not depend on it [default: one for each core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    use_threads(arguments.threads.map(usize::from))?;
    if let Some(scale) = arguments.depth_scale {
        ensure!(
            scale > 0.0 && scale.is_finite(),
            "--depth-scale {scale}: choose a positive number of metres"
        );
    }
    let model = Model::load(&arguments.model)?;
    let mut reader = Reader::new(&model, arguments)?;
    let rig = match arguments.overlay {
        Some(_) => Some(rig_of(model.record(), arguments.robot.as_deref())?),
        None => None,
    };
    let mut overlays = match (&arguments.overlay, &rig) {
        (Some(folder), Some(rig)) => Some(Overlays::new(folder, &model, rig)?),
        _ => None,
    };
    // A camera is mounted once: a few images tell how.
    let mut to_turn = 3;
    let mut estimate = |path: &Path| {
        let (image, resampling) = reader.read(path)?;
        let seen = look(&model, resampling, &image, arguments.stride.into());
        if seen.estimate.pose.is_none() || to_turn > 0 {
            to_turn -= 1.min(to_turn);
            if let Some(turn) =
                model.seen_better(&seen.image, &seen.estimate, arguments.stride.into())
            {
                eprintln!(
                    "armpose: warning: {}: the arm shows better in the image {}; are the images those of \
                     the camera in robot.toml?",
                    path.display(),
                    turn
                );
            }
        }
        if let Some(overlays) = &mut overlays {
            let pose = seen.estimate.pose.as_ref();
            overlays.draw_estimate(path, &seen.image, pose)?;
        }
        anyhow::Ok(seen)
    };
    let mut all_well = true;
    let mut answer = |path: &Path| {
        let result = estimate(path);
        all_well &= result.is_ok();
        match (result, arguments.json) {
            (Ok(seen), true) => say(&format!("{}\n", to_json(&model, path, &seen))),
            (Ok(seen), false) => say(&to_text(&model, path, &seen)),
            (Err(error), true) => {
                let error = format!("{error:#}");
                let line = json!({ "image": path.to_string_lossy(), "error": error });
                say(&format!("{line}\n"))
            }
            (Err(error), false) => {
                eprintln!("armpose: {error:#}");
                Ok(())
            }
        }
    };
    for path in &arguments.images {
        if path == Path::new("-") {
            for line in std::io::stdin().lock().lines() {
                let line = line.context("cannot read file names from stdin")?;
                if !line.is_empty() {
                    answer(Path::new(&line))?;
                }
            }
        } else if path.is_dir() {
            for path in images_in(path)? {
                answer(&path)?;
            }
        } else {
            answer(path)?;
        }
    }
    Ok(ExitCode::from(if all_well { 0 } else { 2 }))
}

/// Reads images with their camera.
struct Reader<'a> {
    model: &'a Model,
    file: Option<CameraFile>,
    depth_scale: Option<f64>,
    /// The camera of the last image, and how the model sees through it.
    last: Option<(Lens, Resampling)>,
}

impl<'a> Reader<'a> {
    fn new(model: &'a Model, arguments: &Arguments) -> Result<Reader<'a>> {
        let file = match &arguments.camera {
            Some(path) => Some(camera_file::read(path).context("--camera")?),
            None => None,
        };
        let mut reader = Reader {
            model,
            file,
            depth_scale: arguments.depth_scale,
            last: None,
        };
        // What is wrong with the camera of all images is said once.
        let sole = reader.file.as_ref().and_then(CameraFile::sole);
        if let Some(size) = sole.and_then(|camera| camera.size()) {
            reader.through(Path::new(""), size)?;
        }
        Ok(reader)
    }

    /// The camera of an image of this size.
    fn lens(&self, path: &Path, size: [usize; 2]) -> Result<Lens> {
        match &self.file {
            None => Ok((&self.model.record().intrinsics).into()),
            Some(file) => {
                let camera = file.of(path).context("--camera")?;
                camera.lens(size).map_err(|e| anyhow!("--camera: {e}"))
            }
        }
    }

    /// How the model sees through the camera of an image of this size.
    fn through(&mut self, path: &Path, size: [usize; 2]) -> Result<&Resampling> {
        let lens = self.lens(path, size)?;
        let resampling = match self.last.take() {
            Some((last, resampling)) if last == lens => resampling,
            _ => self.model.view_of(lens)?,
        };
        Ok(&self.last.insert((lens, resampling)).1)
    }

    /// The image, of depths that the model knows.
    fn read(&mut self, path: &Path) -> Result<(DepthImage, &Resampling)> {
        let usual = Units::default();
        let (size, unit) = match &self.file {
            None => {
                let camera = self.model.record().intrinsics;
                (Some([camera.width, camera.height]), None)
            }
            Some(file) => {
                let camera = file.of(path).context("--camera")?;
                (camera.size(), camera.unit_m())
            }
        };
        let units = Units {
            integer_m: self.depth_scale.or(unit).unwrap_or(usual.integer_m),
            float_m: self.depth_scale.unwrap_or(usual.float_m),
        };
        let image = read_depth_file(path, size, units)?;
        check_range(&image, &self.model.record().range)
            .map_err(|e| anyhow!("{}: {e}", path.display()))?;
        (self.model.check_depths(&image)).map_err(|e| anyhow!("{}: {e}", path.display()))?;
        let resampling = self.through(path, [image.width, image.height])?;
        Ok((image, resampling))
    }
}

/// An image in the model's view, and what the model says of it.
struct Seen {
    image: DepthImage,
    estimate: Estimate,
    latency_ms: f64,
}

fn look(model: &Model, resampling: &Resampling, image: &DepthImage, stride: usize) -> Seen {
    let clock = Instant::now();
    let image = resampling.apply(image);
    let estimate = model.estimate(&image, stride);
    Seen {
        image,
        estimate,
        latency_ms: 1e3 * clock.elapsed().as_secs_f64(),
    }
}

/// The depth images in a folder, by name.
fn images_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let cannot_read = || format!("cannot read {}", folder.display());
    let mut images = Vec::new();
    for entry in folder.read_dir().with_context(cannot_read)? {
        let path = entry.with_context(cannot_read)?.path();
        if extension(&path).is_some() {
            images.push(path);
        }
    }
    if images.is_empty() {
        bail!("{} holds no depth images ({})", folder.display(), endings());
    }
    images.sort();
    Ok(images)
}

fn to_json(model: &Model, path: &Path, seen: &Seen) -> serde_json::Value {
    let Estimate {
        presence,
        sure_pixels,
        pose,
    } = &seen.estimate;
    let by_joint = |values: &[f64]| {
        let joints = model.record().joints.iter().zip(values);
        let members = joints.map(|(joint, &value)| (joint.column(), json!(value)));
        serde_json::Value::Object(members.collect())
    };
    json!({
        "image": path.to_string_lossy(),
        "arm_visible": sure_pixels.map(|_| pose.is_some()),
        "presence": presence,
        "joints": pose.as_ref().map(|pose| by_joint(&pose.values)),
        "spread": pose.as_ref().map(|pose| by_joint(&pose.spread)),
        "confidence": pose.as_ref().map(|pose| pose.confidence),
        "pixels": pose.as_ref().map(|pose| pose.pixels),
        "arm_pixels": sure_pixels,
        "latency_ms": seen.latency_ms,
    })
}

fn to_text(model: &Model, path: &Path, seen: &Seen) -> String {
    let record = model.record();
    let Estimate {
        sure_pixels, pose, ..
    } = &seen.estimate;
    let sees = match sure_pixels {
        Some(n) => format!("{n} pixels surely show the arm"),
        None => "not segmented".to_owned(),
    };
    let mut text = format!("{}: {sees}, {:.0} ms\n", path.display(), seen.latency_ms);
    let Some(pose) = pose else {
        let least = record.least_arm_pixels;
        let why = match (seen.estimate.presence, record.least_presence) {
            (Some(share), Some(needed)) if share < needed => format!(
                "{:.0} % of the trees see a robot, and it takes {:.0} %",
                100.0 * share,
                100.0 * needed
            ),
            _ => format!("that takes {least} pixels"),
        };
        text.push_str(&format!("  the arm is not visible: {why}\n"));
        return text;
    };
    let width = record
        .joints
        .iter()
        .map(|j| j.name.len())
        .max()
        .unwrap_or(0);
    for ((joint, value), spread) in record.joints.iter().zip(&pose.values).zip(&pose.spread) {
        let unit = joint.unit.name();
        text.push_str(&format!(
            "  {:width$}  {value:>8.4} {unit}, spread {spread:.4}\n",
            joint.name
        ));
    }
    text
}
