//! The solids of the torso and of the Barrett WAM arm, measured, in metres and in the canonical
//! frames of the links.

use super::outline::Axis::{X, Y, Z};
use super::outline::{
    Outline, arc, clipped_disc, cuboid, cylinder, extrude, inset, loft, loft_both, rectangle, ring,
    segment, tube, turned,
};
use armpose::robot::Mesh;
use std::f64::consts::PI;

/// An arch: a half disc of radius `r` about the origin on legs down to `v = bottom`. All arches
/// have equally many points.
fn arch(r: f64, bottom: f64) -> Outline {
    let steps = 20;
    let mut outline: Outline = (0..=steps)
        .map(|i| {
            let (sin, cos) = (PI * i as f64 / steps as f64).sin_cos();
            [r * cos, r * sin]
        })
        .collect();
    outline.extend([[-r, bottom], [r, bottom]]);
    outline
}

/// The box between the arms and the neck's foot; the WAM bases are links of their own.
pub fn torso() -> Vec<Mesh> {
    let waist = vec![
        [-0.1147, -0.1016],
        [0.1147, -0.1016],
        [0.2, -0.016],
        [0.2, 0.1],
        [-0.2, 0.1],
        [-0.2, -0.016],
    ];
    vec![
        extrude(Z, &waist, [0.0016, 0.508]),
        cuboid([-0.033, 0.033], [0.054, 0.104], [0.508, 0.541]),
    ]
}

/// The rounded block behind the shoulder. Its connector end lies at +x.
pub fn base() -> Vec<Mesh> {
    let mut block = arc([0.0; 2], 0.14, 90.0, 270.0);
    block.extend([[0.22, -0.14], [0.22, 0.14]]);
    vec![extrude(Z, &block, [-0.346, -0.186])]
}

pub fn shoulder() -> Vec<Mesh> {
    let mut solids = vec![cylinder(Z, [0.0; 2], 0.14, [-0.186, -0.1237])];
    // The floor between the motors slopes like a roof from the middle to the rim.
    let roof = [
        (0.0, -0.0598),
        (0.0863, -0.1),
        (0.093, -0.1),
        (0.1155, -0.1115),
        (0.1323, -0.12),
        (0.1396, -0.1237),
    ];
    let sections: Vec<_> = (roof[1..].iter().rev().map(|&(x, z)| (-x, z)))
        .chain(roof)
        .map(|(x, z)| {
            let y = (0.14f64.powi(2) - x * x).sqrt().min(0.1045);
            (x, rectangle([-y, y], [-0.15, z]))
        })
        .collect();
    solids.push(loft(X, &sections));
    // Two stops on the rim.
    let stop = [
        [0.1, -0.124],
        [0.1326, -0.124],
        [0.1326, -0.1065],
        [0.1095, -0.0945],
        [0.1, -0.102],
    ];
    solids.push(extrude(Y, &stop.to_vec(), [-0.014, 0.014]));
    let opposite = stop.iter().rev().map(|[x, z]| [-x, *z]).collect();
    solids.push(extrude(Y, &opposite, [-0.014, 0.014]));
    // The motors on either side: y, radius, lower end.
    let motor = [
        (0.06, 0.0895, -0.186),
        (0.1045, 0.0893, -0.186),
        (0.1055, 0.0822, -0.186),
        (0.129, 0.0822, -0.186),
        (0.137, 0.0797, -0.1853),
        (0.1705, 0.0704, -0.1676),
        (0.1725, 0.056, -0.1666),
        (0.1738, 0.038, -0.1657),
    ];
    solids.extend(loft_both(
        Y,
        &motor.map(|(y, r, bottom)| (y, arch(r, bottom))),
    ));
    solids
}

/// Two tubes that meet at right angles, hollow.
pub fn upper_arm_in_shoulder() -> Vec<Mesh> {
    let mut sleeve = ring(Y, [0.0; 2], [0.0445, 0.06], [-0.109, 0.0]);
    // Its inner end follows the wall of the other tube.
    for v in sleeve.vertices.iter_mut().filter(|v| v[1] == 0.0) {
        v[1] = -(0.0618f32.powi(2) - v[0] * v[0]).sqrt();
    }
    vec![ring(Z, [0.0; 2], [0.06, 0.0635], [-0.06, 0.06]), sleeve]
}

pub fn upper_arm() -> Vec<Mesh> {
    // A fork of two plates, each of a wide inner and a narrower outer layer. Outlines in (x, z).
    let mut inner = arc([0.045, 0.55], 0.04, -45.0, 135.0);
    inner.extend(arc([0.0, 0.4995], 0.0445, 135.0, 180.0));
    inner.extend([[-0.0445, 0.486], [-0.0361, 0.474], [-0.03, 0.464]]);
    inner.extend([
        [0.03, 0.464],
        [0.0361, 0.474],
        [0.0445, 0.486],
        [0.0445, 0.493],
    ]);
    let mut outer = arc([0.045, 0.55], 0.0362, -45.0, 135.0);
    outer.extend([
        [-0.0235, 0.5325],
        [-0.027, 0.527],
        [-0.027, 0.476],
        [-0.0245, 0.468],
    ]);
    outer.extend([[-0.018, 0.4655], [0.0215, 0.4655], [0.0385, 0.4825]]);
    outer.extend([[0.041, 0.488], [0.0412, 0.4945]]);
    let mut solids = vec![
        ring(Z, [0.0; 2], [0.0435, 0.0445], [0.0, 0.484]),
        // The tube widens to a square below the fork.
        tube(
            Z,
            &[
                (0.46, 0.0375, 0.0446),
                (0.468, 0.0375, 0.0461),
                (0.474, 0.0375, 0.0497),
                (0.48, 0.0375, 0.0531),
                (0.486, 0.0375, 0.056),
                (0.486, 0.0372, 0.0435),
                (0.46, 0.0372, 0.0435),
            ]
            .map(|(z, y, round)| (z, clipped_disc([0.0445, y], round))),
        ),
        // The cable drum and its axle.
        cylinder(Y, [0.0, 0.5055], 0.031, [-0.0105, 0.0105]),
        cylinder(Y, [0.0, 0.505], 0.0092, [-0.034, 0.034]),
    ];
    solids.extend(loft_both(Y, &[0.0318, 0.0375].map(|y| (y, inner.clone()))));
    let bevel = [(0.0375, 0.0), (0.0465, 0.0003), (0.048, 0.0022)];
    solids.extend(loft_both(
        Y,
        &bevel.map(|(y, depth)| (y, inset(&outer, depth))),
    ));
    solids
}

pub fn forearm() -> Vec<Mesh> {
    let axis = -0.045;
    let mut solids = vec![
        ring(Z, [0.0; 2], [0.028, 0.0298], [-0.013, 0.013]),
        ring(Z, [0.0; 2], [0.028, 0.053], [0.012, 0.0315]),
        ring(Z, [0.0; 2], [0.028, 0.053], [-0.0315, -0.012]),
        // Between the rings the neck is cut round the cable drum.
        extrude(
            Z,
            &neck(0.0, arc([0.0; 2], 0.053, 269.5, 207.0)),
            [-0.0125, 0.0125],
        ),
    ];
    // Beside the rings it stays within the round of the forearm.
    let plate = [0.012, 0.02, 0.0255, 0.0295, 0.0315];
    solids.extend(loft_both(
        Z,
        &plate.map(|z| (z, neck(z, vec![[0.0, -0.05], [-0.048, -0.0195]]))),
    ));
    let profile = [[0.0445, -0.2788], [0.0445, -0.0675], [0.0325, -0.0555]];
    solids.push(turned(Y, [axis, 0.0], &profile));
    // The motors of the wrist, and a cable rail.
    for side in [-1.0, 1.0] {
        solids.push(cylinder(
            Y,
            [axis, side * 0.0252],
            0.0305,
            [-0.1486, -0.1015],
        ));
    }
    solids.push(cuboid(
        [axis - 0.0054, axis + 0.0054],
        [-0.2485, -0.148],
        [-0.048, -0.04],
    ));
    solids
}

/// The outline in (x, y) of the forearm's neck at height `z`, closed by the given edge toward the
/// elbow's axis, which runs from right to left.
fn neck(z: f64, edge: Outline) -> Outline {
    let half = (0.0445f64.powi(2) - z * z).sqrt();
    let (left, right) = (-0.045 - half, -0.045 + half);
    let slant = |x: f64| -0.022 - (-0.0503 - x) / 1.045;
    let mut outline = vec![[-0.0503, -0.022], [left + 0.0025, slant(left + 0.0025)]];
    outline.extend([
        [left + 0.0005, slant(left) - 0.004],
        [left, -0.068],
        [right, -0.068],
    ]);
    outline.push([right, edge[0][1] - 0.003]);
    outline.extend(edge);
    outline
}

pub fn wrist_yaw() -> Vec<Mesh> {
    // z, half widths in x and y, and the round that cuts the corners; a bore goes through.
    let profile = [
        (0.2728, 0.0425, 0.0425, 0.0425),
        (0.2787, 0.0425, 0.0425, 0.0425),
        (0.2787, 0.0425, 0.019, 0.0425),
        (0.2825, 0.0424, 0.019, 0.0425),
        (0.29, 0.0296, 0.019, 0.0425),
        (0.291, 0.0284, 0.02, 0.0425),
        (0.2925, 0.0268, 0.02, 0.0425),
        (0.295, 0.0252, 0.02, 0.0425),
        (0.2975, 0.0243, 0.02, 0.0425),
        (0.305, 0.0234, 0.02, 0.0425),
        (0.309, 0.0222, 0.02, 0.03),
        (0.31, 0.022, 0.019, 0.0265),
        (0.315, 0.0219, 0.019, 0.024),
        (0.3175, 0.0219, 0.019, 0.0222),
        (0.322, 0.0217, 0.019, 0.022),
        (0.324, 0.0208, 0.0185, 0.021),
        (0.324, 0.0208, 0.0185, 0.0083),
        (0.2728, 0.0425, 0.0425, 0.0083),
    ];
    vec![tube(
        Z,
        &profile.map(|(z, x, y, round)| (z, clipped_disc([x, y], round))),
    )]
}

pub fn wrist_pitch() -> Vec<Mesh> {
    let drum = [
        [0.0133, 0.0133],
        [0.0146, 0.0142],
        [0.0146, 0.017],
        [0.0176, 0.017],
        [0.0176, 0.019],
        [0.0202, 0.019],
        [0.0202, 0.023],
        [0.0235, 0.023],
        [0.0235, 0.0247],
        [0.0248, 0.0247],
        [0.0248, 0.0317],
        [0.02, 0.0317],
        [0.02, 0.04],
    ];
    let mut solids = vec![
        // The flange.
        ring(Y, [0.0; 2], [0.014, 0.0185], [-0.0604, -0.0459]),
        ring(Y, [0.0; 2], [0.014, 0.0425], [-0.054, -0.0478]),
        ring(Y, [0.0; 2], [0.014, 0.0444], [-0.0478, -0.0459]),
        // The cable drum above.
        turned(Z, [0.0; 2], &drum),
        // Cheeks of sheet metal on either side of it.
        cuboid([-0.0203, -0.0191], [-0.046, -0.012], [0.0178, 0.0396]),
        cuboid([0.0191, 0.0203], [-0.046, -0.012], [0.0178, 0.0396]),
        cuboid([-0.0203, 0.0203], [-0.048, -0.0413], [0.0178, 0.0396]),
        cylinder(Z, [0.0; 2], 0.0145, [-0.0205, -0.0135]),
    ];
    // The lid, round like the flange in x and like the drum in y.
    let lid = [-0.0475, 0.0, 0.006, 0.011, 0.015, 0.018, 0.0198].map(|y: f64| {
        let half = (0.0203f64.powi(2) - y.max(0.0).powi(2)).sqrt();
        (y, segment(0.0444, 0.0393, half))
    });
    solids.push(loft(Y, &lid));
    // The gussets fill the round of the flange up to a hollow for the forearm's end.
    let gusset = [-0.0459, -0.044, -0.04, -0.035, -0.03, -0.026].map(|y: f64| {
        let hollow = (0.0503f64.powi(2) - (y - 0.0041).powi(2)).sqrt();
        (y, segment(0.0444, hollow.max(0.0145), 1.0))
    });
    solids.push(loft(Y, &gusset));
    let below = gusset.map(|(y, o)| (y, o.iter().map(|[x, z]| [-x, -z]).collect()));
    solids.push(loft(Y, &below));
    // The motor below, with a bevelled end.
    let motor = arch(0.0195, -0.0196);
    let motor: Outline = motor.iter().map(|[x, z]| [-x, -0.0391 - z]).collect();
    let sections = [
        (-0.0479, 0.0),
        (0.0075, 0.0),
        (0.0098, 0.0025),
        (0.0111, 0.0045),
    ];
    solids.push(loft(
        Y,
        &sections.map(|(y, depth)| (y, inset(&motor, depth))),
    ));
    solids
}

/// The tool flange and the force sensor, recessed at both ends.
pub fn lower_wrist() -> Vec<Mesh> {
    vec![
        ring(Z, [0.0; 2], [0.0425, 0.0445], [0.0479, 0.077]),
        ring(Z, [0.0; 2], [0.0189, 0.0426], [0.0525, 0.061]),
        cylinder(Z, [0.0; 2], 0.0428, [0.0597, 0.0705]),
    ]
}
