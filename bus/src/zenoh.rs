//! The bus between processes: a zenoh session in peer mode.

use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

use ::zenoh::bytes::ZBytes;
use ::zenoh::qos::{CongestionControl, Priority};
use ::zenoh::query::ConsolidationMode;
use ::zenoh::sample::{Sample, SampleKind};
use ::zenoh::session::SessionClosedError;
use ::zenoh::{Session, Wait};

use crate::endpoint::Endpoint;
use crate::ledger::{Ledger, Record, Sent};
use crate::options::{config, failed};
use crate::{key, Bus, Error, Event, Guard, Inbox, Options, Publisher, Query, LOW_LATENCY_MAX_BYTES};

/// Longest timeout of a query; prevents an overflow in sums of instants.
const LONGEST_QUESTION: Duration = Duration::from_secs(24 * 3600);

/// The Unix socket of a killed process is free again within milliseconds. A socket still locked after this time
/// belongs to a live process.
const STILL_ENDING: Duration = Duration::from_secs(3);

/// Pause between two attempts to listen on such a socket.
const LOOK_AGAIN: Duration = Duration::from_millis(20);

/// Attempts to listen where port 0 was given: another process may take the free port before zenoh binds it.
const PORT_ATTEMPTS: usize = 5;

/// Joins the bus: listens, dials, and waits until every endpoint of `connect` has answered. Takes a few milliseconds
/// when all are up. Messages sent from then on reach all sides that were dialled.
///
/// # Errors
/// [`Error::Endpoint`] for a string that is not an endpoint, [`Error::InUse`] and [`Error::Listen`] for one on which
/// this process cannot listen, [`Error::Unreachable`] for those that did not answer in time.
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
        let listen = wanted.iter().map(Endpoint::ready_to_listen).collect::<Result<Vec<_>, _>>()?;
        let remaining = options.connect_timeout.saturating_sub(start.elapsed());
        match ::zenoh::open(config(options, &listen, remaining)?).wait() {
            Ok(session) => {
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
            Err(error) => match refused(&listen, &*error) {
                Some((_, Refusal::Locked)) if start.elapsed() < STILL_ENDING => {
                    std::thread::sleep(LOOK_AGAIN);
                }
                Some((endpoint, Refusal::Locked)) => return Err(endpoint.in_use()),
                Some((endpoint, Refusal::System(reason))) => return Err(endpoint.cannot_listen(&reason)),
                None => {
                    attempts -= 1;
                    if attempts == 0 {
                        return Err(match failed("open a session", &*error) {
                            // The configuration was understood, so what fails is what is outside.
                            Error::Zenoh { action, reason } => Error::System { action, reason },
                            other => other,
                        });
                    }
                }
            },
        }
    }
}

/// Why zenoh does not listen on a Unix socket.
#[derive(Debug, PartialEq)]
enum Refusal {
    /// The lock beside it is held. Nobody accepts connections there any more, but the process that did so, or a
    /// child of it that has inherited the lock, is not quite gone.
    Locked,
    /// The file system has no sockets or no locks, for instance.
    System(String),
}

/// The Unix socket that zenoh could not listen on, and why: its messages are all that tells one case from another.
fn refused<'a>(
    listen: &'a [Endpoint],
    error: &(dyn std::error::Error + Send + Sync),
) -> Option<(&'a Endpoint, Refusal)> {
    let text = error.to_string();
    listen.iter().find_map(|endpoint| {
        let Endpoint::Unix(path) = endpoint else { return None };
        let (_, why) = text.split_once(&format!(" listener on {}", path.to_str()?))?;
        let why = why.strip_prefix(" - ").or_else(|| why.strip_prefix(": "))?;
        if why.starts_with("Unable to acquire lock: EAGAIN") {
            return Some((endpoint, Refusal::Locked));
        }
        let reason = why.rsplit_once(" at ").map_or(why, |(reason, _)| reason);
        Some((endpoint, Refusal::System(reason.to_owned())))
    })
}

/// Names the endpoints that accept no connection. If all accept one, none of them answered as zenoh in time.
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
            // Express: sent at once, without waiting to share a packet with the next message. Metrics are not express,
            // and have a lower priority than all else.
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
                inbox.push(Event::Message { key, payload: bytes(sample.payload()) });
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
            let (ledger, of_reply) = (ledger.clone(), key.clone());
            // The counts of a key are created with the first reply, so foreign queries alone create none.
            let answer = move |payload: &[u8]| answer(&query, of_reply, payload, &ledger, max_bytes);
            inbox.push(Event::Query(Query::new(key, payload, answer)));
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
        let timeout = timeout.min(LONGEST_QUESTION);
        let deadline = Instant::now() + timeout;
        let replies = self
            .session
            .get(key::exact(key)?)
            .payload(payload)
            .timeout(timeout)
            // Otherwise zenoh delays replies until all have arrived.
            .consolidation(ConsolidationMode::None)
            .congestion_control(CongestionControl::Block)
            .express(true)
            .wait()
            .map_err(|error| failed(&format!("ask on `{key}`"), &*error))?;
        self.ledger.line(key.into()).sent(Sent::Query, payload);
        // Errors among the replies are timeouts. The channel closes when no side is left that may answer.
        while let Ok(Some(reply)) = replies.recv_deadline(deadline) {
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
            inbox.push(event);
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

fn answer(
    query: &::zenoh::query::Query,
    key: Arc<str>,
    payload: &[u8],
    ledger: &Arc<Ledger>,
    max_bytes: usize,
) {
    let sent = fits(&key, payload, max_bytes).and_then(|()| {
        let reply = query.reply(query.key_expr().clone(), payload).express(true);
        reply.wait().map_err(|error| failed("reply", &*error))
    });
    match sent {
        Ok(()) => ledger.line(key).sent(Sent::Reply, payload),
        Err(error) => tracing::warn!(%key, %error, "a reply was dropped"),
    }
}

/// The declared key if it equals the key of the message, so that a message needs no new string.
fn shared(declared: &Arc<str>, came: &str) -> Arc<str> {
    if **declared == *came {
        declared.clone()
    } else {
        came.into()
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_that_is_held_is_told_from_one_that_cannot_be() {
        let listen = [Endpoint::parse("tcp/127.0.0.1:7447"), Endpoint::parse("unixsock-stream//run/a.sock")];
        let listen = listen.map(Result::unwrap);
        let why = |text: &str| {
            let text = format!(
                "Unable to open a listener: Can not create a new UnixSocketStream listener on {text}"
            );
            refused(&listen, &*Box::from(text)).map(|(endpoint, refusal)| {
                assert_eq!(endpoint, &listen[1]);
                refusal
            })
        };
        let system = |reason: &str| Some(Refusal::System(reason.to_owned()));
        assert_eq!(
            why("/run/a.sock - Unable to acquire lock: EAGAIN: Try again at /src/unicast.rs:315."),
            Some(Refusal::Locked)
        );
        assert_eq!(
            why("/run/a.sock - Unable to acquire lock: ENOLCK: No record locks available at /src/unicast.rs:315."),
            system("Unable to acquire lock: ENOLCK: No record locks available")
        );
        assert_eq!(
            why("/run/a.sock: Operation not permitted (os error 1) at /src/unicast.rs:331."),
            system("Operation not permitted (os error 1)")
        );
        assert_eq!(why("/run/b.sock: Operation not permitted (os error 1) at /src/unicast.rs:331."), None);
    }
}
