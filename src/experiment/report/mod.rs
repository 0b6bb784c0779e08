//! What came out, for readers: in REPRODUCE.md ([`refreshed`]), and as one page for a browser ([`page`]).

mod html;
mod markdown;
mod markup;
mod provenance;
mod results;

pub use html::page;
pub use markdown::{file, refreshed};

use super::claims::{ClaimResult, Verdict};

/// From good to bad.
const VERDICTS: [Verdict; 4] = [
    Verdict::Reproduced,
    Verdict::Partly,
    Verdict::Not,
    Verdict::NotCheckable,
];

fn count<'a>(claims: impl IntoIterator<Item = &'a ClaimResult>, verdict: Verdict) -> usize {
    let claims = claims.into_iter();
    claims.filter(|claim| claim.verdict == verdict).count()
}

/// An exhibit of the paper, or where it says in words what a study tests.
fn exhibit(study: &super::study_file::LoadedStudy) -> String {
    match &*study.paper.exhibit {
        "none" => format!("in words, {}", study.paper.section),
        exhibit => exhibit.to_owned(),
    }
}
