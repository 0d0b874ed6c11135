//! One suite for both buses, then tests of what only the zenoh bus or only the in-memory bus guarantees.

mod memory;
mod outsiders;
mod star;
mod support;

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bus::{Events, Record, Traffic};
use support::{alive, assert_silent, gone, message, next, next_query, Pair, DEADLINE};

#[test]
fn memory_keeps_the_promises_of_the_bus() {
    bus_suite(&support::in_memory);
}

#[test]
fn zenoh_over_unix_sockets_keeps_the_promises_of_the_bus() {
    bus_suite(&|| support::over_unix_socket(false));
}

#[test]
fn zenoh_over_unix_sockets_with_low_latency_keeps_the_promises_of_the_bus() {
    bus_suite(&|| support::over_unix_socket(true));
}

#[test]
fn zenoh_over_tcp_keeps_the_promises_of_the_bus() {
    bus_suite(&|| support::over_tcp(false));
}

#[test]
fn zenoh_over_tcp_with_low_latency_keeps_the_promises_of_the_bus() {
    bus_suite(&|| support::over_tcp(true));
}

fn bus_suite(make: &dyn Fn() -> Pair) {
    publications_arrive_whole_and_in_order(&make());
    every_subscriber_hears_and_a_dropped_one_does_not(&make());
    wildcards_hear_what_matches(&make());
    a_side_hears_itself(&make());
    a_query_is_answered_at_once_or_later_from_another_thread(&make());
    a_query_without_an_answer_ends(&make());
    tokens_come_and_go(&make());
    a_side_that_is_dropped_takes_its_tokens_along(make());
    a_publisher_of_a_dropped_side_says_closed(make());
    traffic_counts_what_a_side_sent(&make());
    a_recorded_side_reports_what_it_sends_and_declares(&make());
    keys_are_checked(&make());
}

fn publications_arrive_whole_and_in_order(pair: &Pair) {
    let (inbox, events) = bus::inbox();
    let _guard = pair.server.subscribe("t/data", inbox).unwrap();
    pair.settle();
    let publisher = pair.client.publisher("t/data").unwrap();
    // 0 to 20 KB; the content differs even where lengths are equal.
    let payload = |i: usize| (0..i * 7919 % 20_001).map(|j| (i + j) as u8).collect::<Vec<_>>();
    for i in 0..1_000 {
        publisher.send(&payload(i)).unwrap();
    }
    let mut first_key = None;
    for i in 0..1_000 {
        let (key, received) = message(next(&events));
        assert_eq!(&*key, "t/data");
        assert!(received == payload(i), "message {i} has {} bytes", received.len());
        let first = first_key.get_or_insert_with(|| key.clone());
        assert!(Arc::ptr_eq(first, &key), "an exact key is shared, not copied");
    }
}

fn every_subscriber_hears_and_a_dropped_one_does_not(pair: &Pair) {
    let (inbox, first) = bus::inbox();
    let first_guard = pair.server.subscribe("t/data", inbox).unwrap();
    let (inbox, second) = bus::inbox();
    let _second_guard = pair.server.subscribe("t/data", inbox).unwrap();
    pair.settle();
    let publisher = pair.client.publisher("t/data").unwrap();
    publisher.send(b"both").unwrap();
    assert_eq!(message(next(&first)).1, b"both");
    assert_eq!(message(next(&second)).1, b"both");
    drop(first_guard);
    publisher.send(b"one").unwrap();
    assert_eq!(message(next(&second)).1, b"one");
    assert_silent(&first);
}

fn wildcards_hear_what_matches(pair: &Pair) {
    let (inbox, one_chunk) = bus::inbox();
    let _one = pair.server.subscribe("t/*/act", inbox).unwrap();
    let (inbox, any) = bus::inbox();
    let _any = pair.server.subscribe("t/**", inbox).unwrap();
    pair.settle();
    for key in ["t/0/act", "t/1/see", "t/2/3/act", "u/0/act", "t/4/act"] {
        pair.client.publisher(key).unwrap().send(key.as_bytes()).unwrap();
    }
    let keys = |events: &Events, n: usize| -> Vec<String> {
        (0..n).map(|_| message(next(events)).0.to_string()).collect()
    };
    assert_eq!(keys(&one_chunk, 2), ["t/0/act", "t/4/act"]);
    assert_eq!(keys(&any, 4), ["t/0/act", "t/1/see", "t/2/3/act", "t/4/act"]);
    assert_silent(&one_chunk);
    assert_silent(&any);
}

fn a_side_hears_itself(pair: &Pair) {
    let (inbox, events) = bus::inbox();
    let _subscription = pair.client.subscribe("t/own", inbox.clone()).unwrap();
    pair.client.best_effort_publisher("t/own").unwrap().send(b"me").unwrap();
    assert_eq!(message(next(&events)).1, b"me");
    let _watch = pair.client.watch("t/alive/*", inbox).unwrap();
    let _token = pair.client.announce("t/alive/me").unwrap();
    assert_eq!(alive(next(&events)), "t/alive/me");
}

fn a_query_is_answered_at_once_or_later_from_another_thread(pair: &Pair) {
    let (inbox, events) = bus::inbox();
    let _guard = pair.server.serve("t/ask/*", inbox).unwrap();
    pair.settle();
    std::thread::scope(|scope| {
        let client = &pair.client;
        let first = scope.spawn(move || client.ask("t/ask/1", b"first", DEADLINE).unwrap());
        let held = next_query(&events);
        assert_eq!((&*held.key, &held.payload[..]), ("t/ask/1", &b"first"[..]));
        // While the first is held, the second is answered.
        let second = scope.spawn(move || client.ask("t/ask/2", b"", DEADLINE).unwrap());
        let query = next_query(&events);
        assert_eq!((&*query.key, &query.payload[..]), ("t/ask/2", &b""[..]));
        query.reply(b"");
        assert_eq!(second.join().unwrap().unwrap(), b"");
        assert!(!first.is_finished());
        scope.spawn(move || held.reply(&[7; 20_000]));
        assert_eq!(first.join().unwrap().unwrap(), [7; 20_000]);
    });
}

fn a_query_without_an_answer_ends(pair: &Pair) {
    let start = Instant::now();
    assert_eq!(pair.client.ask("t/nobody", b"?", DEADLINE).unwrap(), None);
    assert!(start.elapsed() < DEADLINE / 2, "nobody serves the key, which is known at once");

    let (inbox, events) = bus::inbox();
    let _guard = pair.server.serve("t/silent", inbox).unwrap();
    pair.settle();
    std::thread::scope(|scope| {
        let asked = scope.spawn(|| pair.client.ask("t/silent", b"?", DEADLINE).unwrap());
        drop(next_query(&events));
        assert_eq!(asked.join().unwrap(), None);
    });
    assert!(start.elapsed() < DEADLINE / 2, "a dropped query is an answer");

    let (start, timeout) = (Instant::now(), Duration::from_millis(100));
    assert_eq!(pair.client.ask("t/silent", b"?", timeout).unwrap(), None);
    assert!(start.elapsed() >= timeout);
    next_query(&events).reply(b"too late, and no harm done");
    assert_eq!(pair.client.ask("t/nobody", b"?", Duration::MAX).unwrap(), None);
}

fn tokens_come_and_go(pair: &Pair) {
    let early = pair.client.announce("t/alive/early").unwrap();
    pair.settle();
    let (inbox, events) = bus::inbox();
    let watch = pair.server.watch("t/alive/*", inbox).unwrap();
    assert_eq!(alive(next(&events)), "t/alive/early");
    let late = pair.client.announce("t/alive/late").unwrap();
    assert_eq!(alive(next(&events)), "t/alive/late");
    let _unseen = pair.client.announce("t/dead/unseen").unwrap();
    drop(early);
    assert_eq!(gone(next(&events)), "t/alive/early");
    drop(late);
    assert_eq!(gone(next(&events)), "t/alive/late");
    drop(watch);
    assert_silent(&events);
}

fn a_side_that_is_dropped_takes_its_tokens_along(pair: Pair) {
    let (inbox, events) = bus::inbox();
    let _watch = pair.server.watch("t/alive/*", inbox).unwrap();
    let token = pair.client.announce("t/alive/client").unwrap();
    assert_eq!(alive(next(&events)), "t/alive/client");
    drop(pair.client);
    assert_eq!(gone(next(&events)), "t/alive/client");
    drop(token);
    assert_silent(&events);
}

fn a_publisher_of_a_dropped_side_says_closed(pair: Pair) {
    let publisher = pair.client.publisher("t/data").unwrap();
    publisher.send(b"open").unwrap();
    drop(pair.client);
    assert_eq!(publisher.send(b"closed"), Err(bus::Error::Closed { key: "t/data".into() }));
}

fn traffic_counts_what_a_side_sent(pair: &Pair) {
    let (inbox, events) = bus::inbox();
    let _guard = pair.server.serve("t/ask", inbox).unwrap();
    pair.settle();
    let traffic = |key: &str, messages, bytes| Traffic { key: key.into(), messages, bytes };
    assert_eq!(pair.client.traffic(), []);
    let (z, a) = (pair.client.publisher("t/z").unwrap(), pair.client.best_effort_publisher("t/a").unwrap());
    z.send(&[0; 10]).unwrap();
    z.send(&[0; 5]).unwrap();
    a.send(&[]).unwrap();
    pair.client.publisher("t/z").unwrap().send(&[0; 1]).unwrap();
    let _unused = pair.client.publisher("t/unused").unwrap();
    std::thread::scope(|scope| {
        let asked = scope.spawn(|| pair.client.ask("t/ask", b"abc", DEADLINE).unwrap());
        next_query(&events).reply(b"abcdefg");
        assert_eq!(asked.join().unwrap().unwrap(), b"abcdefg");
    });
    assert_eq!(pair.client.traffic(), [traffic("t/a", 1, 0), traffic("t/ask", 1, 3), traffic("t/z", 3, 16)]);
    assert_eq!(pair.server.traffic(), [traffic("t/ask", 1, 7)]);
}

fn a_recorded_side_reports_what_it_sends_and_declares(pair: &Pair) {
    let records = Arc::new(Mutex::new(vec![]));
    let written = records.clone();
    let earlier = pair.server.publisher("t/data").unwrap();
    earlier.send(b"unseen").unwrap();
    let server =
        bus::recorded(pair.server.clone(), Arc::new(move |record| written.lock().unwrap().push(record)));
    let (inbox, events) = bus::inbox();
    let _subscription = server.subscribe("t/in/*", inbox.clone()).unwrap();
    let _watch = server.watch("t/alive/**", inbox.clone()).unwrap();
    let _queryable = server.serve("t/ask", inbox).unwrap();
    pair.settle();
    let _token = server.announce("t/here").unwrap();
    earlier.send(b"seen").unwrap();
    assert_eq!(server.ask("t/nobody", b"?", DEADLINE).unwrap(), None);
    std::thread::scope(|scope| {
        scope.spawn(|| pair.client.ask("t/ask", b"how", DEADLINE).unwrap());
        next_query(&events).reply(b"so");
    });
    let key = Arc::from;
    let expected = [
        Record::Subscribed { key: key("t/in/*") },
        Record::Watched { key: key("t/alive/**") },
        Record::Served { key: key("t/ask") },
        Record::Announced { key: key("t/here") },
        Record::Published { key: key("t/data"), payload: b"seen".to_vec() },
        Record::Asked { key: key("t/nobody"), payload: b"?".to_vec() },
        Record::Replied { key: key("t/ask"), payload: b"so".to_vec() },
    ];
    let is_of_test = |record: &&Record| !support::is_of_settling(record);
    let records = records.lock().unwrap();
    assert_eq!(records.iter().filter(is_of_test).collect::<Vec<_>>(), expected.iter().collect::<Vec<_>>());
}

fn keys_are_checked(pair: &Pair) {
    let (inbox, _events) = bus::inbox();
    for bus in [&pair.server, &pair.client] {
        let errors = [
            bus.publisher("t/*").err(),
            bus.best_effort_publisher("t//a").err(),
            bus.subscribe("/t", inbox.clone()).err(),
            bus.serve("t/", inbox.clone()).err(),
            bus.watch("t/$*", inbox.clone()).err(),
            bus.announce("t/**").err(),
            bus.ask("t/*", b"", DEADLINE).err(),
        ];
        for error in errors {
            assert!(matches!(error, Some(bus::Error::Key { .. })), "{error:?}");
        }
    }
    let error = pair.client.publisher("t/*").err().unwrap();
    assert_eq!(
        error.to_string(),
        "`t/*` is not a key such as `run/agent/0/act`: `*` is allowed in key expressions only"
    );
}
