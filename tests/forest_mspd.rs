//! MSPD held against its definition, eq. 6, and against MSE where the two are one.

use armpose::distances::DistanceMatrix;
use armpose::feature::SampleMatrix;
use armpose::forest::bins::BinnedMatrix;
use armpose::forest::grow::{GrowSpec, Member, TargetTable};
use armpose::forest::leaves::{LeafTable, grow_means};
use armpose::forest::objective::mspd_few::mspd_few;
use armpose::forest::objective::mspd_published::mspd_published;
use armpose::forest::objective::{Cut, Objective, mse::mse, mspd::mspd};
use armpose::forest::tree::Tree;
use armpose::random::{Stream, below, normal, stream, unit};

/// Symmetric and otherwise anything: no triangle inequality, and some things lie at one place.
fn distances(random: &mut Stream, count: usize) -> DistanceMatrix {
    let table: Vec<f64> = (0..count * count)
        .map(|_| match below(random, 9) {
            0 => 0.0,
            _ => 2.0 * unit(random),
        })
        .collect();
    DistanceMatrix::new(count, |a, b| table[a * count + b])
}

/// Eq. 6, sample by sample.
fn mean_squared_distance(distances: &DistanceMatrix, members: &[&Member]) -> f64 {
    let n: f64 = members.iter().map(|m| f64::from(m.weight)).sum();
    if n <= 1.0 {
        return 0.0;
    }
    let mut sum = 0.0;
    for a in members {
        for b in members {
            let d = distances.get(a.target.into(), b.target.into());
            sum += f64::from(a.weight) * f64::from(b.weight) * d * d;
        }
    }
    sum / (n * n - n)
}

/// The negative of eq. 1 for all cuts that leave `min_leaf` on both sides, ascending.
fn all_cuts(
    distances: &DistanceMatrix,
    members: &[Member],
    codes: &[u8],
    min_leaf: f64,
) -> Vec<Cut> {
    let mut bins = codes.to_vec();
    bins.sort_unstable();
    bins.dedup();
    let mut cuts = Vec::new();
    for pair in bins.windows(2) {
        let (left, right): (Vec<_>, Vec<_>) = members
            .iter()
            .zip(codes)
            .partition(|&(_, &code)| code <= pair[0]);
        let part = |side: Vec<(&Member, &u8)>| {
            let side: Vec<&Member> = side.into_iter().map(|(m, _)| m).collect();
            let n: f64 = side.iter().map(|m| f64::from(m.weight)).sum();
            (n, n * mean_squared_distance(distances, &side))
        };
        let (left, right) = (part(left), part(right));
        if left.0 >= min_leaf && right.0 >= min_leaf {
            cuts.push(Cut {
                left: pair[0],
                right: pair[1],
                score: -(left.1 + right.1) / (left.0 + right.0),
            });
        }
    }
    cuts
}

/// Samples of a node, ascending, with the targets in runs as images have them, or in any order.
fn node(random: &mut Stream, count: usize, targets: usize, runs: bool) -> Vec<Member> {
    let mut drawn: Vec<u16> = (0..count).map(|_| below(random, targets) as u16).collect();
    if runs {
        drawn.sort_unstable();
    }
    let member = |(sample, target)| Member {
        sample,
        target,
        weight: 1 + below(random, 3) as u16,
    };
    (0..).zip(drawn).map(member).collect()
}

/// Both forms against eq. 6, at nodes of few and many samples, targets and bins.
#[test]
fn the_best_cut_is_the_best_of_all() {
    for (case, (count, targets, bins)) in [
        (2, 2, 2),
        (3, 5, 4),
        (9, 4, 200),
        (12, 40, 6),
        (40, 3, 9),
        (60, 200, 256),
        (150, 20, 30),
        (250, 70, 100),
        (400, 9, 256),
        (500, 200, 5),
        (900, 40, 12),
        (1500, 130, 3),
    ]
    .into_iter()
    .enumerate()
    {
        for turn in 0..4 {
            let random = &mut stream(1, "cuts", &[case as u64, turn]);
            let distances = distances(random, targets);
            let members = node(random, count, targets, turn % 2 == 0);
            let codes: Vec<u8> = (0..count).map(|_| below(random, bins) as u8).collect();
            let min_leaf = 1 + below(random, 4) as u32;
            let cuts = all_cuts(&distances, &members, &codes, f64::from(min_leaf));
            let best = cuts
                .iter()
                .map(|cut| cut.score)
                .fold(f64::NEG_INFINITY, f64::max);
            for objective in [
                mspd(&distances).unwrap(),
                mspd_published(&distances).unwrap(),
            ] {
                let mut scan = objective.scan(3);
                if !scan.enter(&members) {
                    let all: Vec<&Member> = members.iter().collect();
                    assert!(mean_squared_distance(&distances, &all) < 1e-9);
                    continue;
                }
                let found = scan.best_cut(&members, &codes, min_leaf);
                let Some(found) = found else {
                    assert!(cuts.is_empty());
                    continue;
                };
                let same = |cut: &&Cut| (cut.left, cut.right) == (found.left, found.right);
                let cut = cuts.iter().find(same).unwrap();
                let scale = best.abs().max(1e-3);
                assert!(
                    (cut.score - found.score).abs() <= 1e-9 * scale,
                    "{cut:?} {found:?}"
                );
                assert!(
                    best - cut.score <= 1e-9 * scale,
                    "{cut:?} is not the best, {best}"
                );
            }
        }
    }
}

/// What both forms found at one node after the other, in the same scan: nothing is left behind.
#[test]
fn both_forms_agree_to_the_last_bit() {
    let random = &mut stream(2, "forms", &[]);
    let distances = distances(random, 180);
    let (fast, published) = (
        mspd(&distances).unwrap(),
        mspd_published(&distances).unwrap(),
    );
    let (mut fast, mut published) = (fast.scan(3), published.scan(3));
    for (count, targets) in [
        (700, 180),
        (30, 180),
        (2500, 60),
        (5, 2),
        (20, 7),
        (3000, 170),
    ] {
        let members = node(random, count, targets, true);
        assert_eq!(fast.enter(&members), published.enter(&members));
        for bins in [3, 250, 40] {
            let codes: Vec<u8> = (0..count).map(|_| below(random, bins) as u8).collect();
            let cut = fast.best_cut(&members, &codes, 5);
            assert_eq!(cut, published.best_cut(&members, &codes, 5));
        }
    }
}

const SPEC: GrowSpec = GrowSpec {
    trees: 2,
    min_leaf: 3,
    features_per_node: 5,
    max_depth: None,
    bootstrap: true,
};

/// Values that tell a little of the target and differ within it; two of the columns are each
/// other's mirror image, so that their splits tie.
fn grow(
    table: &TargetTable,
    per_target: usize,
    objective: &dyn Objective,
    spec: &GrowSpec,
) -> (Vec<Tree>, Vec<LeafTable>) {
    let samples = table.targets() * per_target;
    let matrix = SampleMatrix::fill(12, &[samples], |_, columns| {
        let mut random = stream(3, "values", &[]);
        for sample in 0..samples {
            let y = table.row(sample / per_target);
            for (feature, column) in columns.iter_mut().enumerate().skip(1) {
                let told = y[feature % y.len()] + y[(feature + 1) % y.len()];
                column[sample] = (30.0 * (told + 2.0 * normal(&mut random))) as i16;
            }
            columns[0][sample] = -columns[1][sample];
        }
        Ok::<(), ()>(())
    });
    let data = BinnedMatrix::new(&matrix.unwrap()).unwrap();
    let targets: Vec<u16> = (0..samples).map(|s| (s / per_target) as u16).collect();
    grow_means(&data, &targets, table, objective, spec, 4, &|_| ()).unwrap()
}

fn table(seed: u64, targets: usize, width: usize) -> TargetTable {
    let mut random = stream(seed, "table", &[]);
    let values = (0..targets * width).map(|_| normal(&mut random));
    TargetTable::new(width, values.collect()).unwrap()
}

fn euclidean(table: &TargetTable) -> DistanceMatrix {
    let rows: Vec<f64> = (0..table.targets())
        .flat_map(|t| table.row(t))
        .copied()
        .collect();
    DistanceMatrix::euclidean(&rows, table.width())
}

#[test]
fn both_forms_grow_the_same_trees() {
    let table = table(5, 50, 3);
    for distances in [
        euclidean(&table),
        distances(&mut stream(5, "distances", &[]), 50),
    ] {
        let fast = grow(&table, 40, &*mspd(&distances).unwrap(), &SPEC);
        assert_eq!(
            fast,
            grow(&table, 40, &*mspd_published(&distances).unwrap(), &SPEC)
        );
        assert!(fast.0[0].leaves() > 100);
    }
}

/// D = |y_a - y_b|: H_MSPD = 2 k n / (n - 1) H_MSE.
#[test]
fn euclidean_distances_make_it_the_variance() {
    let table = table(6, 30, 4);
    let distances = euclidean(&table);
    let (mspd, mse) = (mspd(&distances).unwrap(), mse(&table).unwrap());
    let random = &mut stream(6, "nodes", &[]);
    for count in [1, 2, 5, 30, 400] {
        let members = node(random, count, 30, false);
        let n: f64 = members.iter().map(|m| f64::from(m.weight)).sum();
        let expected = match n {
            1.0 => 0.0,
            n => 8.0 * n / (n - 1.0) * mse.impurity(&members),
        };
        let h = mspd.impurity(&members);
        assert!((h - expected).abs() <= 1e-9 * expected, "{h} {expected}");
        let all: Vec<&Member> = members.iter().collect();
        assert!((h - mean_squared_distance(&distances, &all)).abs() <= 1e-12 * h);
    }
}

/// Poses of a planar arm of five bars, at distances as DISP has them: the largest way that a joint
/// goes. No points in a space lie so.
fn arm_distances(random: &mut Stream, count: usize) -> DistanceMatrix {
    let poses: Vec<Vec<[f64; 2]>> = (0..count)
        .map(|_| {
            let (mut at, mut heading) = ([0.0; 2], 0.0);
            (0..5)
                .map(|_| {
                    heading += 1.6 * unit(random) - 0.8;
                    at = [at[0] + f64::cos(heading), at[1] + f64::sin(heading)];
                    at
                })
                .collect()
        })
        .collect();
    DistanceMatrix::new(count, |a, b| {
        let ways = poses[a].iter().zip(&poses[b]);
        let ways = ways.map(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]));
        ways.fold(0.0, f64::max)
    })
}

/// Fourteen signed dimensions choose the exact form's cut or one hardly worse.
#[test]
fn few_dimensions_choose_much_the_same_cuts() {
    let random = &mut stream(8, "few", &[]);
    let distances = arm_distances(random, 120);
    let (exact, few) = (mspd(&distances).unwrap(), mspd_few(&distances).unwrap());
    let (mut exact_scan, mut few_scan) = (exact.scan(3), few.scan(3));
    let (mut same, mut cuts) = (0, 0);
    for turn in 0..300 {
        let poses = 4 + below(random, 117);
        let members = node(random, 20 + 5 * turn, poses, true);
        assert_eq!(exact.impurity(&members), few.impurity(&members));
        assert!(exact_scan.enter(&members) && few_scan.enter(&members));
        // Bins tell how far a pose is from some other one, and not much.
        let pole = below(random, 120);
        let code = |m: &Member| {
            let told = distances.get(m.target.into(), pole);
            (20.0 * (told + 1.5 * unit(random))) as u8
        };
        let codes: Vec<u8> = members.iter().map(code).collect();
        let best = exact_scan.best_cut(&members, &codes, 5).unwrap();
        let other = few_scan.best_cut(&members, &codes, 5).unwrap();
        same += usize::from(best.left == other.left);
        cuts += 1;
        // What the exact form says of the other cut: there are two bins then.
        let sides: Vec<u8> = codes.iter().map(|&c| u8::from(c > other.left)).collect();
        let score = exact_scan.best_cut(&members, &sides, 1).unwrap().score;
        let gain = |score: f64| exact.impurity(&members) + score;
        assert!(gain(score) > 0.9 * gain(best.score));
    }
    assert!(5 * same > 4 * cuts, "{same} of {cuts}");
}

#[test]
fn distances_are_needed_for_every_target() {
    let table = table(7, 20, 2);
    let few = distances(&mut stream(7, "distances", &[]), 19);
    let objective = mspd(&few).unwrap();
    let data = SampleMatrix::fill(1, &[20], |_, columns| {
        (0..)
            .zip(&mut *columns[0])
            .for_each(|(i, value)| *value = i);
        Ok::<(), ()>(())
    });
    let data = BinnedMatrix::new(&data.unwrap()).unwrap();
    let targets: Vec<u16> = (0..20).collect();
    let grown = grow_means(&data, &targets, &table, &*objective, &SPEC, 1, &|_| ());
    assert!(grown.unwrap_err().to_string().contains("20 expected"));
    assert!(mspd(&DistanceMatrix::new(3, |_, _| f64::INFINITY)).is_err());
}
