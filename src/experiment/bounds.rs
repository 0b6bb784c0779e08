//! Bounds: what numbers of our own results may be, held by `armpose check`. Claims compare with the
//! paper, bounds with ourselves.

use super::statistics::{mean, standard_deviation};
use super::study::BoundedColumns;
use super::table::significant;
use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A number lies within `margin` of `centre`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Bound {
    pub centre: f64,
    pub margin: f64,
}

impl Bound {
    /// Half a unit of the sixth digit, to which both sides are rounded, is forgiven.
    pub fn holds(&self, value: f64) -> bool {
        (value - self.centre).abs() <= self.margin + 1e-5 * (self.centre.abs() + self.margin)
    }
}

/// The bounds of a study by the names of its [`values`].
pub type StudyBounds = BTreeMap<String, Bound>;

/// Where the bounds of a profile stand.
pub fn file(root: &Path, profile: &str) -> PathBuf {
    root.join("tests/bounds").join(format!("{profile}.toml"))
}

/// The bounded numbers of a `summary.csv`, named by the cells of the key columns and the number's
/// column: `mse.error_deg`.
pub fn values(summary: &Path, bounded: &BoundedColumns) -> Result<BTreeMap<String, f64>> {
    let unreadable = || format!("cannot read {}", summary.display());
    let mut reader = csv::Reader::from_path(summary).with_context(unreadable)?;
    let headers = reader.headers().with_context(unreadable)?.clone();
    let position = |name: &String| {
        let found = headers.iter().position(|h| h == name);
        found.with_context(|| format!("{} has no column {name}", summary.display()))
    };
    let keys: Vec<usize> = bounded.key.iter().map(position).collect::<Result<_>>()?;
    let columns: Vec<usize> = bounded
        .columns
        .iter()
        .map(position)
        .collect::<Result<_>>()?;
    let mut values = BTreeMap::new();
    for record in reader.records() {
        let record = record.with_context(unreadable)?;
        let cell = |column: usize| record.get(column).unwrap_or_default();
        for &column in columns.iter().filter(|&&c| !cell(c).is_empty()) {
            let parts = keys.iter().map(|&k| cell(k)).chain([&headers[column]]);
            let name = parts.collect::<Vec<_>>().join(".");
            let text = cell(column);
            let value = text
                .parse()
                .with_context(|| format!("{name}: `{text}` is no number"))?;
            if values.insert(name.clone(), value).is_some() {
                bail!(
                    "{} has two rows named {name}; add a key column",
                    summary.display()
                );
            }
        }
    }
    Ok(values)
}

/// Bounds from the same study run with several seeds: the mean, and four standard deviations.
pub fn calibrate(runs: &[BTreeMap<String, f64>]) -> Result<StudyBounds> {
    const DEVIATIONS: f64 = 4.0;
    let Some(first) = runs.first() else {
        bail!("bounds need at least one run");
    };
    let mut bounds = StudyBounds::new();
    for name in first.keys() {
        let drawn: Vec<f64> = runs
            .iter()
            .filter_map(|run| run.get(name))
            .copied()
            .collect();
        ensure!(
            drawn.len() == runs.len() && drawn.iter().all(|v| v.is_finite()),
            "{name} is not a number in every run, so it cannot be bounded"
        );
        let bound = Bound {
            centre: rounded(mean(&drawn)),
            margin: rounded(DEVIATIONS * standard_deviation(&drawn)),
        };
        bounds.insert(name.clone(), bound);
    }
    Ok(bounds)
}

/// To six digits.
fn rounded(x: f64) -> f64 {
    significant(x, 6).parse().unwrap_or(x)
}

/// Bounds from one run that took too long to be repeated with other seeds: each number, give or take a
/// hundredth of it. The same seed gives the same number, to the last bit on a machine of the same kind; the
/// margin is for others, which round differently.
pub fn around(run: &BTreeMap<String, f64>) -> Result<StudyBounds> {
    const TOLERANCE: f64 = 0.01;
    let mut bounds = calibrate(std::slice::from_ref(run))?;
    for bound in bounds.values_mut() {
        bound.margin = rounded(TOLERANCE * bound.centre.abs());
    }
    Ok(bounds)
}

/// One line for each bound and each value, and whether all bounds hold. A value without a bound and
/// a bound without a value are failures: the file of bounds is out of date.
pub fn judge(id: &str, bounds: &StudyBounds, values: &BTreeMap<String, f64>) -> (String, bool) {
    let mut text = String::new();
    let mut all_hold = true;
    let mut names: Vec<&String> = bounds.keys().chain(values.keys()).collect();
    names.sort();
    names.dedup();
    for name in names {
        let (line, holds) = match (values.get(name), bounds.get(name)) {
            (Some(&value), Some(bound)) => {
                let holds = bound.holds(value);
                let relation = if holds { "within" } else { "OUTSIDE" };
                let [value, centre, margin] =
                    [value, bound.centre, bound.margin].map(|x| significant(x, 4));
                (format!("{value} {relation} {centre} +- {margin}"), holds)
            }
            (Some(_), None) => ("has no bound; run `armpose bounds`".to_owned(), false),
            (None, _) => ("is bounded but not in the results".to_owned(), false),
        };
        text.push_str(&format!("{id} {name} {line}\n"));
        all_hold &= holds;
    }
    (text, all_hold)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_calibrated_on_runs_hold_them_and_not_more() {
        let runs: Vec<_> = (0..12)
            .map(|i| {
                BTreeMap::from([
                    ("a".to_owned(), 40.0 + f64::from(i % 3)),
                    ("b".to_owned(), 7.0),
                ])
            })
            .collect();
        let bounds = calibrate(&runs).unwrap();
        // Values 40, 41, 42 four times each: variance 8 / 11.
        let margin = 4.0 * (8.0_f64 / 11.0).sqrt();
        assert!((bounds["a"].margin - margin).abs() < 1e-4 && bounds["a"].centre == 41.0);
        assert_eq!(
            bounds["b"],
            Bound {
                centre: 7.0,
                margin: 0.0
            }
        );
        assert!(runs.iter().all(|run| judge("s", &bounds, run).1));

        let mut off = runs[0].clone();
        off.insert("a".to_owned(), 45.0);
        let (text, holds) = judge("fig9", &bounds, &off);
        assert!(!holds);
        assert_eq!(
            text,
            "fig9 a 45 OUTSIDE 41 +- 3.411\nfig9 b 7 within 7 +- 0\n"
        );
        off.remove("b");
        off.insert("c".to_owned(), 1.0);
        let (text, holds) = judge("fig9", &bounds, &off);
        assert!(!holds && text.contains("b is bounded but not") && text.contains("c has no bound"));
    }

    #[test]
    fn bounds_around_a_run_hold_it_and_what_rounds_like_it() {
        let run = |a: f64, b: f64| BTreeMap::from([("a".to_owned(), a), ("b".to_owned(), b)]);
        let bounds = around(&run(-20.0, 0.0)).unwrap();
        assert!(judge("s", &bounds, &run(-20.19, 0.0)).1);
        assert!(!judge("s", &bounds, &run(-20.21, 0.0)).1);
        assert!(!judge("s", &bounds, &run(-20.0, 0.001)).1);
        assert!(around(&run(f64::NAN, 0.0)).is_err());
    }

    #[test]
    fn values_are_named_by_key_and_column() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("summary.csv");
        std::fs::write(
            &path,
            "objective,sf,error_deg,n\nmse,no,40.5,7\nwsc,no,,7\n",
        )
        .unwrap();
        let bounded = |key: &[&str], columns: &[&str]| BoundedColumns {
            key: key.iter().map(|&k| k.to_owned()).collect(),
            columns: columns.iter().map(|&c| c.to_owned()).collect(),
        };
        let found = values(&path, &bounded(&["objective", "sf"], &["error_deg", "n"])).unwrap();
        let expected = [
            ("mse.no.error_deg", 40.5),
            ("mse.no.n", 7.0),
            ("wsc.no.n", 7.0),
        ];
        assert_eq!(
            found,
            expected
                .map(|(name, value)| (name.to_owned(), value))
                .into()
        );
        let error = |bounded| values(&path, &bounded).unwrap_err().to_string();
        assert!(error(bounded(&["sf"], &["n"])).contains("two rows named no.n"));
        assert!(error(bounded(&["x"], &["n"])).contains("has no column x"));
        assert!(error(bounded(&["sf"], &["objective"])).contains("`mse` is no number"));
    }
}
