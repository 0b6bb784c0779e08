//! From the data set to the image estimate: what a forest has seen, it must know.

use armpose::dataset::{DataSet, SetSpec};
use armpose::estimator::error::{mean_angle_error, mean_pose};
use armpose::experiment::task::Task;
use armpose::experiment::tasks::data_set::DataSetTask;
use armpose::experiment::tasks::estimates::EstimatesTask;
use armpose::experiment::tasks::pose_forest::{PoseForestTask, Training};
use armpose::feature::FeatureSpec;
use armpose::forest::grow::GrowSpec;
use armpose::forest::objective::ObjectiveKind;
use std::path::Path;
use std::sync::Arc;

const IMAGES: usize = 12;

#[test]
fn a_forest_knows_the_images_it_was_trained_on() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut spec = SetSpec::read(&root.join("data/sets/pef.toml")).unwrap();
    spec.images = IMAGES;
    let set = Arc::new(DataSetTask { spec, seed: 5 });
    let forest = Arc::new(PoseForestTask {
        set: set.clone(),
        images: (0..IMAGES).collect(),
        objective: ObjectiveKind::named("mse").unwrap(),
        training: Training {
            foreground: 2000,
            background: 1000,
            features: FeatureSpec {
                count: 200,
                window: 200,
            },
            forest: GrowSpec {
                trees: 5,
                min_leaf: 60,
                features_per_node: 60,
                max_depth: None,
                bootstrap: true,
            },
        },
        fold: 0,
    });
    // The constructor refuses images that the forest has seen; here they are wanted.
    assert!(EstimatesTask::new(forest.clone(), vec![3], 1.0, 5, 1).is_err());
    let estimates = EstimatesTask {
        forest: forest.clone(),
        images: (0..IMAGES).collect(),
        sigma: 1.0,
        trees: 5,
        stride: 1,
    };

    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(&path).unwrap();
        path
    };
    let (images, model, out) = (at("set"), at("forest"), at("estimates"));
    let quiet = |_| ();
    set.run(&[], &images, &quiet).unwrap();
    forest
        .run(std::slice::from_ref(&images), &model, &quiet)
        .unwrap();
    estimates
        .run(&[model, images.clone()], &out, &quiet)
        .unwrap();

    let set = DataSet::open(&images).unwrap();
    let constant = mean_pose((0..IMAGES).map(|image| set.pose(image)));
    let mut ratios = Vec::new();
    for estimated in EstimatesTask::read(&out).unwrap() {
        let truth = set.pose(estimated.image);
        let error = |step: usize| {
            mean_angle_error(truth, &estimated.estimate.thresholds[step].pose).to_degrees()
        };
        let floor = mean_angle_error(truth, &constant).to_degrees();
        println!(
            "image {}: {:.1} deg at t_r = 0, {:.1} at 0.9; constant pose {floor:.1}",
            estimated.image,
            error(0),
            error(90)
        );
        ratios.push(error(90) / floor);
    }
    // An image that hardly shows the arm may look like another one.
    ratios.sort_by(f64::total_cmp);
    assert!(ratios[3 * IMAGES / 4] < 0.25, "{ratios:?}");
}
