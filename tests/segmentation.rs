//! The segmentation forest and what it looks at.

use armpose::camera::{DepthImage, Image};
use armpose::estimator::segmentation::segment;
use armpose::feature::{
    D_INVALID_MM, DepthFeatures, Extra, FeatureSpec, PaddedDepth, SampleMatrix,
};
use armpose::forest::bins::BinnedMatrix;
use armpose::forest::grow::{GrowSpec, TargetTable};
use armpose::forest::leaves::grow_means;
use armpose::forest::objective::mse::mse;
use armpose::forest::pose_forest::PoseForest;
use armpose::forest::segmentation_forest::SegmentationForest;
use armpose::random::{below, stream};

/// Beside eq. 4: column, row and depth of the pixel, and another image at delta_u.
#[test]
fn extra_features_are_of_the_pixel_and_of_the_context() {
    let mut random = stream(1, "extra", &[]);
    let (width, height) = (37, 23);
    let depth = DepthImage {
        width,
        height,
        pixels: (0..width * height)
            .map(|_| below(&mut random, 3) as u16 * 2100)
            .collect(),
    };
    let map = Image {
        width,
        height,
        pixels: (0..width * height)
            .map(|_| below(&mut random, 256) as u8)
            .collect(),
    };
    let spec = FeatureSpec {
        count: 9,
        window: 30,
    };
    let pixel = DepthFeatures::draw(&spec, Extra::Pixel, &mut stream(2, "f", &[])).unwrap();
    let context = DepthFeatures::draw(&spec, Extra::Context, &mut stream(2, "f", &[])).unwrap();
    assert_eq!((pixel.count(), context.count()), (12, 18));
    let whole = PaddedDepth::new(&depth, pixel.reach());
    for step in [1, 2, 3, 5, 40] {
        let padded = PaddedDepth::every(step, &depth, pixel.reach()).with_context(&map);
        let (of_pixel, of_context) = (pixel.on(&padded), context.on(&padded));
        let places = (0..height).flat_map(|y| (0..width).step_by(step).map(move |x| (x, y)));
        for (x, y) in places {
            let position = padded.position(x, y);
            let at = y * width + x;
            let mm = match depth.pixels[at] {
                0 => D_INVALID_MM,
                mm => mm as i16,
            };
            assert_eq!(padded.depth(position), mm);
            let found = [9, 10, 11].map(|feature| of_pixel.value(feature, position));
            assert_eq!(found, [x as i16, y as i16, mm]);
            for (feature, [[dx, dy], _]) in context.offsets().iter().enumerate() {
                let (u, v) = (x as i32 + i32::from(*dx), y as i32 + i32::from(*dy));
                let inside = (0..width as i32).contains(&u) && (0..height as i32).contains(&v);
                let there = if inside {
                    i16::from(map.pixels[v as usize * width + u as usize])
                } else {
                    0
                };
                assert_eq!(of_context.value(9 + feature, position), there);
                // Whichever columns stand beside each other.
                let same = pixel.on(&whole).value(feature, whole.position(x, y));
                assert_eq!(of_context.value(feature, position), same);
                assert_eq!(of_pixel.value(feature, position), same);
            }
        }
    }
}

/// Two classes on either side of a column and a third in front: learnt without fault, the shares
/// sum to 1, and the file brings the forest back.
#[test]
fn a_segmentation_forest_learns_what_can_be_told_apart() {
    let (width, height) = (64, 48);
    let mut random = stream(3, "segmentation", &[]);
    let images: Vec<(DepthImage, Vec<u16>)> = (0..6)
        .map(|_| {
            let (left, top) = (below(&mut random, 40), below(&mut random, 30));
            let class = |at: usize| {
                let (x, y) = (at % width, at / width);
                let inside = (left..left + 20).contains(&x) && (top..top + 14).contains(&y);
                if inside { 2 } else { u16::from(x >= 32) }
            };
            let classes: Vec<u16> = (0..width * height).map(class).collect();
            let depth = |&class: &u16| 2500 - 500 * class / 2 + below(&mut random, 20) as u16;
            let pixels = classes.iter().map(depth).collect();
            let image = DepthImage {
                width,
                height,
                pixels,
            };
            (image, classes)
        })
        .collect();
    let spec = FeatureSpec {
        count: 10,
        window: 20,
    };
    let features = DepthFeatures::draw(&spec, Extra::Pixel, &mut random).unwrap();
    let (test, train) = images.split_last().unwrap();
    let positions = |padded: &PaddedDepth| -> Vec<u32> {
        let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        all.map(|(x, y)| padded.position(x, y)).collect()
    };
    let counts = vec![width * height; train.len()];
    let matrix = SampleMatrix::fill(features.count(), &counts, |i, columns| {
        let padded = PaddedDepth::new(&train[i].0, features.reach());
        features.fill(&padded, &positions(&padded), columns);
        Ok::<(), ()>(())
    });
    let one_hot = TargetTable::new(3, vec![1., 0., 0., 0., 1., 0., 0., 0., 1.]).unwrap();
    let targets: Vec<u16> = train.iter().flat_map(|image| image.1.clone()).collect();
    let spec = GrowSpec {
        trees: 5,
        min_leaf: 2,
        features_per_node: 4,
        max_depth: None,
        bootstrap: true,
    };
    let (trees, leaves) = grow_means(
        &BinnedMatrix::new(&matrix.unwrap()).unwrap(),
        &targets,
        &one_hot,
        &*mse(&one_hot).unwrap(),
        &spec,
        1,
        &|_| (),
    )
    .unwrap();
    let classes = ["left", "right", "front"].map(String::from).to_vec();
    let forest = SegmentationForest::new(features, classes, trees, leaves).unwrap();

    let padded = PaddedDepth::new(&test.0, forest.features().reach());
    let shares = forest.shares(&forest.features().on(&padded), &positions(&padded));
    for shares in shares.chunks(3) {
        assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    }
    let found = segment(&forest, &test.0, 2, 1);
    let wrong = found.classes.pixels.iter().zip(&test.1);
    let wrong = wrong.filter(|(found, truth)| u16::from(**found) != **truth);
    assert!(wrong.count() < width * height / 50);
    for (at, shares) in shares.chunks(3).enumerate() {
        let largest = shares.iter().copied().fold(0.0, f32::max);
        let class = usize::from(found.classes.pixels[at]);
        assert!(shares[class] == largest && shares[..class].iter().all(|&s| s < largest));
        assert_eq!(found.share.pixels[at], (shares[2] * 255.0).round() as u8);
    }

    // A pixel says what the first of its block of 3 x 3 says.
    let coarse = segment(&forest, &test.0, 2, 3);
    for at in 0..width * height {
        let first = at / width / 3 * 3 * width + at % width / 3 * 3;
        assert_eq!(coarse.classes.pixels[at], found.classes.pixels[first]);
        assert_eq!(coarse.share.pixels[at], found.share.pixels[first]);
    }

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model");
    forest.save(&path).unwrap();
    assert_eq!(SegmentationForest::load(&path).unwrap(), forest);
    let other = PoseForest::load(&path).unwrap_err().to_string();
    assert!(
        other.contains("its header is for something else"),
        "{other}"
    );
}
