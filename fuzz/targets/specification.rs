//! The TOML files of a data set, a robot and a camera; the first byte says which.
#![no_main]

use armpose::camera::Camera;
use armpose::dataset::SetSpec;
use armpose::scene::Rig;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let urdf = include_str!("../../tests/fixtures/robots/planar_arm/arm.urdf");
    std::fs::write(folder.path().join("arm.urdf"), urdf).unwrap();
    folder
});

fuzz_target!(|bytes: &[u8]| {
    let Some((first, rest)) = bytes.split_first() else {
        return;
    };
    let path = FOLDER.path().join("file.toml");
    std::fs::write(&path, rest).unwrap();
    match first % 3 {
        0 => drop(SetSpec::read(&path)),
        1 => drop(Rig::read(&path)),
        _ => drop(Camera::read(&path)),
    }
});
