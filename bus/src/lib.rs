//! The message bus: zenoh between processes, the same interface in memory.
//!
//! The only crate that depends on zenoh. Its API has no generics and no async, so the crates above neither compile
//! zenoh's generics again nor need a runtime.
//!
//! # Shape
//!
//! A star of peers. Roles that serve listen on explicit endpoints, all others dial them and listen
//! nowhere; scouting is off. Peers do not forward to peers, so a dialling side receives what the listening
//! side sends it and nothing that another dialling side published. A peer does forward between a client or
//! a router and all others, so sessions in those modes are refused. A router in the middle would add two hops to
//! every message and would forward between agents.
//!
//! # Order
//!
//! - Messages on one key from one side arrive in the order they were sent, none lost while the link
//!   lives. Across a reconnect delivery is at most once: messages that matter carry a number and can be
//!   asked for again.
//! - What a side sends after [`open`] has returned reaches every side that it dialled. In the other
//!   direction: subscribe first, then query or announce. A side that receives the query or the token has
//!   already received the subscription.
//! - A publication without a subscriber is dropped where it was sent.
//!
//! # Threads
//!
//! zenoh normally starts five runtimes and hands each message from thread to thread between them. With one
//! shared runtime ([`use_one_runtime`]) the thread that polls a socket also reads it: half the context
//! switches and up to twice the round trips a second. The price: nothing may ever block that runtime. A
//! publication from inside a callback does so when the queue is full (measured: the session is closed and
//! data lost, while every send reports success). Therefore callbacks here only push an [`Event`]
//! into the inbox, and everything else happens on the caller's own threads. The inbox is unbounded: a role
//! keeps reading it.
//!
//! # Liveness
//!
//! A killed process closes its sockets: its tokens are gone within 1 to 2 ms. A process that is stopped, or whose
//! network is cut, keeps its session for the lease of 10 s. Measured with SIGSTOP, on Unix sockets and TCP, with low
//! latency and without: after 6 s the session is intact and messages sent meanwhile are answered; after more than the
//! lease the token was gone at 10.0 s and back 2 to 4 ms after SIGCONT.

mod endpoint;
mod error;
mod faults;
mod inbox;
mod key;
mod ledger;
mod memory;
mod options;
mod zenoh;

use std::any::Any;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

pub use endpoint::unix_endpoint;
pub use error::Error;
pub use inbox::{inbox, Events, Inbox};
pub use ledger::{recorded, Ledger, Record, Sink, Traffic};
pub use memory::{memory, MemoryHub};
pub use options::{use_one_runtime, Options, LOW_LATENCY_MAX_BYTES};
pub use zenoh::open;

/// What arrives in a role's inbox.
#[derive(Debug)]
pub enum Event {
    /// A publication on a key that this side subscribes to.
    Message {
        /// The key it was published on; shared with the subscription when that names one exact key.
        key: Arc<str>,
        /// The payload.
        payload: Vec<u8>,
    },
    /// A query on a key that this side serves.
    Query(Query),
    /// A token on a watched key is present: it existed already, or was just announced.
    Alive {
        /// The key of the token.
        key: Arc<str>,
    },
    /// A token on a watched key is gone: it was dropped, or its process died or lost its connection.
    Gone {
        /// The key of the token.
        key: Arc<str>,
    },
    /// A signal arrived: `main` pushes this into a role's inbox. The bus never sends it.
    Stop,
}

/// One side of the bus. A declaration ends when its [`Guard`] or the side itself is dropped; after the latter
/// publishers return [`Error::Closed`].
///
/// A *key* is a path such as `rondo/r1/world/0/observe`. A *key expression* may contain `*` for one
/// chunk and `**` for any number of chunks.
pub trait Bus: Send + Sync {
    /// A publisher that waits when the link is full and loses nothing: for messages that learning depends on.
    fn publisher(&self, key: &str) -> Result<Publisher, Error>;

    /// A publisher that drops messages when the link is full and never waits: for metrics.
    fn best_effort_publisher(&self, key: &str) -> Result<Publisher, Error>;

    /// Receives publications on matching keys as [`Event::Message`], also this side's own.
    fn subscribe(&self, key_expr: &str, inbox: Inbox) -> Result<Guard, Error>;

    /// Receives queries on matching keys as [`Event::Query`].
    fn serve(&self, key_expr: &str, inbox: Inbox) -> Result<Guard, Error>;

    /// Sends a query on `key` and waits for the first reply. `None` if no side serves the key, every side that does
    /// dropped the query, or the timeout passed.
    fn ask(&self, key: &str, payload: &[u8], timeout: Duration) -> Result<Option<Vec<u8>>, Error>;

    /// Keeps a token on `key` for as long as the guard, this side and its process live. A key that several other sides
    /// announce is alive from the first of them to the last, so a process may start before its predecessor is gone. A
    /// side must not watch a key that it announces itself.
    fn announce(&self, key: &str) -> Result<Guard, Error>;

    /// Receives [`Event::Alive`] for tokens that are present, then every change.
    fn watch(&self, key_expr: &str, inbox: Inbox) -> Result<Guard, Error>;

    /// The endpoints that this side listens on, with the real port where 0 was given. Empty in memory and for a side
    /// that only dials.
    fn endpoints(&self) -> Vec<String>;

    /// The traffic counts of this side.
    fn ledger(&self) -> &Arc<Ledger>;

    /// Messages and payload bytes that this side sent (publications, queries and replies), by key and
    /// in the order of keys. A publication without subscribers counts: it was handed to the bus.
    fn traffic(&self) -> Vec<Traffic> {
        self.ledger().traffic()
    }
}

type SendFn = dyn Fn(&[u8]) -> Result<(), Error> + Send;
type ReplyFn = dyn FnOnce(&[u8]) + Send;

/// Sends on one key.
pub struct Publisher {
    send: Box<SendFn>,
}

impl Publisher {
    fn new(send: impl Fn(&[u8]) -> Result<(), Error> + Send + 'static) -> Self {
        Self { send: Box::new(send) }
    }

    /// Sends `payload` to all subscribers of the key.
    ///
    /// # Errors
    /// [`Error::Closed`] when the side that made this publisher was dropped, [`Error::TooLarge`] when
    /// the link cannot carry a message of this size.
    pub fn send(&self, payload: &[u8]) -> Result<(), Error> {
        (self.send)(payload)
    }
}

/// A query from another side. It may be answered now or later, from any thread. If it is dropped without an answer,
/// the other side receives "no reply" at once.
pub struct Query {
    /// The key of the query.
    pub key: Arc<str>,
    /// The payload of the query.
    pub payload: Vec<u8>,
    reply: Box<ReplyFn>,
}

impl Query {
    fn new(key: Arc<str>, payload: Vec<u8>, reply: impl FnOnce(&[u8]) + Send + 'static) -> Self {
        Self { key, payload, reply: Box::new(reply) }
    }

    /// Sends the reply. If it cannot be delivered because the other side is gone or has stopped waiting, it is dropped
    /// and logged; the other side sends its query again.
    pub fn reply(self, payload: &[u8]) {
        (self.reply)(payload);
    }
}

impl fmt::Debug for Query {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, payload, .. } = self;
        f.debug_struct("Query").field("key", key).field("payload", payload).finish_non_exhaustive()
    }
}

/// Keeps a subscription, a served key, a token or a watch alive; undeclares it when dropped.
#[must_use = "dropping the guard ends what it guards at once"]
pub struct Guard {
    _declared: Box<dyn Any + Send + Sync>,
}

impl Guard {
    fn new(declared: impl Any + Send + Sync) -> Self {
        Self { _declared: Box::new(declared) }
    }
}
