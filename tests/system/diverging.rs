//! A learner with infinite numbers ends the run with a message, and the last checkpoint is unchanged.

use std::fs;

use nix::sys::signal::Signal;
use store::{Checkpoint, RunFolder};

use crate::cluster::{experiment, Cluster};
use crate::q_learning;

const NOTHING: [&str; 0] = [];

/// Gives agent 1's networks finite weights that are so large that computing with them overflows.
fn blow_up(cluster: &Cluster, network: &str) -> Checkpoint {
    let folder = RunFolder::open(cluster.path("run")).expect("a run");
    let checkpoints = folder.role("agent-1").expect("its folder").checkpoints();
    let newest = *checkpoints.rounds().expect("readable").last().expect("it saved when it left");
    let mut checkpoint = checkpoints.load(newest).expect("it is whole");
    for tensor in checkpoint.tensors.iter_mut().filter(|tensor| tensor.name.starts_with(network)) {
        tensor.data.fill(1e30);
    }
    checkpoints.save(&checkpoint).expect("there is room");
    checkpoint
}

#[test]
fn a_learner_that_diverges_ends_the_run_with_its_reason_and_keeps_the_last_checkpoint() {
    for (words, network) in [(experiment(1, 9_000), "critic."), (q_learning::foraging(), "q.")] {
        let cluster = Cluster::new();
        let training = cluster.train("run", words, NOTHING);
        cluster.run("run").reaches(1_500);
        training.signal(Signal::SIGINT);
        assert_eq!(training.wait().code, Some(75));
        let before = blow_up(&cluster, network);

        // Resuming ends in the same way, so the exit code does not mean "try again".
        let ends = || {
            let ended = cluster.resume("run").wait();
            ended.fails_with(78, &["agent-1: agent 1 diverged in update call ", "`--lr-fast`, `--lr-slow`"]);
            let line = ended.stderr.lines().find(|line| line.contains("diverged")).expect("it is there");
            line[line.find("agent 1").expect("it is named")..].to_owned()
        };
        let first = ends();
        assert_eq!(ends(), first);
        let folder = RunFolder::open(cluster.path("run")).expect("a run");
        let checkpoints = folder.role("agent-1").expect("its folder").checkpoints();
        assert_eq!(checkpoints.rounds().expect("readable").last(), Some(&before.round));
        assert_eq!(checkpoints.load(before.round).expect("whole").state, before.state);
        let rows = fs::read_to_string(cluster.path("run").join("agent-1/metrics.jsonl")).expect("rows");
        assert!(!rows.contains("inf") && !rows.contains("NaN") && !rows.contains("null"), "{rows}");
    }
}
