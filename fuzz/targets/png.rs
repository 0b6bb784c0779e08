//! A depth image and a label image.
#![no_main]

use armpose::camera::Intrinsics;
use armpose::camera::png::{read_depth, read_labels};
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

const CAMERA: Intrinsics = Intrinsics {
    width: 16,
    height: 12,
    fx: 10.0,
    fy: 10.0,
    cx: 8.0,
    cy: 6.0,
};

fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.path().join("image.png");
    std::fs::write(&path, bytes).unwrap();
    let _ = read_depth(&path, &CAMERA);
    let _ = read_labels(&path, &CAMERA);
});
