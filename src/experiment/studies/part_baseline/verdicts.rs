//! What the comparison says of the paper's claims.

use super::angles::{Angles, Method};
use crate::experiment::claims::{Claim, ClaimResult, Verdict, difference};
use crate::experiment::statistics::{bootstrap, mean};
use crate::experiment::studies::cross_validation::verdicts::worst_show_little;
use crate::random::stream;
use anyhow::{Context, Result};
use serde::Deserialize;

/// How a claim is tested. Errors are mean joint errors, compared image by image.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// The error of the first is below that of each of the others.
    Order {
        smaller: String,
        larger: Vec<String>,
    },
    /// The joints' positions are found more precisely by the first than by the second.
    NearerJoints { smaller: String, larger: String },
    /// What images that hardly show the arm add to the error is more with the first than with the
    /// second.
    MoreAffected { more: String, less: String },
    /// Of the tenth of images with the largest errors, more than half are among the fifth that
    /// shows the least of the arm.
    WorstShowLittle { method: String },
}

impl Angles {
    pub(super) fn judge(&self, claim: &Claim<Test>, methods: &[Method]) -> Result<ClaimResult> {
        let Some(test) = &claim.test else {
            return Ok(claim.without_test());
        };
        let find = |id: &str| {
            let method = methods.iter().find(|method| method.id == id);
            method.with_context(|| format!("there is no method {id}"))
        };
        let all = |method: &Method| -> Vec<f64> {
            method.images.iter().map(|t| t.error.all_deg).collect()
        };
        let mut random = stream(self.specification.seed, "claim", &[]);
        Ok(match test {
            Test::Order { smaller, larger } => {
                let least = find(smaller)?;
                let mut worst = Verdict::Reproduced;
                let mut ours = Vec::new();
                for id in larger {
                    let gap = difference(&all(find(id)?), &all(least), &mut random);
                    worst = worst.max(Verdict::of(&gap, 0.0, f64::INFINITY));
                    ours.push(format!(
                        "{id} - {smaller} = {:.2} deg ({:.2} to {:.2})",
                        gap.mean, gap.low, gap.high
                    ));
                }
                let ours = format!("{}; 95 % intervals", ours.join("; "));
                claim.result(ours, least.images.len(), worst)
            }
            Test::NearerJoints { smaller, larger } => {
                let (least, most) = (find(smaller)?, find(larger)?);
                let pairs = most.images.iter().zip(&least.images);
                let off = pairs.map(|(most, least)| (most.off_m(), least.off_m()));
                let off: Vec<(f64, f64)> = off
                    .filter(|(most, least)| !most.is_nan() && !least.is_nan())
                    .collect();
                let (most, least): (Vec<f64>, Vec<f64>) = off.into_iter().unzip();
                let gap = difference(&most, &least, &mut random);
                let ours = format!(
                    "{larger}: {:.3} m, {smaller}: {:.3} m, difference {:.3} m (95 % interval {:.3} \
                     to {:.3})",
                    mean(&most),
                    mean(&least),
                    gap.mean,
                    gap.low,
                    gap.high
                );
                claim.result(ours, most.len(), Verdict::of(&gap, 0.0, f64::INFINITY))
            }
            Test::MoreAffected { more, less } => {
                let (more_affected, less_affected) = (find(more)?, find(less)?);
                let added = |method: &Method, drawn: &[usize]| {
                    let of = |shown: bool| {
                        let images = drawn.iter().map(|&image| &method.images[image]);
                        let images = images.filter(|tested| self.shows_arm(tested) == shown);
                        mean(
                            &images
                                .map(|tested| tested.error.all_deg)
                                .collect::<Vec<_>>(),
                        )
                    };
                    of(false) - of(true)
                };
                let gap =
                    |drawn: &[usize]| added(more_affected, drawn) - added(less_affected, drawn);
                let images = more_affected.images.len();
                let everything: Vec<usize> = (0..images).collect();
                let gap = bootstrap(images, gap, &mut random);
                let ours = format!(
                    "images that hardly show the arm add {:.2} deg with {more}, {:.2} deg with {less}; \
                     difference {:.2} deg (95 % interval {:.2} to {:.2})",
                    added(more_affected, &everything),
                    added(less_affected, &everything),
                    gap.mean,
                    gap.low,
                    gap.high
                );
                claim.result(ours, images, Verdict::of(&gap, 0.0, f64::INFINITY))
            }
            Test::WorstShowLittle { method } => {
                let method = find(method)?;
                let visible: Vec<f64> = method.images.iter().map(|t| t.visible as f64).collect();
                worst_show_little(claim, &visible, &all(method))
            }
        })
    }
}
