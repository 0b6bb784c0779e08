//! Files of every format, mutated at random: each is read or refused with a message, and nothing panics or
//! hangs. A blink of it here; `ARMPOSE_FUZZ_SECONDS=600 cargo test --test mutations` goes on for ten minutes
//! a format, with other mutations for other numbers.

use armpose::camera::camera_file;
use armpose::camera::depth_file::{Units, read_depth_file};
use armpose::camera::png::{read_depth, read_labels, write_depth, write_labels};
use armpose::camera::{Camera, Image, Intrinsics, Resampling};
use armpose::dataset::{RealFrames, SetSpec, generate};
use armpose::forest::pose_forest::PoseForest;
use armpose::model::Model;
use armpose::model::training::{ModelSpec, train};
use armpose::random::{Stream, below, stream};
use armpose::robot::Robot;
use armpose::scene::{Rig, inspect::remarks};
use std::error::Error;
use std::fs;
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What a format's grammar is made of, or what arithmetic stumbles over.
const WORDS: &[&str] = &[
    "1e300",
    "-1",
    "0",
    "nan",
    "inf",
    "1e-300",
    "99999999999",
    "-9223372036854775808",
    "\"",
    "'",
    "=",
    "[",
    "]",
    "{",
    "}",
    "<",
    ">",
    "/>",
    "#",
    ".",
    ",",
    "\n",
    "<!--",
    "-->",
    "<!DOCTYPE ",
    "&lt;",
    "<link name=\"a\"/>",
    "<joint name=\"j\" type=\"continuous\">",
    "</joint>",
    "floating",
    "prismatic",
    "<mimic joint=\"shoulder\" multiplier=\"1e5\"/>",
    "<origin xyz=\"1 2 3\" rpy=\"1 2 3\"/>",
    "<sphere radius=\"1\"/>",
    "<mesh filename=\"x.stl\"/>",
    "facet",
    "vertex",
    "endloop",
    "f 1 2 3",
    "<polylist count=\"",
    "<polygons>",
    "<tristrips>",
    "<instance_node url=\"#n\"/>",
    "<rotate>0 0 1 90</rotate>",
    "<scale>1e30 0 -1</scale>",
    "stride=\"",
    "offset=\"9\"",
    "xmlns:a=\"b\"",
    "<a:b/>",
    "\\\n",
    "endfacet",
    "SOLID x\nFACET NORMAL",
    "<float_array count=\"",
    "'descr'",
    "'<f8'",
    "(16, 12)",
    "'fortran_order': True",
    "(1, 6, 8)",
    "P5\n8 6 65535\n",
    "Pf\n8 6\n-1.0\n",
    "&a ",
    "*a",
    "<<: *a",
    "---\n",
    "!!opencv-matrix",
    "\"coeffs\": [1e3, -1e9]",
    "depth_scale: ",
    "{ xyz = [0, 0, 1], quaternion_xyzw = [0, 0, 0, 1] }",
    "link_from_camera = ",
    "true",
    "null",
];
const NUMBERS: [u32; 6] = [0, 1, 255, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff];
const LONGEST: usize = 100_000;
/// No file of that length takes longer.
const SLOWEST: Duration = Duration::from_secs(20);

fn mutated(s: &mut Stream, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = seeds[below(s, seeds.len())].clone();
    for _ in 0..=below(s, 4) {
        let at = below(s, bytes.len() + 1);
        let to = (at + below(s, 60)).min(bytes.len());
        match below(s, 6) {
            0 if at < bytes.len() => bytes[at] ^= 1 << below(s, 8),
            1 => drop(bytes.drain(at..to)),
            2 => {
                let part = bytes[at..to].to_vec();
                bytes.splice(at..at, part);
            }
            3 => {
                let other = &seeds[below(s, seeds.len())];
                let from = below(s, other.len() + 1);
                let part = other[from..(from + below(s, 300)).min(other.len())].to_vec();
                bytes.splice(at..at, part);
            }
            4 => {
                let number = NUMBERS[below(s, NUMBERS.len())].to_le_bytes();
                let kept = bytes.iter_mut().skip(at).zip(number);
                kept.for_each(|(byte, new)| *byte = new);
            }
            _ => drop(bytes.splice(at..to, WORDS[below(s, WORDS.len())].bytes())),
        }
    }
    bytes.truncate(LONGEST);
    bytes
}

type Read<'a> = &'a dyn Fn(&[u8]) -> Result<(), Box<dyn Error>>;

/// Reads mutations of `seeds`, all of which are fine themselves.
fn mutate(format: &str, seeds: Vec<Vec<u8>>, read: Read) {
    for seed in &seeds {
        read(seed).unwrap();
    }
    let seconds = std::env::var("ARMPOSE_FUZZ_SECONDS").ok();
    let seconds: Option<u64> = seconds.and_then(|s| s.parse().ok());
    let time = seconds.map_or(Duration::from_millis(300), Duration::from_secs);
    let mut s = stream(seconds.unwrap_or(0), format, &[]);
    let (begin, mut runs, mut fine, mut slowest) = (Instant::now(), 0, 0, Duration::ZERO);
    while begin.elapsed() < time {
        let bytes = mutated(&mut s, &seeds);
        let start = Instant::now();
        let result = panic::catch_unwind(AssertUnwindSafe(|| read(&bytes)));
        let keep = || {
            let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format);
            fs::write(&kept, &bytes).unwrap();
            println!("{} does it", kept.display());
        };
        let result = result.unwrap_or_else(|cause| {
            keep();
            panic::resume_unwind(cause)
        });
        if start.elapsed() > SLOWEST {
            keep();
            panic!("a file takes {:?}", start.elapsed());
        }
        match result {
            Ok(()) => fine += 1,
            // A mistake in TOML is shown in its line.
            Err(error) => assert!(error.to_string().lines().count() <= 8, "{error}"),
        }
        runs += 1;
        slowest = slowest.max(start.elapsed());
    }
    println!("{format}: {runs} files, {fine} of them fine, the slowest in {slowest:?}");
    assert!(runs > 0);
}

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn bytes(path: &Path) -> Vec<u8> {
    fs::read(path).unwrap()
}

#[test]
fn robots() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.urdf");
    let cases = ["u_mimic_no_limit", "u_two_materials", "u_zero_box"];
    let cases = cases.map(|name| format!("tests/fixtures/cases/robots/{name}.urdf"));
    let arms = ["planar_arm", "gripper_arm"];
    let arms = arms.map(|robot| format!("tests/fixtures/robots/{robot}/arm.urdf"));
    let seeds = cases.iter().chain(&arms).map(|file| bytes(&here(file)));
    mutate("urdf", seeds.collect(), &|bytes| {
        fs::write(&path, bytes)?;
        let robot = Robot::from_urdf(&path)?;
        let poses = robot.forward_kinematics(&robot.rest());
        assert!(
            poses
                .iter()
                .all(|p| p.translation.vector.norm().is_finite())
        );
        let _ = remarks(&robot);
        Ok(())
    });
}

#[test]
fn meshes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let kinds = ["stl", "obj", "dae"];
    for kind in kinds {
        let urdf = format!(
            "<robot name=\"r\"><link name=\"a\"><visual><geometry><mesh filename=\"mesh.{kind}\"/>\
             </geometry></visual></link></robot>"
        );
        fs::write(at(&format!("{kind}.urdf")), urdf).unwrap();
    }
    let ascii = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
                 endloop\nendfacet\nendsolid a\n";
    let obj = "v 0 0 0\nv 1 0 0 1\nv 0 1 0 .5 .5 .5\nv 0 0 1\nf 1 2 3\nf 1/1 2//2 4/4/4\nf -1 \\\n-2 1 2\n\
               v 2 0 0\nv 2 2 0\nv 1 1 0\nv 0 2 0\nf 1 5 6 7 8\n";
    let box_of_case = |name: &str| bytes(&here(&format!("tests/fixtures/cases/robots/{name}")));
    let binary = bytes(&here("data/robots/arm/meshes/torso.stl"));
    // The first byte says which kind a file is.
    let seed = |kind: u8, bytes: &[u8]| [&[kind], bytes].concat();
    let seeds = vec![
        seed(0, &binary),
        seed(0, ascii.as_bytes()),
        seed(1, obj.as_bytes()),
        seed(2, &box_of_case("dae_instance_node_mm.dae")),
        seed(2, &bytes(&here("tests/fixtures/robots/everything.dae"))),
    ];
    mutate("mesh", seeds, &|bytes| {
        let (first, rest) = bytes.split_first().unwrap_or((&0, &[]));
        let kind = kinds[usize::from(*first) % kinds.len()];
        fs::write(at(&format!("mesh.{kind}")), rest)?;
        let robot = Robot::from_urdf(&at(&format!("{kind}.urdf")))?;
        let _ = robot.links[0].mesh.components();
        Ok(())
    });
}

const CAMERA: Intrinsics = Intrinsics {
    width: 16,
    height: 12,
    fx: 10.0,
    fy: 10.0,
    cx: 8.0,
    cy: 6.0,
};

fn image<T: Clone>(value: T) -> Image<T> {
    Image {
        width: 16,
        height: 12,
        pixels: vec![value; 16 * 12],
    }
}

#[test]
fn images() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_depth(&at("depth.png"), &image(1500)).unwrap();
    write_labels(&at("labels.png"), &image(3)).unwrap();
    let seed = |kind: u8, name: &str| [&[kind], &bytes(&at(name))[..]].concat();
    let seeds = vec![seed(0, "depth.png"), seed(1, "labels.png")];
    mutate("image", seeds, &|bytes| {
        let (kind, rest) = bytes.split_first().unwrap_or((&0, &[]));
        let path = at("image.png");
        fs::write(&path, rest)?;
        match kind % 2 {
            0 => drop(read_depth(&path, &CAMERA)?),
            _ => drop(read_labels(&path, &CAMERA)?),
        }
        Ok(())
    });
}

/// Depth files of every format, of the right size and of any.
#[test]
fn depth_files() {
    let folder = tempfile::tempdir().unwrap();
    let kinds = ["png", "npy", "npz", "tif", "exr", "pgm", "pfm"];
    let ours = here("tests/fixtures/depth");
    for kind in kinds {
        let path = folder.path().join(format!("depth.{kind}"));
        let entries = fs::read_dir(&ours).unwrap().map(|e| e.unwrap().path());
        let mut files: Vec<PathBuf> = entries
            .filter(|file| file.extension().is_some_and(|end| end == kind))
            .filter(|file| read_depth_file(file, None, Units::default()).is_ok())
            .collect();
        files.sort();
        assert!(!files.is_empty());
        let seeds = files.iter().map(|file| bytes(file)).collect();
        mutate(kind, seeds, &|bytes| {
            fs::write(&path, bytes)?;
            let any = read_depth_file(&path, None, Units::default());
            let right = read_depth_file(&path, Some([8, 6]), Units::default());
            // Whatever is of the right size is the same without asking.
            if let Ok(right) = right {
                assert!(any.as_ref().is_ok_and(|any| *any == right));
            }
            any?;
            Ok(())
        });
    }
}

#[test]
fn cameras() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera");
    let k = "[300.0, 0.0, 160.0, 0.0, 300.0, 120.0, 0.0, 0.0, 1.0]";
    let case = |name: &str| bytes(&here(&format!("tests/fixtures/cases/cameras/{name}")));
    let opencv = format!(
        "%YAML:1.0\n---\nimage_width: 320\nimage_height: 240\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
         cols: 3\n   dt: d\n   data: {k}\ndistortion_coefficients: &a\n   rows: 1\n   data: [-0.2, 0.1, 0., 0.]\n\
         copy: *a\n"
    );
    let bop =
        format!("{{\"1\": {{\"cam_K\": {k}, \"depth_scale\": 0.1}}, \"2\": {{\"cam_K\": {k}}}}}");
    let open_3d = "{\"width\": 320, \"height\": 240, \"intrinsic_matrix\": [300, 0, 0, 0, 300, 0, 160, 120, 1]}";
    let seeds = vec![
        case("camera_info.yaml"),
        case("rs_intrinsics.json"),
        opencv.into_bytes(),
        bop.into_bytes(),
        open_3d.into(),
    ];
    mutate("camera", seeds, &|bytes| {
        fs::write(&path, bytes)?;
        let file = camera_file::read(&path)?;
        let camera = file.of(Path::new("depth_000001.png"))?;
        let lens = camera.lens(camera.size().unwrap_or([320, 240]))?;
        let seen = Resampling::new(&lens, &CAMERA).covered();
        assert!((0.0..=1.0).contains(&seen));
        Ok(())
    });
}

#[test]
fn models() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mut spec = SetSpec::read(&here("tests/fixtures/robots/planar_arm/set.toml")).unwrap();
    spec.images = 6;
    let set = generate(&spec, 1, &at("set"), &|_| ()).unwrap();
    let rig = Rig::read(&spec.robot_path()).unwrap();
    let mut training = ModelSpec::of_paper(160);
    for forest in training.segmentation.iter_mut().chain([&mut training.pose]) {
        (forest.foreground, forest.background) = (40, 20);
        forest.forest.trees = 2;
    }
    let model = train(&set, (&rig, &spec.robot_path()), &training, &|_| ()).unwrap();
    model.save(&at("model")).unwrap();
    let forest = bytes(&at("model/pose.bin"));
    let record = bytes(&at("model/model.json"));
    // The hash at a forest's end is put right, or nothing else would ever be looked at.
    let (forest, _) = forest.split_at(forest.len() - 32);
    let seeds = vec![[&[0], forest].concat(), [&[1], &record[..]].concat()];
    mutate("model", seeds, &|bytes| {
        let (kind, rest) = bytes.split_first().unwrap_or((&0, &[]));
        if kind % 2 == 0 {
            let hash = blake3::hash(rest);
            fs::write(at("forest.bin"), [rest, hash.as_bytes()].concat())?;
            PoseForest::load(&at("forest.bin"))?;
        } else {
            fs::write(at("model/model.json"), rest)?;
            Model::load(&at("model"))?;
        }
        Ok(())
    });
}

#[test]
fn specifications() {
    let folder = tempfile::tempdir().unwrap();
    let planar = folder.path().join("planar_arm");
    fs::create_dir(&planar).unwrap();
    let robots = here("tests/fixtures/robots");
    fs::copy(robots.join("planar_arm/arm.urdf"), planar.join("arm.urdf")).unwrap();
    let real = "{\"joint_names\": [\"a\"], \"width\": 4, \"height\": 3, \"fx\": 5.0, \"fy\": 5.5, \
                \"cx\": 1.5, \"cy\": 1.0, \"frames\": [{\"depth\": \"0.png\", \"q\": [0.1]}]}";
    let files = [
        "planar_arm/set.toml",
        "planar_arm/robot.toml",
        "camera.toml",
    ];
    let files = files.map(|file| bytes(&robots.join(file)));
    let robot = String::from_utf8(files[1].clone()).unwrap();
    let files = [&files[..], &[real.as_bytes().to_vec()]].concat();
    let seeds = files.iter().zip(0u8..);
    let seeds = seeds.map(|(bytes, kind)| [&[kind], &bytes[..]].concat());
    let mut seeds: Vec<Vec<u8>> = seeds.collect();
    let mount = robot
        .lines()
        .find(|line| line.starts_with("camera_from_link"))
        .unwrap();
    for pose in [
        "link_from_camera = { xyz = [0, 0, 1.5], quaternion_xyzw = [1, 0, 0, 0] }",
        "camera_from_link = { xyz = [0, 0, 1.5], rpy = [3.14, 0, 0] }",
    ] {
        seeds.push([&[1], robot.replace(mount, pose).as_bytes()].concat());
    }
    mutate("specification", seeds, &|bytes| {
        let (kind, rest) = bytes.split_first().unwrap_or((&0, &[]));
        let path = planar.join("file.toml");
        fs::write(&path, rest)?;
        match kind % 4 {
            0 => drop(SetSpec::read(&path)?),
            1 => drop(Rig::read(&path)?),
            2 => drop(Camera::read(&path)?),
            _ => drop(RealFrames::read(&path)?),
        }
        Ok(())
    });
}
