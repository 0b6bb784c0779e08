//! One page for a browser with everything of a folder of results: it loads nothing and runs nothing.

use super::markup::{Escaped, data_uri, fill, prose, table};
use super::provenance::provenance;
use super::results::Results;
use super::{VERDICTS, count, exhibit, markdown};
use crate::experiment::claims::{ClaimResult, Verdict};
use crate::experiment::study::Profile;
use crate::experiment::study_file::{self, LoadedStudy, Request};
use anyhow::{Context, Result};
use std::fmt::Write;
use std::path::Path;

/// Longer tables are folded.
const LONG: usize = 40;

/// A study of which there are results. Those of other repositories, or of an older one, may have no file.
struct Chapter {
    results: Results,
    study: Option<LoadedStudy>,
}

/// The results in `folder`, which holds a folder for each study, as an HTML page. Studies are described as
/// in the repository `root`.
pub fn page(root: &Path, folder: &Path) -> Result<String> {
    let chapters = chapters(root, folder)?;
    let name = folder.strip_prefix(root).unwrap_or(folder);
    let title = format!("armpose: {}", name.display());
    let title = Escaped(&title).to_string();
    let mut studies = String::new();
    for chapter in &chapters {
        studies.push_str(&chapter.section()?);
    }
    Ok(fill(
        include_str!("page.html"),
        &[
            ("title", &title),
            ("lead", &lead(&chapters)),
            ("claims", &all_claims(&chapters)),
            ("contents", &contents(&chapters)),
            ("studies", &studies),
        ],
    ))
}

/// In the order of REPRODUCE.md, and then what has no place in it.
fn chapters(root: &Path, folder: &Path) -> Result<Vec<Chapter>> {
    let request = Request {
        root: root.to_owned(),
        profile: Profile::Paper,
        overrides: Vec::new(),
        seed: 1,
    };
    let (kinds, known) = (crate::experiment::kinds(), study_file::ids(root)?);
    let places = markdown::places(root);
    let mut all = Results::all(folder)?;
    all.sort_by_key(|results| {
        let place = places.iter().position(|id| *id == results.id);
        place.unwrap_or(places.len())
    });
    let chapter = |results: Results| {
        let study = match known.contains(&results.id) {
            true => Some(study_file::read(&kinds, &request, &results.id)?),
            false => None,
        };
        Ok(Chapter { results, study })
    };
    all.into_iter().map(chapter).collect()
}

fn lead(chapters: &[Chapter]) -> String {
    let distinct = |pointer: &str, shown: &dyn Fn(String) -> String| {
        let facts = chapters.iter().map(|c| shown(c.results.fact(pointer)));
        let mut facts: Vec<String> = facts.collect();
        facts.sort();
        facts.dedup();
        match facts.len() {
            0..4 => Escaped(facts.join(", ")).to_string(),
            n => format!("({n} different)"),
        }
    };
    let of = |verdict| count(chapters.iter().flat_map(|c| &c.results.claims), verdict);
    let [reproduced, partly, not, unchecked] = VERDICTS.map(of);
    let same = |text: String| text;
    format!(
        "<p>What came of {} studies of Widmaier, Kappler, Schaal and Bohg, <cite>Robot Arm Pose Estimation \
         by Pixel-wise Regression of Joint Angles</cite> (ICRA 2016), run again by armpose. Of {} statements \
         of the paper {reproduced} are reproduced, {partly} partly and {not} not; {unchecked} cannot be \
         checked here. An order is <em>reproduced</em> when the 95 % bootstrap interval of the difference \
         lies on the claimed side, <em>partly</em> when only the mean does; every rule stands in the file of \
         its study. <em>Not</em> is a finding, not a failure. Profile {}, seed {}, revision {}; {}; {}.</p>\n",
        chapters.len(),
        reproduced + partly + not + unchecked,
        distinct("/profile", &same),
        distinct("/seed", &same),
        distinct("/machine/git_revision", &|hash| hash
            .chars()
            .take(7)
            .collect()),
        distinct("/machine/cpu", &same),
        distinct("/started", &|time| time.chars().take(10).collect()),
    )
}

/// The claims of all studies, with the choice to see those of one verdict only.
fn all_claims(chapters: &[Chapter]) -> String {
    let all = || chapters.iter().flat_map(|c| &c.results.claims);
    let mut html = "<fieldset class=\"filter\">\n<legend>Show</legend>\n".to_owned();
    let mut choice = |id: &str, checked: &str, shown: String| {
        let _ = writeln!(
            html,
            "<label><input type=\"radio\" name=\"show\" id=\"show-{id}\"{checked}> {shown}</label>"
        );
    };
    choice("all", " checked", format!("all {}", all().count()));
    for verdict in VERDICTS {
        let n = count(all(), verdict);
        choice(&verdict.to_string(), "", format!("{} {n}", badge(verdict)));
    }
    html.push_str("</fieldset>\n<table class=\"claims\">\n");
    html.push_str(CLAIMS_HEAD);
    for chapter in chapters.iter().filter(|c| !c.results.claims.is_empty()) {
        let _ = writeln!(
            html,
            "<tbody>\n<tr class=\"of\"><th scope=\"rowgroup\" colspan=\"4\"><a href=\"#{}\">{}</a></th></tr>",
            Escaped(&chapter.results.id),
            Escaped(chapter.title())
        );
        for claim in &chapter.results.claims {
            html.push_str(&row(claim));
        }
        html.push_str("</tbody>\n");
    }
    html.push_str("</table>\n");
    html
}

const CLAIMS_HEAD: &str = "<thead><tr><th scope=\"col\">The paper says</th><th scope=\"col\">Where</th>\
     <th scope=\"col\">We find</th><th scope=\"col\">Verdict</th></tr></thead>\n";

fn row(claim: &ClaimResult) -> String {
    let n = match claim.n {
        0 => String::new(),
        n => format!(" <span class=\"small\">n = {n}</span>"),
    };
    format!(
        "<tr class=\"claim {}\"><td><q>{}</q> <span class=\"small\">{}</span></td>\
         <td data-label=\"Where\">{}</td><td data-label=\"We find\">{}{n}</td><td>{}</td></tr>\n",
        claim.verdict,
        Escaped(&claim.quote),
        Escaped(&claim.paper),
        Escaped(&claim.place),
        Escaped(&claim.ours),
        badge(claim.verdict)
    )
}

/// A verdict by word, sign and colour.
fn badge(verdict: Verdict) -> String {
    let (sign, word) = match verdict {
        Verdict::Reproduced => ("✓", "reproduced"),
        Verdict::Partly => ("≈", "partly"),
        Verdict::Not => ("✗", "not reproduced"),
        Verdict::NotCheckable => ("–", "not checkable"),
    };
    format!(
        "<span class=\"badge {verdict}\"><span aria-hidden=\"true\">{sign}</span> {word}</span>"
    )
}

fn contents(chapters: &[Chapter]) -> String {
    let mut html = "<ol>\n".to_owned();
    for chapter in chapters {
        let _ = write!(
            html,
            "<li><a href=\"#{}\">{}</a>",
            Escaped(&chapter.results.id),
            Escaped(chapter.title())
        );
        let claims = &chapter.results.claims;
        if !claims.is_empty() {
            let n = VERDICTS.map(|verdict| count(claims, verdict));
            let told: Vec<String> = VERDICTS
                .iter()
                .zip(n)
                .filter(|(_, n)| *n > 0)
                .map(|(verdict, n)| format!("{n} {verdict}"))
                .collect();
            let told = told.join(", ");
            let _ = write!(
                html,
                " <span class=\"bar\" role=\"img\" aria-label=\"{told}\" title=\"{told}\">"
            );
            for (verdict, n) in VERDICTS.iter().zip(n).filter(|(_, n)| *n > 0) {
                let _ = write!(html, "<i class=\"{verdict}\" style=\"flex:{n}\"></i>");
            }
            html.push_str("</span>");
        }
        html.push_str("</li>\n");
    }
    html.push_str("</ol>\n");
    html
}

impl Chapter {
    fn title(&self) -> &str {
        let title = self.study.as_ref().map(|study| &study.title);
        title.unwrap_or(&self.results.id)
    }

    fn section(&self) -> Result<String> {
        let Chapter { results, study } = self;
        let mut html = format!(
            "<section id=\"{}\">\n<h2>{}</h2>\n",
            Escaped(&results.id),
            Escaped(self.title())
        );
        if let Some(study) = study {
            writeln!(
                html,
                "<p class=\"question\">{}</p>\n<p class=\"small\">{} · <code>armpose experiment {}</code> · \
                 {}</p>",
                Escaped(&study.question),
                Escaped(exhibit(study)),
                Escaped(&results.id),
                Escaped(results.cost())
            )?;
        }
        for name in results.files(&["svg", "png"], &results.id)? {
            html.push_str(&self.figure(&name)?);
        }
        if !results.claims.is_empty() {
            html.push_str("<h3>Claims</h3>\n<table class=\"claims\">\n");
            html.push_str(CLAIMS_HEAD);
            html.push_str("<tbody>\n");
            html.extend(results.claims.iter().map(row));
            html.push_str("</tbody>\n</table>\n");
        }
        if let Some(study) = study {
            html.push_str(&self.analysis(&study.analysis));
        }
        html.push_str("<h3>Numbers</h3>\n");
        let tables = results.files(&["csv"], "summary")?;
        for name in tables.iter().filter(|name| *name != "data") {
            let (table, rows) = table(&results.path(&format!("{name}.csv")))?;
            let open = if rows <= LONG { " open" } else { "" };
            let name = Escaped(name);
            writeln!(
                html,
                "<details{open}>\n<summary>{name}.csv <span class=\"small\">{rows} rows</span></summary>\n\
                 <div class=\"wide\" role=\"region\" aria-label=\"{name}\" tabindex=\"0\">\n{table}</div>\n\
                 </details>"
            )?;
        }
        html.push_str(&provenance(results));
        html.push_str("</section>\n");
        Ok(html)
    }

    /// As SVG or PNG, whichever is smaller.
    fn figure(&self, name: &str) -> Result<String> {
        let results = &self.results;
        let mut files = Vec::new();
        for (extension, media_type) in [("svg", "image/svg+xml"), ("png", "image/png")] {
            let path = results.path(&format!("{name}.{extension}"));
            if path.is_file() {
                let bytes = std::fs::read(&path);
                let bytes = bytes.with_context(|| format!("cannot read {}", path.display()))?;
                files.push((media_type, bytes));
            }
        }
        // So that nothing moves while the page is loaded: what the first chunk of a PNG says.
        let png = files.iter().find(|(kind, _)| *kind == "image/png");
        let number = |bytes: &[u8], at: usize| {
            let bytes = bytes.get(at..at + 4)?.try_into().ok()?;
            Some(u32::from_be_bytes(bytes))
        };
        let size = png.and_then(|(_, png)| Some((number(png, 16)?, number(png, 20)?)));
        let size = size.map_or_else(String::new, |(width, height)| {
            format!(" width=\"{width}\" height=\"{height}\"")
        });
        let figures = results.manifest["figures"].as_array().into_iter().flatten();
        let told = { figures }.find(|figure| figure["name"] == name);
        let text = |key: &str| told.and_then(|told| told[key].as_str());
        let (title, caption) = (text("title"), text("caption"));
        let alt = match caption {
            Some(caption) => format!("{}. {caption}", title.unwrap_or_default()),
            None => format!("{}, {name}", self.title()),
        };
        let smallest = files.iter().min_by_key(|(_, bytes)| bytes.len());
        let (media_type, bytes) = smallest.context("a figure without a file")?;
        Ok(format!(
            "<figure class=\"wide\" tabindex=\"0\"><img alt=\"{}\"{size} src=\"{}\"></figure>\n",
            Escaped(alt),
            data_uri(media_type, bytes)
        ))
    }

    /// What is said of the reference run may not be true of others.
    fn analysis(&self, text: &str) -> String {
        let manifest = &self.results.manifest;
        let settings = manifest["study"]["settings"].as_array();
        let is_reference = manifest["profile"] == Profile::Paper.name()
            && manifest["seed"] == 1
            && settings.is_none_or(Vec::is_empty);
        let text = prose(text);
        match is_reference {
            true => format!("<h3>Analysis</h3>\n{text}"),
            false => format!(
                "<details>\n<summary>Analysis of the run at the paper's scale</summary>\n{text}</details>\n"
            ),
        }
    }
}
