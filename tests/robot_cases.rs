//! Small robots as people have them, each with the right answer (tests/fixtures/cases/robots). The box in
//! every mesh is 0.1 x 0.05 x 0.02 m with a corner at its origin, unless said otherwise.

use armpose::robot::{Mesh, Robot, RobotError};
use std::path::{Path, PathBuf};
use std::process::Command;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/cases/robots")
}

fn read(name: &str) -> Result<Robot, RobotError> {
    Robot::from_urdf(&folder().join(name))
}

/// The robot, of which nothing is to be said.
fn clean(name: &str) -> Robot {
    let robot = read(&format!("{name}.urdf")).unwrap();
    assert!(robot.warnings.is_empty(), "{name}: {:?}", robot.warnings);
    assert!(robot.notes.is_empty(), "{name}: {:?}", robot.notes);
    robot
}

fn arm(robot: &Robot) -> &Mesh {
    &robot.links[robot.link("arm").unwrap()].mesh
}

fn refused(name: &str) -> String {
    let error = read(name).map(drop).expect_err(name).to_string();
    assert!(!error.contains('\n') && error.len() < 600, "{error}");
    error
}

/// Fails unless the mesh has that many triangles and bounds, m.
fn is(mesh: &Mesh, triangles: usize, low: [f32; 3], high: [f32; 3], name: &str) {
    assert_eq!(mesh.triangles.len(), triangles, "{name}");
    let bounds = mesh.bounds().unwrap();
    let pairs = [(bounds.0, low), (bounds.1, high)];
    for (x, expected) in pairs.iter().flat_map(|(a, b)| a.iter().zip(b)) {
        assert!((x - expected).abs() < 1e-6, "{name}: {bounds:?}");
    }
}

#[test]
fn collada_is_drawn_where_its_scene_says() {
    let at = |x: f32, y: f32, z: f32| ([x, y, z], [x + 0.1, y + 0.05, z + 0.02]);
    for (name, (low, high)) in [
        ("dae_small_offset", at(0.0, 0.0, 0.0095)),
        // A quarter turn about z.
        ("dae_chain", ([-0.05, 0.3, 0.0], [0.0, 0.4, 0.02])),
        ("dae_unit_translate", at(0.0, 0.0, 0.1)),
        ("dae_instance_node", at(0.0, 0.0, 0.2)),
    ] {
        is(arm(&clean(name)), 12, low, high, name);
    }
    let millimetres = clean("dae_instance_node_mm");
    is(arm(&millimetres), 12, [0.0; 3], [0.01, 0.005, 0.002], "mm");
    let twice = clean("dae_instanced_twice");
    let pieces = arm(&twice).components();
    assert_eq!(pieces.len(), 2);
    assert!(pieces.iter().all(|piece| piece.triangles.len() == 12));
    let orphan = clean("dae_orphan");
    assert_eq!(arm(&orphan).triangles.len(), 12);
    let two = clean("dae_same_id_in_two_meshes");
    is(arm(&two), 24, [0.0; 3], [0.3, 0.05, 0.02], "same ids");
}

#[test]
fn stl_and_obj_are_read_as_exporters_write_them() {
    for name in [
        "stl_solid_12",
        "stl_plain_binary",
        "stl_ascii_upper",
        "obj_cont",
        "u_percent",
        "u_file_rel",
    ] {
        is(arm(&clean(name)), 12, [0.0; 3], [0.1, 0.05, 0.02], name);
    }
    // After a comment that ends like a line that goes on.
    let text = std::fs::read_to_string(folder().join("obj_cont.obj")).unwrap();
    let temporary = tempfile::tempdir().unwrap();
    let at = |name: &str| temporary.path().join(name);
    std::fs::write(at("obj_cont.obj"), format!("# C:\\parts\\\n{text}")).unwrap();
    std::fs::copy(folder().join("obj_cont.urdf"), at("robot.urdf")).unwrap();
    let robot = Robot::from_urdf(&at("robot.urdf")).unwrap();
    is(arm(&robot), 12, [0.0; 3], [0.1, 0.05, 0.02], "comment");
    // A triangle stands twice.
    is(
        arm(&clean("stl_solid_13")),
        13,
        [0.0; 3],
        [0.1, 0.05, 0.02],
        "13",
    );
}

#[test]
fn what_does_not_matter_to_depth_is_not_looked_at() {
    for name in [
        "u_empty_texture",
        "u_two_materials",
        "u_no_effort",
        "u_axis_no_xyz",
    ] {
        let robot = clean(name);
        is(arm(&robot), 12, [-0.05; 3], [0.05; 3], name);
        assert_eq!(robot.joints[0].limits, (-1.0, 1.0));
    }
    let joint = &clean("u_axis_no_xyz").joints[0];
    let turned = joint.parent_from_child(1.0).rotation.axis().unwrap();
    assert!(
        (turned.x - 1.0).abs() < 1e-12,
        "the axis of a joint is x unless it says another"
    );
}

#[test]
fn shapes_without_a_size_are_no_body() {
    for name in ["u_zero_box", "u_cyl_extra"] {
        let robot = read(&format!("{name}.urdf")).unwrap();
        assert!(arm(&robot).is_empty());
        assert_eq!(robot.notes.len(), 1);
        assert!(robot.notes[0].contains("link \"arm\""), "{:?}", robot.notes);
    }
}

#[test]
fn a_follower_has_the_limits_of_its_leader() {
    let robot = clean("u_mimic_no_limit");
    let follower = robot.joints.iter().find(|j| j.name == "fj").unwrap();
    assert_eq!(follower.limits, (-1.0, 1.0));
    assert!(refused("u_no_limit.urdf").contains("joint \"j\" has no usable limits; add <limit"));
}

#[test]
fn a_collision_shape_stands_in_for_a_visual_that_cannot_be_read() {
    let missing = refused("u_missing_visual_with_collision.urdf");
    // The file has no collision shape; with one, it is read.
    assert!(
        missing.contains("cannot use mesh \"gone.dae\": there is no file"),
        "{missing}"
    );
    let text = std::fs::read_to_string(folder().join("u_missing_visual_with_collision.urdf"));
    let visual = "<visual><geometry><mesh filename=\"gone.dae\"/></geometry></visual>";
    let with =
        format!("{visual}<collision><geometry><box size=\".2 .2 .2\"/></geometry></collision>");
    let text = text.unwrap();
    assert!(text.contains(visual));
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("robot.urdf");
    std::fs::write(&path, text.replace(visual, &with)).unwrap();
    let robot = Robot::from_urdf(&path).unwrap();
    is(arm(&robot), 12, [-0.1; 3], [0.1; 3], "collision");
    assert!(
        robot.notes[0].contains("its collision shape stands in"),
        "{:?}",
        robot.notes
    );
}

#[test]
fn formats_that_are_not_read_are_named() {
    for (name, part) in [
        (
            "u_glb.urdf",
            ".glb files are not read; convert the mesh to STL, OBJ or COLLADA",
        ),
        (
            "u_ply.urdf",
            ".ply files are not read; convert the mesh to STL, OBJ or COLLADA",
        ),
        ("u_sdf.sdf", "this is an SDF file"),
        ("u_mjcf.xml", "this is an MJCF file"),
    ] {
        let message = refused(name);
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn numbers_in_another_unit_are_warned_of() {
    for (name, part) in [
        (
            "u_mm_small",
            "is 15.0 m large, and all else spans 0.10 m: it is probably in millimetres",
        ),
        (
            "u_limit_degrees",
            "from -170 to 170 rad: these limits are probably in degrees",
        ),
    ] {
        let path = folder().join(format!("{name}.urdf"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_armpose"));
        let output = command
            .args(["robot", "inspect"])
            .arg(path)
            .output()
            .unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(
            text.starts_with("warning: ") && text.contains(part),
            "{text}"
        );
    }
}

#[test]
fn what_a_robot_is_can_be_read_by_programs() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_armpose"));
    let file = folder().join("u_mimic_no_limit.urdf");
    let output = command
        .args(["robot", "inspect", "--json"])
        .arg(file)
        .output()
        .unwrap();
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(told["links"][1]["name"], "arm");
    assert_eq!(
        told["links"][1]["pose"][2],
        serde_json::json!([0.0, 0.0, 1.0, 0.1])
    );
    assert_eq!(told["links"][1]["triangles"], 12);
    assert!((told["links"][1]["area"].as_f64().unwrap() - 0.06).abs() < 1e-6);
    let follower = &told["joints"][1];
    assert_eq!(follower["mimic"]["joint"], "j");
    assert_eq!(follower["mimic"]["multiplier"], -1.0);
    assert_eq!(follower["limits"], serde_json::json!([-1.0, 1.0]));
}

/// Reads a robot of the links "a" and "b" with these bodies, and this joint between them.
fn two_links(a: &str, b: &str, joint: &str) -> Result<Robot, RobotError> {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("robot.urdf");
    std::fs::copy(
        folder().join("sub/part.Stl"),
        temporary.path().join("part.Stl"),
    )
    .unwrap();
    let text = format!(
        "<robot><link name=\"a\">{a}</link><link name=\"b\">{b}</link>{joint}<gazebo>\
         <undeclared:plugin x:y=\"1\"/></gazebo></robot>"
    );
    std::fs::write(&path, text).unwrap();
    Robot::from_urdf(&path)
}

fn joint(kind: &str, limit: &str) -> String {
    format!(
        "<joint name=\"j\" type=\"{kind}\"><parent link=\"a\"/><child link=\"b\"/>{limit}</joint>"
    )
}

fn body(geometry: &str) -> String {
    format!("<visual><geometry>{geometry}</geometry></visual>")
}

#[test]
fn joints_with_more_freedom_are_held_and_limits_beyond_reason_are_none() {
    for kind in ["floating", "planar", "spherical"] {
        let robot = two_links("", "", &joint(kind, "")).unwrap();
        assert_eq!(robot.dofs(), 0);
        assert!(robot.notes[0].contains(&format!("joint \"j\" is {kind}")));
    }
    let limit = |lower: &str, upper: &str| format!("<limit lower=\"{lower}\" upper=\"{upper}\"/>");
    let endless = joint("revolute", &limit("-1e+16", "1e+16"));
    let robot = two_links("", "", &endless).unwrap();
    assert!(robot.joints[0].is_circular() && robot.notes.len() == 1);
    for (lower, upper) in [("-1e+16", "1"), ("nan", "1"), ("1", "-1"), ("one", "2")] {
        assert!(two_links("", "", &joint("revolute", &limit(lower, upper))).is_err());
    }
    // One that is left out is 0, as both are where a joint is locked.
    let robot = two_links("", "", &joint("revolute", "<limit upper=\"2\"/>")).unwrap();
    assert_eq!(robot.joints[0].limits, (0.0, 2.0));
    let robot = two_links("", "", &joint("prismatic", &limit("0", "0"))).unwrap();
    assert_eq!(robot.joints[0].limits, (0.0, 0.0));
    let long = two_links("", "", &joint("prismatic", &limit("0", "50"))).unwrap();
    assert!(long.warnings[0].contains("are its limits in millimetres?"));
    let turns = two_links("", "", &joint("revolute", &limit("-12.6", "12.6"))).unwrap();
    assert!(turns.warnings.is_empty());
}

#[test]
fn a_scale_is_advised_only_where_the_file_says_no_unit() {
    let fixed = joint("fixed", "");
    let scaled = |scale: &str| format!("<mesh filename=\"part.Stl\" scale=\"{scale}\"/>");
    let robot = two_links(&body(&scaled("2 2 2")), "", &fixed).unwrap();
    is(
        &robot.links[0].mesh,
        12,
        [0.0; 3],
        [0.2, 0.1, 0.04],
        "part.Stl",
    );
    let told = |geometry: &str| {
        let error = two_links(&body(geometry), "", &fixed).map(drop);
        error.unwrap_err().to_string()
    };
    let message = told(&scaled("1000 1000 1000"));
    assert!(
        message.contains("100.0 x 50.0 x 20.0 m large; check the scale"),
        "{message}"
    );
    assert!(told("<box size=\"300 80 80\"/>").contains("check its size, which is in metres"));
    let big = folder().join("dae_chain.dae");
    let dae = |scale| format!("<mesh filename=\"{}\" scale=\"{scale}\"/>", big.display());
    let message = told(&dae("1e3 1e3 1e3"));
    assert!(
        message.contains("the file says its unit") && !message.contains("0.001"),
        "{message}"
    );
    assert!(told("<ellipsoid/>").contains("<ellipsoid>, which is not read"));
    assert!(told("<sphere radius=\"x\"/>").contains("radius=\"x\", which should be 1 number"));
    assert!(told("<sphere/>").contains("has no radius"));
}
