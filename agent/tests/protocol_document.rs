//! What the agent sends is what `docs/protocol.md` shows, byte for byte.

use std::thread;
use std::time::Duration;

use agent::{Left, Machine};
use algos::device::DeviceName;
use bus::{Event, Events};
use process::Role;
use proto::config::AlgoName;
use proto::keys::Keys;
use proto::presets::{config, Family};
use proto::Mode;
use store::RunFolder;
use vectors::vectors;

#[path = "../../proto/tests/vectors/mod.rs"]
mod vectors;

const DEADLINE: Duration = Duration::from_secs(20);

/// The next event.
fn next(events: &Events) -> Event {
    events.recv_timeout(DEADLINE).expect("it comes in time")
}

#[test]
fn the_request_to_join_and_the_last_answer_are_those_of_the_page() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut config = config("run", "any", 3, AlgoName::Ippo, Family::Lbf);
    config.algo.hidden = 8;
    let keys = Keys::new("run").expect("a good name");
    let run = RunFolder::create(folder.path().join("run"), &config.to_toml()).expect("a new folder");
    let hub = bus::memory();
    let digest = config.digest();

    // The env-server's side, by hand.
    let world = hub.connect();
    let (inbox, events) = bus::inbox();
    let _served = world.serve(&keys.any_join(), inbox.clone()).expect("served");
    let _answers = world.subscribe(&keys.act(1), inbox.clone()).expect("a subscription");
    let _tokens = world.watch(&keys.alive_agent(1), inbox).expect("a watch");
    let observe = world.publisher(&keys.observe(1)).expect("a publisher");

    let role = Role::new(hub.connect(), config, run.role("agent-1").expect("a role"), DEADLINE);
    let role = role.expect("a good name");
    let machine = Machine { device: DeviceName::Cpu, threads: 1 };
    let agent = thread::spawn(move || agent::run(role, 1, machine));

    let Event::Query(query) = next(&events) else { panic!("a request to join") };
    assert_eq!(*query.key, keys.join(1));
    // Frame, digest, nonce as a long number, no checkpoint.
    let page = &vectors()["join"];
    assert_eq!((&query.payload[..2], &query.payload[2..34]), (&page[..2], &digest[..]));
    assert_eq!((query.payload[34], query.payload.len()), (page[34], 44), "nearly every nonce is long");
    assert_eq!(query.payload[43], 0);

    // The page's seat, without a checkpoint: epoch 1, round 0, no steps.
    let seat = [&vectors()["welcome-seat"][..3], &[1, 0, 0], &vectors()["welcome-seat"][12..]].concat();
    query.reply(&seat);
    assert!(matches!(next(&events), Event::Alive { .. }), "the token");

    // The page closes the run: at any point of the epoch.
    observe.send(&vectors()["observe-finished"]).expect("it is there");
    let Event::Message { payload, .. } = next(&events) else { panic!("an answer") };
    assert_eq!(payload, vectors()["act-without-actions"]);
    assert_eq!(agent.join().expect("it does not panic").expect("it leaves well"), Left::Finished);
    assert_eq!(vectors()["observe-finished"][2], Mode::Finished as u8);
}
