//! Several seeds with one command.

use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::cluster::{experiment, short, undisturbed, wait_until, Cluster, Member};

#[test]
fn seeds_side_by_side_come_to_the_results_of_single_runs() {
    let cluster = Cluster::new();
    cluster.train("sweep", short(), ["--seeds=2", "--jobs=2"]).succeeds();
    assert_eq!(cluster.digest("sweep/seed-1"), undisturbed());
    cluster.train("second", experiment(2, 9_000), ["--in-process"]).succeeds();
    assert_eq!(cluster.digest("sweep/seed-2"), cluster.digest("second"));
}

/// Signals a sweep of two teams side by side. Returns its exit code when all processes are gone.
fn end_a_sweep_with(signal: Signal) -> (Cluster, Option<i32>) {
    let cluster = Cluster::new();
    let endless = experiment(1, 10_000_000);
    let mut sweep = cluster.train("sweep", endless, ["--seeds=3", "--jobs=2"]);
    cluster.run("sweep/seed-1").reaches(1_000);
    cluster.run("sweep/seed-2").reaches(1_000);
    let everybody = sweep.descendants();
    assert_eq!(everybody.len(), 10, "two launchers with four roles each");
    let before = Instant::now();
    sweep.signal(signal);
    // Before `wait`, which kills remaining processes.
    wait_until("everybody to be gone", || !everybody.iter().any(Member::is_alive));
    let ended = sweep.wait();
    assert!(before.elapsed() < Duration::from_secs(3), "{:?}", before.elapsed());
    (cluster, ended.code)
}

#[test]
fn an_interrupted_sweep_saves_each_team_and_starts_no_other() {
    for signal in [Signal::SIGINT, Signal::SIGHUP, Signal::SIGUSR1] {
        let (cluster, code) = end_a_sweep_with(signal);
        assert_eq!(code, Some(75), "{signal}");
        for seed in ["sweep/seed-1", "sweep/seed-2"] {
            assert!(!cluster.run(seed).checkpoints("agent-0").is_empty(), "{signal}: {seed} has saved");
        }
        assert!(!cluster.path("sweep/seed-3").exists());
    }
}

#[test]
fn nobody_outlives_a_killed_sweep_and_each_team_has_saved() {
    let (cluster, code) = end_a_sweep_with(Signal::SIGKILL);
    assert_eq!(code, None);
    for seed in ["sweep/seed-1", "sweep/seed-2"] {
        assert!(!cluster.run(seed).checkpoints("agent-0").is_empty(), "{seed} has saved");
    }
}
