//! The program's command line. These tests also make cargo build the program, which the system tests start.

use std::process::{Command, Output};

fn call(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rondo-env-server")).args(arguments).output().expect("the program starts")
}

#[test]
fn help_names_the_options() {
    let output = call(&["--help"]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{text}");
    for option in ["--config <FILE>", "--out <DIR>", "--listen <ENDPOINT>", "--wait <SECONDS>"] {
        assert!(text.contains(option), "{option} is missing in {text}");
    }
}

#[test]
fn a_missing_argument_is_named_and_ends_with_the_code_for_usage() {
    let output = call(&["--config=c.toml", "--out=run"]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(64), "{text}");
    assert!(text.contains("--listen <ENDPOINT>"), "{text}");
}
