//! Reading a robot from a URDF file and the mesh files that it names.

use super::{Joint, Link, Mesh, Mimic, Motion, Robot, solids};
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use urdf_rs::{Geometry, JointType};

/// A mesh larger than this (m) is taken for one in millimetres.
const MAX_EXTENT: f64 = 20.0;
/// Numbers beyond this are mistakes, and would only overflow later.
const MAX_NUMBER: f64 = 1e6;
/// Files larger than this (bytes) are no robot descriptions; meshes may be as large.
const MAX_FILE: u64 = 1 << 28;

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
    Read(std::io::Error),
    #[error("not a valid URDF file: {0}")]
    Xml(String),
    #[error("the robot has no links")]
    NoLinks,
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
        "joint \"{joint}\" is of type {kind}, which is not supported; use revolute, continuous, prismatic or fixed"
    )]
    JointType { joint: String, kind: String },
    #[error(
        "joint \"{joint}\" has no usable limits; add <limit lower=\"...\" upper=\"...\" .../> with lower <= upper, in rad or m"
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
        "link \"{link}\": a body is {extent:.0} m across, which looks like millimetres; give the mesh a scale of 0.001 (<mesh filename=\"...\" scale=\"0.001 0.001 0.001\"/>)"
    )]
    TooLarge { link: String, extent: f64 },
}

impl Robot {
    /// Reads a URDF file and the meshes (STL, OBJ, COLLADA) that its visuals name. A relative file
    /// name starts at the URDF's folder; `package://name/rest` is looked for in that folder and
    /// its ancestors, as `name/rest` and then, for a package folder of another name, as `rest`.
    /// Boxes, cylinders, spheres and capsules are tessellated. The body of a link without any visual
    /// is that of its collision shapes; those of other links are not read.
    pub fn from_urdf(path: &Path) -> Result<Robot, RobotError> {
        read(path).map_err(|problem| RobotError {
            path: path.to_owned(),
            problem,
        })
    }
}

fn read(path: &Path) -> Result<Robot, UrdfProblem> {
    let text = within_bounds(path)
        .and_then(|()| std::fs::read_to_string(path))
        .map_err(UrdfProblem::Read)?;
    let urdf = urdf_rs::read_from_string(&text).map_err(|e| UrdfProblem::Xml(one_line(&e)))?;
    let link_index = index_by_name("link", urdf.links.iter().map(|l| l.name.as_str()))?;
    index_by_name("joint", urdf.joints.iter().map(|j| j.name.as_str()))?;
    let joints = in_tree_order(&urdf, read_joints(&urdf, &link_index)?)?;
    // The parent of a bare file name is the empty path.
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let folder = folder.unwrap_or(Path::new("."));
    let links = urdf
        .links
        .iter()
        .map(|link| {
            Ok(Link {
                name: link.name.clone(),
                mesh: read_body(link, folder)?,
            })
        })
        .collect::<Result<_, UrdfProblem>>()?;
    Ok(Robot {
        name: urdf.name,
        links,
        joints,
    })
}

/// Fails on a file that is too large to be read at once.
fn within_bounds(path: &Path) -> std::io::Result<()> {
    match std::fs::metadata(path)?.len() {
        0..=MAX_FILE => Ok(()),
        bytes => Err(std::io::Error::other(format!(
            "it has {bytes} bytes, more than {MAX_FILE}"
        ))),
    }
}

fn one_line(message: &impl ToString) -> String {
    let text = message.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn index_by_name<'a>(
    kind: &'static str,
    names: impl Iterator<Item = &'a str>,
) -> Result<BTreeMap<&'a str, usize>, UrdfProblem> {
    let mut index = BTreeMap::new();
    for (i, name) in names.enumerate() {
        if index.insert(name, i).is_some() {
            return Err(UrdfProblem::SameName {
                kind,
                name: name.to_owned(),
            });
        }
    }
    Ok(index)
}

/// The joints in URDF order.
fn read_joints(
    urdf: &urdf_rs::Robot,
    link_index: &BTreeMap<&str, usize>,
) -> Result<Vec<Joint>, UrdfProblem> {
    let mut dofs = 0;
    let mut joints = Vec::with_capacity(urdf.joints.len());
    for joint in &urdf.joints {
        let what = || format!("joint \"{}\"", joint.name);
        let link = |name: &str| {
            let unknown = || UrdfProblem::UnknownLink {
                joint: joint.name.clone(),
                link: name.to_owned(),
            };
            link_index.get(name).copied().ok_or_else(unknown)
        };
        let axis = || {
            let axis = Vector3::from(finite(*joint.axis.xyz, what)?);
            Unit::try_new(axis, 1e-9).ok_or_else(|| UrdfProblem::Number { what: what() })
        };
        let motion = match joint.joint_type {
            JointType::Fixed => Motion::Fixed,
            JointType::Revolute | JointType::Continuous => Motion::Revolute(axis()?),
            JointType::Prismatic => Motion::Prismatic(axis()?),
            ref other => {
                return Err(UrdfProblem::JointType {
                    joint: joint.name.clone(),
                    kind: format!("{other:?}").to_lowercase(),
                });
            }
        };
        joints.push(Joint {
            name: joint.name.clone(),
            parent: link(&joint.parent.link)?,
            child: link(&joint.child.link)?,
            origin: pose(&joint.origin, what)?,
            motion,
            limits: limits(joint)?,
            mimic: None,
            dof: (motion != Motion::Fixed).then(|| {
                dofs += 1;
                dofs - 1
            }),
        });
    }
    for i in 0..joints.len() {
        joints[i].mimic = mimic(urdf, &joints, i)?;
    }
    Ok(joints)
}

fn limits(joint: &urdf_rs::Joint) -> Result<(f64, f64), UrdfProblem> {
    let (lower, upper) = (joint.limit.lower, joint.limit.upper);
    match joint.joint_type {
        JointType::Fixed => Ok((0.0, 0.0)),
        JointType::Continuous => Ok((-PI, PI)),
        // A missing <limit> is read as zeros.
        _ if lower <= upper
            && (0.0..=MAX_NUMBER).contains(&lower.abs())
            && (0.0..=MAX_NUMBER).contains(&upper.abs())
            && lower.abs() + upper.abs() > 0.0 =>
        {
            Ok((lower, upper))
        }
        _ => Err(UrdfProblem::Limits {
            joint: joint.name.clone(),
        }),
    }
}

/// Follows the leaders of joint `i` to one that mimics nobody.
fn mimic(urdf: &urdf_rs::Robot, joints: &[Joint], i: usize) -> Result<Option<Mimic>, UrdfProblem> {
    let Some(own_dof) = joints[i].dof else {
        return Ok(None);
    };
    let mut chain = Mimic {
        leader: own_dof,
        multiplier: 1.0,
        offset: 0.0,
    };
    let mut at = i;
    for _ in 0..joints.len() {
        let joint = &urdf.joints[at];
        let Some(mimic) = &joint.mimic else {
            return Ok((at != i).then_some(chain));
        };
        let what = || format!("the mimic of joint \"{}\"", joint.name);
        let numbers = [mimic.multiplier.unwrap_or(1.0), mimic.offset.unwrap_or(0.0)];
        let [multiplier, offset] = finite(numbers, what)?;
        let unknown = || UrdfProblem::UnknownLeader {
            joint: joint.name.clone(),
            leader: mimic.joint.clone(),
        };
        at = (joints.iter().position(|j| j.name == mimic.joint)).ok_or_else(unknown)?;
        chain = Mimic {
            leader: joints[at].dof.ok_or_else(unknown)?,
            multiplier: chain.multiplier * multiplier,
            offset: chain.offset + chain.multiplier * offset,
        };
    }
    Err(UrdfProblem::MimicLoop {
        joint: urdf.joints[i].name.clone(),
    })
}

/// Parents before children, otherwise in URDF order; fails unless the links form one tree.
fn in_tree_order(urdf: &urdf_rs::Robot, joints: Vec<Joint>) -> Result<Vec<Joint>, UrdfProblem> {
    let name = |link: usize| urdf.links[link].name.clone();
    let mut joint_above: Vec<Option<&Joint>> = vec![None; urdf.links.len()];
    for joint in &joints {
        if let Some(first) = joint_above[joint.child].replace(joint) {
            return Err(UrdfProblem::TwoParents {
                link: name(joint.child),
                first: first.name.clone(),
                second: joint.name.clone(),
            });
        }
    }
    if urdf.links.is_empty() {
        return Err(UrdfProblem::NoLinks);
    }
    let depth_of = |link: usize| {
        let (mut depth, mut at) = (0, link);
        while let Some(joint) = joint_above[at] {
            at = joint.parent;
            depth += 1;
            if depth > joints.len() {
                return Err(UrdfProblem::Loop { link: name(link) });
            }
        }
        Ok(depth)
    };
    let depth: Vec<usize> = (0..urdf.links.len())
        .map(depth_of)
        .collect::<Result<_, _>>()?;
    let mut roots = (0..urdf.links.len()).filter(|&link| depth[link] == 0);
    if let (Some(first), Some(second)) = (roots.next(), roots.next()) {
        return Err(UrdfProblem::TwoRoots {
            first: name(first),
            second: name(second),
        });
    }
    let mut sorted = joints;
    sorted.sort_by_key(|joint| depth[joint.child]);
    Ok(sorted)
}

/// The visuals of a link as one mesh; its collision shapes if it has none.
fn read_body(link: &urdf_rs::Link, folder: &Path) -> Result<Mesh, UrdfProblem> {
    let what = || format!("a body of link \"{}\"", link.name);
    let visuals = link.visual.iter().map(|v| (&v.geometry, &v.origin));
    let collisions = link.collision.iter().map(|c| (&c.geometry, &c.origin));
    let has_visuals = !link.visual.is_empty();
    let collisions = collisions.filter(|_| !has_visuals);
    let mut merged = Mesh::default();
    for (geometry, origin) in visuals.chain(collisions) {
        let mesh = match geometry {
            Geometry::Box { size } => solids::cuboid(positive(**size, what)?),
            &Geometry::Cylinder { radius, length } => {
                let [radius, length] = positive([radius, length], what)?;
                solids::cylinder(radius, length)
            }
            &Geometry::Capsule { radius, length } => {
                let [radius, length] = positive([radius, length], what)?;
                solids::capsule(radius, length)
            }
            &Geometry::Sphere { radius } => solids::sphere(positive([radius], what)?[0]),
            Geometry::Mesh { filename, scale } => {
                let scale = finite(scale.map_or([1.0; 3], |s| *s), what)?;
                positive(scale.map(f64::abs), what)?;
                let mesh = read_mesh(filename, folder).map_err(|why| UrdfProblem::Mesh {
                    link: link.name.clone(),
                    mesh: filename.clone(),
                    why,
                })?;
                scaled(mesh, scale)
            }
        };
        let (low, high) = mesh.bounds().unwrap_or_default();
        let extent = (0..3)
            .map(|i| f64::from(high[i] - low[i]))
            .fold(0.0, f64::max);
        if extent > MAX_EXTENT {
            return Err(UrdfProblem::TooLarge {
                link: link.name.clone(),
                extent,
            });
        }
        merged.append(&mesh.transformed(&pose(origin, what)?));
    }
    Ok(merged)
}

fn scaled(mut mesh: Mesh, scale: [f64; 3]) -> Mesh {
    for v in &mut mesh.vertices {
        *v = std::array::from_fn(|i| (f64::from(v[i]) * scale[i]) as f32);
    }
    // A mirrored mesh is inside out until its triangles are turned round.
    if scale.iter().product::<f64>() < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    mesh
}

/// Runs a reader that is not ours and panics on some broken files: then nothing is returned, and nothing
/// printed.
fn guarded<T>(read: impl FnOnce() -> T) -> Option<T> {
    // The hook that prints is the whole program's; whoever panics elsewhere meanwhile is silent, too.
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| ()));
    let result = panic::catch_unwind(AssertUnwindSafe(read));
    panic::set_hook(hook);
    result.ok()
}

/// Reads a mesh file as one welded mesh; the error says why not.
fn read_mesh(uri: &str, folder: &Path) -> Result<Mesh, String> {
    let path = find_file(uri, folder)?;
    let load = |()| mesh_loader::Loader::default().load(&path);
    let file = guarded(|| within_bounds(&path).and_then(load))
        .ok_or("it is broken in a way that its reader does not know")?
        .map_err(|e| one_line(&e))?;
    let mut mesh = Mesh::default();
    for part in file.meshes {
        let vertices = part.vertices;
        let known = |t: &[u32; 3]| t.iter().all(|&i| (i as usize) < vertices.len());
        if !part.faces.iter().all(known) {
            return Err("a triangle names a vertex that does not exist".to_owned());
        }
        mesh.append(&Mesh {
            vertices,
            triangles: part.faces,
        });
    }
    if mesh.vertices.iter().flatten().any(|x| !x.is_finite()) {
        return Err("a vertex is not finite".to_owned());
    }
    let welded = mesh.welded();
    if welded.is_empty() {
        return Err("it has no triangles".to_owned());
    }
    Ok(welded)
}

fn find_file(uri: &str, folder: &Path) -> Result<PathBuf, String> {
    let candidates: Vec<PathBuf> = match uri.split_once("://") {
        None => vec![folder.join(uri)],
        Some(("file", path)) => vec![PathBuf::from(path)],
        Some(("package" | "model", path)) => {
            let folder = folder.canonicalize().map_err(|e| one_line(&e))?;
            let inside = path.split_once('/').map_or(path, |(_, inside)| inside);
            folder
                .ancestors()
                .flat_map(|above| [above.join(path), above.join(inside)])
                .collect()
        }
        Some((scheme, _)) => return Err(format!("\"{scheme}://\" is not supported")),
    };
    let found = candidates.into_iter().find(|path| path.is_file());
    found.ok_or_else(|| format!("there is no such file, seen from {}", folder.display()))
}

/// The numbers, if all are finite and none beyond [`MAX_NUMBER`].
fn finite<const N: usize>(
    numbers: [f64; N],
    what: impl Fn() -> String,
) -> Result<[f64; N], UrdfProblem> {
    if numbers.iter().all(|x| x.abs() <= MAX_NUMBER) {
        Ok(numbers)
    } else {
        Err(UrdfProblem::Number { what: what() })
    }
}

/// The numbers, if they can be sizes of a shape.
fn positive<const N: usize>(
    numbers: [f64; N],
    what: impl Fn() -> String + Copy,
) -> Result<[f64; N], UrdfProblem> {
    let numbers = finite(numbers, what)?;
    match numbers.iter().all(|&x| x > 0.0) {
        true => Ok(numbers),
        false => Err(UrdfProblem::Size { what: what() }),
    }
}

/// URDF angles are roll, pitch, yaw about the fixed axes x, y, z in this order.
fn pose(
    origin: &urdf_rs::Pose,
    what: impl Fn() -> String + Copy,
) -> Result<Isometry3<f64>, UrdfProblem> {
    let [roll, pitch, yaw] = finite(*origin.rpy, what)?;
    Ok(Isometry3::from_parts(
        Translation3::from(finite(*origin.xyz, what)?),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    ))
}
