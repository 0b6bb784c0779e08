//! The right arm of the paper's robot, aligned with the origins of the links that its joints move.

use armpose::circular::Circular;
use armpose::dataset::SetSpec;
use armpose::estimator::error::{angle_error, mean_pose};
use armpose::estimator::inverse_kinematics::{Alignment, Settings, Target, VirtualArm};
use armpose::random::{Stream, below, normal, shuffle, stream, uniform};
use armpose::robot::Joint;
use armpose::scene::{PoseSampler, Rig};
use nalgebra::{Point3, Vector3};
use std::path::Path;

/// Joints in the order of a pose, of which each moves the point of the same number.
const NAMES: [&str; 15] = [
    "SFE", "SAA", "HR", "EB", "WR", "WFE", "WAA", "FR", "FR2", "RF", "RF2", "MF", "MF2", "LF",
    "LF2",
];

struct Bed {
    rig: Rig,
    poses: PoseSampler,
    joints: Vec<usize>,
    links: Vec<usize>,
    arm: VirtualArm,
}

impl Bed {
    fn new() -> Self {
        let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
        let rig = Rig::read(&data.join("robots/arm/robot.toml")).unwrap();
        let spec = SetSpec::read(&data.join("sets/pef.toml")).unwrap();
        let joints = rig.arms[rig.arm("right").unwrap()].joints.clone();
        let all: Vec<&Joint> = rig.robot.dof_joints().collect();
        let links: Vec<usize> = joints.iter().map(|&dof| all[dof].child).collect();
        Self {
            poses: PoseSampler::new(&rig, &spec.poses).unwrap(),
            arm: VirtualArm::new(&rig.robot, &joints, &links),
            joints,
            links,
            rig,
        }
    }

    fn limits(&self) -> Vec<(f64, f64)> {
        let all: Vec<&Joint> = self.rig.robot.dof_joints().collect();
        self.joints.iter().map(|&dof| all[dof].limits).collect()
    }

    /// Anywhere within the limits.
    fn any_pose(&self, s: &mut Stream) -> Vec<f64> {
        let mut q = vec![0.0; self.rig.robot.dofs()];
        for (&dof, (low, high)) in self.joints.iter().zip(self.limits()) {
            q[dof] = uniform(s, low, high);
        }
        self.rig.robot.apply_mimics(&mut q);
        self.joints.iter().map(|&dof| q[dof]).collect()
    }

    /// As in the images on which the forests are trained.
    fn trained_pose(&self, s: &mut Stream) -> Vec<f64> {
        let q = self.poses.sample(&self.rig.robot, s);
        self.joints.iter().map(|&dof| q[dof]).collect()
    }

    fn mean_of_trained_poses(&self) -> Vec<f64> {
        let mut s = stream(1, "trained poses", &[]);
        let poses: Vec<_> = (0..160).map(|_| self.trained_pose(&mut s)).collect();
        mean_pose(poses.iter().map(Vec::as_slice), &Circular::default())
    }

    fn targets(&self, pose: &[f64]) -> Vec<Option<Target>> {
        let target = |position: Point3<f64>| {
            Some(Target {
                position,
                weight: 1.0,
            })
        };
        self.arm.positions(pose).into_iter().map(target).collect()
    }
}

fn direction(s: &mut Stream) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(s)).normalize()
}

/// Targets as they are found in images: a centimetre off, and not equally sure.
fn noisy(mut targets: Vec<Option<Target>>, s: &mut Stream) -> Vec<Option<Target>> {
    for target in targets.iter_mut().flatten() {
        target.position += Vector3::from_fn(|_, _| 0.01 * normal(s));
        target.weight = uniform(s, 0.5, 2.0);
    }
    targets
}

fn farthest(found: &Alignment) -> f64 {
    found
        .residuals
        .iter()
        .flatten()
        .copied()
        .fold(0.0, f64::max)
}

fn degrees(a: &[f64], b: &[f64]) -> Vec<f64> {
    let errors = a
        .iter()
        .zip(b)
        .map(|(&a, &b)| angle_error(a, b).to_degrees());
    errors.collect()
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize]
}

/// The reference, the middle of the limits, is far from most poses.
#[test]
fn reachable_poses_are_reached() {
    let bed = Bed::new();
    let limits = bed.limits();
    let middle: Vec<f64> = limits
        .iter()
        .map(|(low, high)| (low + high) / 2.0)
        .collect();
    let mut s = stream(1, "reachable poses", &[]);
    let mut solved = 0;
    for _ in 0..1000 {
        let pose = bed.any_pose(&mut s);
        let found = bed
            .arm
            .align(&bed.targets(&pose), &middle, &Settings::default());
        solved += usize::from(farthest(&found) <= 1e-3);
        for (&angle, &(low, high)) in found.pose.iter().zip(&limits) {
            assert!((low..=high).contains(&angle), "{angle}, {low} to {high}");
        }
    }
    println!("{solved} of 1000 solved");
    assert!(solved >= 990, "{solved} of 1000 solved");
}

/// Positions leave the wrist two poses; the reference tells which one is meant.
#[test]
fn near_the_reference_the_pose_itself_is_found() {
    let bed = Bed::new();
    let reference = bed.mean_of_trained_poses();
    let mut s = stream(1, "poses", &[]);
    let (mut errors, mut right) = (Vec::new(), 0);
    for _ in 0..300 {
        let pose = bed.trained_pose(&mut s);
        let found = bed
            .arm
            .align(&bed.targets(&pose), &reference, &Settings::default());
        assert!(farthest(&found) <= 1e-3);
        let off = degrees(&pose, &found.pose);
        right += usize::from(off.iter().all(|&error| error < 10.0));
        errors.extend(off);
    }
    println!(
        "{right} of 300 poses, median {} deg",
        quantile(&mut errors, 0.5)
    );
    assert!(right >= 291, "{right} of 300 poses");
    assert!(quantile(&mut errors, 0.5) < 0.02);
}

/// Half a metre off, a point loses its say: what the others tell without it stays as it is.
#[test]
fn a_false_point_spoils_nothing_that_the_others_tell() {
    let bed = Bed::new();
    let reference = bed.mean_of_trained_poses();
    let mut s = stream(1, "false points", &[]);
    let (mut errors, mut spoilt) = (Vec::new(), 0);
    for _ in 0..200 {
        let pose = bed.trained_pose(&mut s);
        let mut targets = bed.targets(&pose);
        let wrong = 3 + below(&mut s, 12);
        let settings = Settings {
            starts: 4,
            ..Settings::default()
        };
        let mut found = vec![true; 15];
        found[wrong] = false;
        let told = bed.arm.observable(&found);
        if let Some(target) = &mut targets[wrong] {
            target.position += 0.5 * direction(&mut s);
        }
        let found = bed.arm.align(&targets, &reference, &settings);
        let off = degrees(&pose, &found.pose).into_iter().zip(&told);
        let off: Vec<f64> = off.filter(|(_, told)| **told).map(|(e, _)| e).collect();
        spoilt += usize::from(off.iter().any(|&error| error > 10.0));
        errors.extend(off);
    }
    let (median, most) = (quantile(&mut errors, 0.5), quantile(&mut errors, 0.95));
    println!("median {median} deg, 95 % below {most} deg, {spoilt} of 200 spoilt");
    assert!(median < 0.02 && most < 0.5, "{median} {most}");
    assert!(spoilt <= 10, "{spoilt} of 200");
}

#[test]
fn weights_are_relative() {
    let bed = Bed::new();
    let reference = bed.mean_of_trained_poses();
    let mut s = stream(1, "weights", &[]);
    let settings = Settings {
        starts: 3,
        ..Settings::default()
    };
    for _ in 0..20 {
        let targets = noisy(bed.targets(&bed.trained_pose(&mut s)), &mut s);
        let found = bed.arm.align(&targets, &reference, &settings);
        let mut heavier = targets.clone();
        for target in heavier.iter_mut().flatten() {
            target.weight *= 1024.0;
        }
        assert_eq!(bed.arm.align(&heavier, &reference, &settings), found);

        // But not without effect: a point that weighs more comes closer.
        let mut favoured = targets.clone();
        if let Some(target) = &mut favoured[9] {
            target.weight *= 30.0;
        }
        let favoured = bed.arm.align(&favoured, &reference, &settings);
        assert!(favoured.residuals[9] < found.residuals[9]);
    }
}

#[test]
fn the_order_of_points_does_not_matter() {
    let bed = Bed::new();
    let reference = bed.mean_of_trained_poses();
    let mut s = stream(1, "order", &[]);
    let settings = Settings {
        starts: 3,
        ..Settings::default()
    };
    for _ in 0..20 {
        let targets = noisy(bed.targets(&bed.trained_pose(&mut s)), &mut s);
        let mut order: Vec<usize> = (0..15).collect();
        shuffle(&mut s, &mut order);
        let links: Vec<usize> = order.iter().map(|&i| bed.links[i]).collect();
        let shuffled: Vec<_> = order.iter().map(|&i| targets[i]).collect();
        let arm = VirtualArm::new(&bed.rig.robot, &bed.joints, &links);
        let a = bed.arm.align(&targets, &reference, &settings);
        let b = arm.align(&shuffled, &reference, &settings);
        for (a, b) in a.pose.iter().zip(&b.pose) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
    }
}

#[test]
fn the_same_bits_come_out_again() {
    let reference = Bed::new().mean_of_trained_poses();
    let run = || {
        let bed = Bed::new();
        let mut s = stream(1, "bits", &[]);
        let align = |_| {
            let targets = noisy(bed.targets(&bed.any_pose(&mut s)), &mut s);
            bed.arm.align(&targets, &reference, &Settings::default())
        };
        (0..5).map(align).collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

/// Points on the last axis of the wrist do not tell how far it is turned; nor does a joint's own
/// origin tell its value. The spread and the bent fingers are told through what they drive.
#[test]
fn what_points_can_tell_is_known() {
    let bed = Bed::new();
    let told = |found: &dyn Fn(usize) -> bool| {
        let found: Vec<bool> = (0..15).map(found).collect();
        let observable = bed.arm.observable(&found).into_iter().zip(NAMES);
        let told = observable.filter(|(yes, _)| *yes).map(|(_, name)| name);
        told.collect::<Vec<_>>()
    };
    assert_eq!(told(&|_| true), NAMES);
    assert_eq!(told(&|_| false), [""; 0]);
    // To the wrist; the point of EB is off its axis, and so is that of WR.
    assert_eq!(told(&|i| i < 7), NAMES[..4]);
    // Without the distal joints the proximal ones are not told.
    let without_distal = |i: usize| ![10, 12, 14].contains(&i);
    assert_eq!(told(&without_distal), NAMES[..9]);
    // The spread moves the proximal joints of two fingers: either is enough, and so is a distal one.
    assert_eq!(told(&|i| without_distal(i) && i != 9), NAMES[..9]);
    assert_eq!(
        told(&|i| without_distal(i) && i != 9 && i != 13),
        NAMES[..7]
    );
    // Without any point of the upper arm the elbow swings freely about the line from shoulder to
    // wrist: only the elbow's angle is told, and what hangs on the hand.
    assert_eq!(
        told(&|i| i != 3 && i != 4),
        [&NAMES[3..4], &NAMES[7..]].concat()
    );

    // With the palm, on the axis of WAA, the wrist's direction is told but not its roll.
    let mut links = bed.links[..7].to_vec();
    links.push(bed.rig.robot.link("R_PALM").unwrap());
    let arm = VirtualArm::new(&bed.rig.robot, &bed.joints, &links);
    let observable = arm.observable(&[true; 8]);
    assert_eq!(observable.iter().filter(|&&yes| yes).count(), 6);
    assert!(observable[..6].iter().all(|&yes| yes));
}

#[test]
fn what_is_not_found_is_reported_and_stays_at_the_reference() {
    let bed = Bed::new();
    let reference = bed.mean_of_trained_poses();
    let mut s = stream(1, "missing", &[]);
    for _ in 0..20 {
        let pose = bed.trained_pose(&mut s);
        let mut targets = noisy(bed.targets(&pose), &mut s);
        targets[7..].fill(None);
        let found = bed.arm.align(&targets, &reference, &Settings::default());
        for (joint, resting) in reference.iter().enumerate() {
            assert_eq!(found.residuals[joint].is_some(), joint < 7);
            assert_eq!(found.observed[joint], joint < 4, "{joint}");
            let off = (found.pose[joint] - resting).abs();
            assert!(joint < 4 || off < 1e-9, "{joint} is off by {off}");
        }
        assert!(angle_error(found.pose[1], pose[1]) < 0.1);
    }
    let nowhere = Target {
        position: Point3::new(0.0, f64::NAN, 0.0),
        weight: 1.0,
    };
    let weightless = Target {
        position: Point3::origin(),
        weight: 0.0,
    };
    for nothing in [None, Some(nowhere), Some(weightless)] {
        let found = bed
            .arm
            .align(&[nothing; 15], &reference, &Settings::default());
        assert_eq!(found.observed, [false; 15]);
        assert_eq!(found.residuals, [None; 15]);
        assert_eq!(found.cost, 0.0);
        assert!(degrees(&found.pose, &reference).iter().all(|&e| e < 1e-9));
    }
}
