//! Signs that a number is in another unit than metres and radians.

use super::bodies::Shape;
use super::{Joint, Motion};

/// No body is this many times as large as the whole chain of joints.
const TOO_LARGE: f64 = 5.0;
/// Bodies up to this size (m) may well be larger than all else, as tables are.
const LARGE: f64 = 2.0;
/// A revolute joint's limits, rad: beyond this it would wind up all its cables.
const MANY_RADIANS: f64 = 45.0;
/// From here on whole numbers are rather degrees.
const WHOLE_DEGREES: f64 = 20.0;
/// Greater ones mean that there is no limit.
const MOST_DEGREES: f64 = 720.0;
/// A prismatic joint's limits, m.
const LONG_SLIDE: f64 = 10.0;

/// One sentence for each number that is probably in another unit. `joints` have parents first.
pub fn warnings(shapes: &[Shape], joints: &[Joint], links: usize) -> Vec<String> {
    let mut warnings = Vec::new();
    // How far the farthest link is from the root, along the joints; and what else tells the size.
    let mut reach = vec![0.0; links];
    for joint in joints {
        reach[joint.child] = reach[joint.parent] + joint.origin.translation.vector.norm();
    }
    let sure = shapes.iter().filter(|shape| shape.unsure.is_none());
    let sizes = reach.into_iter().chain(sure.map(|shape| shape.extent));
    let size = sizes.fold(0.0, f64::max);
    for shape in shapes {
        let Some(mesh) = &shape.unsure else { continue };
        if shape.extent > LARGE && size > 0.0 && shape.extent > TOO_LARGE * size {
            warnings.push(format!(
                "link \"{}\": mesh \"{mesh}\" is {:.1} m large, and all else spans {size:.2} m: it is \
                 probably in millimetres and needs a scale",
                shape.link, shape.extent
            ));
        }
    }
    for joint in joints {
        let (low, high) = joint.limits;
        let most = low.abs().max(high.abs());
        let whole = low.fract() == 0.0 && high.fract() == 0.0;
        let name = &joint.name;
        match joint.motion {
            Motion::Revolute(_)
                if most <= MOST_DEGREES
                    && (most >= MANY_RADIANS || whole && most >= WHOLE_DEGREES) =>
            {
                warnings.push(format!(
                    "joint \"{name}\" turns from {low} to {high} rad: these limits are probably in degrees"
                ));
            }
            Motion::Prismatic(_) if most >= LONG_SLIDE => warnings.push(format!(
                "joint \"{name}\" slides from {low} to {high} m: are its limits in millimetres?"
            )),
            _ => {}
        }
    }
    warnings
}
