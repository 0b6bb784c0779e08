//! DISP against its definition, its axioms and closed forms.

use armpose::pose_space::disp::{Disp, DispError};
use armpose::random::{Stream, below, normal, stream, uniform};
use armpose::robot::{Joint, Link, Mesh, Mimic, Motion, Robot, solids};
use armpose::scene::Rig;
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use std::f64::consts::PI;
use std::path::Path;

fn direction(s: &mut Stream) -> Unit<Vector3<f64>> {
    Unit::new_normalize(Vector3::from_fn(|_, _| normal(s)))
}

fn anywhere(s: &mut Stream) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&direction(s), uniform(s, 0.0, PI));
    Isometry3::from_parts(Translation3::from(direction(s).into_inner() * 0.3), turn)
}

/// The surface of a link: a solid at some place, or none.
fn body(s: &mut Stream) -> Mesh {
    let size = [0; 3].map(|_| uniform(s, 0.02, 0.3));
    let solid = match below(s, 4) {
        0 => solids::cuboid(size),
        1 => solids::capsule(size[0], size[1]),
        2 => solids::cylinder(size[0], size[1]),
        _ => Mesh::default(),
    };
    solid.transformed(&anywhere(s))
}

/// A tree of links with joints of all kinds.
fn robot(s: &mut Stream, links: usize) -> Robot {
    let mut dofs = 0;
    let joint = |child: usize| {
        let motion = match below(s, 4) {
            0 => Motion::Fixed,
            1 => Motion::Prismatic(direction(s)),
            _ => Motion::Revolute(direction(s)),
        };
        let dof = (motion != Motion::Fixed).then(|| {
            dofs += 1;
            dofs - 1
        });
        Joint {
            name: format!("joint {child}"),
            parent: child - 1 - below(s, child.min(2)),
            child,
            origin: anywhere(s),
            motion,
            limits: (-PI, PI),
            mimic: None,
            dof,
        }
    };
    let joints = (1..links).map(joint).collect();
    let link = |i: usize| Link {
        name: format!("link {i}"),
        mesh: body(s),
    };
    Robot {
        name: "random".to_owned(),
        links: (0..links).map(link).collect(),
        joints,
        warnings: Vec::new(),
        notes: Vec::new(),
    }
}

fn names(robot: &Robot) -> Vec<String> {
    robot.dof_joints().map(|joint| joint.name.clone()).collect()
}

fn pose(s: &mut Stream, joints: usize) -> Vec<f64> {
    (0..joints).map(|_| uniform(s, -2.0, 2.0)).collect()
}

/// Eq. 3 over every vertex of every link, of two configurations.
fn by_definition(robot: &Robot, a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (robot.forward_kinematics(a), robot.forward_kinematics(b));
    let links = robot.links.iter().zip(a.iter().zip(&b));
    let moved = links.flat_map(|(link, (a, b))| {
        let vertices = link.mesh.vertices.iter();
        let points = vertices.map(|v| Point3::from(v.map(f64::from)));
        points.map(move |p| (a * p - b * p).norm())
    });
    moved.fold(0.0, f64::max)
}

#[test]
fn random_robots_agree_with_the_definition() {
    let mut s = stream(1, "disp", &[]);
    let mut compared = 0;
    for round in 0..40 {
        let robot = robot(&mut s, 2 + round);
        let names = names(&robot);
        let disp = match Disp::new(&robot, &names) {
            Ok(disp) => disp,
            Err(DispError::NothingMoves { .. }) => continue,
            Err(error) => panic!("{error}"),
        };
        for step in [2.0, 1e-3] {
            let a = pose(&mut s, names.len());
            let b: Vec<f64> = a.iter().map(|x| x + step * normal(&mut s)).collect();
            let (ours, expected) = (disp.distance(&a, &b), by_definition(&robot, &a, &b));
            assert!((ours - expected).abs() < 1e-8, "{ours} {expected}");
            compared += 1;
        }
    }
    assert!(compared > 50);
}

#[test]
fn the_arm_agrees_with_the_definition_and_the_matrix_with_the_pairs() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm/robot.toml");
    let rig = Rig::read(&path).unwrap();
    let arm = &rig.arms[rig.arm("right").unwrap()];
    let all = names(&rig.robot);
    let joints: Vec<&String> = arm.joints.iter().map(|&dof| &all[dof]).collect();
    let disp = Disp::new(&rig.robot, &joints).unwrap();
    let mut s = stream(2, "disp", &[]);
    let poses: Vec<Vec<f64>> = (0..12).map(|_| pose(&mut s, joints.len())).collect();
    let matrix = disp.matrix(&poses);
    assert_eq!(matrix.count(), 12);
    let whole = |pose: &[f64]| {
        let mut q = vec![0.0; rig.robot.dofs()];
        for (&dof, &value) in arm.joints.iter().zip(pose) {
            q[dof] = value;
        }
        q
    };
    for (a, pose) in poses.iter().enumerate() {
        for (b, other) in poses.iter().enumerate() {
            assert_eq!(matrix.get(a, b), disp.distance(pose, other));
            let expected = by_definition(&rig.robot, &whole(pose), &whole(other));
            assert!((matrix.get(a, b) - expected).abs() < 1e-8);
        }
    }
}

#[test]
fn disp_is_a_metric() {
    let mut s = stream(3, "disp", &[]);
    let robot = robot(&mut s, 12);
    let names = names(&robot);
    let disp = Disp::new(&robot, &names).unwrap();
    for _ in 0..200 {
        let [a, b, c] = [0; 3].map(|_| pose(&mut s, names.len()));
        assert_eq!(disp.distance(&a, &a), 0.0);
        assert_eq!(disp.distance(&a, &b), disp.distance(&b, &a));
        let (direct, detour) = (
            disp.distance(&a, &c),
            disp.distance(&a, &b) + disp.distance(&b, &c),
        );
        assert!(direct > 0.0 && direct <= detour + 1e-12);
    }
}

/// A box on one joint, with a second box fixed to it.
fn one_joint(motion: Motion) -> Robot {
    let link = |name: &str, mesh| Link {
        name: name.to_owned(),
        mesh,
    };
    let joint = |child, motion, dof| Joint {
        name: format!("joint {child}"),
        parent: child - 1,
        child,
        origin: Isometry3::translation(0.0, 0.0, 0.25),
        motion,
        limits: (-PI, PI),
        mimic: None,
        dof,
    };
    Robot {
        name: "one joint".to_owned(),
        links: vec![
            link("base", solids::cuboid([9.0; 3])),
            link("box", solids::cuboid([0.2, 0.4, 0.6])),
            link("fixed", solids::cuboid([0.6, 0.4, 0.2])),
        ],
        joints: vec![joint(1, motion, Some(0)), joint(2, Motion::Fixed, None)],
        warnings: Vec::new(),
        notes: Vec::new(),
    }
}

#[test]
fn one_joint_has_a_closed_form() {
    let radius = 0.3f64.hypot(0.2);
    let turning = one_joint(Motion::Revolute(Vector3::z_axis()));
    let sliding = one_joint(Motion::Prismatic(Vector3::x_axis()));
    let turning = Disp::new(&turning, &["joint 1"]).unwrap();
    let sliding = Disp::new(&sliding, &["joint 1"]).unwrap();
    for step in [0.0, 1e-9, 0.1, 1.0, 3.0] {
        let chord = 2.0 * radius * f64::sin(step / 2.0);
        assert!((turning.distance(&[0.4], &[0.4 - step]) - chord).abs() < 1e-7);
        assert!((sliding.distance(&[0.4], &[0.4 + step]) - step).abs() < 1e-12);
    }
}

/// A joint that follows counts whether or not the pose names it.
#[test]
fn followers_follow() {
    let mut s = stream(4, "disp", &[]);
    let mut robot = robot(&mut s, 8);
    let moving: Vec<usize> = (0..7).filter(|&j| robot.joints[j].dof.is_some()).collect();
    let [.., leader, follower] = moving[..] else {
        panic!("too few joints move");
    };
    let mimic = Mimic {
        leader: robot.joints[leader].dof.unwrap(),
        multiplier: 0.5,
        offset: 0.1,
    };
    robot.joints[follower].mimic = Some(mimic);
    robot.links[follower + 1].mesh = solids::sphere(0.2);
    let (leader, follower) = (&robot.joints[leader].name, &robot.joints[follower].name);
    let short = Disp::new(&robot, &[leader]).unwrap();
    let long = Disp::new(&robot, &[follower, leader]).unwrap();
    let follow = |leader: f64| [0.5 * leader + 0.1, leader];
    for _ in 0..20 {
        let (a, b) = (uniform(&mut s, -2.0, 2.0), uniform(&mut s, -2.0, 2.0));
        let expected = long.distance(&follow(a), &follow(b));
        assert!((short.distance(&[a], &[b]) - expected).abs() < 1e-12);
    }
}

#[test]
fn joints_that_say_nothing_are_refused() {
    let robot = one_joint(Motion::Revolute(Vector3::z_axis()));
    let unknown = Disp::new(&robot, &["joint 2"]).unwrap_err();
    assert_eq!(
        unknown.to_string(),
        "robot \"one joint\" has no joint \"joint 2\" that moves"
    );
    let twice = Disp::new(&robot, &["joint 1", "joint 1"]).unwrap_err();
    assert_eq!(twice, DispError::Twice("joint 1".to_owned()));
    let none: [&str; 0] = [];
    assert!(matches!(
        Disp::new(&robot, &none),
        Err(DispError::NothingMoves { .. })
    ));
}
