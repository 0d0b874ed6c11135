//! Sessions that are not peers. zenoh forwards between a client and all others, so a session of a run refuses clients
//! and routers with any settings.

use std::sync::{mpsc, Arc};
use std::time::Duration;

use bus::{Bus, Options};
use serde_json::{json, Value};
use zenoh::sample::Sample;
use zenoh::{Config, Session, Wait};

use crate::support::{assert_silent, message, next, open, settle, socket_in, DEADLINE};

/// What an outsider subscribes to and publishes on.
const KEYS: [&str; 2] = ["rondo/r/world/0/observe", "rondo/r/agent/0/act"];

/// What it publishes.
const OUTSIDE: &[u8] = b"from an outsider";

/// Modes of an outsider, and whether it claims to be a gateway for all.
const OUTSIDERS: [(&str, bool); 3] = [("client", false), ("router", false), ("router", true)];

/// A plain zenoh session, opened without this crate.
fn outsider(
    mode: &str,
    gateway: bool,
    endpoint: &str,
    timeout: Duration,
    must_connect: bool,
) -> Result<Session, String> {
    let mut json = json!({
        "mode": mode,
        "connect": {
            "endpoints": [endpoint],
            "timeout_ms": timeout.as_millis() as u64,
            "exit_on_failure": must_connect,
            "retry": { "period_init_ms": 10, "period_max_ms": 20, "period_increase_factor": 1.0 },
        },
        "listen": { "endpoints": [] },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
    });
    if gateway {
        json["gateway"] = json!({ "south": [Value::Object(serde_json::Map::new())] });
    }
    let config = Config::from_json5(&json.to_string()).expect("settings that zenoh knows");
    zenoh::open(config).wait().map_err(|error| error.to_string())
}

/// One side that listens, and one that has dialled it.
fn team(endpoint: &str, low_latency: bool) -> [Arc<dyn Bus>; 2] {
    let hub = open(&Options { listen: vec![endpoint.to_owned()], low_latency, ..Options::default() });
    let agent = open(&Options { connect: hub.endpoints(), low_latency, ..Options::default() });
    [hub, agent]
}

#[test]
fn a_client_and_a_router_cannot_connect_and_a_peer_can() {
    let folder = tempfile::tempdir().unwrap();
    for low_latency in [false, true] {
        for endpoint in ["tcp/127.0.0.1:0".to_owned(), socket_in(&folder)] {
            let [hub, _agent] = team(&endpoint, low_latency);
            let endpoint = &hub.endpoints()[0];
            for (mode, gateway) in OUTSIDERS {
                let opened = outsider(mode, gateway, endpoint, Duration::from_millis(500), true);
                assert!(opened.is_err(), "{mode}, gateway {gateway}, low latency {low_latency}: {endpoint}");
            }
            outsider("peer", false, endpoint, DEADLINE, true).expect("a peer is served");
        }
    }
}

#[test]
fn a_client_and_a_router_receive_nothing_and_what_they_publish_arrives_nowhere() {
    let [hub, agent] = team("tcp/127.0.0.1:0", false);
    let (inbox, arrived) = bus::inbox();
    let _at_hub = hub.subscribe("rondo/**", inbox.clone()).unwrap();
    let _at_agent = agent.subscribe(KEYS[0], inbox).unwrap();
    settle(&agent, &hub);

    // A router opens alone and continues to dial; a client that connects nowhere does not open at all.
    let outsiders: Vec<_> = OUTSIDERS
        .iter()
        .filter_map(|&(mode, gateway)| {
            let timeout = Duration::from_millis(500);
            let session = outsider(mode, gateway, &hub.endpoints()[0], timeout, false).ok()?;
            let (sender, received) = mpsc::channel();
            for key in ["**", "rondo/**", KEYS[0], KEYS[1]] {
                let sender = sender.clone();
                let keep = move |sample: Sample| drop(sender.send(sample.payload().to_bytes().into_owned()));
                session.declare_subscriber(key).callback(keep).background().wait().expect("it subscribes");
            }
            Some((session, received))
        })
        .collect();
    assert!(!outsiders.is_empty(), "a router opens");
    let (observe, act) = (hub.publisher(KEYS[0]).unwrap(), agent.publisher(KEYS[1]).unwrap());
    for round in 0..50_u8 {
        for (session, _) in &outsiders {
            for key in KEYS {
                session.put(key, OUTSIDE).wait().expect("its own side works");
            }
        }
        observe.send(&[round, 0]).unwrap();
        act.send(&[round, 1]).unwrap();
        // The hub receives its own publication, too.
        let mut came: Vec<_> = (0..3).map(|_| message(next(&arrived)).1).collect();
        came.sort_unstable();
        assert_eq!(came, [vec![round, 0], vec![round, 0], vec![round, 1]]);
    }
    assert_silent(&arrived);
    for (session, received) in outsiders {
        drop(session);
        // A session receives what it publishes itself.
        let foreign = received.into_iter().find(|payload| payload != OUTSIDE);
        assert_eq!(foreign, None);
    }
}
