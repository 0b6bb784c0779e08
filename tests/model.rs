//! `armpose train`, `estimate` and `evaluate`, as people with a robot and a camera meet them.

use armpose::camera::depth_file::{Units, read_depth_file};
use armpose::camera::png::write_depth;
use armpose::camera::{DepthImage, Intrinsics};
use armpose::dataset::DataSet;
use armpose::estimator::error::mean_angle_error;
use armpose::model::Model;
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use tempfile::TempDir;

fn armpose(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_armpose"))
        .args(arguments)
        .output()
        .unwrap()
}

/// What it says on stdout when all is well.
fn says(arguments: &[&str]) -> String {
    let output = armpose(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// The one line on stderr, without the program's name, when it ends with exit code 2.
fn complains(arguments: &[&str]) -> String {
    let output = armpose(arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert_eq!(errors.lines().count(), 1, "{errors}");
    errors.strip_prefix("armpose: ").unwrap().trim().to_owned()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Two sets of images of the planar arm, and a model that is trained on the first.
struct Workshop {
    folder: TempDir,
}

impl Workshop {
    fn get() -> &'static Workshop {
        static WORKSHOP: OnceLock<Workshop> = OnceLock::new();
        WORKSHOP.get_or_init(|| {
            let workshop = Workshop {
                folder: tempfile::tempdir().unwrap(),
            };
            let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/robots");
            let set = workshop.at("planar.toml");
            let lines = format!(
                "images = 60\nrobot = {:?}\ncamera = {:?}\ntarget = \"arm\"\n\
                 [poses.ranges]\nshoulder = [-1.2, 1.2]\n",
                workshop.robot(),
                robots.join("camera.toml")
            );
            fs::write(&set, lines).unwrap();
            for (name, more) in [("train", ["--images", "60"]), ("test", ["--images", "10"])] {
                let seed = if name == "train" { "1" } else { "2" };
                let out = workshop.at(name);
                let render = ["dataset", "render", text(&set), "-o", text(&out), "--seed"];
                says(&[&render[..], &[seed], &more].concat());
            }
            says(&workshop.train("model", &["--threads", "2"]));
            workshop
        })
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn robot(&self) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/robots/planar_arm/robot.toml")
    }

    /// The arguments that train a small model.
    fn train(&self, name: &str, more: &[&'static str]) -> Vec<&'static str> {
        let leak = |path: PathBuf| &*Box::leak(text(&path).to_owned().into_boxed_str());
        let (data, robot, out) = (self.at("train"), self.robot(), self.at(name));
        let mut arguments = vec!["train", "--data", leak(data), "--robot", leak(robot)];
        arguments.extend(["-o", leak(out), "--trees", "4", "--pixels", "300"]);
        arguments.extend(more);
        arguments
    }

    /// Estimates as JSON, one value a line.
    fn estimate(&self, model: &str, more: &[&str]) -> Vec<Value> {
        let model = self.at(model);
        let estimate = ["estimate", "--json", "--model", text(&model)];
        let answer = says(&[&estimate[..], more].concat());
        let lines = answer.lines();
        lines
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }

    fn test_image(&self, image: usize) -> PathBuf {
        self.at("test").join(format!("depth/{image:06}.png"))
    }
}

#[test]
fn estimates_of_new_images_beat_the_constant_pose_and_are_the_same_everywhere() {
    let workshop = Workshop::get();
    let model = Model::load(&workshop.at("model")).unwrap();
    let set = DataSet::open(&workshop.at("test")).unwrap();
    let folder = workshop.at("test").join("depth");
    let answers = workshop.estimate("model", &[text(&folder)]);
    assert_eq!(answers.len(), set.len());
    let (mut errors, mut floors) = (0.0, 0.0);
    for (image, answer) in answers.iter().enumerate() {
        assert_eq!(answer["image"], text(&workshop.test_image(image)));
        let pose = model
            .estimate(&set.frame(image).unwrap().depth, 1)
            .pose
            .unwrap();
        let joints = &answer["joints"];
        assert_eq!(joints["shoulder_rad"], pose.values[0]);
        assert_eq!(joints["elbow_rad"], pose.values[1]);
        assert_eq!(answer["spread"]["elbow_rad"], pose.spread[1]);
        assert_eq!(answer["arm_visible"], true);
        assert!(pose.spread.iter().all(|&spread| spread >= 0.0));
        assert!(0.0 < pose.confidence && pose.confidence <= 1.0);
        errors += mean_angle_error(set.pose(image), &pose.values);
        floors += mean_angle_error(set.pose(image), &model.record().mean_pose);
    }
    println!("{errors} against {floors}");
    assert!(errors < 0.4 * floors, "{errors} against {floors}");

    let (csv, pictures) = (workshop.at("errors.csv"), workshop.at("pictures"));
    let (model, test) = (workshop.at("model"), workshop.at("test"));
    let evaluate = ["evaluate", "--model", text(&model), "--data"];
    let more = [
        text(&test),
        "--csv",
        text(&csv),
        "--overlay",
        text(&pictures),
    ];
    let summary = says(&[&evaluate[..], &more].concat());
    for name in ["elbow_deg", "tip_mm", "disp_mm", "constant_pose_mean"] {
        assert!(summary.contains(name), "{summary}");
    }
    let mut rows = csv::Reader::from_path(&csv).unwrap();
    let header = rows.headers().unwrap().clone();
    let place = |name: &str| header.iter().position(|column| column == name).unwrap();
    let number = |row: &csv::StringRecord, name| row[place(name)].parse::<f64>().unwrap();
    let mut sum = 0.0;
    for row in rows.records() {
        let row = row.unwrap();
        sum += number(&row, "error_all_turning_deg").to_radians();
        assert!(number(&row, "error_tip_mm") <= number(&row, "error_disp_mm") + 1e-6);
    }
    // Tables are rounded.
    assert!((sum - errors).abs() < 1e-4);
    assert_eq!(fs::read_dir(&pictures).unwrap().count(), set.len());

    let train = workshop.at("train");
    let message = complains(&[&evaluate[..], &[text(&train)]].concat());
    assert!(
        message.contains("with seed 1, which are these"),
        "{message}"
    );
    says(&[&evaluate[..], &[text(&train), "--seen-images"]].concat());
}

#[test]
fn the_same_data_gives_the_same_model_and_no_folder_is_overwritten() {
    let workshop = Workshop::get();
    says(&workshop.train("again", &["--threads", "1"]));
    for file in ["model.json", "segmentation.bin", "pose.bin"] {
        let read = |model: &str| fs::read(workshop.at(model).join(file)).unwrap();
        assert_eq!(read("model"), read("again"), "{file}");
    }
    let message = complains(&workshop.train("again", &[]));
    assert!(message.ends_with("exists already; choose another name or remove it"));
}

#[test]
fn other_objectives_and_no_segmentation() {
    let workshop = Workshop::get();
    says(&workshop.train("mspd", &["--objective", "mspd", "--no-segmentation"]));
    let image = workshop.test_image(0);
    let pictures = workshop.at("overlays");
    let more = [text(&image), "--overlay", text(&pictures)];
    let answer = &workshop.estimate("mspd", &more)[0];
    assert!(answer["arm_visible"].is_null() && answer["arm_pixels"].is_null());
    assert!(answer["joints"]["elbow_rad"].is_f64());
    assert!(pictures.join("0000-000000.png").is_file());
    assert!(!workshop.at("mspd").join("segmentation.bin").exists());
}

/// A robot sends one name and waits for the answer.
#[test]
fn names_on_stdin_are_answered_one_by_one() {
    let workshop = Workshop::get();
    let mut child = Command::new(env!("CARGO_BIN_EXE_armpose"))
        .args([
            "estimate",
            "--json",
            "--model",
            text(&workshop.at("model")),
            "-",
        ])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut names = child.stdin.take().unwrap();
    let mut answers = BufReader::new(child.stdout.take().unwrap()).lines();
    let files = [
        workshop.test_image(0),
        workshop.at("no.png"),
        workshop.test_image(1),
    ];
    for (at, file) in files.iter().enumerate() {
        writeln!(names, "{}", text(file)).unwrap();
        let answer: Value = serde_json::from_str(&answers.next().unwrap().unwrap()).unwrap();
        assert_eq!(answer["image"], text(file));
        assert_eq!(answer["error"].is_string(), at == 1, "{answer}");
        assert_eq!(answer["joints"].is_object(), at != 1);
    }
    drop(names);
    assert_eq!(child.wait().unwrap().code(), Some(2));
}

fn npy(descr: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values);
    bytes
}

/// The same image in other files, units, types and from a camera with finer pixels.
#[test]
fn an_image_is_the_same_whatever_holds_it() {
    let workshop = Workshop::get();
    let model = Model::load(&workshop.at("model")).unwrap();
    let camera = model.record().intrinsics;
    let depth = read_depth_file(&workshop.test_image(2), None, Units::default()).unwrap();
    let file = workshop.test_image(2);
    let expected = &workshop.estimate("model", &[text(&file)])[0];
    assert!(expected["joints"].is_object());

    let tenths = DepthImage {
        pixels: depth.pixels.iter().map(|mm| 10 * mm).collect(),
        ..depth
    };
    let png = workshop.at("tenths.png");
    write_depth(&png, &tenths).unwrap();
    let message = complains(&[
        "estimate",
        "--model",
        text(&workshop.at("model")),
        text(&png),
    ]);
    assert!(
        message.contains("0.0001 (tenths of a millimetre"),
        "{message}"
    );

    let twice = Intrinsics {
        width: 2 * camera.width,
        height: 2 * camera.height,
        fx: 2.0 * camera.fx,
        fy: 2.0 * camera.fy,
        cx: 2.0 * camera.cx + 0.5,
        cy: 2.0 * camera.cy + 0.5,
    };
    let camera_file = workshop.at("twice.json");
    fs::write(&camera_file, serde_json::to_string(&twice).unwrap()).unwrap();
    let metres = |&mm: &u16| match mm {
        0 => f64::NAN,
        mm => f64::from(mm) / 1000.0,
    };
    let of_twice = |at: usize| {
        let (x, y) = (at % twice.width, at / twice.width);
        &depth.pixels[y / 2 * camera.width + x / 2]
    };
    let large =
        (0..twice.width * twice.height).flat_map(|at| (metres(of_twice(at)) as f32).to_le_bytes());
    let small = depth.pixels.iter();
    let (of_large, of_small) = ("(240, 320)", "(120, 160)");
    let files: [(&str, Vec<u8>); 3] = [
        ("f4.npy", npy("<f4", of_large, &large.collect::<Vec<_>>())),
        (
            "f8.npy",
            npy(
                "<f8",
                of_small,
                &small
                    .clone()
                    .flat_map(|mm| metres(mm).to_le_bytes())
                    .collect::<Vec<_>>(),
            ),
        ),
        (
            "u2.npy",
            npy(
                "<u2",
                of_small,
                &small.flat_map(|mm| mm.to_le_bytes()).collect::<Vec<_>>(),
            ),
        ),
    ];
    let camera_option = ["--camera", text(&camera_file)];
    for (name, bytes) in files {
        let file = workshop.at(name);
        fs::write(&file, bytes).unwrap();
        let more = if name == "f4.npy" {
            &camera_option[..]
        } else {
            &[]
        };
        let answer = &workshop.estimate("model", &[&[text(&file)], more].concat())[0];
        for field in ["joints", "spread", "arm_pixels", "pixels"] {
            assert_eq!(answer[field], expected[field], "{name}");
        }
    }
    let more = [text(&png), "--depth-scale", "0.0001"];
    assert_eq!(
        workshop.estimate("model", &more)[0]["joints"],
        expected["joints"]
    );

    let narrow = Intrinsics {
        fx: 2.0 * twice.fx,
        ..twice
    };
    fs::write(&camera_file, serde_json::to_string(&narrow).unwrap()).unwrap();
    let model = workshop.at("model");
    let estimate = ["estimate", "--model", text(&model), text(&png)];
    let message = complains(&[&estimate[..], &camera_option].concat());
    assert!(
        message.starts_with("the images cover 50 % of what"),
        "{message}"
    );
}

/// A file of another tool for the camera, with its own unit; a folder with endings of any kind; and images
/// that cannot be depth, which fail alone.
#[test]
fn cameras_and_images_of_other_tools_are_estimated_alike() {
    let workshop = Workshop::get();
    let model = Model::load(&workshop.at("model")).unwrap();
    let i = model.record().intrinsics;
    let file = workshop.test_image(2);
    let expected = &workshop.estimate("model", &[text(&file)])[0]["joints"];
    assert!(expected.is_object());
    let k = format!("[{}, 0, {}, 0, {}, {}, 0, 0, 1]", i.fx, i.cx, i.fy, i.cy);
    let (ros, bop) = (workshop.at("info.yaml"), workshop.at("scene_camera.json"));
    fs::write(
        &ros,
        format!(
            "height: {}\nwidth: {}\ndistortion_model: plumb_bob\nD: [0, 0, 0, 0, 0]\nK: {k}\n---\n",
            i.height, i.width
        ),
    )
    .unwrap();
    let far = "[9e3, 0, 80, 0, 9e3, 60, 0, 0, 1]";
    fs::write(
        &bop,
        format!("{{\"2\": {{\"cam_K\": {k}, \"depth_scale\": 0.1}}, \"3\": {{\"cam_K\": {far}}}}}"),
    )
    .unwrap();
    let depth = read_depth_file(&file, None, Units::default()).unwrap();
    let changed = |name: &str, change: &dyn Fn(u16) -> u16| {
        let path = workshop.at(name);
        let image = DepthImage {
            pixels: depth.pixels.iter().map(|&mm| change(mm)).collect(),
            ..depth
        };
        write_depth(&path, &image).unwrap();
        path
    };
    let tenths = changed("frame_000002.png", &|mm| 10 * mm);
    let joints = |more: &[&str]| workshop.estimate("model", more)[0]["joints"].clone();
    assert_eq!(joints(&[text(&file), "--camera", text(&ros)]), *expected);
    assert_eq!(joints(&[text(&tenths), "--camera", text(&bop)]), *expected);

    let folder = workshop.at("endings");
    fs::create_dir(&folder).unwrap();
    fs::copy(&file, folder.join("B.PNG")).unwrap();
    let values = depth.pixels.iter().flat_map(|mm| mm.to_be_bytes());
    let pgm = [b"P5 160 120 65535\n".to_vec(), values.collect()].concat();
    fs::write(folder.join("a.pgm"), pgm).unwrap();
    fs::write(folder.join("notes.txt"), "no image").unwrap();
    let answers = workshop.estimate("model", &[text(&folder)]);
    assert_eq!(answers.len(), 2);
    assert!(answers.iter().all(|answer| answer["joints"] == *expected));

    let model = workshop.at("model");
    let refused = |image: &Path, more: &[&str]| {
        let estimate = ["estimate", "--model", text(&model), text(image)];
        let message = complains(&[&estimate[..], more].concat());
        assert!(message.contains(text(image)), "{message}");
        message
    };
    let nothing = refused(&changed("nothing.png", &|_| 0), &[]);
    assert!(
        nothing.contains("not one of its pixels has a valid depth"),
        "{nothing}"
    );
    let fivefold = refused(&changed("fivefold.png", &|mm| mm * 5), &[]);
    assert!(fivefold.contains("5 times smaller"), "{fivefold}");
    let fourth = changed("frame_4.png", &|mm| mm);
    let unknown = refused(&fourth, &["--camera", text(&bop)]);
    assert!(unknown.contains("no camera for image 4"), "{unknown}");
}

#[test]
fn where_there_is_no_arm_none_is_seen() {
    let workshop = Workshop::get();
    let wall = workshop.at("wall.png");
    let image = DepthImage {
        width: 160,
        height: 120,
        pixels: (0..160 * 120).map(|at| 1500 + at % 160 / 40).collect(),
    };
    write_depth(&wall, &image).unwrap();
    let answer = &workshop.estimate("model", &[text(&wall)])[0];
    assert_eq!(answer["arm_visible"], false);
    assert!(answer["joints"].is_null() && answer["spread"].is_null());

    // As text, beside an image with the arm.
    let (model, image) = (workshop.at("model"), workshop.test_image(0));
    let said = says(&[
        "estimate",
        "--model",
        text(&model),
        text(&image),
        text(&wall),
    ]);
    let joints = &workshop.estimate("model", &[text(&image)])[0]["joints"];
    let shown = |joint: &str, column: &str| {
        let value = joints[column].as_f64().unwrap();
        format!("\n  {joint:8}  {value:>8.4} rad, spread ")
    };
    assert!(said.starts_with(&format!("{}: ", text(&image))), "{said}");
    assert!(said.contains(&shown("shoulder", "shoulder_rad")), "{said}");
    assert!(said.contains(&shown("elbow", "elbow_rad")), "{said}");
    let share = 100.0 * answer["presence"].as_f64().unwrap();
    let needed = 100.0
        * Model::load(&model)
            .unwrap()
            .record()
            .least_presence
            .unwrap();
    let unseen = format!(
        "\n  the arm is not visible: {share:.0} % of the trees see a robot, and it takes {needed:.0} %\n"
    );
    assert!(said.ends_with(&unseen), "{said}");
}

/// Rooms without the robot show no arm, new images of the robot do; `evaluate` counts both.
#[test]
fn rooms_show_no_arm() {
    let workshop = Workshop::get();
    let set = workshop.at("planar.toml");
    let rooms = workshop.at("rooms.toml");
    let text_of_set = fs::read_to_string(&set).unwrap();
    fs::write(&rooms, format!("without_robot = 0.5\n{text_of_set}")).unwrap();
    let images = workshop.at("rooms");
    let render = ["dataset", "render", text(&rooms), "-o", text(&images)];
    says(&[&render[..], &["--images", "200", "--seed", "8"]].concat());
    let table = workshop.at("rooms.csv");
    let model = workshop.at("model");
    let evaluate = ["evaluate", "--model", text(&model), "--data", text(&images)];
    let said = says(&[&evaluate[..], &["--csv", text(&table)]].concat());
    let row = said
        .lines()
        .find(|line| line.starts_with("there is no robot"))
        .unwrap();
    let counts: Vec<usize> = row
        .split_whitespace()
        .filter_map(|word| word.parse().ok())
        .collect();
    assert_eq!(counts.iter().sum::<usize>(), 100);
    assert!(counts[0] <= 4, "{said}");
    let mut reader = csv::Reader::from_path(&table).unwrap();
    let columns = reader.headers().unwrap().clone();
    let place = |name: &str| columns.iter().position(|column| column == name).unwrap();
    let [robot, found, error] = ["robot", "arm_found", "error_tip_mm"].map(place);
    let mut shown = 0;
    for row in reader.records() {
        let row = row.unwrap();
        // Nothing can be wrong about a pose that is not there.
        let is_measured = &row[robot] == "1" && &row[found] == "1";
        assert_eq!(!row[error].is_empty(), is_measured, "{row:?}");
        shown += usize::from(is_measured);
    }
    assert!(shown >= 90, "{shown} of 100 arms are found");
}

/// The model says so when an image was turned over on its way, or is far from what it learnt from.
#[test]
fn images_of_another_view_are_told() {
    let workshop = Workshop::get();
    let model = workshop.at("model");
    let set = DataSet::open(&workshop.at("test")).unwrap();
    let (mut as_they_are, mut turned) = (0, 0);
    for image in 0..set.len() {
        let depth = set.frame(image).unwrap().depth;
        let mut upside_down = depth.clone();
        upside_down.pixels.reverse();
        for (image, warnings) in [(depth, &mut as_they_are), (upside_down, &mut turned)] {
            let path = workshop.at("turned.png");
            write_depth(&path, &image).unwrap();
            let output = armpose(&["estimate", "--model", text(&model), text(&path)]);
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            *warnings += usize::from(said.contains("the arm shows better in the image"));
        }
    }
    assert!(as_they_are <= 1, "{as_they_are} of 10 warnings are false");
    // The arm turns all round in the image: few of these can tell.
    assert!(turned >= as_they_are, "{turned}");

    let far = workshop.at("far.png");
    let image = DepthImage {
        width: 160,
        height: 120,
        pixels: (0..160 * 120).map(|at| 330 + at % 160 / 40).collect(),
    };
    write_depth(&far, &image).unwrap();
    let said = complains(&["estimate", "--model", text(&model), text(&far)]);
    assert!(
        said.contains("the median of its depths is 0.33 m"),
        "{said}"
    );
}

/// The camera of the training images reports nothing beyond 5 m.
#[test]
fn depths_out_of_range_are_as_good_as_none() {
    let workshop = Workshop::get();
    let model = Model::load(&workshop.at("model")).unwrap();
    let set = DataSet::open(&workshop.at("test")).unwrap();
    let image = set.frame(0).unwrap().depth;
    let with = |depth: u16| {
        let mut image = image.clone();
        image
            .pixels
            .iter_mut()
            .step_by(23)
            .for_each(|mm| *mm = depth);
        model.estimate(&image, 1)
    };
    assert_eq!(with(5001), with(0));
    assert_eq!(with(299), with(0));
    assert_ne!(with(4999), with(0));
}

/// A copy of a model in which one file was changed is refused with one sentence.
#[test]
fn unusable_models_are_refused() {
    let workshop = Workshop::get();
    let folder = tempfile::tempdir().unwrap();
    let image = workshop.test_image(0);
    let refused = |file: &str, change: &dyn Fn(&mut Vec<u8>)| {
        for name in [
            "model.json",
            "presence-whole.bin",
            "presence-arm.bin",
            "segmentation.bin",
            "pose.bin",
        ] {
            fs::copy(workshop.at("model").join(name), folder.path().join(name)).unwrap();
        }
        let path = folder.path().join(file);
        let mut bytes = fs::read(&path).unwrap();
        change(&mut bytes);
        fs::write(&path, bytes).unwrap();
        let folder = text(folder.path());
        complains(&["estimate", "--model", folder, text(&image)])
    };
    let replaced = |from: &'static str, to: &'static str| {
        move |bytes: &mut Vec<u8>| {
            let before = String::from_utf8(bytes.clone()).unwrap();
            *bytes = before.replacen(from, to, 1).into_bytes();
            assert_ne!(before.as_bytes(), bytes);
        }
    };
    let cut = |bytes: &mut Vec<u8>| bytes.truncate(bytes.len() / 2);
    let flip = |bytes: &mut Vec<u8>| {
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
    };
    for (message, part) in [
        (refused("pose.bin", &cut), "cut off or was altered"),
        (refused("pose.bin", &flip), "cut off or was altered"),
        (refused("segmentation.bin", &flip), "cut off or was altered"),
        (refused("segmentation.bin", &|b| b[8] = 9), "version"),
        (refused("model.json", &cut), "model.json: EOF"),
        (
            refused("model.json", &replaced("\"format\": 2", "\"format\": 7")),
            "the model has format 7",
        ),
        (
            refused("model.json", &replaced("\"format\"", "\"from\"")),
            "no model of armpose",
        ),
        (
            refused("model.json", &replaced("\"elbow\"", "\"wrist\"")),
            "estimates the joints shoulder, elbow",
        ),
        (
            refused("model.json", &replaced("\"t_r\": 0.9", "\"t_r\": 0.905")),
            "t_r = 0.905",
        ),
        (
            refused(
                "model.json",
                &replaced("\"width\": 160", "\"width\": 160000000"),
            ),
            "each side",
        ),
        (
            refused("model.json", &replaced("\"sigma\": 1.0", "\"sigma\": -1.0")),
            "sigma",
        ),
        (
            refused(
                "model.json",
                &replaced("\"pose.bin\": \"", "\"pose.bin\": \"0"),
            ),
            "belongs to another model",
        ),
    ] {
        assert!(message.contains(part), "{message}");
    }
    let nowhere = workshop.at("nowhere");
    let message = complains(&["estimate", "--model", text(&nowhere), text(&image)]);
    assert!(message.starts_with("cannot read "), "{message}");
}
