//! Pairs of buses to test on, and events with deadlines.

use std::sync::mpsc::TryRecvError;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use bus::{Bus, Event, Events, Options, Query, Record};
use tempfile::TempDir;

/// Far longer than anything takes on a busy machine; a test that waits this long has failed.
pub const DEADLINE: Duration = Duration::from_secs(20);

/// Two connected sides.
pub struct Pair {
    /// The side that listens.
    pub server: Arc<dyn Bus>,
    /// The side that dials.
    pub client: Arc<dyn Bus>,
    /// Holds the socket.
    _folder: Option<TempDir>,
}

const SETTLING: &str = "settling";

impl Pair {
    /// Returns when each side has received all declarations of the other so far. Declarations and tokens travel in
    /// order, so a token that was announced last is seen last.
    pub fn settle(&self) {
        settle(&self.server, &self.client);
        settle(&self.client, &self.server);
    }
}

/// Returns when `to` has received all declarations of `from` so far.
pub fn settle(from: &Arc<dyn Bus>, to: &Arc<dyn Bus>) {
    let (inbox, events) = bus::inbox();
    let _watch = to.watch(SETTLING, inbox).unwrap();
    let token = from.announce(SETTLING).unwrap();
    assert_eq!(alive(next(&events)), SETTLING);
    drop(token);
    assert_eq!(gone(next(&events)), SETTLING);
}

/// A restarted process may announce its token before that of its predecessor is gone.
pub fn a_token_of_two_sides_lives_as_long_as_either(
    hub: &Arc<dyn Bus>,
    left: &Arc<dyn Bus>,
    right: &Arc<dyn Bus>,
) {
    let (inbox, events) = bus::inbox();
    let _watch = hub.watch("t/alive/*", inbox).unwrap();
    let first = left.announce("t/alive/both").unwrap();
    assert_eq!(alive(next(&events)), "t/alive/both");
    let second = right.announce("t/alive/both").unwrap();
    settle(right, hub);
    let (inbox, late) = bus::inbox();
    let _late_watch = hub.watch("t/alive/*", inbox).unwrap();
    assert_eq!(alive(next(&late)), "t/alive/both");
    drop(first);
    settle(left, hub);
    drop(second);
    for events in [events, late] {
        assert_eq!(gone(next(&events)), "t/alive/both");
        assert_silent(&events);
    }
}

/// Whether a record comes from [`settle`].
pub fn is_of_settling(record: &Record) -> bool {
    matches!(record, Record::Announced { key } | Record::Watched { key } if &**key == SETTLING)
}

pub fn in_memory() -> Pair {
    let hub = bus::memory();
    Pair { server: hub.connect(), client: hub.connect(), _folder: None }
}

pub fn over_unix_socket(low_latency: bool) -> Pair {
    let folder = tempfile::tempdir().unwrap();
    let endpoint = socket_in(&folder);
    let server = open(&Options { listen: vec![endpoint.clone()], low_latency, ..Options::default() });
    assert_eq!(server.endpoints(), std::slice::from_ref(&endpoint));
    let client = open(&Options { connect: vec![endpoint], low_latency, ..Options::default() });
    Pair { server, client, _folder: Some(folder) }
}

pub fn over_tcp(low_latency: bool) -> Pair {
    let server = open(&Options { listen: vec!["tcp/127.0.0.1:0".into()], low_latency, ..Options::default() });
    let client = open(&Options { connect: server.endpoints(), low_latency, ..Options::default() });
    assert_eq!(client.endpoints(), Vec::<String>::new());
    Pair { server, client, _folder: None }
}

pub fn socket_in(folder: &TempDir) -> String {
    format!("unixsock-stream/{}", folder.path().join("bus.sock").display())
}

pub fn open(options: &Options) -> Arc<dyn Bus> {
    try_open(options).unwrap()
}

pub fn try_open(options: &Options) -> Result<Arc<dyn Bus>, bus::Error> {
    static RUNTIME: OnceLock<()> = OnceLock::new();
    RUNTIME.get_or_init(bus::use_one_runtime);
    bus::open(options)
}

pub fn next(events: &Events) -> Event {
    events.recv_timeout(DEADLINE).expect("an event before the deadline")
}

pub fn message(event: Event) -> (Arc<str>, Vec<u8>) {
    match event {
        Event::Message { key, payload } => (key, payload),
        other => panic!("a message was expected, {other:?} came"),
    }
}

pub fn alive(event: Event) -> String {
    match event {
        Event::Alive { key } => key.to_string(),
        other => panic!("a token was expected, {other:?} came"),
    }
}

pub fn gone(event: Event) -> String {
    match event {
        Event::Gone { key } => key.to_string(),
        other => panic!("the end of a token was expected, {other:?} came"),
    }
}

pub fn next_query(events: &Events) -> Query {
    match next(events) {
        Event::Query(query) => query,
        other => panic!("a query was expected, {other:?} came"),
    }
}

/// Asserts that nothing has arrived. Only meaningful after an event that was sent later.
pub fn assert_silent(events: &Events) {
    match events.try_recv() {
        Err(TryRecvError::Empty | TryRecvError::Disconnected) => (),
        Ok(event) => panic!("nothing was expected, {event:?} came"),
    }
}

/// Tries until it succeeds or the deadline passes.
pub fn eventually<T>(what: &str, mut attempt: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(done) = attempt() {
            return done;
        }
        assert!(start.elapsed() < DEADLINE, "{what} within {DEADLINE:?}");
        std::thread::yield_now();
    }
}
