//! The solids of the BarrettHand BH280, measured, in metres and in the canonical frames of its
//! links: the palm looks along z, a finger points along x and bends about z toward y.

use super::outline::Axis::{self, X, Y, Z};
use super::outline::{
    Outline, arc, cuboid, cylinder, disc, extrude, hull, inset, loft, loft_both, turned,
};
use armpose::robot::Mesh;

pub fn palm() -> Vec<Mesh> {
    // The pad: z, its size relative to the plate's.
    let plate = hull(
        arc([0.0; 2], 0.0444, -29.0, 29.0)
            .into_iter()
            .chain([[0.0358, 0.024], [0.031, 0.0265]])
            .flat_map(|[x, y]| [[x, y], [-x, y], [x, -y], [-x, -y]]),
    );
    let pad = [
        (0.0665, 1.0, 1.0),
        (0.0753, 1.0, 1.0),
        (0.0757, 0.975, 0.92),
        (0.077, 0.966, 0.89),
        (0.0778, 0.92, 0.86),
        (0.0785, 0.78, 0.8),
        (0.0793, 0.45, 0.55),
    ]
    .map(|(z, u, v)| (z, plate.iter().map(|[x, y]| [x * u, y * v]).collect()));
    let profile = [
        [0.0425, 0.0],
        [0.0425, 0.002],
        [0.0418, 0.0025],
        [0.0418, 0.0048],
        [0.0444, 0.0052],
        [0.0444, 0.0415],
    ];
    let mut solids = vec![
        turned(Z, [0.0; 2], &profile),
        cuboid([-0.0124, 0.0124], [-0.042, 0.036], [0.041, 0.067]),
        cuboid([-0.0125, 0.0125], [-0.041, -0.026], [0.066, 0.07]),
        cuboid([-0.0125, 0.0125], [-0.031, -0.026], [0.07, 0.073]),
        loft(Z, &pad),
    ];
    solids.extend(finger_root(X, [0.0, 0.0754], [-0.0043, 0.0027]));
    solids
}

/// The fork that carries a proximal finger link, whose axis stands at 0.05 along the fork and
/// `origin` across; `slot` is open between two heights along `axis`.
fn finger_root(axis: Axis, origin: [f64; 2], slot: [f64; 2]) -> [Mesh; 3] {
    let placed = |outline: Outline| -> Outline {
        outline
            .iter()
            .map(|[u, v]| [u + origin[0], v + origin[1]])
            .collect()
    };
    let foot = [[0.027, -0.0334], [0.0505, -0.0334], [0.065, -0.0256]];
    let fork = placed(hull(
        (foot.into_iter())
            .chain(disc([0.05, 0.0], 0.015))
            .chain([[0.0275, -0.009]]),
    ));
    let solid = placed(hull(
        foot.into_iter().chain([[0.065, -0.0125], [0.027, -0.0125]]),
    ));
    [
        extrude(axis, &fork, [-0.0123, slot[0]]),
        extrude(axis, &fork, [slot[1], 0.0123]),
        extrude(axis, &solid, [-0.0123, 0.0123]),
    ]
}

pub fn knuckle() -> Vec<Mesh> {
    let mut body = arc([0.0; 2], 0.0123, 90.0, 270.0);
    body.extend([[0.045, -0.0123], [0.045, 0.0123]]);
    let mut solids = vec![
        extrude(Z, &body, [-0.0339, -0.0091]),
        cylinder(Z, [0.0; 2], 0.009, [-0.0389, -0.0039]),
    ];
    solids.extend(finger_root(Y, [0.0; 2], [-0.0027, 0.0043]));
    solids
}

pub fn proximal() -> Vec<Mesh> {
    let web = hull(
        disc([0.0; 2], 0.0124)
            .into_iter()
            .chain(disc([0.0699, 0.003], 0.0095)),
    );
    let body = vec![
        [0.0166, -0.009],
        [0.018, -0.0104],
        [0.0296, -0.01],
        [0.057, -0.0076],
        [0.0591, -0.0055],
        [0.0587, 0.0112],
        [0.0575, 0.0135],
        [0.054, 0.015],
        [0.0255, 0.015],
        [0.0165, 0.0095],
        [0.0158, 0.008],
    ];
    let bevel = [
        (-0.0097, 0.0022),
        (-0.0085, 0.0),
        (0.0087, 0.0),
        (0.0099, 0.0022),
    ];
    vec![
        extrude(Z, &web, [-0.0046, 0.003]),
        cylinder(Z, [0.0; 2], 0.01, [-0.0105, 0.0105]),
        loft(Z, &bevel.map(|(z, depth)| (z, inset(&body, depth)))),
        cylinder(Z, [0.0699, 0.003], 0.005, [-0.0077, 0.0099]),
    ]
}

pub fn distal() -> Vec<Mesh> {
    // The two shells on the sides, rounded outward.
    let mut side = vec![
        [0.0119, -0.0084],
        [0.0222, -0.0074],
        [0.0376, -0.0059],
        [0.0479, -0.005],
        [0.0545, -0.0042],
        [0.0562, -0.002],
        [0.0571, 0.0],
        [0.0568, 0.002],
        [0.0561, 0.004],
        [0.0547, 0.006],
        [0.052, 0.008],
        [0.0479, 0.0092],
        [0.0417, 0.01],
        [0.0325, 0.0106],
        [0.0181, 0.0103],
        [0.014, 0.0095],
    ];
    side.extend(arc([0.0; 2], 0.0095, 90.0, 265.0));
    let round = [
        (0.0077, 0.0),
        (0.009, 0.0005),
        (0.01, 0.001),
        (0.011, 0.0021),
        (0.0115, 0.0034),
    ];
    let mut solids = loft_both(Z, &round.map(|(z, depth)| (z, inset(&side, depth)))).to_vec();
    // The fork about the joint, open where the proximal link's web turns.
    let mut fork = arc([0.0; 2], 0.0095, 90.0, 265.0);
    fork.extend([[0.0181, -0.0079], [0.0181, 0.0095]]);
    solids.push(extrude(Z, &fork, [-0.0079, -0.005]));
    solids.push(extrude(Z, &fork, [0.0036, 0.0079]));
    // The core, with the finger's pad and a lip under the tip.
    let core = vec![
        [0.01, -0.0086],
        [0.016, -0.0081],
        [0.016, -0.005],
        [0.041, -0.005],
        [0.041, -0.0039],
        [0.0557, -0.0039],
        [0.0562, -0.002],
        [0.0574, 0.0],
        [0.0573, 0.002],
        [0.0566, 0.004],
        [0.0553, 0.006],
        [0.0529, 0.008],
        [0.045, 0.0099],
        [0.0417, 0.0103],
        [0.0376, 0.0108],
        [0.0325, 0.011],
        [0.0181, 0.0105],
        [0.0181, 0.0095],
        [0.01, 0.0095],
    ];
    solids.push(extrude(Z, &core, [-0.0079, 0.0079]));
    solids.push(cuboid([0.055, 0.059], [-0.0039, -0.003], [-0.0073, 0.0073]));
    solids
}
