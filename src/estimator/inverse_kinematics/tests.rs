//! Robots small enough for exact answers.

use super::*;
use crate::robot::{Joint, Link, Mesh, Mimic, Motion, Robot};
use nalgebra::{Isometry3, Translation3, Unit, Vector3};

const FREE: (f64, f64) = (-3.1, 3.1);

/// A joint's motion, the place of its origin in the frame of the link above, its limits and leader.
type Moving = (Motion, [f64; 3], (f64, f64), Option<Mimic>);

/// A chain of joints; the last link is fixed to the one before it at `tip`.
fn chain(joints: &[Moving], tip: [f64; 3]) -> Robot {
    let at = |[x, y, z]: [f64; 3]| Isometry3::from(Translation3::new(x, y, z));
    let joint = |i: usize, motion, origin, limits, mimic| Joint {
        name: format!("joint {i}"),
        parent: i,
        child: i + 1,
        origin: at(origin),
        motion,
        limits,
        mimic,
        dof: (motion != Motion::Fixed).then_some(i),
    };
    let count = joints.len();
    let moving = joints.iter().enumerate();
    let moving =
        moving.map(|(i, &(motion, origin, limits, mimic))| joint(i, motion, origin, limits, mimic));
    let fixed = joint(count, Motion::Fixed, tip, (0.0, 0.0), None);
    let link = |i: usize| Link {
        name: format!("link {i}"),
        mesh: Mesh::default(),
    };
    Robot {
        name: "chain".to_owned(),
        links: (0..count + 2).map(link).collect(),
        joints: moving.chain([fixed]).collect(),
        warnings: Vec::new(),
        notes: Vec::new(),
    }
}

/// Two links of 1 m and 0.5 m in the plane z = 0; the points are elbow and tip.
fn planar(limits: [(f64, f64); 2]) -> VirtualArm {
    let turn = Motion::Revolute(Vector3::z_axis());
    let joints = [
        (turn, [0.0; 3], limits[0], None),
        (turn, [1.0, 0.0, 0.0], limits[1], None),
    ];
    VirtualArm::new(&chain(&joints, [0.5, 0.0, 0.0]), &[0, 1], &[2, 3])
}

fn at(x: f64, y: f64) -> Option<Target> {
    Some(Target {
        position: Point3::new(x, y, 0.0),
        weight: 1.0,
    })
}

/// The law of cosines gives the two poses in which the tip is at a distance d: the elbow at
/// +-acos((d^2 - 1 - 0.25) / 1). The reference chooses.
#[test]
fn a_planar_arm_takes_the_pose_of_the_law_of_cosines() {
    let arm = planar([FREE; 2]);
    let (x, y) = (0.7, 0.9);
    let elbow = f64::acos((x * x + y * y - 1.25) / 1.0);
    for sign in [1.0, -1.0] {
        let elbow = sign * elbow;
        let shoulder = f64::atan2(y, x) - f64::atan2(0.5 * elbow.sin(), 1.0 + 0.5 * elbow.cos());
        let reference = [shoulder + 0.2, elbow + 0.1];
        let found = arm.align(&[None, at(x, y)], &reference, &Settings::default());
        assert!((found.pose[0] - shoulder).abs() < 1e-5, "{found:?}");
        assert!((found.pose[1] - elbow).abs() < 1e-5, "{found:?}");
        assert_eq!(found.observed, [true, true]);
        assert_eq!(found.residuals[0], None);
    }
}

/// Out of reach, the arm stretches towards the target; its elbow is told by nothing but curvature.
#[test]
fn an_arm_stretches_towards_what_it_cannot_reach() {
    let settings = Settings {
        scale: 10.0,
        prior: 1e-9,
        ..Settings::default()
    };
    let found = planar([FREE; 2]).align(&[None, at(0.0, 2.0)], &[0.3, 0.4], &settings);
    assert!((found.pose[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-3);
    assert!(found.pose[1].abs() < 1e-3, "{found:?}");
    assert!((found.residuals[1].unwrap() - 0.5).abs() < 1e-6);
    assert_eq!(
        found.observed,
        [false, false],
        "stretched arms are singular"
    );
}

/// With the shoulder held by its limit at 0.5 the tip comes nearest where it points at the target
/// from the elbow. Clamping the unlimited solution would leave the elbow elsewhere.
#[test]
fn at_a_limit_the_other_joints_do_their_best() {
    let limit = 0.5;
    let (x, y) = (0.2, 1.2);
    let elbow = (f64::cos(limit), f64::sin(limit));
    let best = f64::atan2(y - elbow.1, x - elbow.0) - limit;
    let settings = Settings {
        scale: 100.0,
        prior: 1e-9,
        ..Settings::default()
    };
    let limited = planar([(-1.0, limit), FREE]);
    let found = limited.align(&[None, at(x, y)], &[0.0, 0.0], &settings);
    assert_eq!(found.pose[0], limit);
    assert!((found.pose[1] - best).abs() < 1e-4, "{found:?}, not {best}");
}

/// Turning and sliding joints, one that follows a leader backwards, and skew axes.
fn mixed() -> Robot {
    let axis = |x, y, z| Unit::new_normalize(Vector3::new(x, y, z));
    let follow = Mimic {
        leader: 0,
        multiplier: -0.7,
        offset: 0.2,
    };
    let joints = [
        (
            Motion::Revolute(axis(0.3, -1.0, 0.2)),
            [0.1, 0.0, 0.4],
            FREE,
            None,
        ),
        (
            Motion::Prismatic(axis(1.0, 0.5, 0.0)),
            [0.3, 0.2, 0.1],
            (-0.2, 0.4),
            None,
        ),
        (
            Motion::Revolute(axis(0.0, 0.4, 1.0)),
            [0.2, 0.1, 0.3],
            FREE,
            Some(follow),
        ),
        (
            Motion::Revolute(axis(1.0, 0.0, 0.3)),
            [0.0, 0.3, 0.1],
            FREE,
            None,
        ),
    ];
    chain(&joints, [0.1, 0.2, 0.3])
}

#[test]
fn derivatives_are_those_of_finite_differences() {
    let arm = VirtualArm::new(&mixed(), &[0, 1, 2, 3], &[1, 2, 3, 4, 5]);
    assert_eq!(arm.limits.len(), 3);
    let mut stream = random::stream(1, "derivatives", &[]);
    let (mut placed, mut columns) = (Vec::new(), vec![Vector3::zeros(); 3]);
    let h = 1e-6;
    for _ in 0..50 {
        let x = arm.draw(&mut stream);
        arm.place(&x, &mut placed);
        for point in &arm.points {
            columns.fill(Vector3::zeros());
            let position = arm.position(point, &placed);
            arm.differentiate(point, &position, &placed, &mut columns);
            for (i, column) in columns.iter().enumerate() {
                let moved = |by: f64| {
                    let (mut x, mut placed) = (x.clone(), Vec::new());
                    x[i] += by;
                    arm.place(&x, &mut placed);
                    arm.position(point, &placed)
                };
                let difference = (moved(h) - moved(-h)) / (2.0 * h);
                assert!((difference - column).norm() < 1e-8, "{difference} {column}");
            }
        }
    }
}

#[test]
fn positions_are_those_of_the_robot() {
    let robot = mixed();
    let arm = VirtualArm::new(&robot, &[0, 1, 2, 3], &[1, 2, 3, 4, 5]);
    let mut stream = random::stream(1, "positions", &[]);
    for _ in 0..20 {
        let pose = arm.pose(&arm.draw(&mut stream));
        let mut q = pose.clone();
        robot.apply_mimics(&mut q);
        assert_eq!(pose, q);
        let links = robot.forward_kinematics(&q);
        for (ours, link) in arm.positions(&pose).iter().zip(&links[1..]) {
            assert!((ours.coords - link.translation.vector).norm() < 1e-12);
        }
    }
}

/// A joint that is named without its leader moves it all the same.
#[test]
fn sliding_and_following_joints_are_found() {
    for joints in [vec![0, 1, 2, 3], vec![2, 1, 3]] {
        let arm = VirtualArm::new(&mixed(), &joints, &[1, 2, 3, 4, 5]);
        let mut stream = random::stream(2, "mixed", &[]);
        for _ in 0..50 {
            let pose = arm.pose(&arm.draw(&mut stream));
            let target = |position| {
                Some(Target {
                    position,
                    weight: 2.0,
                })
            };
            let targets: Vec<_> = arm.positions(&pose).into_iter().map(target).collect();
            let reference = vec![0.0; joints.len()];
            let found = arm.align(&targets, &reference, &Settings::default());
            for (a, b) in found.pose.iter().zip(&pose) {
                assert!((a - b).abs() < 1e-3, "{:?}, not {pose:?}", found.pose);
            }
        }
    }
}
