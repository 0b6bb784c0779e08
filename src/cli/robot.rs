//! `armpose robot`: what a robot's description says.

use super::say;
use anyhow::Result;
use armpose::dataset::portrait;
use armpose::experiment::table::{Cell, Table};
use armpose::robot::{Joint, Motion, Packages, Robot};
use armpose::scene::proposal::limbs;
use armpose::scene::{Rig, inspect};
use clap::Subcommand;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Look at a robot before images are made of it
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Inspect(Inspect),
}

/// Read a robot and show its joints, its links, and what may surprise
///
/// Example: armpose robot inspect my.urdf --picture my_robot.png
///
/// ROBOT is a URDF file, a xacro file if the program xacro is installed, or the TOML file of a robot
/// with its arms and its camera (`armpose dataset render --help` has an example).
///
/// Links have visual shapes or, where those are missing or cannot be read, collision shapes: boxes,
/// cylinders, spheres, capsules, or meshes in STL, OBJ or COLLADA (.dae). STL and OBJ are in metres
/// unless the URDF gives a scale; of COLLADA the file's unit counts, but not its up axis, as in RViz
/// and Gazebo. Joints may be revolute, continuous, prismatic or fixed, and may mimic others; those of
/// other types are held at 0.
///
/// A mesh's file name starts at the URDF's folder. package://NAME/REST is REST in the folder given by
/// --package (or by `[packages]` in a robot.toml), or else in the package NAME that is found by
/// ROS_PACKAGE_PATH, by AMENT_PREFIX_PATH, or in the folders above the URDF and beside those, where
/// a package.xml or the folder's name says which package it is.
///
/// The picture shows the robot with all joints at 0 (or at the limit next to it), from its front (x),
/// right (-y) and above. Each link has another colour than the next.
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
struct Inspect {
    /// A URDF or xacro file, or a robot.toml that names one
    robot: PathBuf,
    /// Draw the robot into this PNG file
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// The folder of a package that the URDF names; may be given several times
    #[arg(long = "package", value_name = "NAME=DIR", value_parser = package)]
    packages: Vec<(String, PathBuf)>,
    /// Print JSON: joints, and links with their poses where all joints are at 0, metres and radians
    #[arg(long)]
    json: bool,
}

/// Reads `NAME=DIR`.
pub fn package(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, folder)) if !name.is_empty() && Path::new(folder).is_dir() => {
            Ok((name.to_owned(), folder.into()))
        }
        Some((_, folder)) => Err(format!("there is no folder \"{folder}\"")),
        None => {
            Err("it should be NAME=DIR, as in my_robot_description=/home/me/my_robot".to_owned())
        }
    }
}

pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.command {
        Command::Inspect(arguments) => inspect_robot(arguments),
    }
}

fn inspect_robot(arguments: &Inspect) -> Result<ExitCode> {
    let path = &arguments.robot;
    let packages: Packages = arguments.packages.iter().cloned().collect();
    let is_rig = path
        .extension()
        .is_some_and(|extension| extension == "toml");
    let (robot, arms) = if is_rig {
        let rig = Rig::read_with(path, &packages)?;
        let arms = arms(&rig);
        (rig.robot, arms)
    } else {
        let robot = Robot::from_urdf_with(path, &packages)?;
        let guess = guess(&robot);
        (robot, guess)
    };
    let text = match arguments.json {
        true => format!("{:#}\n", inspect::as_json(&robot)),
        false => as_text(&robot, &arms),
    };
    if let Some(picture) = &arguments.picture {
        portrait(&robot, &robot.rest(), picture)?;
    }
    say(&text)?;
    if let (Some(picture), false) = (&arguments.picture, arguments.json) {
        say(&format!("picture: {}\n", picture.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn as_text(robot: &Robot, arms: &str) -> String {
    let mut text = String::new();
    for warning in &robot.warnings {
        text.push_str(&format!("warning: {warning}\n"));
    }
    let triangles = robot.links.iter().map(|link| link.mesh.triangles.len());
    text.push_str(&format!(
        "robot {}: {} links, {} joints, of which {} move; {} triangles\n",
        robot.name,
        robot.links.len(),
        robot.joints.len(),
        robot.dofs(),
        triangles.sum::<usize>()
    ));
    if !robot.joints.is_empty() {
        text.push_str(&format!("\n{}", joints(robot).to_text()));
    }
    text.push_str(&format!("\n{}{arms}\n", links(robot).to_text()));
    let remarks = inspect::remarks(robot);
    if robot.notes.is_empty() && remarks.is_empty() && robot.warnings.is_empty() {
        text.push_str("nothing to remark\n");
    }
    for note in robot.notes.iter().chain(&remarks) {
        text.push_str(&format!("note: {note}\n"));
    }
    text
}

/// In the order of the tree, limits as in the URDF, and in degrees for those who think in them.
fn joints(robot: &Robot) -> Table {
    let columns = [
        "joint", "type", "parent", "child", "lower", "upper", "unit", "degrees", "follows",
    ];
    let mut table = Table::new(columns);
    let name = |link: usize| robot.links[link].name.as_str().into();
    for joint in &robot.joints {
        let (kind, unit) = match joint.motion {
            Motion::Fixed => ("fixed", ""),
            Motion::Prismatic(_) => ("prismatic", "m"),
            Motion::Revolute(_) => ("revolute", "rad"),
        };
        let (low, high) = joint.limits;
        let limit = |x: f64| match joint.motion {
            Motion::Fixed => Cell::Empty,
            _ => Cell::Number(x),
        };
        let degrees = match joint.motion {
            Motion::Revolute(_) => {
                format!("{:.0} to {:.0}", low.to_degrees(), high.to_degrees())
            }
            _ => String::new(),
        };
        table.push([
            joint.name.as_str().into(),
            kind.into(),
            name(joint.parent),
            name(joint.child),
            limit(low),
            limit(high),
            unit.into(),
            degrees.into(),
            follows(robot, joint).into(),
        ]);
    }
    table
}

fn follows(robot: &Robot, joint: &Joint) -> String {
    let leader = |dof| robot.joints.iter().find(|j| j.dof == Some(dof));
    let described = joint.mimic.and_then(|mimic| {
        let leader = &leader(mimic.leader)?.name;
        let (multiplier, offset) = (mimic.multiplier, mimic.offset);
        Some(match (multiplier == 1.0, offset == 0.0) {
            (true, true) => leader.clone(),
            (false, true) => format!("{multiplier:.4} {leader}"),
            _ => format!("{multiplier:.4} {leader} {offset:+.4}"),
        })
    });
    described.unwrap_or_default()
}

/// In the order of the URDF, which is that of the labels in images.
fn links(robot: &Robot) -> Table {
    let mut table = Table::new(["link", "depth", "triangles", "size_m"]);
    let mut depths = vec![0usize; robot.links.len()];
    for joint in &robot.joints {
        depths[joint.child] = depths[joint.parent] + 1;
    }
    for (link, depth) in robot.links.iter().zip(depths) {
        let size = match link.mesh.bounds() {
            None => "no body".to_owned(),
            Some((low, high)) => {
                let [x, y, z]: [f32; 3] = std::array::from_fn(|i| high[i] - low[i]);
                format!("{x:.3} x {y:.3} x {z:.3}")
            }
        };
        let triangles = link.mesh.triangles.len();
        table.push([
            link.name.as_str().into(),
            depth.into(),
            triangles.into(),
            size.into(),
        ]);
    }
    table
}

/// The limb that is most likely the arm.
fn guess(robot: &Robot) -> String {
    let limbs = limbs(robot);
    let Some(arm) = limbs.first() else {
        return String::new();
    };
    let joints: Vec<&str> = (arm.joints.iter())
        .map(|&joint| robot.joints[joint].name.as_str())
        .collect();
    format!(
        "\nprobably the arm: from link {} to {}; armpose init writes it down\n  pose: {}\n",
        robot.links[arm.root].name,
        robot.links[arm.tip].name,
        joints.join(", ")
    )
}

fn arms(rig: &Rig) -> String {
    let mut text = String::new();
    for arm in &rig.arms {
        let joint = |&dof: &usize| rig.robot.dof_joints().nth(dof).map(|j| j.name.as_str());
        let joints: Vec<&str> = arm.joints.iter().filter_map(joint).collect();
        text.push_str(&format!(
            "\narm {}: {} links from {}, tip {}\n  pose: {}\n",
            arm.name,
            arm.links.len(),
            rig.robot.links[arm.links[0]].name,
            rig.robot.links[arm.tip].name,
            joints.join(", ")
        ));
    }
    text
}
