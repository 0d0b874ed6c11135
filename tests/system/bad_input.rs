//! User mistakes: each has one clear message and the right exit code, and changes nothing.

use std::fs;
use std::net::TcpListener;
use std::process::Stdio;

use crate::cluster::{experiment, rondo, short, undisturbed, wait_until, Cluster, Ended, Process};
use crate::hosts::Hosts;

const NOTHING: [&str; 0] = [];

/// `rondo` with these words, in a new folder that must be empty afterwards.
#[track_caller]
pub fn refused(words: &[&str]) -> Ended {
    let cluster = Cluster::new();
    let mut command = rondo();
    command.args(words).current_dir(cluster.path(""));
    let ended = Process::start(command).wait();
    let left = fs::read_dir(cluster.path("")).expect("a folder").count();
    assert_eq!(left, 0, "{words:?} left something behind");
    assert_eq!(ended.stdout, "", "{words:?}");
    ended
}

#[test]
fn unknown_names_are_answered_with_the_nearest_known_one() {
    refused(&["train", "lfb-8x8-2p-2f"])
        .fails_with(78, &["error: there is no task `lfb-8x8-2p-2f`", "`lbf-8x8-2p-2f"]);
    refused(&["train", "--algo=mtpo"]).fails_with(
        78,
        &["error: unknown algorithm `mtpo`: expected ippo, mtppo, sppo, iql, mtql, sql; did you mean `mtppo`?"],
    );
    refused(&["train", "--profile=epymarll"]).fails_with(
        78,
        &["unknown profile `epymarll`: expected rondo, epymarl, benchmark2021; did you mean `epymarl`?"],
    );
    refused(&["train", "--set=algo.profile=epymarl"]).fails_with(
        78,
        &["`--set algo.profile`: a profile is a name for values of other keys", "`--profile`"],
    );
    refused(&["train", "--set=algo.hiden=64"])
        .fails_with(78, &["`algo.hiden` is not a key; did you mean `algo.hidden`?"]);
    refused(&["train", "--set=alog.hidden=64"])
        .fails_with(78, &["`alog` is not a key; did you mean `algo`?"]);
    refused(&["train", "--lr-fats=1"]).fails_with(64, &["'--lr-fats'", "'--lr-fast'"]);
    refused(&["trian"]).fails_with(64, &["'trian'", "'train'"]);
    refused(&["train", "--transport=udp"]).fails_with(64, &["'udp'", "unix, tcp"]);
}

#[test]
fn settings_that_are_none_say_how_to_write_them() {
    refused(&["train", "--set=algo.hidden"]).fails_with(
        64,
        &["error: `--set algo.hidden`: there is no `=`; write KEY=VALUE, for example algo.hidden=64"],
    );
    refused(&["train", "--set==1"]).fails_with(64, &["the key is empty"]);
    refused(&["train", "--set=seed.x=1"]).fails_with(64, &["`seed` holds no keys"]);
    refused(&["train", "--set=algo.hidden=many"]).fails_with(78, &["hidden = \"many\"", "invalid type"]);
}

#[test]
fn numbers_that_cannot_be_are_refused_with_what_was_expected() {
    for (words, parts) in [
        (&["--envs=0"][..], &["`world.copies` is 0: expected a number from 1 to 10000"][..]),
        (&["--lr-fast=-1"], &["`schedule.rates[0]` is -1: expected a number from 0 to 1"]),
        (&["--lr-fast", "-1"], &["`schedule.rates[0]` is -1: expected a number from 0 to 1"]),
        (&["--lr-fast=nan"], &["`schedule.rates[0]` is NaN: expected a number from 0 to 1"]),
        (&["--lr-slow=inf"], &["`schedule.rates[1]` is inf: expected a number from 0 to 1"]),
        (&["--t-max=0"], &["`t_max` is 0: expected a number from 1"]),
        (&["--test-interval=0"], &["`test.interval` is 0: expected a number from 1"]),
        (&["--test-episodes=0"], &["`test.episodes` is 0: expected a number from 1 to 10000"]),
        (&["--switch-period=0"], &["expected a whole number from 1"]),
        (&["--switch-period=soon"], &["`soon`", "inf"]),
        (&["--set=algo.hidden=0"], &["`algo.hidden` is 0: expected a number from 1 to 4096"]),
        (&["lbf-3x3-9p-9f"], &["error: task `lbf-3x3-9p-9f` cannot be played: "]),
    ] {
        let words: Vec<&str> = ["train"].iter().chain(words).copied().collect();
        refused(&words).fails_with(78, parts);
    }
    refused(&["train", "--t-max=many"]).fails_with(64, &["'many'", "--t-max <N>"]);
    refused(&["train", "--seeds=2", "--set=seed=3"])
        .fails_with(64, &["`--set seed` with `--seeds`: each seed is another one; `--seed` says the first"]);
    refused(&["train", "--seeds=0"]).fails_with(64, &["`--seeds` and `--jobs` must be at least 1"]);
}

#[test]
fn an_example_without_an_answer_is_refused_with_what_was_expected() {
    for (words, part) in [
        (&["--n=1"][..], "error: `--n 1`: expected a number of agents from 2 to 32"),
        (&["--p=0"], "error: `--p 0`: expected a weight from 1e-9 to 1e9"),
        (&["--q=-inf"], "error: `--q -inf`: expected a weight from -1e9 to 1e9"),
        (&["--variance", "-1"], "error: `--variance -1`: expected a variance from 0 to 1e9"),
        (&["--variance=0"], "the cost has no single minimum"),
        (&["--n=-3"], "invalid value '-3' for '--n <N>'"),
    ] {
        refused(&[&["example", "estimation"], words].concat()).fails_with(64, &[part]);
    }
}

#[test]
fn all_mistakes_are_reported_at_once() {
    refused(&["train", "--envs=0", "--t-max=0", "--lr-fast=2", "--test-interval=0"]).fails_with(
        78,
        &[
            "the configuration has 4 mistakes",
            "`world.copies`",
            "`t_max`",
            "`schedule.rates[0]`",
            "`test.interval`",
        ],
    );
}

#[test]
fn a_folder_that_exists_is_left_alone() {
    let cluster = Cluster::new();
    let precious = cluster.path("results").join("precious.txt");
    fs::create_dir(cluster.path("results")).expect("created");
    fs::write(&precious, "years of work").expect("written");
    let path = cluster.path("results").display().to_string();
    cluster.train("results", short(), NOTHING).wait().fails_with(
        78,
        &[
            &format!("error: {path} holds something other than a run, a new run needs a new folder"),
            "choose another folder with --out",
        ],
    );
    assert_eq!(fs::read_to_string(precious).expect("it is still there"), "years of work");
    assert_eq!(fs::read_dir(cluster.path("results")).expect("a folder").count(), 1);
}

#[test]
fn what_is_no_run_cannot_be_resumed_or_digested() {
    let cluster = Cluster::new();
    fs::create_dir(cluster.path("empty")).expect("created");
    for folder in ["empty", "nowhere"] {
        let says = format!(
            "error: `{}` is not a run folder: there is no config.toml in it",
            cluster.path(folder).display()
        );
        cluster
            .resume(folder)
            .wait()
            .fails_with(78, &[&says, "hint: name the folder that was given to --out"]);
        let mut digest = rondo();
        digest.arg("digest").arg(cluster.path(folder));
        Process::start(digest).wait().fails_with(78, &[&says]);
    }
    assert!(!cluster.path("nowhere").exists());
    assert_eq!(fs::read_dir(cluster.path("empty")).expect("a folder").count(), 0);
}

#[test]
fn a_configuration_with_an_unknown_key_names_line_and_nearest_key() {
    let hosts = Hosts::new(short());
    let path = hosts.cluster.path("config.toml");
    let text = fs::read_to_string(&path).expect("it was written");
    fs::write(&path, text.replace("t_max", "t_maxx")).expect("written");
    let says = format!("error: {}: the configuration has 1 unknown key", path.display());
    hosts
        .start_env_server(&[])
        .wait()
        .fails_with(78, &[&says, "line 3: `t_maxx` is not a key; did you mean `t_max`?"]);
    fs::remove_file(&path).expect("removed");
    hosts.start_env_server(&[]).wait().fails_with(
        78,
        &[
            &format!("error: cannot read {}: ", path.display()),
            "hint: `rondo config TASK` writes a configuration",
        ],
    );
    assert!(!hosts.folder("world").exists());
}

#[test]
fn a_configuration_that_does_not_fit_its_world_or_transport_is_refused_by_the_env_server_too() {
    let hosts = Hosts::new(short());
    let path = hosts.cluster.path("config.toml");
    let text = fs::read_to_string(&path).expect("it was written");
    let start = |changes: &[(&str, &str)]| {
        let changed = changes.iter().fold(text.clone(), |text, (from, to)| {
            assert!(text.contains(from), "`{from}` is missing in {text}");
            text.replace(from, to)
        });
        fs::write(&path, changed).expect("written");
        let ended = hosts.start_env_server(&[]).wait();
        fs::remove_dir_all(hosts.folder("world")).expect("removed");
        ended
    };
    start(&[("agents = 2", "agents = 3"), ("levels = [0, 1]", "levels = [0, 1, 1]")])
        .fails_with(78, &["error: `world.agents` is 3, but lbf-5x5-2p-1f has 2"]);
    start(&[("copies = 10", "copies = 1000")]).fails_with(
        78,
        &["error: `bus.low_latency` is true, but that transport carries 32768 bytes a message", "49040"],
    );
}

#[test]
fn a_transport_that_cannot_carry_a_run_is_no_change_that_it_can_go_on_with() {
    let cluster = Cluster::new();
    let mut config = rondo();
    config.args(["config", "--envs=1000", "--run=run"]);
    let text = Process::start(config).succeeds().stdout;
    fs::create_dir(cluster.path("run")).expect("created");
    fs::write(cluster.path("run/config.toml"), &text).expect("written");
    cluster.resume_with("run", ["--set=bus.low_latency=true"]).wait().fails_with(
        78,
        &["error: `bus.low_latency` is true, but that transport carries 32768 bytes a message"],
    );
    assert_eq!(fs::read_to_string(cluster.path("run/config.toml")).expect("it is there"), text);
}

#[test]
fn endpoints_in_use_or_misspelt_are_named() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let mut hosts = Hosts::new(short());
    hosts.world = format!("tcp/{}", taken.local_addr().expect("an address"));
    hosts.start_env_server(&[]).wait().fails_with(
        74,
        &[
            &format!("error: cannot listen on `{}`: it is in use; hint: ", hosts.world),
            "stop the process that listens there, choose another port, or port 0 for a free one",
        ],
    );
    hosts.world = "127.0.0.1:7447".to_owned();
    hosts.start_env_server(&[]).wait().fails_with(
        64,
        &["error: `127.0.0.1:7447` is not an endpoint: ", "write `unixsock-stream/PATH` or `tcp/HOST:PORT`"],
    );
}

#[test]
fn an_agent_that_reaches_nobody_names_the_endpoint() {
    let hosts = Hosts::new(short());
    hosts.start_agent(0, &["--wait=1"]).wait().fails_with(
        75,
        &[&format!("no answer at `{}`", hosts.world), "hint: start the process that listens there"],
    );
}

#[test]
fn an_agent_with_another_configuration_is_refused() {
    let hosts = Hosts::new(short());
    let servers = [hosts.start_env_server(&[]), hosts.start_coordinator(&[])];
    servers.iter().for_each(|server| drop(server.endpoint()));
    let other = Hosts::new(experiment(2, 9_000));
    let other = Hosts { world: hosts.world.clone(), coordinator: hosts.coordinator.clone(), ..other };
    other.start_agent(0, &[]).wait().fails_with(
        78,
        &[
            "error: agent 0 was refused a seat: this agent's configuration has the digest ",
            "start both with the same config.toml",
        ],
    );
    finishes(&hosts, servers);
}

/// Refused processes have no effect: the right team joins and the run has the usual digest.
fn finishes(hosts: &Hosts, servers: [Process; 2]) {
    let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    agents.into_iter().chain(servers).for_each(|process| drop(process.succeeds()));
    assert_eq!(hosts.merged_digest(), undisturbed());
}

#[test]
fn an_agent_that_is_one_too_many_is_refused() {
    let hosts = Hosts::new(short());
    let servers = [hosts.start_env_server(&[]), hosts.start_coordinator(&[])];
    let out_of_range = hosts.start_agent(2, &[]);
    out_of_range.wait().fails_with(
        78,
        &["error: agent 2 was refused a seat: there is no agent 2 in a team of 2; ids go from 0 to 1"],
    );
    fs::remove_dir_all(hosts.folder("agent-2")).expect("removed");

    let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    wait_until("agent 1 to act", || {
        hosts.recorded("agent-1").iter().any(|line| line["key"] == "rondo/run/agent/1/act")
    });
    // With a separate folder and record, as on another host.
    let second =
        Hosts { cluster: Cluster::new(), world: hosts.world.clone(), coordinator: hosts.coordinator.clone() };
    fs::copy(hosts.cluster.path("config.toml"), second.cluster.path("config.toml")).expect("copied");
    second.start_agent(1, &[]).wait().fails_with(
        78,
        &["error: agent 1 was refused a seat: agent 1 has already joined as another process; \
             stop that one, or start this one with another id"],
    );
    agents.into_iter().chain(servers).for_each(|process| drop(process.succeeds()));
    assert_eq!(hosts.merged_digest(), undisturbed());
}

#[test]
fn agents_that_do_not_come_are_named() {
    let hosts = Hosts::new(short());
    let world = hosts.start_env_server(&["--wait=4"]);
    let coordinator = hosts.start_coordinator(&["--wait=4"]);
    let agent = hosts.start_agent(0, &["--wait=6"]);
    world.wait().fails_with(
        75,
        &[
            "error: agent 1 of run `run` did not join within 4s (joined: 0)",
            "waited on `rondo/run/agent/1/join`",
            "hint: on its host run `rondo-agent --id 1 --config FILE --out DIR --connect ENDPOINT …`",
        ],
    );
    coordinator.wait().fails_with(75, &["error: agent", "1 of run `run` did not join within 4s"]);
    agent.wait().fails_with(75, &["error: agent 0 got no seat within 6s", "is every agent started"]);
}

#[test]
fn an_agent_that_leaves_before_the_run_begins_is_named() {
    let hosts = Hosts::new(short());
    let world = hosts.start_env_server(&["--wait=6"]);
    let coordinator = hosts.start_coordinator(&[]);
    let leaves = hosts.start_agent(0, &[]);
    wait_until("agent 0 to ask for its seat", || {
        hosts.recorded("agent-0").iter().any(|line| line["key"] == "rondo/run/agent/0/join")
    });
    leaves.signal(nix::sys::signal::Signal::SIGKILL);
    leaves.wait();
    let stays = hosts.start_agent(1, &[]);
    world.wait().fails_with(
        75,
        &["error: agent 0 of run `run` joined, but did not announce itself within 6s (joined: 1)"],
    );
    // The other agent had a seat. It ends when the env-server does.
    let ended = stays.wait();
    ended.fails_with(75, &["error: agent 1 lost the env-server: it left run `run` in round 0"]);
    drop(coordinator);
}

#[test]
fn an_agent_that_leaves_is_named_by_the_env_server() {
    let hosts = Hosts::new(short());
    let servers = [hosts.start_env_server(&[]), hosts.start_coordinator(&[])];
    let (stays, leaves) = (hosts.start_agent(0, &[]), hosts.start_agent(1, &[]));
    wait_until("agent 1 to learn", || {
        hosts.recorded("agent-1").iter().any(|line| line["key"] == "rondo/run/agent/1/progress")
    });
    leaves.signal(nix::sys::signal::Signal::SIGKILL);
    leaves.wait();
    let [world, coordinator] = servers;
    world.wait().fails_with(
        75,
        &["error: agent 1 left the run and did not come back within 5s", "start the same commands again"],
    );
    // The other agent received the closing tick, saved and left.
    assert_eq!(stays.wait().code, Some(75));
    assert_eq!(coordinator.wait().code, Some(75));

    // All processes, started again, continue from their common round.
    let servers = [hosts.start_env_server(&[]), hosts.start_coordinator(&[])];
    finishes(&hosts, servers);
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    let mut command = rondo();
    command.arg("tasks").stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("it starts");
    // Nobody reads.
    drop(child.stdout.take());
    let ended = child.wait_with_output().expect("it ends");
    assert_eq!((ended.status.code(), ended.stderr.as_slice()), (Some(0), [].as_slice()));
}
