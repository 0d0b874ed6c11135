//! What the coordinator sends is what `docs/protocol.md` shows, byte for byte.

use std::thread;
use std::time::{Duration, Instant};

use bus::Event;
use process::Role;
use proto::config::{AlgoName, Period};
use proto::presets::{config, Family};
use store::RunFolder;
use vectors::vectors;

#[path = "../../proto/tests/vectors/mod.rs"]
mod vectors;

const DEADLINE: Duration = Duration::from_secs(20);

/// What the coordinator of a run with these rates and levels answers to the page's question.
fn answer(rates: &[f64], levels: &[u32], period: Period) -> Vec<u8> {
    let mut config = config("run", "any", levels.len() as u32, AlgoName::Mtppo, Family::Lbf);
    config.schedule.rates = rates.to_vec();
    config.schedule.levels = levels.to_vec();
    config.schedule.switch_period = period;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let run = RunFolder::create(folder.path().join("run"), &config.to_toml()).expect("a new folder");
    let hub = bus::memory();
    let role = Role::new(hub.connect(), config, run.role("coordinator").expect("a role"), DEADLINE);
    let role = role.expect("a good name");
    let (stop, keys) = (role.inbox.clone(), role.keys.clone());
    let coordinator = thread::spawn(move || coordinator::run(role));
    let (agent, deadline) = (hub.connect(), Instant::now() + DEADLINE);
    let answer = loop {
        let answer = agent.ask(&keys.schedule(), &vectors()["rates-query"], DEADLINE).expect("it can ask");
        assert!(Instant::now() < deadline, "it serves the schedule");
        if let Some(answer) = answer {
            break answer;
        }
    };
    stop.send(Event::Stop).expect("it listens");
    coordinator.join().expect("it does not panic").expect("it leaves well");
    answer
}

#[test]
fn the_pages_question_gets_the_pages_answer() {
    assert_eq!(answer(&[2e-4, 5e-5], &[0, 1, 1], Period::Every(100)), vectors()["rates"]);
}

#[test]
fn a_schedule_that_never_changes_is_that_of_the_page() {
    assert_eq!(answer(&[1e-4], &[0, 0], Period::Infinite), vectors()["rates-for-ever"]);
}
