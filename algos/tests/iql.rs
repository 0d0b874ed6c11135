//! The Q learner as a whole: initial weights, target network, exploration, frozen rates, the parts of a minibatch,
//! checkpoints.

use algos::iql::{Config, Iql, UpdateStats};
use algos::learner::{Learner, OffPolicy};
use algos::network::Kind;
use algos::reward_stats::Standardisation;
use algos::rollout::{End, Episode};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const OBS: usize = 6;
const ACTIONS: usize = 3;
const KINDS: [Kind; 2] = [Kind::Fc, Kind::Gru];

fn config(network: Kind) -> Config {
    Config {
        network,
        hidden: 16,
        agents: 2,
        gamma: 0.99,
        target_update: 200.0,
        max_grad_norm: 10.0,
        reward_standardisation: Standardisation::Off,
        hold_frozen_moments: false,
        time_limit_is_terminal: true,
        double_q: true,
    }
}

fn learner(config: Config) -> Iql {
    Iql::new(config, OBS, ACTIONS, &mut ChaCha8Rng::seed_from_u64(1))
}

fn episode(length: usize, rng: &mut ChaCha8Rng) -> Episode {
    Episode {
        obs: (0..(length + 1) * OBS).map(|_| rng.random_range(-1.0..1.0)).collect(),
        avail: vec![1; (length + 1) * ACTIONS],
        actions: (0..length).map(|_| rng.random_range(0..ACTIONS as u16)).collect(),
        rewards: (0..length).map(|_| rng.random_range(-1.0..1.0)).collect(),
        end: End::Terminated,
    }
}

fn episodes(lengths: &[usize], seed: u64) -> Vec<Episode> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    lengths.iter().map(|&length| episode(length, &mut rng)).collect()
}

/// The bits of all tensors whose names start with `owner.`.
fn bits(learner: &Iql, owner: &str) -> Vec<u32> {
    let of_owner = |name: &str| name.strip_prefix(owner).is_some_and(|rest| rest.starts_with('.'));
    let tensors = learner.tensors().into_iter().filter(|(name, ..)| of_owner(name));
    tensors.flat_map(|(_, _, data)| data.iter().map(|x| x.to_bits())).collect()
}

#[test]
fn initial_weights_have_the_spread_of_the_uniform_distribution_and_the_target_is_an_exact_copy() {
    // Standard deviation 1 / sqrt(3 fan_in), bounds ±1 / sqrt(fan_in) (algorithms §1.3, §12). In a GRU the fan-in is
    // the hidden width for all matrices.
    for network in KINDS {
        let learner = learner(Config { hidden: 128, ..config(network) });
        assert_eq!(bits(&learner, "q"), bits(&learner, "target_q"));
        let mut checked = 0;
        for (name, _, data) in learner.tensors() {
            if name.starts_with("adam.") {
                assert!(data.iter().all(|&x| x == 0.0), "{name} starts at zero");
            } else if data.len() >= 300 {
                let bound = 1.0 / if name.contains("fc1") { OBS as f64 } else { 128.0 }.sqrt();
                let n = data.len() as f64;
                let mean = data.iter().map(|&x| f64::from(x)).sum::<f64>() / n;
                let var = data.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>() / n;
                let expected = bound / 3.0f64.sqrt();
                assert!(data.iter().all(|&x| f64::from(x).abs() <= bound), "{name}");
                assert!((var.sqrt() / expected - 1.0).abs() < 4.0 / n.sqrt(), "{name}: {}", var.sqrt());
                checked += 1;
            }
        }
        assert!(checked >= 6, "{checked} tensors checked");
    }
}

#[test]
fn the_target_network_is_copied_by_update_call_200_and_not_before() {
    let mut learner = learner(config(Kind::Fc));
    let start = bits(&learner, "target_q");
    let episodes = episodes(&[2, 1], 2);
    for _ in 1..200 {
        learner.update(&episodes, 1e-3);
    }
    assert_eq!(bits(&learner, "target_q"), start, "199 calls");
    learner.update(&episodes, 1e-3);
    let copied = bits(&learner, "q");
    assert_ne!(copied, start);
    assert_eq!(bits(&learner, "target_q"), copied, "call 200");
    learner.update(&episodes, 1e-3);
    assert_eq!(bits(&learner, "target_q"), copied, "call 201");
    assert_eq!((learner.update_calls(), learner.counters().last_target_copy), (201, 200));
}

#[test]
fn a_polyak_target_is_the_running_mean_of_the_networks() {
    let mut learner = learner(Config { target_update: 0.01, ..config(Kind::Gru) });
    let float = |bits: Vec<u32>| -> Vec<f32> { bits.into_iter().map(f32::from_bits).collect() };
    let mut target = float(bits(&learner, "target_q"));
    for call in 0..3 {
        learner.update(&episodes(&[4, 3], call), 1e-2);
        for (target, value) in target.iter_mut().zip(float(bits(&learner, "q"))) {
            *target = (1.0 - 0.01) * *target + 0.01 * value;
        }
        assert_eq!(float(bits(&learner, "target_q")), target);
    }
}

#[test]
fn a_frozen_agent_keeps_its_weights_while_its_moments_follow_the_option() {
    // Check 3 of algorithms §12.
    for (network, hold) in KINDS.into_iter().flat_map(|kind| [(kind, false), (kind, true)]) {
        let mut learner = learner(Config { hold_frozen_moments: hold, ..config(network) });
        let before = learner.clone();
        for call in 0..3 {
            let stats = learner.update(&episodes(&[4, 6], call), 0.0);
            assert!(stats.loss > 0.0 && stats.grad_norm > 0.0);
        }
        assert_eq!(bits(&learner, "q"), bits(&before, "q"));
        assert_eq!(bits(&learner, "target_q"), bits(&before, "target_q"));
        for moments in ["adam.q.m", "adam.q.v"] {
            assert_eq!(bits(&learner, moments) == bits(&before, moments), hold, "{moments}");
        }
        assert_eq!(learner.counters().adam_steps, if hold { 0 } else { 3 });
        assert_eq!(learner.update_calls(), 3);
    }
}

#[test]
fn the_length_of_the_others_in_a_minibatch_changes_nothing_of_an_episode() {
    // Check 5 of algorithms §12. Padding has no rows here, so the errors of a short episode are the same alone and
    // beside a long one.
    for network in KINDS {
        let update = |episodes: &[Episode]| learner(config(network)).update(episodes, 0.0);
        let all = episodes(&[3, 9, 1], 3);
        let single: Vec<UpdateStats> = all.iter().map(|e| update(std::slice::from_ref(e))).collect();
        let together = update(&all);
        let mean = |of: fn(&UpdateStats) -> f64| {
            single.iter().zip([3.0, 9.0, 1.0]).map(|(stats, steps)| of(stats) * steps).sum::<f64>() / 13.0
        };
        let parts: [fn(&UpdateStats) -> f64; 4] =
            [|s| s.loss, |s| s.td_error_abs, |s| s.q_taken_mean, |s| s.target_mean];
        for of in parts {
            assert!((of(&together) - mean(of)).abs() < 1e-6, "{network:?}: {together:?} {single:?}");
        }
    }
}

#[test]
fn episodes_of_different_lengths_may_come_in_any_order() {
    for network in KINDS {
        let run = |order: [usize; 3]| {
            let standardised = Standardisation::Running;
            let mut learner = learner(Config { reward_standardisation: standardised, ..config(network) });
            let all = episodes(&[3, 9, 1], 3);
            learner.update(&order.map(|k| all[k].clone()), 1e-3);
            (bits(&learner, "q"), learner.counters())
        };
        assert_eq!(run([0, 1, 2]), run([2, 0, 1]));
        assert_eq!(run([0, 1, 2]), run([1, 2, 0]));
    }
}

#[test]
fn what_is_never_allowed_reaches_neither_gradient_nor_target() {
    // The third action is never available. Its bias makes it by far the best or the worst, in both networks.
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut episode = episode(2, &mut rng);
    (episode.actions, episode.avail) = (vec![0, 1], [1, 1, 0].repeat(3));
    let run = |value_of_forbidden: f32| {
        let mut learner = learner(config(Kind::Fc));
        let mut tensors: Vec<(String, Vec<f32>)> =
            learner.tensors().into_iter().map(|(name, _, data)| (name, data.to_vec())).collect();
        for (_, data) in tensors.iter_mut().filter(|(name, _)| name.ends_with("q.head.bias")) {
            data[2] = value_of_forbidden;
        }
        let counters = learner.counters();
        let find = |name: &str| tensors.iter().find(|(n, _)| n == name).map(|(_, data)| data.as_slice());
        learner.restore(&counters, find).expect("its own tensors");
        learner.update(std::slice::from_ref(&episode), 1e-3)
    };
    assert_eq!(run(100.0), run(-100.0));
}

#[test]
fn actions_are_always_allowed_ones_whatever_epsilon_is() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for (network, epsilon) in KINDS.into_iter().flat_map(|kind| [0.0, 0.3, 1.0].map(|e| (kind, e))) {
        let mut learner = learner(config(network));
        learner.begin_round(4);
        let mut actions = Vec::new();
        for _ in 0..200 {
            let obs: Vec<f32> = (0..4 * OBS).map(|_| rng.random_range(-1.0..1.0)).collect();
            let only: Vec<usize> = (0..4).map(|_| rng.random_range(0..ACTIONS)).collect();
            // Row 0 allows all but one action, the others a single one.
            let avail = |row: usize, action: usize| u8::from((only[row] == action) != (row == 0));
            let avail: Vec<u8> = (0..4 * ACTIONS).map(|i| avail(i / ACTIONS, i % ACTIONS)).collect();
            learner.act(&[0, 1, 2, 3], &obs, &avail, epsilon, &mut rng, &mut actions);
            assert_eq!(actions.len(), 4);
            assert_ne!(usize::from(actions[0]), only[0]);
            assert_eq!(actions[1..].iter().map(|&a| usize::from(a)).collect::<Vec<_>>(), only[1..]);
        }
    }
}

#[test]
fn exploring_leaves_recurrent_states_and_the_random_stream_as_they_are() {
    // One learner explores in the first half of an episode, the other does not. In the second half they act alike:
    // their observations and the positions of their random streams are the same.
    let act = |first_epsilon: f64| {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let mut learner = learner(config(Kind::Gru));
        let mut seen = ChaCha8Rng::seed_from_u64(9);
        learner.begin_round(3);
        let mut all = Vec::new();
        for t in 0..10 {
            let obs: Vec<f32> = (0..3 * OBS).map(|_| seen.random_range(-3.0..3.0)).collect();
            let mut actions = Vec::new();
            let epsilon = if t < 5 { first_epsilon } else { 0.5 };
            learner.act(&[2, 0, 1], &obs, &[1; 3 * ACTIONS], epsilon, &mut rng, &mut actions);
            if t >= 5 {
                all.extend(actions);
            }
        }
        all
    };
    assert_eq!(act(0.0), act(1.0));
}

#[test]
fn a_restored_learner_goes_on_with_the_same_bits() {
    let config =
        Config { reward_standardisation: Standardisation::Running, target_update: 3.0, ..config(Kind::Gru) };
    let mut learner = learner(config.clone());
    for call in 0..2 {
        learner.update(&episodes(&[4, 6], call), 1e-3);
    }
    let counters = learner.counters();
    let saved: Vec<(String, Vec<f32>)> =
        learner.tensors().into_iter().map(|(name, _, data)| (name, data.to_vec())).collect();
    let find = |name: &str| saved.iter().find(|(n, _)| n == name).map(|(_, data)| data.as_slice());

    let mut other = Iql::new(config, OBS, ACTIONS, &mut ChaCha8Rng::seed_from_u64(99));
    other.restore(&counters, find).expect("it fits");
    for call in 2..5 {
        let episodes = episodes(&[5, 5, 2], call);
        assert_eq!(learner.update(&episodes, 1e-3), other.update(&episodes, 1e-3));
    }
    assert_eq!(learner.tensors(), other.tensors());
    assert_eq!(learner.counters(), other.counters());

    let lost = other.restore(&counters, |name| find(name).filter(|_| name != "target_q.head.bias"));
    assert_eq!(
        lost.expect_err("refused").to_string(),
        "the checkpoint has no tensor `target_q.head.bias`; it was written by a learner of another kind"
    );
    assert_eq!(learner.tensors(), other.tensors(), "a refused checkpoint changes nothing");
}
