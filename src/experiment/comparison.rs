//! The numbers of a study's results, to be compared with those of other runs: for `armpose diff`, and for
//! the spread over seeds.

use super::statistics::{mean, standard_deviation};
use super::table::{Table, significant};
use super::task::read_json;
use anyhow::{Context, Result};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// The numbers of a `summary.csv`, by row and column. A row is named by its cells that are no numbers and,
/// where several have the same name, by how many of them stand above it. In the order of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers(Vec<((String, String), f64)>);

impl Numbers {
    /// Those of a `summary.csv`. Fails when it cannot be read.
    pub fn read(summary: &Path) -> Result<Numbers> {
        let unreadable = || format!("cannot read {}", summary.display());
        let mut reader = csv::Reader::from_path(summary).with_context(unreadable)?;
        let columns = reader.headers().with_context(unreadable)?.clone();
        let mut rows: BTreeMap<String, usize> = BTreeMap::new();
        let mut numbers = Vec::new();
        for record in reader.records() {
            let record = record.with_context(unreadable)?;
            let number = |cell: &str| cell.parse::<f64>().ok();
            let words = record
                .iter()
                .filter(|cell| number(cell).is_none() && !cell.is_empty());
            let mut row = words.collect::<Vec<_>>().join(" / ");
            let above = rows.entry(row.clone()).or_default();
            *above += 1;
            if *above > 1 {
                write!(row, " #{above}")?;
            }
            for (column, cell) in columns.iter().zip(&record) {
                if let Some(number) = number(cell) {
                    numbers.push(((row.clone(), column.to_owned()), number));
                }
            }
        }
        Ok(Numbers(numbers))
    }

    fn get(&self, name: &(String, String)) -> Option<f64> {
        let found = self.0.iter().find(|(known, _)| known == name);
        found.map(|&(_, number)| number)
    }
}

/// The mean, the standard deviation and the extremes of every number over several runs of a study. Numbers
/// that not all runs have are left out.
pub fn spread(runs: &[Numbers]) -> Table {
    let mut table = Table::new(["row", "column", "runs", "mean", "sd", "least", "most"]);
    let names = runs.first().map_or(&[][..], |first| &first.0);
    for (name, _) in names {
        let values: Vec<f64> = runs.iter().filter_map(|run| run.get(name)).collect();
        if values.len() < runs.len() {
            continue;
        }
        let extreme = |pick: fn(f64, f64) -> f64| values.iter().copied().fold(f64::NAN, pick);
        table.push([
            name.0.as_str().into(),
            name.1.as_str().into(),
            values.len().into(),
            mean(&values).into(),
            standard_deviation(&values).into(),
            extreme(f64::min).into(),
            extreme(f64::max).into(),
        ]);
    }
    table
}

/// How the results of a study in the folder `new` differ from those in `old`: a line for each parameter,
/// part of the program and number that does. Empty when all result files are the same to the last bit.
pub fn differences(old: &Path, new: &Path) -> Result<Vec<String>> {
    let (old_manifest, new_manifest) = (manifest(old)?, manifest(new)?);
    let hashes = |manifest: &Value| -> BTreeMap<String, String> {
        let outputs = manifest["outputs"].as_array().into_iter().flatten();
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        outputs
            .map(|o| (text(&o["name"]), text(&o["blake3"])))
            .collect()
    };
    let (old_files, new_files) = (hashes(&old_manifest), hashes(&new_manifest));
    if old_files == new_files {
        return Ok(Vec::new());
    }
    let mut lines = Vec::new();
    for place in [
        "/profile",
        "/seed",
        "/study/parameters",
        "/machine/git_revision",
        "/machine/cargo_lock_blake3",
        "/machine/rustc",
        "/machine/cpu",
    ] {
        let of = |manifest: &Value| flat(manifest.pointer(place).unwrap_or(&Value::Null));
        compare(
            place.trim_start_matches('/'),
            &of(&old_manifest),
            &of(&new_manifest),
            &mut lines,
        );
    }
    let (old_numbers, new_numbers) = (
        Numbers::read(&old.join("summary.csv"))?,
        Numbers::read(&new.join("summary.csv"))?,
    );
    for (name, was) in &old_numbers.0 {
        let (row, column) = name;
        match new_numbers.get(name) {
            Some(is) if is == *was || (is.is_nan() && was.is_nan()) => {}
            Some(is) => {
                let [was_shown, is_shown] = [*was, is].map(|x| significant(x, 6));
                let change = significant(is - was, 3);
                lines.push(format!(
                    "{row}: {column} {was_shown} -> {is_shown} ({change})"
                ));
            }
            None => lines.push(format!("{row}: {column} is gone")),
        }
    }
    for (name @ (row, column), is) in &new_numbers.0 {
        if old_numbers.get(name).is_none() {
            lines.push(format!("{row}: {column} {} is new", significant(*is, 6)));
        }
    }
    for name in old_files.keys().chain(new_files.keys()) {
        let line = match (old_files.get(name), new_files.get(name)) {
            (Some(was), Some(is)) if was == is => continue,
            (Some(_), Some(_)) => format!("{name} changed"),
            (None, _) => format!("{name} is new"),
            (_, None) => format!("{name} is gone"),
        };
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    Ok(lines)
}

fn manifest(folder: &Path) -> Result<Value> {
    read_json(&folder.join("manifest.json"))
}

/// Names and values at the ends of a tree of objects.
fn flat(value: &Value) -> BTreeMap<String, String> {
    match value {
        Value::Object(members) => {
            let below = members.iter().flat_map(|(name, value)| {
                flat(value)
                    .into_iter()
                    .map(move |(rest, value)| match rest.is_empty() {
                        true => (name.clone(), value),
                        false => (format!("{name}.{rest}"), value),
                    })
            });
            below.collect()
        }
        end => BTreeMap::from([(String::new(), end.to_string())]),
    }
}

fn compare(
    place: &str,
    old: &BTreeMap<String, String>,
    new: &BTreeMap<String, String>,
    lines: &mut Vec<String>,
) {
    let mut names: Vec<&String> = old.keys().chain(new.keys()).collect();
    names.sort();
    names.dedup();
    for name in names {
        let nothing = "nothing".to_owned();
        let (was, is) = (
            old.get(name).unwrap_or(&nothing),
            new.get(name).unwrap_or(&nothing),
        );
        if was != is {
            let dot = if name.is_empty() { "" } else { "." };
            lines.push(format!("{place}{dot}{name} {was} -> {is}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::fs;

    fn results(folder: &Path, images: usize, summary: &str) {
        fs::create_dir_all(folder).unwrap();
        fs::write(folder.join("summary.csv"), summary).unwrap();
        let manifest = json!({
            "seed": 1,
            "study": { "parameters": { "protocol": { "images": images } } },
            "outputs": [{ "name": "summary.csv", "blake3": summary }],
        });
        fs::write(folder.join("manifest.json"), manifest.to_string()).unwrap();
    }

    #[test]
    fn rows_are_named_by_their_words() {
        let folder = tempfile::tempdir().unwrap();
        let text = "method,n,kind,error\nmse,3,a,1.5\nmse,4,a,\nmspd,3,b,NaN\n";
        results(folder.path(), 1, text);
        let numbers = Numbers::read(&folder.path().join("summary.csv")).unwrap();
        let of = |row: &str, column: &str| numbers.get(&(row.to_owned(), column.to_owned()));
        assert_eq!(of("mse / a", "error"), Some(1.5));
        assert_eq!(of("mse / a #2", "n"), Some(4.0));
        assert_eq!(of("mse / a #2", "error"), None);
        assert_eq!(of("mspd / b", "n"), Some(3.0));
    }

    #[test]
    fn differences_are_told_one_by_one() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a"), folder.path().join("b"));
        results(&a, 20, "method,error\nmse,1.5\nmspd,2\n");
        results(&b, 20, "method,error\nmse,1.5\nmspd,2\n");
        assert!(differences(&a, &b).unwrap().is_empty());
        results(&b, 30, "method,error\nmse,1.25\nkpca,3\n");
        assert_eq!(
            differences(&a, &b).unwrap(),
            [
                "study/parameters.protocol.images 20 -> 30",
                "mse: error 1.5 -> 1.25 (-0.25)",
                "mspd: error is gone",
                "kpca: error 3 is new",
                "summary.csv changed",
            ]
        );
        fs::remove_file(b.join("manifest.json")).unwrap();
        assert!(differences(&a, &b).is_err());
    }

    #[test]
    fn the_spread_of_runs() {
        let folder = tempfile::tempdir().unwrap();
        let run = |name: &str, error: f64| {
            let folder = folder.path().join(name);
            results(
                &folder,
                1,
                &format!("method,error,rest\nmse,{error},{name}\n"),
            );
            Numbers::read(&folder.join("summary.csv")).unwrap()
        };
        // The last column is a word, by which rows are named: so it must be the same.
        let table = spread(&[run("x", 1.0), run("x", 3.0)]);
        assert_eq!(
            String::from_utf8(table.to_csv()).unwrap(),
            "row,column,runs,mean,sd,least,most\nmse / x,error,2,2,1.41421,1,3\n"
        );
        assert!(spread(&[run("x", 1.0), run("y", 3.0)]).rows.is_empty());
    }
}
