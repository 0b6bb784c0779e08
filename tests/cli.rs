//! The program as people meet it: messages, exit codes, what goes to stdout and what to stderr.

use std::path::Path;
use std::process::{Command, Output, Stdio};

fn armpose(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_armpose"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// A repository whose studies are these files.
fn repository(studies: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("Cargo.toml"), "").unwrap();
    std::fs::create_dir(folder.path().join("experiments")).unwrap();
    for (id, text) in studies {
        let path = folder.path().join("experiments").join(format!("{id}.toml"));
        std::fs::write(path, text).unwrap();
    }
    folder
}

/// Exit code 2, nothing on stdout, and exactly this on stderr.
fn fails(folder: &Path, arguments: &[&str], message: &str) {
    let output = armpose(folder, arguments);
    assert_eq!(String::from_utf8_lossy(&output.stderr), message);
    assert_eq!(String::from_utf8_lossy(&output.stdout), "");
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn an_unknown_study_is_told_the_nearest_one() {
    let repository = repository(&[("fig9", ""), ("tuning", "")]);
    fails(
        repository.path(),
        &["experiment", "fig99", "--plan"],
        "armpose: there is no study `fig99`; did you mean `fig9`? \
         (`armpose experiment list` shows all)\n",
    );
    fails(
        repository.path(),
        &["experiment", "nothing-like-it"],
        "armpose: there is no study `nothing-like-it` (`armpose experiment list` shows all)\n",
    );
}

#[test]
fn bad_toml_is_shown_with_its_place() {
    let repository = repository(&[("fig9", "title = 'a'\nkind = \n")]);
    let output = armpose(repository.path(), &["experiment", "show", "fig9"]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        message.starts_with("armpose: experiments/fig9.toml:2:"),
        "{message}"
    );
    assert!(message.contains("\n2 | kind = \n"), "{message}");
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_subfolder_will_do() {
    let repository = repository(&[("fig9", "kind = 'no-such-kind'\n")]);
    let deep = repository.path().join("experiments");
    let output = armpose(&deep, &["experiment", "all", "--profile", "smoke"]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    let start = "armpose: experiments/fig9.toml: there is no study kind `no-such-kind`";
    assert!(message.starts_with(start), "{message}");
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn mistakes_on_the_command_line_have_exit_code_2() {
    let repository = repository(&[]);
    for arguments in [
        &["experiment"][..],
        &["experiment", "show"],
        &["experiment", "list", "--profile", "huge"],
        &["experiment", "list", "fig9"],
        &["experiment", "all", "fig9"],
        &["experiment", "list", "--threads", "0"],
        &["experimnet"],
        &["check", "--profile", "smoke"],
    ] {
        let output = armpose(repository.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(
            output.stdout.is_empty() && !output.stderr.is_empty(),
            "{arguments:?}"
        );
    }
}

#[test]
fn nobody_listening_is_not_an_error() {
    let repository = repository(&[]);
    let mut child = Command::new(env!("CARGO_BIN_EXE_armpose"))
        .args(["experiment", "list"])
        .current_dir(repository.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stderr.is_empty());
}
