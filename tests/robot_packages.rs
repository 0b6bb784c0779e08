//! Robots whose meshes lie in packages, and robots written in xacro.

use armpose::robot::{Packages, Robot};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/cases/robots")
}

/// Fails unless the link "arm" has the box of 0.1 x 0.05 x 0.02 m.
fn has_the_box(robot: &Robot) {
    let mesh = &robot.links[robot.link("arm").unwrap()].mesh;
    assert_eq!(mesh.triangles.len(), 12);
    assert_eq!(mesh.bounds(), Some(([0.0; 3], [0.1, 0.05, 0.02])));
}

#[test]
fn a_package_is_found_where_it_is_said_to_be() {
    let error = Robot::from_urdf(&folder().join("u_pkg_elsewhere.urdf")).map(drop);
    let message = error.unwrap_err().to_string();
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
    has_the_box(&robot);
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
    has_the_box(&rig.robot);
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
    has_the_box(&robot);
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
