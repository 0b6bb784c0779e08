//! `armpose dataset render`: a user's own robot from a folder of their own, and cameras that are never
//! mounted twice in quite the same way.

use armpose::camera::{Camera, Photographer};
use armpose::dataset::{DataSet, SetSpec, generate};
use armpose::scene::{CameraJitter, Rig, robot_bodies};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn fixture(robot: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures/robots")
        .join(robot)
        .join("set.toml")
}

fn render(set: &Path, folder: &Path, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_armpose"))
        .args(["dataset", "render"])
        .arg(set)
        .arg("-o")
        .arg(folder)
        .args(more)
        .output()
        .unwrap()
}

fn jittered(translation_m: f64, rotation_deg: f64) -> SetSpec {
    let mut spec = SetSpec::read(&fixture("planar_arm")).unwrap();
    spec.camera_jitter = Some(CameraJitter {
        translation_m,
        rotation_deg,
    });
    spec
}

#[test]
fn four_lines_are_enough_for_a_set() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("images");
    let output = render(&fixture("gripper_arm"), &out, &["--images", "2"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(said.starts_with("2 images in ") && said.lines().count() == 1);
    assert!(out.join("contact-sheet.png").is_file());
    let set = DataSet::open(&out).unwrap();
    set.verify().unwrap();
    assert_eq!((set.len(), set.target_joints().len()), (2, 9));
    for image in 0..2 {
        assert!(set.record().images[image].arms[0] >= 300);
        // The second finger follows the first.
        assert_eq!(set.pose(image)[7], set.pose(image)[8]);
    }
    // The body of link5 is drawn although it has no visual.
    let spec = SetSpec::read(&fixture("gripper_arm")).unwrap();
    let robot = Rig::read(&spec.robot_path()).unwrap().robot;
    assert!(!robot.links[robot.link("link5").unwrap()].mesh.is_empty());

    let again = render(&fixture("gripper_arm"), &out, &[]);
    let message = String::from_utf8_lossy(&again.stderr).into_owned();
    assert_eq!(again.status.code(), Some(2));
    assert!(message.contains("already holds a data set"), "{message}");
    fs::remove_file(out.join("set.json")).unwrap();
    let again = render(&fixture("gripper_arm"), &out, &[]);
    let message = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(message.contains("never finished"), "{message}");
}

/// The lines of the help text that are indented below the line that starts with `title`.
fn example(help: &str, title: &str) -> String {
    let lines = help.lines().skip_while(|line| !line.starts_with(title));
    let below = lines
        .skip(1)
        .take_while(|l| l.is_empty() || l.starts_with(' '));
    below.collect::<Vec<_>>().join("\n")
}

#[test]
fn the_examples_of_the_help_are_sound_and_its_defaults_are_the_defaults() {
    let help = Command::new(env!("CARGO_BIN_EXE_armpose"))
        .args(["dataset", "render", "--help"])
        .output()
        .unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("my_set.toml");
    let read = |text: &str| {
        fs::write(&path, text).unwrap();
        SetSpec::read(&path).unwrap()
    };
    let text = example(&help, "my_set.toml");
    let mut shown = read(&text);
    let four: Vec<&str> = text.lines().filter(|l| !l.is_empty()).take(4).collect();
    let shortest = read(&four.join("\n"));
    assert!(shown.camera_jitter.take().is_some());
    assert_eq!(shown, shortest);

    fs::write(&path, example(&help, "my_camera.toml")).unwrap();
    Camera::read(&path).unwrap();
    let robot = example(&help, "my_robot.toml");
    let urdf = fixture("gripper_arm").with_file_name("arm.urdf");
    let robot = robot.replace("my.urdf", urdf.to_str().unwrap());
    fs::write(&path, robot.replace("\"base\"", "\"link0\"")).unwrap();
    let rig = Rig::read(&path).unwrap();
    let rest = rig.robot.forward_kinematics(&rig.robot.rest());
    let root_from_camera = rig.camera_from_root(&rest).inverse();
    let expected = nalgebra::Vector3::new(-1.5, 0.0, 0.4);
    assert!((root_from_camera.translation.vector - expected).norm() < 1e-12);
    let ahead = root_from_camera * nalgebra::Vector3::z();
    assert!((ahead - nalgebra::Vector3::x()).norm() < 1e-12);
}

#[test]
fn what_fails_leaves_the_folder_free_for_the_next_attempt() {
    let folder = tempfile::tempdir().unwrap();
    let mut spec = SetSpec::read(&fixture("planar_arm")).unwrap();
    spec.visibility.robot_pixels = 160 * 120;
    let error = generate(&spec, 1, folder.path(), &|_| {}).unwrap_err();
    assert!(error.to_string().contains("of 2000 frames"), "{error}");
    spec.visibility.robot_pixels = 300;
    generate(&spec, 1, folder.path(), &|_| {}).unwrap();
    for (floor, height) in [(2.0, [2.4, 3.0]), (0.0, [1.0, 3.0])] {
        (spec.room.floor, spec.room.height) = (floor, height);
        let elsewhere = folder.path().join("elsewhere");
        let error = generate(&spec, 1, &elsewhere, &|_| {}).unwrap_err();
        assert!(error.to_string().contains("between floor and"), "{error}");
        assert!(!elsewhere.exists());
    }
}

#[test]
fn posed_before_its_own_camera_the_robot_covers_the_same_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let spec = jittered(0.1, 10.0);
    let set = generate(&spec, 1, folder.path(), &|_| {}).unwrap();
    let rig = Rig::read(&spec.robot_path()).unwrap();
    let mut photographer = Photographer::new(&Camera::read(&spec.camera_path()).unwrap());
    let nominal = rig.camera_from_root(&rig.robot.forward_kinematics(&[0.0; 2]));
    assert!((nominal.to_homogeneous() - set.camera_from_root().to_homogeneous()).norm() < 1e-12);
    for image in 0..set.len() {
        let camera_from_root = set.camera_from_root_of(image);
        let displaced = camera_from_root * nominal.inverse();
        let angle = displaced.rotation.angle();
        assert!(angle > 0.0 && angle <= 10f64.to_radians() + 1e-9);
        let q = set.configuration(image, &rig.robot).unwrap();
        let poses = rig.robot.forward_kinematics(&q);
        let drawn = photographer.draw(&robot_bodies(&rig, &poses, camera_from_root));
        let seen = set.frame(image).unwrap().labels;
        // A pixel on an edge may round either way, as the camera's pose went through a matrix.
        let differ = (seen.pixels.iter().zip(&drawn.labels.pixels)).filter(|(a, b)| a != b);
        assert!(differ.count() <= 2);
    }
    let broken = fs::read_to_string(folder.path().join("set.json")).unwrap();
    let broken = broken.replacen("\"camera_from_root\"", "\"camera\"", 1);
    fs::write(folder.path().join("set.json"), broken).unwrap();
    let error = DataSet::open(folder.path()).unwrap_err().to_string();
    assert!(error.contains("camera_from_root"), "{error}");
}

#[test]
fn jitter_moves_the_camera_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let make =
        |name: &str, spec: &SetSpec| generate(spec, 1, &folder.path().join(name), &|_| {}).unwrap();
    let still = make("still", &SetSpec::read(&fixture("planar_arm")).unwrap());
    let none = make("none", &jittered(0.0, 0.0));
    let much = make("much", &jittered(0.05, 3.0));
    let text = fs::read_to_string(still.folder().join("set.json")).unwrap();
    assert!(!text.contains("jitter") && !text.contains("camera_from_root"));
    for image in 0..still.len() {
        assert_eq!(still.frame(image).unwrap(), none.frame(image).unwrap());
        assert_eq!(still.camera_from_root_of(image), still.camera_from_root());
        assert_eq!(still.pose(image), much.pose(image));
        assert_ne!(still.frame(image).unwrap(), much.frame(image).unwrap());
    }
    assert_eq!(still.camera(), much.camera());
    let wild = generate(
        &jittered(-0.1, 0.0),
        1,
        &folder.path().join("wild"),
        &|_| {},
    );
    assert!(wild.unwrap_err().to_string().contains("camera_jitter"));
}
