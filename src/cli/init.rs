//! `armpose init`: from a URDF to the three files that describe a user's data set.

use super::robot::package;
use super::say;
use anyhow::{Context, Result, anyhow, bail};
use armpose::camera::{Camera, Intrinsics, Lens, camera_file};
use armpose::robot::{Packages, Robot};
use armpose::scene::proposal::{Limb, Viewpoint, limbs, ranges, viewpoint};
use armpose::strict_toml;
use clap::ValueEnum;
use nalgebra::Isometry3;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Propose the files that describe a robot, its camera and a set of images, to be corrected
///
/// Example: armpose init my.urdf --camera camera_info.yaml
///
/// Writes robot.toml, camera.toml and set.toml. Which limb is the arm, where its hand begins and how far
/// its joints are drawn are guesses from the URDF; each file says what to look at. The camera is put where
/// it sees the whole arm: replace its pose by that of your own camera.
///
/// Then: armpose dataset render set.toml -o images
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// A URDF file, or a .xacro file if the program xacro is there
    robot: PathBuf,
    /// The folder for the three files
    #[arg(short, long, value_name = "FOLDER", default_value = ".")]
    out: PathBuf,
    /// The camera's intrinsics, in any of the formats that `armpose estimate` reads
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// How the camera measures depth
    #[arg(long, value_enum, default_value_t = Sensor::Kinect)]
    sensor: Sensor,
    /// Where a package is that the URDF names; may be given several times
    #[arg(long = "package", value_name = "NAME=DIR", value_parser = package)]
    packages: Vec<(String, PathBuf)>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Sensor {
    /// Structured light: Kinect, Xtion, PrimeSense
    Kinect,
    /// Active stereo: RealSense D400
    Stereo,
}

impl Sensor {
    fn preset(self) -> &'static str {
        match self {
            Sensor::Kinect => include_str!("../../data/cameras/realistic.toml"),
            Sensor::Stereo => include_str!("../../data/cameras/active-stereo.toml"),
        }
    }
}

const FILES: [&str; 3] = ["robot.toml", "camera.toml", "set.toml"];
/// Images wider than this are shrunk by a whole number: more pixels take time and tell little.
const WIDEST: usize = 848;

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let out = &arguments.out;
    if let Some(there) = FILES.iter().find(|file| out.join(file).exists()) {
        bail!(
            "{} exists already; choose another folder with -o, or remove it",
            out.join(there).display()
        );
    }
    let packages: Packages = arguments.packages.iter().cloned().collect();
    let robot = Robot::from_urdf_with(&arguments.robot, &packages)?;
    let limbs = limbs(&robot);
    let Some(arm) = limbs.first() else {
        bail!(
            "{}: no joint of the robot moves, so that there is no pose to estimate",
            arguments.robot.display()
        );
    };
    let camera = camera(arguments)?;
    let view = viewpoint(&robot, arm, &camera.intrinsics).ok_or_else(|| {
        anyhow!(
            "{}: the arm from link \"{}\" on has no body that could be seen",
            arguments.robot.display(),
            robot.links[arm.root].name
        )
    })?;
    std::fs::create_dir_all(out).with_context(|| format!("cannot write {}", out.display()))?;
    let texts = [
        robot_toml(arguments, &robot, arm, &limbs[1..], &view)?,
        camera_toml(&camera)?,
        set_toml(&robot, arm, &camera, &view),
    ];
    for (file, text) in FILES.iter().zip(&texts) {
        let path = out.join(file);
        if let Err(error) = std::fs::write(&path, text) {
            for file in FILES {
                // Whatever of it was not written need not be removed.
                let _ = std::fs::remove_file(out.join(file));
            }
            return Err(error).with_context(|| format!("cannot write {}", path.display()));
        }
    }
    for warning in &robot.warnings {
        eprintln!("armpose: warning: {warning}");
    }
    for note in &robot.notes {
        eprintln!("armpose: note: {note}");
    }
    let joints = arm.joints.len();
    say(&format!(
        "robot {}: an arm of {joints} joints from link \"{}\" to \"{}\"\n\
         wrote {}, {} and {}: look at them, and put your camera's pose into the first\n\
         then: armpose dataset render {} -o images\n",
        robot.name,
        robot.links[arm.root].name,
        robot.links[arm.tip].name,
        out.join(FILES[0]).display(),
        out.join(FILES[1]).display(),
        out.join(FILES[2]).display(),
        out.join(FILES[2]).display(),
    ))?;
    Ok(ExitCode::SUCCESS)
}

/// The camera of the images to be made: the sensor's preset, with the intrinsics of the file.
fn camera(arguments: &Arguments) -> Result<Camera> {
    let mut camera: Camera = strict_toml::parse("the camera", arguments.sensor.preset())?;
    let Some(path) = &arguments.camera else {
        return Ok(camera);
    };
    let file = camera_file::read(path).context("--camera")?;
    let sole = file.sole().with_context(|| {
        format!(
            "--camera {}: it has different cameras; make a file of one",
            path.display()
        )
    })?;
    let size = sole.size().with_context(|| {
        format!(
            "--camera {}: it does not tell width and height of the images",
            path.display()
        )
    })?;
    let Lens { intrinsics, .. } = sole
        .lens(size)
        .map_err(|e| anyhow!("--camera {}: {e}", path.display()))?;
    camera.intrinsics = shrunk(&intrinsics, intrinsics.width.div_ceil(WIDEST));
    Ok(camera)
}

/// The camera whose pixels are `by` by `by` of the other's.
fn shrunk(camera: &Intrinsics, by: usize) -> Intrinsics {
    let times = by as f64;
    // Pixel 0 reaches from -0.5 to 0.5.
    let centre = |c: f64| (c + 0.5) / times - 0.5;
    Intrinsics {
        width: camera.width / by,
        height: camera.height / by,
        fx: camera.fx / times,
        fy: camera.fy / times,
        cx: centre(camera.cx),
        cy: centre(camera.cy),
    }
}

fn robot_toml(
    arguments: &Arguments,
    robot: &Robot,
    arm: &Limb,
    others: &[Limb],
    view: &Viewpoint,
) -> Result<String> {
    let out = &arguments.out;
    let mut text = "# The robot: its arms, and where the camera is.\n".to_owned();
    text.push_str(&format!(
        "urdf = {}\n",
        quoted(&seen_from(out, &arguments.robot)?)
    ));
    if !arguments.packages.is_empty() {
        text.push_str("\n[packages]\n");
        for (name, folder) in &arguments.packages {
            text.push_str(&format!(
                "{} = {}\n",
                key(name),
                quoted(&seen_from(out, folder)?)
            ));
        }
    }
    let name = |link: usize| quoted(Path::new(&robot.links[link].name));
    text.push_str(&format!(
        "\n# Replace this by your camera's pose. This one stands {:.2} m from the middle of what the arm reaches.\n\
         # Other forms, by the camera's calibration: link_from_camera = ..., and instead of a matrix\n\
         # {{ xyz = [x, y, z], quaternion_xyzw = [x, y, z, w] }} or {{ xyz = [x, y, z], rpy = [roll, pitch, yaw] }}.\n\
         # The camera's frame is the optical one: x right, y down, z forward; metres and radians.\n\
         [camera]\nlink = {}\ncamera_from_link = [\n{}]\n",
        view.distance,
        name(robot.root()),
        rows(&view.camera_from_root)
    ));
    text.push_str(
        "\n# Errors are told by the tip's origin, too. A hand's fingers are drawn in all positions; name their\n\
         # joints here if you want them estimated.\n",
    );
    let joints: Vec<String> = (arm.joints.iter())
        .map(|&joint| quoted(Path::new(&robot.joints[joint].name)))
        .collect();
    text.push_str(&format!(
        "[[arm]]\nname = \"arm\"\nroot = {}\ntip = {}\njoints = [{}]\n",
        name(arm.root),
        name(arm.tip),
        joints.join(", ")
    ));
    for limb in others {
        text.push_str(&format!(
            "# Another limb that may be meant: root = {}, tip = {}, {} joints.\n",
            name(limb.root),
            name(limb.tip),
            limb.joints.len()
        ));
    }
    Ok(text)
}

fn camera_toml(camera: &Camera) -> Result<String> {
    let values = toml::to_string(camera).context("the camera cannot be written")?;
    Ok(format!(
        "# The camera that the images are made for: pixels, metres. Depths outside the range are invalid.\n\
         # More on the sensor: data/cameras in armpose's repository.\n\n{values}"
    ))
}

fn set_toml(robot: &Robot, arm: &Limb, camera: &Camera, view: &Viewpoint) -> String {
    let root_from_link = robot.forward_kinematics(&robot.rest());
    let lowest = robot
        .links
        .iter()
        .zip(&root_from_link)
        .filter_map(|(link, pose)| {
            let mesh = link.mesh.clone().transformed(pose);
            mesh.bounds().map(|(low, _)| f64::from(low[2]))
        });
    let lowest = lowest.fold(f64::INFINITY, f64::min);
    let camera_z = view.camera_from_root.inverse().translation.z;
    // A hundredth of a metre below the robot, in whole centimetres.
    let floor = (100.0 * lowest.min(camera_z - 0.2)).floor() / 100.0;
    let height = (camera_z - floor + 0.5).max(2.4);
    let behind = view.distance + view.reach;
    let mut text = "# The images to learn from. `armpose dataset render --help` tells of all that can be said here.\n\
         images = 500\nrobot = \"robot.toml\"\ncamera = \"camera.toml\"\ntarget = \"arm\"\n\n\
         # How surely the camera is where robot.toml says.\n\
         [camera_jitter]\ntranslation_m = 0.02\nrotation_deg = 1.0\n\n\
         # Joints are drawn between their limits, or within these ranges. The narrower, the better the\n\
         # estimates: name here what your robot really does, in rad and m.\n[poses.ranges]\n"
        .to_owned();
    let ranges = ranges(robot, arm);
    for &joint in &arm.joints {
        let joint = &robot.joints[joint];
        let name = key(&joint.name);
        let line = match ranges.get(&joint.name) {
            Some([low, high]) => format!("{name} = [{low}, {high}]  # it turns all round\n"),
            None => format!("# {name} = [{}, {}]\n", joint.limits.0, joint.limits.1),
        };
        text.push_str(&line);
    }
    text.push_str(&format!(
        "\n# The room about it: the floor's height in the robot's root frame (a table's top, if it stands on one),\n\
         # and from the camera to the wall ahead.\n\
         [room]\nfloor = {floor:.2}\nahead = [{:.1}, {:.1}]\nheight = [{height:.1}, {:.1}]\n",
        behind.max(1.8),
        behind.max(1.8) + 2.0,
        height + 0.6
    ));
    if camera.range.far_m < behind {
        text.push_str(&format!(
            "# The arm reaches up to {behind:.1} m from the camera, which measures up to {} m: put it nearer.\n",
            camera.range.far_m
        ));
    }
    text
}

/// The rows of a 4x4 matrix, to a tenth of a millimetre.
fn rows(pose: &Isometry3<f64>) -> String {
    let matrix = pose.to_homogeneous();
    let row = |row: usize| {
        // Adding zero makes -0 and 0 one number.
        let number = |column: usize| (1e4 * matrix[(row, column)]).round() / 1e4 + 0.0;
        let numbers = (0..4).map(|column| format!("{:8.4}", number(column)));
        format!("  [{}],\n", numbers.collect::<Vec<_>>().join(", "))
    };
    (0..3).map(row).collect::<String>() + "  [0, 0, 0, 1],\n"
}

/// A path of the user's as a file in `folder` names it.
fn seen_from(folder: &Path, path: &Path) -> Result<PathBuf> {
    match path.is_absolute() || folder == Path::new(".") {
        true => Ok(path.to_owned()),
        false => {
            std::path::absolute(path).with_context(|| format!("cannot find {}", path.display()))
        }
    }
}

/// A TOML key: quoted only where it must be.
fn key(name: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    match !name.is_empty() && name.chars().all(is_bare) {
        true => name.to_owned(),
        false => quoted(Path::new(name)),
    }
}

/// A TOML string.
fn quoted(text: &Path) -> String {
    toml::Value::from(text.to_string_lossy().into_owned()).to_string()
}
