//! What the schedule does to learning, by the weights that whole runs come to (spec §6).

use crate::cluster::{experiment, Cluster};

/// Digests of each agent's weights after a run in threads, with the last of these words added.
fn weights(words: &[&str]) -> [String; 2] {
    let cluster = Cluster::new();
    cluster.train("run", experiment(3, 4_000), words.iter().copied().chain(["--in-process"])).succeeds();
    let digest: serde_json::Value = serde_json::from_str(&cluster.digest("run")).expect("a digest is JSON");
    [0, 1].map(|agent| digest["agents"][agent].as_str().expect("a digest for each agent").to_owned())
}

#[test]
fn with_equal_rates_the_period_does_not_matter_and_it_is_independent_ppo() {
    let equal = |more: &[&str]| weights(&[&["--lr-fast=0.001", "--lr-slow=0.001"], more].concat());
    let independent = weights(&["--algo=ippo", "--lr-fast=0.001"]);
    for period in ["1", "7", "inf"] {
        let found = equal(&["--algo=mtppo", &format!("--set=schedule.switch_period={period}")]);
        assert_eq!(found, independent, "period {period}");
    }
    assert_ne!(weights(&["--algo=ippo", "--lr-fast=0.0005"]), independent);
}

#[test]
fn in_sequential_ppo_only_the_agent_whose_turn_it_is_learns() {
    // One period for the whole run: agent 0 learns, at one rate or at another; agent 1 never does.
    let run = |rate: &str| weights(&["--algo=sppo", "--set=schedule.switch_period=inf", rate]);
    let (slowly, quickly) = (run("--lr-fast=0.0001"), run("--lr-fast=0.001"));
    assert_ne!(slowly[0], quickly[0]);
    assert_eq!(slowly[1], quickly[1]);
    // Where turns are taken, agent 1 learns too.
    let in_turns = weights(&["--algo=sppo", "--lr-fast=0.001"]);
    assert_ne!(in_turns[1], quickly[1]);
}
