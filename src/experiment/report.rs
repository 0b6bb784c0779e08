//! REPRODUCE.md: what came out, exhibit by exhibit.
//!
//! The file is written by hand but for the lines between two kinds of markers, which say where in the
//! text each study has its place:
//!
//! ```text
//! <!-- verdicts -->       how the claims of all studies fared, a row for each study
//! <!-- end -->
//! <!-- study fig9 -->     question, figure, claims with verdicts, and analysis of one study
//! <!-- end -->
//! ```

use super::claims::{ClaimResult, Verdict};
use super::study::Profile;
use super::study_file::{self, LoadedStudy, Request};
use anyhow::{Context, Result, bail, ensure};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Where the text stands in the repository `root`.
pub fn file(root: &Path) -> PathBuf {
    root.join("REPRODUCE.md")
}

const VERDICTS: &str = "<!-- verdicts -->";
const STUDY: &str = "<!-- study ";
const END: &str = "<!-- end -->";

/// The text with what stands between markers as the results in `results/paper` have it. Fails when a
/// study has no place in it, or two.
pub fn refreshed(root: &Path) -> Result<String> {
    let path = file(root);
    let old = std::fs::read_to_string(&path)
        .with_context(|| format!("cannot read {}", path.display()))?;
    let request = Request {
        root: root.to_owned(),
        profile: Profile::Paper,
        overrides: Vec::new(),
        seed: 1,
    };
    let kinds = super::kinds();
    let placed: Vec<&str> = old.lines().filter_map(study_of).collect();
    for id in study_file::ids(root)? {
        let places = placed.iter().filter(|&&placed| placed == id).count();
        ensure!(
            places == 1,
            "{}: study {id} has {places} places; give it one line `{STUDY}{id} -->`, followed by `{END}`",
            path.display()
        );
    }
    let studies = placed
        .iter()
        .map(|id| Told::read(root, study_file::read(&kinds, &request, id)?))
        .collect::<Result<Vec<Told>>>()?;

    let mut new = String::new();
    let mut lines = old.lines();
    let mut next = studies.iter();
    while let Some(line) = lines.next() {
        writeln!(new, "{line}")?;
        let told = match (line, study_of(line)) {
            (VERDICTS, _) => overview(&studies),
            (_, Some(_)) => next.next().map(Told::chapter).unwrap_or_default(),
            _ => continue,
        };
        new.push_str(&told);
        if !lines.by_ref().any(|line| line == END) {
            bail!("{}: no `{END}` after `{line}`", path.display());
        }
        writeln!(new, "{END}")?;
    }
    Ok(new)
}

fn study_of(line: &str) -> Option<&str> {
    line.strip_prefix(STUDY)?.strip_suffix(" -->")
}

/// A study and how its claims fared.
struct Told {
    study: LoadedStudy,
    /// Absent without results.
    claims: Option<Vec<ClaimResult>>,
}

impl Told {
    fn read(root: &Path, study: LoadedStudy) -> Result<Told> {
        let folder = root.join("results/paper").join(&study.id);
        let path = folder.join("claims.json");
        let shown = || format!("cannot read {}", path.display());
        let claims = match folder.exists() {
            true => {
                let text = std::fs::read_to_string(&path).with_context(shown)?;
                Some(serde_json::from_str(&text).with_context(shown)?)
            }
            false => None,
        };
        Ok(Told { study, claims })
    }

    fn chapter(&self) -> String {
        let LoadedStudy {
            id,
            title,
            question,
            analysis,
            ..
        } = &self.study;
        let mut text = format!("### {title}\n\n*{question}* `cargo run -- experiment {id}`\n\n");
        let Some(claims) = &self.claims else {
            text.push_str("Not yet run at the paper's scale.\n");
            return text;
        };
        let _ = writeln!(text, "![{title}](results/paper/{id}/{id}.png)\n");
        text.push_str("| the paper says | where | ours | verdict |\n|---|---|---|---|\n");
        for claim in claims {
            let _ = writeln!(
                text,
                "| {} | {} | {} | {} |",
                cell(&claim.quote),
                cell(&claim.place),
                cell(&claim.ours.to_string()),
                claim.verdict
            );
        }
        let _ = writeln!(text, "\n{}", analysis.trim());
        text
    }
}

/// A row for each study: how many of its claims have each verdict.
fn overview(studies: &[Told]) -> String {
    const ALL: [Verdict; 4] = [
        Verdict::Reproduced,
        Verdict::Partly,
        Verdict::Not,
        Verdict::NotCheckable,
    ];
    let mut text = "| exhibit | study |".to_owned();
    for verdict in ALL {
        let _ = write!(text, " {verdict} |");
    }
    text.push_str("\n|---|---|---|---|---|---|\n");
    for Told { study, claims } in studies {
        let LoadedStudy { title, id, .. } = study;
        let _ = match claims {
            Some(_) => write!(text, "| {title} | [`{id}`](results/paper/{id}) |"),
            None => write!(text, "| {title} | `{id}`, not yet run |"),
        };
        for verdict in ALL {
            let claims = claims.iter().flatten();
            match claims.filter(|claim| claim.verdict == verdict).count() {
                0 => text.push_str(" |"),
                n => {
                    let _ = write!(text, " {n} |");
                }
            }
        }
        text.push('\n');
    }
    text
}

/// Text in a cell of a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}
