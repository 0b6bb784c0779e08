//! The mistakes of `scripts/plant_faults.py` can still be made, and were caught when they last were.

use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Faults {
    fault: Vec<Fault>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Fault {
    name: String,
    what: String,
    file: String,
    first: Option<String>,
    edits: Vec<[String; 2]>,
}

fn faults() -> Vec<Fault> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(root.join("scripts/faults.toml")).unwrap();
    toml::from_str::<Faults>(&text).unwrap().fault
}

/// Whoever rewrites a line with a fault moves the fault along, in `scripts/faults.toml`.
#[test]
fn every_fault_can_be_planted() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for fault in faults() {
        let text = fs::read_to_string(root.join(&fault.file)).unwrap();
        assert!(!fault.edits.is_empty());
        if let Some(first) = &fault.first {
            assert!(root.join(format!("tests/{first}.rs")).is_file(), "{first}");
        }
        for [old, new] in &fault.edits {
            let times = text.matches(old).count();
            let Fault { name, file, .. } = &fault;
            assert_eq!(times, 1, "{name}: how often {file} has\n{old}");
            assert_ne!(old, new);
        }
    }
}

/// The table has what was caught, and by what; a fault that is new has no row until the script is run.
#[test]
fn no_fault_escaped() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut reader = csv::Reader::from_path(root.join("results/faults.csv")).unwrap();
    let faults = faults();
    let mut caught = 0;
    for row in reader.deserialize::<BTreeMap<String, String>>() {
        let row = row.unwrap();
        let name = &row["fault"];
        let fault = faults.iter().find(|fault| fault.name == *name);
        let fault = fault.unwrap_or_else(|| panic!("{name} is no longer a fault"));
        assert!(!row["caught_by"].is_empty(), "{name} escaped");
        assert_eq!((&row["what"], &row["file"]), (&fault.what, &fault.file));
        caught += 1;
    }
    assert!(caught >= 8);
}
