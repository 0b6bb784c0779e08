//! The transformations of a node.

use super::numbers;
use nalgebra::{Matrix4, Rotation3, Translation3, Unit, Vector3};
use roxmltree::Node;

/// The transformation that an element stands for; `None` when it is another kind of element.
pub fn read(element: Node) -> Result<Option<Matrix4<f64>>, String> {
    let matrix = match element.tag_name().name() {
        "matrix" => affine(element)?,
        "translate" => {
            let [x, y, z] = exactly(element)?;
            Translation3::new(x, y, z).to_homogeneous()
        }
        "rotate" => {
            let [x, y, z, degrees] = exactly(element)?;
            match Unit::try_new(Vector3::new(x, y, z), 1e-12) {
                Some(axis) => {
                    Rotation3::from_axis_angle(&axis, degrees.to_radians()).to_homogeneous()
                }
                // Some exporters write an axis of zeros for no rotation.
                None if degrees == 0.0 => Matrix4::identity(),
                None => return Err("its <rotate> has no axis".to_owned()),
            }
        }
        "scale" => Matrix4::new_nonuniform_scaling(&Vector3::from(exactly::<3>(element)?)),
        "lookat" => {
            let [ex, ey, ez, ix, iy, iz, ux, uy, uz] = exactly(element)?;
            let eye = Vector3::new(ex, ey, ez);
            let backward = eye - Vector3::new(ix, iy, iz);
            let up = Vector3::new(ux, uy, uz);
            if up.cross(&backward).norm() < 1e-12 {
                return Err("its <lookat> looks nowhere or along its up axis".to_owned());
            }
            Translation3::from(eye).to_homogeneous()
                * Rotation3::face_towards(&backward, &up).to_homogeneous()
        }
        "skew" => return Err("it uses <skew>, which is not read".to_owned()),
        _ => return Ok(None),
    };
    Ok(Some(matrix))
}

/// The rows of a 4x4 matrix whose last row is 0 0 0 1.
pub fn affine(element: Node) -> Result<Matrix4<f64>, String> {
    let matrix = Matrix4::from_row_slice(&exactly::<16>(element)?);
    let last = matrix.row(3) - Matrix4::identity().row(3);
    if last.abs().max() > 1e-6 {
        let name = element.tag_name().name();
        return Err(format!("the last row of its <{name}> is not 0 0 0 1"));
    }
    Ok(matrix)
}

/// The finite numbers that an element holds.
fn exactly<const N: usize>(element: Node) -> Result<[f64; N], String> {
    let numbers: Vec<f64> = numbers(element)?;
    let finite = numbers.iter().all(|x| x.is_finite());
    let exactly = <[f64; N]>::try_from(numbers).ok().filter(|_| finite);
    let name = element.tag_name().name();
    exactly.ok_or_else(|| format!("its <{name}> is not {N} finite numbers"))
}
