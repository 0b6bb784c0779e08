//! The paper's claims and how they fared.

use super::statistics::{Interval, bootstrap_mean};
use super::table::significant;
use crate::random::Stream;
use serde::{Deserialize, Serialize};

/// A statement of the paper, as a study file gives it. `T` is what the study kind needs to test it.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Claim<T> {
    /// Unique within the study.
    pub id: String,
    /// The paper's own words.
    pub quote: String,
    /// Section, page or exhibit of the paper.
    #[serde(rename = "where")]
    pub place: String,
    /// What is claimed: "order", "number", "trend", ...
    pub kind: String,
    /// What the paper says, in a word or a number.
    pub paper: Scalar,
    /// Absent when nothing in this project can test the claim.
    pub test: Option<T>,
    /// Why there is no test.
    #[serde(default)]
    pub untested: Option<String>,
}

/// A number or words.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(untagged)]
pub enum Scalar {
    Number(f64),
    Text(String),
}

impl From<f64> for Scalar {
    fn from(number: f64) -> Scalar {
        Scalar::Number(number)
    }
}

impl From<String> for Scalar {
    fn from(text: String) -> Scalar {
        Scalar::Text(text)
    }
}

impl From<&str> for Scalar {
    fn from(text: &str) -> Scalar {
        Scalar::Text(text.to_owned())
    }
}

impl std::fmt::Display for Scalar {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Scalar::Number(number) => f.write_str(&significant(*number, 4)),
            Scalar::Text(text) => f.write_str(text),
        }
    }
}

/// From good to bad: the verdict on several things together is their maximum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    Reproduced,
    Partly,
    Not,
    NotCheckable,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Verdict::Reproduced => "reproduced",
            Verdict::Partly => "partly",
            Verdict::Not => "not",
            Verdict::NotCheckable => "not-checkable",
        })
    }
}

/// An entry of `claims.json`.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct ClaimResult {
    pub id: String,
    pub quote: String,
    #[serde(rename = "where")]
    pub place: String,
    pub kind: String,
    pub paper: Scalar,
    pub ours: Scalar,
    /// How many images, folds, ... the verdict rests on.
    pub n: u64,
    pub verdict: Verdict,
}

impl<T> Claim<T> {
    /// What was found, `ours`, on `n` things (mostly images), and what follows. Numbers are rounded to six digits.
    pub fn result(&self, ours: impl Into<Scalar>, n: usize, verdict: Verdict) -> ClaimResult {
        let mut ours = ours.into();
        if let Scalar::Number(number) = ours {
            // As many digits as in the tables; JSON has no NaN.
            let rounded = significant(number, 6);
            ours = match rounded.parse() {
                Ok(number) if f64::is_finite(number) => Scalar::Number(number),
                _ => Scalar::Text(rounded),
            };
        }
        ClaimResult {
            id: self.id.clone(),
            quote: self.quote.clone(),
            place: self.place.clone(),
            kind: self.kind.clone(),
            paper: self.paper.clone(),
            ours,
            n: n as u64,
            verdict,
        }
    }

    /// The result of a claim without a test.
    pub fn without_test(&self) -> ClaimResult {
        let reason = self.untested.as_deref();
        self.not_checkable(reason.unwrap_or("nothing here can test it"))
    }

    /// The result of a claim that cannot be tested here, with the reason.
    pub fn not_checkable(&self, reason: &str) -> ClaimResult {
        self.result(reason, 0, Verdict::NotCheckable)
    }
}

impl Verdict {
    /// What is claimed to lie between `low` and `high` is *reproduced* when its 95 % interval does,
    /// *partly* when only its mean does, else *not*.
    pub fn of(interval: &Interval, low: f64, high: f64) -> Verdict {
        if low < interval.low && interval.high < high {
            Verdict::Reproduced
        } else if low < interval.mean && interval.mean < high {
            Verdict::Partly
        } else {
            Verdict::Not
        }
    }
}

/// The 95 % bootstrap interval of the mean of `a - b`, pair by pair (one pair for each image).
/// Panics when the lengths differ.
pub fn difference(a: &[f64], b: &[f64], stream: &mut Stream) -> Interval {
    assert_eq!(a.len(), b.len(), "differences need pairs");
    let differences: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
    bootstrap_mean(&differences, stream)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{normal, stream};

    #[test]
    fn verdicts_rest_on_paired_differences() {
        let mut s = stream(1, "order-test", &[]);
        let base: Vec<f64> = (0..100).map(|_| 40.0 + 10.0 * normal(&mut s)).collect();
        let above = |by: f64| -> Vec<f64> {
            let mut noise = stream(2, "order-noise", &[]);
            base.iter().map(|b| b + by + normal(&mut noise)).collect()
        };
        let offset = difference(&above(0.0), &base, &mut s).mean;
        let mut gap = |by: f64| difference(&above(by - offset), &base, &mut s);
        // Noise of the difference is 1, of its mean 0.1, although the values themselves vary by 10.
        let mut judge = |by: f64, low: f64, high: f64| Verdict::of(&gap(by), low, high);
        assert_eq!(judge(0.5, 0.0, f64::INFINITY), Verdict::Reproduced);
        assert_eq!(judge(0.05, 0.0, f64::INFINITY), Verdict::Partly);
        assert_eq!(judge(-0.05, 0.0, f64::INFINITY), Verdict::Not);
        assert_eq!(judge(0.1, -0.5, 0.5), Verdict::Reproduced);
        assert_eq!(judge(0.45, -0.5, 0.5), Verdict::Partly);
        assert_eq!(judge(0.55, -0.5, 0.5), Verdict::Not);
        assert!((gap(0.5).mean - 0.5).abs() < 1e-9);
    }

    #[test]
    fn the_json_of_a_result_is_golden() {
        let text = "id = 'a'\nquote = 'q'\nwhere = 'V-A'\nkind = 'order'\npaper = 'MSE < WSC'";
        let claim: Claim<bool> = toml::from_str(text).unwrap();
        assert_eq!(
            serde_json::to_string(&claim.result(1.0 / 3.0, 200, Verdict::Reproduced)).unwrap(),
            r#"{"id":"a","quote":"q","where":"V-A","kind":"order","paper":"MSE < WSC","ours":0.333333,"n":200,"verdict":"reproduced"}"#
        );
        let untested = serde_json::to_string(&claim.not_checkable("no numbers")).unwrap();
        assert!(untested.ends_with(r#""ours":"no numbers","n":0,"verdict":"not-checkable"}"#));
    }
}
