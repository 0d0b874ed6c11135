//! What only the zenoh bus guarantees: the star of peers, its endpoints and its errors.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bus::{Bus, Error, Options};

use crate::support::{
    a_token_of_two_sides_lives_as_long_as_either, alive, assert_silent, eventually, gone, message, next,
    open, over_unix_socket, settle, socket_in, try_open, DEADLINE,
};

#[test]
fn a_dialling_side_hears_the_listening_side_and_no_other_dialling_side() {
    let hub = open(&Options { listen: vec!["tcp/127.0.0.1:0".into()], ..Options::default() });
    let dial = || open(&Options { connect: hub.endpoints(), ..Options::default() });
    let (left, right) = (dial(), dial());
    let (inbox, at_hub) = bus::inbox();
    let _hub = hub.subscribe("t/**", inbox.clone()).unwrap();
    let _hub_watch = hub.watch("t/**", inbox).unwrap();
    let (inbox, at_right) = bus::inbox();
    let _right = right.subscribe("t/**", inbox.clone()).unwrap();
    let _right_watch = right.watch("t/**", inbox).unwrap();
    settle(&right, &hub);
    settle(&hub, &left);

    let _token = left.announce("t/left").unwrap();
    assert_eq!(alive(next(&at_hub)), "t/left");
    left.publisher("t/data").unwrap().send(b"from left").unwrap();
    assert_eq!(message(next(&at_hub)).1, b"from left");
    // A message that the hub had forwarded would arrive before this one.
    hub.publisher("t/data").unwrap().send(b"from hub").unwrap();
    assert_eq!(message(next(&at_right)).1, b"from hub");
    assert_silent(&at_right);
}

#[test]
fn a_token_of_two_dialling_sides_lives_as_long_as_either() {
    let hub = open(&Options { listen: vec!["tcp/127.0.0.1:0".into()], ..Options::default() });
    let dial = || open(&Options { connect: hub.endpoints(), ..Options::default() });
    a_token_of_two_sides_lives_as_long_as_either(&hub, &dial(), &dial());
}

#[test]
fn what_is_sent_right_after_open_reaches_all_who_were_dialled() {
    let listen = || open(&Options { listen: vec!["tcp/127.0.0.1:0".into()], ..Options::default() });
    let hubs = [listen(), listen()];
    let (inbox, events) = bus::inbox();
    // Many, so that sending the declarations takes longer than opening.
    let subscribe = |hub: &Arc<dyn Bus>| -> Vec<_> {
        let others = (0..300).map(|i| format!("t/other/{i}"));
        let keys = others.chain(["t/data".into()]);
        keys.map(|key| hub.subscribe(&key, inbox.clone()).unwrap()).collect()
    };
    let _guards = hubs.each_ref().map(subscribe);
    let connect: Vec<_> = hubs.iter().flat_map(|hub| hub.endpoints()).collect();
    for i in 0..20 {
        let client = open(&Options { connect: connect.clone(), ..Options::default() });
        client.publisher("t/data").unwrap().send(&[i]).unwrap();
        assert_eq!(message(next(&events)).1, [i]);
        assert_eq!(message(next(&events)).1, [i]);
    }
}

#[test]
fn a_side_that_dials_first_waits_for_the_one_that_listens() {
    let folder = tempfile::tempdir().unwrap();
    let endpoint = socket_in(&folder);
    std::thread::scope(|scope| {
        let connect = vec![endpoint.clone()];
        let client =
            scope.spawn(move || open(&Options { connect, connect_timeout: DEADLINE, ..Options::default() }));
        let server = open(&Options { listen: vec![endpoint.clone()], ..Options::default() });
        let client = client.join().unwrap();
        settle(&client, &server);
    });
}

#[test]
fn a_lost_link_is_dialled_again() {
    let folder = tempfile::tempdir().unwrap();
    let endpoint = socket_in(&folder);
    let listen = || open(&Options { listen: vec![endpoint.clone()], ..Options::default() });
    let server = listen();
    let client = open(&Options { connect: vec![endpoint.clone()], ..Options::default() });
    let (inbox, events) = bus::inbox();
    let _watch = client.watch("t/server", inbox.clone()).unwrap();
    let _subscription = client.subscribe("t/data", inbox).unwrap();
    let token = server.announce("t/server").unwrap();
    assert_eq!(alive(next(&events)), "t/server");
    drop((token, server));
    assert_eq!(gone(next(&events)), "t/server");

    let server = listen();
    let _token = server.announce("t/server").unwrap();
    assert_eq!(alive(next(&events)), "t/server");
    settle(&client, &server);
    server.publisher("t/data").unwrap().send(b"again").unwrap();
    assert_eq!(message(next(&events)).1, b"again");
}

#[test]
fn an_optional_endpoint_may_appear_later_or_never() {
    let folder = tempfile::tempdir().unwrap();
    let monitor = socket_in(&folder);
    let hub = open(&Options { listen: vec!["tcp/127.0.0.1:0".into()], ..Options::default() });
    let start = Instant::now();
    let client = open(&Options {
        connect: hub.endpoints(),
        optional_connect: vec![monitor.clone(), "tcp/127.0.0.1:1".into()],
        connect_timeout: DEADLINE,
        ..Options::default()
    });
    assert!(start.elapsed() < DEADLINE / 2);
    let (inbox, events) = bus::inbox();
    let monitor = open(&Options { listen: vec![monitor], ..Options::default() });
    let _guard = monitor.subscribe("t/loss", inbox).unwrap();
    let loss = client.best_effort_publisher("t/loss").unwrap();
    let first = eventually("a metric reaches the monitor", || {
        loss.send(b"0.5").unwrap();
        events.recv_timeout(Duration::from_millis(10)).ok()
    });
    assert_eq!(message(first).1, b"0.5");
}

#[test]
fn a_low_latency_side_and_one_that_is_not_understand_each_other() {
    for low_latency in [true, false] {
        let hub =
            open(&Options { listen: vec!["tcp/127.0.0.1:0".into()], low_latency, ..Options::default() });
        let client =
            open(&Options { connect: hub.endpoints(), low_latency: !low_latency, ..Options::default() });
        let (inbox, events) = bus::inbox();
        let _guard = client.subscribe("t/data", inbox).unwrap();
        settle(&client, &hub);
        hub.publisher("t/data").unwrap().send(&[1; 20_000]).unwrap();
        assert_eq!(message(next(&events)).1, [1; 20_000]);
    }
}

#[test]
fn messages_beyond_the_low_latency_limit_are_refused_and_those_at_the_limit_arrive() {
    let limit = bus::LOW_LATENCY_MAX_BYTES;
    let pair = over_unix_socket(true);
    let (inbox, events) = bus::inbox();
    let _subscription = pair.server.subscribe("t/data", inbox.clone()).unwrap();
    let _queryable = pair.server.serve("t/ask", inbox).unwrap();
    pair.settle();
    let publisher = pair.client.publisher("t/data").unwrap();
    let too_large = |key: &str| Error::TooLarge { key: key.into(), bytes: limit + 1, limit };
    assert_eq!(publisher.send(&vec![1; limit + 1]), Err(too_large("t/data")));
    assert_eq!(pair.client.ask("t/ask", &vec![1; limit + 1], DEADLINE), Err(too_large("t/ask")));
    publisher.send(&vec![2; limit]).unwrap();
    assert_eq!(message(next(&events)).1, vec![2; limit]);
    assert_eq!(pair.client.traffic().len(), 1);
}

#[test]
fn large_messages_pass_without_low_latency() {
    let pair = over_unix_socket(false);
    let (inbox, events) = bus::inbox();
    let _subscription = pair.server.subscribe("t/data", inbox).unwrap();
    pair.settle();
    pair.client.publisher("t/data").unwrap().send(&vec![3; 1_000_000]).unwrap();
    assert_eq!(message(next(&events)).1, vec![3; 1_000_000]);
}

#[test]
fn an_endpoint_in_use_is_named_with_a_hint() {
    let folder = tempfile::tempdir().unwrap();
    let listen = vec![socket_in(&folder), "tcp/127.0.0.1:0".into()];
    let first = open(&Options { listen, ..Options::default() });
    let endpoints = first.endpoints();
    for (endpoint, hint) in endpoints.iter().zip([
        "another process of this run is alive; stop it, or choose another run folder",
        "stop the process that listens there, choose another port, or port 0 for a free one",
    ]) {
        let error =
            try_open(&Options { listen: vec![endpoint.clone()], ..Options::default() }).err().unwrap();
        assert_eq!(error, Error::InUse { endpoint: endpoint.clone(), hint });
        assert_eq!(error.to_string(), format!("cannot listen on `{endpoint}`: it is in use; hint: {hint}"));
    }
    // The first side still works, and the socket file that it leaves does not prevent a successor.
    for endpoint in &endpoints {
        let client = open(&Options { connect: vec![endpoint.clone()], ..Options::default() });
        settle(&client, &first);
    }
    drop(first);
    open(&Options { listen: endpoints, ..Options::default() });
}

#[test]
fn a_socket_file_left_by_a_killed_process_is_taken_over() {
    let folder = tempfile::tempdir().unwrap();
    let endpoint = socket_in(&folder);
    drop(std::os::unix::net::UnixListener::bind(folder.path().join("bus.sock")).unwrap());
    assert!(folder.path().join("bus.sock").exists());
    let server = open(&Options { listen: vec![endpoint.clone()], ..Options::default() });
    let client = open(&Options { connect: vec![endpoint], ..Options::default() });
    settle(&client, &server);
}

#[test]
fn a_folder_that_does_not_exist_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let endpoint = format!("unixsock-stream/{}", folder.path().join("missing/bus.sock").display());
    let error = try_open(&Options { listen: vec![endpoint.clone()], ..Options::default() }).err().unwrap();
    match &error {
        Error::Listen { endpoint: named, reason, .. } => {
            assert_eq!((named, reason.as_str()), (&endpoint, "No such file or directory (os error 2)"));
        }
        other => panic!("{other}"),
    }
    assert!(error.to_string().contains("`--transport tcp`"), "{error}");
}

#[test]
fn an_unreachable_endpoint_is_named_with_the_time_waited() {
    let folder = tempfile::tempdir().unwrap();
    let absent = socket_in(&folder);
    let hub = open(&Options { listen: vec!["tcp/127.0.0.1:0".into()], ..Options::default() });
    let timeout = Duration::from_millis(200);
    let connect = [hub.endpoints(), vec![absent.clone()]].concat();
    let options = Options { connect, connect_timeout: timeout, ..Options::default() };
    match try_open(&options).err().unwrap() {
        Error::Unreachable { endpoints, waited } => {
            assert_eq!(endpoints, [absent], "the hub is there and is not blamed");
            assert!(waited >= timeout && waited < DEADLINE / 2, "{waited:?}");
        }
        other => panic!("{other}"),
    }
}

#[test]
fn a_listener_that_does_not_speak_zenoh_is_unreachable() {
    let stranger = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp/{}", stranger.local_addr().unwrap());
    let connect_timeout = Duration::from_millis(200);
    let error = try_open(&Options { connect: vec![endpoint.clone()], connect_timeout, ..Options::default() });
    match error.err().unwrap() {
        Error::Unreachable { endpoints, .. } => assert_eq!(endpoints, [endpoint]),
        other => panic!("{other}"),
    }
}

#[test]
fn what_is_no_endpoint_is_refused_wherever_it_is_given() {
    let bad = || vec!["tcp/localhost".to_string()];
    for options in [
        Options { listen: bad(), ..Options::default() },
        Options { connect: bad(), ..Options::default() },
        Options { optional_connect: bad(), ..Options::default() },
    ] {
        assert_eq!(
            try_open(&options).err().unwrap().to_string(),
            "`tcp/localhost` is not an endpoint: the port is missing; write `unixsock-stream/PATH` or \
             `tcp/HOST:PORT`"
        );
    }
}
