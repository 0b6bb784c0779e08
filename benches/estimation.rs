//! Estimating in images of the simulated camera: the walk of pixels through a tree beside the walk of one
//! after the other, whole estimates, and loading a model. The pose forest has the paper's size; the
//! segmentation forest learns from the same 160 images. Images and forests are made once and kept in
//! Cargo's folder for temporary files.

use armpose::camera::DepthImage;
use armpose::circular::Circular;
use armpose::dataset::{DataSet, Frame, SetSpec, generate, sample_pixels};
use armpose::estimator::image::combine;
use armpose::estimator::look::Look;
use armpose::estimator::segmentation::{masked, segment};
use armpose::feature::{
    DepthFeatures, Extra, FeatureSpec, FeaturesOnImage, PaddedDepth, SampleMatrix,
};
use armpose::forest::bins::BinnedMatrix;
use armpose::forest::grow::{GrowSpec, TargetTable};
use armpose::forest::leaves::{LeafTable, grow_means};
use armpose::forest::objective::mse::mse;
use armpose::forest::pose_forest::PoseForest;
use armpose::forest::segmentation_forest::SegmentationForest;
use armpose::forest::tree::{LEAF, Tree, find_leaves};
use armpose::random::stream;
use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use std::hint::black_box;
use std::path::Path;

/// The first ones are learnt from, the last one is estimated.
const IMAGES: usize = 161;
const TREES: usize = 10;

fn data_set(folder: &Path) -> DataSet {
    let sets = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/sets");
    let mut spec = SetSpec::read(&sets.join("pef.toml")).expect("a sound set");
    spec.images = IMAGES;
    DataSet::open(folder)
        .or_else(|_| generate(&spec, 1, folder, &|_| ()))
        .expect("images")
}

/// Grows trees on pixels of all images but the last; `target` says which target and which row of the
/// table a pixel of an image has.
fn grow(
    set: &DataSet,
    features: &DepthFeatures,
    foreground: usize,
    background: usize,
    table: TargetTable,
    target: &dyn Fn(usize, &Frame, usize) -> u16,
    spec: &GrowSpec,
) -> (Vec<Tree>, Vec<LeafTable>) {
    let arms = set.arm_of_label();
    let counts = vec![foreground + background; IMAGES - 1];
    let drawn: Vec<_> = (0..IMAGES - 1)
        .map(|image| {
            let frame = set.frame(image).expect("an image");
            let mut random = stream(1, "bench", &[image as u64]);
            let pixels = sample_pixels(&frame, &arms, foreground, background, &mut random);
            (frame, pixels.expect("pixels"))
        })
        .collect();
    let matrix = SampleMatrix::fill(features.count(), &counts, |image, columns| {
        let (frame, pixels) = &drawn[image];
        let padded = PaddedDepth::new(&frame.depth, features.reach());
        let position = |&(x, y): &(u16, u16)| padded.position(x.into(), y.into());
        let positions: Vec<u32> = pixels.iter().map(position).collect();
        features.fill(&padded, &positions, columns);
        Ok::<(), ()>(())
    });
    let targets = drawn
        .iter()
        .enumerate()
        .flat_map(|(image, (frame, pixels))| {
            let at = |&(x, y): &(u16, u16)| usize::from(y) * frame.depth.width + usize::from(x);
            pixels
                .iter()
                .map(move |pixel| target(image, frame, at(pixel)))
        });
    let targets: Vec<u16> = targets.collect();
    let data = BinnedMatrix::new(&matrix.expect("samples")).expect("samples");
    let objective = mse(&table).expect("targets");
    grow_means(&data, &targets, &table, &*objective, spec, 7, &|_| ()).expect("trees")
}

fn features(count: usize, window: usize, extra: Extra) -> DepthFeatures {
    let spec = FeatureSpec { count, window };
    DepthFeatures::draw(&spec, extra, &mut stream(1, "features", &[])).expect("features")
}

fn pose_forest(set: &DataSet) -> PoseForest {
    let features = features(500, 200, Extra::Nothing);
    let spec = GrowSpec {
        trees: TREES,
        min_leaf: 5,
        features_per_node: 22,
        max_depth: None,
        bootstrap: true,
    };
    let poses: Vec<f64> = (0..IMAGES - 1).flat_map(|i| set.pose(i)).copied().collect();
    let names = set.target_joints().to_vec();
    let table = TargetTable::new(names.len(), poses).expect("poses");
    let of_image = |image: usize, _: &Frame, _: usize| image as u16;
    let (trees, leaves) = grow(set, &features, 2000, 1000, table, &of_image, &spec);
    PoseForest::new(features, names, Circular::default(), trees, leaves, 1.0).expect("a forest")
}

fn segmentation_forest(set: &DataSet) -> SegmentationForest {
    let features = features(200, 100, Extra::Pixel);
    let spec = GrowSpec {
        trees: TREES,
        min_leaf: 1,
        features_per_node: 14,
        max_depth: None,
        bootstrap: true,
    };
    let (classes, arms) = (set.classes(), set.arm_of_label());
    let width = classes.len();
    let members = (0..width * width).map(|at| f64::from(u8::from(at % width == at / width)));
    let table = TargetTable::new(width, members.collect()).expect("classes");
    let class = |_: usize, frame: &Frame, at: usize| {
        arms[usize::from(frame.labels.pixels[at])].map_or(0, |arm| arm as u16 + 1)
    };
    let (trees, leaves) = grow(set, &features, 1500, 1500, table, &class, &spec);
    SegmentationForest::new(features, classes, trees, leaves).expect("a forest")
}

/// The valid pixels of every `step`-th row and column.
fn positions(depth: &DepthImage, padded: &PaddedDepth, step: usize) -> Vec<u32> {
    let rows = (0..depth.height).step_by(step);
    let pixels = rows.flat_map(|y| (0..depth.width).step_by(step).map(move |x| (x, y)));
    let valid = pixels.filter(|&(x, y)| depth.pixels[y * depth.width + x] > 0);
    valid.map(|(x, y)| padded.position(x, y)).collect()
}

/// What [`find_leaves`] finds, one pixel after the other.
fn one_by_one(trees: &[Tree], image: &FeaturesOnImage, positions: &[u32]) -> Vec<u32> {
    let leaf = |tree: &Tree, position: u32| {
        let mut node = tree.nodes()[0];
        while node.feature != LEAF {
            let right = image.value(node.feature.into(), position) > node.threshold;
            node = tree.nodes()[node.child as usize + usize::from(right)];
        }
        node.child
    };
    let of_tree = |tree| positions.iter().map(move |&position| leaf(tree, position));
    trees.iter().flat_map(of_tree).collect()
}

fn benches(criterion: &mut Criterion) {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("estimation");
    let set = data_set(&folder.join("set"));
    let (pose_model, segmentation_model) = (folder.join("pose"), folder.join("segmentation"));
    let pose = PoseForest::load(&pose_model).unwrap_or_else(|_| {
        let forest = pose_forest(&set);
        forest.save(&pose_model).expect("a model");
        forest
    });
    let segmentation = SegmentationForest::load(&segmentation_model).unwrap_or_else(|_| {
        let forest = segmentation_forest(&set);
        forest.save(&segmentation_model).expect("a model");
        forest
    });
    let depth = set.frame(IMAGES - 1).expect("an image").depth;
    let threads = |count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
        pool.expect("threads")
    };
    let (one, two) = (threads(1), threads(2));
    let mut group = criterion.benchmark_group("estimation");
    group.sampling_mode(SamplingMode::Flat).sample_size(10);

    // Elements are pixels times trees.
    for (name, features, trees) in [
        ("PEF", pose.features(), pose.trees()),
        ("SF", segmentation.features(), segmentation.trees()),
    ] {
        let (leaves, depths) = (trees[0].leaves(), trees[0].depth());
        println!("{name}: {leaves} leaves and {depths} levels in the first tree");
        let padded = PaddedDepth::new(&depth, features.reach());
        let image = features.on(&padded);
        for step in [1, 2] {
            let positions = positions(&depth, &padded, step);
            group.throughput(Throughput::Elements((positions.len() * TREES) as u64));
            group.bench_function(format!("{name}, step {step}, one core"), |b| {
                b.iter(|| one.install(|| black_box(find_leaves(trees, &image, &positions))))
            });
            group.bench_function(format!("{name}, step {step}, one by one, one core"), |b| {
                b.iter(|| one.install(|| black_box(one_by_one(trees, &image, &positions))))
            });
        }
    }

    group.throughput(Throughput::Elements(1));
    for step in [1, 2] {
        let name = format!("SF and PEF at all valid pixels, step {step}, two cores");
        let estimate = || {
            let padded = PaddedDepth::new(&depth, segmentation.features().reach());
            let pixels = positions(&depth, &padded, step);
            black_box(segmentation.shares(&segmentation.features().on(&padded), &pixels));
            let padded = PaddedDepth::new(&depth, pose.features().reach());
            let pixels = positions(&depth, &padded, step);
            let leaves = pose.find_leaves(&pose.features().on(&padded), &pixels);
            combine(&pose, &leaves, &vec![true; pixels.len()])
        };
        group.bench_function(name, |b| b.iter(|| two.install(|| black_box(estimate()))));
        let arm = set.target() + 1;
        let estimate = || {
            let classes = segment(&segmentation, &depth, arm, step).classes;
            let of_arm = masked(&depth, |at| usize::from(classes.pixels[at]) == arm);
            let padded = PaddedDepth::every(step, &of_arm, pose.features().reach());
            Look::new(&pose, &of_arm, &padded, step).estimate(|_| true)
        };
        let name = format!("segmenting, then estimating what is left, step {step}, two cores");
        group.bench_function(name, |b| b.iter(|| two.install(|| black_box(estimate()))));
    }
    group.bench_function("load the pose forest, two cores", |b| {
        b.iter(|| two.install(|| PoseForest::load(&pose_model).expect("a model")))
    });
}

criterion_group!(estimation, benches);
criterion_main!(estimation);
