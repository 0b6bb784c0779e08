//! `armpose init`: from a URDF to the files of a set.

use armpose::camera::Camera;
use armpose::dataset::SetSpec;
use armpose::robot::Robot;
use armpose::scene::Rig;
use armpose::scene::proposal::{limbs, ranges};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn armpose(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_armpose"))
        .args(arguments)
        .output()
        .unwrap()
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// From nothing but the URDF: the three files are sound, and images can be drawn from them.
#[test]
fn what_is_proposed_can_be_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let camera = fixture("cases/cameras/rs_intrinsics.json");
    for (robot, tip, joints, more) in [
        ("gripper_arm", "hand_tcp", 7, &[][..]),
        (
            "planar_arm",
            "tip",
            2,
            &["--camera", text(&camera), "--sensor", "stereo"],
        ),
    ] {
        let urdf = fixture("robots").join(robot).join("arm.urdf");
        let out = folder.path().join(robot);
        let init = [&["init", text(&urdf), "-o", text(&out)], more].concat();
        let output = armpose(&init);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let rig = Rig::read(&out.join("robot.toml")).unwrap();
        let arm = &rig.arms[0];
        assert_eq!(rig.robot.links[arm.tip].name, tip);
        assert_eq!(arm.joints.len(), joints);
        let set = SetSpec::read(&out.join("set.toml")).unwrap();
        let read = Camera::read(&set.camera_path()).unwrap();
        let width = if more.is_empty() { 640 } else { 320 };
        assert_eq!(read.intrinsics.width, width);
        let images = out.join("images");
        let set = out.join("set.toml");
        let render = [
            "dataset",
            "render",
            text(&set),
            "-o",
            text(&images),
            "--images",
            "4",
        ];
        let output = armpose(&render);
        assert_eq!(output.status.code(), Some(0), "{output:?}");

        // Nobody's files are replaced.
        let before = fs::read(&set).unwrap();
        let output = armpose(&init);
        assert_eq!(output.status.code(), Some(2));
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains("robot.toml exists already"), "{said}");
        assert_eq!(fs::read(&set).unwrap(), before);
    }
}

fn robot(joints: &[(&str, &str, &str, &str)]) -> Robot {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.urdf");
    let mut links: Vec<&str> = joints.iter().flat_map(|j| [j.1, j.2]).collect();
    links.sort_unstable();
    links.dedup();
    let mut urdf = "<robot name='r'>".to_owned();
    for link in links {
        urdf.push_str(&format!(
            "<link name='{link}'><visual><geometry><box size='.1 .1 .1'/></geometry></visual></link>"
        ));
    }
    for (name, parent, child, kind) in joints {
        urdf.push_str(&format!(
            "<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>\
             <origin xyz='0 0 .3'/><axis xyz='0 1 0'/><limit lower='-1' upper='1'/></joint>"
        ));
    }
    fs::write(&path, urdf + "</robot>").unwrap();
    Robot::from_urdf(&path).unwrap()
}

/// Limbs branch off the torso; fingers do not make limbs; arms come before legs however many joints
/// these have.
#[test]
fn limbs_are_told_apart() {
    let mut joints = vec![("waist", "pelvis", "torso", "revolute")];
    let arm = [
        ("l_arm_1", "torso", "l_arm_link1", "revolute"),
        ("l_arm_2", "l_arm_link1", "l_arm_link2", "revolute"),
        ("l_arm_3", "l_arm_link2", "l_arm_link3", "continuous"),
        ("l_arm_4", "l_arm_link3", "l_hand", "revolute"),
        ("l_finger_1", "l_hand", "l_finger1", "revolute"),
        ("l_finger_2", "l_hand", "l_finger2", "prismatic"),
        ("l_tool", "l_hand", "l_tool_tcp", "fixed"),
    ];
    let leg = [
        ("leg_1", "pelvis", "leg_link1", "revolute"),
        ("leg_2", "leg_link1", "leg_link2", "revolute"),
        ("leg_3", "leg_link2", "leg_link3", "revolute"),
        ("leg_4", "leg_link3", "leg_link4", "revolute"),
        ("leg_5", "leg_link4", "leg_link5", "revolute"),
        ("leg_6", "leg_link5", "foot", "revolute"),
    ];
    let head = [("neck", "torso", "head", "revolute")];
    joints.extend(arm.iter().chain(&leg).chain(&head));
    let robot = robot(&joints);
    let limbs = limbs(&robot);
    let name = |link: usize| robot.links[link].name.as_str();
    let found: Vec<_> = limbs
        .iter()
        .map(|limb| (name(limb.root), name(limb.tip), limb.joints.len()))
        .collect();
    assert_eq!(found[0], ("l_arm_link1", "l_tool_tcp", 4));
    assert!(found.contains(&("leg_link1", "foot", 6)), "{found:?}");
    assert!(
        !found.iter().any(|limb| limb.1.contains("finger")),
        "{found:?}"
    );
    // Only the joint without limits is narrowed.
    let ranges = ranges(&robot, &limbs[0]);
    assert_eq!(ranges.keys().collect::<Vec<_>>(), ["l_arm_3"]);
    assert_eq!(ranges["l_arm_3"], [-1.57, 1.57]);
}

#[test]
fn a_robot_that_does_not_move_has_no_arm() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stool.urdf");
    fs::write(
        &path,
        "<robot name='stool'><link name='seat'><visual><geometry><box size='.4 .4 .4'/></geometry></visual></link></robot>",
    )
    .unwrap();
    let out = folder.path().join("files");
    let output = armpose(&["init", text(&path), "-o", text(&out)]);
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(
        said.contains("no joint of the robot moves") && said.lines().count() == 1,
        "{said}"
    );
    assert!(!out.exists());
}
