//! Decoding arbitrary bytes neither panics nor accepts part of a message. Ten thousand cases of each kind for each
//! message, the same in every run.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseResult, TestRng, TestRunner};
use proto::codec::{decode, encode, Message};
use proto::control::{Join, Metrics, Progress, Rates, RatesQuery, Refusal, Seat, Welcome};
use proto::{Act, End, Mode, Observe, WIRE_VERSION};
use std::cell::Cell;
use std::fmt::Debug;

const CASES: u32 = 10_000;

/// One type of message.
struct Kind {
    name: &'static str,
    tag: u8,
    /// Bytes of a valid message.
    valid: BoxedStrategy<Vec<u8>>,
    /// Decodes, and encodes what was accepted: the result must be equal, for tick messages byte by byte.
    accepts: fn(&[u8]) -> Result<bool, TestCaseError>,
}

fn kinds() -> Vec<Kind> {
    vec![
        tick_kind(Observe::NAME, Observe::TAG, observe(), Observe::encode, accepts_observe),
        tick_kind(Act::NAME, Act::TAG, act(), Act::encode, accepts_act),
        control_kind(join()),
        control_kind(welcome()),
        control_kind(rates()),
        control_kind(any::<u64>().prop_map(|update_call| RatesQuery { update_call })),
        control_kind(
            any::<(u64, bool)>().prop_map(|(update_calls, finished)| Progress { update_calls, finished }),
        ),
        control_kind(metrics()),
    ]
}

fn tick_kind<M: Debug + 'static>(
    name: &'static str,
    tag: u8,
    message: impl Strategy<Value = M> + 'static,
    encode: fn(&M, &mut Vec<u8>),
    accepts: fn(&[u8]) -> Result<bool, TestCaseError>,
) -> Kind {
    let valid = message.prop_map(move |message| {
        let mut bytes = Vec::new();
        encode(&message, &mut bytes);
        bytes
    });
    Kind { name, tag, valid: valid.boxed(), accepts }
}

fn accepts_observe(bytes: &[u8]) -> Result<bool, TestCaseError> {
    let mut message = Observe::default();
    if message.decode(bytes).is_err() {
        return Ok(false);
    }
    let mut again = Vec::new();
    message.encode(&mut again);
    prop_assert_eq!(again, bytes);
    Ok(true)
}

fn accepts_act(bytes: &[u8]) -> Result<bool, TestCaseError> {
    let mut message = Act::default();
    if message.decode(bytes).is_err() {
        return Ok(false);
    }
    let mut again = Vec::new();
    message.encode(&mut again);
    prop_assert_eq!(again, bytes);
    Ok(true)
}

fn control_kind<M: Message + Debug + 'static>(message: impl Strategy<Value = M> + 'static) -> Kind {
    let valid = message.prop_map(|message| encode(&message).expect("the strategies make permitted messages"));
    Kind { name: M::NAME, tag: M::TAG, valid: valid.boxed(), accepts: accepts_control::<M> }
}

/// An encoding may use longer numbers than needed, so the bytes can differ once; encoding again changes nothing.
fn accepts_control<M: Message + Debug>(bytes: &[u8]) -> Result<bool, TestCaseError> {
    let Ok(message) = decode::<M>(bytes) else { return Ok(false) };
    let shortest = encode(&message).map_err(|error| TestCaseError::fail(error.to_string()))?;
    prop_assert!(shortest.len() <= bytes.len());
    let again = decode::<M>(&shortest).map_err(|error| TestCaseError::fail(error.to_string()))?;
    prop_assert_eq!(encode(&again), Ok(shortest));
    Ok(true)
}

fn check<S: Strategy>(name: &str, strategy: &S, test: impl Fn(S::Value) -> TestCaseResult) {
    let config = Config { cases: CASES, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    if let Err(failure) = runner.run(strategy, test) {
        panic!("{name}: {failure}");
    }
}

#[test]
fn valid_messages_are_accepted() {
    for kind in kinds() {
        check(kind.name, &kind.valid, |bytes| {
            prop_assert!((kind.accepts)(&bytes)?);
            Ok(())
        });
    }
}

#[test]
fn random_bytes_are_survived() {
    for kind in kinds() {
        check(kind.name, &vec(any::<u8>(), 0..100), |bytes| (kind.accepts)(&bytes).map(drop));
    }
}

#[test]
fn random_content_behind_the_right_frame_is_survived() {
    for kind in kinds() {
        check(kind.name, &vec(any::<u8>(), 0..150), |content| {
            let bytes = [&[WIRE_VERSION, kind.tag][..], &content].concat();
            (kind.accepts)(&bytes).map(drop)
        });
    }
}

/// Reaches the checks of values; bytes of a random length never do.
#[test]
fn random_sections_of_the_right_length_are_survived() {
    let accepted = Cell::new(0);
    let shaped = (0..4_usize, 0..4_usize, 0..4_usize, vec(0..4_u8, 1 + Observe::encoded_len(4, 4, 4)));
    check("Observe", &shaped, |(rows, obs_size, n_actions, mut bytes)| {
        bytes.truncate(Observe::encoded_len(rows, obs_size, n_actions));
        bytes[..2].copy_from_slice(&[WIRE_VERSION, Observe::TAG]);
        bytes[3] = 0;
        bytes[20..32].fill(0);
        for (at, size) in [(20, rows), (22, obs_size), (24, n_actions)] {
            bytes[at] = u8::try_from(size).expect("at most 3");
        }
        accepted.set(accepted.get() + u32::from(accepts_observe(&bytes)?));
        Ok(())
    });
    assert!(accepted.get() > 100, "only {} cases passed all checks", accepted.get());
}

#[test]
fn a_message_cut_off_anywhere_is_refused() {
    for kind in kinds() {
        check(kind.name, &(&kind.valid, any::<prop::sample::Index>()), |(bytes, cut)| {
            prop_assert!(!(kind.accepts)(&bytes[..cut.index(bytes.len())])?);
            Ok(())
        });
    }
}

#[test]
fn a_message_followed_by_anything_is_refused() {
    for kind in kinds() {
        check(kind.name, &(&kind.valid, vec(any::<u8>(), 1..20)), |(bytes, more)| {
            prop_assert!(!(kind.accepts)(&[bytes, more].concat())?);
            Ok(())
        });
    }
}

#[test]
fn messages_with_flipped_bits_are_survived() {
    let flips = vec((any::<prop::sample::Index>(), 0..8_u32), 1..5);
    for kind in kinds() {
        check(kind.name, &(&kind.valid, &flips), |(mut bytes, flips)| {
            for (at, bit) in flips {
                let at = at.index(bytes.len());
                bytes[at] ^= 1 << bit;
            }
            (kind.accepts)(&bytes).map(drop)
        });
    }
}

#[test]
fn no_message_is_taken_for_another() {
    let kinds = kinds();
    for kind in &kinds {
        check(kind.name, &kind.valid, |bytes| {
            for other in kinds.iter().filter(|other| other.tag != kind.tag) {
                prop_assert!(!(other.accepts)(&bytes)?, "taken for {}", other.name);
            }
            Ok(())
        });
    }
}

fn mode() -> impl Strategy<Value = Mode> {
    prop::sample::select(vec![Mode::Train, Mode::Test, Mode::Finished, Mode::Stopped])
}

fn finite() -> impl Strategy<Value = f32> {
    any::<f32>().prop_map(|x| if x.is_finite() { x } else { 0.0 })
}

prop_compose! {
    fn observe()(mode in mode(), rows in 1..6_usize, obs_size in 0..5_usize, n_actions in 1..5_usize)(
        epoch in any::<u32>(),
        round in any::<u64>(),
        tick in any::<u32>(),
        t_env in any::<u64>(),
        copies in prop::collection::btree_set(any::<u16>(), rows),
        ends in vec(prop::sample::select(vec![End::Running, End::Terminated, End::TimeLimit]), rows),
        rewards in vec(finite(), rows),
        obs in vec(finite(), rows * obs_size),
        avail in vec(0..2_u8, rows * n_actions),
        mode in Just(mode),
        obs_size in Just(obs_size),
        n_actions in Just(n_actions),
    ) -> Observe {
        if mode.closes_the_run() {
            return Observe { mode, epoch, round, tick, t_env, obs_size, n_actions, ..Observe::default() };
        }
        let copies = copies.into_iter().collect();
        let mut message =
            Observe { mode, epoch, round, tick, t_env, obs_size, n_actions, copies, ends, rewards, obs, avail };
        if tick == 0 {
            message.ends.fill(End::Running);
            message.rewards.fill(0.0);
        }
        // A running row has an available action.
        for row in 0..message.rows() {
            message.avail[row * n_actions] = 1;
        }
        message
    }
}

fn act() -> impl Strategy<Value = Act> {
    (mode(), any::<u32>(), any::<u64>(), any::<u32>(), vec(any::<u16>(), 0..6)).prop_map(
        |(mode, epoch, round, tick, mut actions)| {
            if mode.closes_the_run() {
                actions.clear();
            }
            Act { mode, epoch, round, tick, actions }
        },
    )
}

fn join() -> impl Strategy<Value = Join> {
    (any::<[u8; 32]>(), any::<u64>(), prop::collection::btree_set(any::<u64>(), 0..5)).prop_map(
        |(config_digest, nonce, checkpoints)| Join {
            config_digest,
            nonce,
            checkpoints: checkpoints.into_iter().collect(),
        },
    )
}

fn welcome() -> impl Strategy<Value = Welcome> {
    let seat = (any::<(u32, u64, u64)>(), 1..=65_535_u32, 1..=65_535_u32, 1..=10_000_u32, 1..=u32::MAX)
        .prop_map(|((epoch, round, t_env), agents, sizes, copies, episode_limit)| Seat {
            epoch,
            round,
            t_env,
            agents,
            obs_size: sizes,
            n_actions: 65_536 - sizes,
            copies,
            test_episodes: 10_001 - copies,
            episode_limit,
        });
    let refusal = prop_oneof![
        any::<(u8, u8)>().prop_map(|(ours, theirs)| Refusal::Version { ours, theirs }),
        any::<([u8; 32], [u8; 32])>().prop_map(|(ours, theirs)| Refusal::Config { ours, theirs }),
        any::<u32>().prop_map(|id| Refusal::IdTaken { id }),
        any::<(u32, u32)>().prop_map(|(id, agents)| Refusal::IdOutOfRange { id, agents }),
        ".{0,40}".prop_map(Refusal::malformed),
        Just(Refusal::Closing),
        ".{0,40}".prop_map(|text| Refusal::no_common_round(&text)),
    ];
    prop_oneof![seat.prop_map(Welcome::Seat), refusal.prop_map(Welcome::Refused)]
}

fn rates() -> impl Strategy<Value = Rates> {
    (0..u64::MAX - 1, 1..u64::MAX, vec(0.0..1.0_f64, 2), vec(0..2_u8, 1..20)).prop_map(
        |(from, length, rates, levels)| Rates {
            from,
            until: from.saturating_add(length),
            fast_agent: u32::try_from(levels.len() / 2).expect("at most 10"),
            rates,
            levels,
        },
    )
}

fn metrics() -> impl Strategy<Value = Metrics> {
    (any::<u64>(), any::<u64>(), vec(("[a-z_]{1,12}", any::<f64>()), 0..6))
        .prop_map(|(t_env, update_calls, scalars)| Metrics { t_env, update_calls, scalars })
}
