//! A URDF file, and everything that `armpose robot inspect` makes of it.
#![no_main]

use armpose::robot::Robot;
use armpose::scene::inspect::remarks;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.path().join("robot.urdf");
    std::fs::write(&path, bytes).unwrap();
    if let Ok(robot) = Robot::from_urdf(&path) {
        let poses = robot.forward_kinematics(&robot.rest());
        assert!(
            poses
                .iter()
                .all(|pose| pose.translation.vector.norm().is_finite())
        );
        let _ = remarks(&robot);
    }
});
