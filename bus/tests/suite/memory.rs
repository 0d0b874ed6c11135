//! What only the in-memory bus guarantees: seeded faults, the same in every run.

use bus::{Event, MemoryHub};

use crate::support::{a_token_of_two_sides_lives_as_long_as_either, alive, message, next};

/// Publishes 0 to `n` and returns what arrives.
fn received(hub: &MemoryHub, n: u8) -> Vec<u8> {
    let (server, client) = (hub.connect(), hub.connect());
    let (inbox, events) = bus::inbox();
    let guard = server.subscribe("t/data", inbox).unwrap();
    let publisher = client.publisher("t/data").unwrap();
    for i in 0..n {
        publisher.send(&[i]).unwrap();
    }
    drop((guard, server));
    std::iter::from_fn(|| events.try_recv().ok()).map(|event| message(event).1[0]).collect()
}

#[test]
fn a_token_of_two_sides_lives_as_long_as_either_in_memory() {
    let hub = bus::memory();
    a_token_of_two_sides_lives_as_long_as_either(&hub.connect(), &hub.connect(), &hub.connect());
}

#[test]
fn without_faults_everything_arrives_before_send_returns() {
    assert_eq!(received(&bus::memory(), 200), (0..200).collect::<Vec<_>>());
}

#[test]
fn certain_faults_do_what_they_say() {
    assert!(received(&MemoryHub::with_faults(1, 1.0, 0.0, 0.0), 5).is_empty());
    assert_eq!(received(&MemoryHub::with_faults(1, 0.0, 1.0, 0.0), 3), [0, 0, 1, 1, 2, 2]);
    // Each is delivered after its successor; the last one has none.
    assert_eq!(received(&MemoryHub::with_faults(1, 0.0, 0.0, 1.0), 4), [0, 1, 2]);
}

#[test]
fn a_publication_that_is_overtaken_comes_right_after_the_next() {
    let arrived = received(&MemoryHub::with_faults(3, 0.0, 0.0, 0.3), 200);
    let mut sorted = arrived.clone();
    sorted.sort_unstable();
    assert_eq!(sorted[..199], (0..199).collect::<Vec<_>>()[..], "none is lost, save perhaps the last");
    assert_ne!(arrived, sorted, "some are overtaken");
    for (place, &i) in arrived.iter().enumerate() {
        assert!(place.abs_diff(usize::from(i)) <= 2, "{i} arrived as number {place}");
    }
}

#[test]
fn the_same_seed_gives_the_same_faults_and_another_gives_others() {
    let of_seed = |seed| received(&MemoryHub::with_faults(seed, 0.1, 0.1, 0.1), 250);
    assert_eq!(of_seed(1), of_seed(1));
    assert_ne!(of_seed(1), of_seed(2));
}

#[test]
fn faults_leave_queries_and_tokens_alone() {
    let hub = MemoryHub::with_faults(1, 1.0, 0.0, 0.0);
    let (server, client) = (hub.connect(), hub.connect());
    let (inbox, events) = bus::inbox();
    let _watch = server.watch("t/alive/*", inbox.clone()).unwrap();
    let _token = client.announce("t/alive/0").unwrap();
    assert_eq!(alive(next(&events)), "t/alive/0");
    let _queryable = server.serve("t/ask", inbox).unwrap();
    std::thread::scope(|scope| {
        let asked = scope.spawn(|| client.ask("t/ask", b"", crate::support::DEADLINE).unwrap());
        match next(&events) {
            Event::Query(query) => query.reply(b"yes"),
            other => panic!("a query was expected, {other:?} came"),
        }
        assert_eq!(asked.join().unwrap().unwrap(), b"yes");
    });
}
