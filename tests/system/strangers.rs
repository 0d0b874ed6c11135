//! Foreign peers that send arbitrary bytes: garbage is dropped, wrong requests are refused with a reason, and the run
//! is not affected.

use std::sync::Arc;
use std::time::Duration;

use bus::{Bus, Options};
use proto::codec::{decode, encode, WIRE_VERSION};
use proto::config::Config;
use proto::control::{Join, Progress, Refusal, Welcome};
use proto::keys::Keys;

use crate::cluster::{experiment, outsider, short, undisturbed, wait_until, Cluster, Process};
use crate::hosts::Hosts;

/// How long a stranger waits for an answer.
const ANSWER: Duration = Duration::from_secs(20);

fn keys() -> Keys {
    Keys::new("run").expect("a good name")
}

fn config(hosts: &Hosts) -> Config {
    let text = std::fs::read_to_string(hosts.cluster.path("config.toml")).expect("it was written");
    Config::from_toml(&text).expect("it is one")
}

/// A foreign peer that dials one endpoint.
fn stranger(hosts: &Hosts, endpoint: &str) -> Arc<dyn Bus> {
    let low_latency = config(hosts).bus.low_latency;
    let options = Options { connect: vec![endpoint.to_owned()], low_latency, ..Options::default() };
    bus::open(&options).expect("it listens")
}

/// Pseudo-random bytes, the same in each run: the upper ones of a linear congruential generator.
fn noise(seed: u64) -> Vec<u8> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    };
    (0..seed * 37 % 2_000).map(|_| next()).collect()
}

/// Variations of valid messages.
fn nearly(seed: u64) -> Vec<Vec<u8>> {
    let mut act = Vec::new();
    let id = seed % 100;
    proto::Act { round: id, tick: 0, actions: vec![u16::MAX; 10], ..proto::Act::default() }.encode(&mut act);
    let progress = encode(&Progress { update_calls: seed << 40 | seed, finished: true }).expect("it fits");
    let mut other_version = act.clone();
    other_version[0] = WIRE_VERSION + 1;
    let mut other_tag = act.clone();
    other_tag[1] = 200;
    vec![
        noise(seed),
        vec![],
        vec![WIRE_VERSION],
        act[..act.len() - 1].to_vec(),
        [&act[..], &[0]].concat(),
        other_version,
        other_tag,
        act,
        progress,
    ]
}

#[test]
fn a_run_comes_to_its_digest_while_strangers_send_garbage_on_every_key() {
    let hosts = Hosts::new(short());
    let (world, coordinator) = (hosts.start_env_server(&[]), hosts.start_coordinator(&[]));
    let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    world.endpoint();
    coordinator.endpoint();
    let (to_world, to_coordinator) = (stranger(&hosts, &hosts.world), stranger(&hosts, &hosts.coordinator));
    let keys = keys();
    // Tokens of agents that do not exist, too.
    let _token =
        [&to_world, &to_coordinator].map(|bus| bus.announce(&keys.alive_agent(99)).expect("a token"));
    let publishers: Vec<_> = [keys.act(0), keys.act(1), keys.act(99), keys.observe(0), keys.schedule()]
        .iter()
        .map(|key| to_world.publisher(key).expect("a publisher"))
        .chain(
            [keys.progress(0), keys.progress(99), keys.schedule()]
                .iter()
                .map(|key| to_coordinator.publisher(key).expect("a publisher")),
        )
        .collect();

    let (mut seed, mut refused) = (0, 0);
    while world.is_alive() && coordinator.is_alive() {
        seed += 1;
        for message in nearly(seed) {
            for publisher in &publishers {
                publisher.send(&message).expect("the stranger's own side works");
            }
        }
        // Queries are answered, so they also set the pace.
        // None comes before the env-server serves the key, and when it has left.
        if let Some(reply) =
            to_world.ask(&keys.join(seed as u32 % 3), &noise(seed), ANSWER).expect("it can ask")
        {
            let refusal = decode::<Welcome>(&reply).expect("a welcome");
            assert!(matches!(refusal, Welcome::Refused(_)), "{refusal:?}");
            refused += 1;
        }
        to_coordinator.ask(&keys.schedule(), &noise(seed), Duration::from_millis(20)).expect("it can ask");
    }
    for process in agents.into_iter().chain([world, coordinator]) {
        let ended = process.succeeds();
        assert!(!ended.stderr.contains("panicked"), "{ended:#?}");
    }
    assert!(refused > 3, "the strangers were there during the run: {refused}");
    assert_eq!(hosts.merged_digest(), undisturbed());
}

/// zenoh would forward between them and the team: a client at the env-server would receive every observation.
#[test]
fn clients_and_routers_are_refused_at_every_endpoint_of_a_run() {
    let cluster = Cluster::new();
    let run = cluster.train("run", experiment(1, 1_000_000), [""; 0]);
    cluster.run("run").reaches(500);
    let keys = Keys::new("run").expect("a good name");
    let dial = |name: &str, mode: &str, keys: &[String]| {
        let mut command = outsider();
        let socket = cluster.path("run").join("bus").join(name);
        command.arg(mode).arg(format!("unixsock-stream/{}", socket.display())).args(keys);
        Process::start(command)
    };
    let sockets = ["world.sock", "coordinator.sock", "monitor.sock"];
    let cases = sockets.iter().flat_map(|name| ["client", "router"].map(|mode| (*name, mode)));
    let attempts = [keys.observe(0), keys.act(0), keys.schedule(), keys.progress(0), keys.agent_metrics(0)];
    let outsiders: Vec<_> = cases.map(|(name, mode)| (name, mode, dial(name, mode, &attempts))).collect();
    for (name, mode, outsider) in &outsiders {
        wait_until("an outsider to be refused, or to be served", || !outsider.stdout().is_empty());
        let said = outsider.stdout();
        assert!(said.lines().all(|line| line == "refused"), "a {mode} at {name}: {said}");
    }
    // The same program as a peer, which only receives, is served: it is able to.
    let peer = dial("world.sock", "peer", &[]);
    wait_until("an observation", || peer.stdout().contains(&format!("received {}", keys.observe(0))));
    assert!(run.is_alive(), "{}", run.stderr());
}

#[test]
fn peers_of_another_version_or_configuration_are_refused_with_the_reason() {
    let hosts = Hosts::new(short());
    let world = hosts.start_env_server(&[]);
    world.endpoint();
    let stranger = stranger(&hosts, &hosts.world);
    let digest = config(&hosts).digest();
    let ask = |id: u32, question: &[u8]| {
        // Until the env-server has declared that it answers, there is no reply.
        let mut reply = None;
        wait_until("a refusal", || {
            reply = stranger.ask(&keys().join(id), question, ANSWER).expect("it can ask");
            reply.is_some()
        });
        match decode::<Welcome>(&reply.expect("it has been waited for")) {
            Ok(Welcome::Refused(refusal)) => refusal,
            other => panic!("{other:?}"),
        }
    };
    let join =
        |digest, nonce| encode(&Join { config_digest: digest, nonce, checkpoints: vec![] }).expect("it fits");

    let mut other_version = join(digest, 1);
    other_version[0] = 9;
    let refusal = ask(0, &other_version);
    assert_eq!(refusal, Refusal::Version { ours: WIRE_VERSION, theirs: 9 });
    assert_eq!(
        refusal.to_string(),
        format!(
            "this agent has wire version 9, the env-server {WIRE_VERSION}; \
             install the same version of rondo on every host"
        )
    );
    let refusal = ask(0, &join([7; 32], 1));
    assert_eq!(refusal, Refusal::Config { ours: digest, theirs: [7; 32] });
    assert!(refusal
        .to_string()
        .starts_with("this agent's configuration has the digest 070707070707…, the env-server's "));
    assert!(refusal.to_string().ends_with("…; start both with the same config.toml"));
    let refusal = ask(2, &join(digest, 1));
    assert_eq!(refusal.to_string(), "there is no agent 2 in a team of 2; ids go from 0 to 1");
    assert!(matches!(ask(1, b"hello"), Refusal::Version { .. }));
    assert!(matches!(ask(1, &[WIRE_VERSION, 3, 255]), Refusal::Malformed(_)));

    // None of them has taken a seat: the team joins, and the run has the usual digest.
    drop(stranger);
    let coordinator = hosts.start_coordinator(&[]);
    let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    for process in agents.into_iter().chain([world, coordinator]) {
        process.succeeds();
    }
    assert_eq!(hosts.merged_digest(), undisturbed());
}

#[test]
fn a_message_too_large_for_the_fast_transport_is_refused_where_it_is_sent() {
    let hosts = Hosts::new(short());
    let world = hosts.start_env_server(&[]);
    world.endpoint();
    assert!(config(&hosts).bus.low_latency, "the ticks of this task are small");
    let stranger = stranger(&hosts, &hosts.world);
    let publisher = stranger.publisher(&keys().act(0)).expect("a publisher");
    let error = publisher.send(&vec![1; bus::LOW_LATENCY_MAX_BYTES + 1]).expect_err("too large");
    assert!(matches!(error, bus::Error::TooLarge { .. }), "{error}");
    // The link is still there.
    let (inbox, _events) = bus::inbox();
    let _watch = stranger.watch(&keys().any_alive(), inbox).expect("a watch");
    drop(world);
}
