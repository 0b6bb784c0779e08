//! The parts of the arms that the baseline tells apart, as a file declares them.

use crate::dataset::{LabelRecord, SetRecord};
use crate::forest::part_forest::PartClass;
use crate::strict_toml::{self, TomlError};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A part: some links of an arm.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartSpec {
    pub name: String,
    /// As `robot.toml` calls it.
    pub arm: String,
    pub links: Vec<String>,
}

/// Why parts cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PartsError {
    #[error(transparent)]
    Toml(#[from] TomlError),
    #[error("part \"{part}\": the {arm} arm has no link \"{link}\"")]
    Unknown {
        part: String,
        arm: String,
        link: String,
    },
    #[error("link \"{link}\" of the {arm} arm is in {count} parts; it must be in one")]
    NotOne {
        link: String,
        arm: String,
        count: usize,
    },
}

/// Reads the tables `[[part]]` of a file such as `data/baselines/arm-parts.toml`.
pub fn read_parts(path: &Path) -> Result<Vec<PartSpec>, PartsError> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct PartsFile {
        part: Vec<PartSpec>,
    }
    let file: PartsFile = strict_toml::read(path)?;
    Ok(file.part)
}

/// The classes of a part forest: 0 is the background, and part i is class i + 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts {
    pub classes: Vec<PartClass>,
    /// The class of each label of an image.
    pub of_label: [u8; 256],
}

impl Parts {
    /// For the images of a set. Parts of its target arm vote. Fails unless every link of the arms is
    /// in just one part.
    pub fn new(parts: &[PartSpec], set: &SetRecord) -> Result<Parts, PartsError> {
        let is = |part: &PartSpec, entry: &LabelRecord| {
            part.arm == entry.arm && part.links.contains(&entry.link)
        };
        for part in parts {
            for link in &part.links {
                let known = |entry: &LabelRecord| entry.arm == part.arm && entry.link == *link;
                if !set.labels.iter().any(known) {
                    return Err(PartsError::Unknown {
                        part: part.name.clone(),
                        arm: part.arm.clone(),
                        link: link.clone(),
                    });
                }
            }
        }
        let mut of_label = [0; 256];
        for entry in &set.labels {
            let mut with_link = (1..).zip(parts).filter(|(_, part)| is(part, entry));
            match (with_link.next(), with_link.count()) {
                (Some((class, _)), 0) => of_label[usize::from(entry.label)] = class,
                (first, others) => {
                    return Err(PartsError::NotOne {
                        link: entry.link.clone(),
                        arm: entry.arm.clone(),
                        count: usize::from(first.is_some()) + others,
                    });
                }
            }
        }
        let background = PartClass {
            name: "background".to_owned(),
            votes: false,
        };
        let part = |part: &PartSpec| PartClass {
            name: format!("{} {}", part.arm, part.name),
            votes: part.arm == set.specification.target,
        };
        let classes = std::iter::once(background).chain(parts.iter().map(part));
        Ok(Parts {
            classes: classes.collect(),
            of_label,
        })
    }
}
