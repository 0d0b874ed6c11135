//! PPO against a slow implementation of the equations of algorithms §4.1: dense `B × T` tensors with masks, double
//! precision, candle's automatic differentiation, none of our kernels.

use algos::host::Host;
use algos::learner::{Choice, Learner, OnPolicy};
use algos::network::Kind;
use algos::ppo::{Config, Ppo};
use algos::returns::EndOfBatch;
use algos::reward_stats::Standardisation;
use algos::rollout::{End, Rollout};
use candle_core::{Device, Result, Tensor, Var, D};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

mod plain;
use plain::{distance, forward, update_target, Parameters};

const OBS: usize = 5;
const ACTIONS: usize = 4;

fn config(actor: Kind) -> Config {
    Config {
        actor,
        hidden: 16,
        agents: 3,
        gamma: 0.97,
        epochs: 4,
        clip: 0.2,
        entropy_coef: 0.01,
        n_step: 3,
        target_update: 2.0,
        max_grad_norm: 10.0,
        end_of_batch: EndOfBatch::Epymarl,
        reward_standardisation: Standardisation::Off,
        hold_frozen_moments: false,
    }
}

/// Plays `lengths.len()` episodes of these lengths with random observations, masks and rewards.
fn play(learner: &mut Ppo, lengths: &[usize], reward_scale: f32, rng: &mut ChaCha8Rng) -> Rollout {
    let mut rollout = Rollout::default();
    rollout.begin(lengths.len());
    learner.begin_round(lengths.len());
    let longest = *lengths.iter().max().expect("an episode");
    let mut actions = Vec::new();
    for t in 0..=longest {
        let (mut copies, mut all_obs, mut all_avail) = (Vec::new(), Vec::new(), Vec::new());
        for (copy, &length) in lengths.iter().enumerate().filter(|(_, &length)| t <= length) {
            if t > 0 {
                let end = if t == length { End::Terminated } else { End::Running };
                rollout.outcome(copy, reward_scale * rng.random_range(-1.0..1.0f32), end);
            }
            let obs: Vec<f32> = (0..OBS).map(|_| rng.random_range(-1.0..1.0)).collect();
            let mut avail: Vec<u8> = (0..ACTIONS).map(|_| rng.random_range(0..4u8).min(1)).collect();
            avail[0] = 1;
            rollout.observe(copy, &obs, &avail);
            if t < length {
                copies.push(copy as u16);
                all_obs.extend(obs);
                all_avail.extend(avail);
            }
        }
        if t < longest {
            learner.act(&copies, &all_obs, &all_avail, Choice::Sample, rng, &mut actions);
            for (&copy, &action) in copies.iter().zip(&actions) {
                rollout.act(usize::from(copy), action);
            }
        }
    }
    rollout
}

/// Dense arrays of a round (algorithms §2): `B` episodes, `T + 1` slots, zeros and mask 0 after the end.
struct Dense {
    obs: Tensor,
    avail: Tensor,
    one_hot: Tensor,
    rewards: Vec<Vec<f64>>,
    mask: Vec<Vec<f64>>,
}

fn dense(rollout: &Rollout) -> Result<Dense> {
    let longest = rollout.episodes().iter().map(|e| e.len()).max().expect("an episode");
    let b = rollout.episodes().len();
    let mut obs = vec![0.0f64; b * (longest + 1) * OBS];
    let mut avail = vec![1.0f64; b * longest * ACTIONS];
    let mut one_hot = vec![0.0f64; b * longest * ACTIONS];
    let (mut rewards, mut mask) = (vec![vec![0.0; longest]; b], vec![vec![0.0; longest]; b]);
    for (k, e) in rollout.episodes().iter().enumerate() {
        for (i, &x) in e.obs.iter().enumerate() {
            obs[k * (longest + 1) * OBS + i] = f64::from(x);
        }
        for t in 0..e.len() {
            for a in 0..ACTIONS {
                avail[(k * longest + t) * ACTIONS + a] = f64::from(e.avail[t * ACTIONS + a]);
            }
            one_hot[(k * longest + t) * ACTIONS + usize::from(e.actions[t])] = 1.0;
            rewards[k][t] = f64::from(e.rewards[t]);
            mask[k][t] = 1.0;
        }
    }
    Ok(Dense {
        obs: Tensor::from_vec(obs, (b, longest + 1, OBS), &Device::Cpu)?,
        avail: Tensor::from_vec(avail, (b, longest, ACTIONS), &Device::Cpu)?,
        one_hot: Tensor::from_vec(one_hot, (b, longest, ACTIONS), &Device::Cpu)?,
        rewards,
        mask,
    })
}

/// The formula of algorithms §4.3.
fn returns(rewards: &[f64], mask: &[f64], values: &[f64], n: usize, gamma: f64) -> Vec<f64> {
    let batch_length = rewards.len();
    (0..batch_length)
        .map(|t| {
            let k_end = n.min(batch_length - t);
            let mut g: f64 = (0..k_end).map(|k| gamma.powi(k as i32) * mask[t + k] * rewards[t + k]).sum();
            if t + n < batch_length {
                g += gamma.powi(n as i32) * mask[t + n] * values[t + n];
            } else {
                g += gamma.powi((batch_length - t) as i32) * values[batch_length];
            }
            g
        })
        .collect()
}

struct Reference {
    config: Config,
    actor: Parameters,
    critic: Parameters,
    target: Vec<Var>,
    calls: u64,
    copied: u64,
}

impl Reference {
    fn of(learner: &Ppo, config: &Config) -> Result<Self> {
        Ok(Self {
            config: config.clone(),
            actor: Parameters::of(learner.tensors(), "actor")?,
            critic: Parameters::of(learner.tensors(), "critic")?,
            target: Parameters::of(learner.tensors(), "target_critic")?.values,
            calls: 0,
            copied: 0,
        })
    }

    fn log_pi(&self, data: &Dense) -> Result<(Tensor, Tensor)> {
        let t = data.avail.dim(1)?;
        let logits = forward(self.config.actor, &self.actor.values, &data.obs.narrow(1, 0, t)?)?;
        // Forbidden logits become −1e10.
        let logits = ((logits * &data.avail)? + ((&data.avail - 1.0)? * 1e10)?)?;
        let pi = candle_nn::ops::softmax(&logits, D::Minus1)?;
        let log_pi = (&pi + 1e-10)?.log()?;
        Ok((pi, log_pi))
    }

    fn update(&mut self, rollout: &Rollout, lr: f64) -> Result<()> {
        let data = dense(rollout)?;
        let (b, t, _) = data.avail.dims3()?;
        let mask = Tensor::new(data.mask.clone(), &Device::Cpu)?;
        let count = mask.sum_all()?.to_scalar::<f64>()? * self.config.agents as f64;
        let eps = f64::from(self.config.clip);
        let log_p = |log_pi: &Tensor| (log_pi * &data.one_hot)?.sum(D::Minus1);
        let p_old = log_p(&self.log_pi(&data)?.1)?.detach();
        for _ in 0..self.config.epochs {
            let values = forward(Kind::Fc, &self.target, &data.obs)?.reshape((b, t + 1))?.to_vec2::<f64>()?;
            let g: Vec<Vec<f64>> = (0..b)
                .map(|k| {
                    let gamma = f64::from(self.config.gamma);
                    returns(&data.rewards[k], &data.mask[k], &values[k], self.config.n_step, gamma)
                })
                .collect();
            let g = Tensor::new(g, &Device::Cpu)?;
            let obs = data.obs.narrow(1, 0, t)?;
            let v = forward(Kind::Fc, &self.critic.values, &obs)?.reshape((b, t))?;
            let adv = (&mask * (&g - &v)?)?.detach();
            let loss = ((&mask * (&g - &v)?.sqr()?)?.sum_all()? / count)?;
            self.critic.descend(&loss, self.config.max_grad_norm, lr)?;

            let (pi, log_pi) = self.log_pi(&data)?;
            let rho = (log_p(&log_pi)? - &p_old)?.exp()?;
            let s = (&rho * &adv)?.minimum(&(rho.clamp(1.0 - eps, 1.0 + eps)? * &adv)?)?;
            let entropy = (pi * &log_pi)?.sum(D::Minus1)?.neg()?;
            let objective = (s + (entropy * f64::from(self.config.entropy_coef))?)?;
            let loss = ((&mask * objective)?.sum_all()?.neg()? / count)?;
            self.actor.descend(&loss, self.config.max_grad_norm, lr)?;
        }
        self.calls += 1;
        let rule = self.config.target_update;
        update_target(rule, self.calls, &mut self.copied, &self.target, &self.critic.values)
    }
}

/// Five update calls of both; each moves a parameter by up to 4 epochs × lr = 4e-3.
fn compare(config: Config, lengths: &[usize], reward_scale: f32) {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut learner = Ppo::new(config.clone(), OBS, ACTIONS, &mut rng);
    let mut reference = Reference::of(&learner, &config).expect("reference");
    let start = learner.clone();
    let lr = 1e-3;
    for call in 0..5 {
        let rollout = play(&mut learner, lengths, reward_scale, &mut rng);
        learner.update(rollout.episodes(), lr);
        reference.update(&rollout, lr).expect("reference update");
        let parts = [
            ("actor", &reference.actor.values),
            ("critic", &reference.critic.values),
            ("target_critic", &reference.target),
        ];
        for (owner, values) in parts {
            let (largest, mean) = distance(learner.tensors(), owner, values).expect("same shapes");
            // Adam turns a gradient that is only a rounding error into a whole step, so single parameters may differ by
            // more than the rounding of an addition.
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

/// More than one part of a batch holds: 512 rows, 16 episodes.
fn many(episodes: usize) -> Vec<usize> {
    (0..episodes).map(|k| 1 + (k * 7) % 13).collect()
}

#[test]
fn batches_of_several_parts_follow_the_plain_reference_too() {
    compare(config(Kind::Fc), &many(120), 1.0);
    compare(config(Kind::Gru), &many(37), 1.0);
}

#[test]
fn polyak_targets_and_clipped_gradients_follow_the_plain_reference() {
    // Rewards of this size give gradients far over the norm of 10, times 1/n.
    compare(Config { target_update: 0.01, ..config(Kind::Gru) }, &[5, 7, 7], 500.0);
}

#[test]
fn actor_and_critic_that_learn_at_once_come_to_the_same_bits() {
    let at_once = |first: &mut (dyn FnMut() + Send), second: &mut (dyn FnMut() + Send)| {
        std::thread::scope(|threads| {
            threads.spawn(first);
            second();
        });
    };
    for kind in [Kind::Fc, Kind::Gru] {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut learner = Ppo::new(config(kind), OBS, ACTIONS, &mut rng);
        let mut other = learner.clone();
        other.run_on(Host { both: at_once, ..Host::default() });
        for _ in 0..3 {
            let rollout = play(&mut learner, &many(60), 1.0, &mut rng);
            assert_eq!(learner.update(rollout.episodes(), 1e-3), other.update(rollout.episodes(), 1e-3));
            assert_eq!(learner.tensors(), other.tensors());
        }
    }
}

#[test]
fn initial_weights_have_the_spread_of_the_uniform_distribution() {
    // Standard deviation 1 / sqrt(3 fan_in), bounds ±1 / sqrt(fan_in) (algorithms §1.3, §12).
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let config = Config { hidden: 128, ..config(Kind::Gru) };
    let learner = Ppo::new(config, 12, 6, &mut rng);
    let fan_in = |name: &str| if name.contains("fc1") { 12.0f64 } else { 128.0 };
    let mut checked = 0;
    for (name, _, data) in learner.tensors() {
        if name.starts_with("adam.") {
            assert!(data.iter().all(|&x| x == 0.0), "{name} starts at zero");
        } else if data.len() >= 300 {
            let bound = 1.0 / fan_in(&name).sqrt();
            let n = data.len() as f64;
            let mean = data.iter().map(|&x| f64::from(x)).sum::<f64>() / n;
            let deviation = (data.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>() / n).sqrt();
            let expected = bound / 3.0f64.sqrt();
            assert!(data.iter().all(|&x| f64::from(x).abs() <= bound), "{name}");
            assert!((deviation / expected - 1.0).abs() < 4.0 / n.sqrt(), "{name}: {deviation} {expected}");
            assert!(mean.abs() < 4.0 * expected / n.sqrt(), "{name}: mean {mean}");
            checked += 1;
        }
    }
    assert!(checked >= 8, "{checked} tensors checked");
}

#[test]
fn target_critic_starts_as_an_exact_copy() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let learner = Ppo::new(config(Kind::Fc), OBS, ACTIONS, &mut rng);
    let of = |owner: &str| -> Vec<f32> {
        let tensors = learner.tensors();
        tensors.iter().filter(|(n, ..)| n.starts_with(owner)).flat_map(|(_, _, d)| d.to_vec()).collect()
    };
    assert_eq!(of("critic."), of("target_critic."));
}

#[test]
fn a_frozen_agent_keeps_its_weights_while_its_moments_follow_the_option() {
    // Check 3 of algorithms §12.
    for hold in [false, true] {
        let config = Config { hold_frozen_moments: hold, target_update: 200.0, ..config(Kind::Gru) };
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut learner = Ppo::new(config, OBS, ACTIONS, &mut rng);
        let before = learner.clone();
        for _ in 0..3 {
            let rollout = play(&mut learner, &[4, 6], 1.0, &mut rng);
            learner.update(rollout.episodes(), 0.0);
        }
        for (old, new) in before.tensors().iter().zip(learner.tensors()) {
            let moments = new.0.starts_with("adam.");
            let same = old.2.iter().zip(new.2).all(|(a, b)| a.to_bits() == b.to_bits());
            assert_eq!(same, !moments || hold, "{} with hold = {hold}", new.0);
        }
        assert_eq!(learner.update_calls(), 3);
    }
}

#[test]
fn a_restored_learner_goes_on_with_the_same_bits() {
    let config = Config { reward_standardisation: Standardisation::Running, ..config(Kind::Gru) };
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut learner = Ppo::new(config.clone(), OBS, ACTIONS, &mut rng);
    let first = play(&mut learner, &[4, 6], 1.0, &mut rng);
    learner.update(first.episodes(), 1e-3);
    let counters = learner.counters();
    let saved: Vec<(String, Vec<f32>)> =
        learner.tensors().into_iter().map(|(n, _, d)| (n, d.to_vec())).collect();

    let mut other = Ppo::new(config, OBS, ACTIONS, &mut ChaCha8Rng::seed_from_u64(99));
    let find = |name: &str| saved.iter().find(|(n, _)| n == name).map(|(_, d)| d.as_slice());
    other.restore(&counters, find).expect("it fits");
    let second = play(&mut learner, &[5, 5], 1.0, &mut rng);
    assert_eq!(learner.update(second.episodes(), 1e-3), other.update(second.episodes(), 1e-3));
    assert_eq!(learner.tensors(), other.tensors());
    assert_eq!(learner.counters(), other.counters());

    let lost = other.restore(&counters, |name| find(name).filter(|_| name != "critic.head.bias"));
    assert!(lost.expect_err("refused").to_string().contains("critic.head.bias"));
}
