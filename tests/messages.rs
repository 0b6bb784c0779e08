//! What is said of mistakes: every message, held to one file (`tests/fixtures/messages.txt`), and the rules
//! for them: one line, no cause told twice, exit code 2. `UPDATE_MESSAGES=1 cargo test --test messages`
//! writes the file anew; read what changed.

use armpose::camera::camera_file;
use armpose::camera::depth_file::{Units, read_depth_file};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures")
}

/// The files of a folder whose names end like one of these, by name.
fn files(folder: &str, endings: &[&str]) -> Vec<PathBuf> {
    let entries = fs::read_dir(fixtures().join(folder)).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| {
        endings
            .iter()
            .any(|end| path.to_string_lossy().ends_with(end))
    });
    files.sort();
    assert!(!files.is_empty());
    files
}

/// Messages so far, with the places of this machine replaced.
struct Messages {
    folder: tempfile::TempDir,
    text: String,
}

impl Messages {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        path
    }

    fn told(&mut self, of: &str, message: &str) {
        let here = self.folder.path().to_string_lossy().into_owned();
        let fixtures = fixtures().to_string_lossy().into_owned();
        let places = |text: &str| text.replace(&here, "HERE").replace(&fixtures, "FIXTURES");
        let (of, message) = (places(of), places(message));
        // A mistake in TOML is shown with its line and a caret below it.
        let is_toml = message.contains(" | ");
        assert!(
            is_toml || !message.trim_end().contains('\n'),
            "{of}: {message}"
        );
        for twice in ["os error", "No such file"] {
            assert!(message.matches(twice).count() <= 1, "{of}: {message}");
        }
        for raw in ["{", ":?}", "Some(", "Os {"] {
            assert!(!message.contains(raw) || is_toml, "{of}: {message}");
        }
        assert!(message.len() < 700, "{of}: {message}");
        writeln!(
            self.text,
            "{of}\n    {}\n",
            message.trim_end().replace('\n', "\n    ")
        )
        .unwrap();
    }

    /// Runs the program, which must fail.
    fn of_run(&mut self, arguments: &[&str]) {
        let output = Command::new(env!("CARGO_BIN_EXE_armpose"))
            .args(arguments)
            .current_dir(self.folder.path())
            .env("PATH", "")
            .env_remove("ROS_PACKAGE_PATH")
            .env_remove("AMENT_PREFIX_PATH")
            .output()
            .unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert_eq!(output.stdout, b"", "{arguments:?}");
        assert!(message.starts_with("armpose: "), "{message}");
        self.told(&format!("$ armpose {}", arguments.join(" ")), &message);
    }

    fn inspect(&mut self, robot: &Path) {
        self.of_run(&["robot", "inspect", robot.to_str().unwrap()]);
    }
}

const CAMERA: &str = "[intrinsics]\nwidth = 160\nheight = 120\nfx = 145.0\nfy = 145.0\ncx = 80.0\ncy = 60.0\n\
                      [range]\nnear_m = 0.3\nfar_m = 5.0\n";
const MATRIX: &str =
    "camera_from_link = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1.5], [0, 0, 0, 1]]";
const SET: &str =
    "images = 1\nrobot = \"robot.toml\"\ncamera = \"camera.toml\"\ntarget = \"arm\"\n";

fn robot_toml(camera: &str, arm: &str) -> String {
    format!("urdf = \"arm.urdf\"\n[camera]\nlink = \"base\"\n{camera}\n[[arm]]\n{arm}\n")
}

const ARM: &str =
    "name = \"arm\"\nroot = \"upper\"\ntip = \"tip\"\njoints = [\"shoulder\", \"elbow\"]";

#[test]
fn mistakes_are_told_in_one_sentence() {
    let mut messages = Messages {
        folder: tempfile::tempdir().unwrap(),
        text: String::new(),
    };
    // Robots.
    for path in files("malformed", &[".urdf"]) {
        messages.inspect(&path);
    }
    for path in files("malformed", &[".stl", ".obj", ".dae"]) {
        let urdf = format!(
            "<robot name='r'><link name='a'><visual><geometry><mesh filename='{}'/></geometry></visual></link></robot>",
            path.display()
        );
        let robot = messages.write("one_mesh.urdf", &urdf);
        messages.told(
            &format!("mesh {}", path.display()),
            "is named by one_mesh.urdf:",
        );
        messages.inspect(&robot);
    }
    for name in [
        "u_glb.urdf",
        "u_ply.urdf",
        "u_sdf.sdf",
        "u_mjcf.xml",
        "u_xacro.urdf",
        "u_no_limit.urdf",
        "u_pkg_elsewhere.urdf",
        "u_missing_visual_with_collision.urdf",
        "nothing-there.urdf",
        "",
    ] {
        messages.inspect(&fixtures().join("cases/robots").join(name));
    }
    let link = "<link name='a'/><link name='b'/>";
    let joint = "<joint name='j' type='revolute'><parent link='a'/><child link='b'/><limit lower='-1' upper='1'/></joint>";
    for (name, inside) in [
        ("no_links", String::new()),
        ("two_roots", link.to_owned()),
        ("same_name", "<link name='a'/><link name='a'/>".to_owned()),
        (
            "unknown_link",
            format!("{link}{}", joint.replace("'b'", "'c'")),
        ),
        (
            "two_parents",
            format!(
                "{link}<link name='c'/>{joint}{}",
                joint.replace("'j'", "'k'").replace("'a'", "'c'")
            ),
        ),
        (
            "loop",
            format!(
                "{link}{joint}{}",
                joint
                    .replace("'j'", "'k'")
                    .replace("parent link='a'", "parent link='b'")
                    .replace("child link='b'", "child link='a'")
            ),
        ),
        (
            "kind",
            format!("{link}{}", joint.replace("revolute", "hinge")),
        ),
        ("limits", format!("{link}{}", joint.replace("'-1'", "'2'"))),
        (
            "mimic",
            format!(
                "{link}{}",
                joint.replace("<limit", "<mimic joint='x'/><limit")
            ),
        ),
        (
            "number",
            format!(
                "{link}{}",
                joint.replace("<limit", "<origin xyz='0 0 nan'/><limit")
            ),
        ),
        (
            "words",
            format!(
                "{link}{}",
                joint.replace("<limit", "<origin xyz='0 0'/><limit")
            ),
        ),
    ] {
        let path = messages.write(
            &format!("{name}.urdf"),
            &format!("<robot name='r'>{inside}</robot>"),
        );
        messages.inspect(&path);
    }

    // Rigs and sets.
    let urdf = fs::read_to_string(fixtures().join("robots/planar_arm/arm.urdf")).unwrap();
    messages.write("arm.urdf", &urdf);
    messages.write("camera.toml", CAMERA);
    messages.write("set.toml", SET);
    let render = ["dataset", "render", "set.toml", "-o", "images"];
    messages.of_run(&render);
    for (camera, arm) in [
        (MATRIX, ARM.replace("upper", "uper")),
        (MATRIX, ARM.replace("\"tip\"", "\"base\"")),
        (MATRIX, ARM.replace("elbow", "end")),
        (MATRIX, ARM.replace("elbow", "shoulder")),
        (MATRIX, ARM.replace("\"arm\"", "\"left\"")),
        (MATRIX, ARM.replace("joints", "joint")),
        (
            "camera_from_link = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 1.5], [0, 0, 0, 1]]",
            ARM.to_owned(),
        ),
        (
            "camera_from_link = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
            ARM.to_owned(),
        ),
        (
            "camera_from_link = [[2, 0, 0, 0], [0, -2, 0, 0], [0, 0, -2, 1.5], [0, 0, 0, 1]]",
            ARM.to_owned(),
        ),
        (
            "camera_from_link = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1500], [0, 0, 0, 1]]",
            ARM.to_owned(),
        ),
        (
            "camera_from_link = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, -1.5], [0, 0, 0, 1]]",
            ARM.to_owned(),
        ),
        (
            "camera_from_link = { xyz = [0, 0, 1.5], quaternion_xyzw = [1, 1, 0, 0] }",
            ARM.to_owned(),
        ),
        (
            "camera_from_link = { xyz = [0, 0, 1.5], quaternion = [1, 0, 0, 0] }",
            ARM.to_owned(),
        ),
        (
            "camera_from_link = { xyz = [0, 0, 1.5], rpy = [180, 0, 0] }",
            ARM.to_owned(),
        ),
        ("link_from_camera = 5", ARM.to_owned()),
    ] {
        messages.write("robot.toml", &robot_toml(camera, &arm));
        messages.of_run(&render);
    }
    messages.write("robot.toml", &robot_toml(MATRIX, ARM));
    for set in [
        SET.replace("images = 1", "images = 0"),
        SET.replace("camera.toml", "kamera.toml"),
        format!("{SET}without_robot = 2.0\n"),
        format!("{SET}[camera_jitter]\ntranslation_m = -1.0\nrotation_deg = 0.0\n"),
        format!("{SET}[room]\nahead = [3.0, 2.0]\n"),
        format!("{SET}[room]\nfloor = 2.0\n"),
        format!("{SET}[furniture]\nclutter = [3, 2]\n"),
        format!("{SET}[poses]\nfixed = {{ elbw = 1.0 }}\n"),
        format!("{SET}[poses.ranges]\nelbow = [0.0, 9.0]\n"),
        format!("{SET}[visibility]\ntarget_pixels = 19000\n"),
        format!("{SET}color = \"red\"\n"),
    ] {
        messages.write("set.toml", &set);
        messages.of_run(&render);
    }
    messages.write("set.toml", SET);
    for camera in [
        CAMERA.replace("fx = 145.0", "fx = 0.9"),
        CAMERA.replace("width = 160", "width = 0"),
        CAMERA.replace("cx = 80.0", "cx = 8000.0"),
        CAMERA.replace("near_m = 0.3", "near_m = 6.0"),
    ] {
        messages.write("camera.toml", &camera);
        messages.of_run(&render);
    }
    messages.write("camera.toml", CAMERA);
    messages.write("full/note.txt", "mine");
    messages.of_run(&["dataset", "render", "set.toml", "-o", "full"]);

    // Proposals, data sets and models.
    messages.of_run(&["init", "arm.urdf"]);
    messages.of_run(&["init", "gone.urdf", "-o", "new"]);
    let normalised = fixtures().join("cases/cameras/normalised.json");
    messages.of_run(&[
        "init",
        "arm.urdf",
        "-o",
        "new",
        "--camera",
        normalised.to_str().unwrap(),
    ]);
    messages.of_run(&[
        "train",
        "--data",
        "images",
        "--robot",
        "robot.toml",
        "-o",
        "model",
    ]);
    messages.of_run(&[
        "train",
        "--data",
        "full",
        "--robot",
        "robot.toml",
        "-o",
        "full",
    ]);
    messages.of_run(&["estimate", "--model", "model", "depth.png"]);
    messages.of_run(&[
        "estimate",
        "--model",
        "full",
        "depth.png",
        "--depth-scale=-1",
    ]);
    messages.write("old/model.json", "{\"format\": 1}");
    messages.of_run(&["estimate", "--model", "old", "depth.png"]);
    messages.write("other/model.json", "{}");
    messages.of_run(&["evaluate", "--model", "other", "--data", "images"]);

    // Images and cameras.
    let endings = [".png", ".npy", ".npz", ".tif", ".exr", ".pgm", ".pfm"];
    for path in files("malformed", &endings) {
        let error = read_depth_file(&path, Some([16, 12]), Units::default()).unwrap_err();
        messages.told(
            &format!("depth image {}", path.display()),
            &error.to_string(),
        );
    }
    for path in files("depth", &[""]) {
        // Those that can be read are of 8 x 6 pixels.
        let error = read_depth_file(&path, Some([4, 3]), Units::default()).unwrap_err();
        messages.told(
            &format!("depth image of 4 x 3 pixels {}", path.display()),
            &error.to_string(),
        );
    }
    for (name, text) in [
        ("empty.json", ""),
        ("list.json", "[1, 2]"),
        ("no_focal_length.json", "{\"width\": 8, \"height\": 6}"),
        (
            "fisheye.yaml",
            "width: 320\nheight: 240\ndistortion_model: equidistant\nD: [0.1, 0, 0, 0]\nK: [300, 0, 160, 0, 300, 120, 0, 0, 1]\n",
        ),
        (
            "behind.yaml",
            "width: 320\nheight: 240\nK: [-300, 0, 160, 0, 300, 120, 0, 0, 1]\n",
        ),
        ("short.yaml", "width: 320\nheight: 240\nK: [300, 0, 160]\n"),
        ("broken.yaml", "width: [320\n"),
    ] {
        let path = messages.write(name, text);
        let error = camera_file::read(&path).unwrap_err();
        messages.told(&format!("camera {name}: {text:?}"), &error.to_string());
    }
    for path in [normalised, messages.path("gone.json")] {
        let error = camera_file::read(&path).unwrap_err();
        messages.told(&format!("camera {}", path.display()), &error.to_string());
    }

    let kept = fixtures().join("messages.txt");
    if std::env::var_os("UPDATE_MESSAGES").is_some() {
        fs::write(&kept, &messages.text).unwrap();
    }
    let expected = fs::read_to_string(&kept).unwrap_or_default();
    for (line, (now, then)) in messages.text.lines().zip(expected.lines()).enumerate() {
        assert_eq!(now, then, "line {} of {}", line + 1, kept.display());
    }
    assert_eq!(messages.text.lines().count(), expected.lines().count());
}
