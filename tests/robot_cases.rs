//! Small robots as people have them, each with the right answer (tests/fixtures/cases/robots). The box in
//! every mesh is 0.1 x 0.05 x 0.02 m with a corner at its origin, unless said otherwise.

use armpose::robot::{Mesh, Packages, Robot, RobotError};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

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
fn a_package_is_found_where_it_is_said_to_be() {
    let message = refused("u_pkg_elsewhere.urdf");
    assert!(
        message.contains("--package my_robot_description=DIR"),
        "{message}"
    );
    let elsewhere = tempfile::tempdir().unwrap();
    let package = elsewhere.path().join("src/my_robot_description");
    std::fs::create_dir_all(package.join("meshes")).unwrap();
    std::fs::copy(
        folder().join("sub/part.stl"),
        package.join("meshes/part.stl"),
    )
    .unwrap();
    let urdf = folder().join("u_pkg_elsewhere.urdf");
    let packages = Packages::from([("my_robot_description".to_owned(), package.clone())]);
    let robot = Robot::from_urdf_with(&urdf, &packages).unwrap();
    is(arm(&robot), 12, [0.0; 3], [0.1, 0.05, 0.02], "package");
    assert!(robot.notes.is_empty());

    let inspect = |more: &[&str], variable: &str, value: &Path| -> Output {
        Command::new(env!("CARGO_BIN_EXE_armpose"))
            .args(["robot", "inspect"])
            .arg(&urdf)
            .args(more)
            .env(variable, value)
            .output()
            .unwrap()
    };
    let given = format!("my_robot_description={}", package.display());
    let nowhere = elsewhere.path().join("nowhere");
    for output in [
        inspect(&["--package", &given], "UNUSED", &nowhere),
        inspect(&[], "ROS_PACKAGE_PATH", elsewhere.path()),
        inspect(&[], "ROS_PACKAGE_PATH", &package),
    ] {
        assert_eq!(output.status.code(), Some(0), "{output:?}");
    }
    assert_eq!(
        inspect(&[], "ROS_PACKAGE_PATH", &nowhere).status.code(),
        Some(2)
    );
    // A file that is not in the package is not taken from another one.
    std::fs::remove_file(package.join("meshes/part.stl")).unwrap();
    let output = inspect(&["--package", &given], "UNUSED", &nowhere);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(
        message.contains("there is no file") && message.lines().count() == 1,
        "{message}"
    );
    // An install of ROS 2; and a workspace whose folder has another name.
    let share = elsewhere
        .path()
        .join("install/share/my_robot_description/meshes");
    std::fs::create_dir_all(&share).unwrap();
    std::fs::copy(folder().join("sub/part.stl"), share.join("part.stl")).unwrap();
    let output = inspect(&[], "AMENT_PREFIX_PATH", &elsewhere.path().join("install"));
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}

#[test]
fn a_robot_toml_says_where_packages_are() {
    let folder_of_rig = tempfile::tempdir().unwrap();
    let at = |name: &str| folder_of_rig.path().join(name);
    std::fs::create_dir_all(at("assets/meshes")).unwrap();
    std::fs::copy(folder().join("sub/part.stl"), at("assets/meshes/part.stl")).unwrap();
    std::fs::copy(folder().join("u_pkg_elsewhere.urdf"), at("arm.urdf")).unwrap();
    let rig = "urdf = \"arm.urdf\"\n[packages]\nmy_robot_description = \"assets\"\n[camera]\nlink = \
               \"base\"\n[[arm]]\nname = \"a\"\nroot = \"arm\"\ntip = \"arm\"\njoints = [\"j\"]\n";
    std::fs::write(at("robot.toml"), rig).unwrap();
    let rig = armpose::scene::Rig::read(&at("robot.toml")).unwrap();
    assert_eq!(arm(&rig.robot).triangles.len(), 12);
}

#[test]
fn a_package_is_known_by_its_manifest() {
    let workspace = tempfile::tempdir().unwrap();
    let at = |name: &str| workspace.path().join(name);
    for (package, name) in [("clone-main", "my_robot_description"), ("other", "other")] {
        std::fs::create_dir_all(at(package).join("urdf")).unwrap();
        std::fs::create_dir_all(at(package).join("meshes")).unwrap();
        let manifest = format!("<?xml version=\"1.0\"?><package><name>{name}</name></package>");
        std::fs::write(at(package).join("package.xml"), manifest).unwrap();
        std::fs::copy(
            folder().join("sub/part.stl"),
            at(package).join("meshes/part.stl"),
        )
        .unwrap();
        let urdf = folder().join("u_pkg_elsewhere.urdf");
        std::fs::copy(urdf, at(package).join("urdf/arm.urdf")).unwrap();
    }
    let robot = Robot::from_urdf(&at("clone-main/urdf/arm.urdf")).unwrap();
    assert!(robot.notes.is_empty());
    // There is meshes/part.stl, but it belongs to another package.
    let error = Robot::from_urdf(&at("other/urdf/arm.urdf")).map(drop);
    assert!(
        error
            .unwrap_err()
            .to_string()
            .contains("is not found; say where")
    );
    // Where no manifest speaks against it, the file is taken, and that is told.
    std::fs::remove_file(at("other/package.xml")).unwrap();
    let robot = Robot::from_urdf(&at("other/urdf/arm.urdf")).unwrap();
    assert_eq!(robot.notes.len(), 1);
    assert!(
        robot.notes[0].contains("is taken to be"),
        "{:?}",
        robot.notes
    );
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

/// `armpose robot inspect FILE` with these programs only.
fn inspect_with_path(file: &Path, programs: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_armpose"));
    command.args(["robot", "inspect"]).arg(file);
    command.env("PATH", programs).output().unwrap()
}

#[test]
fn xacro_makes_a_urdf_or_is_asked_for() {
    use std::os::unix::fs::PermissionsExt;
    let programs = tempfile::tempdir().unwrap();
    let file = folder().join("u_xacro.urdf");
    let stderr = |output: Output| {
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    let message = stderr(inspect_with_path(&file, programs.path()));
    assert!(
        message.contains("pip install xacro") && message.lines().count() == 1,
        "{message}"
    );
    let xacro = |script: &str| {
        let path = programs.path().join("xacro");
        std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    };
    let urdf = folder().join("u_no_effort.urdf");
    xacro(&format!("exec /bin/cat '{}'", urdf.display()));
    let output = inspect_with_path(&file, programs.path());
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let own = programs.path().join("robot.urdf.xacro");
    std::fs::write(&own, "anything").unwrap();
    let output = inspect_with_path(&own, programs.path());
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    xacro("echo 'undefined\nsubstitution' >&2; exit 2");
    let message = stderr(inspect_with_path(&file, programs.path()));
    assert!(
        message.contains("xacro failed: undefined substitution"),
        "{message}"
    );
    assert_eq!(message.lines().count(), 1);
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
