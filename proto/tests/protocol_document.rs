//! `docs/protocol.md` and the code agree: the code encodes and decodes every test vector of the document, every
//! message has one, and every key is in its table.

mod vectors;

use proto::codec::{decode, encode, Message};
use proto::control::{Join, Metrics, Progress, Rates, RatesQuery, Refusal, Seat, Welcome};
use proto::{Act, End, Key, Keys, Mode, Observe, WIRE_VERSION};
use std::collections::BTreeMap;
use std::fmt::Debug;
use vectors::{vectors, DOCUMENT};

fn observe() -> Observe {
    Observe {
        mode: Mode::Train,
        epoch: 1,
        round: 300,
        tick: 7,
        t_env: 100_000,
        obs_size: 3,
        n_actions: 2,
        copies: vec![0, 4],
        ends: vec![End::Running, End::Terminated],
        rewards: vec![0.0, 0.5],
        obs: vec![1.0, 2.0, -1.0, 0.0, 0.25, 3.0],
        avail: vec![1, 0, 1, 1],
    }
}

fn refusals() -> [(&'static str, Refusal); 7] {
    [
        ("welcome-version", Refusal::Version { ours: 2, theirs: 1 }),
        ("welcome-config", Refusal::Config { ours: [0xaa; 32], theirs: [0xbb; 32] }),
        ("welcome-id-taken", Refusal::IdTaken { id: 2 }),
        ("welcome-id-out-of-range", Refusal::IdOutOfRange { id: 3, agents: 3 }),
        ("welcome-malformed", Refusal::malformed("why")),
        ("welcome-closing", Refusal::Closing),
        ("welcome-no-common-round", Refusal::no_common_round("why")),
    ]
}

/// The messages of the vectors as the code encodes them. Decoding them is checked too.
fn examples() -> BTreeMap<&'static str, Vec<u8>> {
    let mut examples = BTreeMap::from([
        ("observe", observe_both_ways(&observe())),
        ("observe-finished", {
            let none = Observe::default();
            observe_both_ways(&Observe { mode: Mode::Finished, epoch: 1, round: 301, t_env: 100_250, ..none })
        }),
        ("act", {
            act_both_ways(&Act { mode: Mode::Train, epoch: 1, round: 300, tick: 7, actions: vec![0] })
        }),
        ("act-without-actions", {
            act_both_ways(&Act { mode: Mode::Finished, epoch: 1, round: 301, tick: 0, actions: vec![] })
        }),
        (
            "join",
            both_ways(&Join {
                config_digest: [0x11; 32],
                nonce: 0x0102_0304_0506_0708,
                checkpoints: vec![200, 300],
            }),
        ),
        (
            "welcome-seat",
            both_ways(&Welcome::Seat(Seat {
                epoch: 1,
                round: 300,
                t_env: 100_000,
                agents: 3,
                obs_size: 18,
                n_actions: 6,
                copies: 10,
                test_episodes: 100,
                episode_limit: 50,
            })),
        ),
        (
            "rates",
            both_ways(&Rates {
                from: 300,
                until: 400,
                fast_agent: 0,
                rates: vec![2e-4, 5e-5],
                levels: vec![0, 1, 1],
            }),
        ),
        (
            "rates-for-ever",
            both_ways(&Rates {
                from: 0,
                until: Rates::FOR_EVER,
                fast_agent: 0,
                rates: vec![1e-4],
                levels: vec![0, 0],
            }),
        ),
        ("rates-query", both_ways(&RatesQuery { update_call: 300 })),
        ("progress", both_ways(&Progress { update_calls: 301, finished: false })),
        (
            "metrics",
            both_ways(&Metrics {
                t_env: 100_250,
                update_calls: 301,
                scalars: vec![("loss".to_owned(), 0.5), ("lr".to_owned(), 2e-4)],
            }),
        ),
    ]);
    examples.extend(refusals().map(|(name, refusal)| (name, both_ways(&Welcome::Refused(refusal)))));
    examples
}

fn observe_both_ways(message: &Observe) -> Vec<u8> {
    let (mut bytes, mut back) = (Vec::new(), Observe::default());
    message.encode(&mut bytes);
    back.decode(&bytes).unwrap();
    assert_eq!(&back, message);
    bytes
}

fn act_both_ways(message: &Act) -> Vec<u8> {
    let (mut bytes, mut back) = (Vec::new(), Act::default());
    message.encode(&mut bytes);
    back.decode(&bytes).unwrap();
    assert_eq!(&back, message);
    bytes
}

fn both_ways<M: Message + PartialEq + Debug>(message: &M) -> Vec<u8> {
    let bytes = encode(message).unwrap();
    assert_eq!(&decode::<M>(&bytes).unwrap(), message);
    bytes
}

#[test]
fn every_vector_of_the_document_is_what_the_code_sends_and_understands() {
    let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ");
    let (written, sent) = (vectors(), examples());
    assert_eq!(written.keys().collect::<Vec<_>>(), sent.keys().collect::<Vec<_>>());
    for (name, bytes) in &sent {
        assert_eq!(hex(&written[name]), hex(bytes), "vector `{name}`");
    }
}

#[test]
fn every_message_has_a_vector() {
    let mut tags: Vec<u8> = vectors().values().map(|bytes| bytes[1]).collect();
    tags.sort_unstable();
    tags.dedup();
    assert_eq!(tags, [1, 2, 3, 4, 5, 6, 7, 8]);
    assert!(vectors().values().all(|bytes| bytes[0] == WIRE_VERSION));
}

#[test]
fn every_key_is_in_the_table() {
    let keys = Keys::new("RUN").unwrap();
    for key in [
        Key::Observe(7),
        Key::Act(7),
        Key::Join(7),
        Key::Schedule,
        Key::Progress(7),
        Key::AgentMetrics(7),
        Key::WorldMetrics,
        Key::AliveWorld,
        Key::AliveCoordinator,
        Key::AliveAgent(7),
    ] {
        let template = keys.of(key).replace("rondo/RUN/", "").replace('7', "{i}");
        assert!(DOCUMENT.contains(&format!("`{template}`")), "`{template}` is missing");
    }
}

#[test]
fn the_limits_of_the_document_are_those_of_the_code() {
    for (tag, name, limit) in [
        (Join::TAG, Join::NAME, Join::MAX_BYTES),
        (Welcome::TAG, Welcome::NAME, Welcome::MAX_BYTES),
        (Rates::TAG, Rates::NAME, Rates::MAX_BYTES),
        (RatesQuery::TAG, RatesQuery::NAME, RatesQuery::MAX_BYTES),
        (Progress::TAG, Progress::NAME, Progress::MAX_BYTES),
        (Metrics::TAG, Metrics::NAME, Metrics::MAX_BYTES),
    ] {
        let row = format!("| {tag} | `{name}` | {limit} |");
        assert!(DOCUMENT.contains(&row), "the table of messages has no row `{row}`");
    }
}
