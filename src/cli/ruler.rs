//! How far a pose is from the true one.

use anyhow::{Context, Result};
use armpose::estimator::error::{angle_error, tip_error};
use armpose::experiment::statistics::mean;
use armpose::model::{JointRecord, ModelRecord, Unit};
use armpose::pose_space::disp::Disp;
use armpose::scene::{Arm, Rig};

/// Measures the errors of a pose.
pub struct Ruler<'a> {
    pub record: &'a ModelRecord,
    rig: &'a Rig,
    arm: &'a Arm,
    disp: Disp<'a>,
}

impl<'a> Ruler<'a> {
    pub fn new(record: &'a ModelRecord, rig: &'a Rig) -> Result<Ruler<'a>> {
        let arm = rig.arm(&record.arm).context("the robot lost its arm")?;
        let names: Vec<&str> = record.joints.iter().map(|j| j.name.as_str()).collect();
        Ok(Ruler {
            record,
            rig,
            arm: &rig.arms[arm],
            disp: Disp::new(&rig.robot, &names)?,
        })
    }

    /// The names of what [`Ruler::measure`] measures, each with its unit.
    pub fn columns(&self) -> Vec<String> {
        let joint = |joint: &JointRecord| match joint.unit {
            Unit::Rad => format!("{}_deg", joint.name),
            Unit::M => format!("{}_mm", joint.name),
        };
        let rest = ["all_turning_deg", "tip_mm", "disp_mm"].map(str::to_owned);
        self.record.joints.iter().map(joint).chain(rest).collect()
    }

    /// What [`Ruler::columns`] names, of a pose beside the true one.
    pub fn measure(&self, truth: &[f64], pose: &[f64]) -> Vec<f64> {
        let (mut errors, mut turning) = (Vec::new(), Vec::new());
        for (joint, (&t, &e)) in self.record.joints.iter().zip(truth.iter().zip(pose)) {
            errors.push(match joint.unit {
                Unit::Rad => angle_error(t, e).to_degrees(),
                Unit::M => 1000.0 * (t - e).abs(),
            });
            if joint.unit == Unit::Rad {
                turning.extend(errors.last());
            }
        }
        let Arm { tip, joints, .. } = self.arm;
        errors.push(mean(&turning));
        errors.push(1000.0 * tip_error(&self.rig.robot, *tip, joints, truth, pose));
        errors.push(1000.0 * self.disp.distance(truth, pose));
        errors
    }
}
