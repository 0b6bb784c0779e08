//! From the data set to the image estimate: what a forest has seen, it must know.

use armpose::dataset::{DataSet, SetSpec};
use armpose::estimator::error::{mean_angle_error, mean_pose};
use armpose::estimator::segmentation::LEAST_ARM_PIXELS;
use armpose::experiment::task::Task;
use armpose::experiment::tasks::data_set::DataSetTask;
use armpose::experiment::tasks::estimates::EstimatesTask;
use armpose::experiment::tasks::pose_forest::PoseForestTask;
use armpose::experiment::tasks::segmentation::{SegmentationTask, true_classes};
use armpose::experiment::tasks::segmentation_forest::SegmentationForestTask;
use armpose::experiment::tasks::sight::{SegmentationKind, Sight};
use armpose::feature::FeatureSpec;
use armpose::forest::grow::GrowSpec;
use armpose::forest::objective::ObjectiveKind;
use armpose::training::Training;
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
        sight: Sight::WHOLE,
        fold: 0,
    });
    // The constructor refuses images that the forest has seen; here they are wanted.
    assert!(EstimatesTask::new(forest.clone(), vec![3], 1.0, 5, 1).is_err());
    let estimates = EstimatesTask {
        forest: forest.clone(),
        set: set.clone(),
        sight: Sight::WHOLE,
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
    let constant = mean_pose((0..IMAGES).map(|image| set.pose(image)), set.circular());
    let mut ratios = Vec::new();
    for estimated in EstimatesTask::read(&out).unwrap() {
        let truth = set.pose(estimated.image);
        let estimate = estimated.estimate.unwrap();
        let error =
            |step: usize| mean_angle_error(truth, &estimate.thresholds[step].pose).to_degrees();
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

/// A segmentation forest on few images, segmented images, and pose forests that see nothing but one
/// arm: by the forest, by the truth, and with the arm's share as context.
#[test]
fn segmented_forests_see_one_arm_and_say_when_there_is_none() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let task = |name: &str, images| Arc::new(DataSetTask::new(root, name, images, 5).unwrap());
    let (sf, pef) = (task("sf", 10), task("pef", 8));
    let grow = GrowSpec {
        trees: 3,
        min_leaf: 1,
        features_per_node: 14,
        max_depth: None,
        bootstrap: true,
    };
    let training = Training {
        foreground: 300,
        background: 300,
        features: FeatureSpec {
            count: 40,
            window: 60,
        },
        forest: grow,
    };
    let forest = Arc::new(SegmentationForestTask {
        set: sf.clone(),
        training: training.clone(),
    });
    let refused = SegmentationTask::new(forest.clone(), sf.clone())
        .err()
        .unwrap();
    let refused = refused.to_string();
    assert!(
        refused.contains("set sf cannot be segmented: the segmentation forest was trained on them"),
        "{refused}"
    );
    let segmentation = Arc::new(SegmentationTask::new(forest.clone(), pef.clone()).unwrap());

    let folder = tempfile::tempdir().unwrap();
    let run = |task: &dyn Task, inputs: &[&str], name: &str| {
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at(name)).unwrap();
        let inputs: Vec<_> = inputs.iter().map(|name| at(name)).collect();
        task.run(&inputs, &at(name), &|_| ()).unwrap();
        at(name)
    };
    run(&*sf, &[], "sf");
    let pef_folder = run(&*pef, &[], "pef");
    run(&*forest, &["sf"], "forest");
    let segmented = run(&*segmentation, &["forest", "pef"], "segmented");

    let set = DataSet::open(&pef_folder).unwrap();
    let camera = &set.camera().intrinsics;
    let arm = set.target() + 1;
    let confusions = SegmentationTask::confusions(&segmented).unwrap();
    for (image, confusion) in confusions.iter().enumerate() {
        let record = &set.record().images[image];
        let arms: Vec<usize> = (1..3).map(|class| confusion.pixels(class)).collect();
        assert_eq!(arms, record.arms);
        let all: usize = confusion.0.iter().flatten().sum();
        assert_eq!(all, record.valid);
        let found = SegmentationTask::read(&segmented, image, camera).unwrap();
        let given = found.classes.pixels.iter();
        let given = given.filter(|&&class| usize::from(class) == arm).count();
        assert_eq!(given, confusion.given(arm));
    }
    let mut sum = confusions[0].clone();
    confusions[1..].iter().for_each(|other| sum.add(other));
    assert!(sum.f1(0) > 0.9 && sum.f1(arm) > 0.3, "{sum:?}");

    for kind in [
        SegmentationKind::Forest,
        SegmentationKind::Truth,
        SegmentationKind::Context,
    ] {
        let sight = Sight::new(kind, || Ok(segmentation.clone())).unwrap();
        let input = sight.input().map(|_| &*segmented);
        let arm_pixels: Vec<usize> = match kind {
            SegmentationKind::Truth => (0..8)
                .map(|image| set.record().images[image].arms[set.target()])
                .collect(),
            _ => confusions.iter().map(|image| image.given(arm)).collect(),
        };
        let mut sure = Vec::new();
        for (image, &pixels) in arm_pixels.iter().enumerate() {
            let frame = set.frame(image).unwrap();
            let seen = sight.look(&set, input, image).unwrap().frame;
            let classes = match kind {
                SegmentationKind::Truth => true_classes(&set, &frame.labels),
                _ => {
                    SegmentationTask::read(&segmented, image, camera)
                        .unwrap()
                        .classes
                }
            };
            let is_arm = |at: usize| usize::from(classes.pixels[at]) == arm;
            let mut left = 0;
            for (at, &mm) in frame.depth.pixels.iter().enumerate() {
                let stays = kind == SegmentationKind::Context || is_arm(at);
                assert_eq!(seen.depth.pixels[at], if stays { mm } else { 0 });
                left += usize::from(mm > 0 && is_arm(at));
            }
            assert_eq!(left, pixels);
            sure.push(match kind {
                SegmentationKind::Truth => pixels,
                _ => {
                    let found = SegmentationTask::read(&segmented, image, camera).unwrap();
                    found.sure_pixels()
                }
            });
        }
        let pose_forest = Arc::new(PoseForestTask {
            set: pef.clone(),
            images: (0..6).collect(),
            objective: ObjectiveKind::named("mse").unwrap(),
            training: training.clone(),
            sight: sight.clone(),
            fold: 0,
        });
        let samples = pose_forest.samples_of(&set, input, &|_| ()).unwrap();
        let with_arm = (0..6).filter(|&i| kind == SegmentationKind::Context || arm_pixels[i] > 0);
        assert_eq!(samples.targets.len(), 600 * with_arm.count());
        let features = if kind == SegmentationKind::Context {
            80
        } else {
            40
        };
        assert_eq!(samples.binned.features(), features);

        let estimates = EstimatesTask::new(pose_forest.clone(), vec![6, 7], 1.0, 3, 4).unwrap();
        let mut inputs = vec!["pef"];
        inputs.extend(input.map(|_| "segmented"));
        let name = format!("pose forest {}", kind.id());
        run(&*pose_forest, &inputs, &name);
        inputs.insert(0, &name);
        let out = run(&estimates, &inputs, &format!("estimates {}", kind.id()));
        for estimated in EstimatesTask::read(&out).unwrap() {
            let pixels = sure[estimated.image];
            assert_eq!(estimated.sure_pixels, Some(pixels));
            assert_eq!(estimated.estimate.is_some(), pixels >= LEAST_ARM_PIXELS);
        }
    }
}
