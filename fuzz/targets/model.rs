//! A pose forest's file. The hash at its end is put right, or nothing else would ever be looked at.
#![no_main]

use armpose::forest::pose_forest::PoseForest;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use tempfile::TempDir;

static FOLDER: LazyLock<TempDir> = LazyLock::new(|| tempfile::tempdir().unwrap());

fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.path().join("forest.bin");
    let mut file = bytes.to_vec();
    file.extend_from_slice(blake3::hash(bytes).as_bytes());
    std::fs::write(&path, file).unwrap();
    let _ = PoseForest::load(&path);
});
