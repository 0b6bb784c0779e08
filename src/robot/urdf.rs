//! Reading a robot from a URDF file and the mesh files that it names.

use super::bodies::Bodies;
use super::packages::{Finder, Packages};
use super::xml::{child, children};
use super::{Link, Robot, files, joints, units, xacro, xml};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use roxmltree::Node;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Numbers beyond this are mistakes, and would only overflow later.
const MAX_NUMBER: f64 = 1e6;
/// Files larger than this (bytes) are no robot descriptions.
const MAX_FILE: u64 = 1 << 27;
/// Robots with more links or joints than this are none.
const MAX_LINKS: usize = 1000;

/// A URDF file that cannot be used, and why.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {problem}", path = path.display())]
pub struct RobotError {
    pub path: PathBuf,
    pub problem: UrdfProblem,
}

/// What makes a file unusable as a robot.
#[derive(Debug, thiserror::Error)]
pub enum UrdfProblem {
    #[error("cannot read the robot description: {0}")]
    Read(String),
    #[error("{0}")]
    Kind(String),
    #[error("{0}")]
    Xacro(String),
    #[error("not a valid URDF file: {0}")]
    Xml(String),
    #[error("the robot has no links")]
    NoLinks,
    #[error("the robot has more than {most} {what}")]
    TooMany { what: &'static str, most: usize },
    #[error("a <{0}> has no name")]
    NoName(String),
    #[error("{what} has no {attribute}")]
    NoAttribute { what: String, attribute: String },
    #[error("{what} has {attribute}=\"{value}\", which should be {count} number(s)")]
    Value {
        what: String,
        attribute: String,
        value: String,
        count: usize,
    },
    #[error("joint \"{joint}\" has no <{end} link=\"...\"/>")]
    NoEnd { joint: String, end: &'static str },
    #[error("two {kind}s are called \"{name}\"; names must differ")]
    SameName { kind: &'static str, name: String },
    #[error("joint \"{joint}\" refers to a link \"{link}\" that does not exist")]
    UnknownLink { joint: String, link: String },
    #[error(
        "link \"{link}\" is the child of two joints, \"{first}\" and \"{second}\"; it must have one parent"
    )]
    TwoParents {
        link: String,
        first: String,
        second: String,
    },
    #[error("the links form a loop through \"{link}\"; a robot must be a tree")]
    Loop { link: String },
    #[error(
        "the links \"{first}\" and \"{second}\" both have no parent; connect them with a joint"
    )]
    TwoRoots { first: String, second: String },
    #[error(
        "joint \"{joint}\" is of type \"{kind}\", which is not read; use revolute, continuous, prismatic or fixed"
    )]
    JointType { joint: String, kind: String },
    #[error(
        "joint \"{joint}\" has no usable limits; add <limit lower=\"...\" upper=\"...\" .../> with lower <= upper, in rad or m, or make it continuous if it turns all round"
    )]
    Limits { joint: String },
    #[error("joint \"{joint}\" mimics \"{leader}\", which is not a joint that moves")]
    UnknownLeader { joint: String, leader: String },
    #[error("joint \"{joint}\" mimics itself by way of other joints")]
    MimicLoop { joint: String },
    #[error(
        "{what} has a number that is not finite or beyond a million, or a direction of length zero"
    )]
    Number { what: String },
    #[error("{what} has a size that is not positive")]
    Size { what: String },
    #[error("link \"{link}\": cannot use mesh \"{mesh}\": {why}")]
    Mesh {
        link: String,
        mesh: String,
        why: String,
    },
    #[error(
        "link \"{link}\" has a shape <{kind}>, which is not read; use box, cylinder, sphere, capsule or mesh"
    )]
    Geometry { link: String, kind: String },
    #[error("link \"{link}\": a body is {size} m large; {advice}")]
    TooLarge {
        link: String,
        size: String,
        advice: String,
    },
}

impl Robot {
    /// Reads a URDF file and the meshes (STL, OBJ, COLLADA) that its visuals name. A xacro file is made
    /// a URDF by the program `xacro`, where that is installed.
    ///
    /// A relative file name starts at the URDF's folder; a package is looked for where
    /// ROS_PACKAGE_PATH and AMENT_PREFIX_PATH say, and above the URDF. Boxes, cylinders, spheres and
    /// capsules are tessellated. The body of a link without any visual, or with one that cannot be
    /// read, is that of its collision shapes; those of other links are not read. Joints that have
    /// more than one degree of freedom are taken to be fixed. Materials, inertias and extensions do
    /// not matter.
    pub fn from_urdf(path: &Path) -> Result<Robot, RobotError> {
        Self::from_urdf_with(path, &Packages::new())
    }

    /// The same, given the folders of packages, which come before all other places.
    pub fn from_urdf_with(path: &Path, packages: &Packages) -> Result<Robot, RobotError> {
        read(path, packages).map_err(|problem| RobotError {
            path: path.to_owned(),
            problem,
        })
    }
}

fn read(path: &Path, packages: &Packages) -> Result<Robot, UrdfProblem> {
    // Read in any case: the message of a file that cannot be read is ours.
    let text = files::read_text(path, MAX_FILE).map_err(UrdfProblem::Read)?;
    let is_xacro = path
        .extension()
        .is_some_and(|extension| extension == "xacro");
    let robot = match is_xacro {
        true => None,
        false => parse(text, path, packages)?,
    };
    if let Some(robot) = robot {
        return Ok(robot);
    }
    let text = xacro::run(path).map_err(UrdfProblem::Xacro)?;
    let unresolved = || UrdfProblem::Xacro("xacro left elements of its own in it".to_owned());
    parse(text, path, packages)?.ok_or_else(unresolved)
}

/// The robot that a text describes; `None` if it is written in xacro.
fn parse(text: String, path: &Path, packages: &Packages) -> Result<Option<Robot>, UrdfProblem> {
    let robot = xml::read(text, |root| {
        let kind = match root.tag_name().name() {
            "robot" => None,
            "sdf" => Some("an SDF file, as Gazebo has them"),
            "mujoco" => Some("an MJCF file, as MuJoCo has them"),
            "COLLADA" => Some("a COLLADA file: a mesh"),
            _ => Some("an XML file, but its outermost element is not <robot>"),
        };
        if let Some(kind) = kind {
            return Err(UrdfProblem::Kind(format!(
                "this is {kind}; give the robot's URDF, or convert it to one"
            )));
        }
        let of_xacro = |node: Node| {
            let namespace = node.tag_name().namespace();
            namespace.is_some_and(|namespace| namespace.ends_with("xacro"))
        };
        match root.descendants().any(of_xacro) {
            true => Ok(None),
            false => read_robot(root, path, packages).map(Some),
        }
    });
    robot.map_err(UrdfProblem::Xml)?
}

fn read_robot(root: Node, path: &Path, packages: &Packages) -> Result<Robot, UrdfProblem> {
    let elements = |kind| children(root, kind).collect::<Vec<Node>>();
    let (link_elements, joint_elements) = (elements("link"), elements("joint"));
    for (what, elements) in [("links", &link_elements), ("joints", &joint_elements)] {
        if elements.len() > MAX_LINKS {
            return Err(UrdfProblem::TooMany {
                what,
                most: MAX_LINKS,
            });
        }
    }
    let names: Vec<&str> =
        (link_elements.iter().map(|link| name_of(*link))).collect::<Result<_, _>>()?;
    let link_index = index_by_name("link", &names)?;
    let joint_names: Vec<&str> =
        (joint_elements.iter().map(|joint| name_of(*joint))).collect::<Result<_, _>>()?;
    index_by_name("joint", &joint_names)?;
    let mut notes = Vec::new();
    let joints = joints::read(&joint_elements, &link_index, &mut notes)?;
    let joints = joints::in_tree_order(&names, joints)?;
    let mut finder = Finder::new(path, packages);
    let mut bodies = Bodies::new(&mut finder);
    let mut links = Vec::with_capacity(names.len());
    for element in link_elements {
        links.push(Link {
            name: name_of(element)?.to_owned(),
            mesh: bodies.read(element)?,
        });
    }
    let (shapes, of_bodies) = bodies.finish();
    notes.extend(of_bodies);
    notes.extend(finder.notes);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(Robot {
        name: root
            .attribute("name")
            .map_or(stem.into_owned(), str::to_owned),
        warnings: units::warnings(&shapes, &joints, links.len()),
        links,
        joints,
        notes,
    })
}

fn index_by_name<'a>(
    kind: &'static str,
    names: &[&'a str],
) -> Result<BTreeMap<&'a str, usize>, UrdfProblem> {
    let mut index = BTreeMap::new();
    for (i, &name) in names.iter().enumerate() {
        if index.insert(name, i).is_some() {
            return Err(UrdfProblem::SameName {
                kind,
                name: name.to_owned(),
            });
        }
    }
    Ok(index)
}

/// The name of a link or joint.
pub fn name_of<'a>(element: Node<'a, '_>) -> Result<&'a str, UrdfProblem> {
    let no_name = || UrdfProblem::NoName(element.tag_name().name().to_owned());
    element.attribute("name").ok_or_else(no_name)
}

/// The numbers, if all are finite and none beyond [`MAX_NUMBER`].
pub fn finite<const N: usize>(numbers: [f64; N], what: &str) -> Result<[f64; N], UrdfProblem> {
    match numbers.iter().all(|x| x.abs() <= MAX_NUMBER) {
        true => Ok(numbers),
        false => Err(UrdfProblem::Number {
            what: what.to_owned(),
        }),
    }
}

/// The numbers that an attribute of `element` holds; `None` without the attribute. Messages say that
/// it belongs to `what`.
pub fn values<const N: usize>(
    element: Node,
    attribute: &str,
    what: &str,
) -> Result<Option<[f64; N]>, UrdfProblem> {
    let Some(text) = element.attribute(attribute) else {
        return Ok(None);
    };
    let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
    let numbers = numbers.ok().and_then(|numbers| numbers.try_into().ok());
    let numbers = numbers.ok_or_else(|| UrdfProblem::Value {
        what: what.to_owned(),
        attribute: attribute.to_owned(),
        value: text.chars().take(60).collect(),
        count: N,
    })?;
    finite(numbers, what).map(Some)
}

/// The `<origin>` of an element. URDF angles are roll, pitch, yaw about the fixed axes x, y, z in this
/// order.
pub fn pose(element: Node, what: &str) -> Result<Isometry3<f64>, UrdfProblem> {
    let origin = |attribute| match child(element, "origin") {
        Some(origin) => values(origin, attribute, what),
        None => Ok(None),
    };
    let [roll, pitch, yaw] = origin("rpy")?.unwrap_or_default();
    Ok(Isometry3::from_parts(
        Translation3::from(origin("xyz")?.unwrap_or_default()),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    ))
}
