//! The part-classification baseline, from the data set to the joints.

use armpose::dataset::DataSet;
use armpose::estimator::error::angle_error;
use armpose::estimator::part_baseline::BaselineSpec;
use armpose::estimator::part_baseline::joints::joint_points;
use armpose::estimator::part_baseline::parts::{PartSpec, Parts, read_parts};
use armpose::estimator::part_baseline::votes::FoundJoint;
use armpose::experiment::task::Task;
use armpose::experiment::tasks::data_set::DataSetTask;
use armpose::experiment::tasks::part_estimates::{PartEstimated, PartEstimatesTask, Voting};
use armpose::experiment::tasks::part_forest::PartForestTask;
use armpose::experiment::tasks::pose_forest::{FOREST_FILE, PoseForestTask};
use armpose::experiment::tasks::sight::Sight;
use armpose::feature::FeatureSpec;
use armpose::forest::objective::ObjectiveKind;
use armpose::forest::part_forest::PartForest;
use armpose::forest::pose_forest::PoseForest;
use armpose::training::Training;
use std::path::Path;
use std::sync::Arc;

const IMAGES: usize = 14;
const TRAINING: usize = 10;

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// How far from the truth joints were found, in millimetres.
fn joint_errors(images: &[PartEstimated]) -> Vec<f64> {
    let pairs = images
        .iter()
        .flat_map(|image| image.truth.iter().zip(&image.found));
    let error = |(truth, found): (&[f64; 3], &Option<FoundJoint>)| {
        let at = found.as_ref()?.at;
        let squares = (0..3).map(|axis| (truth[axis] - at[axis]).powi(2));
        Some(1000.0 * squares.sum::<f64>().sqrt())
    };
    pairs.filter_map(error).collect()
}

/// On images that the forest has seen it finds the joints; on others it knows parts better than
/// chance; and with true parts and votes everything is exact.
#[test]
fn parts_joints_and_pose_from_forest_and_oracle() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let set_task = Arc::new(DataSetTask::new(root, "pef", IMAGES, 7).unwrap());
    let mut baseline = BaselineSpec::read(&root.join("data/baselines/literature.toml")).unwrap();
    baseline.forest.min_leaf = 4;
    baseline.forest.features_per_node = 20;
    let samples = PoseForestTask {
        set: set_task.clone(),
        images: (0..TRAINING).collect(),
        objective: ObjectiveKind::named("mse").unwrap(),
        training: Training {
            foreground: 1200,
            background: 600,
            features: FeatureSpec {
                count: 100,
                window: 200,
            },
            forest: baseline.forest,
        },
        sight: Sight::WHOLE,
        fold: 0,
    };
    let forest = Arc::new(PartForestTask {
        samples: Arc::new(samples),
        baseline: baseline.clone(),
    });
    let estimates = |images: Vec<usize>, voting| {
        PartEstimatesTask::new(forest.clone(), set_task.clone(), images, voting, 2)
    };
    let refused = estimates(vec![3], Voting::Forest)
        .err()
        .unwrap()
        .to_string();
    assert!(
        refused.contains("image 3 of set pef is in the training"),
        "{refused}"
    );

    let folder = tempfile::tempdir().unwrap();
    let run = |task: &dyn Task, inputs: &[&str], name: &str| {
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at(name)).unwrap();
        let inputs: Vec<_> = inputs.iter().map(|name| at(name)).collect();
        task.run(&inputs, &at(name), &|_| ()).unwrap();
        at(name)
    };
    let set_folder = run(&*set_task, &[], "set");
    let forest_folder = run(&*forest, &["set"], "forest");
    let set = DataSet::open(&set_folder).unwrap();
    let unseen = estimates((TRAINING..IMAGES).collect(), Voting::Forest).unwrap();
    let out = run(&unseen, &["set", "set", "forest"], "unseen");
    let unseen = PartEstimatesTask::read(&out).unwrap();
    let oracle = estimates((TRAINING..IMAGES).collect(), Voting::Oracle).unwrap();
    let out = run(&oracle, &["set", "set"], "oracle");
    let oracle = PartEstimatesTask::read(&out).unwrap();
    // The constructor refuses images that the forest has seen; here they are wanted.
    let seen = PartEstimatesTask {
        forest: forest.clone(),
        set: set_task.clone(),
        images: (0..TRAINING).collect(),
        voting: Voting::Forest,
        stride: 2,
    };
    let seen = PartEstimatesTask::read(&run(&seen, &["set", "set", "forest"], "seen")).unwrap();

    // The model file brings the forest back, and nothing else.
    let path = forest_folder.join(FOREST_FILE);
    let model = PartForest::load(&path).unwrap();
    assert_eq!(model.classes(), unseen.classes);
    assert_eq!(model.joints(), unseen.joints);
    assert_eq!(model.votes_per_joint(), baseline.leaves.modes);
    let copy = folder.path().join("copy.bin");
    model.save(&copy).unwrap();
    assert_eq!(std::fs::read(&copy).unwrap(), std::fs::read(&path).unwrap());
    let other = PoseForest::load(&path).unwrap_err().to_string();
    assert!(
        other.contains("its header is for something else"),
        "{other}"
    );

    // Leaves: shares sum to 1, votes weigh no more than the arm's share and fall.
    for (tree, nodes) in model.trees().iter().enumerate() {
        for leaf in 0..nodes.leaves() {
            for joint in 0..model.joints().len() {
                let votes = model.votes(tree, leaf, joint);
                assert!(
                    votes
                        .iter()
                        .all(|&[.., weight]| (0.0..=1.0).contains(&weight))
                );
                assert!(votes.is_sorted_by(|a, b| a[3] >= b[3]));
            }
        }
    }

    let (rig, arm) = set_task.rig().unwrap();
    let points = joint_points(&rig, arm);
    assert_eq!(points.len(), unseen.joints.len());

    // f1 of a guess that gives each class as often as it occurs is the class' share of the pixels.
    let mut sum = unseen.images[0].confusion.clone();
    unseen.images[1..]
        .iter()
        .for_each(|image| sum.add(&image.confusion));
    let all: usize = sum.0.iter().flatten().sum();
    let (mut f1, mut chance) = (0.0, 0.0);
    for class in 1..unseen.classes.len() {
        if sum.pixels(class) > 0 {
            f1 += sum.f1(class);
            chance += sum.pixels(class) as f64 / all as f64;
        }
    }
    println!("parts on unseen images: f1 {f1:.2}, chance {chance:.2} (sums over parts)");
    assert!(f1 > 5.0 * chance);

    let (known, new) = (joint_errors(&seen.images), joint_errors(&unseen.images));
    println!(
        "joints: {:.1} mm on seen, {:.1} mm on unseen images",
        median(known.clone()),
        median(new)
    );
    assert!(median(known) < 40.0);

    // The oracle: no pixel is wrong, every joint within reach of a vote is found where it is, and what
    // the points tell of the pose is right.
    let mut errors = Vec::new();
    for estimated in &oracle.images {
        for (truth, row) in estimated.confusion.0.iter().enumerate() {
            assert!(
                row.iter()
                    .enumerate()
                    .all(|(given, &n)| given == truth || n == 0)
            );
        }
        let truth = set.pose(estimated.image);
        for ((&truth, &pose), &observed) in
            truth.iter().zip(&estimated.pose).zip(&estimated.observed)
        {
            if observed {
                errors.push(angle_error(truth, pose).to_degrees());
            }
        }
    }
    let exact = joint_errors(&oracle.images);
    println!(
        "oracle: {} joints found, {} angles observed, median {:.5} deg",
        exact.len(),
        errors.len(),
        median(errors.clone())
    );
    assert!(exact.iter().all(|&mm| mm < 0.01), "{exact:?}");
    assert!(errors.len() > 30 && median(errors) < 1.0);
}

/// The declared parts divide the pixels of the arms among them and take no other; and files that do not
/// are refused.
#[test]
fn parts_are_a_partition_of_the_arms() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let task = DataSetTask::new(root, "pef", 1, 7).unwrap();
    let folder = tempfile::tempdir().unwrap();
    task.run(&[], folder.path(), &|_| ()).unwrap();
    let set = DataSet::open(folder.path()).unwrap();
    let baselines = root.join("data/baselines");
    let specs = read_parts(&baselines.join("arm-parts.toml")).unwrap();
    for preset in ["literature.toml", "tuned.toml"] {
        let baseline = BaselineSpec::read(&baselines.join(preset)).unwrap();
        assert_eq!(baseline.parts, specs);
    }
    let parts = Parts::new(&specs, set.record()).unwrap();
    assert_eq!(parts.classes.len(), 1 + specs.len());
    let arms = set.arm_of_label();
    for (class, arm) in parts.of_label.iter().zip(arms) {
        let class = usize::from(*class);
        assert_eq!(class > 0, arm.is_some());
        assert_eq!(parts.classes[class].votes, arm == Some(set.target()));
    }
    for class in 1..parts.classes.len() {
        assert!(parts.of_label.iter().any(|&c| usize::from(c) == class));
    }

    let fault = |change: &dyn Fn(&mut Vec<PartSpec>)| {
        let mut specs = specs.clone();
        change(&mut specs);
        Parts::new(&specs, set.record()).unwrap_err().to_string()
    };
    let missing = fault(&|specs| specs[1].links.clear());
    assert_eq!(
        missing,
        "link \"R_UPPER_ARM\" of the right arm is in 0 parts; it must be in one"
    );
    let twice = fault(&|specs| specs[0].links.push("R_UPPER_ARM".to_owned()));
    assert!(twice.contains("is in 2 parts"), "{twice}");
    let unknown = fault(&|specs| specs[0].links.push("L_HAND".to_owned()));
    assert_eq!(
        unknown,
        "part \"shoulder\": the right arm has no link \"L_HAND\""
    );
}
