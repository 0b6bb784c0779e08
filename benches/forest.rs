//! Training one tree at the paper's size and at smaller ones, on few features a node and on all, and MSPD
//! as published at a size it can do.

use armpose::camera::DepthImage;
use armpose::circular::Circular;
use armpose::distances::DistanceMatrix;
use armpose::feature::{DepthFeatures, Extra, FeatureSpec, PaddedDepth, SampleMatrix};
use armpose::forest::bins::BinnedMatrix;
use armpose::forest::grow::{GrowSpec, TargetTable};
use armpose::forest::leaves::grow_means;
use armpose::forest::objective::mspd_few::mspd_few;
use armpose::forest::objective::mspd_published::mspd_published;
use armpose::forest::objective::{Objective, mse::mse, mspd::mspd};
use armpose::forest::pose_forest::PoseForest;
use armpose::random::{below, stream, uniform};
use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use std::time::Duration;

const POSES: usize = 160;
const SAMPLES_PER_POSE: usize = 3000;
const JOINTS: usize = 15;

/// The joints of the arm that [`image`] draws: pixels and millimetres.
fn joints(pose: &[f64]) -> Vec<[f64; 3]> {
    let (mut at, mut heading) = ([420.0, 240.0, 1400.0], 0.0);
    let moved = |joint: &f64| {
        heading += joint;
        at[0] += 40.0 * f64::cos(heading);
        at[1] += 40.0 * f64::sin(heading);
        at[2] -= 120.0 * joint;
        at
    };
    pose.iter().take(7).map(moved).collect()
}

/// The largest way that a joint goes from one pose to the other, as DISP is of all points.
fn displacement(a: &[f64], b: &[f64]) -> f64 {
    let ways = joints(a).into_iter().zip(joints(b));
    let way = |(a, b): ([f64; 3], [f64; 3])| {
        let squares = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2));
        squares.sum::<f64>().sqrt()
    };
    ways.map(way).fold(0.0, f64::max)
}

/// A table, and on it an arm of seven bars that hang together and turn by their pose: a scene in
/// which a pixel's surroundings say something about the pose, and most of which is empty.
fn image(pose: &[f64]) -> DepthImage {
    let (width, height) = (640, 480);
    let mut pixels = vec![0; width * height];
    for (at, depth) in pixels.iter_mut().enumerate() {
        let (x, y) = (at % width, at / width);
        *depth = match y {
            0..200 if x % 97 < 3 => 0,
            0..200 => 4000 + (x / 40 * 10) as u16,
            _ => (800.0 + 600_000.0 / (y as f64 + 20.0)) as u16,
        };
    }
    let (mut x, mut y, mut z, mut heading) = (420.0, 240.0, 1400.0, 0.0);
    for joint in pose.iter().take(7) {
        heading += joint;
        for _ in 0..40 {
            x += f64::cos(heading);
            y += f64::sin(heading);
            z -= 3.0 * joint;
            for dy in -14..=14 {
                for dx in -14..=14 {
                    let (u, v) = (x as i32 + dx, y as i32 + dy);
                    if (0..width as i32).contains(&u) && (0..height as i32).contains(&v) {
                        let round = (dx * dx + dy * dy) / 4;
                        pixels[v as usize * width + u as usize] = (z as i32 + round) as u16;
                    }
                }
            }
        }
    }
    DepthImage {
        width,
        height,
        pixels,
    }
}

struct Data {
    features: DepthFeatures,
    binned: BinnedMatrix,
    targets: Vec<u16>,
    table: TargetTable,
}

fn samples(samples_per_pose: usize) -> Data {
    let mut random = stream(1, "bench", &[]);
    let spec = FeatureSpec {
        count: 500,
        window: 200,
    };
    let features = DepthFeatures::draw(&spec, Extra::Nothing, &mut random).unwrap();
    let poses: Vec<f64> = (0..POSES * JOINTS)
        .map(|_| uniform(&mut random, -1.2, 1.2))
        .collect();
    let images: Vec<DepthImage> = poses.chunks(JOINTS).map(image).collect();
    let counts = vec![samples_per_pose; POSES];
    let matrix = SampleMatrix::fill(features.count(), &counts, |i, columns| {
        let padded = PaddedDepth::new(&images[i], features.reach());
        let mut random = stream(1, "pixels", &[i as u64]);
        // Most on the arm, as in the paper's training data.
        let mut positions = Vec::new();
        while positions.len() < samples_per_pose {
            let (x, y) = (below(&mut random, 640), below(&mut random, 480));
            let near = padded.depth(padded.position(x, y)) < 1800;
            if near || below(&mut random, 40) == 0 {
                positions.push(padded.position(x, y));
            }
        }
        positions.sort_unstable();
        features.fill(&padded, &positions, columns);
        Ok::<(), ()>(())
    })
    .unwrap();
    Data {
        features,
        binned: BinnedMatrix::new(&matrix).unwrap(),
        targets: (0..POSES * samples_per_pose)
            .map(|i| (i / samples_per_pose) as u16)
            .collect(),
        table: TargetTable::new(JOINTS, poses).unwrap(),
    }
}

fn grow(
    data: &Data,
    objective: &dyn Objective,
    trees: usize,
    features_per_node: usize,
) -> PoseForest {
    let spec = GrowSpec {
        trees,
        min_leaf: 5,
        features_per_node,
        max_depth: None,
        bootstrap: true,
    };
    let (trees, leaves) = grow_means(
        &data.binned,
        &data.targets,
        &data.table,
        objective,
        &spec,
        7,
        &|_| (),
    )
    .unwrap();
    let names = (0..JOINTS).map(|joint| format!("joint {joint}")).collect();
    PoseForest::new(
        data.features.clone(),
        names,
        Circular::default(),
        trees,
        leaves,
        1.0,
    )
    .unwrap()
}

fn benches(criterion: &mut Criterion) {
    let one_core = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let one_core = one_core.unwrap();
    let data = samples(SAMPLES_PER_POSE);
    let mut group = criterion.benchmark_group("forest");
    group
        .sampling_mode(SamplingMode::Flat)
        .sample_size(10)
        .warm_up_time(Duration::from_secs(1));
    let distances = DistanceMatrix::new(POSES, |a, b| {
        displacement(data.table.row(a), data.table.row(b))
    });
    let by_variance = mse(&data.table).unwrap();
    for (name, objective) in [
        ("MSE", &*by_variance),
        ("MSPD", &*mspd(&distances).unwrap()),
        ("MSPD in few dimensions", &*mspd_few(&distances).unwrap()),
    ] {
        group.bench_function(
            format!("train one tree on {name}, 480,000 x 500, 22 a node"),
            |b| b.iter(|| one_core.install(|| grow(&data, objective, 1, 22))),
        );
    }
    for samples_per_pose in [30, 300] {
        let data = samples(samples_per_pose);
        let by_variance = mse(&data.table).unwrap();
        for features_per_node in [22, 500] {
            let size = POSES * samples_per_pose;
            group.bench_function(
                format!("train one tree on MSE, {size} x 500, {features_per_node} a node"),
                |b| {
                    b.iter(|| one_core.install(|| grow(&data, &*by_variance, 1, features_per_node)))
                },
            );
        }
    }
    // The published form's time grows with the square of a node's size: few samples a pose.
    let some = samples(50);
    for (name, objective) in [
        ("MSPD", mspd(&distances).unwrap()),
        ("MSPD as published", mspd_published(&distances).unwrap()),
    ] {
        group.bench_function(format!("train one tree on {name}, 8,000 x 500"), |b| {
            b.iter(|| one_core.install(|| grow(&some, &*objective, 1, 22)));
        });
    }
}

criterion_group!(forest, benches);
criterion_main!(forest);
