//! The committed meshes are what the script makes, and they are sound solids.

#[path = "../scripts/arm_meshes.rs"]
#[allow(dead_code)]
mod arm_meshes;

use arm_meshes::{binary_stl, meshes};
use nalgebra::Vector3;
use std::collections::HashMap;
use std::path::Path;

#[test]
fn the_script_makes_the_committed_files() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm/meshes");
    let meshes = meshes();
    for (name, mesh) in &meshes {
        let committed = std::fs::read(folder.join(format!("{name}.stl"))).unwrap();
        let made = binary_stl(mesh);
        assert_eq!(
            made.len(),
            committed.len(),
            "{name}: numbers of triangles differ"
        );
        for (made, committed) in numbers(&made).zip(numbers(&committed)) {
            // The last bit of a sine may differ between platforms.
            assert!(
                (made - committed).abs() < 1e-6,
                "{name}: {made} is not {committed}"
            );
        }
    }
    let files = std::fs::read_dir(folder).unwrap().count();
    assert_eq!(
        files,
        meshes.len(),
        "there are files that the script does not make"
    );
}

/// All coordinates in a binary STL file.
fn numbers(file: &[u8]) -> impl Iterator<Item = f32> {
    let triangles = file[84..].chunks_exact(50);
    triangles.flat_map(|t| {
        t[..48]
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
    })
}

#[test]
fn every_solid_is_closed_and_faces_outward() {
    for (name, mesh) in meshes() {
        for piece in mesh.components() {
            let corner = |i: u32| Vector3::from(piece.vertices[i as usize].map(f64::from));
            let mut open = HashMap::new();
            let mut six_volumes = 0.0;
            for &[a, b, c] in &piece.triangles {
                six_volumes += corner(a).cross(&corner(b)).dot(&corner(c));
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    *open.entry((from, to)).or_insert(0) += 1;
                    *open.entry((to, from)).or_insert(0) -= 1;
                }
            }
            assert!(open.values().all(|&n| n == 0), "{name} has an open edge");
            assert!(six_volumes > 0.0, "{name} has a solid that is inside out");
        }
    }
}

#[test]
fn both_arms_have_a_reasonable_number_of_triangles() {
    let robot = armpose::robot::Robot::from_urdf(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm/arm.urdf"),
    )
    .unwrap();
    let triangles: usize = robot.links.iter().map(|l| l.mesh.triangles.len()).sum();
    println!("{triangles} triangles");
    assert!((10_000..30_000).contains(&triangles), "{triangles}");
}
