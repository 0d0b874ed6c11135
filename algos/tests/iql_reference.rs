//! Independent Q-learning against a slow implementation of the equations of algorithms §5.2: dense `B × (T + 1)`
//! tensors with masks, double precision, candle's automatic differentiation.

use algos::iql::{Config, Iql, UpdateStats};
use algos::learner::Learner;
use algos::network::Kind;
use algos::reward_stats::Standardisation;
use algos::rollout::{End, Episode};
use candle_core::{Device, Result, Tensor, Var, D};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

mod plain;
use plain::{distance, forward, update_target, Parameters};

const OBS: usize = 5;
const ACTIONS: usize = 4;

fn config(network: Kind) -> Config {
    Config {
        network,
        hidden: 16,
        agents: 3,
        gamma: 0.97,
        target_update: 2.0,
        max_grad_norm: 10.0,
        reward_standardisation: Standardisation::Off,
        hold_frozen_moments: false,
        time_limit_is_terminal: true,
        double_q: true,
    }
}

/// Episodes of these lengths with random observations, masks, actions and rewards. Those of even length
/// are ended by the world, the others by the step limit.
fn episodes(lengths: &[usize], reward_scale: f32, rng: &mut ChaCha8Rng) -> Vec<Episode> {
    let of_length = |&length: &usize| {
        let mut episode = Episode {
            obs: (0..(length + 1) * OBS).map(|_| rng.random_range(-1.0..1.0)).collect(),
            avail: (0..(length + 1) * ACTIONS).map(|_| rng.random_range(0..4u8).min(1)).collect(),
            actions: (0..length).map(|_| rng.random_range(0..ACTIONS as u16)).collect(),
            rewards: (0..length).map(|_| reward_scale * rng.random_range(-1.0..1.0f32)).collect(),
            end: if length % 2 == 0 { End::Terminated } else { End::TimeLimit },
        };
        episode.avail.chunks_exact_mut(ACTIONS).for_each(|row| row[0] = 1);
        for (row, &action) in episode.avail.chunks_exact_mut(ACTIONS).zip(&episode.actions) {
            row[usize::from(action)] = 1;
        }
        episode
    };
    lengths.iter().map(of_length).collect()
}

/// Running reward standardisation (algorithms §2.6).
struct Rewards {
    mean: f64,
    var: f64,
    count: f64,
}

impl Rewards {
    fn standardise(&mut self, rewards: &mut [Vec<f64>]) {
        let all = rewards.concat();
        let k = all.len() as f64;
        let mean = all.iter().sum::<f64>() / k;
        let var = all.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (k - 1.0);
        let (delta, count) = (mean - self.mean, self.count + k);
        self.var = (self.var * self.count + var * k + delta.powi(2) * self.count * k / count) / count;
        self.mean += delta * k / count;
        self.count = count;
        rewards.iter_mut().flatten().for_each(|r| *r = (*r - self.mean) / self.var.sqrt());
    }
}

struct Reference {
    config: Config,
    q: Parameters,
    target: Vec<Var>,
    rewards: Rewards,
    calls: u64,
    copied: u64,
}

impl Reference {
    fn of(learner: &Iql, config: &Config) -> Result<Self> {
        Ok(Self {
            config: config.clone(),
            q: Parameters::of(learner.tensors(), "q")?,
            target: Parameters::of(learner.tensors(), "target_q")?.values,
            rewards: Rewards { mean: 0.0, var: 1.0, count: 1e-4 },
            calls: 0,
            copied: 0,
        })
    }

    fn update(&mut self, episodes: &[Episode], lr: f64) -> Result<UpdateStats> {
        let b = episodes.len();
        let longest = episodes.iter().map(Episode::len).max().expect("an episode");
        let mut obs = vec![0.0f64; b * (longest + 1) * OBS];
        let mut one_hot = vec![0.0f64; b * longest * ACTIONS];
        let (mut rewards, mut mask) = (vec![vec![0.0; longest]; b], vec![vec![0.0; longest]; b]);
        for (k, e) in episodes.iter().enumerate() {
            for (i, &x) in e.obs.iter().enumerate() {
                obs[k * (longest + 1) * OBS + i] = f64::from(x);
            }
            for t in 0..e.len() {
                one_hot[(k * longest + t) * ACTIONS + usize::from(e.actions[t])] = 1.0;
                rewards[k][t] = f64::from(e.rewards[t]);
                mask[k][t] = 1.0;
            }
        }
        if self.config.reward_standardisation == Standardisation::Running {
            self.rewards.standardise(&mut rewards);
        }
        let obs = Tensor::from_vec(obs, (b, longest + 1, OBS), &Device::Cpu)?;
        let q = forward(self.config.network, &self.q.values, &obs)?;
        let online = q.to_vec3::<f64>()?;
        let target = forward(self.config.network, &self.target, &obs)?.to_vec3::<f64>()?;
        let mut y = vec![vec![0.0; longest]; b];
        for (k, e) in episodes.iter().enumerate() {
            for t in 0..e.len() {
                // Forbidden actions get −9,999,999 in both.
                let masked = |q: &[f64]| -> Vec<f64> {
                    let avail = &e.avail[(t + 1) * ACTIONS..(t + 2) * ACTIONS];
                    q.iter().zip(avail).map(|(&q, &a)| if a == 1 { q } else { -9_999_999.0 }).collect()
                };
                let (online, target) = (masked(&online[k][t + 1]), masked(&target[k][t + 1]));
                let chooser = if self.config.double_q { &online } else { &target };
                let best = (0..ACTIONS).max_by(|&i, &j| chooser[i].total_cmp(&chooser[j])).expect("actions");
                let ended = e.end == End::Terminated || self.config.time_limit_is_terminal;
                let term = if ended && t + 1 == e.len() { 1.0 } else { 0.0 };
                y[k][t] = rewards[k][t] + f64::from(self.config.gamma) * (1.0 - term) * target[best];
            }
        }
        let y = Tensor::new(y, &Device::Cpu)?;
        let mask = Tensor::new(mask, &Device::Cpu)?;
        let count = mask.sum_all()?.to_scalar::<f64>()?;
        let one_hot = Tensor::from_vec(one_hot, (b, longest, ACTIONS), &Device::Cpu)?;
        let taken = (q.narrow(1, 0, longest)? * one_hot)?.sum(D::Minus1)?;
        let error = (&mask * (&taken - &y)?)?;
        let mean = |x: Tensor| Ok::<_, candle_core::Error>(x.sum_all()?.to_scalar::<f64>()? / count);
        let loss = error.sqr()?.sum_all()?;
        let mut stats = UpdateStats {
            loss: mean(error.sqr()?)?,
            grad_norm: 0.0,
            td_error_abs: mean(error.abs()?)?,
            q_taken_mean: mean((&mask * &taken)?)?,
            target_mean: mean((&mask * &y)?)?,
        };
        let loss = (loss / (count * self.config.agents as f64))?;
        stats.grad_norm = self.q.descend(&loss, self.config.max_grad_norm, lr)?;
        self.calls += 1;
        let rule = self.config.target_update;
        update_target(rule, self.calls, &mut self.copied, &self.target, &self.q.values)?;
        Ok(stats)
    }
}

/// Eight update calls of both; each moves a parameter by up to lr = 1e-3.
fn compare(config: Config, lengths: &[usize], reward_scale: f32) {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut learner = Iql::new(config.clone(), OBS, ACTIONS, &mut rng);
    let mut reference = Reference::of(&learner, &config).expect("reference");
    let start = learner.clone();
    let lr = 1e-3;
    for call in 0..8 {
        let episodes = episodes(lengths, reward_scale, &mut rng);
        let ours = learner.update(&episodes, lr);
        let theirs = reference.update(&episodes, lr).expect("reference update");
        let pairs = [
            (ours.loss, theirs.loss),
            (ours.grad_norm, theirs.grad_norm),
            (ours.td_error_abs, theirs.td_error_abs),
            (ours.q_taken_mean, theirs.q_taken_mean),
            (ours.target_mean, theirs.target_mean),
        ];
        for (a, b) in pairs {
            assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "call {call}: {ours:?}, expected {theirs:?}");
        }
        for (owner, values) in [("q", &reference.q.values), ("target_q", &reference.target)] {
            let (largest, mean) = distance(learner.tensors(), owner, values).expect("same shapes");
            // As for PPO: Adam turns a gradient that is only a rounding error into a whole step.
            assert!(
                mean < 2e-6 && largest < 1e-4,
                "{owner} after call {call}: mean {mean:e}, largest {largest:e}"
            );
        }
    }
    let moved = start.tensors().iter().zip(learner.tensors()).any(|(a, b)| a.2[0] != b.2[0]);
    assert!(moved, "the comparison is of learners that learn");
}

#[test]
fn a_feed_forward_learner_follows_the_plain_reference() {
    compare(config(Kind::Fc), &[6, 9, 3, 9, 1], 1.0);
}

#[test]
fn a_recurrent_learner_follows_the_plain_reference_through_episodes_of_all_lengths() {
    compare(config(Kind::Gru), &[6, 9, 3, 9, 1, 8], 1.0);
}

#[test]
fn minibatches_of_several_parts_follow_the_plain_reference() {
    // More rows than a part of a feed-forward batch has, more episodes than one of a recurrent batch.
    let lengths: Vec<usize> = (0..90).map(|k| 1 + (k * 7) % 13).collect();
    compare(config(Kind::Fc), &lengths, 1.0);
    compare(config(Kind::Gru), &lengths[..37], 1.0);
}

#[test]
fn step_limits_that_are_no_terminations_and_single_q_learning_follow_the_plain_reference() {
    compare(Config { time_limit_is_terminal: false, ..config(Kind::Gru) }, &[7, 4, 7, 1], 1.0);
    compare(Config { double_q: false, ..config(Kind::Fc) }, &[7, 4, 7, 1], 1.0);
}

#[test]
fn polyak_targets_and_clipped_gradients_follow_the_plain_reference() {
    // Rewards of this size give gradients far over the norm of 10, times 1/n.
    compare(Config { target_update: 0.01, ..config(Kind::Gru) }, &[5, 7, 7], 500.0);
}

#[test]
fn standardised_rewards_follow_the_plain_reference() {
    for network in [Kind::Fc, Kind::Gru] {
        let config = Config { reward_standardisation: Standardisation::Running, ..config(network) };
        compare(config, &[5, 2, 8], 30.0);
    }
}
