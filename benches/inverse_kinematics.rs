//! Aligning the arm with the origins of its joints' links: exact positions of poses anywhere within
//! the limits from the middle of these, and of poses as in training from their mean; these also a
//! centimetre off, and with one of them half a metre off. Each iteration takes the next of 1,000
//! poses; what single ones take, the shortest of five times, is printed before.

use armpose::circular::Circular;
use armpose::dataset::SetSpec;
use armpose::estimator::error::mean_pose;
use armpose::estimator::inverse_kinematics::{Settings, Target, VirtualArm};
use armpose::random::{below, normal, stream, uniform};
use armpose::robot::Joint;
use armpose::scene::{PoseSampler, Rig};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use std::hint::black_box;
use std::path::Path;
use std::time::{Duration, Instant};

const POSES: usize = 1000;

fn inverse_kinematics(criterion: &mut Criterion) {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let spec = SetSpec::read(&data.join("sets/pef.toml")).expect("a sound set");
    let rig = Rig::read(&data.join("robots/arm/robot.toml")).expect("a sound robot");
    let sampler = PoseSampler::new(&rig, &spec.poses).expect("sound poses");
    let joints = &rig.arms[rig.arm(&spec.target).expect("an arm")].joints;
    let all: Vec<&Joint> = rig.robot.dof_joints().collect();
    let links: Vec<usize> = joints.iter().map(|&dof| all[dof].child).collect();
    let arm = VirtualArm::new(&rig.robot, joints, &links);

    let mut s = stream(1, "bench", &[]);
    let limits: Vec<(f64, f64)> = joints.iter().map(|&dof| all[dof].limits).collect();
    let middle: Vec<f64> = limits
        .iter()
        .map(|(low, high)| (low + high) / 2.0)
        .collect();
    let any = |_| {
        let draw = |&(low, high): &(f64, f64)| uniform(&mut s, low, high);
        limits.iter().map(draw).collect::<Vec<f64>>()
    };
    let any: Vec<Vec<f64>> = (0..POSES).map(any).collect();
    let mut s = stream(2, "bench", &[]);
    let trained = |_| {
        let q = sampler.sample(&rig.robot, &mut s);
        joints.iter().map(|&dof| q[dof]).collect::<Vec<f64>>()
    };
    let trained: Vec<Vec<f64>> = (0..POSES).map(trained).collect();
    let mean = mean_pose(trained.iter().map(Vec::as_slice), &Circular::default());

    let mut group = criterion.benchmark_group("inverse kinematics");
    group
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(3));
    for (name, poses, reference, noise, outlier, starts) in [
        ("any pose", &any, &middle, 0.0, 0.0, 32),
        ("trained pose", &trained, &mean, 0.0, 0.0, 32),
        ("noise, 8 starts", &trained, &mean, 0.01, 0.0, 8),
        ("false point, 8 starts", &trained, &mean, 0.0, 0.5, 8),
    ] {
        let settings = Settings {
            starts,
            ..Settings::default()
        };
        let mut vector = || Vector3::from_fn(|_, _| normal(&mut s));
        let found = |pose: &Vec<f64>| {
            let mut target = |position| Target {
                position: position + noise * vector(),
                weight: 1.0,
            };
            let positions = arm.positions(pose).into_iter();
            positions.map(|p| Some(target(p))).collect::<Vec<_>>()
        };
        let mut found: Vec<_> = poses.iter().map(found).collect();
        let mut s = stream(3, "bench", &[]);
        for targets in &mut found {
            let wrong = 3 + below(&mut s, links.len() - 3);
            if let Some(target) = &mut targets[wrong] {
                let direction = Vector3::from_fn(|_, _| normal(&mut s)).normalize();
                target.position += outlier * direction;
            }
        }
        let time = |targets: &Vec<_>| {
            // Whoever else is on the machine only ever makes it longer.
            let once = |_| {
                let start = Instant::now();
                black_box(arm.align(targets, reference, &settings));
                start.elapsed()
            };
            (0..5).map(once).min().unwrap_or_default()
        };
        let mut times: Vec<Duration> = found.iter().map(time).collect();
        times.sort();
        let mean = times.iter().sum::<Duration>() / POSES as u32;
        let [median, most] = [POSES / 2, POSES * 99 / 100].map(|i| times[i]);
        println!("{name}: median {median:?}, mean {mean:?}, 99 % within {most:?}");

        let mut next = found.iter().cycle();
        group.bench_function(name, |b| {
            b.iter(|| next.next().map(|t| arm.align(t, reference, &settings)))
        });
    }
    group.finish();
}

criterion_group!(benches, inverse_kinematics);
criterion_main!(benches);
