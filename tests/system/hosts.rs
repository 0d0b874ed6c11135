//! Roles started one by one, as on several hosts: separate folders, explicit endpoints, any order.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use nix::sys::signal::Signal;

use crate::cluster::{copy_into, experiment, role, rondo, short, undisturbed, wait_until, Cluster, Process};

/// The roles of one run, each with a separate folder.
pub struct Hosts {
    pub cluster: Cluster,
    /// Where the env-server and the coordinator listen.
    pub world: String,
    pub coordinator: String,
}

impl Hosts {
    /// Endpoints that are known before a process listens: Unix sockets.
    pub fn new(experiment: Vec<String>) -> Self {
        let cluster = Cluster::new();
        let socket = |name: &str| format!("unixsock-stream/{}", cluster.path(name).display());
        let (world, coordinator) = (socket("world.sock"), socket("coordinator.sock"));
        let mut config = rondo();
        config.arg("config").args(experiment);
        let text = Process::start(config).succeeds().stdout;
        fs::write(cluster.path("config.toml"), text).expect("written");
        Self { cluster, world, coordinator }
    }

    fn command(&self, program: &str, host: &str) -> Command {
        let mut command = role(program);
        command.arg("--config").arg(self.cluster.path("config.toml")).arg("--out").arg(self.folder(host));
        command.arg("--record").arg(self.record(host));
        command
    }

    /// The run folder on one host: `world`, `coordinator`, `agent-0`, …
    pub fn folder(&self, host: &str) -> PathBuf {
        self.cluster.path("hosts").join(host)
    }

    /// The record of a role's traffic.
    pub fn record(&self, host: &str) -> PathBuf {
        self.cluster.path(&format!("{host}.jsonl"))
    }

    /// The lines of that record, complete ones only.
    pub fn recorded(&self, host: &str) -> Vec<serde_json::Value> {
        let text = fs::read_to_string(self.record(host)).unwrap_or_default();
        let complete = text.rfind('\n').map_or("", |end| &text[..end]);
        complete.lines().map(|line| serde_json::from_str(line).expect("a record is JSON")).collect()
    }

    pub fn start_env_server(&self, more: &[&str]) -> Process {
        let mut command = self.command("rondo-env-server", "world");
        command.args(["--listen", &self.world]).args(more);
        Process::start(command)
    }

    pub fn start_coordinator(&self, more: &[&str]) -> Process {
        let mut command = self.command("rondo-coordinator", "coordinator");
        command.args(["--listen", &self.coordinator]).args(more);
        Process::start(command)
    }

    pub fn start_agent(&self, id: u32, more: &[&str]) -> Process {
        let mut command = self.command("rondo-agent", &format!("agent-{id}"));
        command.arg(format!("--id={id}")).args(["--connect", &self.world, "--connect", &self.coordinator]);
        command.args(more);
        Process::start(command)
    }

    /// The digest of all folders copied into one.
    pub fn merged_digest(&self) -> String {
        for host in fs::read_dir(self.cluster.path("hosts")).expect("folders") {
            copy_into(&host.expect("a name").path(), &self.cluster.path("merged"));
        }
        self.cluster.digest("merged")
    }
}

#[test]
fn the_order_in_which_roles_start_does_not_matter() {
    let orders =
        [["agent-1", "agent-0", "coordinator", "world"], ["agent-0", "world", "coordinator", "agent-1"]];
    for order in orders {
        let hosts = Hosts::new(short());
        let started = order.map(|name| match name {
            "world" => hosts.start_env_server(&[]),
            "coordinator" => hosts.start_coordinator(&[]),
            "agent-0" => hosts.start_agent(0, &[]),
            _ => hosts.start_agent(1, &[]),
        });
        for process in started {
            process.succeeds();
        }
        assert_eq!(hosts.merged_digest(), undisturbed(), "{order:?}");
    }
}

#[test]
fn roles_on_separate_addresses_and_folders_come_to_the_digest_of_one_machine() {
    let mut hosts = Hosts::new(short());
    (hosts.world, hosts.coordinator) = ("tcp/127.0.0.2:0".to_owned(), "tcp/127.0.0.3:0".to_owned());
    let (world, coordinator) = (hosts.start_env_server(&[]), hosts.start_coordinator(&[]));
    (hosts.world, hosts.coordinator) = (world.endpoint(), coordinator.endpoint());
    assert!(hosts.world.starts_with("tcp/127.0.0.2:") && hosts.coordinator.starts_with("tcp/127.0.0.3:"));
    let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    for process in agents.into_iter().chain([world, coordinator]) {
        process.succeeds();
    }
    // A host's folder holds its own role only.
    for host in ["world", "coordinator", "agent-0", "agent-1"] {
        let roles = ["world", "coordinator", "agent-0", "agent-1"];
        let there = roles.map(|role| hosts.folder(host).join(role).exists());
        assert_eq!(there, roles.map(|role| role == host), "{host}");
    }
    assert_eq!(hosts.merged_digest(), undisturbed());
}

#[test]
fn agents_wait_for_a_coordinator_that_died_and_go_on_with_its_successor() {
    // One episode a round: more update calls than a coordinator publishes ahead.
    let many_rounds = || {
        let mut words = experiment(1, 12_000);
        words.extend(["--envs=1", "--set=save.interval=50"].map(str::to_owned));
        words
    };
    let cluster = Cluster::new();
    cluster.train("undisturbed", many_rounds(), ["--in-process"]).succeeds();

    let hosts = Hosts::new(many_rounds());
    let (world, coordinator) = (hosts.start_env_server(&[]), hosts.start_coordinator(&[]));
    let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    wait_until("the first update calls", || progress(&hosts) > 5);
    coordinator.signal(Signal::SIGKILL);
    coordinator.wait();
    let (before, questions) = (progress(&hosts), asked(&hosts));
    wait_until("an agent that asks for the schedule", || asked(&hosts) > questions);
    let told_ahead = progress(&hosts);
    assert!(told_ahead > before, "what was told ahead is used: {told_ahead} after {before}");
    let successor = hosts.start_coordinator(&[]);
    for process in agents.into_iter().chain([world, successor]) {
        process.succeeds();
    }
    assert!(progress(&hosts) > told_ahead);
    assert_eq!(hosts.merged_digest(), cluster.digest("undisturbed"));
}

#[test]
fn an_env_server_that_is_asked_to_stop_sends_everybody_home_to_go_on_later() {
    let hosts = Hosts::new(short());
    let (world, coordinator) = (hosts.start_env_server(&[]), hosts.start_coordinator(&[]));
    let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    wait_until("the first update calls", || progress(&hosts) > 5);
    world.signal(Signal::SIGTERM);
    for process in agents.into_iter().chain([world]) {
        let ended = process.wait();
        assert_eq!((ended.code, ended.stderr.as_str()), (Some(75), ""), "stopping is no error");
    }
    assert_eq!(coordinator.wait().code, Some(75), "the run can be resumed");

    let servers = [hosts.start_env_server(&[]), hosts.start_coordinator(&[])];
    let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    for process in agents.into_iter().chain(servers) {
        process.succeeds();
    }
    assert_eq!(hosts.merged_digest(), undisturbed());
}

/// Update calls that agent 0 has reported.
fn progress(hosts: &Hosts) -> usize {
    let reports = |line: &&serde_json::Value| line["key"] == "rondo/run/agent/0/progress";
    hosts.recorded("agent-0").iter().filter(reports).count()
}

/// Number of queries for the schedule.
fn asked(hosts: &Hosts) -> usize {
    let question = |line: &serde_json::Value| line["op"] == "asked" && line["key"] == "rondo/run/schedule";
    let lines = ["agent-0", "agent-1"].map(|host| hosts.recorded(host)).concat();
    lines.iter().filter(|line| question(line)).count()
}

#[test]
fn an_agent_with_another_folder_is_refused_and_nobody_loses_a_checkpoint() {
    let hosts = Hosts::new(short());
    let start = |more: &[&str]| {
        let servers = [hosts.start_env_server(more), hosts.start_coordinator(&[])];
        let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
        (servers, agents)
    };
    let ([world, coordinator], agents) = start(&[]);
    wait_until("the first update calls", || progress(&hosts) > 5);
    world.signal(Signal::SIGTERM);
    for process in agents.into_iter().chain([world]) {
        assert_eq!(process.wait().code, Some(75));
    }
    assert_eq!(coordinator.wait().code, Some(75));

    // As with a mistyped `--out`: agent 1 has an empty folder.
    let right = hosts.folder("agent-1").with_file_name("right");
    std::fs::rename(hosts.folder("agent-1"), &right).expect("renamed");
    let rounds = |host: &str, role: &str| {
        let names = std::fs::read_dir(hosts.folder(host).join(role).join("checkpoints")).expect("a folder");
        names.map(|entry| entry.expect("a name").file_name()).collect::<Vec<_>>()
    };
    let before = [rounds("world", "world"), rounds("agent-0", "agent-0")];
    let ([world, coordinator], agents) = start(&[]);
    world.wait().fails_with(78, &["no checkpoint is held by every process (env-server: ", "agent 1: none)"]);
    for agent in agents {
        agent.wait().fails_with(78, &["was refused a seat: no checkpoint is held by every process"]);
    }
    coordinator.signal(Signal::SIGTERM);
    assert_eq!(coordinator.wait().code, Some(75));
    assert_eq!([rounds("world", "world"), rounds("agent-0", "agent-0")], before);

    // On request the run starts from the beginning, and the old state is kept.
    let ([world, coordinator], agents) = start(&["--start-over"]);
    for process in agents.into_iter().chain([world, coordinator]) {
        process.succeeds();
    }
    assert_eq!(hosts.merged_digest(), undisturbed());
    for (host, role) in [("world", "world"), ("agent-0", "agent-0")] {
        assert!(hosts.folder(host).join(role).join("set-aside-1/checkpoints").is_dir(), "{role}");
    }
}
