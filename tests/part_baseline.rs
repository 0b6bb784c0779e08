//! The part-classification baseline.

use armpose::dataset::DataSet;
use armpose::estimator::part_baseline::parts::{PartSpec, Parts, read_parts};
use armpose::experiment::task::Task;
use armpose::experiment::tasks::data_set::DataSetTask;
use std::path::Path;

/// The declared parts divide the pixels of the arms among them and take no other; and files that do not
/// are refused.
#[test]
fn parts_are_a_partition_of_the_arms() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let task = DataSetTask::new(root, "pef", 1, 7).unwrap();
    let folder = tempfile::tempdir().unwrap();
    task.run(&[], folder.path(), &|_| ()).unwrap();
    let set = DataSet::open(folder.path()).unwrap();
    let specs = read_parts(&root.join("data/baselines/arm-parts.toml")).unwrap();
    let parts = Parts::new(&specs, set.record()).unwrap();
    assert_eq!(parts.classes.len(), 1 + specs.len());
    let arms = set.arm_of_label();
    for label in 0..256 {
        let class = usize::from(parts.of_label[label]);
        assert_eq!(class > 0, arms[label].is_some());
        assert_eq!(
            parts.classes[class].votes,
            arms[label] == Some(set.target())
        );
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
