//! What the parts of a camera are called in files, and where they stand.

use super::FileCamera;
use crate::camera::Distortion;
use serde_json::{Map, Value};

type Object = Map<String, Value>;

/// The camera that an object describes.
pub(super) fn camera(value: &Value) -> Result<FileCamera, String> {
    let object = value.as_object().ok_or("it holds no camera")?;
    if object.contains_key("binning_x") {
        let part = object.get("roi").and_then(Value::as_object);
        let turned_on = |value: Option<&Value>, off: f64| {
            value.and_then(number).is_some_and(|value| value > off)
        };
        let cropped = part.is_some_and(|roi| turned_on(roi.get("width"), 0.0));
        let binned = ["binning_x", "binning_y"].map(|key| turned_on(object.get(key), 1.0));
        if cropped || binned.contains(&true) {
            return Err(
                "its images are binned or cropped (binning_x, binning_y, roi), which its matrix does \
                 not count in; give fx, fy, cx, cy, width, height of the images as they are"
                    .to_owned(),
            );
        }
    }
    let Pinhole {
        fx,
        fy,
        cx,
        cy,
        rectified,
    } = pinhole(object)?;
    Ok(FileCamera {
        size: size(object)?,
        fx,
        fy,
        cx,
        cy,
        distortion: match rectified {
            true => Distortion::default(),
            false => distortion(object)?,
        },
        unit_m: unit(object)?,
    })
}

struct Pinhole {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    /// Of images whose distortion was taken out.
    rectified: bool,
}

/// Where a camera's 3x3 matrix stands.
const MATRICES: [&str; 5] = ["K", "k", "camera_matrix", "cam_K", "intrinsic_matrix"];

fn pinhole(object: &Object) -> Result<Pinhole, String> {
    let one_of = |keys: &[&'static str]| {
        let present = keys.iter().find_map(|&key| Some((key, object.get(key)?)));
        present.map(|(key, value)| number(value).ok_or_else(|| format!("{key} must be a number")))
    };
    let fields = [&["fx"][..], &["fy"], &["cx", "ppx"], &["cy", "ppy"]];
    if let [Some(fx), Some(fy), Some(cx), Some(cy)] = fields.map(one_of) {
        return Ok(Pinhole {
            fx: fx?,
            fy: fy?,
            cx: cx?,
            cy: cy?,
            rectified: false,
        });
    }
    for key in MATRICES {
        let Some(value) = object.get(key) else {
            continue;
        };
        let wrong = |what: &str| Err(format!("{key} {what}"));
        let Some(values) = numbers(value).and_then(|values| <[f64; 9]>::try_from(values).ok())
        else {
            return wrong("must be a matrix of 3 x 3 numbers");
        };
        // By rows, or by columns as Open3D's is.
        let [fx, skew, cx, below, fy, cy, ..] = match values[6..] {
            [0.0, 0.0, 1.0] => values,
            _ => std::array::from_fn(|at| values[at % 3 * 3 + at / 3]),
        };
        let last = match values[6..] {
            [0.0, 0.0, 1.0] => &values[6..],
            _ => &[values[2], values[5], values[8]],
        };
        if values.iter().all(|&value| value == 0.0) {
            // An uncalibrated camera of ROS may still have P.
            continue;
        }
        if last != [0.0, 0.0, 1.0] || below != 0.0 || skew.abs() > 1e-3 * fx.abs() {
            return wrong("must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]");
        }
        return Ok(Pinhole {
            fx,
            fy,
            cx,
            cy,
            rectified: false,
        });
    }
    for key in ["P", "p", "projection_matrix"] {
        let values = object.get(key).and_then(numbers);
        if let Some([fx, _, cx, _, _, fy, cy, ..]) = values.as_deref()
            && [*fx, *fy] != [0.0, 0.0]
        {
            return Ok(Pinhole {
                fx: *fx,
                fy: *fy,
                cx: *cx,
                cy: *cy,
                rectified: true,
            });
        }
    }
    Err(
        match MATRICES.iter().find(|&&key| object.contains_key(key)) {
            Some(key) => format!("{key} is all zeros: the camera was not calibrated"),
            None => {
                let missing = ["fx", "fy", "cx", "cy"].into_iter().zip(fields.map(one_of));
                let missing: Vec<&str> = (missing.filter(|(_, field)| field.is_none()))
                    .map(|(name, _)| name)
                    .collect();
                format!(
                    "it holds no camera: {} missing (fx, fy, cx, cy, or a matrix called one of {}, are read)",
                    match &missing[..] {
                        [one] => format!("{one} is"),
                        several => format!("{} are", several.join(", ")),
                    },
                    MATRICES.join(", ")
                )
            }
        },
    )
}

fn size(object: &Object) -> Result<Option<[usize; 2]>, String> {
    let side = |keys: [&str; 2]| {
        let (key, value) = keys.iter().find_map(|&key| Some((key, object.get(key)?)))?;
        let whole = number(value).filter(|side| *side >= 0.0 && side.fract() == 0.0 && *side < 1e9);
        let whole = whole.ok_or_else(|| format!("{key} must be a whole number"));
        Some(whole.map(|side| side as usize))
    };
    let sides = (
        side(["width", "image_width"]),
        side(["height", "image_height"]),
    );
    match sides {
        (Some(width), Some(height)) => Ok(Some([width?, height?])),
        (None, None) => Ok(None),
        _ => Err("it tells only one of width and height".to_owned()),
    }
}

/// How the models of distortion are called that OpenCV's coefficients are for.
const OPENCV: [&str; 5] = [
    "plumb_bob",
    "radtan",
    "brown_conrady",
    "rational_polynomial",
    "opencv",
];
/// How librealsense calls its variants of Brown and Conrady's model.
const MODIFIED: [&str; 2] = ["modified_brown_conrady", "inverse_brown_conrady"];

fn distortion(object: &Object) -> Result<Distortion, String> {
    let model = ["distortion_model", "model", "camera_model"]
        .iter()
        .find_map(|&key| object.get(key)?.as_str())
        .unwrap_or_default();
    let model = model.to_lowercase().replace([' ', '-'], "_");
    let model = model.rsplit('.').next().unwrap_or_default();
    let model = model.trim_start_matches("rs2_distortion_");
    let lists = [
        "D",
        "d",
        "distortion_coefficients",
        "coeffs",
        "dist_coeffs",
        "distortion",
        "dist",
    ];
    let named = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];
    let list = lists.iter().find_map(|&key| Some((key, object.get(key)?)));
    let coefficients = match list {
        Some((_, Value::Null)) => Vec::new(),
        Some((key, value)) => {
            numbers(value).ok_or_else(|| format!("{key} must be a list of numbers"))?
        }
        None => {
            let value = |key: &str| match object.get(key) {
                None => Ok(0.0),
                Some(value) => number(value).ok_or_else(|| format!("{key} must be a number")),
            };
            named
                .iter()
                .map(|key| value(key))
                .collect::<Result<_, _>>()?
        }
    };
    let distorts = coefficients.iter().any(|&c| c != 0.0);
    match model {
        "" | "none" | "pinhole" if !distorts => Ok(Distortion::default()),
        "" => Distortion::new(&coefficients, false),
        model if OPENCV.contains(&model) => Distortion::new(&coefficients, false),
        model if MODIFIED.contains(&model) => Distortion::new(&coefficients, true),
        "none" | "pinhole" => Err(format!(
            "its distortion model is \"{model}\", but there are coefficients of distortion"
        )),
        model => {
            let known: String = model.chars().take(40).collect();
            Err(format!(
                "its distortion model \"{known}\" is not known (a fisheye is none of a pinhole camera); \
                 undistort the images first, and give the camera of those without distortion"
            ))
        }
    }
}

/// `depth_scale`, for which there are three customs, whose usual values lie apart: millimetres a unit
/// (BOP), metres a unit (librealsense), units a metre.
fn unit(object: &Object) -> Result<Option<f64>, String> {
    let Some(value) = object.get("depth_scale") else {
        return Ok(None);
    };
    match number(value) {
        Some(mm) if (0.01..=10.0).contains(&mm) => Ok(Some(mm / 1000.0)),
        Some(metres) if (1e-5..0.01).contains(&metres) => Ok(Some(metres)),
        Some(in_a_metre) if (100.0..=1e5).contains(&in_a_metre) => Ok(Some(1.0 / in_a_metre)),
        _ => Err(format!(
            "depth_scale = {value} is neither millimetres a unit (0.01 to 10), nor metres a unit, nor units \
             a metre"
        )),
    }
}

/// A finite number; YAML may give it as text.
fn number(value: &Value) -> Option<f64> {
    let number = match value {
        Value::Number(number) => number.as_f64()?,
        Value::String(text) => text.trim().parse().ok()?,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

/// A list of numbers, or of such lists, or an object with such a list as `data`.
fn numbers(value: &Value) -> Option<Vec<f64>> {
    match value {
        Value::Object(object) => numbers(object.get("data")?),
        Value::Array(values) if values.iter().all(Value::is_array) => {
            let rows: Option<Vec<Vec<f64>>> = values.iter().map(numbers).collect();
            rows.map(|rows| rows.concat())
        }
        Value::Array(values) => values.iter().map(number).collect(),
        _ => None,
    }
}
