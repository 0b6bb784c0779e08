//! Depth images that other tools wrote: `scripts/depth_fixtures.py`.

use armpose::camera::depth_file::{
    RangeError, Units, check_range, endings, extension, read_depth_file,
};
use armpose::camera::{DepthImage, Range};
use std::fs;
use std::path::{Path, PathBuf};

const SIZE: Option<[usize; 2]> = Some([8, 6]);

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures/depth")
        .join(name)
}

/// 1000 + 10 x + 100 y mm, but for four invalid pixels at the top left.
fn truth() -> DepthImage {
    let mm = |at: usize| match at {
        0..4 => 0,
        at => (1000 + 10 * (at % 8) + 100 * (at / 8)) as u16,
    };
    DepthImage {
        width: 8,
        height: 6,
        pixels: (0..48).map(mm).collect(),
    }
}

fn given(metres: f64) -> Units {
    Units {
        integer_m: metres,
        float_m: metres,
    }
}

fn message(path: &Path, units: Units) -> String {
    let message = read_depth_file(path, SIZE, units).unwrap_err().to_string();
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(message.contains(&*path.to_string_lossy()), "{message}");
    message
}

#[test]
fn all_formats_hold_the_same_image() {
    let names = "u16.png uint16.npy int16.npy int32.npy uint32.npy float32.npy float64.npy big_endian.npy \
                 big_endian_float.npy fortran.npy axis_behind.npy axis_before.npy only.npz called_depth.npz \
                 float32.tif uint16.tiff big_endian.tif float64.tif tiled.tif opencv.tiff z.exr \
                 rgb_and_depth.exr grey.exr u16.pgm opencv.pfm big_endian.pfm";
    for name in names.split_whitespace() {
        for size in [SIZE, None] {
            let image = read_depth_file(&fixture(name), size, Units::default());
            assert_eq!(image.unwrap(), truth(), "{name}");
        }
        let other = read_depth_file(&fixture(name), Some([6, 8]), Units::default());
        let message = other.unwrap_err().to_string();
        assert!(
            message.contains("8 x 6") && message.contains("6 x 8"),
            "{message}"
        );
    }
}

/// Half floats tell 1 to 2 m in steps of 0.98 mm.
#[test]
fn half_floats_are_read_to_their_precision() {
    for name in ["float16.npy", "float16.tif", "half.exr"] {
        let image = read_depth_file(&fixture(name), SIZE, Units::default()).unwrap();
        for (&got, &truth) in image.pixels.iter().zip(&truth().pixels) {
            assert!(
                got.abs_diff(truth) <= 1 && (got == 0) == (truth == 0),
                "{name}"
            );
        }
    }
}

#[test]
fn other_units_are_read_when_they_are_told() {
    for (name, unit) in [("tum.png", 0.0002), ("float_mm.npy", 0.001)] {
        let image = read_depth_file(&fixture(name), SIZE, given(unit)).unwrap();
        assert_eq!(image, truth(), "{name}");
    }
    let fivefold = read_depth_file(&fixture("u16.png"), SIZE, given(0.005)).unwrap();
    assert_eq!(fivefold.pixels[47], 5 * truth().pixels[47]);
}

#[test]
fn what_holds_no_depth_is_refused_with_the_reason() {
    for (name, part) in [
        ("grey8.png", "8-bit Grayscale"),
        ("colour16.png", "16-bit Rgb"),
        ("uint8.npy", "'|u1'"),
        ("colour.npy", "[6, 8, 3]"),
        ("several.npz", "left, right"),
        ("colour.tif", "RGB(16)"),
        ("colour.exr", "colours"),
        ("grey8.pgm", "end at 255"),
    ] {
        let message = message(&fixture(name), Units::default());
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn endings_may_be_in_capitals() {
    let folder = tempfile::tempdir().unwrap();
    for (from, to) in [
        ("u16.png", "A.PNG"),
        ("z.exr", "a.Exr"),
        ("float32.tif", "A.TIFF"),
    ] {
        let path = folder.path().join(to);
        fs::copy(fixture(from), &path).unwrap();
        assert!(extension(&path).is_some());
        assert_eq!(
            read_depth_file(&path, SIZE, Units::default()).unwrap(),
            truth()
        );
    }
    let path = folder.path().join("a.jpg");
    fs::copy(fixture("u16.png"), &path).unwrap();
    assert!(message(&path, Units::default()).contains(&endings()));
    let path = folder.path().join("folder.png");
    fs::create_dir(&path).unwrap();
    assert!(message(&path, Units::default()).contains("no regular file"));
}

/// However short a file is cut, it is refused.
#[test]
fn files_that_are_cut_off_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for name in [
        "u16.png",
        "uint16.npy",
        "only.npz",
        "float32.tif",
        "z.exr",
        "u16.pgm",
        "opencv.pfm",
    ] {
        let whole = fs::read(fixture(name)).unwrap();
        let path = folder.path().join(name);
        let ends = if name.ends_with(".tif") { 4 } else { 0 };
        for length in 0..whole.len() - ends {
            fs::write(&path, &whole[..length]).unwrap();
            match read_depth_file(&path, SIZE, Units::default()) {
                // What stands behind the values of a PNG does not matter.
                Ok(image) => assert!(name == "u16.png" && image == truth(), "{name} {length}"),
                Err(error) => assert_eq!(error.to_string().lines().count(), 1),
            }
        }
    }
}

/// A PGM of one row; the first pixel is invalid.
fn row(folder: &Path, values: impl IntoIterator<Item = u16>) -> PathBuf {
    let values: Vec<u16> = values.into_iter().collect();
    let mut bytes = format!("P5\n# a comment\n{} 1 65535\n", values.len()).into_bytes();
    bytes.extend(values.iter().flat_map(|value| value.to_be_bytes()));
    let path = folder.join("row.pgm");
    fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn a_wrong_unit_is_named_with_the_likely_one() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = |values: Vec<u16>, units: Units| {
        let path = row(folder.path(), values);
        read_depth_file(&path, None, units).unwrap_err().to_string()
    };
    let usual = Units::default();
    let around = |value: u16| vec![0, value - 1, value, value + 1];
    for (values, units, part) in [
        (around(2), usual, "metres in whole numbers"),
        (
            around(150),
            usual,
            "--depth-scale 0.01 (centimetres: 1.5 m)",
        ),
        (
            around(15_000),
            usual,
            "0.0001 (tenths of a millimetre: 1.5 m)",
        ),
        (around(15_000), usual, "0.0002 (TUM data sets: 3 m)"),
        (around(15_000), usual, "0.00025 (RealSense L515: 3.75 m)"),
        (around(1_500), given(0.0001), "0.001 (millimetres: 1.5 m)"),
        (vec![0], usual, "not one of its pixels has a valid depth"),
        (vec![0; 5], usual, "not one of its pixels has a valid depth"),
        (
            vec![0, 65535, 0],
            usual,
            "not one of its pixels has a valid depth",
        ),
        (vec![1500; 5], usual, "all its pixels have the value 1500"),
        (vec![2047, 700, 800, 2047], usual, "raw disparities"),
    ] {
        let message = wrong(values, units);
        assert!(
            message.contains(part) && message.lines().count() == 1,
            "{message}"
        );
    }
    let floats = message(&fixture("float_mm.npy"), usual);
    assert!(
        floats.contains("--depth-scale 0.001 (millimetres: 1.32 m)"),
        "{floats}"
    );
    // Saturated values and zeros are invalid, and do not hide what is there.
    let path = row(folder.path(), [0, 65535, 65535, 65535, 1500]);
    let image = read_depth_file(&path, None, usual).unwrap();
    assert_eq!(image.pixels, [0, 0, 0, 0, 1500]);
}

#[test]
fn depths_out_of_a_models_range_are_told_with_the_likely_unit() {
    let range = Range {
        near_m: 0.5,
        far_m: 5.0,
    };
    let image = |mm: &[u16]| DepthImage {
        width: mm.len(),
        height: 1,
        pixels: mm.to_vec(),
    };
    assert_eq!(check_range(&image(&[0, 900, 6000, 7000]), &range), Ok(()));
    assert_eq!(
        check_range(&image(&[0, 0]), &range),
        Err(RangeError::Nothing)
    );
    for (mm, part) in [
        (
            [0, 7400, 7500, 7600],
            "10 times smaller or 5 times smaller or 4 times smaller",
        ),
        (
            [0, 230, 240, 250],
            "10 times larger or 5 times larger or 4 times larger",
        ),
        ([0, 60_000, 60_000, 60_000], "half are below 60 m"),
    ] {
        let message = check_range(&image(&mm), &range).unwrap_err().to_string();
        assert!(
            message.contains(part) && message.starts_with("only 0.0 %"),
            "{message}"
        );
    }
}

fn npy(descr: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values);
    bytes
}

#[test]
fn unusable_npy_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("depth.npy");
    let values: Vec<u8> = (1024u16..1030).flat_map(u16::to_le_bytes).collect();
    let whole = npy("<u2", "(2, 3)", &values);
    let read = |bytes: &[u8]| {
        fs::write(&file, bytes).unwrap();
        read_depth_file(&file, Some([3, 2]), Units::default())
    };
    assert_eq!(
        read(&whole).unwrap().pixels,
        [1024, 1025, 1026, 1027, 1028, 1029]
    );
    let mut long = whole.clone();
    long[6..12].copy_from_slice(&[2, 0, 255, 255, 255, 255]);
    let mut version = whole.clone();
    version[6] = 4;
    let tail = [whole.clone(), vec![0]].concat();
    let huge = "(99999999999999999999, 99999999999999999999)";
    for (bytes, part) in [
        (npy("<u2", huge, &[]), "cannot be larger"),
        (
            npy("<u2", "(4294967296, 4294967296)", &[]),
            "4294967296 x 4294967296 pixels",
        ),
        (
            npy("<u2", "(3, 2)", &values),
            "2 x 3 pixels, but the camera's images are 3 x 2",
        ),
        (npy("<u2", "(6,)", &values), "its shape is [6]"),
        (npy("<i8", "(2, 3)", &[0; 48]), "the type '<i8'"),
        (b"not NumPy's, surely".to_vec(), "magic"),
        (long, "header has 4294967295 bytes"),
        (version, "version"),
        (tail, "13 bytes of values stand in it"),
    ] {
        let message = read(&bytes).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
        assert!(message.contains("is not a usable NPY file") && message.lines().count() == 1);
    }
    let strange = [f64::INFINITY, f64::NAN, -1.0, 1e300, 0.0004, 1.2345];
    let bytes: Vec<u8> = strange.iter().flat_map(|x| x.to_le_bytes()).collect();
    let image = read(&npy("<f8", "(2, 3)", &bytes)).unwrap();
    assert_eq!(image.pixels, [0, 0, 0, 0, 0, 1235]);
}

/// Renderers write 1e10 where nothing is, mostly.
#[test]
fn a_far_background_does_not_hide_the_unit() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("depth.npy");
    let read = |depths: [f32; 40]| {
        let bytes: Vec<u8> = depths.iter().flat_map(|x| x.to_le_bytes()).collect();
        fs::write(&file, npy("<f4", "(4, 10)", &bytes)).unwrap();
        read_depth_file(&file, None, Units::default())
    };
    let mut depths = [1e10; 40];
    (depths[7], depths[8]) = (1.5, 1.6);
    let image = read(depths).unwrap();
    assert_eq!(image.pixels.iter().filter(|&&mm| mm > 0).count(), 2);
    assert_eq!((image.pixels[7], image.pixels[8]), (1500, 1600));
    let message = read(depths.map(|m| m.min(9.0) * 1000.0))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("--depth-scale 0.001 (millimetres: 9 m)"),
        "{message}"
    );
}
