//! A mesh file; its first byte says of which kind it is.
#![no_main]

use armpose::robot::Robot;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    for kind in KINDS {
        let urdf = format!(
            "<robot name=\"r\"><link name=\"a\"><visual><geometry><mesh filename=\"mesh.{kind}\"/>\
             </geometry></visual></link></robot>"
        );
        std::fs::write(folder.path().join(format!("{kind}.urdf")), urdf).unwrap();
    }
    folder
});

const KINDS: [&str; 3] = ["stl", "obj", "dae"];

fuzz_target!(|bytes: &[u8]| {
    let Some((first, rest)) = bytes.split_first() else {
        return;
    };
    let kind = KINDS[usize::from(*first) % KINDS.len()];
    std::fs::write(FOLDER.path().join(format!("mesh.{kind}")), rest).unwrap();
    if let Ok(robot) = Robot::from_urdf(&FOLDER.path().join(format!("{kind}.urdf"))) {
        assert!(!robot.links[0].mesh.is_empty());
        let _ = robot.links[0].mesh.components();
    }
});
