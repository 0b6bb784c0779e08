//! What the study files and the committed results say of each other.

use armpose::estimator::segmentation::LEAST_ARM_PIXELS;
use armpose::experiment::report;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn study(id: &str) -> toml::Table {
    let text = std::fs::read_to_string(root().join(format!("experiments/{id}.toml"))).unwrap();
    text.parse().unwrap()
}

/// The forests of the studies have the leaf size and the features per node that the one-standard-
/// error rule chose in the committed tuning.
#[test]
fn studies_use_what_tuning_chose() {
    let summary = root().join("results/paper/tuning/summary.csv");
    let mut reader = csv::Reader::from_path(summary).unwrap();
    let columns = reader.headers().unwrap().clone();
    let column = |name: &str| columns.iter().position(|c| c == name).unwrap();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let chosen: Vec<_> = rows
        .iter()
        .filter(|r| &r[column("role")] == "chosen")
        .collect();
    assert_eq!(chosen.len(), 1);
    for id in ["fig9", "tuning", "uniform", "variants"] {
        let study = study(id);
        let forest = &study["parameters"]["protocol"]["training"]["forest"];
        for name in ["min_leaf", "features_per_node", "trees"] {
            assert_eq!(
                forest[name].to_string(),
                chosen[0][column(name)],
                "{id}: {name}"
            );
        }
    }
}

/// The tuned baseline has, of every sweep, what was chosen in the committed tuning.
#[test]
fn the_baseline_has_what_tuning_chose() {
    let summary = root().join("results/paper/tuning_parts/summary.csv");
    let mut reader = csv::Reader::from_path(summary).unwrap();
    let columns = reader.headers().unwrap().clone();
    let column = |name: &str| columns.iter().position(|c| c == name).unwrap();
    let rows = reader.records().map(Result::unwrap);
    let chosen: Vec<_> = rows.filter(|r| &r[column("role")] == "chosen").collect();
    let baseline = std::fs::read_to_string(root().join("data/baselines/tuned.toml")).unwrap();
    let baseline: toml::Table = baseline.parse().unwrap();
    let mut sweeps = Vec::new();
    for row in &chosen {
        let (place, names): (_, &[_]) = match &row[column("sweep")] {
            "grid" => ("forest", &["min_leaf", "features_per_node"]),
            "longest" => ("votes", &["longest_m"]),
            "heaviest" => ("votes", &["heaviest"]),
            "bandwidth" => ("votes", &["bandwidth_m"]),
            "prior" => ("alignment", &["prior"]),
            other => panic!("sweep {other}"),
        };
        for &name in names {
            let number = |text: &str| text.parse::<f64>().unwrap();
            let ours = number(&baseline[place][name].to_string());
            assert_eq!(ours, number(&row[column(name)]), "{name}");
        }
        sweeps.push(place);
    }
    assert_eq!(sweeps.len(), 5);
}

/// Every study has committed results at the paper's scale, with a verdict on each of its claims.
#[test]
fn every_study_has_its_results_and_verdicts() {
    for entry in std::fs::read_dir(root().join("experiments")).unwrap() {
        let file = entry.unwrap().path();
        let id = file.file_stem().unwrap().to_str().unwrap().to_owned();
        let results = root().join("results/paper").join(&id);
        let files = ["data.csv", "summary.csv", "claims.json", "manifest.json"];
        let figures = [format!("{id}.svg"), format!("{id}.png")];
        for name in files.map(str::to_owned).iter().chain(&figures) {
            assert!(results.join(name).is_file(), "{id} has no {name}");
        }
        let verdicts: Vec<serde_json::Value> =
            serde_json::from_str(&std::fs::read_to_string(results.join("claims.json")).unwrap())
                .unwrap();
        let told: Vec<&str> = verdicts.iter().map(|v| v["id"].as_str().unwrap()).collect();
        let study = study(&id);
        let claims = study.get("claim").and_then(|claims| claims.as_array());
        let claims = claims.into_iter().flatten();
        let asked: Vec<&str> = claims.map(|c| c["id"].as_str().unwrap()).collect();
        assert_eq!(told, asked, "{id}");
    }
}

/// Manifests name the program, not where it stood on somebody's machine.
#[test]
fn manifests_hold_no_absolute_path_of_the_program() {
    for entry in std::fs::read_dir(root().join("results/paper")).unwrap() {
        let file = entry.unwrap().path().join("manifest.json");
        let manifest: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
        let program = Path::new(manifest["command"][0].as_str().unwrap());
        assert!(program.is_relative(), "{}", file.display());
    }
}

/// REPRODUCE.md says what the committed results say.
#[test]
fn the_report_is_up_to_date() {
    let text = std::fs::read_to_string(report::file(&root())).unwrap();
    assert!(
        text == report::refreshed(&root()).unwrap(),
        "run `cargo run -- report`"
    );
}

#[test]
fn tracked_results_are_small() {
    fn bytes(path: &Path) -> u64 {
        let Ok(entries) = std::fs::read_dir(path) else {
            return path.metadata().unwrap().len();
        };
        entries.map(|e| bytes(&e.unwrap().path())).sum()
    }
    let size = bytes(&root().join("results/paper"));
    assert!(size < 24_000_000, "{size} bytes");
}

/// By the number of pixels that surely show it, images that hardly show the right arm are told from
/// those that do: on the committed test of the segmentation forest.
#[test]
fn an_image_without_the_arm_is_told_from_one_with_it() {
    let data = root().join("results/paper/table1/data.csv");
    let mut reader = csv::Reader::from_path(data).unwrap();
    let columns = reader.headers().unwrap().clone();
    let column = |name: &str| columns.iter().position(|c| c == name).unwrap();
    let (class, sure) = (column("class"), column("sure_px"));
    let rows = reader.records().map(Result::unwrap);
    let images: Vec<(usize, usize)> = rows
        .filter(|row| &row[class] == "right arm")
        .map(|row| {
            let pixels = |at: usize| row[at].parse::<usize>().unwrap();
            ((sure + 1..row.len()).map(pixels).sum(), pixels(sure))
        })
        .collect();
    let seen = |is_meant: &dyn Fn(usize) -> bool| {
        let meant = images.iter().filter(|(visible, _)| is_meant(*visible));
        let seen: Vec<bool> = meant.map(|(_, n)| *n >= LEAST_ARM_PIXELS).collect();
        assert!(seen.len() >= 10);
        seen.iter().filter(|&&seen| seen).count() as f64 / seen.len() as f64
    };
    let balanced = (seen(&|visible| visible > 1000) + 1.0 - seen(&|visible| visible < 50)) / 2.0;
    assert!(balanced >= 0.95, "{balanced}");
}

/// Given true parts and true votes, the baseline's later stages recover the joints that positions can
/// tell: on the committed comparison.
#[test]
fn true_votes_recover_the_arm() {
    let summary = root().join("results/paper/fig11a/summary.csv");
    let mut reader = csv::Reader::from_path(summary).unwrap();
    let columns = reader.headers().unwrap().clone();
    let cell = |row: &csv::StringRecord, name: &str| {
        row[columns.iter().position(|c| c == name).unwrap()].to_owned()
    };
    let oracle = reader.records().map(Result::unwrap).find(|row| {
        cell(row, "method") == "part-baseline-oracle"
            && cell(row, "shown") == "all"
            && cell(row, "measure") == "observable joints"
    });
    let oracle = oracle.unwrap();
    assert!(cell(&oracle, "median_image").parse::<f64>().unwrap() < 1.0);
    assert!(cell(&oracle, "images").parse::<usize>().unwrap() > 100);
}
