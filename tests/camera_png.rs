//! PNG files of depth and labels: round trip, and what is refused.

use armpose::camera::png::{PngError, read_depth, read_labels, write_depth, write_labels};
use armpose::camera::{DepthImage, Image, Intrinsics};
use armpose::random::{below, stream};

const CAMERA: Intrinsics = Intrinsics {
    width: 31,
    height: 17,
    fx: 30.0,
    fy: 30.0,
    cx: 15.0,
    cy: 8.0,
};

fn image<T>(pixel: impl FnMut(usize) -> T) -> Image<T> {
    Image {
        width: CAMERA.width,
        height: CAMERA.height,
        pixels: (0..CAMERA.width * CAMERA.height).map(pixel).collect(),
    }
}

#[test]
fn images_survive() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("image.png");
    let mut s = stream(1, "png", &[]);
    // Zeros and values with any high and low byte, median about 5 m.
    let depth = image(|i| {
        if i % 5 == 0 {
            0
        } else {
            below(&mut s, 10_000) as u16
        }
    });
    write_depth(&path, &depth).expect("written");
    assert!(read_depth(&path, &CAMERA).expect("read") == depth);
    let nothing = image(|_| 0u16);
    write_depth(&path, &nothing).expect("written");
    assert!(read_depth(&path, &CAMERA).expect("an image without valid pixels") == nothing);
    let labels = image(|i| i as u8);
    write_labels(&path, &labels).expect("written");
    assert!(read_labels(&path, &CAMERA).expect("read") == labels);
}

#[test]
fn what_is_no_depth_image_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("image.png");
    let refusal = |depth: &DepthImage| {
        write_depth(&path, depth).expect("written");
        read_depth(&path, &CAMERA).expect_err("refused")
    };
    for (value, guess) in [
        (2, "metres"),
        (150, "centimetres"),
        (15_000, "tenths of a millimetre"),
    ] {
        let error = refusal(&image(|i| if i < 300 { value } else { 0 }));
        assert!(matches!(error, PngError::Unit { .. }));
        assert!(error.to_string().contains(guess), "{error}");
    }
    let error = refusal(&Image {
        width: 2,
        height: 1,
        pixels: vec![1000, 1000],
    });
    assert!(
        matches!(error, PngError::Size { found_width: 2, .. }),
        "{error}"
    );

    write_labels(&path, &image(|_| 200u8)).expect("written");
    let error = read_depth(&path, &CAMERA).expect_err("8-bit depth");
    assert!(matches!(error, PngError::Format { .. }));
    assert!(error.to_string().contains("8-bit Grayscale"), "{error}");

    let whole = std::fs::read(&path).expect("read back");
    std::fs::write(&path, &whole[..whole.len() - 30]).expect("written");
    assert!(matches!(
        read_labels(&path, &CAMERA),
        Err(PngError::Decode { .. })
    ));
    std::fs::write(&path, "P5 2 1 255 ab").expect("written");
    assert!(matches!(
        read_labels(&path, &CAMERA),
        Err(PngError::Decode { .. })
    ));
    let missing = folder.path().join("missing.png");
    assert!(matches!(
        read_depth(&missing, &CAMERA),
        Err(PngError::Open { .. })
    ));
    let nowhere = folder.path().join("no folder").join("image.png");
    assert!(matches!(
        write_depth(&nowhere, &image(|_| 1000)),
        Err(PngError::Write { .. })
    ));
}
