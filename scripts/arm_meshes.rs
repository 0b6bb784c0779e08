//! Writes the meshes of the dual-arm robot, `data/robots/arm/meshes/*.stl`, from the solids below:
//! `cargo run --example arm_meshes`.
//!
//! The measures are those of Barrett's WAM arm and BH280 hand, in metres and in the canonical
//! frames of the links. Solids of a link may overlap: each is closed, and only the outside of
//! their union is ever seen.

mod outline;

use armpose::robot::Mesh;
use outline::Axis::{X, Y, Z};
use outline::{
    Outline, arc, clipped_disc, cuboid, cylinder, disc, extrude, hull, inset, loft, rectangle,
    ring, segment, tube, turned,
};
use std::f64::consts::PI;
use std::path::Path;

fn main() -> std::io::Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm/meshes");
    for (name, mesh) in meshes() {
        std::fs::write(folder.join(format!("{name}.stl")), binary_stl(&mesh))?;
        println!("{name}.stl: {} triangles", mesh.triangles.len());
    }
    Ok(())
}

/// File name without ending, and mesh.
pub fn meshes() -> Vec<(&'static str, Mesh)> {
    let links: [(&'static str, Vec<Mesh>); 13] = [
        ("torso", torso()),
        ("wam_base", base()),
        ("wam1", shoulder()),
        ("wam2", upper_arm_in_shoulder()),
        ("wam3", upper_arm()),
        ("wam4", forearm()),
        ("wam5", wrist_yaw()),
        ("wam6", wrist_pitch()),
        ("wam7", lower_wrist()),
        ("hand_base", palm()),
        ("finger_knuckle", knuckle()),
        ("finger_proximal", proximal()),
        ("finger_distal", distal()),
    ];
    links
        .into_iter()
        .map(|(name, solids)| {
            let mut merged = Mesh::default();
            solids.iter().for_each(|solid| merged.append(solid));
            (name, merged)
        })
        .collect()
}

/// The binary STL file of a mesh: an 80-byte header, the number of triangles, and for each its
/// normal, corners and two spare bytes, little-endian.
pub fn binary_stl(mesh: &Mesh) -> Vec<u8> {
    let mut file = vec![0; 80];
    file[..24].copy_from_slice(b"made by arm_meshes.rs   ");
    file.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in &mesh.triangles {
        let corners = triangle.map(|i| mesh.vertices[i as usize]);
        // Readers take the normal from the corners; zero says so.
        for x in [0.0f32; 3].iter().chain(corners.iter().flatten()) {
            file.extend(x.to_le_bytes());
        }
        file.extend([0; 2]);
    }
    file
}

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

/// The loft and its mirror image at negative heights.
fn mirrored(axis: outline::Axis, sections: &[(f64, Outline)]) -> [Mesh; 2] {
    let negative: Vec<_> = sections
        .iter()
        .rev()
        .map(|(h, o)| (-h, o.clone()))
        .collect();
    [loft(axis, sections), loft(axis, &negative)]
}

/// The box between the arms and the neck's foot; the WAM bases are links of their own.
fn torso() -> Vec<Mesh> {
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
fn base() -> Vec<Mesh> {
    let mut block = arc([0.0; 2], 0.14, 90.0, 270.0);
    block.extend([[0.22, -0.14], [0.22, 0.14]]);
    vec![extrude(Z, &block, [-0.346, -0.186])]
}

fn shoulder() -> Vec<Mesh> {
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
    solids.extend(mirrored(
        Y,
        &motor.map(|(y, r, bottom)| (y, arch(r, bottom))),
    ));
    solids
}

/// Two tubes that meet at right angles, hollow.
fn upper_arm_in_shoulder() -> Vec<Mesh> {
    let mut sleeve = ring(Y, [0.0; 2], [0.0445, 0.06], [-0.109, 0.0]);
    // Its inner end follows the wall of the other tube.
    for v in sleeve.vertices.iter_mut().filter(|v| v[1] == 0.0) {
        v[1] = -(0.0618f32.powi(2) - v[0] * v[0]).sqrt();
    }
    vec![ring(Z, [0.0; 2], [0.06, 0.0635], [-0.06, 0.06]), sleeve]
}

fn upper_arm() -> Vec<Mesh> {
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
    solids.extend(mirrored(Y, &[0.0318, 0.0375].map(|y| (y, inner.clone()))));
    let bevel = [(0.0375, 0.0), (0.0465, 0.0003), (0.048, 0.0022)];
    solids.extend(mirrored(
        Y,
        &bevel.map(|(y, depth)| (y, inset(&outer, depth))),
    ));
    solids
}

fn forearm() -> Vec<Mesh> {
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
    solids.extend(mirrored(
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

fn wrist_yaw() -> Vec<Mesh> {
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

fn wrist_pitch() -> Vec<Mesh> {
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
        (y, segment(0.0444, hollow, 1.0))
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
fn lower_wrist() -> Vec<Mesh> {
    vec![
        ring(Z, [0.0; 2], [0.0425, 0.0445], [0.0479, 0.077]),
        ring(Z, [0.0; 2], [0.0189, 0.0426], [0.0525, 0.061]),
        cylinder(Z, [0.0; 2], 0.0428, [0.0597, 0.0705]),
    ]
}

fn palm() -> Vec<Mesh> {
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
fn finger_root(axis: outline::Axis, origin: [f64; 2], slot: [f64; 2]) -> [Mesh; 3] {
    let placed = |outline: Outline| -> Outline {
        outline
            .iter()
            .map(|[u, v]| [u + origin[0], v + origin[1]])
            .collect()
    };
    let foot = [[0.027, -0.0339], [0.0485, -0.0339], [0.065, -0.0245]];
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

fn knuckle() -> Vec<Mesh> {
    let mut body = arc([0.0; 2], 0.0123, 90.0, 270.0);
    body.extend([[0.055, -0.0123], [0.055, 0.0123]]);
    let mut solids = vec![
        extrude(Z, &body, [-0.0339, -0.0105]),
        cylinder(Z, [0.0; 2], 0.009, [-0.0389, -0.0039]),
    ];
    solids.extend(finger_root(Y, [0.0; 2], [-0.0027, 0.0043]));
    solids
}

fn proximal() -> Vec<Mesh> {
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

fn distal() -> Vec<Mesh> {
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
    let mut solids = mirrored(Z, &round.map(|(z, depth)| (z, inset(&side, depth)))).to_vec();
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
