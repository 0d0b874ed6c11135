//! Roles that die: the run ends with a message that names them, and no process is left.

use std::fs;
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::cluster::{experiment, rondo, short, undisturbed, wait_until, Cluster, Ended, Member, Process};

const NOTHING: [&str; 0] = [];

/// All processes of a run are gone after this time, for any end.
const NO_ORPHAN_AFTER: Duration = Duration::from_secs(2);

/// A run that is longer than the test.
fn endless() -> Vec<String> {
    experiment(1, 10_000_000)
}

/// A run of four processes that has begun to learn.
fn running(cluster: &Cluster, experiment: Vec<String>) -> (Process, Vec<Member>) {
    let mut training = cluster.train("run", experiment, NOTHING);
    cluster.run("run").reaches(1_000);
    let children = training.children();
    assert_eq!(children.len(), 4, "env-server, coordinator and two agents");
    (training, children)
}

/// Waits for the end of the launcher. Checks the time since `before`, and that no child is left.
#[track_caller]
fn ends_in_time(training: Process, children: &[Member], before: Instant) -> Ended {
    // Before `wait`, which kills remaining processes.
    wait_until("the children to be gone", || !children.iter().any(Member::is_alive));
    let ended = training.wait();
    assert!(before.elapsed() < NO_ORPHAN_AFTER, "{:?}", before.elapsed());
    ended
}

#[test]
fn no_process_is_left_after_each_kind_of_signal_to_the_launcher() {
    for (signal, code) in [(Signal::SIGINT, Some(75)), (Signal::SIGTERM, Some(75)), (Signal::SIGKILL, None)] {
        let cluster = Cluster::new();
        let (training, children) = running(&cluster, endless());
        let before = Instant::now();
        training.signal(signal);
        let ended = ends_in_time(training, &children, before);
        assert_eq!(ended.code, code, "{signal}: {ended:#?}");
    }
}

/// Kills one role. The launcher must name it and end the others, and the run must be resumable.
fn a_role_dies(role: &str, name: &str) {
    let cluster = Cluster::new();
    let (mut training, children) = running(&cluster, short());
    let victim = training.child(role);
    let before = Instant::now();
    victim.signal(Signal::SIGKILL);
    let ended = ends_in_time(training, &children, before);
    let says = format!("error: {name}: was ended by SIGKILL");
    let advice = format!("hint: continue with `rondo resume {}`", cluster.path("run").display());
    ended.fails_with(75, &[&says, &advice]);
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), undisturbed());
}

#[test]
fn a_killed_agent_ends_the_run_by_name() {
    a_role_dies("agent-1", "agent-1");
}

#[test]
fn a_killed_env_server_ends_the_run_by_name() {
    a_role_dies("env-server", "world");
}

#[test]
fn a_killed_coordinator_ends_the_run_by_name() {
    a_role_dies("coordinator", "coordinator");
}

#[test]
fn a_role_that_hangs_does_not_keep_the_launcher_from_leaving() {
    let cluster = Cluster::new();
    let (mut training, children) = running(&cluster, endless());
    let hanging = training.child("agent-0");
    hanging.signal(Signal::SIGSTOP);
    // The first signal requests the end of the round, which does not come without agent 0.
    let first = Instant::now();
    training.signal(Signal::SIGINT);
    wait_until("an answer", || training.stderr().contains("stopping after this round"));
    // The second, within a second, is the same request and does not prevent a save.
    training.signal(Signal::SIGINT);
    wait_until("a second to pass", || first.elapsed() > Duration::from_millis(1_100));
    assert!(training.is_alive() && children.iter().all(Member::is_alive));
    // The third comes later and waits for nothing.
    let before = Instant::now();
    training.signal(Signal::SIGINT);
    let ended = ends_in_time(training, &children, before);
    assert_eq!(ended.code, Some(75), "{ended:#?}");
}

#[test]
fn every_signal_that_asks_for_an_end_saves_the_team() {
    for signal in [Signal::SIGHUP, Signal::SIGINT, Signal::SIGTERM, Signal::SIGUSR1, Signal::SIGUSR2] {
        let cluster = Cluster::new();
        let (training, children) = running(&cluster, endless());
        let before = Instant::now();
        training.signal(signal);
        let ended = ends_in_time(training, &children, before);
        assert_eq!(ended.code, Some(75), "{signal}: {ended:#?}");
        assert!(!cluster.run("run").checkpoints("agent-0").is_empty(), "{signal}: the agents have saved");
    }
}

#[test]
fn a_team_saves_when_its_launcher_is_killed() {
    let cluster = Cluster::new();
    // No checkpoint is due before the end.
    let mut words = endless();
    words.push("--set=save.interval=1000000".to_owned());
    let (training, children) = running(&cluster, words);
    cluster.run("run").reaches(1_500);
    let before = Instant::now();
    training.signal(Signal::SIGKILL);
    ends_in_time(training, &children, before);
    for role in ["world", "agent-0", "agent-1"] {
        assert!(!cluster.run("run").checkpoints(role).is_empty(), "{role}");
    }
}

#[test]
fn a_role_that_hangs_does_not_outlive_a_killed_launcher_either() {
    let cluster = Cluster::new();
    let (mut training, children) = running(&cluster, endless());
    // A stopped process cannot notice the end of the launcher; the system continues it.
    let hanging = training.child("agent-0");
    hanging.signal(Signal::SIGSTOP);
    wait_until("agent 0 to stop", || hanging.has_stopped());
    let before = Instant::now();
    training.signal(Signal::SIGKILL);
    ends_in_time(training, &children, before);
}

#[test]
fn a_role_that_cannot_start_ends_the_run_at_once() {
    let cluster = Cluster::new();
    let mut config = rondo();
    config.arg("config").args(short());
    // A folder in the place of its log: only the role itself finds that.
    let log = cluster.path("run/world/log.jsonl");
    fs::create_dir_all(&log).expect("created");
    fs::write(cluster.path("run/config.toml"), Process::start(config).succeeds().stdout).expect("written");
    let before = Instant::now();
    let says = format!("error: world: could not open `{}`: Is a directory", log.display());
    cluster.resume("run").wait().fails_with(74, &[&says]);
    assert!(before.elapsed() < Duration::from_secs(20), "{:?}", before.elapsed());
}
