//! Growing and predicting, held against slow and obvious versions of the same.

use armpose::camera::DepthImage;
use armpose::feature::{DepthFeatures, FeatureSpec, PaddedDepth, SampleMatrix};
use armpose::forest::bins::BinnedMatrix;
use armpose::forest::grow::{GrowSpec, TargetTable};
use armpose::forest::leaves::{LeafTable, grow_means};
use armpose::forest::objective::mse::mse;
use armpose::forest::tree::{LEAF, Tree};
use armpose::random::{Stream, below, normal, stream};

const ALL: GrowSpec = GrowSpec {
    trees: 1,
    min_leaf: 1,
    features_per_node: usize::MAX,
    max_depth: None,
    bootstrap: false,
};

/// Samples as rows of features, each with the row of its target.
#[derive(Clone)]
struct Samples {
    rows: Vec<Vec<i16>>,
    targets: Vec<u16>,
    table: TargetTable,
}

impl Samples {
    fn binned(&self) -> BinnedMatrix {
        let matrix = SampleMatrix::fill(self.rows[0].len(), &[self.rows.len()], |_, columns| {
            for (feature, column) in columns.iter_mut().enumerate() {
                for (value, row) in column.iter_mut().zip(&self.rows) {
                    *value = row[feature];
                }
            }
            Ok::<(), ()>(())
        });
        BinnedMatrix::new(&matrix.unwrap()).unwrap()
    }

    fn grow(&self, spec: &GrowSpec, seed: u64) -> (Vec<Tree>, Vec<LeafTable>) {
        let objective = mse(&self.table).unwrap();
        let (data, targets) = (self.binned(), &self.targets);
        grow_means(
            &data,
            targets,
            &self.table,
            &*objective,
            spec,
            seed,
            &|_| (),
        )
        .unwrap()
    }

    fn target(&self, sample: usize) -> &[f64] {
        self.table.row(usize::from(self.targets[sample]))
    }
}

/// Values that depend on the target, so that there is something to learn, of `levels` kinds.
fn samples(random: &mut Stream, count: usize, features: usize, levels: usize) -> Samples {
    let (targets, width) = (count.div_ceil(8), 3);
    let values = (0..targets * width).map(|_| below(random, 200) as f64 - 100.0);
    let table = TargetTable::new(width, values.collect()).unwrap();
    let targets: Vec<u16> = (0..count).map(|_| below(random, targets) as u16).collect();
    let value = |target: u16, feature: usize, random: &mut Stream| {
        let y = table.row(usize::from(target))[feature % width] + 40.0 * normal(random);
        (y * levels as f64 / 400.0).clamp(-5000.0, 5000.0) as i16
    };
    let row = |&target: &u16| (0..features).map(|f| value(target, f, random)).collect();
    let rows = targets.iter().map(row).collect();
    Samples {
        rows,
        targets,
        table,
    }
}

fn naive_leaf(tree: &Tree, row: &[i16]) -> u32 {
    let mut at = 0;
    loop {
        let node = tree.nodes()[at];
        if node.feature == LEAF {
            return node.child;
        }
        at = node.child as usize + usize::from(row[usize::from(node.feature)] > node.threshold);
    }
}

fn predict(grown: &(Vec<Tree>, Vec<LeafTable>), row: &[i16]) -> Vec<f64> {
    let mut mean = vec![0.0; grown.1[0].width()];
    for (tree, leaves) in grown.0.iter().zip(&grown.1) {
        let leaf = leaves.row(naive_leaf(tree, row) as usize);
        for (sum, &y) in mean.iter_mut().zip(leaf) {
            *sum += f64::from(y) / grown.0.len() as f64;
        }
    }
    mean
}

/// The sum of squared distances to the mean over the samples `members`.
fn scatter(samples: &Samples, members: &[usize]) -> f64 {
    let width = samples.table.width();
    let mean = |i: usize| {
        members.iter().map(|&s| samples.target(s)[i]).sum::<f64>() / members.len() as f64
    };
    let means: Vec<f64> = (0..width).map(mean).collect();
    let distance = |&s: &usize| -> f64 {
        let y = samples.target(s).iter().zip(&means);
        y.map(|(y, m)| (y - m).powi(2)).sum()
    };
    members.iter().map(distance).sum()
}

/// Follows the tree down and holds every node against all thresholds between all distinct values of
/// all features.
fn check_node(samples: &Samples, tree: &Tree, at: usize, members: &[usize], min_leaf: usize) {
    let parts = |feature: usize, threshold: i16| -> (Vec<usize>, Vec<usize>) {
        let left = |&s: &usize| samples.rows[s][feature] <= threshold;
        members.iter().partition(|s| left(s))
    };
    let total = scatter(samples, members);
    let mut best: Option<f64> = None;
    for feature in 0..samples.rows[0].len() {
        let mut values: Vec<i16> = members.iter().map(|&s| samples.rows[s][feature]).collect();
        values.sort_unstable();
        values.dedup();
        for pair in values.windows(2) {
            let (left, right) = parts(feature, pair[0]);
            if left.len() >= min_leaf && right.len() >= min_leaf {
                let rest = scatter(samples, &left) + scatter(samples, &right);
                best = Some(best.map_or(rest, |best| best.min(rest)));
            }
        }
    }
    let node = tree.nodes()[at];
    if node.feature == LEAF {
        assert!(total == 0.0 || best.is_none(), "a leaf that could be split");
        return;
    }
    let feature = usize::from(node.feature);
    let (left, right) = parts(feature, node.threshold);
    assert!(left.len() >= min_leaf && right.len() >= min_leaf);
    // Targets are rounded to 2^-15 of their range.
    let rest = scatter(samples, &left) + scatter(samples, &right);
    assert!(
        rest - best.unwrap() <= 1e-3 * total,
        "{rest} is not the least, {best:?}"
    );
    let below = left
        .iter()
        .map(|&s| i32::from(samples.rows[s][feature]))
        .max();
    let above = right
        .iter()
        .map(|&s| i32::from(samples.rows[s][feature]))
        .min();
    assert_eq!(
        i32::from(node.threshold),
        (below.unwrap() + above.unwrap()) >> 1
    );
    check_node(samples, tree, node.child as usize, &left, min_leaf);
    check_node(samples, tree, node.child as usize + 1, &right, min_leaf);
}

#[test]
fn every_split_is_the_best_of_all() {
    for seed in 0..20 {
        let random = &mut stream(seed, "exact", &[]);
        let data = samples(random, 150, 6, 20 + 10 * seed as usize);
        let min_leaf = 1 + seed as u32 % 5;
        let (trees, _) = data.grow(&GrowSpec { min_leaf, ..ALL }, seed);
        let everyone: Vec<usize> = (0..data.rows.len()).collect();
        check_node(&data, &trees[0], 0, &everyone, min_leaf as usize);
    }
}
