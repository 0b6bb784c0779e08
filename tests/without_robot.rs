//! Images of a room without the robot, and rooms that leave the robot its place.

use armpose::dataset::{DataSet, SetSpec, Studio, generate};
use armpose::random::stream;
use armpose::scene::{FurnitureSpec, OrientedBox, RobotPlace, RoomSpec, furnish};
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use std::fs;
use std::path::Path;

fn planar() -> SetSpec {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/robots/planar_arm/set.toml");
    SetSpec::read(&path).unwrap()
}

#[test]
fn the_share_is_kept_in_every_hundred_images_and_in_both_halves() {
    let mut spec = planar();
    assert_eq!(spec.without_robot, 0.1);
    for (share, expected) in [(0.0, 0), (0.1, 10), (0.25, 25), (0.5, 50), (1.0, 100)] {
        spec.without_robot = share;
        for half in [0, 1] {
            let images = (half..200).step_by(2);
            let without = images.filter(|&image| spec.is_without_robot(image)).count();
            assert_eq!(without, expected, "{share}");
        }
    }
}

/// Rooms without the robot take nothing from the images that show it: these are what they would be alone.
#[test]
fn images_of_the_robot_do_not_depend_on_those_without() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str, without_robot: f64| {
        let mut spec = planar();
        spec.images = 6;
        spec.without_robot = without_robot;
        generate(&spec, 3, &folder.path().join(name), &|_| ()).unwrap()
    };
    let (all, some) = (of("all", 0.0), of("some", 0.34));
    some.verify().unwrap();
    assert_eq!(all.images_with_robot(), [0, 1, 2, 3, 4, 5]);
    assert_eq!(some.images_with_robot(), [0, 1, 2, 3]);
    for image in 0..4 {
        assert_eq!(all.frame(image).unwrap(), some.frame(image).unwrap());
    }
    for image in 4..6 {
        let frame = some.frame(image).unwrap();
        assert!(frame.joints.is_empty());
        assert!(frame.labels.pixels.iter().all(|&label| label == 0));
        assert!(frame.depth.median_mm().is_some());
        let record = &some.record().images[image];
        assert!(record.without_robot && record.arms == [0]);
    }
    // What the table of joints says and what set.json says must agree.
    let table = folder.path().join("some/joints.csv");
    let text = fs::read_to_string(&table).unwrap();
    assert!(text.ends_with("\n4,,\n5,,\n"), "{text}");
    fs::write(&table, text.replace("4,,", "4,0.5,0.5")).unwrap();
    let error = DataSet::open(&folder.path().join("some")).unwrap_err();
    assert!(error.to_string().contains("image 4"), "{error}");
}

/// Seen from the studio, an image is the one that is written.
#[test]
fn a_studio_takes_the_images_of_its_set() {
    let folder = tempfile::tempdir().unwrap();
    let mut spec = planar();
    spec.without_robot = 0.5;
    let set = generate(&spec, 5, &folder.path().join("set"), &|_| ()).unwrap();
    let studio = Studio::read(&spec).unwrap();
    let mut photographer = armpose::camera::Photographer::new(studio.camera());
    for image in 0..4 {
        let shot = studio.shoot(image, &mut photographer, 5).unwrap();
        assert_eq!(shot.photo.depth, set.frame(image).unwrap().depth);
        assert_eq!(shot.configuration.is_none(), spec.is_without_robot(image));
    }
}

fn cube(x: f64, y: f64, z: f64) -> OrientedBox {
    OrientedBox {
        centre: Point3::new(x, y, z),
        axes: Matrix3::identity(),
        half: Vector3::repeat(0.1),
    }
}

/// A camera at the origin of the robot's root frame, 1 m above the floor, that looks along x.
fn root_from_camera() -> Isometry3<f64> {
    let axes = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    let turn = nalgebra::Rotation3::from_matrix_unchecked(axes);
    Isometry3::from_parts(Vector3::zeros().into(), turn.into())
}

fn room(give_way: bool) -> RoomSpec {
    RoomSpec {
        floor: -1.0,
        ahead: [2.0; 2],
        aside: [1.0; 2],
        behind: [1.0; 2],
        height: [2.5; 2],
        give_way,
    }
}

const BARE: FurnitureSpec = FurnitureSpec {
    closets: [0; 2],
    shelves: [0; 2],
    tables: [0; 2],
    chairs: [0; 2],
    clutter: [0; 2],
    clearance: 0.3,
};

#[test]
fn walls_and_ceiling_give_way_to_the_robot_and_to_nothing_else() {
    let walls = |robot: &[OrientedBox], give_way: bool| {
        let boxes = [robot.to_vec()];
        let place = RobotPlace::Taken(&boxes);
        let mut random = stream(1, "walls", &[]);
        let built = furnish(
            &room(give_way),
            &BARE,
            &root_from_camera(),
            place,
            &mut random,
        );
        (built.mesh.bounds().unwrap(), built.walls_moved)
    };
    let as_drawn = ([-1.0, -1.0, -1.0], [2.0, 1.0, 1.5]);
    let near = |(low, high): ([f32; 3], [f32; 3]), expected: ([f32; 3], [f32; 3])| {
        let pairs = low
            .iter()
            .chain(&high)
            .zip(expected.0.iter().chain(&expected.1));
        pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-5)
    };
    let (bounds, moved) = walls(&[cube(1.0, 0.0, 0.0)], true);
    assert!(near(bounds, as_drawn) && !moved, "{bounds:?}");
    // Each leaves by another side, by 0.3 m; walls stand 2 cm behind it.
    for (robot, low, high) in [
        (cube(2.2, 0.0, 0.0), as_drawn.0, [2.32, 1.0, 1.5]),
        (cube(0.0, 1.2, 0.0), as_drawn.0, [2.0, 1.32, 1.5]),
        (cube(0.0, -1.2, 0.0), [-1.0, -1.32, -1.0], as_drawn.1),
        (cube(-1.2, 0.0, 0.0), [-1.32, -1.0, -1.0], as_drawn.1),
        (cube(0.0, 0.0, 1.7), as_drawn.0, [2.0, 1.0, 1.82]),
    ] {
        let (bounds, moved) = walls(&[robot], true);
        assert!(near(bounds, (low, high)) && moved, "{bounds:?}");
        assert!(!walls(&[robot], false).1);
    }
    // The floor stays: what stands on it is mounted through it.
    let (bounds, moved) = walls(&[cube(0.5, 0.0, -1.2)], true);
    assert!(near(bounds, as_drawn) && !moved);
}

#[test]
fn something_else_stands_in_the_place_of_the_robot() {
    let furniture = FurnitureSpec {
        clutter: [0, 1],
        ..BARE
    };
    let robot = [vec![cube(1.2, 0.3, 0.0), cube(1.0, -0.2, -0.3)]];
    let mut standing = 0;
    for seed in 0..40 {
        let mut random = stream(seed, "stand-ins", &[]);
        let place = RobotPlace::Free(&robot);
        let built = furnish(
            &room(true),
            &furniture,
            &root_from_camera(),
            place,
            &mut random,
        );
        // The walls have eight vertices.
        let things = &built.mesh.vertices[8..];
        let camera = Vector3::zeros();
        for vertex in things {
            let at = Vector3::from(vertex.map(f64::from));
            assert!((at - camera).norm() > 0.3 - 1e-5);
            assert!(at.x < 2.001 && at.y.abs() < 1.001 && at.z > -1.001 && at.z < 1.501);
        }
        standing += usize::from(!things.is_empty());
    }
    assert!(standing >= 36, "{standing} of 40");
    // Whoever wants bare rooms gets bare rooms.
    let mut random = stream(1, "bare", &[]);
    let place = RobotPlace::Free(&robot);
    let bare = furnish(&room(true), &BARE, &root_from_camera(), place, &mut random);
    assert_eq!(bare.mesh.vertices.len(), 8);
}
