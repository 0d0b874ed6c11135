//! How a process takes part in the bus, and the configuration of zenoh for it: a star on explicit endpoints.

use std::time::Duration;

use ::zenoh::Config;
use serde_json::json;

use crate::endpoint::Endpoint;
use crate::Error;

/// The largest payload for the low-latency transport. That transport does not fragment: a message beyond the batch
/// size of the link (65,535 bytes on a Unix socket, less on TCP, headers included) ends the session without an error.
/// Half of that size is already rejected here, with an error.
pub const LOW_LATENCY_MAX_BYTES: usize = 32 * 1024;

/// A peer that sends nothing for this long counts as dead. Long enough for a process that is stopped, swapped out or
/// starved for some seconds. A process that dies closes its sockets, which is noticed at once.
const LEASE: Duration = Duration::from_secs(10);

/// How long a blocking publication may wait for room. After that zenoh closes the session, loses the queue and
/// reports success, so this is far longer than any pause that a run survives.
const WAIT_BEFORE_CLOSE: Duration = Duration::from_secs(600);

/// Retry periods, first and longest. A required endpoint is about to appear. An optional one, such as a monitor, may
/// be absent for the whole run and should cost nothing.
const RETRY_NEEDED: [Duration; 2] = [Duration::from_millis(20), Duration::from_millis(100)];
const RETRY_OPTIONAL: [Duration; 2] = [Duration::from_millis(200), Duration::from_secs(2)];

/// One runtime with one thread for all of zenoh. With a second thread each message wakes both, one only to look for
/// work: a twentieth more processor time. Rondo's code never blocks that thread, and zenoh starts a replacement where
/// it has to wait itself.
const ONE_RUNTIME: &str =
    "(acc:(handover:rx),app:(handover:rx),net:(handover:rx),tx:(handover:rx),rx:(worker_threads:1))";

/// How a process takes part in the bus.
#[derive(Debug, Clone)]
pub struct Options {
    /// Endpoints to listen on: `unixsock-stream/PATH` or `tcp/HOST:PORT`, where port 0 means any.
    pub listen: Vec<String>,
    /// Endpoints to dial, one for each other side (zenoh refuses a second link to the same one). All must answer within
    /// `connect_timeout`. A link that is lost later is dialled again for as long as this side lives.
    pub connect: Vec<String>,
    /// Endpoints to dial in the background, for example a monitor. An unreachable one is not an error.
    pub optional_connect: Vec<String>,
    /// How long [`open`](crate::open) waits for all of `connect`.
    pub connect_timeout: Duration,
    /// The faster transport, with at most [`LOW_LATENCY_MAX_BYTES`] per message. Both sides of a link must enable it.
    pub low_latency: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            listen: vec![],
            connect: vec![],
            optional_connect: vec![],
            connect_timeout: Duration::from_secs(30),
            low_latency: false,
        }
    }
}

/// Makes zenoh use one runtime in this process, unless `ZENOH_RUNTIME` is already set.
///
/// Call it at the top of `main`, before any thread starts: it sets an environment variable, which zenoh reads once,
/// at its first use. [`open`](crate::open) logs a warning if this was not called.
pub fn use_one_runtime() {
    if std::env::var_os("ZENOH_RUNTIME").is_none() {
        std::env::set_var("ZENOH_RUNTIME", ONE_RUNTIME);
    }
}

/// zenoh's configuration of a session that listens on `listen`, where no port is 0, and dials as in `options`.
pub(crate) fn config(
    options: &Options,
    listen: &[Endpoint],
    connect_timeout: Duration,
) -> Result<Config, Error> {
    let listen: Vec<_> = listen.iter().map(Endpoint::to_string).collect();
    let optional = options.optional_connect.iter().map(|endpoint| {
        let [first, longest] = RETRY_OPTIONAL.map(|period| period.as_millis());
        format!("{endpoint}#exit_on_failure=false;retry_period_init_ms={first};retry_period_max_ms={longest}")
    });
    let connect: Vec<_> = options.connect.iter().cloned().chain(optional).collect();
    let [first, longest] = RETRY_NEEDED.map(|period| period.as_millis() as u64);
    let json = json!({
        "mode": "peer",
        "listen": { "endpoints": listen, "exit_on_failure": true },
        "connect": {
            "endpoints": connect,
            // Rounded up, so that a failure after it is a timeout. 0 would mean one attempt without waiting.
            "timeout_ms": i64::try_from(connect_timeout.as_millis() + 1).unwrap_or(i64::MAX),
            "exit_on_failure": true,
            "retry": { "period_init_ms": first, "period_max_ms": longest, "period_increase_factor": 2.0 },
        },
        // The wait for scouted peers can miss its signal and then lasts the whole scouting delay of 500 ms.
        // It is not needed: zenoh sends everything to a peer whose subscriptions it has not received yet.
        "open": { "return_conditions": { "connect_scouted": false } },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
        // Peers only. A peer would forward between a client or a router and all others, in both directions. This names
        // routers as the sessions to serve as a gateway, which a peer cannot do, so they are refused. Clients are
        // refused because they are not named.
        "gateway": { "south": [{ "filters": [{ "modes": ["router"] }] }] },
        "transport": {
            // zenoh allows only one of the two.
            "unicast": { "lowlatency": options.low_latency, "qos": { "enabled": !options.low_latency } },
            "link": { "tx": {
                "lease": LEASE.as_millis() as u64,
                "queue": { "congestion_control": { "block": {
                    "wait_before_close": WAIT_BEFORE_CLOSE.as_micros() as u64,
                } } },
            } },
        },
    });
    Config::from_json5(&json.to_string()).map_err(|error| failed("read its configuration", &*error))
}

/// An error of zenoh. Its errors can be distinguished by their text only.
pub(crate) fn failed(action: &str, error: &(dyn std::error::Error + Send + Sync)) -> Error {
    let text = error.to_string();
    // zenoh's messages end with a place in its own source, which does not help the user.
    let reason = match text.rsplit_once(" at ") {
        Some((reason, place)) if place.contains(".rs:") => reason,
        _ => &text,
    };
    let (action, reason) = (action.to_owned(), reason.to_owned());
    if reason.contains("(os error ") {
        Error::System { action, reason }
    } else {
        Error::Zenoh { action, reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_place_in_the_sources_of_zenoh_is_left_out() {
        let cut = failed("open", &*Box::from("Unable to open: gone at /src/net/runtime.rs:388."));
        let kept = failed("open", &*Box::from("nobody is at home"));
        assert_eq!(cut.to_string(), "zenoh cannot open: Unable to open: gone");
        assert_eq!(kept.to_string(), "zenoh cannot open: nobody is at home");
    }

    #[test]
    fn what_the_operating_system_refuses_is_not_a_fault_of_the_program() {
        let text = "Can not create a timer: Too many open files (os error 24) at /src/timer.rs:12.";
        let error = failed("open a session", &*Box::from(text));
        let reason = "Can not create a timer: Too many open files (os error 24)".to_owned();
        assert_eq!(error, Error::System { action: "open a session".to_owned(), reason });
    }

    #[test]
    fn every_setting_is_one_that_zenoh_knows() {
        let options = Options {
            connect: vec!["tcp/10.0.0.5:7447".into()],
            optional_connect: vec!["unixsock-stream/m.sock".into()],
            connect_timeout: Duration::MAX,
            low_latency: true,
            ..Options::default()
        };
        let config = config(&options, &[Endpoint::parse("tcp/0.0.0.0:1").unwrap()], Duration::MAX).unwrap();
        let value = |key: &str| config.get_json(key).unwrap();
        assert_eq!(value("listen/endpoints"), r#"["tcp/0.0.0.0:1"]"#);
        assert_eq!(
            value("connect/endpoints"),
            "[\"tcp/10.0.0.5:7447\",\"unixsock-stream/m.sock\
             #exit_on_failure=false;retry_period_init_ms=200;retry_period_max_ms=2000\"]"
        );
        assert_eq!(value("connect/timeout_ms"), i64::MAX.to_string());
        assert_eq!(value("transport/unicast/lowlatency"), "true");
        assert_eq!(value("transport/unicast/qos/enabled"), "false");
        assert_eq!(value("transport/link/tx/lease"), "10000");
        let block = "transport/link/tx/queue/congestion_control/block/wait_before_close";
        assert_eq!(value(block), "600000000");
        assert_eq!(value("scouting/multicast/enabled"), "false");
        assert_eq!(value("scouting/gossip/enabled"), "false");
        assert_eq!(value("open/return_conditions/connect_scouted"), "false");
        // zenoh has no access to this value by its key.
        let whole: serde_json::Value = serde_json::from_str(&config.to_string()).unwrap();
        assert_eq!(whole["gateway"]["south"][0]["filters"][0]["modes"], json!(["router"]));
    }
}
