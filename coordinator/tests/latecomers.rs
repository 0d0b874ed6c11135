//! An agent that joins after the others receives the schedule.

use std::thread;
use std::time::Duration;

use bus::{Event, Events};
use process::Role;
use proto::codec::decode;
use proto::config::AlgoName;
use proto::control::Rates;
use proto::keys::Keys;
use proto::presets::{config, Family};
use store::RunFolder;

const DEADLINE: Duration = Duration::from_secs(20);

/// The first schedule that arrives.
fn told(events: &Events) -> Rates {
    match events.recv_timeout(DEADLINE) {
        Ok(Event::Message { payload, .. }) => decode(&payload).expect("a schedule"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_agent_that_comes_after_the_schedule_was_published_hears_it_too() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = config("run", "any", 2, AlgoName::Mtppo, Family::Lbf);
    let keys = Keys::new("run").expect("a good name");
    let run = RunFolder::create(folder.path().join("run"), &config.to_toml()).expect("a new folder");
    let hub = bus::memory();
    let agents = [hub.connect(), hub.connect()];

    let role = Role::new(hub.connect(), config, run.role("coordinator").expect("a role"), DEADLINE);
    let role = role.expect("a good name");
    let stop = role.inbox.clone();
    let coordinator = thread::spawn(move || coordinator::run(role));
    let mut guards = Vec::new();
    for (id, agent) in (0..).zip(&agents) {
        let (inbox, events) = bus::inbox();
        guards.push(agent.subscribe(&keys.schedule(), inbox).expect("a subscription"));
        guards.push(agent.announce(&keys.alive_agent(id)).expect("a token"));
        // The second agent joins after the first has received the schedule.
        assert_eq!(told(&events).from, 0, "agent {id}");
    }
    stop.send(Event::Stop).expect("it listens");
    coordinator.join().expect("it does not panic").expect("it leaves well");
}
