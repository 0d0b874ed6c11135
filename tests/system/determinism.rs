//! The digest depends on program, configuration and seed only.

use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::cluster::{experiment, short, undisturbed, wait_until, Cluster};

const NOTHING: [&str; 0] = [];

#[test]
fn processes_threads_and_both_transports_come_to_one_digest_every_time() {
    let cluster = Cluster::new();
    let ways: [(&str, &[&str]); 4] =
        [("first", &[]), ("again", &[]), ("tcp", &["--transport=tcp"]), ("threads", &["--in-process"])];
    for (run, more) in ways {
        cluster.train(run, short(), more).succeeds();
        assert_eq!(cluster.digest(run), undisturbed(), "{run}");
    }
    // The digest is over something: every role has written rows, every agent has weights.
    for role in ["world", "agent-0", "agent-1"] {
        assert!(cluster.run("first").rows(role).len() > 5, "{role}");
    }
}

#[test]
fn another_seed_comes_to_another_digest() {
    let cluster = Cluster::new();
    cluster.train("two", experiment(2, 9_000), ["--in-process"]).succeeds();
    let (one, two) = (parsed(undisturbed()), parsed(&cluster.digest("two")));
    assert_ne!(one["metrics"], two["metrics"]);
    for agent in 0..2 {
        assert_ne!(one["agents"][agent], two["agents"][agent], "agent {agent}");
    }
}

#[test]
fn an_agent_that_stands_still_for_three_seconds_changes_nothing() {
    let cluster = Cluster::new();
    let mut training = cluster.train("run", short(), NOTHING);
    cluster.run("run").reaches(3_000);
    let agent = training.child("agent-1");
    agent.signal(Signal::SIGSTOP);
    let rows = || cluster.run("run").rows("world").len();
    let before = rows();
    let stopped = Instant::now();
    wait_until("three seconds to pass", || stopped.elapsed() >= Duration::from_secs(3));
    // No role continues without it; a row may still be written.
    assert!(rows() <= before + 1, "{} rows after {before}", rows());
    agent.signal(Signal::SIGCONT);
    training.succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
}

#[test]
fn a_run_that_was_asleep_for_longer_than_its_patience_goes_on() {
    let cluster = Cluster::new();
    let mut training = cluster.train("run", short(), ["--wait=2"]);
    cluster.run("run").reaches(3_000);
    let children = training.children();
    children.iter().for_each(|child| child.signal(Signal::SIGSTOP));
    let stopped = Instant::now();
    wait_until("four seconds to pass", || stopped.elapsed() >= Duration::from_secs(4));
    children.iter().for_each(|child| child.signal(Signal::SIGCONT));
    training.succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
}

fn parsed(line: &str) -> serde_json::Value {
    serde_json::from_str(line).expect("a digest is JSON")
}
