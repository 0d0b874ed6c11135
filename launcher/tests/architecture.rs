//! Checks the claims of ARCHITECTURE.md and the unit files against manifests, sources and units.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The arrows: each crate of the workspace, and the crates that it may depend on. The launcher may depend on all.
const ARROWS: [(&str, &[&str]); 10] = [
    ("proto", &[]),
    ("envs", &[]),
    ("algos", &[]),
    ("bus", &[]),
    ("store", &[]),
    ("monitor", &["envs"]),
    ("process", &["proto", "bus", "store"]),
    ("coordinator", &["proto", "bus", "store", "process"]),
    ("env-server", &["proto", "bus", "store", "process", "envs"]),
    ("agent", &["proto", "bus", "store", "process", "algos"]),
];
const TOP: &str = "launcher";

/// Outside crates that one crate only may depend on.
const ONE_DOOR: [(&str, &str); 6] = [
    ("zenoh", "bus"),
    ("bincode", "proto"),
    ("gemm", "algos"),
    ("candle-core", "algos"),
    ("resvg", "monitor"),
    ("gif", "monitor"),
];

/// Modules of the standard library that `proto`, `envs` and `algos` do without.
const IMPURE: [&str; 6] = ["env", "fs", "net", "process", "thread", "time"];

fn crates() -> impl Iterator<Item = &'static str> {
    ARROWS.iter().map(|(name, _)| *name).chain([TOP])
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("cannot read {}: {error}", path.display()))
}

fn manifest(folder: &str) -> toml::Table {
    let path = root().join(folder).join("Cargo.toml");
    read(&path).parse().unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The dependencies of a manifest: of the library, of tests and of single targets.
fn dependencies(manifest: &toml::Table) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (name, value) in manifest {
        let Some(table) = value.as_table() else { continue };
        if name.ends_with("dependencies") {
            found.extend(table.keys().cloned());
        } else {
            found.extend(dependencies(table));
        }
    }
    found
}

/// The source files of a crate, with their paths from the root.
fn sources(name: &str) -> Vec<(String, String)> {
    let mut waiting = vec![Path::new(name).join("src")];
    let mut found = Vec::new();
    while let Some(folder) = waiting.pop() {
        for entry in fs::read_dir(root().join(&folder)).expect("a readable folder") {
            let entry = entry.expect("a readable folder");
            let path = folder.join(entry.file_name());
            if entry.file_type().expect("a file or a folder").is_dir() {
                waiting.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push((path.display().to_string(), read(&entry.path())));
            }
        }
    }
    assert!(!found.is_empty(), "no sources in {name}");
    found
}

/// The lines of a file without their `//` comments.
fn code(text: &str) -> impl Iterator<Item = &str> {
    text.lines().map(|line| line.split("//").next().unwrap_or_default())
}

fn words(line: &str) -> impl Iterator<Item = &str> {
    line.split(|c: char| c != '_' && !c.is_alphanumeric())
}

/// The modules that a line names directly below `std`: in `std::fs::read` and in `use std::{fmt, fs}`.
fn std_modules(line: &str) -> Vec<&str> {
    let mut found = Vec::new();
    for (start, path) in line.match_indices("std::") {
        let rest = &line[start + path.len()..];
        match rest.strip_prefix('{') {
            Some(list) => found.extend(list.split(',').filter_map(|item| words(item.trim()).next())),
            None => found.extend(words(rest).next()),
        }
    }
    found
}

#[test]
fn every_crate_of_the_workspace_has_its_arrows() {
    let workspace = manifest(".");
    let members = workspace["workspace"]["members"].as_array().expect("members are a list");
    let members: BTreeSet<&str> = members.iter().filter_map(|member| member.as_str()).collect();
    assert_eq!(members, crates().collect());
}

#[test]
fn crates_depend_on_what_the_arrows_allow_and_roles_not_on_each_other() {
    for (name, allowed) in ARROWS {
        for dependency in dependencies(&manifest(name)) {
            let ours = crates().any(|other| other == dependency);
            assert!(
                !ours || allowed.contains(&dependency.as_str()),
                "{name} must not depend on {dependency}"
            );
        }
    }
}

#[test]
fn what_has_one_door_is_named_by_one_crate() {
    for (outside, door) in ONE_DOOR {
        let named: Vec<_> = crates().filter(|name| dependencies(&manifest(name)).contains(outside)).collect();
        assert_eq!(named, [door], "crates that name {outside}");
    }
}

#[test]
fn candle_is_built_for_tests_and_for_gpus_only() {
    let algos = manifest("algos");
    for (name, how) in algos["dependencies"].as_table().expect("a table") {
        let optional = how.get("optional").and_then(toml::Value::as_bool) == Some(true);
        assert!(!name.starts_with("candle") || optional, "algos is built with {name}");
    }
    for name in ["algos", "agent", TOP] {
        let features = &manifest(name)["features"];
        assert!(features.get("cuda").is_some() && features.get("default").is_none(), "features of {name}");
    }
}

#[test]
fn bincode_is_named_in_the_codec_only() {
    for (path, text) in sources("proto") {
        let named = code(&text).any(|line| words(line).any(|word| word == "bincode"));
        assert_eq!(named, path == "proto/src/codec.rs", "{path}");
    }
}

#[test]
fn one_file_is_unsafe() {
    let is_unsafe =
        |text: &str| code(text).any(|line| words(line).any(|word| ["unsafe", "unsafe_code"].contains(&word)));
    let found: Vec<_> =
        crates().flat_map(sources).filter(|(_, text)| is_unsafe(text)).map(|(path, _)| path).collect();
    assert_eq!(found, ["algos/src/kernels/gemm.rs"]);
}

#[test]
fn messages_worlds_and_learners_touch_no_file_no_network_no_process_and_no_clock() {
    for name in ["proto", "envs", "algos"] {
        for (path, text) in sources(name) {
            for line in code(&text) {
                let impure = std_modules(line).into_iter().find(|module| IMPURE.contains(module));
                assert_eq!(impure, None, "{path}: {line}");
            }
        }
    }
}

/// `rondo ROLE` takes the same arguments as the program `rondo-ROLE` that the units start.
#[test]
fn the_unit_files_start_the_roles_with_arguments_that_these_understand() {
    let mut roles = BTreeSet::new();
    for entry in fs::read_dir(root().join("deploy")).expect("a readable folder") {
        let path = entry.expect("a readable folder").path();
        if path.extension().is_none_or(|extension| extension != "service") {
            continue;
        }
        let text = read(&path);
        let start = text.lines().find_map(|line| line.strip_prefix("ExecStart=")).expect("a command");
        let (program, arguments) = start.split_once(' ').expect("a role has arguments");
        let role = program.strip_prefix("/usr/local/bin/rondo-").expect("a role");
        // An option that is unknown or lacks its value is reported before help is given.
        let output = Command::new(env!("CARGO_BIN_EXE_rondo"))
            .arg(role)
            .args(arguments.replace("%i", "0").split(' '))
            .arg("--help")
            .output()
            .expect("the program starts");
        let complaint = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}: {complaint}", path.display());
        roles.insert(role.to_owned());
    }
    assert_eq!(roles, BTreeSet::from(["agent", "coordinator", "env-server"].map(str::to_owned)));
}
