//! Pixels that walk through trees together end where each would end alone.

use armpose::camera::{DepthImage, Image};
use armpose::circular::Circular;
use armpose::estimator::image::combine;
use armpose::feature::{D_INVALID_MM, DepthFeatures, Extra, FeatureSpec, PaddedDepth};
use armpose::forest::leaves::LeafTable;
use armpose::forest::pose_forest::PoseForest;
use armpose::forest::segmentation_forest::SegmentationForest;
use armpose::forest::tree::{LEAF, Node, Tree, find_leaves};
use armpose::random::{Stream, below, stream, uniform};

type Pixel = (usize, usize);

/// An image with smooth patches, steps and holes, and a map for [`Extra::Context`].
struct Scene {
    depth: DepthImage,
    map: Image<u8>,
}

impl Scene {
    fn draw(width: usize, height: usize, random: &mut Stream) -> Scene {
        let (step, shift) = (5 + below(random, 20), below(random, 1000));
        let mut pixel = |at: usize| {
            let (x, y) = (at % width, at / width);
            match below(random, 12) {
                0 => 0,
                _ => (600 + shift + x / step * 130 + y / step * 70) as u16,
            }
        };
        let pixels = (0..width * height).map(&mut pixel).collect();
        let map = (0..width * height).map(|_| below(random, 256) as u8);
        Scene {
            map: Image {
                width,
                height,
                pixels: map.collect(),
            },
            depth: DepthImage {
                width,
                height,
                pixels,
            },
        }
    }

    /// The value of a feature by its definition.
    fn value(&self, features: &DepthFeatures, feature: usize, (x, y): Pixel) -> i16 {
        let inside = |[dx, dy]: [i16; 2]| {
            let (x, y) = (x as i32 + i32::from(dx), y as i32 + i32::from(dy));
            let (width, height) = (self.depth.width as i32, self.depth.height as i32);
            ((0..width).contains(&x) && (0..height).contains(&y)).then(|| (y * width + x) as usize)
        };
        let depth = |offset| match inside(offset).map_or(0, |at| self.depth.pixels[at]) {
            0 => D_INVALID_MM,
            mm => mm.min(5000) as i16,
        };
        let offsets = features.offsets();
        match (features.extra(), feature.checked_sub(offsets.len())) {
            (_, None) => depth(offsets[feature][0]) - depth(offsets[feature][1]),
            (Extra::Context, Some(i)) => {
                inside(offsets[i][0]).map_or(0, |at| self.map.pixels[at].into())
            }
            (_, Some(0)) => x as i16,
            (_, Some(1)) => y as i16,
            _ => depth([0, 0]),
        }
    }

    fn pixel(&self, random: &mut Stream) -> Pixel {
        (
            below(random, self.depth.width),
            below(random, self.depth.height),
        )
    }

    /// A tree whose thresholds are values of the scene, so that they part its pixels.
    fn tree(&self, features: &DepthFeatures, splits: usize, random: &mut Stream) -> Tree {
        let leaf = Node {
            feature: LEAF,
            threshold: 0,
            child: 0,
        };
        let mut nodes = vec![leaf];
        while nodes.len() < 2 * splits + 1 {
            let at = below(random, nodes.len());
            if nodes[at].feature == LEAF {
                let feature = below(random, features.count());
                nodes[at] = Node {
                    feature: feature as u16,
                    threshold: self.value(features, feature, self.pixel(random)),
                    child: nodes.len() as u32,
                };
                nodes.extend([leaf; 2]);
            }
        }
        let leaves = nodes.iter_mut().filter(|node| node.feature == LEAF);
        leaves
            .zip(0..)
            .for_each(|(leaf, number)| leaf.child = number);
        Tree::new(nodes, features.count()).unwrap()
    }

    fn leaf(&self, tree: &Tree, features: &DepthFeatures, pixel: Pixel) -> u32 {
        let mut at = 0;
        loop {
            let node = tree.nodes()[at];
            if node.feature == LEAF {
                return node.child;
            }
            let value = self.value(features, node.feature.into(), pixel);
            at = node.child as usize + usize::from(value > node.threshold);
        }
    }
}

fn features(window: usize, extra: Extra, random: &mut Stream) -> DepthFeatures {
    DepthFeatures::draw(&FeatureSpec { count: 9, window }, extra, random).unwrap()
}

/// Whole images, every second and third pixel, and pixels in any order and several times; images that
/// are narrower than a word, and one that is larger than a run; any number of threads.
#[test]
fn together_as_alone() {
    let mut random = stream(1, "walk", &[]);
    let sizes = [(1, 1), (3, 7), (15, 9), (16, 9), (47, 31), (280, 240)];
    for ((width, height), extra) in sizes
        .into_iter()
        .flat_map(|size| [Extra::Nothing, Extra::Pixel, Extra::Context].map(|extra| (size, extra)))
    {
        let window = 1 + below(&mut random, 40);
        let features = features(window, extra, &mut random);
        let scene = Scene::draw(width, height, &mut random);
        let trees = [0, 1, 60].map(|splits| scene.tree(&features, splits, &mut random));
        let padded = PaddedDepth::new(&scene.depth, features.reach()).with_context(&scene.map);
        let image = features.on(&padded);
        let grid = |step: usize| -> Vec<Pixel> {
            let rows = (0..height).step_by(step);
            rows.flat_map(|y| (0..width).step_by(step).map(move |x| (x, y)))
                .collect()
        };
        let any = (0..300).map(|_| scene.pixel(&mut random)).collect();
        for pixels in [grid(1), grid(2), grid(3), any, vec![]] {
            let positions: Vec<u32> = pixels.iter().map(|&(x, y)| padded.position(x, y)).collect();
            let alone: Vec<u32> = trees
                .iter()
                .flat_map(|tree| pixels.iter().map(|&p| scene.leaf(tree, &features, p)))
                .collect();
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let together = pool
                    .unwrap()
                    .install(|| find_leaves(&trees, &image, &positions));
                assert!(
                    together == alone,
                    "{width}x{height}, {} pixels",
                    pixels.len()
                );
            }
        }
    }
}

/// Confidences and shares are sums over the trees in their order, to the last bit.
#[test]
fn sums_over_trees_have_an_order() {
    let mut random = stream(2, "walk", &[]);
    let features = features(30, Extra::Pixel, &mut random);
    let scene = Scene::draw(170, 120, &mut random);
    let trees: Vec<Tree> = (0..7)
        .map(|_| scene.tree(&features, 40, &mut random))
        .collect();
    let mut table = |tree: &Tree| {
        let mut draw = |count: usize| (0..count).map(|_| uniform(&mut random, 0.0, 1.0)).collect();
        let (values, impurities): (Vec<f64>, _) = (draw(3 * tree.leaves()), draw(tree.leaves()));
        let values = values.into_iter().map(|value| value as f32).collect();
        LeafTable::new(3, values, impurities).unwrap()
    };
    let leaves: Vec<LeafTable> = trees.iter().map(&mut table).collect();
    let names = || ["a", "b", "c"].map(String::from).to_vec();
    let padded = PaddedDepth::new(&scene.depth, features.reach());
    let image = features.on(&padded);
    let pixels: Vec<Pixel> = (0..170 * 120).map(|at| (at % 170, at / 170)).collect();
    let positions: Vec<u32> = pixels.iter().map(|&(x, y)| padded.position(x, y)).collect();

    let pose = PoseForest::new(
        features.clone(),
        names(),
        Circular::default(),
        trees.clone(),
        leaves.clone(),
        0.7,
    );
    let pose = pose.unwrap();
    let confidences = pose.find_leaves(&image, &positions).confidences();
    let forest = SegmentationForest::new(features.clone(), names(), trees.clone(), leaves.clone());
    let shares = forest.unwrap().shares(&image, &positions);
    for (i, &pixel) in pixels.iter().enumerate() {
        let (mut confidence, mut share) = (0.0, [0.0; 3]);
        for (t, tree) in trees.iter().enumerate() {
            let leaf = scene.leaf(tree, &features, pixel) as usize;
            confidence += pose.confidences()[t][leaf];
            let row = leaves[t].row(leaf);
            share.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
        }
        assert_eq!(confidences[i], confidence / 7.0);
        assert_eq!(shares[3 * i..3 * i + 3], share.map(|sum| sum / 7.0));
    }
}

/// Eqs. 12 and 13 by the estimates of single pixels, for poses of one value, of as many as one thread
/// sums, and of more.
#[test]
fn an_image_is_the_mean_of_its_confident_pixels() {
    let mut random = stream(3, "walk", &[]);
    for width in [1, 8, 15] {
        let features = features(30, Extra::Nothing, &mut random);
        let scene = Scene::draw(31, 23, &mut random);
        let trees: Vec<Tree> = (0..4)
            .map(|_| scene.tree(&features, 30, &mut random))
            .collect();
        let mut draw = |count: usize| -> Vec<f64> {
            (0..count).map(|_| uniform(&mut random, 0.0, 2.0)).collect()
        };
        let leaves = trees.iter().map(|tree| {
            let values = draw(width * tree.leaves());
            let values = values.into_iter().map(|value| value as f32).collect();
            LeafTable::new(width, values, draw(tree.leaves())).unwrap()
        });
        let leaves = leaves.collect();
        let names = (0..width).map(|i| i.to_string()).collect();
        let forest = PoseForest::new(
            features.clone(),
            names,
            Circular::default(),
            trees,
            leaves,
            0.7,
        )
        .unwrap();
        let padded = PaddedDepth::new(&scene.depth, features.reach());
        let positions: Vec<u32> = (0..31 * 23)
            .map(|at| padded.position(at % 31, at / 31))
            .collect();
        let found = forest.find_leaves(&features.on(&padded), &positions);
        let foreground: Vec<bool> = (0..positions.len()).map(|i| i % 3 == 0).collect();
        let estimate = combine(&forest, &found, &foreground).unwrap();

        let confidences: Vec<f64> = found.confidences().into_iter().map(f64::from).collect();
        let min = confidences.iter().copied().fold(f64::MAX, f64::min);
        let max = confidences.iter().copied().fold(f64::MIN, f64::max);
        assert_eq!(estimate.thresholds.len(), 101);
        let nothing = forest.find_leaves(&features.on(&padded), &[]);
        assert!(combine(&forest, &nothing, &[]).is_none());
        for (step, at) in estimate.thresholds.iter().enumerate() {
            let chosen = |&i: &usize| (confidences[i] - min) * 100.0 >= (max - min) * step as f64;
            let chosen: Vec<usize> = (0..positions.len()).filter(chosen).collect();
            assert_eq!(at.pixels, chosen.len());
            assert_eq!(
                at.foreground,
                chosen.iter().filter(|&&i| foreground[i]).count()
            );
            let (mut mean, mut weight, mut pose) = (vec![0.0; width], 0.0, vec![0.0; width]);
            for &i in &chosen {
                found.pose(i, &mut pose);
                weight += confidences[i];
                let terms = pose.iter().map(|y| confidences[i] * y);
                mean.iter_mut().zip(terms).for_each(|(sum, y)| *sum += y);
            }
            for (mean, y) in mean.iter().zip(&at.pose) {
                assert!((mean / weight - y).abs() < 1e-5);
            }
        }
    }
}
