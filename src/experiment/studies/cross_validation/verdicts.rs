//! What the comparison says of the paper's claims.

use super::{CrossValidationStudy, Method};
use crate::experiment::claims::{Claim, ClaimResult, Verdict, difference};
use crate::experiment::statistics::{mean, quantile, spearman};
use crate::experiment::tasks::sight::SegmentationKind;
use crate::forest::objective::ObjectiveKind;
use crate::random::stream;
use anyhow::{Context, Result, ensure};
use serde::Deserialize;

/// How a claim is tested. Errors are mean joint errors, compared image by image.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum Test {
    /// The error of each method in `smaller` is below that of `larger`.
    Order {
        smaller: Vec<String>,
        larger: String,
    },
    /// The error of no method in `methods` is below that of `than` by `margin_deg` or more.
    NotBetter {
        methods: Vec<String>,
        than: String,
        margin_deg: f64,
    },
    /// The error of each method in `methods` differs from that of `from` by less than `margin_deg`.
    Equal {
        methods: Vec<String>,
        from: String,
        margin_deg: f64,
    },
    /// Of the tenth of images with the largest errors, more than half are among the fifth that
    /// shows the least of the arm.
    WorstShowLittle { method: String },
    /// In most images most of the chosen pixels are foreground.
    ChosenAreForeground { method: String },
}

impl Test {
    /// All methods that it is about.
    fn methods(&self) -> Vec<&String> {
        match self {
            Test::Order { smaller, larger } => smaller.iter().chain([larger]).collect(),
            Test::NotBetter { methods, than, .. } => methods.iter().chain([than]).collect(),
            Test::Equal { methods, from, .. } => methods.iter().chain([from]).collect(),
            Test::WorstShowLittle { method } | Test::ChosenAreForeground { method } => vec![method],
        }
    }
}

/// Fails when no run could have a method of this name.
pub(super) fn known(id: &str) -> Result<()> {
    let (objective, kind) = id.split_once('/').unwrap_or((id, "none"));
    ensure!(
        ObjectiveKind::named(objective).is_some() && SegmentationKind::named(kind).is_some(),
        "there is no method {id}"
    );
    Ok(())
}

impl CrossValidationStudy {
    pub(super) fn verdicts(&self, methods: &[Method]) -> Result<Vec<ClaimResult>> {
        let judge = |claim: &Claim<Test>| {
            self.verdict(claim, methods)
                .with_context(|| format!("claim {}", claim.id))
        };
        self.specification.claims.iter().map(judge).collect()
    }

    fn verdict(&self, claim: &Claim<Test>, methods: &[Method]) -> Result<ClaimResult> {
        let Some(test) = &claim.test else {
            return Ok(claim.without_test());
        };
        let method = |id: &str| methods.iter().find(|m| m.name() == id);
        if let Some(id) = test.methods().into_iter().find(|id| method(id).is_none()) {
            known(id)?;
            return Ok(claim.not_checkable(&format!("this run is without {id}")));
        }
        let method = |id: &str| method(id).context("looked for above");
        // The error of `reference` less that of each method is claimed to lie in between.
        let compare = |ids: &[String], reference: &str, low: f64, high: f64| {
            let reference = method(reference)?;
            let mut worst = Verdict::Reproduced;
            let mut ours = Vec::new();
            for id in ids {
                let method = method(id)?;
                let mut stream = stream(self.specification.seed, "claim", &[]);
                let mut gap = |measure: fn(&super::Tested) -> f64| {
                    let images = |m: &Method| m.results.iter().map(measure).collect::<Vec<_>>();
                    difference(&images(reference), &images(method), &mut stream)
                };
                let angle = gap(|tested| tested.error.all_deg);
                let disp = gap(|tested| tested.error.disp_m);
                worst = worst.max(Verdict::of(&angle, low, high));
                ours.push(format!(
                    "{} - {id} = {:.2} deg ({:.2} to {:.2}), {:.4} m DISP ({:.4} to {:.4})",
                    reference.name(),
                    angle.mean,
                    angle.low,
                    angle.high,
                    disp.mean,
                    disp.low,
                    disp.high
                ));
            }
            let ours = format!("{}; 95 % intervals", ours.join("; "));
            Ok(claim.result(ours, reference.results.len(), worst))
        };
        match test {
            Test::Order { smaller, larger } => compare(smaller, larger, 0.0, f64::INFINITY),
            Test::NotBetter {
                methods,
                than,
                margin_deg,
            } => compare(methods, than, f64::NEG_INFINITY, *margin_deg),
            Test::Equal {
                methods,
                from,
                margin_deg,
            } => compare(methods, from, -margin_deg, *margin_deg),
            Test::WorstShowLittle { method: id } => {
                let method = method(id)?;
                let visible = method.results.iter().map(|r| r.outcome.visible as f64);
                let visible: Vec<f64> = visible.collect();
                let errors = method.images(|e| e.all_deg);
                Ok(worst_show_little(claim, &visible, &errors))
            }
            Test::ChosenAreForeground { method: id } => {
                Ok(chosen_are_foreground(claim, method(id)?, self.step))
            }
        }
    }
}

/// Whether, of the tenth of images with the largest errors, more than half are among the fifth that
/// shows the least of the arm; `visible` are the pixels of the arm in each image.
pub fn worst_show_little<T>(claim: &Claim<T>, visible: &[f64], errors: &[f64]) -> ClaimResult {
    let mut ascending = visible.to_vec();
    ascending.sort_by(f64::total_cmp);
    let little = quantile(&ascending, 0.2);
    let mut by_error: Vec<usize> = (0..errors.len()).collect();
    by_error.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]));
    let worst = &by_error[..errors.len().div_ceil(10)];
    let share = worst.iter().filter(|&&i| visible[i] <= little).count() as f64 / worst.len() as f64;
    let verdict = match share {
        s if s > 0.5 => Verdict::Reproduced,
        // More than their part of all images.
        s if s > 0.2 => Verdict::Partly,
        _ => Verdict::Not,
    };
    let ours = format!(
        "{:.0} % of the worst tenth are among the fifth with at most {little:.0} pixels of the arm; \
         rank correlation of error and pixels {:.2}",
        100.0 * share,
        spearman(errors, visible)
    );
    claim.result(ours, errors.len(), verdict)
}

fn chosen_are_foreground(claim: &Claim<Test>, method: &Method, step: usize) -> ClaimResult {
    let chosen = method
        .results
        .iter()
        .map(|r| &r.outcome.estimate.thresholds[step]);
    let shares: Vec<f64> = chosen
        .map(|c| c.foreground as f64 / c.pixels as f64)
        .collect();
    let all = method
        .results
        .iter()
        .map(|r| &r.outcome.estimate.thresholds[0]);
    let anyway: Vec<f64> = all.map(|c| c.foreground as f64 / c.pixels as f64).collect();
    let mostly = shares.iter().filter(|&&share| share > 0.5).count() as f64 / shares.len() as f64;
    let verdict = match mostly {
        m if m > 0.5 => Verdict::Reproduced,
        _ if mean(&shares) > mean(&anyway) => Verdict::Partly,
        _ => Verdict::Not,
    };
    let ours = format!(
        "in {:.0} % of the images most chosen pixels are foreground; mean share {:.0} % of the chosen, \
         {:.0} % of all valid pixels",
        100.0 * mostly,
        100.0 * mean(&shares),
        100.0 * mean(&anyway)
    );
    claim.result(ours, shares.len(), verdict)
}
