//! Targets computed by hand, and the gradient of the loss with respect to the values.

use super::*;
use crate::rollout::End;

fn config() -> Config {
    Config {
        network: Kind::Fc,
        hidden: 8,
        agents: 2,
        gamma: 0.5,
        target_update: 200.0,
        max_grad_norm: 10.0,
        reward_standardisation: Standardisation::Off,
        hold_frozen_moments: false,
        time_limit_is_terminal: true,
        double_q: true,
    }
}

fn episode(avail: &[[u8; 3]], actions: &[u16], rewards: &[f32], end: End) -> Episode {
    Episode {
        obs: vec![0.0; avail.len()],
        avail: avail.concat(),
        actions: actions.to_vec(),
        rewards: rewards.to_vec(),
        end,
    }
}

/// All of `episodes`, with three actions.
fn part(episodes: &[Episode], time_limit_is_terminal: bool) -> Part {
    let network = Network { kind: Kind::Fc, inputs: 1, hidden: 8, outputs: 3 };
    let (mut batch, mut part) = (Batch::default(), Part::default());
    batch.begin(episodes, &network);
    part.fill(&batch, 0, episodes, &network, time_limit_is_terminal);
    part
}

/// Gradient and statistics of the part, which is the whole minibatch.
fn found(config: &Config, part: &Part, q: &[f32], target_q: &[f32]) -> (Vec<f32>, UpdateStats) {
    let (mut d_q, mut stats) = (vec![f32::NAN], UpdateStats::default());
    config.temporal_differences(part, part.transitions.len(), q, target_q, &mut d_q, &mut stats);
    (d_q, stats)
}

/// Two episodes of 2 and 1 steps. Rows: (a, 0), (b, 0), (a, 1), (b, 1), (a, 2).
fn two_episodes(time_limit_is_terminal: bool) -> Part {
    let a = episode(&[[1, 1, 1], [1, 0, 1], [0, 1, 1]], &[1, 2], &[1.0, 2.0], End::TimeLimit);
    let b = episode(&[[1, 1, 1], [1, 1, 1]], &[0], &[-1.0], End::Terminated);
    part(&[a, b], time_limit_is_terminal)
}

const Q: [f32; 15] = [
    0.0, 1.5, 0.0, //
    4.0, 0.0, 0.0, //
    1.0, 9.0, 2.0, // the best one, 9, is forbidden: a* = 2
    7.0, 7.0, 7.0, // after the end, never looked at
    8.0, 3.0, 1.0, // 8 is forbidden: a* = 1
];
const TARGET_Q: [f32; 15] = [
    0.0, 0.0, 0.0, //
    0.0, 0.0, 0.0, //
    6.0, 5.0, 4.0, // of a* = 2: 4; the largest allowed one: 6
    9.0, 9.0, 9.0, //
    5.0, -2.0, 10.0, // of a* = 1: −2; the largest allowed one: 10
];

/// `q − y` of the steps (a, 0), (b, 0), (a, 1), from the gradient `2 (q − y) / (n Σ m)`. Asserts that the rest of the
/// gradient is zero.
fn errors(config: &Config) -> [f32; 3] {
    let (d_q, _) = found(config, &two_episodes(config.time_limit_is_terminal), &Q, &TARGET_Q);
    let taken = [1, 3, 8];
    assert_eq!(d_q.len(), 15);
    assert!(d_q.iter().enumerate().all(|(i, &d)| d == 0.0 || taken.contains(&i)), "{d_q:?}");
    taken.map(|i| d_q[i] * 3.0)
}

#[test]
fn targets_are_those_worked_out_by_hand() {
    // y(a, 0) = 1 + 0.5·4 = 3, y(b, 0) = −1, y(a, 1) = 2 at the step limit; q is 1.5, 4 and 2.
    assert_eq!(errors(&config()), [-1.5, 5.0, 0.0]);
    let (_, stats) = found(&config(), &two_episodes(true), &Q, &TARGET_Q);
    let close = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{stats:?}");
    close(stats.loss, (1.5 * 1.5 + 5.0 * 5.0) / 3.0);
    close(stats.td_error_abs, 6.5 / 3.0);
    close(stats.q_taken_mean, 7.5 / 3.0);
    close(stats.target_mean, 4.0 / 3.0);
}

#[test]
fn a_step_limit_that_is_no_termination_looks_at_the_final_observation() {
    // y(a, 1) = 2 + 0.5·(−2) = 1.
    assert_eq!(errors(&Config { time_limit_is_terminal: false, ..config() }), [-1.5, 5.0, 1.0]);
}

#[test]
fn without_double_q_the_target_network_chooses_among_the_allowed() {
    // y(a, 0) = 1 + 0.5·6 = 4, y(a, 1) = 2 + 0.5·10 = 7.
    let config = Config { double_q: false, time_limit_is_terminal: false, ..config() };
    assert_eq!(errors(&config), [-2.5, 5.0, -5.0]);
}

#[test]
fn where_no_action_is_allowed_the_next_value_is_that_of_forbidden_ones() {
    // y = 0 − 0.5·9,999,999, as in the reference.
    let part = part(&[episode(&[[1; 3], [0; 3]], &[0], &[0.0], End::TimeLimit)], false);
    let (_, stats) = found(&config(), &part, &[1.0; 6], &[1.0; 6]);
    assert_eq!(stats.target_mean, -4_999_999.5);
}

#[test]
fn the_gradient_is_that_of_the_loss_with_fixed_targets() {
    let config = Config { time_limit_is_terminal: false, ..config() };
    let (found, _) = found(&config, &two_episodes(false), &Q, &TARGET_Q);
    // y by hand: see above. The loss of the team's mean is 1/n of this agent's.
    let (taken, y) = ([1, 3, 8], [3.0, -1.0, 1.0f64]);
    let loss = |q: &[f64; 15]| -> f64 {
        let squares: f64 = taken.iter().zip(y).map(|(&i, y)| (q[i] - y).powi(2)).sum();
        squares / (2.0 * 3.0)
    };
    for (i, &found) in found.iter().enumerate() {
        let at = |h: f64| {
            let mut q = Q.map(f64::from);
            q[i] += h;
            loss(&q)
        };
        let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
        assert!((f64::from(found) - expected).abs() < 1e-6, "value {i}: {found} {expected}");
    }
}
