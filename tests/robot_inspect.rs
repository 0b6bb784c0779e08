//! `armpose robot inspect`, and the robots that other tests use.

use armpose::random::{stream, uniform};
use armpose::robot::Robot;
use armpose::scene::inspect::remarks;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn fixture(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures/robots")
        .join(file)
}

fn inspect(robot: &Path, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_armpose"))
        .args(["robot", "inspect"])
        .arg(robot)
        .args(more)
        .output()
        .unwrap()
}

fn said(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// The words of the line that starts with `name`.
fn row<'a>(text: &'a str, name: &str) -> Vec<&'a str> {
    let mut lines = text.lines().map(|line| line.split_whitespace().collect());
    let of_name = |words: &Vec<&str>| words.first() == Some(&name);
    lines.find(of_name).unwrap()
}

#[test]
fn joints_links_and_arms_are_shown() {
    let text = said(&inspect(&fixture("gripper_arm/robot.toml"), &[]));
    let first = "robot gripper_arm: 12 links, 11 joints, of which 9 move; ";
    assert!(text.starts_with(first), "{text}");
    let row = |name: &str| row(&text, name).join(" ");
    assert_eq!(
        row("joint4"),
        "joint4 revolute link3 link4 -3.072 -0.0698 rad -176 to -4"
    );
    assert_eq!(
        row("finger_joint2"),
        "finger_joint2 prismatic hand finger2 0 0.04 m finger_joint1"
    );
    assert_eq!(row("hand_joint"), "hand_joint fixed link7 hand");
    assert_eq!(row("finger1"), "finger1 9 12 0.020 x 0.020 x 0.050");
    assert_eq!(row("hand_tcp"), "hand_tcp 9 0 no body");
    assert!(
        text.contains("\narm arm: 11 links from link1, tip hand_tcp\n  pose: joint1, joint2, ")
    );
    assert!(text.ends_with("nothing to remark\n"), "{text}");
}

#[test]
fn the_picture_shows_the_robot_and_nothing_cut_off() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("robot.png");
    let more = ["--picture", picture.to_str().unwrap()];
    let text = said(&inspect(&fixture("planar_arm/arm.urdf"), &more));
    assert!(text.contains("note: joint \"shoulder\": it reaches (nearly) all angles"));
    let file = std::io::BufReader::new(std::fs::File::open(&picture).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let (width, height) = (info.width as usize, info.height as usize);
    let lit = |x: usize, y: usize| pixels[(y * width + x) * 3..][..3] != [0; 3];
    let count = (0..width * height).filter(|&at| lit(at % width, at / width));
    assert!(count.count() > width * height / 30);
    assert!((0..width).all(|x| !lit(x, 0) && !lit(x, height - 1)));
    assert!((0..height).all(|y| !lit(0, y) && !lit(width - 1, y)));

    let nowhere = folder.path().join("no/robot.png");
    let output = inspect(
        &fixture("planar_arm/arm.urdf"),
        &["--picture", nowhere.to_str().unwrap()],
    );
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.starts_with("armpose: cannot write ") && message.lines().count() == 1);
}

#[test]
fn what_cannot_be_read_is_told_in_a_line() {
    for (robot, part) in [
        ("no.urdf", "no.urdf: cannot read the robot description"),
        ("no.toml", "cannot read"),
        ("camera.toml", "unknown field `intrinsics`"),
        (
            "gripper_arm/robot.toml/arm.urdf",
            "cannot read the robot description",
        ),
    ] {
        let output = inspect(&fixture(robot), &[]);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn surprises_are_remarked() {
    let folder = tempfile::tempdir().unwrap();
    let remarks_of = |links: &str, joint: &str| {
        let path = folder.path().join("robot.urdf");
        let text = format!("<robot name=\"r\">{links}<link name=\"b\"/>{joint}</robot>");
        std::fs::write(&path, text).unwrap();
        remarks(&Robot::from_urdf(&path).unwrap()).join("\n")
    };
    let body = |size: &str| {
        format!(
            "<link name=\"a\"/><link name=\"c\"><visual><geometry><box size=\"{size}\"/></geometry>\
             </visual></link><joint name=\"f\" type=\"fixed\"><parent link=\"b\"/><child link=\"c\"/>\
             </joint>"
        )
    };
    let joint = |lower: f64, upper: f64| {
        format!(
            "<joint name=\"j\" type=\"revolute\"><parent link=\"a\"/><child link=\"b\"/><axis xyz=\"0 \
             0 1\"/><limit lower=\"{lower}\" upper=\"{upper}\" effort=\"1\" velocity=\"1\"/></joint>"
        )
    };
    let sound = body("1 1 1");
    assert_eq!(remarks_of(&sound, &joint(-1.0, 1.0)), "");
    for (links, joint, part) in [
        (
            "<link name=\"a\"/>",
            joint(-1.0, 1.0),
            "nothing can be drawn",
        ),
        (
            "<link name=\"a\"/>",
            joint(-1.0, 1.0),
            "moves no link that has a body",
        ),
        (&sound, joint(-6.3, 6.3), "span 2.01 turns"),
        (&sound, joint(-3.11, 3.11), "nearly"),
        (&sound, joint(1.0, 1.0), "no room to move"),
        (&body("0.01 0.01 0.01"), joint(-1.0, 1.0), "0.010 m across"),
        (&body("15 1 1"), joint(-1.0, 1.0), "15.000 m across"),
    ] {
        let remarks = remarks_of(links, &joint);
        assert!(remarks.contains(part), "{remarks}");
    }
    let follower = "<link name=\"d\"/><joint name=\"k\" type=\"revolute\"><parent link=\"c\"/>\
         <child link=\"d\"/><axis xyz=\"0 0 1\"/><limit lower=\"0\" upper=\"1\" effort=\"1\" \
         velocity=\"1\"/><mimic joint=\"j\" multiplier=\"-2\"/></joint>";
    let remarks = remarks_of(&sound, &(joint(0.0, 1.0) + follower));
    assert!(remarks.contains("values from -2.000 to 0.000"), "{remarks}");
}

#[test]
fn the_fixtures_move_as_their_formulas_say() {
    let planar = Robot::from_urdf(&fixture("planar_arm/arm.urdf")).unwrap();
    let tip = planar.link("tip").unwrap();
    let mut s = stream(1, "planar arm", &[]);
    for _ in 0..100 {
        let [a, b] = [0, 1].map(|_| uniform(&mut s, -4.0, 4.0));
        let at = planar.forward_kinematics(&[a, b])[tip].translation.vector;
        let formula = [
            0.5 * a.cos() + 0.4 * (a + b).cos(),
            0.5 * a.sin() + 0.4 * (a + b).sin(),
            0.3,
        ];
        assert!((at - nalgebra::Vector3::from(formula)).norm() < 1e-12);
    }
    // With all joints at 0 the gripper arm stands upright and its hand points down.
    let gripper = Robot::from_urdf(&fixture("gripper_arm/arm.urdf")).unwrap();
    let mut zero = vec![0.0; 9];
    zero[gripper.dof("finger_joint1").unwrap()] = 0.03;
    gripper.apply_mimics(&mut zero);
    let poses = gripper.forward_kinematics(&zero);
    let at = |link: &str| poses[gripper.link(link).unwrap()].translation.vector;
    let height = 0.333 + 0.316 + 0.384 - 0.107;
    let expected = nalgebra::Vector3::new(0.088, 0.0, height - 0.1034);
    assert!((at("hand_tcp") - expected).norm() < 1e-9);
    let apart = (at("finger1") - at("finger2")).norm();
    assert!((apart - 0.06).abs() < 1e-9, "{apart}");
}

#[test]
fn a_downloaded_robot_is_read() {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let shared = std::env::var_os("ARMPOSE_SHARED").map_or(default, PathBuf::from);
    let urdf = shared.join("robots/xarm7/xarm7.urdf");
    if !urdf.is_file() {
        println!("skipped: there is no {}", urdf.display());
        return;
    }
    let text = said(&inspect(&urdf, &[]));
    assert!(text.starts_with("robot xarm7: 8 links, 7 joints, of which 7 move"));
    assert!(text.contains("joint \"joint1\": it reaches (nearly) all angles"));
    assert!(!text.contains("overlap"), "{text}");
}
