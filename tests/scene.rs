//! Poses, self-collision and rooms of the dual-arm robot.

use armpose::random::{Stream, stream, uniform};
use armpose::robot::{Link, Mesh};
use armpose::scene::{
    FurnitureSpec, PoseSampler, PoseSpec, Rig, RobotPlace, RoomSpec, SceneError, SelfCollision,
    furnish,
};
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;

fn rig() -> Rig {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm/robot.toml");
    Rig::read(&path).unwrap()
}

fn poses(fixed: &[(&str, f64)], ranges: &[(&str, [f64; 2])]) -> PoseSpec {
    PoseSpec {
        fixed: fixed.iter().map(|&(n, v)| (n.to_owned(), v)).collect(),
        ranges: ranges.iter().map(|&(n, r)| (n.to_owned(), r)).collect(),
        camera_clearance: 0.3,
    }
}

#[test]
fn sampled_joints_keep_limits_ranges_and_mimics() {
    let rig = rig();
    let spec = poses(&[("UTILT", 0.8), ("L_EB", 1.0)], &[("R_EB", [0.5, 0.6])]);
    let sampler = PoseSampler::new(&rig, &spec).unwrap();
    let mut s = stream(1, "pose test", &[]);
    let value = |q: &[f64], name: &str| q[rig.robot.dof(name).unwrap()];
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for _ in 0..500 {
        let q = sampler.sample(&rig.robot, &mut s);
        for (joint, value) in rig.robot.dof_joints().zip(&q) {
            let (low, high) = joint.limits;
            assert!((low..=high).contains(value), "{}: {value}", joint.name);
        }
        assert_eq!(value(&q, "UTILT"), 0.8);
        assert_eq!(value(&q, "L_EB"), 1.0);
        assert_eq!(value(&q, "LPAN"), 0.0);
        assert!((0.5..=0.6).contains(&value(&q, "R_EB")));
        assert_eq!(value(&q, "R_FR2"), value(&q, "R_FR"));
        for finger in ["R_RF", "R_MF", "R_LF", "L_RF", "L_MF", "L_LF"] {
            let distal = value(&q, &format!("{finger}2"));
            assert!((distal - value(&q, finger) / 3.0).abs() < 1e-12);
        }
        lowest = value(&q, "R_SFE").min(lowest);
        highest = value(&q, "R_SFE").max(highest);
    }
    // The whole range is used.
    assert!(lowest < -2.5 && highest > 2.5, "{lowest} {highest}");
}

#[test]
fn fixing_a_joint_leaves_the_others_as_they_were() {
    let rig = rig();
    let draw = |spec: &PoseSpec| {
        let sampler = PoseSampler::new(&rig, spec).unwrap();
        sampler.sample(&rig.robot, &mut stream(2, "pose test", &[]))
    };
    let (free, fixed) = (
        draw(&poses(&[], &[])),
        draw(&poses(&[("R_SAA", -1.0)], &[])),
    );
    let changed: Vec<usize> = (0..free.len()).filter(|&i| free[i] != fixed[i]).collect();
    assert_eq!(changed, [rig.robot.dof("R_SAA").unwrap()]);
}

#[test]
fn impossible_poses_are_errors_that_name_the_joint() {
    let rig = rig();
    for (spec, joint, part) in [
        (poses(&[("R_SFA", 0.0)], &[]), "R_SFA", "no such joint"),
        (poses(&[("R_FR2", 0.0)], &[]), "R_FR2", "follows another"),
        (poses(&[("R_SFE", 3.0)], &[]), "R_SFE", "limits"),
        (poses(&[], &[("R_SFE", [1.0, 0.0])]), "R_SFE", "limits"),
        (poses(&[], &[("R_SFE", [f64::NAN, 0.0])]), "R_SFE", "limits"),
        (
            poses(&[], &[("LPAN", [-0.1, 0.1])]),
            "LPAN",
            "moves the camera",
        ),
        (
            poses(&[("R_EB", 1.0)], &[("R_EB", [0.0, 1.0])]),
            "R_EB",
            "both",
        ),
    ] {
        let message = PoseSampler::new(&rig, &spec).unwrap_err().to_string();
        assert!(
            message.contains(joint) && message.contains(part),
            "{message}"
        );
    }
}

#[test]
fn mistakes_in_a_robot_file_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let arm = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm");
    let text = std::fs::read_to_string(arm.join("robot.toml")).unwrap();
    let text = text.replace("\"arm.urdf\"", &format!("{:?}", arm.join("arm.urdf")));
    let read = |from: &str, to: &str| {
        assert!(text.contains(from));
        let path = folder.path().join("robot.toml");
        std::fs::write(&path, text.replace(from, to)).unwrap();
        Rig::read(&path).map_err(|e| e.to_string())
    };
    let matrix = |a: &str| {
        format!(
            "link = \"BASE\"\ncamera_from_link = [{a}, [0, 1, 0, 0], [0, 0, 1, 2.0], [0, 0, 0, 1]]"
        )
    };
    let link = "link = \"xtion_depth_optical_frame\"";
    for (from, to, part) in [
        (
            "root = \"L_SHOULDER\"",
            "root = \"L_ELBOW\"",
            "no link \"L_ELBOW\"",
        ),
        ("root = \"L_SHOULDER\"", "root = \"R_HAND\"", "share"),
        ("name = \"left\"", "name = \"right\"", "share"),
        ("\"L_SFE\"", "\"R_SFE\"", "no joint \"R_SFE\""),
        (link, "lnk = \"BASE\"", "lnk"),
        (link, &matrix("[0, 1, 0, 0]"), "camera_from_link"),
    ] {
        let message = read(from, to).unwrap_err();
        assert!(message.contains(part), "{message}");
        assert!(message.contains("robot.toml"), "{message}");
    }
    let mounted = read(link, &matrix("[1, 0, 0, 0]")).unwrap();
    let poses = mounted
        .robot
        .forward_kinematics(&vec![0.0; mounted.robot.dofs()]);
    assert_eq!(
        mounted.camera_from_root(&poses),
        Isometry3::translation(0.0, 0.0, 2.0)
    );
    assert!(matches!(
        Rig::read(&arm.join("none.toml")),
        Err(SceneError::Toml(_))
    ));
}

/// However the robot stands, its camera's link has the same place in the camera's frame.
#[test]
fn the_camera_moves_with_its_link() {
    let rig = rig();
    let mut s = stream(4, "camera test", &[]);
    for _ in 0..20 {
        let joints = rig.robot.dof_joints();
        let q: Vec<f64> = joints.map(|_| uniform(&mut s, -1.0, 1.0)).collect();
        let root_from_link = rig.robot.forward_kinematics(&q);
        let camera_from_link =
            rig.camera_from_root(&root_from_link) * root_from_link[rig.camera_link];
        let off = camera_from_link.to_homogeneous() - rig.camera_from_link.to_homogeneous();
        assert!(off.norm() < 1e-12, "{off}");
    }
}

/// A configuration and the links that touch in it.
type Collision = (Vec<f64>, (usize, usize));

/// Draws poses until `count` are free of collision; returns those and the ones that are not.
fn free_and_colliding(rig: &Rig, count: usize) -> (Vec<Vec<f64>>, Vec<Collision>) {
    let sampler = PoseSampler::new(rig, &poses(&[], &[])).unwrap();
    let sample = |s: &mut Stream| sampler.sample(&rig.robot, s);
    let collision = SelfCollision::new(&rig.robot, sample);
    let mut s = stream(3, "collision test", &[]);
    let (mut free, mut colliding) = (Vec::new(), Vec::new());
    while free.len() < count {
        let q = sample(&mut s);
        let root_from_link = rig.robot.forward_kinematics(&q);
        match collision.first(&root_from_link, &collision.boxes(&root_from_link)) {
            None => free.push(q),
            Some(pair) => colliding.push((q, pair)),
        }
    }
    (free, colliding)
}

/// The parts of each link, in the root frame.
fn posed_parts(rig: &Rig, q: &[f64]) -> Vec<Vec<Mesh>> {
    let links = rig.robot.links.iter().zip(rig.robot.forward_kinematics(q));
    let parts = |(link, pose): (&Link, Isometry3<f64>)| {
        let parts = link.mesh.components().into_iter();
        parts.map(|part| part.transformed(&pose)).collect()
    };
    links.map(parts).collect()
}

/// The oracle: whether a vertex or the middle of a triangle of one link lies inside another link.
/// Exact for what it finds; blind for edges that pierce without a vertex inside.
fn penetrates(a: &[Mesh], b: &[Mesh]) -> bool {
    let near = |x: &Mesh, y: &Mesh| {
        let ((x_low, x_high), (y_low, y_high)) = (x.bounds().unwrap(), y.bounds().unwrap());
        (0..3).all(|i| x_low[i] < y_high[i] && y_low[i] < x_high[i])
    };
    let any = |from: &[Mesh], of: &[Mesh]| {
        from.iter().any(|x| {
            of.iter()
                .any(|y| near(x, y) && points(x).any(|p| inside(y, &p)))
        })
    };
    any(a, b) || any(b, a)
}

fn corner(mesh: &Mesh, index: u32) -> Point3<f64> {
    mesh.vertices[index as usize].map(f64::from).into()
}

fn points(mesh: &Mesh) -> impl Iterator<Item = Point3<f64>> {
    mesh.triangles.iter().flat_map(|t| {
        let [a, b, c] = t.map(|i| corner(mesh, i));
        [a, Point3::from((a.coords + b.coords + c.coords) / 3.0)]
    })
}

/// Whether a point lies inside a closed mesh: the solid angles of its triangles add up to 4 pi.
fn inside(mesh: &Mesh, point: &Point3<f64>) -> bool {
    let (low, high) = mesh.bounds().unwrap();
    if (0..3).any(|i| point[i] <= f64::from(low[i]) || point[i] >= f64::from(high[i])) {
        return false;
    }
    let angle = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| corner(mesh, i) - point);
        let (x, y, z) = (a.norm(), b.norm(), c.norm());
        let cosine = x * y * z + a.dot(&b) * z + b.dot(&c) * x + c.dot(&a) * y;
        2.0 * a.dot(&b.cross(&c)).atan2(cosine)
    };
    let total: f64 = mesh.triangles.iter().map(angle).sum();
    total > 2.0 * std::f64::consts::PI
}

/// Links that only three or more moving joints connect; nearer ones overlap by design.
fn far_apart(rig: &Rig) -> Vec<(usize, usize)> {
    let path = |mut link: usize| {
        let mut path = Vec::new();
        while let Some(joint) = rig.robot.joints.iter().find(|j| j.child == link) {
            if joint.dof.is_some() {
                path.push(joint.name.clone());
            }
            link = joint.parent;
        }
        path
    };
    let with_body: Vec<usize> = (0..rig.robot.links.len())
        .filter(|&l| !rig.robot.links[l].mesh.is_empty())
        .collect();
    let mut pairs = Vec::new();
    for &a in &with_body {
        for &b in with_body.iter().filter(|&&b| b > a) {
            let (p, q) = (path(a), path(b));
            let between = p.iter().filter(|j| !q.contains(j)).count()
                + q.iter().filter(|j| !p.contains(j)).count();
            if between > 2 {
                pairs.push((a, b));
            }
        }
    }
    pairs
}

#[test]
fn accepted_poses_are_free_and_rejected_ones_are_not() {
    let rig = rig();
    let (free, colliding) = free_and_colliding(&rig, 40);
    let pairs = far_apart(&rig);
    for q in &free[..15] {
        let parts = posed_parts(&rig, q);
        for &(a, b) in &pairs {
            let names = (&rig.robot.links[a].name, &rig.robot.links[b].name);
            assert!(!penetrates(&parts[a], &parts[b]), "{names:?} in {q:?}");
        }
    }
    // The convex parts are a little larger than the links, and the oracle misses some.
    let truly = colliding.iter().filter(|(q, (a, b))| {
        let parts = posed_parts(&rig, q);
        penetrates(&parts[*a], &parts[*b])
    });
    let (truly, rejected) = (truly.count(), colliding.len());
    println!(
        "{} of {} poses rejected, {truly} penetrate",
        rejected,
        rejected + free.len()
    );
    assert!(
        rejected >= 5 && truly * 10 >= rejected * 7,
        "{truly} of {rejected}"
    );
}

#[test]
fn known_poses_collide_or_do_not() {
    let rig = rig();
    let sampler = PoseSampler::new(&rig, &poses(&[], &[])).unwrap();
    let collision = SelfCollision::new(&rig.robot, |s| sampler.sample(&rig.robot, s));
    let names = ["SFE", "SAA", "HR", "EB", "WR", "WFE", "WAA"];
    let first = |right: [f64; 7], left: [f64; 7]| {
        let mut q = vec![0.0; rig.robot.dofs()];
        for (i, name) in names.iter().enumerate() {
            q[rig.robot.dof(&format!("R_{name}")).unwrap()] = right[i];
            q[rig.robot.dof(&format!("L_{name}")).unwrap()] = left[i];
        }
        let root_from_link = rig.robot.forward_kinematics(&q);
        let pair = collision.first(&root_from_link, &collision.boxes(&root_from_link));
        pair.map(|(a, b)| {
            (
                rig.robot.links[a].name.clone(),
                rig.robot.links[b].name.clone(),
            )
        })
    };
    // Stretched out to the side and hanging down, arms are free, with wrists bent or straight.
    for wrist in [-1.5, 0.0, 1.5] {
        for shoulder in [-1.57, 0.0] {
            let arm = [0.0, shoulder, -2.36, 0.0, 0.0, wrist, 0.0];
            assert_eq!(first(arm, arm), None, "{arm:?}");
        }
    }
}

#[test]
fn an_arm_can_hit_itself_the_other_and_the_torso() {
    let rig = rig();
    let (_, colliding) = free_and_colliding(&rig, 800);
    let arms = |(a, b): (usize, usize)| (rig.arm_of_link(a), rig.arm_of_link(b));
    let pairs: Vec<_> = colliding.iter().map(|&(_, pair)| arms(pair)).collect();
    assert!(pairs.contains(&(Some(0), Some(0))) && pairs.contains(&(Some(1), Some(1))));
    assert!(pairs.contains(&(Some(0), Some(1))));
    assert!(pairs.contains(&(None, Some(0))) && pairs.contains(&(None, Some(1))));
    assert!(!pairs.contains(&(None, None)));
}

#[test]
fn rooms_leave_the_robot_alone_and_stay_within_their_walls() {
    let rig = rig();
    let sampler = PoseSampler::new(&rig, &poses(&[("UTILT", 0.8)], &[])).unwrap();
    let collision = SelfCollision::new(&rig.robot, |s| sampler.sample(&rig.robot, s));
    let room = RoomSpec {
        floor: 0.0,
        ahead: [1.4, 3.0],
        aside: [1.0, 2.6],
        behind: [1.0, 2.0],
        height: [2.4, 3.0],
        give_way: true,
    };
    let furniture = FurnitureSpec {
        closets: [1, 2],
        shelves: [1, 2],
        tables: [1, 2],
        chairs: [2, 4],
        clutter: [1, 3],
        clearance: 1.0,
    };
    let mut pieces = 0;
    for seed in 0..20 {
        let mut s = stream(seed, "room test", &[]);
        let q = sampler.sample(&rig.robot, &mut s);
        let root_from_link = rig.robot.forward_kinematics(&q);
        let root_from_camera = rig.camera_from_root(&root_from_link).inverse();
        let boxes = collision.boxes(&root_from_link);
        let place = RobotPlace::Taken(&boxes);
        let mesh = furnish(&room, &furniture, &root_from_camera, place, &mut s).mesh;
        let camera = Point3::from(root_from_camera.translation.vector);
        // The room is the first box: 8 vertices, seen from inside.
        let (walls, things) = mesh.vertices.split_at(8);
        pieces += usize::from(!things.is_empty());
        let (low, high) = Mesh {
            vertices: walls.to_vec(),
            triangles: vec![],
        }
        .bounds()
        .unwrap();
        for vertex in things {
            assert!((0..3).all(|i| (low[i] - 1e-3..=high[i] + 1e-3).contains(&vertex[i])));
            let point = Point3::from(vertex.map(f64::from));
            assert!(nalgebra::distance(&camera, &point) >= 1.0 - 1e-5);
            let in_robot = boxes.iter().flatten().any(|b| b.distance(&point) == 0.0);
            assert!(!in_robot, "{point} lies in the robot");
        }
    }
    assert!(pieces > 15, "{pieces} rooms of 20 have furniture");
}

#[test]
fn a_camera_that_looks_straight_down_has_a_room_too() {
    let room = RoomSpec {
        floor: -1.0,
        ahead: [2.0; 2],
        aside: [1.0; 2],
        behind: [1.5; 2],
        height: [3.0; 2],
        give_way: true,
    };
    let none = FurnitureSpec {
        closets: [0; 2],
        shelves: [0; 2],
        tables: [0; 2],
        chairs: [0; 2],
        clutter: [0; 2],
        clearance: 0.0,
    };
    let mut s = stream(1, "down test", &[]);
    let yaw = uniform(&mut s, -3.0, 3.0);
    // Turned over about x, the camera looks down with its image's upper edge towards +y.
    let down = Isometry3::rotation(Vector3::z() * yaw)
        * Isometry3::rotation(Vector3::x() * std::f64::consts::PI);
    let nobody = RobotPlace::Taken(&[]);
    let mesh = furnish(&room, &none, &down, nobody, &mut s).mesh;
    let upper_edge = down * -Vector3::y();
    let ahead = mesh
        .vertices
        .iter()
        .map(|v| Vector3::from(v.map(f64::from)).dot(&upper_edge));
    assert!((ahead.fold(f64::NEG_INFINITY, f64::max) - 2.0).abs() < 1e-6);
    assert_eq!(mesh.bounds().unwrap().0[2], -1.0);
}
