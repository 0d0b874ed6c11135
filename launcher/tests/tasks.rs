//! The output of `rondo tasks`.

use std::fs;
use std::process::{Command, Output};

fn tasks(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rondo")).arg("tasks").args(words).output().expect("the program starts")
}

#[test]
fn a_task_is_explained_without_a_picture_where_no_terminal_is() {
    let output = tasks(&["lbf-5x5-2p-1f"]);
    let said = String::from_utf8(output.stdout).expect("text");
    assert!(output.status.success());
    assert!(said.starts_with("lbf-5x5-2p-1f: Level-based foraging\n\n"), "{said}");
    assert!(!said.contains('\x1b'), "{said}");
}

#[test]
fn the_picture_goes_into_the_file_that_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("start.png");
    let path = out.to_str().expect("text");
    let output = tasks(&["lbf-5x5-2p-1f", "--out", path]);
    let said = String::from_utf8(output.stdout).expect("text");
    assert!(said.ends_with(&format!("\ndrawn in {path}\n")), "{said}");
    assert!(fs::read(&out).expect("a picture").starts_with(b"\x89PNG\r\n\x1a\n"));
}

#[test]
fn an_unknown_task_and_another_kind_of_picture_are_refused_in_one_line() {
    for (words, code, line) in [
        (
            &["lbf-8x8-2p-2f-cop"][..],
            78,
            "error: there is no task `lbf-8x8-2p-2f-cop`: expected `coop` or a version of the rules, `v0` to `v3`",
        ),
        (
            &["lbf-5x5-2p-1f", "--out", "start.pdf"],
            64,
            "error: unknown picture format in start.pdf; end the name in .svg or .png",
        ),
    ] {
        let output = tasks(words);
        let complaint = String::from_utf8(output.stderr).expect("text");
        assert_eq!((output.status.code(), output.stdout.len()), (Some(code), 0), "{complaint}");
        assert!(complaint.starts_with(line) && complaint.lines().count() == 1, "{complaint}");
    }
}
