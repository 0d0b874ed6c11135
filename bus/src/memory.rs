//! The bus in memory: several sides on one hub in one process. It behaves like the zenoh bus, without its threads.
//!
//! Delivery happens on the sender's thread, before `send` returns, in the order of declaration. Unlike in the star of
//! peers, every side can receive from every other. Faults, if requested, affect publications only.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::mpsc::{self, Sender};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ::zenoh::key_expr::{keyexpr, OwnedKeyExpr};

use crate::faults::{Fate, Faults};
use crate::inbox::lock;
use crate::ledger::{Ledger, Record, Sent};
use crate::{key, Bus, Error, Event, Guard, Inbox, Publisher, Query};

/// A hub without faults.
pub fn memory() -> MemoryHub {
    MemoryHub::default()
}

/// The hub that the sides of an in-memory bus share. Clones are the same hub.
#[derive(Clone, Default)]
pub struct MemoryHub {
    state: Arc<Mutex<State>>,
}

impl MemoryHub {
    /// A hub that loses, doubles and reorders publications with these probabilities. What happens to the
    /// `n`-th publication on a key depends on the seed, the key and `n` only. One that is overtaken waits
    /// for the next publication that reaches the same subscriber. Queries and tokens are not touched.
    pub fn with_faults(seed: u64, loss: f64, duplicate: f64, reorder: f64) -> Self {
        let hub = Self::default();
        lock(&hub.state).faults = Some(Faults { seed, loss, duplicate, reorder });
        hub
    }

    /// A new side of the bus. When it is dropped, its declarations end, as if its process had died.
    pub fn connect(&self) -> Arc<dyn Bus> {
        let mut state = lock(&self.state);
        let side = state.new_id();
        state.sides.insert(side);
        Arc::new(MemoryBus { state: self.state.clone(), side, ledger: Arc::default() })
    }
}

#[derive(Default)]
struct State {
    last_id: u64,
    sides: BTreeSet<u64>,
    /// By id, in the order of declaration.
    listeners: BTreeMap<u64, Listener>,
    tokens: BTreeMap<u64, Token>,
    faults: Option<Faults>,
    /// Number of publications so far, by key; used for faults only.
    published: HashMap<Arc<str>, u64>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Subscription,
    Queryable,
    Watch,
}

struct Listener {
    side: u64,
    kind: Kind,
    key_expr: OwnedKeyExpr,
    inbox: Inbox,
    /// The traffic counts of the subscribing side.
    ledger: Arc<Ledger>,
    /// A publication to be delivered after the next one.
    held: Option<(Arc<str>, Vec<u8>)>,
}

struct Token {
    side: u64,
    key: OwnedKeyExpr,
}

impl State {
    fn new_id(&mut self) -> u64 {
        self.last_id += 1;
        self.last_id
    }

    fn matching<'a>(&'a mut self, kind: Kind, key: &'a keyexpr) -> impl Iterator<Item = &'a mut Listener> {
        self.listeners.values_mut().filter(move |listener| {
            listener.kind == kind && (&*listener.key_expr == key || listener.key_expr.intersects(key))
        })
    }

    fn publish(&mut self, key_expr: &keyexpr, key: &Arc<str>, payload: &[u8]) {
        let fate = match self.faults {
            None => Fate::Deliver,
            Some(faults) => {
                let n = self.published.entry(key.clone()).or_default();
                *n += 1;
                faults.fate(key, *n)
            }
        };
        for listener in self.matching(Kind::Subscription, key_expr) {
            let waiting = listener.held.take();
            let deliver = |(key, payload)| listener.inbox.push(Event::Message { key, payload });
            let message = || (key.clone(), payload.to_vec());
            match fate {
                Fate::Deliver => deliver(message()),
                Fate::Lose => (),
                Fate::Duplicate => {
                    deliver(message());
                    deliver(message());
                }
                Fate::Overtaken => listener.held = Some(message()),
            }
            if let Some(overtaken) = waiting {
                deliver(overtaken);
            }
        }
    }

    fn tell_watchers(&mut self, key: &keyexpr, event: fn(Arc<str>) -> Event) {
        for watcher in self.matching(Kind::Watch, key) {
            watcher.inbox.push(event(key.as_str().into()));
        }
    }

    fn end(&mut self, id: u64) {
        self.listeners.remove(&id);
        if let Some(Token { key, .. }) = self.tokens.remove(&id) {
            if !self.is_alive(&key) {
                self.tell_watchers(&key, |key| Event::Gone { key });
            }
        }
    }

    fn is_alive(&self, key: &keyexpr) -> bool {
        self.tokens.values().any(|token| &*token.key == key)
    }

    fn disconnect(&mut self, side: u64) {
        self.sides.remove(&side);
        self.listeners.retain(|_, listener| listener.side != side);
        let of_side = |(&id, token): (&u64, &Token)| (token.side == side).then_some(id);
        let tokens: Vec<_> = self.tokens.iter().filter_map(of_side).collect();
        tokens.into_iter().for_each(|id| self.end(id));
    }
}

struct MemoryBus {
    state: Arc<Mutex<State>>,
    side: u64,
    ledger: Arc<Ledger>,
}

impl MemoryBus {
    fn listen(&self, kind: Kind, key_expr: &str, inbox: Inbox) -> Result<Guard, Error> {
        let key_expr = key::expression(key_expr)?;
        let mut state = lock(&self.state);
        if kind == Kind::Watch {
            let matching = state.tokens.values().filter(|token| token.key.intersects(&key_expr));
            // A key that several sides announce is reported once.
            for key in matching.map(|token| token.key.as_str()).collect::<BTreeSet<_>>() {
                inbox.push(Event::Alive { key: key.into() });
            }
        }
        let id = state.new_id();
        let ledger = self.ledger.clone();
        state.listeners.insert(id, Listener { side: self.side, kind, key_expr, inbox, ledger, held: None });
        Ok(self.guard(id))
    }

    fn guard(&self, id: u64) -> Guard {
        Guard::new(Declared { state: self.state.clone(), id })
    }
}

impl Bus for MemoryBus {
    fn publisher(&self, key: &str) -> Result<Publisher, Error> {
        let key_expr = key::exact(key)?;
        let line = self.ledger.line(key.into());
        let (state, side) = (self.state.clone(), self.side);
        Ok(Publisher::new(move |payload| {
            let mut state = lock(&state);
            if !state.sides.contains(&side) {
                return Err(Error::Closed { key: line.key.to_string() });
            }
            state.publish(&key_expr, &line.key, payload);
            drop(state);
            line.sent(Sent::Publication, payload);
            Ok(())
        }))
    }

    /// The same as [`Bus::publisher`]: memory is never congested.
    fn best_effort_publisher(&self, key: &str) -> Result<Publisher, Error> {
        self.publisher(key)
    }

    fn subscribe(&self, key_expr: &str, inbox: Inbox) -> Result<Guard, Error> {
        let guard = self.listen(Kind::Subscription, key_expr, inbox)?;
        self.ledger.declared(Record::Subscribed { key: key_expr.into() });
        Ok(guard)
    }

    fn serve(&self, key_expr: &str, inbox: Inbox) -> Result<Guard, Error> {
        let guard = self.listen(Kind::Queryable, key_expr, inbox)?;
        self.ledger.declared(Record::Served { key: key_expr.into() });
        Ok(guard)
    }

    fn ask(&self, key: &str, payload: &[u8], timeout: Duration) -> Result<Option<Vec<u8>>, Error> {
        let key_expr = key::exact(key)?;
        let line = self.ledger.line(key.into());
        let (replies, reply) = mpsc::channel();
        for listener in lock(&self.state).matching(Kind::Queryable, &key_expr) {
            let ledger = listener.ledger.clone();
            listener.inbox.push(Event::Query(query(&line.key, payload, replies.clone(), ledger)));
        }
        line.sent(Sent::Query, payload);
        // From here on only the queries can send a reply: when all are dropped, the wait ends.
        drop(replies);
        Ok(reply.recv_timeout(timeout).ok())
    }

    fn announce(&self, key: &str) -> Result<Guard, Error> {
        let key_expr = key::exact(key)?;
        let mut state = lock(&self.state);
        let id = state.new_id();
        if !state.is_alive(&key_expr) {
            state.tell_watchers(&key_expr, |key| Event::Alive { key });
        }
        state.tokens.insert(id, Token { side: self.side, key: key_expr });
        drop(state);
        self.ledger.declared(Record::Announced { key: key.into() });
        Ok(self.guard(id))
    }

    fn watch(&self, key_expr: &str, inbox: Inbox) -> Result<Guard, Error> {
        let guard = self.listen(Kind::Watch, key_expr, inbox)?;
        self.ledger.declared(Record::Watched { key: key_expr.into() });
        Ok(guard)
    }

    fn endpoints(&self) -> Vec<String> {
        vec![]
    }

    fn ledger(&self) -> &Arc<Ledger> {
        &self.ledger
    }
}

impl Drop for MemoryBus {
    fn drop(&mut self) {
        lock(&self.state).disconnect(self.side);
    }
}

/// Ends a listener or a token when dropped.
struct Declared {
    state: Arc<Mutex<State>>,
    id: u64,
}

impl Drop for Declared {
    fn drop(&mut self) {
        lock(&self.state).end(self.id);
    }
}

fn query(key: &Arc<str>, payload: &[u8], replies: Sender<Vec<u8>>, answering: Arc<Ledger>) -> Query {
    let of_reply = key.clone();
    Query::new(key.clone(), payload.to_vec(), move |payload| {
        if replies.send(payload.to_vec()).is_ok() {
            answering.line(of_reply).sent(Sent::Reply, payload);
        }
    })
}
