//! The bus between processes: a zenoh session in peer mode, set up for a star on explicit endpoints.

use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

use ::zenoh::bytes::ZBytes;
use ::zenoh::key_expr::OwnedKeyExpr;
use ::zenoh::qos::{CongestionControl, Priority};
use ::zenoh::query::ConsolidationMode;
use ::zenoh::sample::{Sample, SampleKind};
use ::zenoh::session::SessionClosedError;
use ::zenoh::{Config, Session, Wait};
use serde_json::json;

use crate::endpoint::Endpoint;
use crate::ledger::{Ledger, Line, Record, Sent};
use crate::{key, Bus, Error, Event, Guard, Inbox, Publisher, Query};

/// The largest payload that the low-latency transport is trusted with. It does not cut messages up: one
/// beyond the batch size of the link (65,535 bytes on a Unix socket, less on TCP, headers included) kills
/// the session without a word, so that half of it is refused here, where somebody hears of it.
pub const LOW_LATENCY_MAX_BYTES: usize = 32 * 1024;

/// A peer that says nothing for this long is taken for dead. Long enough for a process that is stopped,
/// swapped out or starved for some seconds; a process that dies closes its sockets and is seen at once.
const LEASE: Duration = Duration::from_secs(10);

/// How long a blocking publication may wait for room. When it passes, zenoh closes the session, loses
/// what was queued and reports success, so it is far longer than any pause that a run survives.
const WAIT_BEFORE_CLOSE: Duration = Duration::from_secs(600);

/// Retry periods, first and longest. Endpoints that a role needs are about to appear; an optional one,
/// such as a monitor, may be absent for the whole run and should cost nothing.
const RETRY_NEEDED: [Duration; 2] = [Duration::from_millis(20), Duration::from_millis(100)];
const RETRY_OPTIONAL: [Duration; 2] = [Duration::from_millis(200), Duration::from_secs(2)];

/// Attempts to listen on a port given as 0, in case that the free port found is taken before zenoh has it.
const PORT_ATTEMPTS: usize = 5;

/// One runtime with two threads for everything that zenoh does. One would do; the second keeps the session
/// alive when the first is held up.
const ONE_RUNTIME: &str =
    "(acc:(handover:rx),app:(handover:rx),net:(handover:rx),tx:(handover:rx),rx:(worker_threads:2))";

/// How to take part in the bus.
#[derive(Debug, Clone)]
pub struct Options {
    /// Endpoints to listen on: `unixsock-stream/PATH` or `tcp/HOST:PORT`, where port 0 means any.
    pub listen: Vec<String>,
    /// Endpoints to dial, one for each other side (zenoh refuses a second link to the same one). All must
    /// answer within `connect_timeout`; a link that is lost later is dialled again for as long as this
    /// side lives.
    pub connect: Vec<String>,
    /// Endpoints to dial in the background, for example a monitor: not reaching one is no error.
    pub optional_connect: Vec<String>,
    /// How long [`open`] waits for all of `connect`.
    pub connect_timeout: Duration,
    /// The transport that is faster and carries at most [`LOW_LATENCY_MAX_BYTES`] a message. Used on a link
    /// when both sides ask for it.
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

/// Makes zenoh use one runtime in this process, unless `ZENOH_RUNTIME` says otherwise already.
///
/// Call it at the top of `main`, before any thread is started: it sets an environment variable, and zenoh
/// reads it once, at its first use. [`open`] warns when nobody did.
pub fn use_one_runtime() {
    if std::env::var_os("ZENOH_RUNTIME").is_none() {
        std::env::set_var("ZENOH_RUNTIME", ONE_RUNTIME);
    }
}

/// Joins the bus: listens, dials, and waits until every endpoint of `connect` has answered and has told
/// what it subscribes to. Takes a few milliseconds when all are there.
///
/// # Errors
/// [`Error::Endpoint`] for a string that is no endpoint, [`Error::InUse`] and [`Error::Listen`] for one that
/// cannot be listened on, [`Error::Unreachable`] for those that did not answer in time.
pub fn open(options: &Options) -> Result<Arc<dyn Bus>, Error> {
    static WARNING: Once = Once::new();
    if std::env::var_os("ZENOH_RUNTIME").is_none() {
        WARNING.call_once(|| {
            tracing::warn!(
                "zenoh runs on five runtimes, which is slow; call `bus::use_one_runtime` first in `main`"
            );
        });
    }
    let parse =
        |texts: &[String]| texts.iter().map(|text| Endpoint::parse(text)).collect::<Result<Vec<_>, _>>();
    let wanted = parse(&options.listen)?;
    let needed = parse(&options.connect)?;
    parse(&options.optional_connect)?;

    let start = Instant::now();
    let any_port = wanted.iter().any(|endpoint| matches!(endpoint, Endpoint::Tcp { port: 0, .. }));
    let mut attempts = if any_port { PORT_ATTEMPTS } else { 1 };
    loop {
        attempts -= 1;
        let listen = wanted.iter().map(Endpoint::ready_to_listen).collect::<Result<Vec<_>, _>>()?;
        let remaining = options.connect_timeout.saturating_sub(start.elapsed());
        match ::zenoh::open(config(options, &listen, remaining)?).wait() {
            Ok(session) => {
                hear_declarations(&session, &needed, options.connect_timeout.saturating_sub(start.elapsed()));
                let endpoints = listen.iter().map(Endpoint::to_string).collect();
                return Ok(Arc::new(ZenohBus {
                    session,
                    endpoints,
                    ledger: Arc::default(),
                    max_bytes: if options.low_latency { LOW_LATENCY_MAX_BYTES } else { usize::MAX },
                }));
            }
            Err(_) if !needed.is_empty() && start.elapsed() >= options.connect_timeout => {
                return Err(unreachable(&needed, start.elapsed()));
            }
            Err(error) if attempts == 0 => return Err(failed("open a session", &*error)),
            Err(_) => (),
        }
    }
}

fn config(options: &Options, listen: &[Endpoint], connect_timeout: Duration) -> Result<Config, Error> {
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
            // 0 would mean one attempt without waiting.
            "timeout_ms": connect_timeout.as_millis().clamp(1, i64::MAX as u128) as i64,
            "exit_on_failure": true,
            "retry": { "period_init_ms": first, "period_max_ms": longest, "period_increase_factor": 2.0 },
        },
        // The wait for these conditions can miss its signal and then lasts the whole scouting delay of
        // 500 ms. `hear_declarations` waits for the same thing.
        "open": { "return_conditions": { "connect_scouted": false } },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
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

/// Returns when the sides that were dialled have told what they subscribe to and serve: until then a
/// publication would be dropped for lack of subscribers. A question about tokens is answered after the
/// declarations that were under way; nobody has this token.
fn hear_declarations(session: &Session, needed: &[Endpoint], timeout: Duration) {
    if needed.is_empty() {
        return;
    }
    let timeout = timeout.max(Duration::from_secs(1));
    let heard = session.liveliness().get("bus/nobody").timeout(timeout).wait().is_ok_and(|replies| {
        // The channel closes when everybody has answered; on a timeout an error comes first.
        replies.recv().is_err()
    });
    if !heard {
        tracing::warn!(?timeout, "a side that was dialled does not tell what it subscribes to; going on");
    }
}

/// Names the endpoints that accept no connection; when all do, none of them spoke zenoh in time.
fn unreachable(needed: &[Endpoint], waited: Duration) -> Error {
    let silent: Vec<_> = needed.iter().filter(|endpoint| !endpoint.answers()).collect();
    let blamed = if silent.is_empty() { needed.iter().collect() } else { silent };
    Error::Unreachable { endpoints: blamed.iter().map(|endpoint| endpoint.to_string()).collect(), waited }
}

struct ZenohBus {
    session: Session,
    endpoints: Vec<String>,
    ledger: Arc<Ledger>,
    max_bytes: usize,
}

impl ZenohBus {
    fn publish(&self, key: &str, congestion: CongestionControl) -> Result<Publisher, Error> {
        let blocking = congestion == CongestionControl::Block;
        let publisher = self
            .session
            .declare_publisher(key::exact(key)?)
            .congestion_control(congestion)
            // Express: not held back to share a packet with the next message. Metrics may be, and they
            // also stand back behind everything else.
            .express(blocking)
            .priority(if blocking { Priority::DEFAULT } else { Priority::DataLow })
            .wait()
            .map_err(|error| failed(&format!("declare a publisher on `{key}`"), &*error))?;
        let line = self.ledger.line(key.into());
        let max_bytes = self.max_bytes;
        Ok(Publisher::new(move |payload| {
            fits(&line.key, payload, max_bytes)?;
            publisher.put(payload).wait().map_err(|error| {
                if error.is::<SessionClosedError>() {
                    Error::Closed { key: line.key.to_string() }
                } else {
                    failed(&format!("publish on `{}`", line.key), &*error)
                }
            })?;
            line.sent(Sent::Publication, payload);
            Ok(())
        }))
    }
}

impl Bus for ZenohBus {
    fn publisher(&self, key: &str) -> Result<Publisher, Error> {
        self.publish(key, CongestionControl::Block)
    }

    fn best_effort_publisher(&self, key: &str) -> Result<Publisher, Error> {
        self.publish(key, CongestionControl::Drop)
    }

    fn subscribe(&self, key_expr: &str, inbox: Inbox) -> Result<Guard, Error> {
        let declared: Arc<str> = key_expr.into();
        let of_sample = declared.clone();
        let push = move |sample: Sample| {
            if sample.kind() == SampleKind::Put {
                let key = shared(&of_sample, sample.key_expr().as_str());
                push(&inbox, Event::Message { key, payload: bytes(sample.payload()) });
            }
        };
        let subscriber = self
            .session
            .declare_subscriber(key::expression(key_expr)?)
            .callback(push)
            .wait()
            .map_err(|error| failed(&format!("subscribe to `{key_expr}`"), &*error))?;
        self.ledger.declared(Record::Subscribed { key: declared });
        Ok(Guard::new(subscriber))
    }

    fn serve(&self, key_expr: &str, inbox: Inbox) -> Result<Guard, Error> {
        let declared: Arc<str> = key_expr.into();
        let (of_query, ledger, max_bytes) = (declared.clone(), self.ledger.clone(), self.max_bytes);
        let push = move |query: ::zenoh::query::Query| {
            let key = shared(&of_query, query.key_expr().as_str());
            let payload = query.payload().map(bytes).unwrap_or_default();
            let line = ledger.line(key.clone());
            let answer = move |payload: &[u8]| answer(&query, payload, &line, max_bytes);
            push(&inbox, Event::Query(Query::new(key, payload, answer)));
        };
        let queryable = self
            .session
            .declare_queryable(key::expression(key_expr)?)
            .callback(push)
            .wait()
            .map_err(|error| failed(&format!("serve `{key_expr}`"), &*error))?;
        self.ledger.declared(Record::Served { key: declared });
        Ok(Guard::new(queryable))
    }

    fn ask(&self, key: &str, payload: &[u8], timeout: Duration) -> Result<Option<Vec<u8>>, Error> {
        fits(key, payload, self.max_bytes)?;
        let replies = self
            .session
            .get(key::exact(key)?)
            .payload(payload)
            .timeout(timeout)
            // Otherwise zenoh holds replies back until all have come.
            .consolidation(ConsolidationMode::None)
            .congestion_control(CongestionControl::Block)
            .express(true)
            .wait()
            .map_err(|error| failed(&format!("ask on `{key}`"), &*error))?;
        self.ledger.line(key.into()).sent(Sent::Query, payload);
        // Errors among the replies are timeouts; the channel closes when nobody is left who may answer.
        while let Ok(reply) = replies.recv() {
            if let Ok(sample) = reply.into_result() {
                return Ok(Some(bytes(sample.payload())));
            }
        }
        Ok(None)
    }

    fn announce(&self, key: &str) -> Result<Guard, Error> {
        let token = self
            .session
            .liveliness()
            .declare_token(key::exact(key)?)
            .wait()
            .map_err(|error| failed(&format!("announce `{key}`"), &*error))?;
        self.ledger.declared(Record::Announced { key: key.into() });
        Ok(Guard::new(token))
    }

    fn watch(&self, key_expr: &str, inbox: Inbox) -> Result<Guard, Error> {
        let declared: Arc<str> = key_expr.into();
        let of_token = declared.clone();
        let push = move |sample: Sample| {
            let key = shared(&of_token, sample.key_expr().as_str());
            let event = match sample.kind() {
                SampleKind::Put => Event::Alive { key },
                SampleKind::Delete => Event::Gone { key },
            };
            push(&inbox, event);
        };
        let watcher = self
            .session
            .liveliness()
            .declare_subscriber(key::expression(key_expr)?)
            .history(true)
            .callback(push)
            .wait()
            .map_err(|error| failed(&format!("watch `{key_expr}`"), &*error))?;
        self.ledger.declared(Record::Watched { key: declared });
        Ok(Guard::new(watcher))
    }

    fn endpoints(&self) -> Vec<String> {
        self.endpoints.clone()
    }

    fn ledger(&self) -> &Arc<Ledger> {
        &self.ledger
    }
}

fn answer(query: &::zenoh::query::Query, payload: &[u8], line: &Line, max_bytes: usize) {
    let sent = fits(&line.key, payload, max_bytes).and_then(|()| {
        // The key was parsed by zenoh when the query came in.
        let key: OwnedKeyExpr = query.key_expr().clone().into();
        let reply = query.reply(key, payload).express(true);
        reply.wait().map_err(|error| failed("reply", &*error))
    });
    match sent {
        Ok(()) => line.sent(Sent::Reply, payload),
        Err(error) => tracing::warn!(key = %line.key, %error, "a reply was dropped"),
    }
}

/// The declared key where it is the very key that came, so that a message costs no new string.
fn shared(declared: &Arc<str>, came: &str) -> Arc<str> {
    if **declared == *came {
        declared.clone()
    } else {
        came.into()
    }
}

/// An inbox that nobody reads any more belongs to a role that ends; its guards are about to be dropped.
fn push(inbox: &Inbox, event: Event) {
    let _ = inbox.send(event);
}

fn bytes(payload: &ZBytes) -> Vec<u8> {
    payload.to_bytes().into_owned()
}

fn fits(key: &str, payload: &[u8], limit: usize) -> Result<(), Error> {
    if payload.len() > limit {
        return Err(Error::TooLarge { key: key.into(), bytes: payload.len(), limit });
    }
    Ok(())
}

fn failed(action: &str, error: &(dyn std::error::Error + Send + Sync)) -> Error {
    Error::Zenoh { action: action.into(), reason: error.to_string() }
}
