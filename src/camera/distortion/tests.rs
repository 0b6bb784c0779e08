use super::*;
use crate::camera::{DepthImage, Resampling};
use crate::random::{stream, uniform};

/// The rays of [`by_opencv`].
const RAYS: [[f64; 2]; 5] = [
    [0.0, 0.0],
    [0.2, -0.1],
    [-0.45, 0.3],
    [0.5, 0.35],
    [-0.1, -0.38],
];

/// ```text
/// K = [[600, 0, 320], [0, 610, 240], [0, 0, 1]]
/// cv2.projectPoints(np.array([[x, y, 1] for x, y in RAYS]), np.zeros(3), np.zeros(3), np.array(K), np.array(D))
/// ```
#[test]
fn rays_are_found_where_opencv_finds_them() {
    type Pixels = [[f64; 2]; 5];
    let by_opencv: [(&[f64], Pixels); 3] = [
        (
            &[-0.28, 0.09, 0.0011, -0.0007, -0.013],
            [
                [320.0, 240.0],
                [438.265805, 179.904424],
                [69.650672, 409.794214],
                [592.119391, 434.019587],
                [262.44497, 17.999868],
            ],
        ),
        (
            &[0.52, -0.11, 0.0004, -0.0003, 0.004, 0.86, -0.06, 0.001],
            [
                [320.0, 240.0],
                [437.996482, 180.02608],
                [72.262557, 407.946618],
                [589.418187, 431.87455],
                [262.833531, 19.291918],
            ],
        ),
        (
            &[-0.3, 0.1, 0.001, 0.002],
            [
                [320.0, 240.0],
                [438.362, 179.89365],
                [72.057481, 408.466254],
                [591.894687, 433.407496],
                [262.891044, 18.747452],
            ],
        ),
    ];
    for (coefficients, pixels) in by_opencv {
        let distortion = Distortion::new(coefficients, false).unwrap();
        for ([x, y], [column, row]) in RAYS.into_iter().zip(pixels) {
            let [x, y] = distortion.apply(x, y).unwrap();
            assert!((600.0 * x + 320.0 - column).abs() < 1e-5, "{x} {column}");
            assert!((610.0 * y + 240.0 - row).abs() < 1e-5, "{y} {row}");
        }
    }
}

/// librealsense inverts its modified model by this iteration, from `rs2_deproject_pixel_to_point`.
fn deprojected([k1, k2, p1, p2, k3]: [f64; 5], [far_x, far_y]: [f64; 2]) -> [f64; 2] {
    let [mut x, mut y] = [far_x, far_y];
    for _ in 0..60 {
        let r2 = x * x + y * y;
        let scale = 1.0 + ((k3 * r2 + k2) * r2 + k1) * r2;
        let (sx, sy) = (x * scale, y * scale);
        x = (far_x - (2.0 * p1 * sx * sy + p2 * (r2 + 2.0 * sx * sx))) / scale;
        y = (far_y - (2.0 * p2 * sx * sy + p1 * (r2 + 2.0 * sy * sy))) / scale;
    }
    [x, y]
}

#[test]
fn the_modified_model_is_what_librealsense_inverts() {
    let coefficients = [-0.056, 0.065, -0.0006, 0.0012, -0.021];
    let distortion = Distortion::new(&coefficients, true).unwrap();
    let plain = Distortion::new(&coefficients, false).unwrap();
    for [x, y] in RAYS {
        let far = distortion.apply(x, y).unwrap();
        let [back_x, back_y] = deprojected(coefficients, far);
        assert!((back_x - x).abs() < 1e-9 && (back_y - y).abs() < 1e-9);
        let other = plain.apply(x, y).unwrap();
        assert!(x == 0.0 || (other[0] - far[0]).abs() > 1e-8);
    }
}

/// r (1 + k1 r²) turns back at r² = -1 / (3 k1).
#[test]
fn rays_that_would_fold_back_are_not_seen() {
    let distortion = Distortion::new(&[-0.3], false).unwrap();
    let turning = (1.0f64 / 0.9).sqrt();
    assert!(distortion.apply(0.99 * turning, 0.0).is_some());
    assert!(distortion.apply(0.0, 1.01 * turning).is_none());
    assert!(Distortion::default().apply(1e6, 0.0).is_some());
}

#[test]
fn impossible_coefficients_are_refused() {
    for (coefficients, part) in [
        (&[f64::NAN][..], "finite"),
        (&[-1e9], "no lens"),
        (&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3], "prism"),
    ] {
        let message = Distortion::new(coefficients, false).unwrap_err();
        assert!(message.contains(part), "{message}");
    }
}

const VIEW: Intrinsics = Intrinsics {
    width: 80,
    height: 60,
    fx: 72.0,
    fy: 71.0,
    cx: 39.3,
    cy: 30.4,
};

/// The formula for cameras without distortion, to the last bit.
#[test]
fn without_distortion_columns_and_rows_stay_apart() {
    let mut random = stream(1, "distortion", &[]);
    for _ in 0..20 {
        let from = Intrinsics {
            width: 90,
            height: 70,
            fx: uniform(&mut random, 60.0, 90.0),
            fy: uniform(&mut random, 60.0, 90.0),
            cx: uniform(&mut random, 30.0, 60.0),
            cy: uniform(&mut random, 20.0, 40.0),
        };
        let image = DepthImage {
            width: 90,
            height: 70,
            pixels: (1..=90 * 70).collect(),
        };
        let seen = Resampling::new(&(&from).into(), &VIEW).apply(&image);
        let place = |at: usize, c: f64, f: f64, c_from: f64, f_from: f64, size: usize| {
            let place = ((at as f64 - c) / f * f_from + c_from).round();
            (0.0..size as f64)
                .contains(&place)
                .then_some(place as usize)
        };
        for (at, &got) in seen.pixels.iter().enumerate() {
            let (x, y) = (at % VIEW.width, at / VIEW.width);
            let column = place(x, VIEW.cx, VIEW.fx, from.cx, from.fx, 90);
            let row = place(y, VIEW.cy, VIEW.fy, from.cy, from.fy, 70);
            let truth = column.zip(row).map_or(0, |(c, r)| image.pixels[r * 90 + c]);
            assert_eq!(got, truth);
        }
    }
}

/// A tilted plane in the image of a lens that distorts, each pixel's ray found by bisection along
/// nothing but the forward model, is the same plane in the view.
#[test]
fn a_plane_is_the_same_plane_through_a_lens() {
    let lens = Lens {
        intrinsics: Intrinsics {
            width: 320,
            height: 240,
            fx: 260.0,
            fy: 262.0,
            cx: 158.0,
            cy: 121.0,
        },
        distortion: Distortion::new(&[-0.28, 0.09, 0.0011, -0.0007, -0.013], false).unwrap(),
    };
    let i = &lens.intrinsics;
    let plane = |x: f64, y: f64| 1000.0 / (0.5 + 0.1 * x - 0.15 * y);
    // Newton with steps of the identity: the distortion is mild.
    let ray = |far: [f64; 2]| {
        let mut ray = far;
        for _ in 0..100 {
            let at = lens.distortion.apply(ray[0], ray[1])?;
            ray = [0, 1].map(|axis| ray[axis] + far[axis] - at[axis]);
        }
        Some(ray)
    };
    let depth = |at: usize| {
        let (column, row) = ((at % 320) as f64, (at / 320) as f64);
        let found = ray([(column - i.cx) / i.fx, (row - i.cy) / i.fy]);
        found.map_or(0, |[x, y]| plane(x, y).round() as u16)
    };
    let image = DepthImage {
        width: 320,
        height: 240,
        pixels: (0..320 * 240).map(depth).collect(),
    };
    let error = |lens: &Lens| {
        let resampling = Resampling::new(lens, &VIEW);
        assert!(resampling.covered() > 0.99, "{}", resampling.covered());
        let seen = resampling.apply(&image);
        let errors = seen.pixels.iter().enumerate().map(|(at, &got)| {
            let (x, y) = ((at % 80) as f64, (at / 80) as f64);
            let truth = plane((x - VIEW.cx) / VIEW.fx, (y - VIEW.cy) / VIEW.fy);
            match got {
                0 => 0.0,
                got => (f64::from(got) - truth).abs(),
            }
        });
        errors.fold(0.0, f64::max)
    };
    // Half a pixel of 1/260 in each axis, slopes of at most 0.15 z²: below 4 mm at z < 2.4 m.
    assert!(error(&lens) < 4.0, "{}", error(&lens));
    let ignored = error(&Lens::from(i));
    assert!(ignored > 15.0, "{ignored}");
}
