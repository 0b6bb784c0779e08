//! Reading TOML strictly: an unknown, misspelt or missing key is an error that says where it is.
//!
//! The structs that are read say `#[serde(deny_unknown_fields)]` and never `flatten`, which loses
//! the place of a mistake.

use serde::{Deserialize, de::DeserializeOwned};
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

/// TOML that cannot be used. The message carries name and line, the line's text with a caret below
/// the mistake, and the nearest known key.
#[derive(Debug, thiserror::Error)]
pub enum TomlError {
    #[error("cannot read {path}", path = path.display())]
    Read {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{0}")]
    Invalid(String),
}

/// Reads the file at `path` into `T`.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, TomlError> {
    parse(&path.display().to_string(), &read_text(path)?)
}

/// The text of the file at `path`.
pub fn read_text(path: &Path) -> Result<String, TomlError> {
    std::fs::read_to_string(path).map_err(|source| TomlError::Read {
        path: path.to_owned(),
        source,
    })
}

/// Reads `text` into `T`; messages call it `name`.
pub fn parse<T: DeserializeOwned>(name: &str, text: &str) -> Result<T, TomlError> {
    toml::from_str(text).map_err(|e| located(name, text, &e))
}

/// Replaces values of `base` by those of a table in `text`: the table called `section`, which may
/// be absent, or the whole text. A path that `base` does not have, or a value of another type
/// (except an integer for a float), is an error with its place. Arrays are replaced whole.
pub fn overlay(
    base: &mut Table,
    name: &str,
    text: &str,
    section: Option<&str>,
) -> Result<(), TomlError> {
    let document = DeTable::parse(text).map_err(|e| located(name, text, &e))?;
    let overrides = match section {
        None => document.get_ref(),
        Some(section) => match document.get_ref().get(section).map(Spanned::get_ref) {
            Some(DeValue::Table(table)) => table,
            _ => return Ok(()),
        },
    };
    let place = |span: Range<usize>, message: &str| {
        TomlError::Invalid(with_caret(name, text, Some(span), message))
    };
    overlay_table(base, overrides, &place)
}

fn overlay_table(
    base: &mut Table,
    overrides: &DeTable,
    place: &dyn Fn(Range<usize>, &str) -> TomlError,
) -> Result<(), TomlError> {
    for (key, value) in overrides {
        let Some(old) = base.get_mut(key.get_ref().as_ref()) else {
            let key_text: &str = key.get_ref();
            let hint = did_you_mean(key_text, base.keys().map(String::as_str));
            let message = format!("no parameter `{key_text}` to override{hint}");
            return Err(place(key.span(), &message));
        };
        match (old, value.get_ref()) {
            (Value::Table(old), DeValue::Table(new)) => overlay_table(old, new, place)?,
            (old, new) => {
                *old = match (&*old, plain(new)) {
                    (Value::Float(_), Some(Value::Integer(new))) => Value::Float(new as f64),
                    (old, Some(new)) if old.same_type(&new) => new,
                    (old, _) => {
                        let message = format!(
                            "`{}` is of type {}, not {}",
                            key.get_ref(),
                            old.type_str(),
                            value.get_ref().type_str()
                        );
                        return Err(place(value.span(), &message));
                    }
                };
            }
        }
    }
    Ok(())
}

/// A parsed value without its spans, once they have served.
fn plain(value: &DeValue) -> Option<Value> {
    let spanned = Spanned::new(0..0, value.clone());
    Value::deserialize(toml::de::ValueDeserializer::from(spanned)).ok()
}

/// `; did you mean ...?` when one of `known` is near to `word`, otherwise nothing.
pub fn did_you_mean<'a>(word: &str, known: impl Iterator<Item = &'a str>) -> String {
    known
        .map(|k| (strsim::damerau_levenshtein(word, k), k))
        .filter(|(distance, k)| *distance <= 1 + word.len().max(k.len()) / 3)
        .min()
        .map_or(String::new(), |(_, k)| format!("; did you mean `{k}`?"))
}

fn located(name: &str, text: &str, error: &toml::de::Error) -> TomlError {
    // serde names the expected keys in its message: "unknown field `a`, expected one of `b`, `c`".
    let mut quoted = error.message().split('`').skip(1).step_by(2);
    let hint = match quoted.next() {
        Some(word) if error.message().starts_with("unknown") => did_you_mean(word, quoted),
        _ => String::new(),
    };
    let message = format!("{}{hint}", error.message());
    TomlError::Invalid(with_caret(name, text, error.span(), &message))
}

/// The message under its place: name, line and column, the line's text, a caret below the span.
fn with_caret(name: &str, text: &str, span: Option<Range<usize>>, message: &str) -> String {
    let Some(span) = span.filter(|s| text.is_char_boundary(s.start)) else {
        return format!("{name}: {message}");
    };
    let before = &text[..span.start];
    let number = before.matches('\n').count() + 1;
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    let line = text[line_start..].lines().next().unwrap_or("");
    let column = text[line_start..span.start].chars().count();
    let width = line
        .chars()
        .count()
        .saturating_sub(column)
        .min(span.len())
        .max(1);
    let margin = " ".repeat(number.to_string().len());
    let indent = " ".repeat(column);
    let carets = "^".repeat(width);
    format!(
        "{name}:{number}:{}: {message}\n{margin} |\n{number} | {line}\n{margin} | {indent}{carets}",
        column + 1
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Outer {
        title: String,
        forest: Inner,
    }

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(deny_unknown_fields, rename_all = "kebab-case")]
    struct Inner {
        trees: usize,
        max_depth: f64,
    }

    #[test]
    fn a_misspelt_key_is_shown_with_its_place_and_the_nearest_key() {
        let text = "title = \"t\"\n\n[forest]\ntrees = 3\n  max-dept = 20\n";
        let error = parse::<Outer>("a.toml", text).unwrap_err().to_string();
        assert_eq!(
            error,
            "a.toml:5:3: unknown field `max-dept`, expected `trees` or `max-depth`; \
             did you mean `max-depth`?\n  |\n5 |   max-dept = 20\n  |   ^^^^^^^^"
        );
    }

    #[test]
    fn a_missing_key_and_bad_syntax_have_their_place() {
        let missing = parse::<Outer>("a.toml", "title = \"t\"\n[forest]\ntrees = 3\n");
        let missing = missing.unwrap_err().to_string();
        assert!(
            missing.contains("a.toml:2:1: missing field `max-depth`"),
            "{missing}"
        );
        let syntax = parse::<Outer>("a.toml", "title = \"t\n")
            .unwrap_err()
            .to_string();
        assert!(syntax.starts_with("a.toml:1:"), "{syntax}");
    }

    fn base() -> Table {
        "[forest]\ntrees = 10\nshare = 0.5\nleaves = [1, 2]\n"
            .parse()
            .unwrap()
    }

    #[test]
    fn an_overlay_replaces_values_and_nothing_else() {
        let mut table = base();
        let text = "x = 1\n[smoke]\nforest = { trees = 3, share = 1, leaves = [5] }\n";
        overlay(&mut table, "a.toml", text, Some("smoke")).unwrap();
        let expected: Table = "[forest]\ntrees = 3\nshare = 1.0\nleaves = [5]\n"
            .parse()
            .unwrap();
        assert_eq!(table, expected);
        overlay(&mut table, "a.toml", text, Some("quick")).unwrap();
        assert_eq!(table, expected);
    }

    #[test]
    fn an_overlay_of_an_unknown_path_or_another_type_is_an_error() {
        let fails = |text: &str| {
            let error = overlay(&mut base(), "--set", text, None).unwrap_err();
            error.to_string()
        };
        assert_eq!(
            fails("forest.tress = 3"),
            "--set:1:8: no parameter `tress` to override; did you mean `trees`?\n  |\n\
             1 | forest.tress = 3\n  |        ^^^^^"
        );
        assert!(fails("forest = 3").contains("`forest` is of type table, not integer"));
        assert!(fails("forest.trees = 2.5").contains("`trees` is of type integer, not float"));
        assert!(fails("forest.trees = ").starts_with("--set:1:"));
    }
}
