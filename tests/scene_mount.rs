//! The camera's pose in a `robot.toml`: its forms, what is put right, what is refused, and whether the arm
//! is in view.

use armpose::camera::Intrinsics;
use armpose::dataset::{SetSpec, generate};
use armpose::random::{Stream, stream, uniform};
use armpose::scene::{ArmView, PoseSampler, PoseSpec, Rig, check_view};
use nalgebra::{
    Isometry3, Matrix3, Matrix4, Point3, Rotation3, Translation3, UnitQuaternion, Vector3,
};
use std::fs;
use std::path::{Path, PathBuf};

fn robots() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/robots")
}

/// The planar arm with this `[camera]` behind its link.
fn rig(mount: &str) -> Result<Rig, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.toml");
    let urdf = robots().join("planar_arm/arm.urdf");
    let text = format!(
        "urdf = '{}'\n[camera]\nlink = \"base\"\n{mount}\n[[arm]]\nname = \"arm\"\nroot = \"upper\"\n\
         tip = \"tip\"\njoints = [\"shoulder\", \"elbow\"]\n",
        urdf.display()
    );
    fs::write(&path, text).unwrap();
    Rig::read(&path).map_err(|e| e.to_string())
}

fn rows(matrix: &Matrix4<f64>, digits: Option<usize>) -> String {
    let number = |x: &f64| match digits {
        None => format!("{x:?}"),
        Some(digits) => format!("{x:.digits$}"),
    };
    let row = |row: usize| -> Vec<String> { matrix.row(row).iter().map(number).collect() };
    let rows: Vec<String> = (0..4).map(|i| format!("[{}]", row(i).join(", "))).collect();
    format!("[{}]", rows.join(", "))
}

fn random_pose(random: &mut Stream) -> Isometry3<f64> {
    let mut three = |far: f64| Vector3::from_fn(|_, _| uniform(random, -far, far));
    Isometry3::new(three(2.0), three(1.8))
}

fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    (a.to_homogeneous() - b.to_homogeneous()).abs().max()
}

#[test]
fn a_pose_is_the_same_in_every_form_and_direction() {
    let mut random = stream(1, "mount", &[]);
    for _ in 0..20 {
        let pose = random_pose(&mut random);
        for (name, pose) in [
            ("camera_from_link", pose),
            ("link_from_camera", pose.inverse()),
        ] {
            let xyz: Vec<f64> = pose.translation.vector.iter().copied().collect();
            let q = pose.rotation.coords;
            let (roll, pitch, yaw) = pose.rotation.euler_angles();
            let forms = [
                rows(&pose.to_homogeneous(), None),
                format!(
                    "{{ xyz = {xyz:?}, quaternion_xyzw = {:?} }}",
                    [q.x, q.y, q.z, q.w]
                ),
                format!(
                    "{{ xyz = {xyz:?}, quaternion_wxyz = {:?} }}",
                    [q.w, q.x, q.y, q.z]
                ),
                format!("{{ xyz = {xyz:?}, rpy = {:?} }}", [roll, pitch, yaw]),
            ];
            for form in forms {
                let rig = rig(&format!("{name} = {form}")).unwrap();
                let expected = match name {
                    "camera_from_link" => pose,
                    _ => pose.inverse(),
                };
                assert!(apart(&rig.camera_from_link, &expected) < 1e-12, "{form}");
                assert!(rig.notes.is_empty());
            }
        }
    }
    // A URDF's angles turn about fixed axes: here first about x, then about z.
    let turned = rig(
        "link_from_camera = { xyz = [1, 2, 3], rpy = [1.5707963267948966, 0, 1.5707963267948966] }",
    );
    let pose = turned.unwrap().camera_from_link.inverse();
    assert!((pose * Point3::new(0.0, 1.0, 0.0) - Point3::new(1.0, 2.0, 4.0)).norm() < 1e-12);
    assert_eq!(rig("").unwrap().camera_from_link, Isometry3::identity());
}

/// Matrices that were good enough before are read to the same bits.
#[test]
fn sound_matrices_are_taken_as_they_always_were() {
    let mut random = stream(2, "mount", &[]);
    for digits in [None, Some(6), Some(4)] {
        for _ in 0..20 {
            let text = rows(&random_pose(&mut random).to_homogeneous(), digits);
            let numbers: Vec<f64> = text
                .split(|c: char| "[], ".contains(c))
                .filter_map(|word| word.parse().ok())
                .collect();
            let matrix = Matrix4::from_row_slice(&numbers);
            let turn: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into_owned();
            let turn = Rotation3::from_matrix(&turn);
            let shift = Translation3::new(matrix[(0, 3)], matrix[(1, 3)], matrix[(2, 3)]);
            let expected =
                Isometry3::from_parts(shift, UnitQuaternion::from_rotation_matrix(&turn));
            let rig = rig(&format!("camera_from_link = {text}")).unwrap();
            assert_eq!(rig.camera_from_link, expected);
            assert!(rig.notes.is_empty());
        }
    }
}

#[test]
fn a_rounded_matrix_becomes_the_nearest_rotation() {
    let mut random = stream(3, "mount", &[]);
    let mut noted = 0;
    for _ in 0..50 {
        let pose = random_pose(&mut random);
        let text = rows(&pose.to_homogeneous(), Some(2));
        let rig = rig(&format!("camera_from_link = {text}")).unwrap();
        let turned = rig.camera_from_link.rotation.angle_to(&pose.rotation);
        assert!(turned.to_degrees() < 0.8, "{}", turned.to_degrees());
        let found = rig.camera_from_link.rotation.to_rotation_matrix();
        assert!((found.matrix() * found.matrix().transpose() - Matrix3::identity()).norm() < 1e-9);
        noted += rig.notes.len();
        assert!(
            rig.notes
                .iter()
                .all(|n| n.contains("camera_from_link is only nearly a rotation"))
        );
    }
    assert!(noted > 40, "{noted}");
}

#[test]
fn what_is_no_pose_is_refused_with_the_reason() {
    for (pose, part) in [
        (
            "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]",
            "determinant is -1: an axis is mirrored",
        ),
        (
            "[[0.001, 0, 0, 0], [0, 0.001, 0, 0], [0, 0, 0.001, 0], [0, 0, 0, 1]]",
            "have the length 0.0010",
        ),
        (
            "[[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
            "lengths 1.000, 2.000 and 1.000",
        ),
        (
            "[[1, 0.3, 0, 0], [0, 0.954, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
            "right angles",
        ),
        (
            "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 2, 3, 1]]",
            "transposed",
        ),
        (
            "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 2]]",
            "last row",
        ),
        (
            "[[1, 0, 0, 1300], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
            "1300 m from its link",
        ),
        (
            "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
            "four rows of four numbers",
        ),
        (
            "[[1, 0, 0, nan], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
            "four numbers",
        ),
        ("3", "a matrix or a table"),
        ("{ xyz = [0, 0, 1] }", "one of quaternion_xyzw"),
        ("{ rpy = [0, 0, 1] }", "must have xyz"),
        (
            "{ xyz = [0, 0, 1], quaternion = [0, 0, 0, 1] }",
            "quaternion is not known",
        ),
        (
            "{ xyz = [0, 0, 1], quaternion_xyzw = [0, 0, 0.5, 1] }",
            "length 1.118",
        ),
        ("{ xyz = [0, 0], rpy = [0, 0, 0] }", "three finite numbers"),
        ("{ xyz = [0, 0, 1], rpy = [0, 0, 90] }", "radians"),
        (
            "{ xyz = [0, 0, 1], rpy = [0, 0, 1], quaternion_xyzw = [0, 0, 0, 1] }",
            "one of",
        ),
    ] {
        for name in ["camera_from_link", "link_from_camera"] {
            let message = rig(&format!("{name} = {pose}")).unwrap_err();
            assert!(
                message.contains(part) && message.contains(name),
                "{message}"
            );
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
    let pose = "{ xyz = [0, 0, 1], rpy = [0, 0, 0] }";
    let both = rig(&format!(
        "camera_from_link = {pose}\nlink_from_camera = {pose}"
    ))
    .unwrap_err();
    assert!(both.contains("give one"), "{both}");
}

const CAMERA: Intrinsics = Intrinsics {
    width: 160,
    height: 120,
    fx: 95.0,
    fy: 95.0,
    cx: 79.5,
    cy: 59.5,
};

/// The pose of the link in the frame of a camera at `eye` that looks at `target`, the link's z upward.
fn looking(eye: [f64; 3], target: [f64; 3]) -> Isometry3<f64> {
    let (eye, target) = (Vector3::from(eye), Vector3::from(target));
    let z = (target - eye).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let turn = Matrix3::from_columns(&[x, z.cross(&x), z]);
    let turn = Rotation3::from_matrix_unchecked(turn);
    let turn = UnitQuaternion::from_rotation_matrix(&turn);
    Isometry3::from_parts(eye.into(), turn).inverse()
}

fn configurations(rig: &Rig) -> Vec<Vec<f64>> {
    let sampler = PoseSampler::new(rig, &PoseSpec::default()).unwrap();
    let sample = |i: u64| sampler.sample(&rig.robot, &mut stream(1, "view", &[i]));
    (0..50).map(sample).collect()
}

fn seen(mount: &str) -> Result<(), String> {
    let rig = rig(mount).unwrap();
    check_view(&rig, 0, &CAMERA, &configurations(&rig)).map_err(|e| e.to_string())
}

/// From all round the arm: where a misread pose shows nothing of it, the reading that shows it is named,
/// be it that which was meant or another that would do as well.
#[test]
fn an_arm_out_of_view_is_told_with_the_convention_that_would_show_it() {
    let matrix = |pose: &Isometry3<f64>| rows(&pose.to_homogeneous(), None);
    let body_from_optical = {
        let turn = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
        Isometry3::from_parts(Translation3::identity(), turn)
    };
    let (mut unseen, mut told) = ([0; 5], [0; 5]);
    for step in 0..12 {
        let angle = 0.3 + 0.5 * f64::from(step);
        let pose = looking([1.9 * angle.cos(), 1.9 * angle.sin(), 1.1], [0.1, 0.0, 0.3]);
        let back = pose.inverse();
        assert_eq!(
            seen(&format!("camera_from_link = {}", matrix(&pose))),
            Ok(())
        );
        assert_eq!(
            seen(&format!("link_from_camera = {}", matrix(&back))),
            Ok(())
        );
        let body = body_from_optical * pose;
        let q = back.rotation.coords;
        let xyz: Vec<f64> = back.translation.vector.iter().copied().collect();
        let wxyz = [q.w, q.x, q.y, q.z];
        let of_body = "of a camera whose frame is one of ROS's bodies (x forward, z up), it would";
        let mounts = [
            (
                format!("camera_from_link = {}", matrix(&back)),
                "as link_from_camera, it would be in view".to_owned(),
            ),
            (
                format!("link_from_camera = {}", matrix(&pose)),
                "as camera_from_link, it would be in view".to_owned(),
            ),
            (
                format!("camera_from_link = {}", matrix(&body)),
                "if its camera's frame is one of ROS's bodies (x forward, z up), it".to_owned(),
            ),
            (
                format!("camera_from_link = {}", matrix(&body.inverse())),
                format!("as link_from_camera {of_body}"),
            ),
            (
                format!("link_from_camera = {{ xyz = {xyz:?}, quaternion_xyzw = {wxyz:?} }}"),
                "as quaternion_wxyz, it would be in view".to_owned(),
            ),
        ];
        for (kind, (mount, reading)) in mounts.iter().enumerate() {
            if let Err(message) = seen(mount) {
                unseen[kind] += 1;
                told[kind] += usize::from(message.contains(reading));
                assert!(message.contains("it would be in view"), "{message}");
                assert!(message.contains("does not see arm \"arm\""), "{message}");
                assert_eq!(message.lines().count(), 1);
            }
        }
    }
    println!("{unseen:?} {told:?}");
    assert!(unseen.iter().all(|&times| times >= 2), "{unseen:?}");
    assert!(
        (0..5).all(|kind| 2 * told[kind] > unseen[kind]),
        "{told:?} of {unseen:?}"
    );
    // Turned round, no convention explains it.
    let away = looking([1.9, 0.5, 1.1], [5.9, 1.5, 1.1]);
    let message = seen(&format!("camera_from_link = {}", matrix(&away))).unwrap_err();
    assert!(
        message.contains("m behind the camera, about x"),
        "{message}"
    );
}

#[test]
fn the_share_in_view_is_counted() {
    let rig = Rig::read(&robots().join("planar_arm/robot.toml")).unwrap();
    let configurations = configurations(&rig);
    let view = |camera: &Intrinsics| {
        ArmView::new((&rig, 0), &rig.camera_from_link, camera, &configurations)
    };
    let whole = view(&CAMERA);
    assert_eq!(whole.in_front, 1.0);
    assert!(
        whole.inside > 0.9 && (whole.middle.z - 1.2).abs() < 0.1,
        "{whole:?}"
    );
    // Of an image of one column nearly nothing is left, of the plane before it all.
    let slit = view(&Intrinsics { width: 1, ..CAMERA });
    assert!(slit.inside < 0.05 && slit.in_front == 1.0);
}

/// The data set is refused at once, with nothing written.
#[test]
fn no_data_set_is_drawn_of_an_arm_out_of_view() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for file in [
        "planar_arm/arm.urdf",
        "planar_arm/robot.toml",
        "planar_arm/set.toml",
        "camera.toml",
    ] {
        fs::create_dir_all(at(file).parent().unwrap()).unwrap();
        fs::copy(robots().join(file), at(file)).unwrap();
    }
    let robot = at("planar_arm/robot.toml");
    let text = fs::read_to_string(&robot).unwrap();
    let above = text.replace("[0, 0, -1, 1.5]", "[0, 0, -1, -1.5]");
    assert_ne!(above, text);
    fs::write(&robot, above).unwrap();
    let spec = SetSpec::read(&at("planar_arm/set.toml")).unwrap();
    let message = generate(&spec, 1, &at("out"), &|_| ())
        .map(drop)
        .unwrap_err()
        .to_string();
    assert!(message.contains("1.80 m behind the camera"), "{message}");
    assert!(!at("out").exists());
}
