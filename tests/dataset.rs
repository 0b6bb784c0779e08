//! Data sets of the dual-arm robot: generation, files, and what goes wrong with them.

use armpose::camera::{Camera, Photographer, png};
use armpose::dataset::{DataSet, DataSetError, SetSpec, SheetStyle, contact_sheet, generate};
use armpose::scene::{Rig, robot_bodies};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};

fn pef(images: usize) -> SetSpec {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/sets/pef.toml");
    let mut spec = SetSpec::read(&path).unwrap();
    spec.images = images;
    spec
}

fn make(spec: &SetSpec, folder: &Path) -> DataSet {
    generate(spec, 1, folder, &|_| {}).unwrap()
}

fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.unwrap().install(work)
}

/// Every file of a folder with its contents, in order.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(contents(&path));
        } else {
            files.push((path.clone(), fs::read(&path).unwrap()));
        }
    }
    files.sort();
    files
}

#[test]
fn the_same_bits_for_any_number_of_threads_and_images() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let counted = AtomicU64::new(0);
    let count = |n| {
        counted.fetch_add(n, Ordering::Relaxed);
    };
    with_threads(1, || generate(&pef(5), 1, &at("one"), &count).unwrap());
    assert_eq!(counted.into_inner(), 5);
    with_threads(2, || make(&pef(5), &at("two")));
    let relative = |name: &str| {
        let strip =
            |(p, bytes): (PathBuf, Vec<u8>)| (p.strip_prefix(at(name)).unwrap().to_owned(), bytes);
        contents(&at(name))
            .into_iter()
            .map(strip)
            .collect::<Vec<_>>()
    };
    assert_eq!(relative("one"), relative("two"));

    let few = make(&pef(2), &at("few"));
    let many = DataSet::open(&at("one")).unwrap();
    for image in 0..2 {
        assert_eq!(few.frame(image).unwrap(), many.frame(image).unwrap());
        assert_eq!(few.record().images[image], many.record().images[image]);
    }
    let poses: Vec<&[f64]> = (0..many.len()).map(|image| many.pose(image)).collect();
    assert!((1..poses.len()).all(|image| !poses[..image].contains(&poses[image])));
    let other_seed = generate(&pef(1), 2, &at("seed"), &|_| {}).unwrap();
    assert_ne!(other_seed.pose(0), many.pose(0));
    let mut other_name = pef(1);
    other_name.name = "tuning".to_owned();
    assert_ne!(make(&other_name, &at("name")).pose(0), many.pose(0));
}

/// A set of eleven images that several tests only read, drawn once a run.
fn shared() -> DataSet {
    static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("data set");
        if folder.exists() {
            fs::remove_dir_all(&folder).unwrap();
        }
        make(&pef(11), &folder);
        folder
    });
    DataSet::open(&FOLDER).unwrap()
}

#[test]
fn images_show_what_the_specification_demands() {
    let set = shared();
    let arm_of_label = set.arm_of_label();
    assert_eq!(set.record().arms[set.target()].name, "right");
    let mut total = [0; 3];
    for image in 0..set.len() {
        let frame = set.frame(image).unwrap();
        let mut arms = [0; 2];
        let mut valid = 0;
        for (&depth, &label) in frame.depth.pixels.iter().zip(&frame.labels.pixels) {
            assert!(depth <= 5000 && (depth == 0 || depth >= 490), "{depth}");
            if depth > 0 {
                valid += 1;
                if let Some(arm) = arm_of_label[usize::from(label)] {
                    arms[arm] += 1;
                }
            }
        }
        let record = &set.record().images[image];
        assert_eq!((record.valid, &record.arms[..]), (valid, &arms[..]));
        assert!(arms[0] + arms[1] >= 300);
        assert!(image % 5 == 0 || arms[0] >= 300);
        total[0] += valid;
        total[1] += arms[0];
        total[2] += arms[1];
    }
    let share = |part: usize, whole: usize| part as f64 / whole as f64;
    let valid = share(total[0], set.len() * 640 * 480);
    let (right, left) = (share(total[1], total[0]), share(total[2], total[0]));
    println!("valid {valid:.3}, right arm {right:.4}, left arm {left:.4} of the valid pixels");
    assert!(valid > 0.75 && valid < 0.97);
    assert!(right > 0.005 && right < 0.15 && left < 0.15);
}

#[test]
fn posed_again_from_joints_csv_the_robot_covers_the_same_pixels() {
    let set = shared();
    let spec = pef(1);
    let rig = Rig::read(&spec.robot_path()).unwrap();
    let mut photographer = Photographer::new(&Camera::read(&spec.camera_path()).unwrap());
    for image in 0..3 {
        let q = set.configuration(image, &rig.robot).unwrap();
        let poses = rig.robot.forward_kinematics(&q);
        let error =
            rig.camera_from_root(&poses).to_homogeneous() - set.camera_from_root().to_homogeneous();
        assert!(error.abs().max() < 1e-12);
        let alone = photographer.draw(&robot_bodies(&rig, &poses, set.camera_from_root_of(image)));
        let frame = set.frame(image).unwrap();
        let (mut same, mut behind_furniture) = (0, 0);
        for (&seen, &drawn) in frame.labels.pixels.iter().zip(&alone.labels.pixels) {
            if seen > 0 {
                assert_eq!(seen, drawn);
                same += 1;
            } else if drawn > 0 {
                behind_furniture += 1;
            }
        }
        assert!(same > 300, "{same} {behind_furniture}");
        let y: Vec<f64> = rig.arms[0].joints.iter().map(|&dof| q[dof]).collect();
        assert_eq!(frame.joints, y);
    }
}

#[test]
fn the_format_is_what_others_rely_on() {
    let set = shared();
    let files: Vec<&str> = set.record().files.keys().map(String::as_str).collect();
    assert_eq!(
        files[..3],
        ["camera.json", "depth/000000.png", "depth/000001.png"]
    );
    assert!(files.contains(&"label/000010.png") && files.contains(&"joints.csv"));
    assert_eq!(files.len(), 2 + 2 * 11);
    let table = fs::read_to_string(set.folder().join("joints.csv")).unwrap();
    let header = table.lines().next().unwrap();
    assert!(header.starts_with(
        "image,R_SFE_rad,R_SAA_rad,R_HR_rad,R_EB_rad,R_WR_rad,R_WFE_rad,R_WAA_rad,R_FR_rad,\
         R_FR2_rad,R_RF_rad,R_RF2_rad,R_MF_rad,R_MF2_rad,R_LF_rad,R_LF2_rad,L_SFE_rad,"
    ));
    assert!(header.contains(",UTILT_rad"));
    let json = |file: &str| -> serde_json::Value {
        serde_json::from_slice(&fs::read(set.folder().join(file)).unwrap()).unwrap()
    };
    let camera = json("camera.json");
    assert_eq!(camera["intrinsics"]["fx"], 580.0);
    assert_eq!(camera["root"], "BASE");
    // The camera looks ahead and down from the head.
    assert!(camera["root_from_camera"][2][3].as_f64().unwrap() > 1.7);
    assert!(camera["root_from_camera"][2][2].as_f64().unwrap() < -0.7);
    let record = json("set.json");
    assert_eq!(record["format"], 1);
    assert_eq!(record["specification"]["visibility"]["target_pixels"], 300);
    let rig = Rig::read(&pef(1).robot_path()).unwrap();
    for entry in &set.record().labels {
        let link = rig.robot.link(&entry.link).unwrap();
        assert_eq!(usize::from(entry.label), link + 1);
        assert!(
            entry
                .link
                .starts_with(if entry.arm == "right" { "R_" } else { "L_" })
        );
    }
    set.verify().unwrap();
}

#[test]
fn a_contact_sheet_shows_all_images() {
    let set = shared();
    let path = set
        .folder()
        .parent()
        .unwrap()
        .join("armpose-test-sheet.png");
    let style = SheetStyle {
        columns: 4,
        shrink: 8,
        tint: true,
    };
    contact_sheet(&set, &[0, 1, 2, 3, 4], style, &path).unwrap();
    let mut reader = png_reader(&path);
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((info.width, info.height), (4 * 81 - 1, 2 * 61 - 1));
    let frame = set.frame(0).unwrap();
    for (y, x) in (0..60).flat_map(|y| (0..80).map(move |x| (y, x))) {
        let at = (y * info.width as usize + x) * 3;
        let invalid = frame.depth.pixels[y * 8 * 640 + x * 8] == 0;
        assert_eq!(pixels[at..at + 3] == [0, 0, 0], invalid);
    }
}

fn png_reader(path: &Path) -> ::png::Reader<std::io::BufReader<fs::File>> {
    let file = std::io::BufReader::new(fs::File::open(path).unwrap());
    ::png::Decoder::new(file).read_info().unwrap()
}

/// A copy of a small set, changed, must not open (or not yield its frames) for the right reason.
#[test]
fn broken_data_sets_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let original = shared();
    let fresh = |name: &str| {
        let copy = folder.path().join(name);
        for (path, bytes) in contents(original.folder()) {
            let to = copy.join(path.strip_prefix(original.folder()).unwrap());
            fs::create_dir_all(to.parent().unwrap()).unwrap();
            fs::write(to, bytes).unwrap();
        }
        copy
    };
    let refused = |name: &str, spoil: &dyn Fn(&Path)| {
        let copy = fresh(name);
        spoil(&copy);
        let frames = |set: DataSet| (0..set.len()).try_for_each(|i| set.frame(i).map(drop));
        let error = DataSet::open(&copy).and_then(frames).unwrap_err();
        let message = error.to_string();
        assert!(message.contains(&*copy.to_string_lossy()), "{message}");
        (error, message)
    };
    let edit = |file: &'static str, from: &'static str, to: &'static str| {
        move |copy: &Path| {
            let text = fs::read_to_string(copy.join(file)).unwrap();
            assert!(text.contains(from));
            fs::write(copy.join(file), text.replacen(from, to, 1)).unwrap();
        }
    };
    for file in [
        "set.json",
        "camera.json",
        "joints.csv",
        "depth/000007.png",
        "label/000010.png",
    ] {
        let (error, message) = refused(&format!("no {}", file.replace('/', "-")), &|copy| {
            fs::remove_file(copy.join(file)).unwrap();
        });
        assert!(matches!(error, DataSetError::Missing { .. }), "{message}");
        assert!(message.contains(file), "{message}");
    }
    let (_, message) = refused("cut", &|copy| {
        let path = copy.join("depth/000003.png");
        let bytes = fs::read(&path).unwrap();
        fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
    });
    assert!(message.contains("depth/000003.png"), "{message}");
    let (error, message) = refused("8-bit", &|copy| {
        fs::copy(copy.join("label/000000.png"), copy.join("depth/000000.png")).unwrap();
    });
    assert!(
        matches!(error, DataSetError::Png(png::PngError::Format { .. })),
        "{message}"
    );
    let (_, message) = refused(
        "version",
        &edit("set.json", "\"format\": 1", "\"format\": 99"),
    );
    assert!(message.contains("format 99"), "{message}");
    let (_, message) = refused("foreign", &|copy| {
        fs::write(copy.join("set.json"), "{}").unwrap()
    });
    assert!(message.contains("no data set"), "{message}");
    let (_, message) = refused("cut json", &|copy| {
        let text = fs::read_to_string(copy.join("set.json")).unwrap();
        fs::write(copy.join("set.json"), &text[..text.len() / 2]).unwrap();
    });
    assert!(message.contains("set.json"), "{message}");
    let (_, message) = refused("size", &edit("camera.json", "640", "320"));
    assert!(message.contains("640 x 480"), "{message}");
    let (_, message) = refused("joint", &edit("joints.csv", "R_SAA_rad", "R_XXX_rad"));
    assert!(message.contains("target arm"), "{message}");
    let (_, message) = refused("unit", &edit("joints.csv", "R_SAA_rad", "R_SAA_deg"));
    assert!(message.contains("R_SAA_deg"), "{message}");
    let (_, message) = refused("number", &edit("joints.csv", "\n3,", "\n3,x"));
    assert!(message.contains("row 4"), "{message}");
    let (_, message) = refused("rows", &edit("joints.csv", "\n10,", "\n#"));
    assert!(message.contains("joints.csv"), "{message}");

    // A digit that is added to a number still reads well, and is found by `verify`.
    let copy = fresh("altered");
    let table = fs::read_to_string(copy.join("joints.csv")).unwrap();
    fs::write(copy.join("joints.csv"), table.trim_end().to_owned() + "1\n").unwrap();
    let set = DataSet::open(&copy).unwrap();
    let message = set.verify().unwrap_err().to_string();
    assert!(
        message.contains("joints.csv") && message.contains("altered"),
        "{message}"
    );

    let error = generate(&pef(1), 1, original.folder(), &|_| {}).unwrap_err();
    assert!(matches!(error, DataSetError::NotEmpty { .. }), "{error}");
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let error = generate(&pef(1), 1, &file, &|_| {}).unwrap_err();
    assert!(matches!(error, DataSetError::Write { .. }), "{error}");
}

#[test]
fn mistakes_in_a_specification_are_named() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let text = fs::read_to_string(root.join("sets/pef.toml")).unwrap();
    let text = text.replace("\"../", &format!("\"{}/", root.display()));
    let folder = tempfile::tempdir().unwrap();
    let made = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        let path = folder.path().join("set.toml");
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let mut spec = SetSpec::read(&path)?;
        spec.images = spec.images.min(1);
        generate(&spec, 1, &folder.path().join("set"), &|_| {})
    };
    for (from, to, part) in [
        ("\nclearance = 0.8", "\nclearence = 0.8", "clearence"),
        ("images = 200", "images = 0", "images = 0"),
        ("ahead = [1.4, 2.6]", "ahead = [2.6, 1.4]", "room.ahead"),
        ("behind = [1.0, 2.0]", "behind = [nan, 2.0]", "room.behind"),
        ("chairs = [1, 3]", "chairs = [3, 1]", "furniture.chairs"),
        ("target = \"right\"", "target = \"rihgt\"", "rihgt"),
        ("UTILT", "UTLIT", "UTLIT"),
        ("realistic.toml", "unrealistic.toml", "unrealistic.toml"),
        ("robot.toml", "robto.toml", "robto.toml"),
    ] {
        let message = made(from, to).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
    // Mistakes are found before anything is written.
    assert!(!folder.path().join("set").exists());

    // A camera with so few pixels that no frame can show enough.
    let camera = fs::read_to_string(root.join("cameras/ideal.toml")).unwrap();
    let scale = |text: String, key: &str, from: &str, to: &str| {
        let (from, to) = (format!("{key} = {from}"), format!("{key} = {to}"));
        assert!(text.contains(&from), "{text}");
        text.replace(&from, &to)
    };
    let camera = scale(camera, "width", "640", "32");
    let camera = scale(camera, "height", "480", "24");
    let camera = scale(camera, "fx", "580.0", "29.0");
    let camera = scale(camera, "fy", "580.0", "29.0");
    let camera = scale(camera, "cx", "320.0", "15.5");
    let camera = scale(camera, "cy", "240.0", "11.5");
    fs::write(folder.path().join("small.toml"), camera).unwrap();
    let small = folder.path().join("small.toml");
    let realistic = format!("{}/cameras/realistic.toml", root.display());
    let text = text.replace(&realistic, &small.display().to_string());
    fs::write(folder.path().join("set.toml"), text).unwrap();
    let spec = SetSpec::read(&folder.path().join("set.toml")).unwrap();
    let error = generate(&spec, 1, &folder.path().join("set"), &|_| {}).unwrap_err();
    assert!(matches!(error, DataSetError::NoFrame { .. }), "{error}");
    assert!(!folder.path().join("set/set.json").exists());
}
