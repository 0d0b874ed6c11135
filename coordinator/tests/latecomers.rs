//! An agent that joins after the others receives the schedule, and the end of a coordinator says how its run ended.

use std::thread;
use std::time::Duration;

use bus::{Event, Events};
use coordinator::Left;
use process::Role;
use proto::codec::{decode, encode};
use proto::config::AlgoName;
use proto::control::{Progress, Rates};
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

/// A coordinator whose two agents have joined, report `finished` and leave, in the given order.
fn left(finished: [bool; 2], tokens_first: bool) -> Left {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = config("run", "any", 2, AlgoName::Ippo, Family::Lbf);
    let keys = Keys::new("run").expect("a good name");
    let run = RunFolder::create(folder.path().join("run"), &config.to_toml()).expect("a new folder");
    let hub = bus::memory();
    let role = Role::new(hub.connect(), config, run.role("coordinator").expect("a role"), DEADLINE);
    let coordinator = thread::spawn(move || coordinator::run(role.expect("a good name")));
    let agents = [hub.connect(), hub.connect()];
    let mut tokens = Vec::new();
    for (id, agent) in (0..).zip(&agents) {
        let (inbox, events) = bus::inbox();
        let _schedule = agent.subscribe(&keys.schedule(), inbox).expect("a subscription");
        tokens.push(agent.announce(&keys.alive_agent(id)).expect("a token"));
        told(&events);
    }
    if tokens_first {
        tokens.clear();
    }
    for ((id, agent), finished) in (0..).zip(&agents).zip(finished) {
        let progress = encode(&Progress { update_calls: 9, finished }).expect("it fits");
        agent.publisher(&keys.progress(id)).expect("a publisher").send(&progress).expect("it is sent");
    }
    drop(tokens);
    coordinator.join().expect("it does not panic").expect("it leaves well")
}

#[test]
fn the_end_tells_a_finished_run_from_one_to_resume() {
    for tokens_first in [false, true] {
        assert_eq!(left([true, true], tokens_first), Left::Finished);
        assert_eq!(left([true, false], tokens_first), Left::Stopped);
        assert_eq!(left([false, false], tokens_first), Left::Stopped);
    }
}
