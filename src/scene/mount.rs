//! Where a `robot.toml` says that the camera is.

use nalgebra::{
    Isometry3, Matrix3, Matrix4, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3,
};
use serde::Deserialize;
use toml::{Table, Value};

/// The table `[camera]`: the link that carries it and, unless it is the camera's optical frame, the pose of
/// one in the frame of the other: a 4x4 matrix, or `{ xyz, quaternion_xyzw }`, `{ xyz, quaternion_wxyz }` or
/// `{ xyz, rpy }` as in a URDF.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraMount {
    pub link: String,
    camera_from_link: Option<Value>,
    link_from_camera: Option<Value>,
}

/// What a mount says.
pub(super) struct Mounted {
    pub camera_from_link: Isometry3<f64>,
    /// What was put right.
    pub note: Option<String>,
    /// What the pose would be if a convention was mistaken for another, and for which.
    pub misreadings: Vec<(String, Isometry3<f64>)>,
}

impl CameraMount {
    /// The pose. The error is a sentence.
    pub(super) fn read(&self) -> Result<Mounted, String> {
        let (name, other, value) = match (&self.camera_from_link, &self.link_from_camera) {
            (Some(_), Some(_)) => {
                return Err("camera_from_link and link_from_camera say the same; give one".into());
            }
            (Some(value), None) => ("camera_from_link", "link_from_camera", value),
            (None, Some(value)) => ("link_from_camera", "camera_from_link", value),
            (None, None) => {
                let body = optical_from_body();
                return Ok(Mounted {
                    camera_from_link: Isometry3::identity(),
                    note: None,
                    misreadings: vec![(
                        format!("if {} is no optical frame but {BODY}", self.link),
                        body,
                    )],
                });
            }
        };
        let fail = |message: String| format!("{name}: {message}");
        let given = Given::read(value).map_err(fail)?;
        let as_named = |pose: Isometry3<f64>| match name {
            "camera_from_link" => pose,
            _ => pose.inverse(),
        };
        let pose = as_named(given.pose);
        let swapped = pose.inverse();
        let body = optical_from_body();
        let mut misreadings = vec![
            (format!("as {other}"), swapped),
            (format!("if its camera's frame is {BODY}"), body * pose),
            (
                format!("as {other} of a camera whose frame is {BODY}"),
                body * swapped,
            ),
        ];
        if let Some((order, pose)) = given.other_order {
            misreadings.push((format!("as {order}"), as_named(pose)));
            misreadings.push((format!("as {other} with {order}"), as_named(pose).inverse()));
        }
        Ok(Mounted {
            camera_from_link: pose,
            note: given.note.map(|note| format!("the camera's {name} {note}")),
            misreadings,
        })
    }
}

const BODY: &str = "one of ROS's bodies (x forward, z up)";

/// From a frame with x forward, y left, z up to the optical one with x right, y down, z forward.
fn optical_from_body() -> Isometry3<f64> {
    let turn = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
    rigid(Vector3::zeros(), &Rotation3::from_matrix_unchecked(turn))
}

fn rigid(shift: Vector3<f64>, turn: &Rotation3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(shift.into(), UnitQuaternion::from_rotation_matrix(turn))
}

/// A pose as it stands in the file.
struct Given {
    pose: Isometry3<f64>,
    note: Option<String>,
    /// Of a quaternion: the pose if its numbers stand in the other order.
    other_order: Option<(&'static str, Isometry3<f64>)>,
}

/// No camera is farther from its link, m: depth images do not reach farther.
const FARTHEST: f64 = 65.0;

impl Given {
    fn read(value: &Value) -> Result<Given, String> {
        let given = match value {
            Value::Array(rows) => {
                let rows: Option<Vec<[f64; 4]>> = rows.iter().map(numbers).collect();
                let rows = rows.and_then(|rows| <[[f64; 4]; 4]>::try_from(rows).ok());
                Given::matrix(&rows.ok_or("it must have four rows of four numbers")?)?
            }
            Value::Table(table) => Given::parts(table)?,
            _ => return Err("it must be a matrix or a table".to_owned()),
        };
        let far = given.pose.translation.vector.norm();
        match far <= FARTHEST {
            true => Ok(given),
            false => Err(format!(
                "the camera would be {far:.0} m from its link; are these millimetres? they must be metres"
            )),
        }
    }

    /// A matrix that is rounded to a few decimals is put right; to three decimals and better in silence.
    fn matrix(rows: &[[f64; 4]; 4]) -> Result<Given, String> {
        let matrix = Matrix4::from_fn(|row, column| rows[row][column]);
        let turn: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into_owned();
        if !matrix.iter().all(|x| x.is_finite()) {
            return Err("its numbers must be finite".to_owned());
        }
        if rows[3] != [0.0, 0.0, 0.0, 1.0] {
            let behind = rows.map(|row| row[3]) == [0.0, 0.0, 0.0, 1.0];
            return Err(match behind {
                true => "its last row must be 0 0 0 1; it looks transposed".to_owned(),
                false => "its last row must be 0 0 0 1".to_owned(),
            });
        }
        let off = (turn.transpose() * turn - Matrix3::identity()).abs().max();
        let shift = Vector3::new(rows[0][3], rows[1][3], rows[2][3]);
        if off < ROUNDED && turn.determinant() > 0.0 {
            let turn = Rotation3::from_matrix(&turn);
            let shift = Translation3::from(shift);
            return Ok(Given {
                pose: Isometry3::from_parts(shift, UnitQuaternion::from_rotation_matrix(&turn)),
                note: None,
                other_order: None,
            });
        }
        if let Some(reason) = no_rotation(&turn, off) {
            return Err(format!("it is no rotation and translation: {reason}"));
        }
        let svd = turn.svd(true, true);
        let (Some(u), Some(v)) = (svd.u, svd.v_t) else {
            return Err("it is no rotation and translation".to_owned());
        };
        let nearest = u * v;
        let angles = (0..3).map(|axis| turn.column(axis).angle(&nearest.column(axis)));
        let most = angles.fold(0.0, f64::max).to_degrees();
        Ok(Given {
            pose: rigid(shift, &Rotation3::from_matrix_unchecked(nearest)),
            note: Some(format!(
                "is only nearly a rotation; the nearest one was taken, which turns its axes by up to \
                 {most:.2} degrees"
            )),
            other_order: None,
        })
    }

    fn parts(table: &Table) -> Result<Given, String> {
        const TURNS: [&str; 3] = ["quaternion_xyzw", "quaternion_wxyz", "rpy"];
        let forms = "it must have xyz and one of quaternion_xyzw, quaternion_wxyz, rpy";
        if let Some(key) =
            (table.keys()).find(|key| *key != "xyz" && !TURNS.contains(&key.as_str()))
        {
            return Err(format!("{key} is not known; {forms}"));
        }
        let turns: Vec<&str> = TURNS
            .into_iter()
            .filter(|key| table.contains_key(*key))
            .collect();
        let (Some(xyz), [turn]) = (table.get("xyz"), &turns[..]) else {
            return Err(forms.to_owned());
        };
        let shift: [f64; 3] = numbers(xyz).ok_or("xyz must be three finite numbers, in metres")?;
        let at = |turn| Isometry3::from_parts(Translation3::from(Vector3::from(shift)), turn);
        if *turn == "rpy" {
            let rpy: Option<[f64; 3]> = numbers(&table["rpy"]);
            let [roll, pitch, yaw] = rpy
                .filter(|rpy| rpy.iter().all(|angle| angle.abs() < 6.3))
                .ok_or("rpy must be three angles in radians")?;
            return Ok(Given {
                pose: at(UnitQuaternion::from_euler_angles(roll, pitch, yaw)),
                note: None,
                other_order: None,
            });
        }
        let four: Option<[f64; 4]> = numbers(&table[*turn]);
        let four = four.ok_or_else(|| format!("{turn} must be four finite numbers"))?;
        let length = four.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() > 0.01 {
            return Err(format!(
                "{turn} has the length {length:.3}, but that of a rotation is 1"
            ));
        }
        let of_order = |order: &str| {
            let [a, b, c, d] = four;
            let quaternion = match order {
                "quaternion_xyzw" => Quaternion::new(d, a, b, c),
                _ => Quaternion::new(a, b, c, d),
            };
            at(UnitQuaternion::from_quaternion(quaternion))
        };
        let other = match *turn {
            "quaternion_xyzw" => "quaternion_wxyz",
            _ => "quaternion_xyzw",
        };
        Ok(Given {
            pose: of_order(turn),
            note: None,
            other_order: Some((other, of_order(other))),
        })
    }
}

/// Largest entry of RᵀR - I of matrices that are taken as they are, and of those that are put right.
const ROUNDED: f64 = 1e-3;
const REPAIRED: f64 = 0.05;

/// Why a matrix, whose RᵀR is `off` from the identity, is no rotation.
fn no_rotation(turn: &Matrix3<f64>, off: f64) -> Option<String> {
    let lengths: Vec<f64> = turn.column_iter().map(|column| column.norm()).collect();
    let mean = lengths.iter().sum::<f64>() / 3.0;
    let determinant = turn.determinant();
    if lengths.iter().any(|length| (length - 1.0).abs() > REPAIRED) {
        let alike = lengths
            .iter()
            .all(|length| (length / mean - 1.0).abs() < REPAIRED);
        return Some(match alike {
            true => format!(
                "its columns have the length {mean:.4} instead of 1; is it scaled, in millimetres?"
            ),
            false => format!(
                "its columns have the lengths {:.3}, {:.3} and {:.3} instead of 1",
                lengths[0], lengths[1], lengths[2]
            ),
        });
    }
    if off > REPAIRED {
        return Some("its columns are not at right angles".to_owned());
    }
    (determinant < 0.0).then(|| format!("its determinant is {determinant:.0}: an axis is mirrored"))
}

/// N finite numbers.
fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let number = |value: &Value| match value {
        Value::Integer(integer) => Some(*integer as f64),
        Value::Float(float) => Some(*float),
        _ => None,
    };
    let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(number).collect();
    let numbers = numbers?;
    let finite = numbers.iter().all(|x| x.is_finite());
    numbers.try_into().ok().filter(|_| finite)
}
