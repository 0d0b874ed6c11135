//! The display of a run on every kind of terminal and without one: all show progress.

use std::process::Command;

use crate::cluster::{rondo, Cluster, Process};
use crate::q_learning::foraging;

/// The run is over in a second or two and shows how far it has come, in each place.
const PROGRESS: [&str; 2] = [" steps", "test return "];

fn train(cluster: &Cluster) -> Command {
    let mut command = rondo();
    command.arg("train").args(foraging()).args(["--in-process", "--out"]).arg(cluster.path("run"));
    command
}

/// The stderr of a run in a terminal with so many columns and these environment variables.
fn on_a_terminal(columns: u32, environment: &str) -> String {
    let cluster = Cluster::new();
    let train = train(&cluster);
    let words = std::iter::once(train.get_program()).chain(train.get_args());
    let words: Vec<String> =
        words.map(|word| format!("'{}'", word.to_str().expect("no odd paths here"))).collect();
    let summary = cluster.path("summary");
    let command = format!(
        "stty cols {columns} rows 24; exec env {environment} {} >'{}'",
        words.join(" "),
        summary.display()
    );
    let mut script = Command::new("script");
    script.args(["--quiet", "--return", "--command", &command]).arg(cluster.path("typescript"));
    script.env("SHELL", "/bin/sh").env_remove("NO_COLOR").env("TERM", "xterm");
    Process::start(script).succeeds().stdout
}

fn shows_progress(seen: &str) {
    for part in PROGRESS {
        assert!(seen.contains(part), "expected {part:?} in {seen:?}");
    }
}

/// Whether something was drawn over.
fn is_live(seen: &str) -> bool {
    seen.contains('\u{1b}')
}

#[test]
fn a_terminal_gets_a_live_display_with_what_the_learners_publish() {
    let seen = on_a_terminal(300, "");
    shows_progress(&seen);
    assert!(is_live(&seen) && seen.contains(" · loss ") && seen.contains(" · epsilon "), "{seen:?}");
}

#[test]
fn a_terminal_that_cannot_be_drawn_on_gets_lines() {
    for environment in ["TERM=dumb", "-u TERM"] {
        let seen = on_a_terminal(80, environment);
        shows_progress(&seen);
        assert!(!is_live(&seen), "{seen:?}");
    }
}

#[test]
fn a_terminal_of_twenty_columns_gets_the_progress_alone() {
    let seen = on_a_terminal(20, "");
    shows_progress(&seen);
    assert!(is_live(&seen) && !seen.contains("loss"), "{seen:?}");
}

#[test]
fn without_colours_there_is_progress_too() {
    let seen = on_a_terminal(80, "NO_COLOR=1");
    shows_progress(&seen);
    // No bold and no colours: only the cursor moves.
    assert!(is_live(&seen) && !seen.contains("\u{1b}[1m"), "{seen:?}");
}

#[test]
fn without_a_terminal_lines_show_progress() {
    let seen = Process::start(train(&Cluster::new())).succeeds().stderr;
    shows_progress(&seen);
    assert!(!is_live(&seen), "{seen:?}");
}

#[test]
fn a_world_that_is_not_all_that_its_name_promises_says_so_when_a_team_starts_to_learn_it() {
    let warning = "a reset places at most 2 of the 3 foods";
    for place in [&["--in-process"][..], &[]] {
        let cluster = Cluster::new();
        let mut train = rondo();
        train.args(["train", "Foraging-5x5-3p-3f-coop-v2", "--t-max=500", "--test-episodes=1"]).args(place);
        train.arg("--set=algo.hidden=8").arg("--out").arg(cluster.path("run"));
        let seen = Process::start(train).succeeds().stderr;
        assert_eq!(seen.matches(warning).count(), 1, "{seen}");
    }
}
