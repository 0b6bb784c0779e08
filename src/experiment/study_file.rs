//! Study files, `experiments/<id>.toml`: reading, checking, and applying profiles and settings.

use super::claims::Claim;
use super::study::{BoundedColumns, Define, PaperPlace, Profile, Specification, Study};
use crate::strict_toml;
use anyhow::{Context, Result, bail};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A study file as it stands. `P` are the parameters of its kind, `T` what its claims' tests need.
#[derive(Deserialize)]
#[serde(
    deny_unknown_fields,
    bound = "P: DeserializeOwned, T: DeserializeOwned"
)]
struct StudyFile<P, T> {
    title: String,
    paper: PaperPlace,
    kind: String,
    question: String,
    analysis: String,
    #[serde(default)]
    bounds: BoundedColumns,
    parameters: P,
    // The overrides of a profile are read by `strict_toml::overlay`.
    #[serde(default, rename = "smoke")]
    _smoke: toml::Table,
    #[serde(default, rename = "quick")]
    _quick: toml::Table,
    #[serde(default = "Vec::new")]
    claim: Vec<Claim<T>>,
}

/// A study that is ready to run.
pub struct LoadedStudy {
    pub id: String,
    pub title: String,
    pub paper: PaperPlace,
    pub kind: String,
    pub question: String,
    pub analysis: String,
    pub bounds: BoundedColumns,
    /// With the profile and all `--set` applied.
    pub parameters: toml::Table,
    pub file: PathBuf,
    pub study: Box<dyn Study>,
}

/// How a study is asked for.
#[derive(Debug, Clone)]
pub struct Request {
    /// The repository.
    pub root: PathBuf,
    pub profile: Profile,
    /// `key=value`, keys relative to `[parameters]`.
    pub overrides: Vec<String>,
    pub seed: u64,
}

type Load = dyn Fn(&Request, &str, &str) -> Result<LoadedStudy>;

/// A kind of study: its name in study files and what reads them.
pub struct Kind {
    name: &'static str,
    load: Box<Load>,
}

impl Kind {
    pub fn new<P, T>(name: &'static str, define: Define<P, T>) -> Kind
    where
        P: DeserializeOwned + Serialize + 'static,
        T: DeserializeOwned + 'static,
    {
        let load = move |request: &Request, id: &str, text: &str| load(request, id, text, define);
        Kind {
            name,
            load: Box::new(load),
        }
    }
}

/// The ids of all studies in `root`, in alphabetical order.
pub fn ids(root: &Path) -> Result<Vec<String>> {
    let folder = root.join("experiments");
    let unreadable = || format!("cannot read the folder of studies {}", folder.display());
    let mut ids = Vec::new();
    for entry in folder.read_dir().with_context(unreadable)? {
        let path = entry.with_context(unreadable)?.path();
        if let (Some("toml"), Some(id)) = (
            path.extension().and_then(|e| e.to_str()),
            path.file_stem().and_then(|s| s.to_str()),
        ) {
            ids.push(id.to_owned());
        }
    }
    ids.sort();
    Ok(ids)
}

/// Reads and checks the study called `id`, whose kind is one of `kinds`.
pub fn read(kinds: &[Kind], request: &Request, id: &str) -> Result<LoadedStudy> {
    let known = ids(&request.root)?;
    if !known.iter().any(|k| k == id) {
        let hint = strict_toml::did_you_mean(id, known.iter().map(String::as_str));
        bail!("there is no study `{id}`{hint} (`armpose experiment list` shows all)");
    }

    #[derive(Deserialize)]
    struct OnlyKind {
        kind: String,
    }
    let path = file(id);
    let text = strict_toml::read_text(&request.root.join(&path))?;
    let name = path.display().to_string();
    let wanted = strict_toml::parse::<OnlyKind>(&name, &text)?.kind;
    let Some(kind) = kinds.iter().find(|k| k.name == wanted) else {
        let hint = strict_toml::did_you_mean(&wanted, kinds.iter().map(|k| k.name));
        let all = kinds.iter().map(|k| k.name).collect::<Vec<_>>().join(", ");
        bail!("{name}: there is no study kind `{wanted}`{hint} (known: {all})");
    };
    (kind.load)(request, id, &text)
}

/// Relative to the repository, as messages show it.
fn file(id: &str) -> PathBuf {
    Path::new("experiments").join(format!("{id}.toml"))
}

fn load<P: DeserializeOwned + Serialize, T: DeserializeOwned>(
    request: &Request,
    id: &str,
    text: &str,
    define: Define<P, T>,
) -> Result<LoadedStudy> {
    let path = file(id);
    let name = path.display().to_string();
    let (file, mut resolved) = parse::<P, T>(request.profile, &name, text)?;
    for setting in &request.overrides {
        set(&mut resolved, setting)?;
    }
    let with = format!("{name} with {}", request.overrides.join(" "));
    let study = define(Specification {
        id: id.to_owned(),
        title: file.title.clone(),
        root: request.root.clone(),
        profile: request.profile,
        seed: request.seed,
        parameters: typed(&resolved, &with)?,
        claims: file.claim,
    })
    .with_context(|| name.clone())?;
    Ok(LoadedStudy {
        id: id.to_owned(),
        title: file.title,
        paper: file.paper,
        kind: file.kind,
        question: file.question,
        analysis: file.analysis,
        bounds: file.bounds,
        parameters: resolved,
        file: path,
        study,
    })
}

/// The parameters of another study, for one that builds on it.
pub fn parameters_of<P: DeserializeOwned + Serialize>(
    root: &Path,
    profile: Profile,
    id: &str,
) -> Result<P> {
    let path = file(id);
    let name = path.display().to_string();
    let text = strict_toml::read_text(&root.join(&path))?;
    let (_, parameters) = parse::<P, serde::de::IgnoredAny>(profile, &name, &text)?;
    typed(&parameters, &name)
}

/// A study file and its parameters for one profile. Every profile is checked, not only this one.
fn parse<P: DeserializeOwned + Serialize, T: DeserializeOwned>(
    wanted: Profile,
    name: &str,
    text: &str,
) -> Result<(StudyFile<P, T>, toml::Table)> {
    let file: StudyFile<P, T> = strict_toml::parse(name, text)?;
    let paper = toml::Table::try_from(&file.parameters)
        .with_context(|| format!("{name}: the parameters cannot be written back"))?;
    let mut resolved = paper.clone();
    for profile in [Profile::Smoke, Profile::Quick] {
        let mut table = paper.clone();
        strict_toml::overlay(&mut table, name, text, Some(profile.name()))?;
        typed::<P>(&table, &format!("{name} with [{}]", profile.name()))?;
        if profile == wanted {
            resolved = table;
        }
    }
    Ok((file, resolved))
}

/// Reads by way of text, so that a mistake is shown in its line.
fn typed<P: DeserializeOwned>(table: &toml::Table, name: &str) -> Result<P> {
    Ok(strict_toml::parse(name, &toml::to_string(table)?)?)
}

/// Applies `key=value`. A value that is not TOML is taken as a string: `--set objective=mse`.
fn set(parameters: &mut toml::Table, setting: &str) -> Result<()> {
    let Some((key, value)) = setting.split_once('=') else {
        bail!("--set {setting}: expected key=value, such as protocol.images=100");
    };
    let quoted = format!("{key}={}", toml::Value::from(value.trim()));
    let text = match setting.parse::<toml::Table>() {
        Ok(_) => setting,
        Err(_) => &quoted,
    };
    Ok(strict_toml::overlay(parameters, "--set", text, None)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::study::{Done, Report};
    use crate::experiment::task::Task;
    use std::sync::Arc;

    #[derive(Debug, Deserialize, Serialize)]
    #[serde(deny_unknown_fields)]
    struct Parameters {
        images: usize,
        #[serde(default)]
        objective: Objective,
        forest: Forest,
    }

    #[derive(Debug, Default, Deserialize, Serialize)]
    #[serde(rename_all = "lowercase")]
    enum Objective {
        #[default]
        Mse,
        Wsc,
    }

    #[derive(Debug, Deserialize, Serialize)]
    #[serde(deny_unknown_fields)]
    struct Forest {
        trees: usize,
        share: f64,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Better {
        _better: String,
    }

    struct Nothing;

    impl Study for Nothing {
        fn tasks(&self) -> Result<Vec<Arc<dyn Task>>> {
            Ok(Vec::new())
        }
        fn report(&self, _: Done<'_>) -> Result<Report> {
            bail!("has no report")
        }
    }

    fn define(specification: Specification<Parameters, Better>) -> Result<Box<dyn Study>> {
        if specification.parameters.images == 0 {
            bail!("`images` must be at least 1");
        }
        Ok(Box::new(Nothing))
    }

    const GOOD: &str = "title = 't'\nkind = 'nothing'\nquestion = 'q'\nanalysis = 'a'\n\
        paper = { section = 'V', exhibit = 'Fig. 9' }\n\
        [parameters]\nimages = 200\nforest = { trees = 10, share = 0.5 }\n\
        [smoke]\nimages = 4\nforest.trees = 2\n[quick]\nimages = 40\n";

    fn read_text(text: &str, profile: Profile, overrides: &[&str]) -> Result<LoadedStudy> {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("experiments")).unwrap();
        std::fs::write(root.path().join("experiments/fig9.toml"), text).unwrap();
        let request = Request {
            root: root.path().to_owned(),
            profile,
            overrides: overrides.iter().map(|&o| o.to_owned()).collect(),
            seed: 1,
        };
        read(&[Kind::new("nothing", define)], &request, "fig9")
    }

    fn message(text: &str, overrides: &[&str]) -> String {
        match read_text(text, Profile::Paper, overrides) {
            Ok(study) => panic!("{:?} was accepted", study.parameters),
            Err(error) => format!("{error:#}"),
        }
    }

    #[test]
    fn profiles_and_settings_override_sizes() {
        let images = |profile, overrides: &[&str]| {
            let study = read_text(GOOD, profile, overrides).unwrap();
            let parameters: Parameters = study.parameters.try_into().unwrap();
            (parameters.images, parameters.forest.trees)
        };
        assert_eq!(images(Profile::Paper, &[]), (200, 10));
        assert_eq!(images(Profile::Quick, &[]), (40, 10));
        assert_eq!(images(Profile::Smoke, &[]), (4, 2));
        assert_eq!(
            images(Profile::Smoke, &["forest.trees=3", "images = 7"]),
            (7, 3)
        );
        let study = read_text(GOOD, Profile::Smoke, &["objective=wsc"]).unwrap();
        assert_eq!(study.parameters["objective"].as_str(), Some("wsc"));
    }

    #[test]
    fn mistakes_are_shown_where_they_are() {
        let starts = |text: &str, overrides: &[&str], start: &str| {
            let found = message(text, overrides);
            assert!(found.starts_with(start), "{found}");
        };
        let f = "experiments/fig9.toml";
        starts(
            &GOOD.replace("title", "titel"),
            &[],
            &format!("{f}:1:1: unknown field `titel`"),
        );
        let misspelt = GOOD.replace("[smoke]\nimages", "[smoke]\nimage");
        starts(
            &misspelt,
            &[],
            &format!("{f}:10:1: no parameter `image` to override; did you mean `images`?"),
        );
        starts(
            &GOOD.replace("'nothing'", "'nothin'"),
            &[],
            &format!("{f}: there is no study kind `nothin`; did you mean `nothing`?"),
        );
        starts(
            &GOOD.replace("[smoke]\nimages = 4", "[smoke]\nimages = -4"),
            &[],
            &format!("{f} with [smoke]:1:10: invalid value: integer `-4`"),
        );
        starts(
            &GOOD.replace("images = 200", "images = 0"),
            &[],
            &format!("{f}: `images` must be at least 1"),
        );
        starts(
            GOOD,
            &["forest.tres=3"],
            "--set:1:8: no parameter `tres` to override; did you mean `trees`?",
        );
        starts(
            GOOD,
            &["forest.trees"],
            "--set forest.trees: expected key=value",
        );
        starts(
            GOOD,
            &["objective=msd"],
            &format!("{f} with objective=msd:2:13: unknown variant `msd`"),
        );
        let claim = "[[claim]]\nid = 'a'\nquote = 'q'\nwhere = 'V'\nkind = 'order'\npaper = 1\ntest = { beter = 'x' }\n";
        starts(
            &format!("{GOOD}{claim}"),
            &[],
            &format!("{f}:20:10: unknown field `beter`"),
        );
    }

    #[test]
    fn an_unknown_study_is_told_its_nearest_name() {
        let request = Request {
            root: PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("no-such-folder"),
            profile: Profile::Paper,
            overrides: Vec::new(),
            seed: 1,
        };
        let missing = read(&[], &request, "fig9").err().unwrap();
        assert!(format!("{missing:#}").starts_with("cannot read the folder of studies"));
    }
}
