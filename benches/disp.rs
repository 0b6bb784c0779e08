//! The DISP matrices of 200 and 2000 poses of the arm, and of 200 without leaving anything out: the
//! corners of all moving links' hulls, placed once a pose, each compared for each pair.

use armpose::dataset::SetSpec;
use armpose::distances::DistanceMatrix;
use armpose::pose_space::disp::Disp;
use armpose::pose_space::hull::extreme_points;
use armpose::random::stream;
use armpose::scene::{PoseSampler, Rig};
use criterion::{Criterion, SamplingMode, criterion_group, criterion_main};
use nalgebra::Point3;
use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

fn disp(criterion: &mut Criterion) {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let spec = SetSpec::read(&data.join("sets/pef.toml")).expect("a sound set");
    let rig = Rig::read(&data.join("robots/arm/robot.toml")).expect("a sound robot");
    let sampler = PoseSampler::new(&rig, &spec.poses).expect("sound poses");
    let arm = &rig.arms[rig.arm(&spec.target).expect("an arm")];
    let joints: Vec<&str> = rig.robot.dof_joints().map(|j| j.name.as_str()).collect();
    let joints: Vec<&str> = arm.joints.iter().map(|&dof| joints[dof]).collect();
    let mut s = stream(1, "bench", &[]);
    let pose = |_| {
        let q = sampler.sample(&rig.robot, &mut s);
        arm.joints.iter().map(|&dof| q[dof]).collect()
    };
    let poses: Vec<Vec<f64>> = (0..2000).map(pose).collect();

    let mut group = criterion.benchmark_group("disp");
    group
        .sampling_mode(SamplingMode::Flat)
        .sample_size(10)
        .warm_up_time(Duration::from_secs(1));
    group.bench_function("prepare the robot", |b| {
        b.iter(|| Disp::new(&rig.robot, &joints))
    });
    let disp = Disp::new(&rig.robot, &joints).expect("joints that move");
    for count in [200, 2000] {
        group.bench_function(format!("{count} poses"), |b| {
            b.iter(|| black_box(disp.matrix(&poses[..count])))
        });
    }

    let corners = |&link: &usize| {
        let vertices = rig.robot.links[link].mesh.vertices.iter();
        let vertices: Vec<[f64; 3]> = vertices.map(|v| v.map(f64::from)).collect();
        let corners = extreme_points(&vertices).into_iter();
        (link, corners.map(|i| vertices[i]).collect::<Vec<_>>())
    };
    let corners: Vec<_> = arm.links.iter().map(corners).collect();
    let place = |pose: &Vec<f64>| {
        let mut q = vec![0.0; rig.robot.dofs()];
        for (&dof, &value) in arm.joints.iter().zip(pose) {
            q[dof] = value;
        }
        let root_from_link = rig.robot.forward_kinematics(&q);
        let placed = corners.iter().flat_map(|(link, corners)| {
            let place = |&corner| (root_from_link[*link] * Point3::from(corner)).coords.into();
            corners.iter().map(place).collect::<Vec<[f64; 3]>>()
        });
        placed.collect::<Vec<_>>()
    };
    let count: usize = corners.iter().map(|(_, corners)| corners.len()).sum();
    group.bench_function(format!("200 poses, all {count} corners"), |b| {
        b.iter(|| {
            let placed: Vec<_> = poses[..200].iter().map(place).collect();
            DistanceMatrix::new(200, |a, b| {
                let mut most = 0.0;
                for (p, q) in placed[a].iter().zip(&placed[b]) {
                    let (x, y, z) = (p[0] - q[0], p[1] - q[1], p[2] - q[2]);
                    most = f64::max(most, x * x + y * y + z * z);
                }
                most.sqrt()
            })
        })
    });
    group.finish();
}

criterion_group!(benches, disp);
criterion_main!(benches);
