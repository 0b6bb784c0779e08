//! Joints that turn all round: the planar arm's shoulder has no limits.

use armpose::circular::Circular;
use armpose::dataset::{DataSet, SetSpec, generate, sample_pixels};
use armpose::estimator::error::angle_error;
use armpose::estimator::image::combine;
use armpose::feature::{DepthFeatures, Extra, FeatureSpec, PaddedDepth, SampleMatrix};
use armpose::forest::ForestError;
use armpose::forest::bins::BinnedMatrix;
use armpose::forest::grow::{GrowSpec, TargetTable};
use armpose::forest::leaves::grow_means;
use armpose::forest::objective::mse::mse;
use armpose::forest::pose_forest::PoseForest;
use armpose::random::stream;
use armpose::scene::{PoseSampler, PoseSpec, Rig};
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/robots")
}

fn set(folder: &Path, images: usize) -> DataSet {
    let mut spec = SetSpec::read(&fixtures().join("planar_arm/set.toml")).unwrap();
    spec.without_robot = 0.0;
    spec.images = images;
    generate(&spec, 1, folder, &|_| {}).unwrap()
}

const PIXELS: usize = 40;

/// A forest on these poses of the first images.
fn train(set: &DataSet, poses: &[Vec<f64>], circular: &Circular) -> PoseForest {
    let spec = FeatureSpec {
        count: 150,
        window: 60,
    };
    let features =
        DepthFeatures::draw(&spec, Extra::Nothing, &mut stream(1, "features", &[])).unwrap();
    let counts = vec![PIXELS; poses.len()];
    let matrix = SampleMatrix::fill(features.count(), &counts, |image, columns| {
        let frame = set.frame(image).unwrap();
        let mut random = stream(1, "pixels", &[image as u64]);
        let pixels = sample_pixels(&frame, &set.arm_of_label(), PIXELS, 0, &mut random).unwrap();
        let padded = PaddedDepth::new(&frame.depth, features.reach());
        let position = |&(x, y): &(u16, u16)| padded.position(x.into(), y.into());
        let positions: Vec<u32> = pixels.iter().map(position).collect();
        features.fill(&padded, &positions, columns);
        Ok::<(), ()>(())
    });
    let data = BinnedMatrix::new(&matrix.unwrap()).unwrap();
    let targets: Vec<u16> = (0..poses.len() * PIXELS)
        .map(|sample| (sample / PIXELS) as u16)
        .collect();
    let columns = poses.iter().flat_map(|pose| circular.encode(pose));
    let table = TargetTable::new(circular.columns(2), columns.collect()).unwrap();
    let spec = GrowSpec {
        trees: 5,
        min_leaf: 5,
        features_per_node: 12,
        max_depth: None,
        bootstrap: true,
    };
    let objective = mse(&table).unwrap();
    let grown = grow_means(&data, &targets, &table, &*objective, &spec, 7, &|_| ());
    let (trees, leaves) = grown.unwrap();
    let names = set.target_joints().to_vec();
    PoseForest::new(features, names, circular.clone(), trees, leaves, 1.0).unwrap()
}

/// The estimate at t_r = 0.5 from all pixels of the arm, and the first pixel's own.
fn estimate(set: &DataSet, forest: &PoseForest, image: usize) -> (Vec<f64>, Vec<f64>) {
    let frame = set.frame(image).unwrap();
    let padded = PaddedDepth::new(&frame.depth, forest.features().reach());
    let seen = frame.labels.pixels.iter().zip(&frame.depth.pixels);
    let at: Vec<usize> = seen
        .enumerate()
        .filter(|(_, (label, depth))| **label > 0 && **depth > 0)
        .map(|(at, _)| at)
        .collect();
    let width = frame.depth.width;
    let positions: Vec<u32> = at
        .iter()
        .map(|at| padded.position(at % width, at / width))
        .collect();
    let found = forest.find_leaves(&forest.features().on(&padded), &positions);
    let combined = combine(forest, &found, &vec![true; at.len()]).unwrap();
    let mut of_pixel = vec![0.0; 2];
    found.pose(0, &mut of_pixel);
    (combined.thresholds[50].pose.clone(), of_pixel)
}

#[test]
fn angles_beside_the_seam_are_estimated_as_well_as_others() {
    let folder = tempfile::tempdir().unwrap();
    const TRAINED: usize = 160;
    let set = set(folder.path(), 260);
    assert_eq!(set.circular().places(), [0]);
    let poses: Vec<Vec<f64>> = (0..TRAINED).map(|i| set.pose(i).to_vec()).collect();
    let circle = train(&set, &poses, set.circular());
    let line = train(&set, &poses, &Circular::default());
    // Whoever notes the angles may add full turns.
    let turned = |(image, pose): (usize, &Vec<f64>)| {
        vec![pose[0] + TAU * ((image % 3) as f64 - 1.0), pose[1]]
    };
    let turned: Vec<Vec<f64>> = poses.iter().enumerate().map(turned).collect();
    let turned = train(&set, &turned, set.circular());

    let (mut at_seam, mut elsewhere, mut on_line) = (Vec::new(), Vec::new(), Vec::new());
    for image in TRAINED..set.len() {
        let truth = set.pose(image);
        let (pose, of_pixel) = estimate(&set, &circle, image);
        assert!(pose[0].abs() <= PI && of_pixel[0].abs() <= PI);
        let again = estimate(&set, &turned, image).0;
        assert!(angle_error(pose[0], again[0]) < 1e-6 && (pose[1] - again[1]).abs() < 1e-6);
        let error = angle_error(truth[0], pose[0]);
        if truth[0].abs() > PI - 0.3 {
            at_seam.push(error);
            on_line.push(angle_error(truth[0], estimate(&set, &line, image).0[0]));
        } else {
            elsewhere.push(error);
        }
    }
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
    let (at_seam, elsewhere, on_line) = (mean(&at_seam), mean(&elsewhere), mean(&on_line));
    println!("{at_seam:.3} at the seam, {elsewhere:.3} elsewhere, {on_line:.3} on a line");
    assert!(at_seam < 0.15 && elsewhere < 0.15 && on_line > 3.0 * at_seam);
}

#[test]
fn model_files_tell_of_circles_only_where_there_are_any() {
    let folder = tempfile::tempdir().unwrap();
    let set = set(&folder.path().join("set"), 3);
    let poses: Vec<Vec<f64>> = (0..3).map(|i| set.pose(i).to_vec()).collect();
    let path = folder.path().join("forest.bin");
    for circular in [Circular::default(), Circular::new(vec![0])] {
        let forest = train(&set, &poses, &circular);
        forest.save(&path).unwrap();
        assert_eq!(PoseForest::load(&path).unwrap(), forest);
        let bytes = std::fs::read(&path).unwrap();
        let told = bytes.windows(8).any(|part| part == b"circular");
        assert_eq!(told, !circular.is_empty());
        // The leaves of one make no sense with the circles of another.
        for wrong in [vec![0, 1], vec![7]] {
            let refused = PoseForest::new(
                forest.features().clone(),
                forest.names().to_vec(),
                Circular::new(wrong),
                forest.trees().to_vec(),
                forest.leaves().to_vec(),
                1.0,
            );
            let error = refused.unwrap_err();
            assert!(matches!(
                error,
                ForestError::Circular(2) | ForestError::Size { .. }
            ));
        }
    }
}

#[test]
fn a_joint_that_turns_all_round_may_be_drawn_from_anywhere() {
    let rig = Rig::read(&fixtures().join("planar_arm/robot.toml")).unwrap();
    let sampler = |joint: &str, range: [f64; 2]| {
        let spec = PoseSpec {
            ranges: [(joint.to_owned(), range)].into(),
            ..PoseSpec::default()
        };
        PoseSampler::new(&rig, &spec)
    };
    let across = sampler("shoulder", [3.0, 4.0]).unwrap();
    let mut s = stream(1, "ranges", &[]);
    let drawn = across.sample(&rig.robot, &mut s)[0];
    assert!((3.0..4.0).contains(&drawn));
    assert!(sampler("shoulder", [4.0, 3.0]).is_err());
    assert!(sampler("shoulder", [f64::NEG_INFINITY, 0.0]).is_err());
    assert!(sampler("elbow", [2.0, 3.0]).is_err());
}
