//! Pieces of HTML.

use crate::experiment::table::significant;
use anyhow::{Context, Result};
use base64::prelude::{BASE64_STANDARD, Engine};
use std::fmt::{Display, Formatter, Write};
use std::path::Path;

/// Text that stands for itself, between tags and in quoted attributes.
pub struct Escaped<T>(pub T);

impl<T: Display> Display for Escaped<T> {
    fn fmt(&self, f: &mut Formatter) -> std::fmt::Result {
        for character in self.0.to_string().chars() {
            match character {
                '&' => f.write_str("&amp;")?,
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '"' => f.write_str("&quot;")?,
                '\'' => f.write_str("&#39;")?,
                other => f.write_char(other)?,
            }
        }
        Ok(())
    }
}

/// Paragraphs, which empty lines divide; what stands between backticks is code.
pub fn prose(text: &str) -> String {
    let mut html = String::new();
    for paragraph in text.trim().split("\n\n") {
        html.push_str("<p>");
        for (at, part) in paragraph.split('`').enumerate() {
            let _ = match at % 2 {
                0 => write!(html, "{}", Escaped(part)),
                _ => write!(html, "<code>{}</code>", Escaped(part)),
            };
        }
        html.push_str("</p>\n");
    }
    html
}

/// A CSV file as a table, what was measured with four significant digits, and how many rows it has.
pub fn table(csv: &Path) -> Result<(String, usize)> {
    let unreadable = || format!("cannot read {}", csv.display());
    let mut reader = csv::Reader::from_path(csv).with_context(unreadable)?;
    let columns = reader.headers().with_context(unreadable)?.clone();
    let rows: Vec<csv::StringRecord> = reader
        .records()
        .collect::<Result<_, _>>()
        .with_context(unreadable)?;
    let is_number = |cell: &str| cell.is_empty() || cell.parse::<f64>().is_ok();
    // What was measured has more digits than anyone reads; what was chosen has few.
    let is_long = |cell: &str| cell.contains('.') && cell.len() > 6;
    let class = |column: usize| {
        let mut cells = rows.iter().map(|row| &row[column]);
        match cells.clone().all(is_number) {
            true => (" class=\"n\"", cells.any(is_long)),
            false => ("", false),
        }
    };
    let classes: Vec<(&str, bool)> = (0..columns.len()).map(class).collect();
    let mut html = "<table>\n<thead><tr>".to_owned();
    for (column, (class, _)) in columns.iter().zip(&classes) {
        write!(
            html,
            "<th scope=\"col\"{class}>{}</th>",
            Escaped(heading(column))
        )?;
    }
    html.push_str("</tr></thead>\n<tbody>\n");
    for row in &rows {
        html.push_str("<tr>");
        for (cell, (class, is_measured)) in row.iter().zip(&classes) {
            let shown = match cell.parse::<f64>() {
                Ok(number) if *is_measured => four_digits(number),
                _ => cell.to_owned(),
            };
            write!(html, "<td{class}>{}</td>", Escaped(shown))?;
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody>\n</table>\n");
    Ok((html, rows.len()))
}

/// With zeros at the end, so that the numbers of a column look alike.
fn four_digits(number: f64) -> String {
    let decimals = 3.0 - number.abs().log10().floor();
    match decimals {
        d if (0.0..8.0).contains(&d) => format!("{number:.*}", d as usize),
        _ => significant(number, 4),
    }
}

/// `fold_sd_deg` as "fold sd (deg)".
fn heading(column: &str) -> String {
    const UNITS: [&str; 8] = ["deg", "rad", "m", "mm", "px", "s", "ms", "ns"];
    match column.rsplit_once('_') {
        Some((name, unit)) if UNITS.contains(&unit) => {
            format!("{} ({unit})", name.replace('_', " "))
        }
        _ => column.replace('_', " "),
    }
}

/// A file in the text of a page. An SVG that is shown so neither runs scripts nor loads anything, and its
/// ids are its own.
pub fn data_uri(media_type: &str, bytes: &[u8]) -> String {
    format!("data:{media_type};base64,{}", BASE64_STANDARD.encode(bytes))
}

/// The template with what belongs into its `{{slots}}`; those without a value stay empty.
pub fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut parts = template.split("{{");
    let mut page = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (slot, rest) = part.split_once("}}").unwrap_or((part, ""));
        let value = values.iter().find(|(name, _)| *name == slot);
        page.push_str(value.map_or("", |(_, value)| value));
        page.push_str(rest);
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stands_for_itself() {
        let text = "a < b && \"c\" > 'd'";
        let escaped = Escaped(text).to_string();
        assert!(!escaped.contains(['<', '>', '"', '\'']));
        let back = escaped
            .replace("&lt;", "<")
            .replace("&gt;", ">")
            .replace("&quot;", "\"")
            .replace("&#39;", "'")
            .replace("&amp;", "&");
        assert_eq!(back, text);
        assert_eq!(
            prose("a `<b>`\nc\n\nd"),
            "<p>a <code>&lt;b&gt;</code>\nc</p>\n<p>d</p>\n"
        );
    }

    /// The test vectors of RFC 4648.
    #[test]
    fn files_are_in_base64() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            let uri = data_uri("text/plain", bytes.as_bytes());
            assert_eq!(uri, format!("data:text/plain;base64,{text}"));
        }
    }

    #[test]
    fn tables_say_units_and_align_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.csv");
        std::fs::write(
            &file,
            "joint,fold_sd_deg,px,t_r\n<a>,1.23456,7,0.9\nb,,123456,0.95\n<c>,12,8,1\n",
        )
        .unwrap();
        let (html, rows) = table(&file).unwrap();
        assert_eq!(rows, 3);
        for part in [
            "<th scope=\"col\">joint</th><th scope=\"col\" class=\"n\">fold sd (deg)</th>",
            "<td>&lt;a&gt;</td><td class=\"n\">1.235</td><td class=\"n\">7</td><td class=\"n\">0.9</td>",
            "<td>b</td><td class=\"n\"></td><td class=\"n\">123456</td><td class=\"n\">0.95</td>",
            "<td>&lt;c&gt;</td><td class=\"n\">12.00</td><td class=\"n\">8</td><td class=\"n\">1</td>",
        ] {
            assert!(html.contains(part), "{html}");
        }
    }

    #[test]
    fn numbers_have_four_digits_at_any_size() {
        let shown = [0.0, 0.012, -1.0, 9.9999, 24.0, 123.45, 123456.7, 2.5e-9].map(four_digits);
        let expected = [
            "0", "0.01200", "-1.000", "10.000", "24.00", "123.5", "123500", "2.5e-9",
        ];
        assert_eq!(shown, expected);
    }

    #[test]
    fn slots_are_filled_once() {
        let page = fill("a {{x}} b {{y}} c", &[("x", "{{y}}"), ("y", "1")]);
        assert_eq!(page, "a {{y}} b 1 c");
    }
}
