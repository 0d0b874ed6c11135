//! The effect of the schedule on learning, seen in the weights of whole runs (algorithms §6).

use std::fs;

use crate::cluster::{experiment, rondo, Cluster, Process};
use crate::q_learning::{foraging_with, speaking_with};

/// Digests of each agent's weights after a run of PPO in threads, with these words added.
fn weights(words: &[&str]) -> [String; 2] {
    weights_after(experiment(3, 4_000), words)
}

/// Digests of each agent's weights after a run in threads.
fn weights_after(experiment: Vec<String>, words: &[&str]) -> [String; 2] {
    let cluster = Cluster::new();
    cluster.train("run", experiment, words.iter().copied().chain(["--in-process"])).succeeds();
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

#[test]
fn with_equal_rates_the_period_does_not_matter_and_it_is_independent_q_learning() {
    let independently = |rate: &str| weights_after(foraging_with("iql"), &[&format!("--lr-fast={rate}")]);
    let independent = independently("0.001");
    for period in ["1", "7", "inf"] {
        let period = format!("--set=schedule.switch_period={period}");
        let equal = ["--lr-fast=0.001", "--lr-slow=0.001", &period];
        assert_eq!(weights_after(foraging_with("mtql"), &equal), independent, "{period}");
    }
    assert_ne!(independently("0.0005"), independent);
}

#[test]
fn in_sequential_q_learning_an_agent_that_never_has_its_turn_keeps_its_first_weights() {
    let weights = |words: &[&str]| weights_after(foraging_with("sql"), words);
    // A single episode, without learning yet.
    let untrained = weights(&["--set=t_max=1"]);
    let one_learns = weights(&["--set=schedule.switch_period=inf"]);
    assert_ne!(one_learns[0], untrained[0]);
    assert_eq!(one_learns[1], untrained[1]);
    // With turns, agent 1 learns too, and agent 0 does not change meanwhile.
    let in_turns = weights(&[]);
    assert_ne!(in_turns[1], untrained[1]);
    assert_ne!(in_turns[0], one_learns[0]);
}

#[test]
fn in_sequential_q_learning_everything_of_an_agent_stands_still_for_as_long_as_others_learn() {
    let cluster = Cluster::new();
    // Every episode has 25 steps. The fourth makes the first update call, so 18 episodes make 15, of which
    // those from number 10 on are agent 1's; the checkpoints after 16 and 18 episodes fall into its turn.
    let words = [
        "--set=t_max=450",
        "--set=schedule.switch_period=10",
        "--set=save.interval=4",
        "--set=algo.frozen_moments=hold",
        "--set=algo.target_update=1000",
        "--in-process",
    ];
    cluster.train("run", speaking_with("sql"), words).succeeds();
    let run = cluster.run("run");
    let saved = |role: &str| {
        assert_eq!(run.checkpoints(role), [16, 18], "{role}");
        [16, 18]
            .map(|round| fs::read(run.checkpoint(role, round).join("weights.safetensors")).expect("weights"))
    };
    let ([stood, still], [was, learned]) = (saved("agent-0"), saved("agent-1"));
    assert!(stood == still, "agent 0 has no turn between the two");
    assert!(was != learned, "agent 1 has");
}

/// The digest of a run in threads.
fn digest(experiment: &[String], words: &[&str]) -> String {
    let cluster = Cluster::new();
    cluster.train("run", experiment.to_vec(), words.iter().copied().chain(["--in-process"])).succeeds();
    cluster.digest("run")
}

#[test]
fn the_rules_for_the_end_of_a_batch_differ_where_episodes_end_early() {
    // Long enough to have episodes that end less than a window before the longest of their batch.
    let foraging = experiment(1, 6_000);
    let of = |words: &[&str]| digest(&foraging, words);
    let (correct, epymarl) =
        (of(&["--set=ppo.end_of_batch=correct"]), of(&["--set=ppo.end_of_batch=epymarl"]));
    assert_ne!(correct, epymarl);
    // The default is the first of them, the reference's profile brings the second.
    assert_eq!(of(&[]), correct);
    assert_eq!(of(&["--profile=epymarl"]), epymarl);
}

#[test]
fn the_rules_for_the_end_of_a_batch_are_one_where_every_episode_has_full_length() {
    let words = ["mpe-simple-speaker-listener", "--t-max=1500", "--test-episodes=2", "--set=algo.hidden=8"];
    let speaking: Vec<String> = words.map(str::to_owned).into();
    let of = |rule: &str| digest(&speaking, &[&format!("--set=ppo.end_of_batch={rule}")]);
    let correct = of("correct");
    assert_eq!(of("epymarl"), correct);
    // The rule is used.
    assert_ne!(of("no_bootstrap"), correct);
}

#[test]
fn a_command_that_brings_the_references_rule_says_so_once() {
    let note = |by: &str| format!("note: `{by}` sets ppo.end_of_batch = epymarl, the reference's rule, ");
    let config = |words: &[&str]| {
        let mut command = rondo();
        command.arg("config").args(words);
        Process::start(command).succeeds()
    };
    for (words, by) in [(&["--paper"][..], "--paper"), (&["--profile=epymarl"], "--profile epymarl")] {
        let ended = config(words);
        assert_eq!(ended.stderr.matches(&note(by)).count(), 1, "{ended:#?}");
        assert!(ended.stdout.contains("\nprofile = \"epymarl\"\n"), "{ended:#?}");
        assert!(ended.stdout.contains("\nend_of_batch = \"epymarl\"\n"), "{ended:#?}");
    }
    for words in [&[][..], &["--paper", "--set=ppo.end_of_batch=correct"], &["--paper", "--algo=iql"]] {
        assert_eq!(config(words).stderr, "", "{words:?}");
    }
    // One note, whatever trains behind it.
    let cluster = Cluster::new();
    let words = ["--seeds=2", "--profile=epymarl", "--in-process"];
    let ended = cluster.train("seeds", experiment(1, 500), words).succeeds();
    assert_eq!(ended.stderr.matches("note: ").count(), 1, "{ended:#?}");
    assert!(ended.stderr.contains(&note("--profile epymarl")), "{ended:#?}");
}
