//! Writes the meshes of the dual-arm robot, `data/robots/arm/meshes/*.stl`, from solids:
//! `cargo run --example arm_meshes`.
//!
//! Solids of a link may overlap: each is closed, and only the outside of their union is seen.

mod arm_solids;
mod hand_solids;
mod outline;

use armpose::robot::Mesh;
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
        ("torso", arm_solids::torso()),
        ("wam_base", arm_solids::base()),
        ("wam1", arm_solids::shoulder()),
        ("wam2", arm_solids::upper_arm_in_shoulder()),
        ("wam3", arm_solids::upper_arm()),
        ("wam4", arm_solids::forearm()),
        ("wam5", arm_solids::wrist_yaw()),
        ("wam6", arm_solids::wrist_pitch()),
        ("wam7", arm_solids::lower_wrist()),
        ("hand_base", hand_solids::palm()),
        ("finger_knuckle", hand_solids::knuckle()),
        ("finger_proximal", hand_solids::proximal()),
        ("finger_distal", hand_solids::distal()),
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
