//! Writes the meshes of the dual-arm robot, `data/robots/arm/meshes/*.stl`, from the solids below:
//! `cargo run --example arm_meshes`.
//!
//! The measures are those of Barrett's WAM arm and BH280 hand, in metres and in the canonical
//! frames of the links. Solids of a link may overlap: each is closed, and only the outside of
//! their union is ever seen.

mod outline;

use armpose::robot::Mesh;
use outline::Axis::{X, Y, Z};
use outline::{Outline, arc, cuboid, cylinder, disc, extrude, hull, loft, rectangle, ring, turned};
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

/// An arch: a half disc of radius `r` about the origin on legs down to `v = bottom`.
fn arch(r: f64, bottom: f64) -> Outline {
    let mut outline = arc([0.0; 2], r, 0.0, 180.0);
    outline.extend([[-r, bottom], [r, bottom]]);
    outline
}

/// The same outline at both signs of the height: two plates.
fn pair(axis: outline::Axis, outline: &Outline, [low, high]: [f64; 2]) -> [Mesh; 2] {
    [
        extrude(axis, outline, [low, high]),
        extrude(axis, outline, [-high, -low]),
    ]
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
    let mut solids = vec![
        turned(&[
            [0.14, -0.186],
            [0.14, -0.128],
            [0.136, -0.128],
            [0.122, -0.1],
        ]),
        cuboid([-0.0895, 0.0895], [-0.1, 0.1], [-0.186, -0.063]),
    ];
    // The motors on either side, bevelled outward.
    let bevel = [
        (0.06, 0.0895, -0.186),
        (0.105, 0.0895, -0.186),
        (0.12, 0.082, -0.183),
        (0.146, 0.077, -0.183),
        (0.1738, 0.046, -0.174),
    ];
    let sections = bevel.map(|(y, r, bottom)| (y, arch(r, bottom)));
    solids.push(loft(Y, &sections));
    let mut mirrored = sections.map(|(y, outline)| (-y, outline));
    mirrored.reverse();
    solids.push(loft(Y, &mirrored));
    solids
}

fn upper_arm_in_shoulder() -> Vec<Mesh> {
    vec![
        cylinder(Z, [0.0; 2], 0.0635, [-0.06, 0.06]),
        ring(Y, [0.0; 2], [0.0445, 0.06], [-0.109, 0.0]),
    ]
}

fn upper_arm() -> Vec<Mesh> {
    let fork = hull(
        disc([0.045, 0.55], 0.04)
            .into_iter()
            .chain(disc([0.0, 0.506], 0.0445))
            .chain([
                [-0.0445, 0.465],
                [0.027, 0.465],
                [0.0445, 0.486],
                [-0.0445, 0.486],
            ]),
    );
    let mut solids = vec![
        cylinder(Z, [0.0; 2], 0.0445, [0.0, 0.488]),
        cylinder(Y, [0.0, 0.505], 0.0315, [-0.012, 0.012]),
    ];
    solids.extend(pair(Y, &fork, [0.032, 0.048]));
    solids
}

fn forearm() -> Vec<Mesh> {
    let neck = vec![
        [-0.05, -0.018],
        [-0.0778, -0.0483],
        [-0.0887, -0.0627],
        [-0.0895, -0.078],
        [-0.0005, -0.078],
        [-0.0005, -0.066],
        [0.0218, -0.0483],
        [0.049, -0.02],
        [0.0, -0.028],
    ];
    vec![
        ring(Z, [0.0; 2], [0.0285, 0.053], [0.012, 0.0315]),
        ring(Z, [0.0; 2], [0.0285, 0.053], [-0.0315, -0.012]),
        extrude(Z, &neck, [-0.0315, 0.0315]),
        cylinder(Y, [-0.045, 0.0], 0.0445, [-0.2788, -0.0665]),
        cuboid([-0.0672, -0.0228], [-0.1486, -0.1015], [-0.0505, 0.0505]),
        cuboid([-0.0549, -0.0351], [-0.1486, -0.1015], [-0.0558, 0.0558]),
    ]
}

fn wrist_yaw() -> Vec<Mesh> {
    let prism = [
        (0.2785, 0.0425),
        (0.2846, 0.0388),
        (0.2901, 0.0294),
        (0.2956, 0.0249),
        (0.3067, 0.023),
        (0.3122, 0.022),
        (0.324, 0.0215),
    ];
    let sections = prism.map(|(z, x)| (z, rectangle([-x, x], [-0.0193, 0.0193])));
    vec![
        cylinder(Z, [0.0; 2], 0.0425, [0.2728, 0.2785]),
        loft(Z, &sections),
    ]
}

fn wrist_pitch() -> Vec<Mesh> {
    let cheek = hull(
        disc([0.0; 2], 0.0247)
            .into_iter()
            .chain(rectangle([-0.0203, 0.0203], [-0.046, 0.0])),
    );
    let gusset = |bottom: f64, top: f64| {
        vec![
            [-bottom, -0.046],
            [bottom, -0.046],
            [top, -0.022],
            [-top, -0.022],
        ]
    };
    vec![
        cylinder(Y, [0.0; 2], 0.0435, [-0.054, -0.0455]),
        cylinder(Y, [0.0; 2], 0.0188, [-0.0604, -0.054]),
        extrude(Z, &cheek, [0.0165, 0.0437]),
        cuboid([-0.0204, 0.0204], [-0.047, 0.009], [-0.047, -0.02]),
        cuboid([-0.012, 0.012], [-0.047, 0.009], [-0.0586, -0.047]),
        extrude(Z, &gusset(0.0445, 0.02), [0.012, 0.032]),
        extrude(Z, &gusset(0.0425, 0.0204), [-0.03, -0.012]),
        cylinder(Z, [0.0; 2], 0.011, [-0.0205, -0.014]),
    ]
}

/// The tool flange and the force sensor.
fn lower_wrist() -> Vec<Mesh> {
    vec![cylinder(Z, [0.0; 2], 0.0445, [0.0479, 0.077])]
}

fn palm() -> Vec<Mesh> {
    let clipped = |r: f64, low: f64, high: f64| -> Outline {
        let right = (1.0 - (low / r).powi(2)).sqrt() * r;
        let mut outline = arc(
            [0.0; 2],
            r,
            -outline::degrees(right, -low),
            outline::degrees((r * r - high * high).sqrt(), high),
        );
        outline.extend(outline.clone().iter().rev().map(|&[x, y]| [-x, y]));
        outline
    };
    let fork = hull(disc([0.05, 0.0754], 0.015).into_iter().chain([
        [0.028, 0.042],
        [0.05, 0.042],
        [0.065, 0.05],
        [0.065, 0.067],
        [0.032, 0.072],
        [0.027, 0.067],
    ]));
    let root = vec![
        [0.028, 0.042],
        [0.05, 0.042],
        [0.065, 0.05],
        [0.065, 0.066],
        [0.027, 0.066],
    ];
    let mut solids = vec![
        cylinder(Z, [0.0; 2], 0.0444, [0.0, 0.041]),
        cuboid([-0.0125, 0.0125], [-0.042, 0.034], [0.041, 0.067]),
        extrude(Z, &clipped(0.0444, -0.0335, 0.026), [0.067, 0.0755]),
        extrude(Z, &clipped(0.0435, -0.024, 0.024), [0.0755, 0.079]),
        cuboid([-0.0125, 0.0125], [-0.042, -0.03], [0.067, 0.0705]),
        extrude(X, &root, [-0.0123, 0.0123]),
    ];
    solids.extend(pair(X, &fork, [0.0035, 0.0123]));
    solids
}

fn knuckle() -> Vec<Mesh> {
    let mut body = arc([0.0; 2], 0.0123, 90.0, 270.0);
    body.extend([[0.055, -0.0123], [0.055, 0.0123]]);
    let fork = hull(disc([0.05, 0.0], 0.015).into_iter().chain([
        [0.029, -0.009],
        [0.029, -0.0339],
        [0.05, -0.0339],
        [0.065, -0.026],
        [0.065, 0.0],
    ]));
    let root = vec![
        [0.029, -0.0339],
        [0.05, -0.0339],
        [0.065, -0.026],
        [0.065, -0.009],
        [0.029, -0.009],
    ];
    let mut solids = vec![
        extrude(Z, &body, [-0.0339, -0.0091]),
        cylinder(Z, [0.0; 2], 0.009, [-0.0389, -0.0039]),
        extrude(Y, &root, [-0.0123, 0.0123]),
    ];
    solids.extend(pair(Y, &fork, [0.0035, 0.0123]));
    solids
}

fn proximal() -> Vec<Mesh> {
    let web = hull(
        disc([0.0; 2], 0.0125)
            .into_iter()
            .chain(disc([0.0699, 0.003], 0.0095)),
    );
    let body = vec![
        [0.0195, -0.011],
        [0.06, -0.0073],
        [0.06, 0.0125],
        [0.052, 0.015],
        [0.026, 0.015],
        [0.0195, 0.0125],
    ];
    vec![
        extrude(Z, &web, [-0.0046, 0.003]),
        cylinder(Z, [0.0; 2], 0.0123, [-0.0105, 0.0105]),
        extrude(Z, &body, [-0.0097, 0.0099]),
        cylinder(Z, [0.0699, 0.003], 0.0045, [-0.0077, 0.01]),
    ]
}

fn distal() -> Vec<Mesh> {
    let mut side = vec![
        [0.0119, -0.0084],
        [0.0222, -0.0074],
        [0.0376, -0.0059],
        [0.0479, -0.0054],
        [0.056, -0.005],
        [0.0565, 0.0],
        [0.0555, 0.004],
        [0.0531, 0.0079],
        [0.0479, 0.0095],
        [0.0428, 0.0103],
        [0.0376, 0.0108],
        [0.0325, 0.011],
        [0.02, 0.011],
        [0.0195, 0.0095],
    ];
    let front: Outline = side
        .iter()
        .copied()
        .chain([[0.01, 0.0095], [0.01, -0.0086]])
        .collect();
    side.extend(arc([0.0; 2], 0.0095, 90.0, 270.0));
    vec![
        extrude(Z, &side, [-0.0115, -0.005]),
        extrude(Z, &side, [0.0036, 0.0115]),
        extrude(Z, &front, [-0.0105, 0.0105]),
    ]
}
