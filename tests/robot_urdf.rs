//! Reading URDF files: what works, and one clear message for what does not.

use armpose::random::{below, stream};
use armpose::robot::{Motion, Robot, RobotError, UrdfProblem};
use armpose::scene::Rig;
use std::path::{Path, PathBuf};

/// Reads a robot from the text between `<robot>` and `</robot>`.
fn read(body: &str) -> Result<Robot, RobotError> {
    let folder = tempfile::tempdir().unwrap();
    read_in(folder.path(), body)
}

fn read_in(folder: &Path, body: &str) -> Result<Robot, RobotError> {
    let path = folder.join("robot.urdf");
    std::fs::write(&path, format!("<robot name=\"test\">{body}</robot>")).unwrap();
    Robot::from_urdf(&path)
}

fn joint(name: &str, parent: &str, child: &str, inside: &str) -> String {
    format!(
        "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/>\
         <axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/>{inside}</joint>"
    )
}

fn links(names: &str) -> String {
    names
        .split(' ')
        .map(|name| format!("<link name=\"{name}\"/>"))
        .collect()
}

fn visual(geometry: &str) -> String {
    format!("<link name=\"a\"><visual><geometry>{geometry}</geometry></visual></link>")
}

#[test]
fn a_bad_description_gives_one_clear_message() {
    let ab = |inside: &str| links("a b") + &joint("j", "a", "b", inside);
    type Expected = fn(&UrdfProblem) -> bool;
    let cases: [(String, Expected); 19] = [
        ("<link name=\"a\">".into(), |p| {
            matches!(p, UrdfProblem::Xml(_))
        }),
        (String::new(), |p| matches!(p, UrdfProblem::NoLinks)),
        (links("a a"), |p| matches!(p, UrdfProblem::SameName { .. })),
        (links("a b"), |p| matches!(p, UrdfProblem::TwoRoots { .. })),
        (links("a") + &joint("j", "a", "nowhere", ""), |p| {
            matches!(p, UrdfProblem::UnknownLink { .. })
        }),
        (
            links("a b") + &joint("j", "a", "b", "") + &joint("k", "b", "a", ""),
            |p| matches!(p, UrdfProblem::Loop { .. }),
        ),
        (
            links("r a b") + &joint("j", "a", "b", "") + &joint("k", "b", "a", ""),
            |p| matches!(p, UrdfProblem::Loop { .. }),
        ),
        (
            links("a b c") + &joint("j", "a", "c", "") + &joint("k", "b", "c", ""),
            |p| matches!(p, UrdfProblem::TwoParents { .. }),
        ),
        (ab("<mimic joint=\"nobody\"/>"), |p| {
            matches!(p, UrdfProblem::UnknownLeader { .. })
        }),
        (ab("<mimic joint=\"j\"/>"), |p| {
            matches!(p, UrdfProblem::MimicLoop { .. })
        }),
        (ab("<mimic joint=\"j\" multiplier=\"inf\"/>"), |p| {
            matches!(p, UrdfProblem::Number { .. })
        }),
        (ab("<origin xyz=\"0 nan 0\" rpy=\"0 0 0\"/>"), |p| {
            matches!(p, UrdfProblem::Number { .. })
        }),
        (ab("").replace("0 0 1", "0 0 0"), |p| {
            matches!(p, UrdfProblem::Number { .. })
        }),
        (ab("").replace("revolute", "screw"), |p| {
            matches!(p, UrdfProblem::JointType { .. })
        }),
        (
            ab("").replace(
                "<limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/>",
                "",
            ),
            |p| matches!(p, UrdfProblem::Limits { .. }),
        ),
        (ab("").replace("lower=\"-1\"", "lower=\"2\""), |p| {
            matches!(p, UrdfProblem::Limits { .. })
        }),
        (visual("<mesh filename=\"gone.stl\"/>"), |p| {
            matches!(p, UrdfProblem::Mesh { .. })
        }),
        (visual("<mesh filename=\"http://gone.stl\"/>"), |p| {
            matches!(p, UrdfProblem::Mesh { .. })
        }),
        (visual("<box size=\"300 80 80\"/>"), |p| {
            matches!(p, UrdfProblem::TooLarge { .. })
        }),
    ];
    for (body, expected) in cases {
        let error = read(&body).map(|_| ()).expect_err(&body);
        assert!(expected(&error.problem), "{body}\n{error}");
        let message = error.to_string();
        assert!(
            message.contains("robot.urdf: ") && !message.contains('\n'),
            "{message}"
        );
    }
    let missing = Robot::from_urdf(Path::new("no/such/robot.urdf")).map(|_| ());
    assert!(matches!(missing.unwrap_err().problem, UrdfProblem::Read(_)));
}

#[test]
fn a_damaged_mesh_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let nan = "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n";
    for (name, content) in [
        ("short.stl", "solid"),
        ("empty.obj", ""),
        ("text.dae", "not a mesh"),
        ("nan.obj", nan),
        ("index.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n"),
    ] {
        std::fs::write(folder.path().join(name), content).unwrap();
        let error = read_in(
            folder.path(),
            &visual(&format!("<mesh filename=\"{name}\"/>")),
        );
        let error = error.map(|_| ()).expect_err(name);
        assert!(matches!(error.problem, UrdfProblem::Mesh { .. }), "{error}");
    }
}

/// Whatever a file holds, reading it ends with a robot or an error.
#[test]
fn corrupted_files_never_cause_a_panic() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/robots/arm");
    let stl = std::fs::read(data.join("meshes/torso.stl")).unwrap();
    let obj = b"o box\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1//2 2 3 4\n".to_vec();
    let body = visual("<box size=\"1 2 3\"/>")
        + &links("b c")
        + &joint("j", "a", "b", "<origin xyz=\"1 2 3\" rpy=\"4 5 6\"/>")
        + &joint("k", "b", "c", "<mimic joint=\"j\" multiplier=\"2\"/>");
    let urdf = format!("<robot name=\"r\">{body}</robot>").into_bytes();
    let folder = tempfile::tempdir().unwrap();
    let mut random = stream(1, "corruption", &[]);
    let mut corrupted = |bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        for _ in 0..=below(&mut random, 4) {
            let at = below(&mut random, bytes.len());
            bytes[at] = b" 0123456789-.abcjk\"/<>\0\xff"[below(&mut random, 24)];
        }
        bytes.truncate(1 + below(&mut random, 2 * bytes.len()));
        bytes
    };
    for _ in 0..200 {
        for (name, content) in [("x.stl", &stl), ("x.obj", &obj)] {
            std::fs::write(folder.path().join(name), corrupted(content)).unwrap();
            let _ = read_in(
                folder.path(),
                &visual(&format!("<mesh filename=\"{name}\"/>")),
            );
        }
        let path = folder.path().join("robot.urdf");
        std::fs::write(&path, corrupted(&urdf)).unwrap();
        let _ = Robot::from_urdf(&path);
    }
}

#[test]
fn visuals_are_placed_scaled_and_merged() {
    let folder = tempfile::tempdir().unwrap();
    let package = folder.path().join("package/meshes");
    std::fs::create_dir_all(&package).unwrap();
    let corner = "v 0 0 0\nv 1000 0 0\nv 0 2000 0\nf 1 2 3\n";
    std::fs::write(package.join("corner.obj"), corner).unwrap();
    let urdf_folder = folder.path().join("package/urdf");
    std::fs::create_dir_all(&urdf_folder).unwrap();
    // The package is called by the name of its folder, and then by another.
    for package in ["package", "renamed"] {
        let robot = read_in(
            &urdf_folder,
            &format!(
                "<link name=\"a\">
                   <visual><origin xyz=\"0 0 1\" rpy=\"0 0 1.5707963267948966\"/><geometry>
                     <mesh filename=\"package://{package}/meshes/corner.obj\" scale=\"0.001 0.001 -0.001\"/>
                   </geometry></visual>
                   <visual><geometry><sphere radius=\"0.5\"/></geometry></visual>
                   <visual><geometry><cylinder radius=\"0.5\" length=\"3\"/></geometry></visual>
                 </link>"
            ),
        )
        .unwrap();
        let mesh = &robot.links[0].mesh;
        let corners = mesh.triangles[0].map(|i| mesh.vertices[i as usize]);
        // A quarter turn takes (0, 2) to (-2, 0); mirroring reverses the order.
        for (corner, expected) in
            corners
                .iter()
                .zip([[0.0, 0.0, 1.0], [-2.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
        {
            for (x, e) in corner.iter().zip(expected) {
                assert!((x - e).abs() < 1e-6, "{corners:?}");
            }
        }
        assert_eq!(mesh.bounds().unwrap().0, [-2.0, -0.5, -1.5]);
    }
}

#[test]
fn joints_are_sorted_and_chains_of_mimics_resolved() {
    let mimic = |leader: &str, m: f64, o: f64| {
        format!("<mimic joint=\"{leader}\" multiplier=\"{m}\" offset=\"{o}\"/>")
    };
    // Children are listed before their parents.
    let robot = read(
        &(links("d c b a")
            + &joint("third", "c", "d", &mimic("second", 3.0, 0.25))
            + &joint("second", "b", "c", &mimic("first", 2.0, 0.5))
            + &joint("first", "a", "b", "")),
    )
    .unwrap();
    assert_eq!(robot.root(), robot.link("a").unwrap());
    let order: Vec<&str> = robot.joints.iter().map(|j| j.name.as_str()).collect();
    assert_eq!(order, ["first", "second", "third"]);
    let dofs: Vec<&str> = robot.dof_joints().map(|j| j.name.as_str()).collect();
    assert_eq!(dofs, ["third", "second", "first"], "as the URDF lists them");
    let mut q = [9.0, 9.0, 0.125];
    robot.apply_mimics(&mut q);
    assert_eq!(q, [3.0 * 0.75 + 0.25, 0.75, 0.125]);
    let below = robot.descendants(robot.link("b").unwrap());
    let names: Vec<&str> = below
        .iter()
        .map(|&l| robot.links[l].name.as_str())
        .collect();
    assert_eq!(names, ["b", "c", "d"]);
}

#[test]
fn forward_kinematics_of_a_planar_arm() {
    let at = |x: f64| format!("<origin xyz=\"{x} 0 0\" rpy=\"0 0 0\"/>");
    let slide = joint("slide", "c", "d", &at(0.5)).replace("revolute", "prismatic");
    let robot = read(
        &(links("a b c d")
            + &joint("one", "a", "b", &at(0.0))
            + &joint("two", "b", "c", &at(1.0))
            + &slide.replace("0 0 1", "1 0 0")),
    )
    .unwrap();
    assert!(matches!(robot.joints[2].motion, Motion::Prismatic(_)));
    let (one, two, slide) = (0.3f64, 0.4f64, 0.2);
    let poses = robot.forward_kinematics(&[one, two, slide]);
    let end = poses[robot.link("d").unwrap()].translation.vector;
    let expected = [
        one.cos() + (0.5 + slide) * (one + two).cos(),
        one.sin() + (0.5 + slide) * (one + two).sin(),
    ];
    assert!((end.x - expected[0]).abs() < 1e-12 && (end.y - expected[1]).abs() < 1e-12);
}

#[test]
fn another_robot_is_read_through_its_package_name() {
    let shared = std::env::var_os("ARMPOSE_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"),
        PathBuf::from,
    );
    let path = shared.join("robots/xarm7/xarm7.urdf");
    if !path.is_file() {
        println!("skipped: there is no {}", path.display());
        return;
    }
    let robot = Robot::from_urdf(&path).unwrap();
    assert_eq!(robot.dofs(), 7);
    assert!(robot.links.iter().all(|link| !link.mesh.is_empty()));
    assert!(robot.notes.is_empty() && robot.warnings.is_empty());
    // The same to the last bit as by the library that read meshes before.
    let text = format!("{:?} {:?} {:?}", robot.name, robot.links, robot.joints);
    let hash = "47ebaa56dddf1d0da49fc7baaecb4c2df4ec8dd232e7571fd29fc703475c1229";
    assert_eq!(blake3::hash(text.as_bytes()).to_hex().as_str(), hash);
    // Stretched upward, the flange stands over the base at the sum of the offsets.
    let poses = robot.forward_kinematics(&[0.0; 7]);
    let flange = poses[robot.link("link7").unwrap()].translation.vector;
    assert!(
        (flange.x - 0.206).abs() < 1e-3 && (flange.z - 0.1205).abs() < 1e-3,
        "{flange}"
    );
}

/// Models and caches hold these hashes: they are of the versions before notes were taken, and meshes read by
/// another library.
#[test]
fn fingerprints_stay_what_they_were() {
    for (rig, expected) in [
        (
            "data/robots/arm/robot.toml",
            "ca9170be5fac0fa215d08941a7429922c99d23568622c5185077b898bf289d94",
        ),
        (
            "tests/fixtures/robots/gripper_arm/robot.toml",
            "b9a8d2e6e6d059954d7379f38591765abff369a1b6d1d58c12e3d1e9914f10ce",
        ),
        (
            "tests/fixtures/robots/planar_arm/robot.toml",
            "88ff33208971cf06981e1393a2e2551a0f0296b682630dc088fe2fa25be5c5f3",
        ),
    ] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(rig);
        let mut rig = Rig::read(&path).unwrap();
        assert_eq!(rig.fingerprint(), expected);
        rig.robot.notes.push("a note".to_owned());
        assert_eq!(rig.fingerprint(), expected);
    }
}
