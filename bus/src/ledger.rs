//! Traffic counts of one peer, by key; on request also a record of everything that it sends.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

use crate::Bus;

/// The traffic of one side on one key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Traffic {
    /// The key.
    pub key: String,
    /// Publications, queries and replies.
    pub messages: u64,
    /// Bytes of their payloads, without any header.
    pub bytes: u64,
}

/// One thing that a side sent or declared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Record {
    /// It published `payload` on `key`.
    Published { key: Arc<str>, payload: Vec<u8> },
    /// It sent the query `payload` on `key`.
    Asked { key: Arc<str>, payload: Vec<u8> },
    /// It replied to a query on `key` with `payload`.
    Replied { key: Arc<str>, payload: Vec<u8> },
    /// It subscribed to this key expression.
    Subscribed { key: Arc<str> },
    /// It serves this key expression.
    Served { key: Arc<str> },
    /// It announced a token on this key.
    Announced { key: Arc<str> },
    /// It watches the tokens that match this key expression.
    Watched { key: Arc<str> },
}

/// Receives the records of a side, on the thread that sends or declares.
pub type Sink = Arc<dyn Fn(Record) + Send + Sync>;

/// The same side of the bus. `sink` receives a record of everything that it sends and declares from now on, also
/// through publishers made earlier.
pub fn recorded(bus: Arc<dyn Bus>, sink: Sink) -> Arc<dyn Bus> {
    bus.ledger().sinks.write().unwrap_or_else(PoisonError::into_inner).push(sink);
    bus
}

/// The traffic counts of one side; read them with [`Bus::traffic`] or [`recorded`].
#[derive(Default)]
pub struct Ledger {
    accounts: Mutex<BTreeMap<Arc<str>, Arc<Account>>>,
    sinks: RwLock<Vec<Sink>>,
}

#[derive(Default)]
struct Account {
    messages: AtomicU64,
    bytes: AtomicU64,
}

/// What kind of message was sent.
#[derive(Clone, Copy)]
pub(crate) enum Sent {
    Publication,
    Query,
    Reply,
}

impl Ledger {
    pub(crate) fn traffic(&self) -> Vec<Traffic> {
        let traffic = |(key, account): (&Arc<str>, &Arc<Account>)| Traffic {
            key: key.to_string(),
            messages: account.messages.load(Relaxed),
            bytes: account.bytes.load(Relaxed),
        };
        let sent = |traffic: &Traffic| traffic.messages > 0;
        self.accounts().iter().map(traffic).filter(sent).collect()
    }

    /// The counts for `key`. A publisher looks them up once.
    pub(crate) fn line(self: &Arc<Self>, key: Arc<str>) -> Line {
        let account = self.accounts().entry(key.clone()).or_default().clone();
        Line { ledger: self.clone(), key, account }
    }

    pub(crate) fn declared(&self, record: Record) {
        self.report(|| record.clone());
    }

    fn report(&self, record: impl Fn() -> Record) {
        for sink in self.sinks.read().unwrap_or_else(PoisonError::into_inner).iter() {
            sink(record());
        }
    }

    fn accounts(&self) -> MutexGuard<'_, BTreeMap<Arc<str>, Arc<Account>>> {
        self.accounts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The counts of one side for one key.
pub(crate) struct Line {
    ledger: Arc<Ledger>,
    pub(crate) key: Arc<str>,
    account: Arc<Account>,
}

impl Line {
    pub(crate) fn sent(&self, sent: Sent, payload: &[u8]) {
        self.account.messages.fetch_add(1, Relaxed);
        self.account.bytes.fetch_add(payload.len() as u64, Relaxed);
        self.ledger.report(|| {
            let (key, payload) = (self.key.clone(), payload.to_vec());
            match sent {
                Sent::Publication => Record::Published { key, payload },
                Sent::Query => Record::Asked { key, payload },
                Sent::Reply => Record::Replied { key, payload },
            }
        });
    }
}
