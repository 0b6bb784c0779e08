use armpose::camera::png::read_depth;
use armpose::dataset::DataSet;
use armpose::estimator::segmentation::segment;
use armpose::forest::segmentation_forest::SegmentationForest;
use std::path::Path;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let forest = SegmentationForest::load(&Path::new(&a[1]).join("segmentation.bin")).unwrap();
    let class: usize = a[2].parse().unwrap();
    let n: usize = a[3].parse().unwrap();
    let taus = [128u8, 166, 191, 217, 229, 242, 250, 255];
    for dir in &a[4..] {
        let mut rows: Vec<(usize, bool, Vec<usize>)> = vec![];
        if dir.ends_with(".png") {
            let camera = armpose::camera::Intrinsics {
                width: 640,
                height: 480,
                fx: 525.,
                fy: 525.,
                cx: 319.5,
                cy: 239.5,
            };
            let d = read_depth(Path::new(dir), &camera).unwrap();
            let s = segment(&forest, &d, class, 1);
            let c: Vec<usize> = taus
                .iter()
                .map(|&t| s.share.pixels.iter().filter(|&&p| p >= t).count())
                .collect();
            println!("{dir} {c:?}");
            continue;
        }
        let set = DataSet::open(Path::new(dir)).unwrap();
        for i in 0..set.len().min(n) {
            let f = set.frame(i).unwrap();
            let s = segment(&forest, &f.depth, class, 1);
            let c = taus
                .iter()
                .map(|&t| s.share.pixels.iter().filter(|&&p| p >= t).count())
                .collect();
            let r = &set.record().images[i];
            rows.push((r.arms[class - 1], r.without_robot, c));
        }
        // for each tau: threshold with 2 % false alarms, and recall at arms >= 1000
        println!("{dir}");
        for (k, t) in taus.iter().enumerate() {
            let mut neg: Vec<usize> = rows.iter().filter(|r| r.1).map(|r| r.2[k]).collect();
            neg.sort();
            let mut pos: Vec<usize> = rows
                .iter()
                .filter(|r| r.0 >= 1000)
                .map(|r| r.2[k])
                .collect();
            pos.sort();
            let q = |v: &Vec<usize>, p: f64| {
                if v.is_empty() {
                    0
                } else {
                    v[((v.len() - 1) as f64 * p) as usize]
                }
            };
            println!(
                "tau {t}: neg n {} q50 {} q90 {} q98 {} | pos n {} q03 {} q10 {} q50 {}",
                neg.len(),
                q(&neg, 0.5),
                q(&neg, 0.9),
                q(&neg, 0.98),
                pos.len(),
                q(&pos, 0.03),
                q(&pos, 0.1),
                q(&pos, 0.5)
            );
        }
    }
}
