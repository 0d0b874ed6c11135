//! A zenoh session that is not a role of a run: `outsider MODE ENDPOINT [KEY...]`. MODE is client, router or peer.
//!
//! It dials until it is accepted or killed, and prints `refused` for every second without success. When accepted, it
//! prints `connected`, subscribes to everything, publishes on each KEY, and prints the key of each message that it
//! receives. The system tests use it to show what such sessions can and cannot receive from a run.

use std::time::Duration;

use serde_json::json;
use zenoh::{Config, Session, Wait};

/// How long one attempt dials.
const ATTEMPT: Duration = Duration::from_secs(1);

/// Between two publications.
const PAUSE: Duration = Duration::from_millis(5);

fn main() {
    let mut arguments = std::env::args().skip(1);
    let (Some(mode), Some(endpoint)) = (arguments.next(), arguments.next()) else {
        panic!("usage: outsider client|router|peer ENDPOINT [KEY...]");
    };
    let keys: Vec<String> = arguments.collect();
    let session = loop {
        match dial(&mode, &endpoint) {
            Some(session) => break session,
            None => println!("refused"),
        }
    };
    println!("connected");
    for expression in ["**", "rondo/**"].into_iter().chain(keys.iter().map(String::as_str)) {
        let subscriber = session
            .declare_subscriber(expression)
            // Its own publications are of no interest.
            .allowed_origin(zenoh::sample::Locality::Remote)
            .callback(|sample| println!("received {}", sample.key_expr()));
        subscriber.background().wait().expect("a subscription");
    }
    loop {
        for key in &keys {
            // Ends with the run.
            let _ = session.put(key, "from an outsider").wait();
        }
        std::thread::sleep(PAUSE);
    }
}

fn dial(mode: &str, endpoint: &str) -> Option<Session> {
    let json = json!({
        "mode": mode,
        "connect": {
            "endpoints": [endpoint],
            "timeout_ms": ATTEMPT.as_millis() as u64,
            "exit_on_failure": true,
            "retry": { "period_init_ms": 20, "period_max_ms": 20, "period_increase_factor": 1.0 },
        },
        "listen": { "endpoints": [] },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
    });
    zenoh::open(Config::from_json5(&json.to_string()).expect("settings that zenoh knows")).wait().ok()
}
