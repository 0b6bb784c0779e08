//! REPRODUCE.md: what came out, exhibit by exhibit.
//!
//! The file is written by hand but for the lines between two kinds of markers, which say where in the
//! text each study has its place:
//!
//! ```text
//! <!-- verdicts -->       how the claims of all studies fared, exhibit by exhibit
//! <!-- end -->
//! <!-- study fig9 -->     question, command, cost, figures, claims with verdicts, and analysis
//! <!-- end -->
//! ```

use super::results::Results;
use super::{VERDICTS, count, exhibit};
use crate::experiment::study::Profile;
use crate::experiment::study_file::{self, LoadedStudy, Request};
use anyhow::{Context, Result, bail, ensure};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Where the text stands in the repository `root`.
pub fn file(root: &Path) -> PathBuf {
    root.join("REPRODUCE.md")
}

const MARKER: &str = "<!-- verdicts -->";
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
    let kinds = crate::experiment::kinds();
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
            (MARKER, _) => overview(&studies),
            (_, Some(_)) => next
                .next()
                .map_or_else(|| Ok(String::new()), Told::chapter)?,
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

/// The studies in the order of the text; none where there is no text.
pub fn places(root: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(file(root)).unwrap_or_default();
    let studies = text.lines().filter_map(study_of);
    studies.map(str::to_owned).collect()
}

fn study_of(line: &str) -> Option<&str> {
    line.strip_prefix(STUDY)?.strip_suffix(" -->")
}

/// A study and what came out.
struct Told {
    study: LoadedStudy,
    results: Option<Results>,
}

impl Told {
    fn read(root: &Path, study: LoadedStudy) -> Result<Told> {
        let folder = root.join("results/paper").join(&study.id);
        let results = match folder.exists() {
            true => Some(Results::read(&folder)?),
            false => None,
        };
        Ok(Told { study, results })
    }

    fn chapter(&self) -> Result<String> {
        let LoadedStudy {
            id,
            title,
            question,
            analysis,
            ..
        } = &self.study;
        let mut text = format!("### {title}\n\n*{question}*\n\n`cargo run -- experiment {id}`");
        let Some(results) = &self.results else {
            text.push_str("\n\nNot yet run at the paper's scale.\n");
            return Ok(text);
        };
        writeln!(text, " (ours: {})\n", results.cost())?;
        // Contact sheets and the like can be looked at in the folder.
        for name in results.files(&["png"], id)? {
            if name == *id || name == "images" {
                writeln!(text, "![{title}](results/paper/{id}/{name}.png)\n")?;
            }
        }
        text.push_str("| the paper says | where | ours | verdict |\n|---|---|---|---|\n");
        for claim in &results.claims {
            writeln!(
                text,
                "| {} | {} | {} | {} |",
                cell(&claim.quote),
                cell(&claim.place),
                cell(&claim.ours.to_string()),
                claim.verdict
            )?;
        }
        writeln!(text, "\n{}", analysis.trim())?;
        Ok(text)
    }
}

/// A row for each study, the figures first, then the tables, and then what the paper says in words: how
/// many of its claims have each verdict.
fn overview(studies: &[Told]) -> String {
    let mut text = "| exhibit | study | results |".to_owned();
    for verdict in VERDICTS {
        let _ = write!(text, " {verdict} |");
    }
    text.push_str("\n|---|---|---|---|---|---|---|\n");
    let mut studies: Vec<&Told> = studies.iter().collect();
    studies.sort_by_key(|told| place(&told.study.paper.exhibit));
    for Told { study, results } in studies {
        let LoadedStudy { title, id, .. } = study;
        let (exhibit, chapter) = (exhibit(study), anchor(title));
        let title = title.strip_prefix(&format!("{exhibit}: ")).unwrap_or(title);
        let _ = match results {
            Some(_) => write!(
                text,
                "| {exhibit} | [{title}](#{chapter}) | [`{id}`](results/paper/{id}) |"
            ),
            None => write!(
                text,
                "| {exhibit} | [{title}](#{chapter}) | `{id}`, not yet run |"
            ),
        };
        for verdict in VERDICTS {
            match count(results.iter().flat_map(|results| &results.claims), verdict) {
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

/// Where an exhibit stands: "Fig. 2" before "Fig. 10" before "Table I", and what is none last.
fn place(exhibit: &str) -> (usize, usize, String) {
    let (kind, number) = exhibit.split_once(' ').unwrap_or((exhibit, ""));
    let kinds = ["Fig.", "Table"];
    let kind = kinds.iter().position(|known| *known == kind);
    let digits: String = number.chars().take_while(char::is_ascii_digit).collect();
    (
        kind.unwrap_or(kinds.len()),
        digits.parse().unwrap_or(0),
        number.to_owned(),
    )
}

/// What the link to a heading is called.
fn anchor(heading: &str) -> String {
    let kept = |c: &char| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_');
    let kept = heading.chars().filter(kept).collect::<String>();
    kept.to_lowercase().replace(' ', "-")
}

/// Text in a cell of a table.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exhibits_are_in_the_order_of_the_paper() {
        let ordered = [
            "Fig. 2", "Fig. 9", "Fig. 10", "Fig. 11a", "Fig. 11b", "Table I", "Table II", "none",
        ];
        assert!(ordered.map(place).is_sorted());
    }

    #[test]
    fn headings_are_linked_as_browsers_show_them() {
        let heading = "Fig. 11a: joint angles regressed, or found by way of parts";
        assert_eq!(
            anchor(heading),
            "fig-11a-joint-angles-regressed-or-found-by-way-of-parts"
        );
    }
}
