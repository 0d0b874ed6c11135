//! All messages on the bus: only those that the protocol lists, from the senders that it names; and no learning
//! without a schedule.

use std::fs;

use proto::codec::{decode, Message};
use proto::control::{Join, Metrics, Progress, Rates, RatesQuery, Welcome};
use proto::keys::{Key, Keys};
use proto::{Act, Observe};

use crate::cluster::{short, undisturbed, Process};
use crate::hosts::Hosts;

/// The name that `rondo config` gives a run.
const RUN: &str = "run";

/// The role of a record.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Role {
    World,
    Coordinator,
    Agent(u32),
}

/// Which operations docs/protocol.md allows a role, key by key.
fn may(role: Role, op: &str, key: Key) -> bool {
    match role {
        Role::World => match op {
            "published" => matches!(key, Key::Observe(0 | 1) | Key::WorldMetrics),
            "replied" => matches!(key, Key::Join(0 | 1)),
            "subscribed" => matches!(key, Key::Act(0 | 1)),
            "announced" => key == Key::AliveWorld,
            _ => false,
        },
        Role::Coordinator => match op {
            "published" | "replied" | "served" => key == Key::Schedule,
            "announced" => key == Key::AliveCoordinator,
            _ => false,
        },
        Role::Agent(id) => match op {
            "published" => [Key::Act(id), Key::Progress(id), Key::AgentMetrics(id)].contains(&key),
            "asked" => [Key::Join(id), Key::Schedule].contains(&key),
            "subscribed" => [Key::Observe(id), Key::Schedule].contains(&key),
            "announced" => key == Key::AliveAgent(id),
            "watched" => key == Key::AliveWorld,
            _ => false,
        },
    }
}

/// Expressions over several agents' keys that a role may declare.
fn may_declare(role: Role, op: &str, expression: &str, keys: &Keys) -> bool {
    match (role, op) {
        (Role::World, "served") => expression == keys.any_join(),
        (Role::Coordinator, "subscribed") => expression == keys.any_progress(),
        (Role::World | Role::Coordinator, "watched") => expression == keys.any_alive(),
        _ => false,
    }
}

/// Decodes a payload as what docs/protocol.md lists for the key, within the size that it allows.
fn is_as_listed(op: &str, key: Key, payload: &[u8]) -> Result<(), String> {
    fn control<M: Message>(payload: &[u8]) -> Result<(), String> {
        decode::<M>(payload).map_err(|error| error.to_string())?;
        if payload.len() > M::MAX_BYTES {
            return Err(format!("{} bytes, at most {} are allowed", payload.len(), M::MAX_BYTES));
        }
        Ok(())
    }
    let exactly = |expected: usize| {
        if payload.len() == expected {
            Ok(())
        } else {
            Err(format!("{} bytes where its rows take {expected}", payload.len()))
        }
    };
    match (op, key) {
        ("published", Key::Observe(_)) => {
            let mut observe = Observe::default();
            observe.decode(payload).map_err(|error| error.to_string())?;
            exactly(Observe::encoded_len(observe.rows(), observe.obs_size, observe.n_actions))
        }
        ("published", Key::Act(_)) => {
            let mut act = Act::default();
            act.decode(payload).map_err(|error| error.to_string())?;
            exactly(24 + 2 * act.actions.len())
        }
        ("asked", Key::Join(_)) => control::<Join>(payload),
        ("replied", Key::Join(_)) => control::<Welcome>(payload),
        ("published" | "replied", Key::Schedule) => control::<Rates>(payload),
        ("asked", Key::Schedule) => control::<RatesQuery>(payload),
        ("published", Key::Progress(_)) => control::<Progress>(payload),
        ("published", Key::AgentMetrics(_) | Key::WorldMetrics) => control::<Metrics>(payload),
        _ => Err("nothing is listed".to_owned()),
    }
}

pub fn unhex(text: &str) -> Vec<u8> {
    let digits = |at: usize| u8::from_str_radix(&text[at..at + 2], 16).expect("hexadecimal digits");
    (0..text.len()).step_by(2).map(digits).collect()
}

/// Checks every recorded line of a role. Returns the number of payloads on each key.
fn audit(hosts: &Hosts, host: &str, role: Role) -> Vec<(Key, usize)> {
    let keys = Keys::new(RUN).expect("a good name");
    let mut seen: Vec<(Key, usize)> = Vec::new();
    for line in hosts.recorded(host) {
        let (op, text) = (line["op"].as_str().expect("an operation"), line["key"].as_str().expect("a key"));
        let Some(key) = keys.parse(text) else {
            assert!(may_declare(role, op, text, &keys), "{host} {op} `{text}`");
            continue;
        };
        assert!(may(role, op, key), "{host} {op} `{text}`");
        if let Some(hex) = line["hex"].as_str() {
            let payload = unhex(hex);
            assert_eq!(line["bytes"].as_u64(), Some(payload.len() as u64));
            if let Err(problem) = is_as_listed(op, key, &payload) {
                panic!("{host} {op} `{text}`: {problem}: {hex}");
            }
            match seen.iter_mut().find(|(of, _)| *of == key) {
                Some((_, count)) => *count += 1,
                None => seen.push((key, 1)),
            }
        }
    }
    seen
}

#[test]
fn every_message_of_a_run_is_one_that_the_protocol_lists_for_its_sender() {
    let hosts = Hosts::new(short());
    let roles: Vec<Process> = vec![
        hosts.start_env_server(&[]),
        hosts.start_coordinator(&[]),
        hosts.start_agent(0, &[]),
        hosts.start_agent(1, &[]),
    ];
    roles.into_iter().for_each(|role| drop(role.succeeds()));
    assert_eq!(hosts.merged_digest(), undisturbed(), "recording changes nothing");

    let world = audit(&hosts, "world", Role::World);
    let coordinator = audit(&hosts, "coordinator", Role::Coordinator);
    let agents = [0, 1].map(|id| audit(&hosts, &format!("agent-{id}"), Role::Agent(id)));

    // The audit covers complete conversations: each tick is answered, each update call reported.
    let count = |seen: &[(Key, usize)], key: Key| {
        seen.iter().find(|(of, _)| *of == key).map_or(0, |&(_, count)| count)
    };
    let rounds = fs::read_dir(hosts.folder("agent-0").join("agent-0/checkpoints")).expect("a folder").count();
    assert!(rounds > 0);
    for id in [0, 1] {
        let agent = &agents[id as usize];
        let ticks = count(&world, Key::Observe(id));
        assert!(ticks > 500, "{ticks}");
        assert_eq!(count(agent, Key::Act(id)), ticks);
        assert!(count(agent, Key::Progress(id)) > 10);
        assert!(count(agent, Key::Join(id)) >= 1 && count(&world, Key::Join(id)) >= 1);
    }
    assert!(count(&coordinator, Key::Schedule) > 0);
    assert!(count(&coordinator, Key::Schedule) < 100, "the schedule is a few messages");
}

#[test]
fn an_agent_never_learns_in_an_update_call_that_no_schedule_covers() {
    let mut hosts = Hosts::new(short());
    // A process that listens in the coordinator's place, accepts every connection and sends nothing.
    let silent =
        bus::open(&bus::Options { listen: vec![hosts.coordinator.clone()], ..bus::Options::default() });
    let silent = silent.expect("it can listen");
    hosts.coordinator = silent.endpoints().remove(0);

    let world = hosts.start_env_server(&[]);
    let agents = [hosts.start_agent(0, &["--wait=3"]), hosts.start_agent(1, &["--wait=3"])];
    for agent in agents {
        agent.wait().fails_with(
            75,
            &[
                "error: no schedule covers update call 0: the coordinator did not answer on `rondo/run/schedule` within 3s",
                "hint: is it running, and its endpoint among the `--connect`?",
            ],
        );
    }
    world.wait().fails_with(75, &["left the run and did not come back within 5s"]);
    for id in [0, 1] {
        let host = format!("agent-{id}");
        let reports = format!("rondo/run/agent/{id}/progress");
        let lines = hosts.recorded(&host);
        assert!(lines.iter().any(|line| line["key"] == "rondo/run/schedule" && line["op"] == "asked"));
        assert!(!lines.iter().any(|line| line["key"] == *reports), "it reported an update call");
        assert_eq!(
            fs::read_dir(hosts.folder(&host).join(&host).join("checkpoints")).into_iter().flatten().count(),
            0
        );
    }
}
