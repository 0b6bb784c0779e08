//! Files that are wrong in ways that once mattered, or that attack whoever reads them: each is refused
//! with one line, soon, and without taking much memory.

use armpose::camera::Intrinsics;
use armpose::camera::depth_file::{Units, read_depth_file};
use armpose::camera::png::{read_depth, read_labels};
use armpose::robot::Robot;
use std::path::{Path, PathBuf};

/// The files whose names end like this.
fn files(ending: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/malformed");
    let entries = std::fs::read_dir(folder).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = paths
        .filter(|path| path.to_string_lossy().ends_with(ending))
        .collect();
    files.sort();
    assert!(!files.is_empty());
    files
}

fn is_one_line(message: &str, path: &Path) {
    assert!(!message.contains('\n'), "{}: {message}", path.display());
    assert!(message.len() < 1000, "{}: {message}", path.display());
}

#[test]
fn robots() {
    for path in files(".urdf") {
        let error = Robot::from_urdf(&path)
            .map(drop)
            .expect_err(&path.to_string_lossy());
        is_one_line(&error.to_string(), &path);
    }
}

#[test]
fn meshes() {
    let folder = tempfile::tempdir().unwrap();
    for path in [".stl", ".obj", ".dae"].into_iter().flat_map(files) {
        let urdf = format!(
            "<robot name=\"r\"><link name=\"a\"><visual><geometry><mesh filename=\"{}\"/></geometry>\
             </visual></link></robot>",
            path.display()
        );
        let robot = folder.path().join("robot.urdf");
        std::fs::write(&robot, urdf).unwrap();
        let error = Robot::from_urdf(&robot)
            .map(drop)
            .expect_err(&path.to_string_lossy());
        is_one_line(&error.to_string(), &path);
    }
}

#[test]
fn images() {
    let camera = Intrinsics {
        width: 16,
        height: 12,
        fx: 10.0,
        fy: 10.0,
        cx: 8.0,
        cy: 6.0,
    };
    for path in files(".png") {
        let error = read_depth(&path, &camera).expect_err(&path.to_string_lossy());
        is_one_line(&error.to_string(), &path);
        assert!(read_labels(&path, &camera).is_err());
    }
    for ending in [".npy", ".npz", ".tif", ".exr", ".pgm", ".pfm"] {
        for path in files(ending) {
            for size in [None, Some([8, 6])] {
                let error = read_depth_file(&path, size, Units::default());
                is_one_line(
                    &error.expect_err(&path.to_string_lossy()).to_string(),
                    &path,
                );
            }
        }
    }
    let huge = Intrinsics {
        width: 0x7fff_ffff,
        height: 0x7fff_ffff,
        ..camera
    };
    assert!(huge.mistake().is_some() && camera.mistake().is_none());
}
