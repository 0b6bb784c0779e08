//! Cameras as other tools describe them.

use armpose::camera::camera_file::{self, CameraFileError};
use armpose::camera::{Distortion, Intrinsics, Lens};
use std::fs;
use std::path::{Path, PathBuf};

fn case(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures/cases/cameras")
        .join(name)
}

const PINHOLE: Intrinsics = Intrinsics {
    width: 320,
    height: 240,
    fx: 300.0,
    fy: 301.0,
    cx: 160.5,
    cy: 119.0,
};

fn lens_of(path: &Path) -> Result<Lens, CameraFileError> {
    let file = camera_file::read(path)?;
    let camera = file.sole().expect("one camera");
    Ok(camera
        .lens(camera.size().unwrap_or([320, 240]))
        .expect("a lens"))
}

fn lens(text: &str) -> Result<Lens, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.txt");
    fs::write(&path, text).unwrap();
    lens_of(&path).map_err(|e| e.to_string())
}

#[test]
fn the_cases_are_read_or_refused_with_the_reason() {
    let centred = Intrinsics {
        fy: 300.0,
        cx: 160.0,
        cy: 120.0,
        ..PINHOLE
    };
    for name in ["camera_info.yaml", "rs_intrinsics.json"] {
        assert_eq!(
            lens_of(&case(name)).unwrap(),
            Lens::from(&centred),
            "{name}"
        );
    }
    let message = lens_of(&case("normalised.json")).unwrap_err().to_string();
    assert!(
        message.contains("normalised.json: fx = 0.9375"),
        "{message}"
    );
    assert!(
        message.contains("multiply fx and cx by the width"),
        "{message}"
    );
}

/// ROS 1's `rostopic echo`, ROS 2's `ros2 topic echo`, `camera_calibration`, OpenCV, librealsense, Open3D,
/// BOP and ours.
#[test]
fn formats_of_other_tools_are_read() {
    let k = "300.0, 0.0, 160.5, 0.0, 301.0, 119.0, 0.0, 0.0, 1.0";
    let d = "-0.28, 0.09, 0.0011, -0.0007, -0.013";
    let p = "310.0, 0.0, 161.0, 0.0, 0.0, 311.0, 118.0, 0.0, 0.0, 0.0, 1.0, 0.0";
    let ros_1 = format!(
        "header: \n  seq: 3\n  stamp: \n    secs: 0\n    nsecs:  0\n  frame_id: \"depth\"\nheight: 240\n\
         width: 320\ndistortion_model: \"plumb_bob\"\nD: [{d}]\nK: [{k}]\nP: [{p}]\nbinning_x: 0\n\
         binning_y: 0\nroi: \n  x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n  do_rectify: False\n---\n"
    );
    let list =
        |values: &str| -> String { values.split(", ").map(|v| format!("- {v}\n")).collect() };
    let ros_2 = format!(
        "header:\n  stamp:\n    sec: 1\n    nanosec: 5\n  frame_id: depth\nheight: 240\nwidth: 320\n\
         distortion_model: plumb_bob\nd:\n{}k:\n{}p:\n{}---\nheight: 1\n---\n",
        list(d),
        list(k),
        list(p)
    );
    let calibration = format!(
        "image_width: 320\nimage_height: 240\ncamera_name: depth\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
         data: [{k}]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [{d}]\n"
    );
    let opencv = format!(
        "%YAML:1.0\n---\nimage_width: 320\nimage_height: 240\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
         cols: 3\n   dt: d\n   data: [ 300., 0., 160.5, 0., 3.01e+02,\n       119., 0., 0., 1. ]\n\
         distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ {d} ]\n"
    );
    let plain = "\"width\": 320, \"height\": 240, \"fx\": 300.0, \"fy\": 301.0";
    let realsense = format!(
        "{{{plain}, \"ppx\": 160.5, \"ppy\": 119.0, \"model\": \"distortion.brown_conrady\", \"coeffs\": [{d}]}}"
    );
    let named = format!(
        "{{{plain}, \"cx\": 160.5, \"cy\": 119.0, \"k1\": -0.28, \"k2\": 0.09, \"p1\": 0.0011, \
         \"p2\": -0.0007, \"k3\": -0.013}}"
    );
    let distorted = Lens {
        intrinsics: PINHOLE,
        distortion: Distortion::new(&[-0.28, 0.09, 0.0011, -0.0007, -0.013], false).unwrap(),
    };
    for text in [&ros_1, &ros_2, &calibration, &opencv, &realsense, &named] {
        assert_eq!(lens(text), Ok(distorted), "{text}");
    }
    let modified = Lens {
        distortion: Distortion::new(&[-0.28, 0.09, 0.0011, -0.0007, -0.013], true).unwrap(),
        ..distorted
    };
    for model in [
        "inverse_brown_conrady",
        "Modified Brown Conrady",
        "RS2_DISTORTION_INVERSE_BROWN_CONRADY",
    ] {
        let text = realsense.replace("distortion.brown_conrady", model);
        assert_eq!(lens(&text), Ok(modified), "{text}");
    }

    let ours = format!("{{{plain}, \"cx\": 160.5, \"cy\": 119.0}}");
    let open_3d = "{\"width\": 320, \"height\": 240, \"intrinsic_matrix\": \
                   [300, 0, 0, 0, 301, 0, 160.5, 119, 1]}";
    let rows = "{\"camera_matrix\": [[300, 0, 160.5], [0, 301, 119], [0, 0, 1]]}";
    let within =
        format!("{{\"intrinsics\": {ours}, \"range\": {{\"near_m\": 0.5, \"far_m\": 5.0}}}}");
    for text in [&ours, open_3d, rows, &within] {
        assert_eq!(lens(text), Ok(Lens::from(&PINHOLE)), "{text}");
    }
    // Without K, ROS tells of the rectified image: no distortion.
    let rectified = lens(&ros_1.replace(&format!("K: [{k}]\n"), "")).unwrap();
    assert_eq!(
        (rectified.intrinsics.fx, rectified.intrinsics.cy),
        (310.0, 118.0)
    );
    assert_eq!(rectified.distortion, Distortion::default());
}

#[test]
fn bop_has_a_camera_and_a_unit_for_each_image() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene_camera.json");
    let entry = |fx: f64| {
        format!("{{\"cam_K\": [{fx}, 0, 160.5, 0, 301, 119, 0, 0, 1], \"depth_scale\": 0.1}}")
    };
    let of = |path: &Path, image: &str| {
        let file = camera_file::read(path).unwrap();
        file.of(Path::new(image))
            .copied()
            .map_err(|e| e.to_string())
    };
    fs::write(
        &path,
        format!("{{\"3\": {}, \"12\": {}}}", entry(300.0), entry(310.0)),
    )
    .unwrap();
    let third = of(&path, "depth/000003.png").unwrap();
    assert_eq!((third.size(), third.unit_m()), (None, Some(0.0001)));
    assert_eq!(third.lens([320, 240]).unwrap(), Lens::from(&PINHOLE));
    assert_eq!(
        of(&path, "x7_000012.png")
            .unwrap()
            .lens([320, 240])
            .unwrap()
            .intrinsics
            .fx,
        310.0
    );
    assert!(
        of(&path, "000004.png")
            .unwrap_err()
            .contains("no camera for image 4")
    );
    assert!(of(&path, "depth.png").unwrap_err().contains("has none"));
    assert!(camera_file::read(&path).unwrap().sole().is_none());
    fs::write(
        &path,
        format!("{{\"3\": {}, \"12\": {}}}", entry(300.0), entry(300.0)),
    )
    .unwrap();
    assert_eq!(of(&path, "depth.png").unwrap(), third);

    let unit = |scale: &str| {
        let text = format!(
            "{{\"fx\": 300, \"fy\": 301, \"cx\": 160, \"cy\": 119, \"width\": 320, \"height\": 240, \
             \"depth_scale\": {scale}}}"
        );
        fs::write(&path, text).unwrap();
        camera_file::read(&path).map(|file| file.sole().unwrap().unit_m().unwrap())
    };
    for (scale, metres) in [
        ("1.0", 0.001),
        ("0.1", 0.0001),
        ("0.001", 0.001),
        ("5000", 0.0002),
    ] {
        assert!((unit(scale).unwrap() - metres).abs() < 1e-12, "{scale}");
    }
    assert!(
        unit("50")
            .unwrap_err()
            .to_string()
            .contains("depth_scale = 50")
    );
}

#[test]
fn what_is_no_camera_is_refused_with_the_reason() {
    let camera = |fx: &str, fy: &str, cx: &str, rest: &str| {
        format!(
            "{{\"width\": 320, \"height\": 240, \"fx\": {fx}, \"fy\": {fy}, \"cx\": {cx}, \"cy\": 119{rest}}}"
        )
    };
    let model = |name: &str, coefficients: &str| {
        let rest = format!(", \"model\": \"{name}\", \"coeffs\": {coefficients}");
        camera("300", "300", "160", &rest)
    };
    for (text, part) in [
        (camera("0.3", "0.4", "160", ""), "field of view"),
        (
            camera("300000", "300", "160", ""),
            "field of view of 0.1 degrees",
        ),
        (camera("300", "700", "160", ""), "factor of 2"),
        (camera("300", "300", "1600", ""), "cx = 1600 is far outside"),
        (camera("-300", "300", "160", ""), "must be positive"),
        (camera("\"x\"", "300", "160", ""), "fx must be a number"),
        (camera("300", "300", "160", ", \"binning_x\": 2"), "binned"),
        (model("kannala_brandt4", "[0, 0, 0, 0]"), "kannala_brandt4"),
        (model("equidistant", "[0.1, 0, 0, 0]"), "fisheye"),
        (model("ftheta", "[0, 0, 0, 0]"), "not known"),
        (model("none", "[0.1]"), "coefficients of distortion"),
        (
            model("plumb_bob", "[\"a\"]"),
            "coeffs must be a list of numbers",
        ),
        (
            "{\"width\": 320, \"height\": 240, \"fx\": 300}".to_owned(),
            "fy, cx, cy are missing",
        ),
        (
            "{\"width\": 320, \"K\": [300, 0, 160, 0, 300, 120, 0, 0, 1]}".to_owned(),
            "only one of width",
        ),
        (
            "{\"K\": [0, 0, 0, 0, 0, 0, 0, 0, 0]}".to_owned(),
            "not calibrated",
        ),
        (
            "{\"K\": [300, 0, 160, 0, 300, 120, 0, 0]}".to_owned(),
            "3 x 3 numbers",
        ),
        (
            "{\"K\": [300, 9, 160, 0, 300, 120, 0, 0, 1]}".to_owned(),
            "[[fx, 0, cx]",
        ),
        (
            "{\"K\": [300, 0, 160, 0, 300, 120, 0, 0, 2]}".to_owned(),
            "[[fx, 0, cx]",
        ),
        ("<opencv_storage></opencv_storage>".to_owned(), "XML"),
        (String::new(), "empty"),
        ("---\n".to_owned(), "empty"),
        ("[1, 2]".to_owned(), "no camera"),
        ("just words".to_owned(), "no camera"),
        ("a: [1, 2".to_owned(), "neither JSON nor YAML"),
        ("{\"a\": ".to_owned(), "EOF"),
        (
            "{\"0\": {}, \"1\": {}}".to_owned(),
            "image 0: it holds no camera",
        ),
    ] {
        let message = lens(&text).unwrap_err();
        assert!(message.contains(part), "{text}: {message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
    // Nine lists of nine lists of ...: a billion words, if anybody unfolded them.
    let mut bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n".to_owned();
    for level in 1..10 {
        let below = vec![format!("*a{}", level - 1); 9].join(", ");
        bomb += &format!("a{level}: &a{level} [{below}]\n");
    }
    assert_eq!(lens(&bomb).unwrap_err().lines().count(), 1);
    assert!(matches!(
        camera_file::read(Path::new("/dev/zero")),
        Err(CameraFileError::Read { .. })
    ));
}
