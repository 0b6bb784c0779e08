//! How results came about: their manifest, folded.

use super::markup::Escaped;
use super::results::Results;
use crate::experiment::progress::duration;
use serde_json::Value;
use std::fmt::Write;

pub fn provenance(results: &Results) -> String {
    let fact = |pointer: &str| results.fact(pointer);
    let changed = match results.manifest["machine"]["git_dirty"].as_bool() {
        Some(true) => ", with changes",
        _ => "",
    };
    let settings = results.manifest["study"]["settings"].as_array();
    let settings = settings.into_iter().flatten().filter_map(Value::as_str);
    let settings: Vec<&str> = settings.collect();
    let memory = match results.manifest["machine"]["memory_megabytes"].as_f64() {
        Some(megabytes) => format!("{megabytes:.0} MB"),
        None => "unknown".to_owned(),
    };
    let rows = [
        ("Command", results.command()),
        (
            "Profile, seed",
            format!("{}, {}", fact("/profile"), fact("/seed")),
        ),
        ("Settings", settings.join(" ")),
        ("Started", fact("/started")),
        ("Cost", results.cost()),
        (
            "Revision",
            format!("{}{changed}", fact("/machine/git_revision")),
        ),
        (
            "Compiler",
            format!("{}, {}", fact("/machine/rustc"), fact("/machine/target")),
        ),
        (
            "Processor",
            format!("{}, {} cores", fact("/machine/cpu"), fact("/machine/cores")),
        ),
        ("Threads", fact("/threads")),
        ("Memory", memory),
        (
            "Study",
            format!("{}, BLAKE3 {}", fact("/study/file"), fact("/study/blake3")),
        ),
        (
            "Cargo.lock",
            format!("BLAKE3 {}", fact("/machine/cargo_lock_blake3")),
        ),
    ];
    let mut html =
        "<details class=\"how\">\n<summary>How this came about</summary>\n<dl>\n".to_owned();
    for (name, value) in rows.iter().filter(|(_, value)| !value.is_empty()) {
        let _ = writeln!(html, "<dt>{name}</dt><dd>{}</dd>", Escaped(value));
    }
    html.push_str("</dl>\n");
    let seconds = |step: &Value| step["seconds"].as_f64().map_or_else(String::new, duration);
    let made = |step: &Value| {
        if step["cached"] == true {
            "earlier"
        } else {
            "in this run"
        }
    };
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let key = |step: &Value| {
        format!(
            "{}/{}",
            text(&step["key"]["stage"]),
            text(&step["key"]["hash"])
        )
    };
    html.push_str(&list(
        "Steps",
        ["step", "made", "in", "key: all that went in"],
        results.manifest["tasks"].as_array(),
        |step| {
            [
                text(&step["label"]),
                made(step).to_owned(),
                seconds(step),
                key(step),
            ]
        },
    ));
    html.push_str(&list(
        "Files",
        ["file", "bytes", "BLAKE3"],
        results.manifest["outputs"].as_array(),
        |file| {
            [
                text(&file["name"]),
                file["bytes"].to_string(),
                text(&file["blake3"]),
            ]
        },
    ));
    let parameters = serde_json::to_string_pretty(&results.manifest["study"]["parameters"]);
    let _ = writeln!(
        html,
        "<details>\n<summary>Parameters</summary>\n<pre>{}</pre>\n</details>\n</details>",
        Escaped(parameters.unwrap_or_default())
    );
    html
}

fn list<const N: usize>(
    title: &str,
    columns: [&str; N],
    entries: Option<&Vec<Value>>,
    row: impl Fn(&Value) -> [String; N],
) -> String {
    let mut html = format!(
        "<details>\n<summary>{title}</summary>\n<div class=\"wide\" role=\"region\" \
         aria-label=\"{title}\" tabindex=\"0\">\n<table>\n<thead><tr>"
    );
    for column in columns {
        let _ = write!(html, "<th scope=\"col\">{column}</th>");
    }
    html.push_str("</tr></thead>\n<tbody>\n");
    for entry in entries.into_iter().flatten() {
        html.push_str("<tr>");
        for cell in row(entry) {
            let _ = write!(html, "<td>{}</td>", Escaped(cell));
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody>\n</table>\n</div>\n</details>\n");
    html
}
