//! The chain of the dual-arm robot against independently computed test vectors.

use armpose::robot::Robot;
use nalgebra::{Isometry3, Matrix3, Point3};
use std::path::Path;

fn arm() -> Robot {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm/arm.urdf");
    Robot::from_urdf(&path).unwrap()
}

/// The distal joints of the test vectors count from the straight finger; ours from its fixed bend.
const FIXED_BEND: f64 = 0.655;

/// A configuration with one arm as given (SFE, SAA, HR, EB, WR, WFE, WAA) and the hand of the test
/// vectors. Both spread joints have the same value; the distal joints leave their limits.
fn configuration(robot: &Robot, side: &str, arm: [f64; 7]) -> Vec<f64> {
    let mut q = vec![0.0; robot.dofs()];
    let mut set = |name: &str, value| q[robot.dof(&format!("{side}_{name}")).unwrap()] = value;
    for (name, value) in ["SFE", "SAA", "HR", "EB", "WR", "WFE", "WAA"]
        .iter()
        .zip(arm)
    {
        set(name, value);
    }
    for (name, value) in [
        ("FR", 0.5),
        ("FR2", 0.5),
        ("RF", 0.6),
        ("MF", 0.7),
        ("LF", 0.8),
    ] {
        set(name, value);
    }
    for (name, value) in [("RF2", 0.2), ("MF2", 0.25), ("LF2", 0.3)] {
        set(name, value - FIXED_BEND);
    }
    q
}

fn link_pose(robot: &Robot, poses: &[Isometry3<f64>], name: &str) -> Isometry3<f64> {
    poses[robot.link(name).unwrap_or_else(|| panic!("no link {name}"))]
}

#[track_caller]
fn assert_near(ours: Point3<f64>, expected: [f64; 3], what: &str) {
    let error = (ours - Point3::from(expected)).norm();
    assert!(
        error < 1e-5,
        "{what}: {ours} is {error} m from {expected:?}"
    );
}

type Row = (&'static str, [f64; 7], [[f64; 3]; 7]);

/// In BASE: elbow axis, wrist centre, LOWER_WRIST, PALM, tips of fingers R, M, L.
const ROWS: [Row; 5] = [
    (
        "R",
        [0.0; 7],
        [
            [0.35018, 0.39518, 0.64173],
            [0.35018, 0.35018, 0.34173],
            [0.35018, 0.35018, 0.29378],
            [0.35018, 0.35018, 0.19048],
            [0.22444, 0.44384, 0.11063],
            [0.48232, 0.35018, 0.10014],
            [0.24504, 0.26777, 0.09119],
        ],
    ),
    (
        "R",
        [0.0, -1.5, -2.4, 1.1, -0.6, 0.0, 0.0],
        [
            [0.73726, 0.73447, 1.10798],
            [0.85683, 0.83875, 0.84943],
            [0.87136, 0.85063, 0.8053],
            [0.90266, 0.87623, 0.71024],
            [1.03385, 0.7815, 0.64115],
            [0.8052, 0.92578, 0.59333],
            [1.04243, 0.95724, 0.67018],
        ],
    ),
    (
        "R",
        [0.3, -1.2, -2.0, 1.5, 0.4, -0.5, 0.7],
        [
            [0.64139, 0.76231, 0.96842],
            [0.48507, 0.86357, 0.72897],
            [0.45473, 0.89354, 0.70705],
            [0.38936, 0.95809, 0.65982],
            [0.2177, 0.92179, 0.67313],
            [0.40989, 1.11656, 0.65042],
            [0.30622, 0.92941, 0.5185],
        ],
    ),
    (
        "R",
        [-0.8, -2.2, -3.0, 2.0, -1.5, 0.6, -1.0],
        [
            [0.54347, 0.8157, 1.41634],
            [0.79939, 0.65787, 1.37612],
            [0.84658, 0.65041, 1.38024],
            [0.94823, 0.63434, 1.38912],
            [1.04953, 0.77592, 1.41469],
            [1.01365, 0.50791, 1.46232],
            [1.0643, 0.66689, 1.27435],
        ],
    ),
    (
        "L",
        [0.3, -1.2, -1.97, 1.5, 3.94, -0.48, 0.75],
        [
            [-0.64076, 0.76319, 0.96923],
            [-0.4803, 0.87024, 0.7351],
            [-0.4506, 0.8594, 0.69905],
            [-0.38661, 0.83605, 0.62139],
            [-0.32336, 0.97033, 0.52691],
            [-0.2784, 0.71818, 0.62583],
            [-0.42257, 0.83868, 0.45889],
        ],
    ),
];

#[test]
fn arms_and_hands_stand_where_the_test_vectors_say() {
    let robot = arm();
    for (row, (side, joints, expected)) in ROWS.iter().enumerate() {
        let poses = robot.forward_kinematics(&configuration(&robot, side, *joints));
        let origin = |link: &str| {
            Point3::from(
                link_pose(&robot, &poses, &format!("{side}_{link}"))
                    .translation
                    .vector,
            )
        };
        // The published frame of the last wrist link lies 47.95 mm along its axis.
        let wrist = link_pose(&robot, &poses, &format!("{side}_LOWER_WRIST"));
        let ours = [
            origin("FOREARM"),
            origin("UPPER_WRIST_PITCH"),
            wrist * Point3::new(0.0, 0.0, 0.04795),
            origin("PALM"),
            origin("R_TIP"),
            origin("M_TIP"),
            origin("L_TIP"),
        ];
        for (column, (ours, expected)) in ours.into_iter().zip(expected).enumerate() {
            assert_near(ours, *expected, &format!("row {row}, column {column}"));
        }
    }
}

/// Columns of `base_from_link` compared with the published rotation, entry by entry.
fn assert_rotation(ours: Matrix3<f64>, expected: Matrix3<f64>) {
    let worst = (ours - expected).abs().max();
    assert!(worst < 1e-5, "{ours} is {worst} off {expected}");
}

#[test]
fn the_wrist_is_turned_as_the_test_vectors_say() {
    let robot = arm();
    // LOWER_WRIST of the vectors is a quarter turn about its axis away from ours.
    let ours_from_theirs = Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    for (row, expected) in [
        (
            0,
            Matrix3::new(0.0, -1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0),
        ),
        (
            2,
            Matrix3::new(
                0.50383, -0.58797, -0.63281, -0.11605, -0.77202, 0.62492, -0.85597, -0.24141,
                -0.4572,
            ),
        ),
    ] {
        let (side, joints, _) = ROWS[row];
        let poses = robot.forward_kinematics(&configuration(&robot, side, joints));
        let wrist = link_pose(&robot, &poses, "R_LOWER_WRIST").rotation;
        assert_rotation(
            wrist.to_rotation_matrix().matrix() * ours_from_theirs,
            expected,
        );
    }
}

#[test]
fn the_head_camera_stands_where_the_calibration_says() {
    let robot = arm();
    let mut q = vec![0.0; robot.dofs()];
    q[robot.dof("UTILT").unwrap()] = 0.8;
    let poses = robot.forward_kinematics(&q);
    let camera = link_pose(&robot, &poses, "xtion_depth_optical_frame");
    assert_near(
        camera.translation.vector.into(),
        [0.00894, 0.27943, 1.74123],
        "the camera",
    );
    assert_rotation(
        *camera.rotation.to_rotation_matrix().matrix(),
        Matrix3::new(
            0.99984, 0.00938, -0.01508, 0.01705, -0.74461, 0.66728, -0.00497, -0.66743, -0.74465,
        ),
    );
}

#[test]
fn the_neck_linkage_keeps_the_head_level() {
    let robot = arm();
    let mut q = vec![0.0; robot.dofs()];
    q[robot.dof("LTILT").unwrap()] = 1.0;
    q[robot.dof("UTILT").unwrap()] = 0.975;
    robot.apply_mimics(&mut q);
    let poses = robot.forward_kinematics(&q);
    let camera = link_pose(&robot, &poses, "xtion_depth_optical_frame");
    let expected = Point3::new(0.0089, 0.4089, 1.6534);
    assert!((camera * Point3::origin() - expected).norm() < 2e-4);
}

#[test]
fn a_configuration_starts_with_the_fifteen_joints_of_the_right_arm() {
    let robot = arm();
    let names: Vec<&str> = robot.dof_joints().map(|j| j.name.as_str()).collect();
    let fifteen = [
        "SFE", "SAA", "HR", "EB", "WR", "WFE", "WAA", "FR", "FR2", "RF", "RF2", "MF", "MF2", "LF",
        "LF2",
    ];
    for (side, ours) in ["R", "L"].iter().zip(names.chunks(15)) {
        let expected: Vec<String> = fifteen.iter().map(|n| format!("{side}_{n}")).collect();
        assert_eq!(ours, expected);
    }
    let mut q: Vec<f64> = (0..robot.dofs()).map(|i| 0.1 * i as f64).collect();
    robot.apply_mimics(&mut q);
    let value = |name: &str| q[robot.dof(name).unwrap()];
    assert_eq!(value("R_FR2"), value("R_FR"));
    for finger in ["R_RF", "R_MF", "R_LF", "L_RF", "L_MF", "L_LF"] {
        assert!((value(&format!("{finger}2")) - value(finger) / 3.0).abs() < 1e-12);
    }
}
