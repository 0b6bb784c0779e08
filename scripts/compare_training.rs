//! Our side of `compare_sklearn.py`, which calls it:
//!
//! - `compare_training export DIR` draws the samples of the paper's first fold and of its test images, and
//!   writes `train` and `test`: `.x`, the features as 16-bit integers, one feature after the other;
//!   `.y`, the joint angles of each sample in rad as 64-bit floats. Both little-endian.
//! - `compare_training train DIR FEATURES_PER_NODE SEED` reads them, trains two trees on two threads,
//!   binning included, and prints the seconds it took, the error of all joints on `test` in degrees (root
//!   of the mean square), and how many leaves the trees have.

use anyhow::{Context, Result, bail};
use armpose::dataset::{DataSet, SetSpec, folds, generate, sample_pixels};
use armpose::feature::{DepthFeatures, Extra, FeatureSpec, PaddedDepth, SampleMatrix};
use armpose::forest::bins::BinnedMatrix;
use armpose::forest::grow::{GrowSpec, TargetTable};
use armpose::forest::leaves::grow_means;
use armpose::forest::objective::mse::mse;
use armpose::forest::tree::{LEAF, Tree};
use armpose::random::stream;
use std::convert::Infallible;
use std::fs;
use std::path::Path;
use std::time::Instant;

const FEATURES: FeatureSpec = FeatureSpec {
    count: 500,
    window: 200,
};
/// Pixels of the arms and of the rest, for each image.
const TRAIN: [usize; 2] = [2000, 1000];
const TEST: [usize; 2] = [200, 100];
const JOINTS: usize = 15;
/// With this there are as many leaves as with scikit-learn's 5: it counts a sample once, we as often as
/// the bootstrap drew it.
const MIN_LEAF: u32 = 7;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["export", folder] => export(Path::new(folder)),
        ["train", folder, features_per_node, seed] => train(
            Path::new(folder),
            features_per_node.parse().context("FEATURES_PER_NODE")?,
            seed.parse().context("SEED")?,
        ),
        _ => bail!("compare_training export DIR | train DIR FEATURES_PER_NODE SEED"),
    }
}

fn export(folder: &Path) -> Result<()> {
    let sets = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/sets");
    let spec = SetSpec::read(&sets.join("pef.toml"))?;
    let images = folder.join("images");
    let set = match DataSet::open(&images) {
        Ok(set) => set,
        Err(_) => generate(&spec, 1, &images, &|_| ())?,
    };
    let test = &folds(set.len(), 5, 1)[0];
    let train: Vec<usize> = (0..set.len()).filter(|i| !test.contains(i)).collect();
    write(&set, &train, TRAIN, &folder.join("train"))?;
    write(&set, test, TEST, &folder.join("test"))
}

fn write(set: &DataSet, images: &[usize], pixels: [usize; 2], path: &Path) -> Result<()> {
    let features = DepthFeatures::draw(&FEATURES, Extra::Nothing, &mut stream(1, "features", &[]))?;
    let arms = set.arm_of_label();
    let matrix = SampleMatrix::fill(
        features.count(),
        &vec![pixels[0] + pixels[1]; images.len()],
        |row, columns| {
            let frame = set.frame(images[row])?;
            let mut random = stream(1, "pixels", &[images[row] as u64]);
            let drawn = sample_pixels(&frame, &arms, pixels[0], pixels[1], &mut random)
                .context("an image has too few pixels")?;
            let padded = PaddedDepth::new(&frame.depth, features.reach());
            let position = |&(x, y): &(u16, u16)| padded.position(x.into(), y.into());
            let positions: Vec<u32> = drawn.iter().map(position).collect();
            features.fill(&padded, &positions, columns);
            anyhow::Ok(())
        },
    )?;
    let x: Vec<u8> = matrix
        .columns()
        .flatten()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let poses = images.iter().map(|&image| set.pose(image));
    let y: Vec<u8> = poses
        .flat_map(|pose| vec![pose; pixels[0] + pixels[1]])
        .flatten()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    fs::write(path.with_extension("x"), x)?;
    fs::write(path.with_extension("y"), y)?;
    Ok(())
}

/// The features, column by column, and the poses, row by row.
fn read(path: &Path) -> Result<(SampleMatrix, Vec<f64>)> {
    let bytes = fs::read(path.with_extension("x"))?;
    let (values, _) = bytes.as_chunks::<2>();
    let samples = values.len() / FEATURES.count;
    let fill = |_, columns: &mut [&mut [i16]]| {
        for (column, values) in columns.iter_mut().zip(values.chunks(samples)) {
            for (to, &from) in column.iter_mut().zip(values) {
                *to = i16::from_le_bytes(from);
            }
        }
        Ok::<(), Infallible>(())
    };
    let Ok(matrix) = SampleMatrix::fill(FEATURES.count, &[samples], fill);
    let bytes = fs::read(path.with_extension("y"))?;
    let (values, _) = bytes.as_chunks::<8>();
    Ok((
        matrix,
        values.iter().map(|&v| f64::from_le_bytes(v)).collect(),
    ))
}

fn train(folder: &Path, features_per_node: usize, seed: u64) -> Result<()> {
    let (x, y) = read(&folder.join("train"))?;
    let (test_x, test_y) = read(&folder.join("test"))?;
    let spec = GrowSpec {
        trees: 2,
        min_leaf: MIN_LEAF,
        features_per_node,
        max_depth: None,
        bootstrap: true,
    };
    let threads = rayon::ThreadPoolBuilder::new().num_threads(2).build()?;
    let clock = Instant::now();
    let (trees, leaves) = threads.install(|| {
        // As scikit-learn is, we are given a pose for each sample; those of an image are the same.
        let mut poses: Vec<f64> = Vec::new();
        let mut targets: Vec<u16> = Vec::new();
        for pose in y.chunks(JOINTS) {
            if poses.is_empty() || poses[poses.len() - JOINTS..] != *pose {
                poses.extend(pose);
            }
            targets.push((poses.len() / JOINTS - 1) as u16);
        }
        let table = TargetTable::new(JOINTS, poses)?;
        let binned = BinnedMatrix::new(&x)?;
        grow_means(
            &binned,
            &targets,
            &table,
            &*mse(&table)?,
            &spec,
            seed,
            &|_| (),
        )
    })?;
    let seconds = clock.elapsed().as_secs_f64();

    let columns: Vec<&[i16]> = test_x.columns().collect();
    let leaf = |tree: &Tree, sample: usize| {
        let mut node = tree.nodes()[0];
        while node.feature != LEAF {
            let right = columns[usize::from(node.feature)][sample] > node.threshold;
            node = tree.nodes()[node.child as usize + usize::from(right)];
        }
        node.child as usize
    };
    let mut squares = 0.0;
    for (sample, pose) in test_y.chunks(JOINTS).enumerate() {
        for (joint, angle) in pose.iter().enumerate() {
            let of_tree = trees.iter().zip(&leaves);
            let sum: f64 = of_tree
                .map(|(tree, means)| f64::from(means.row(leaf(tree, sample))[joint]))
                .sum();
            squares += (sum / trees.len() as f64 - angle).powi(2);
        }
    }
    let error = (squares / test_y.len() as f64).sqrt().to_degrees();
    let leaves: usize = trees.iter().map(Tree::leaves).sum();
    println!("{seconds},{error},{leaves}");
    Ok(())
}
