//! Whether the values of a depth image can be depths in the unit that they are read in.

use super::{Grid, Kind};
use crate::camera::{DepthImage, Image, Range};

/// Metres that one unit of a depth image stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Units {
    /// In images of integers.
    pub integer_m: f64,
    /// In images of floats.
    pub float_m: f64,
}

impl Default for Units {
    /// Integers count millimetres, floats are metres.
    fn default() -> Units {
        Units {
            integer_m: 0.001,
            float_m: 1.0,
        }
    }
}

/// The median depth of an image is within these, m: no depth camera sees a room otherwise.
const PLAUSIBLE: std::ops::RangeInclusive<f64> = 0.2..=10.0;

/// The farthest depth that a [`DepthImage`] holds, m.
const FARTHEST_M: f64 = 65.535;

/// Units in use, m, and whether anybody writes floats in them.
const CUSTOMS: [(f64, &str, bool); 8] = [
    (1.0, "metres", true),
    (0.01, "centimetres", true),
    (0.001, "millimetres", true),
    (0.00025, "RealSense L515", false),
    (0.0002, "TUM data sets", false),
    (0.000125, "eighths of a millimetre", false),
    (0.0001, "tenths of a millimetre", false),
    (0.000001, "micrometres", true),
];

/// The greatest raw disparity of a Kinect, which stands for none.
const NO_DISPARITY: f64 = 2047.0;

/// The image in millimetres, or a sentence why its values are no depths.
pub(super) fn millimetres(grid: Grid, units: Units) -> Result<DepthImage, String> {
    let Grid {
        width,
        height,
        kind,
        mut values,
    } = grid;
    let unit = match kind {
        Kind::Float => units.float_m,
        Kind::Integer16 | Kind::Integer32 => units.integer_m,
    };
    let saturated = f64::from(u16::MAX);
    for value in &mut values {
        let invalid = !(*value > 0.0 && value.is_finite());
        if invalid || (kind == Kind::Integer16 && *value == saturated) {
            *value = 0.0;
        }
    }
    check(&values, kind, unit)?;
    let mm = |value: f64| {
        let mm = (1000.0 * (value * unit)).round();
        match (1.0..=f64::from(u16::MAX)).contains(&mm) {
            true => mm as u16,
            false => 0,
        }
    };
    Ok(Image {
        width,
        height,
        pixels: values.into_iter().map(mm).collect(),
    })
}

fn check(values: &[f64], kind: Kind, unit: f64) -> Result<(), String> {
    let first = values[0];
    if values.iter().all(|&value| value == first) {
        match first {
            0.0 => return Err("not one of its pixels has a valid depth".to_owned()),
            _ if values.len() > 1 => {
                return Err(format!(
                    "all its pixels have the value {first}: that is no depth image"
                ));
            }
            _ => {}
        }
    }
    let disparities = values.iter().filter(|&&v| v == NO_DISPARITY).count();
    if kind != Kind::Float
        && disparities > values.len() / 100
        && values.iter().all(|&v| v > 0.0 && v <= NO_DISPARITY)
    {
        return Err(
            "its values end at 2047 as the raw disparities of a Kinect do; make depths of them first"
                .to_owned(),
        );
    }
    // What is too far for an image of ours does not count, unless that is nearly everything: renderers
    // write huge numbers where nothing is.
    let valid = || values.iter().filter(|&&v| v > 0.0);
    let near = || valid().filter(|&&v| v * unit <= FARTHEST_M);
    if near().count() > valid().count() / 100 && PLAUSIBLE.contains(&(median(near()) * unit)) {
        return Ok(());
    }
    let median = median(valid());
    let found = format!(
        "half its valid depths are below {} m at {unit} m a unit, which no depth camera would see; ",
        short(median * unit)
    );
    Err(match kind {
        Kind::Integer16 | Kind::Integer32 if median < 20.0 => {
            found + "they look like metres in whole numbers: save them in millimetres, or as floats"
        }
        _ => {
            let scales: Vec<String> = (CUSTOMS.iter())
                .filter(|(_, _, floats)| *floats || kind != Kind::Float)
                .filter(|(scale, ..)| PLAUSIBLE.contains(&(median * scale)))
                .map(|(scale, name, _)| format!("{scale} ({name}: {} m)", short(median * scale)))
                .collect();
            match &scales[..] {
                [] => found + "they look like no unit that is known",
                scales => found + "try --depth-scale " + &scales.join(" or "),
            }
        }
    })
}

/// The median of what there is at least one of.
fn median<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    let mut values: Vec<f32> = values.map(|&value| value as f32).collect();
    let middle = values.len() / 2;
    f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// A depth image of which nearly nothing is where a model can see.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RangeError {
    #[error("not one of its pixels has a valid depth")]
    Nothing,
    #[error(
        "only {percent:.1} % of its valid depths are within the {near} to {far} m that the model knows; \
         half are below {median} m{advice}",
        near = range.near_m,
        far = range.far_m,
        median = short(*median_m)
    )]
    Outside {
        percent: f64,
        range: Range,
        median_m: f64,
        /// Which other unit would put the median into the range.
        advice: String,
    },
}

/// Fewer valid pixels than this share of them within the range are taken for a mistake of unit.
const LEAST_SHARE: f64 = 0.01;

/// Fails when nearly all valid depths lie outside `range`, that of the images a model was trained on.
pub fn check_range(depth: &DepthImage, range: &Range) -> Result<(), RangeError> {
    let mut valid: Vec<u16> = (depth.pixels.iter().copied())
        .filter(|&mm| mm > 0)
        .collect();
    let inside = valid.iter().filter(|&&mm| range.holds(mm)).count();
    let share = inside as f64 / valid.len() as f64;
    if valid.is_empty() {
        return Err(RangeError::Nothing);
    }
    if share >= LEAST_SHARE {
        return Ok(());
    }
    let middle = valid.len() / 2;
    let median_m = f64::from(*valid.select_nth_unstable(middle).1) / 1000.0;
    let within = |factor: &&f64| (range.near_m..=range.far_m).contains(&(median_m * **factor));
    let factors: Vec<String> = ([0.1, 0.2, 0.25, 10.0, 5.0, 4.0].iter())
        .filter(within)
        .map(|factor| match *factor < 1.0 {
            true => format!("{} times smaller", short(1.0 / factor)),
            false => format!("{factor} times larger"),
        })
        .collect();
    let advice = match &factors[..] {
        [] => String::new(),
        factors => format!(
            "; if their unit is another, try a --depth-scale {}",
            factors.join(" or ")
        ),
    };
    Err(RangeError::Outside {
        percent: 100.0 * share,
        range: *range,
        median_m,
        advice,
    })
}

/// A number with three digits that matter, as people write it.
fn short(number: f64) -> String {
    let rounded: f64 = format!("{number:.2e}").parse().unwrap_or(number);
    rounded.to_string()
}
