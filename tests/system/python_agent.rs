//! The agent in Python of the protocol's page, in a team with one of Rondo's own.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use nix::sys::signal::Signal;

use crate::cluster::{short, wait_until, Ended, Process};
use crate::hosts::Hosts;
use crate::q_learning::foraging;

/// The seat that the agent in Python takes.
const SEAT: u32 = 1;

fn agent_py() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/agent-in-python/agent.py")
}

/// Whether Python can run the agent. If not, a line on stderr names the skipped test. `.ci/run` counts these lines as
/// skipped tests, and installs the packages so that there are none.
fn can_run(test: &str) -> bool {
    let program = "import sys, tomllib, zenoh, blake3; assert sys.version_info >= (3, 11)";
    let here = Command::new("python3").args(["-c", program]).output().is_ok_and(|done| done.status.success());
    if !here {
        // Not with `eprintln!`, whose output is hidden if the test passes.
        let text = format!(
            "skipped: python_agent::{test} needs python3, 3.11 or newer, with the packages of \
             docs/agent-in-python/requirements.txt\n"
        );
        std::io::stderr().write_all(text.as_bytes()).expect("stderr is there");
    }
    here
}

/// A run whose second agent is the one in Python. Each role has a separate address and folder.
struct Team {
    hosts: Hosts,
    world: Process,
    coordinator: Process,
    rust: Process,
    python: Process,
}

impl Team {
    fn start(mut hosts: Hosts) -> Self {
        (hosts.world, hosts.coordinator) = ("tcp/127.0.0.1:0".to_owned(), "tcp/127.0.0.1:0".to_owned());
        let (world, coordinator) = (hosts.start_env_server(&[]), hosts.start_coordinator(&[]));
        (hosts.world, hosts.coordinator) = (world.endpoint(), coordinator.endpoint());
        let rust = hosts.start_agent(0, &[]);
        let mut command = Command::new("python3");
        command.arg(agent_py()).arg(format!("--id={SEAT}")).env("PYTHONDONTWRITEBYTECODE", "1");
        command.arg("--config").arg(hosts.cluster.path("config.toml"));
        command.arg("--out").arg(hosts.folder(&format!("agent-{SEAT}")));
        command.args(["--connect", &hosts.world, "--connect", &hosts.coordinator]);
        let python = Process::start(command);
        Self { hosts, world, coordinator, rust, python }
    }

    /// Rounds of which the agent in Python has a checkpoint.
    fn saved(&self) -> usize {
        let checkpoints =
            self.hosts.folder(&format!("agent-{SEAT}")).join(format!("agent-{SEAT}/checkpoints"));
        let names = std::fs::read_dir(checkpoints).into_iter().flatten().map_while(Result::ok);
        names.filter(|entry| entry.file_name().to_string_lossy().starts_with("round-")).count()
    }

    /// The ends of env-server, agent in Rust and agent in Python. The coordinator ends with 0 in a finished run, else
    /// with 75.
    fn ends(self) -> (Hosts, [Ended; 3]) {
        let ends = [self.python, self.rust, self.world].map(Process::wait);
        let finished = ends.iter().all(|ended| ended.code == Some(0));
        assert_eq!(self.coordinator.wait().code, Some(if finished { 0 } else { 75 }));
        (self.hosts, ends)
    }

    /// The digest of a complete run.
    fn finishes(self) -> String {
        let (hosts, ends) = self.ends();
        for ended in &ends {
            assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{ends:#?}");
        }
        hosts.merged_digest()
    }
}

/// Plays `experiment` twice, once to its end and once with a stop by SIGTERM in between, and compares.
fn plays_through_a_stop(experiment: fn() -> Vec<String>, stop: fn(&Team) -> &Process, to_stderr: &str) {
    let undisturbed = Team::start(Hosts::new(experiment())).finishes();

    let team = Team::start(Hosts::new(experiment()));
    wait_until("two checkpoints of the agent in Python", || team.saved() == 2);
    stop(&team).signal(Signal::SIGTERM);
    let (hosts, [python, rust, world]) = team.ends();
    for ended in [&python, &rust, &world] {
        assert_eq!(ended.code, Some(75), "{ended:#?}");
    }
    assert_eq!((python.stderr.as_str(), rust.stderr.as_str()), ("", ""), "a stop is no error");
    assert!(world.stderr.contains(to_stderr), "{world:#?}");

    assert_eq!(Team::start(hosts).finishes(), undisturbed);
}

#[test]
fn it_plays_a_ppo_run_through_its_own_stop_and_a_resume_to_the_finish() {
    if can_run("it_plays_a_ppo_run_through_its_own_stop_and_a_resume_to_the_finish") {
        plays_through_a_stop(short, |team| &team.python, "agent 1 left the run");
    }
}

#[test]
fn it_plays_a_q_learning_run_through_a_stop_of_the_world_and_a_resume_to_the_finish() {
    if can_run("it_plays_a_q_learning_run_through_a_stop_of_the_world_and_a_resume_to_the_finish") {
        plays_through_a_stop(foraging, |team| &team.world, "");
    }
}

/// An agent with another configuration or an unknown id leaves with the reason.
#[test]
fn it_leaves_with_the_reason_when_it_is_refused() {
    if !can_run("it_leaves_with_the_reason_when_it_is_refused") {
        return;
    }
    let mut hosts = Hosts::new(short());
    hosts.world = "tcp/127.0.0.1:0".to_owned();
    let world = hosts.start_env_server(&[]);
    let other = hosts.cluster.path("other.toml");
    let ours = hosts.cluster.path("config.toml");
    let text = std::fs::read_to_string(&ours).expect("it was written");
    std::fs::write(&other, text.replace("seed = 1", "seed = 2")).expect("written");
    let reasons = [
        (&other, "1", "it has another config.toml than the env-server"),
        (&ours, "2", "the team has no such seat"),
    ];
    for (k, (config, id, reason)) in reasons.into_iter().enumerate() {
        let mut command = Command::new("python3");
        command
            .arg(agent_py())
            .args(["--id", id, "--connect", &world.endpoint()])
            .arg("--config")
            .arg(config);
        command.arg("--out").arg(hosts.folder(&format!("refused-{k}"))).env("PYTHONDONTWRITEBYTECODE", "1");
        let refused = Process::start(command).wait();
        refused.fails_with(78, &[&format!("error: agent {id} was refused: {reason}")]);
    }
}
