//! Independent Q-learning, one learner per agent. Steps and symbols are those of algorithms §5.2.
//!
//! ```text
//! q  = Q(o_0 … o_T)     q̄ = Q̄(o_0 … o_T)                     each with its own recurrent state, from zero
//! a* = argmax over available a of q[t+1, a]                  double Q; otherwise of q̄[t+1, a]
//! y  = r + γ (1 − term) q̄[t+1, a*]                           a constant
//! loss = Σ m (q[t, a_t] − y)² / Σ m                          clip, Adam
//! target update (algorithms §4.4)
//! ```
//!
//! As in [`crate::ppo`] the gradient has the factor `1/n` (algorithms §3.3), and the clipped norm is that of this agent
//! only (algorithms §6.4).
//!
//! The minibatch goes through the networks in parts that fit the cache; the gradients of the parts add up.
//!
//! The caller chooses the episodes of an update call ([`sample_distinct`], algorithms §5.1) and its learning rate, and
//! with it the timescale (algorithms §6). Absent on purpose: a Huber loss, targets of several steps, prioritised
//! replay, importance weights, RMSProp.

mod batch;
mod draws;

use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::acting::Acting;
use crate::adam::Adam;
use crate::device::Device;
use crate::host::{Host, Seconds, Stopwatch};
use crate::network::{Activations, Kind, Network};
use crate::params::initial;
use crate::reward_stats::{RewardStats, Standardisation};
use crate::rollout::Episode;
use crate::saved::{self, NamedTensor, RestoreError, Vector};
use crate::target;
use batch::{Batch, Part};

pub use draws::{epsilon, sample_distinct};

/// Value of unavailable actions in a target (algorithms §3.1). It matters only if no action is available.
const FORBIDDEN: f32 = -9_999_999.0;

/// Hyperparameters of one learner; defaults and sources are in algorithms §5, §9.2.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Shape of the network.
    pub network: Kind,
    /// Its hidden width, `H`.
    pub hidden: usize,
    /// Number of learning agents, `n`.
    pub agents: usize,
    /// Discount, γ.
    pub gamma: f32,
    /// Above 1: a hard copy every that many update calls. Otherwise Polyak's τ.
    pub target_update: f64,
    /// Largest L2 norm of the gradient.
    pub max_grad_norm: f64,
    /// Reward standardisation.
    pub reward_standardisation: Standardisation,
    /// At learning rate 0 Adam's moments do not change (`hold`) instead of following the gradient (algorithms §6.4).
    pub hold_frozen_moments: bool,
    /// An end by the step limit counts as a termination (algorithms §3.4): the last target is the reward alone.
    pub time_limit_is_terminal: bool,
    /// The online network chooses the action of a target, not the target network.
    pub double_q: bool,
}

/// What one update call reports: means over the steps of its minibatch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpdateStats {
    /// `Σ m (q − y)² / Σ m`, this agent's own mean.
    pub loss: f64,
    /// L2 norm of the gradient before clipping.
    pub grad_norm: f64,
    /// Mean of `|q − y|`.
    pub td_error_abs: f64,
    /// Mean of `q[t, a_t]`.
    pub q_taken_mean: f64,
    /// Mean of `y`.
    pub target_mean: f64,
}

/// The part of a checkpoint that is not a tensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Update calls completed.
    pub update_calls: u64,
    /// Value of `update_calls` at the last hard copy of the target network.
    pub last_target_copy: u64,
    /// Adam steps.
    pub adam_steps: u64,
    /// Running reward statistics.
    pub reward_stats: RewardStats,
}

/// One agent's learner: Q network, target Q network and optimiser.
#[derive(Clone, Debug)]
pub struct Iql {
    config: Config,
    network: Network,
    values: Vec<f32>,
    target_values: Vec<f32>,
    adam: Adam,
    reward_stats: RewardStats,
    update_calls: u64,
    last_target_copy: u64,
    acting: Acting,
    work: Work,
    host: Host,
    seconds: Seconds,
}

/// Buffers of an update call, reused by the next one.
#[derive(Clone, Debug, Default)]
struct Work {
    batch: Batch,
    part: Part,
    activations: Activations,
    /// q̄ of the part, `rows × n_actions`.
    target_q: Vec<f32>,
    d_q: Vec<f32>,
    gradient: Vec<f32>,
}

impl Iql {
    /// A new learner. `rng` draws the initial weights (algorithms §1.3); the target network starts with the same ones.
    pub fn new(config: Config, obs_size: usize, n_actions: usize, rng: &mut impl Rng) -> Self {
        let network =
            Network { kind: config.network, inputs: obs_size, hidden: config.hidden, outputs: n_actions };
        let values = initial(&network.blocks(), rng);
        Self {
            adam: Adam::new(values.len()),
            target_values: values.clone(),
            reward_stats: RewardStats::default(),
            update_calls: 0,
            last_target_copy: 0,
            acting: Acting::default(),
            work: Work { gradient: vec![0.0; values.len()], ..Work::default() },
            host: Host::default(),
            seconds: Seconds::default(),
            config,
            network,
            values,
        }
    }

    /// Computes the passes of the networks on `device` from now on. The caller must call [`Device::check`] before it
    /// uses the result of an update call or an action.
    pub fn compute_on(&mut self, device: &Device) {
        self.acting.compute_on(device);
        self.work.activations.on = device.passes();
        self.work.batch.part_size = device.part_size();
    }

    /// Uses this clock from now on.
    pub fn run_on(&mut self, host: Host) {
        self.host = host;
    }

    /// Seconds so far.
    pub fn seconds(&self) -> Seconds {
        self.seconds
    }

    /// Update calls completed, the `u` of the schedule.
    pub fn update_calls(&self) -> u64 {
        self.update_calls
    }

    /// Starts an episode in each of `copies` environment copies: recurrent states are zero.
    pub fn begin_round(&mut self, copies: usize) {
        self.acting.begin(copies, self.config.hidden);
    }

    /// Chooses one available action for each row, ε-greedily, with a separate coin for each row.
    ///
    /// Row `k` shows environment copy `copies[k]`: `obs` is `rows × obs_size`, `avail` is
    /// `rows × n_actions`. Draws the same number of values from `rng` for every row and every `epsilon`.
    pub fn act(
        &mut self,
        copies: &[u16],
        obs: &[f32],
        avail: &[u8],
        epsilon: f64,
        rng: &mut impl Rng,
        actions: &mut Vec<u16>,
    ) {
        let n_actions = self.network.outputs;
        // Also for random actions: the recurrent state has to follow every observation.
        let mut watch = Stopwatch::start(self.host);
        let out = self.acting.step(&self.network, &self.values, copies, obs);
        watch.lap(&mut self.seconds.acting);
        actions.clear();
        for (q, avail) in out.chunks_exact(n_actions).zip(avail.chunks_exact(n_actions)) {
            actions.push(draws::epsilon_greedy(q, avail, epsilon, rng) as u16);
        }
        watch.lap(&mut self.seconds.choosing);
    }

    /// One update call on a minibatch, with learning rate `lr`.
    ///
    /// # Panics
    /// If there is no episode, or one without steps.
    pub fn update(&mut self, episodes: &[Episode], lr: f64) -> UpdateStats {
        assert!(!episodes.is_empty(), "an update call has episodes to learn from");
        let Work { batch, part, activations: to, target_q, d_q, gradient } = &mut self.work;
        let (mut watch, seconds) = (Stopwatch::start(self.host), &mut self.seconds);
        batch.begin(episodes, &self.network);
        self.reward_stats.standardise(self.config.reward_standardisation, &mut batch.rewards);

        let mut stats = UpdateStats::default();
        gradient.fill(0.0);
        for k in 0..batch.parts.len() {
            part.fill(batch, k, episodes, &self.network, self.config.time_limit_is_terminal);
            watch.lap(&mut seconds.layout);
            // The target network first: the buffers must hold the online network's activations for the backward pass.
            self.network.forward(&self.target_values, &part.obs, &part.steps, to);
            std::mem::swap(&mut to.out, target_q);
            self.network.forward(&self.values, &part.obs, &part.steps, to);
            watch.lap(&mut seconds.forward);
            self.config.temporal_differences(part, batch.count, &to.out, target_q, d_q, &mut stats);
            watch.lap(&mut seconds.loss);
            self.network.backward(&self.values, &part.obs, &part.steps, d_q, to, gradient);
            watch.lap(&mut seconds.backward);
        }
        let Config { max_grad_norm, hold_frozen_moments, .. } = self.config;
        stats.grad_norm =
            self.adam.clipped_step(&mut self.values, gradient, max_grad_norm, lr, hold_frozen_moments);

        self.update_calls += 1;
        let (rule, target) = (self.config.target_update, &mut self.target_values);
        target::update(rule, self.update_calls, &mut self.last_target_copy, target, &self.values);
        watch.lap(&mut seconds.optimiser);
        stats
    }

    /// All tensors of the learner, named; those of the optimiser start with `adam.`.
    pub fn tensors(&self) -> Vec<NamedTensor<'_>> {
        saved::tensors(&self.vectors())
    }

    /// The first of [`Self::tensors`] with an infinite number or NaN, and that number.
    pub fn first_not_finite(&self) -> Option<(String, f32)> {
        saved::first_not_finite(&self.vectors())
    }

    fn vectors(&self) -> [Vector<'_>; 4] {
        [
            ("q", &self.network, &self.values),
            ("target_q", &self.network, &self.target_values),
            ("adam.q.m", &self.network, &self.adam.m),
            ("adam.q.v", &self.network, &self.adam.v),
        ]
    }

    /// The small part of a checkpoint.
    pub fn counters(&self) -> Counters {
        Counters {
            update_calls: self.update_calls,
            last_target_copy: self.last_target_copy,
            adam_steps: self.adam.steps,
            reward_stats: self.reward_stats,
        }
    }

    /// Restores a saved learner; `tensor` returns the numbers of a name.
    ///
    /// # Errors
    /// If a tensor is missing or has another size; this learner is then unchanged.
    pub fn restore<'a>(
        &mut self,
        counters: &Counters,
        tensor: impl Fn(&str) -> Option<&'a [f32]>,
    ) -> Result<(), RestoreError> {
        let [values, target, m, v] = saved::restored(self.vectors(), tensor)?;
        (self.values, self.target_values) = (values, target);
        self.adam = Adam { m, v, steps: counters.adam_steps };
        self.reward_stats = counters.reward_stats;
        self.update_calls = counters.update_calls;
        self.last_target_copy = counters.last_target_copy;
        Ok(())
    }
}

impl Config {
    /// Writes the gradient of the loss with respect to `q` into `d_q`. Both are `rows × n_actions`, like `target_q`.
    /// Adds the part's share to `stats`. `count`: `Σ m` of the whole minibatch.
    ///
    /// ```text
    /// ∂L/∂q[t, a_t] = 2 (q − y) / (n Σ m), and 0 elsewhere
    /// ```
    fn temporal_differences(
        &self,
        part: &Part,
        count: usize,
        q: &[f32],
        target_q: &[f32],
        d_q: &mut Vec<f32>,
        stats: &mut UpdateStats,
    ) {
        let n_actions = q.len() / part.steps.rows();
        let count = count as f64;
        let scale = (2.0 / (count * self.agents as f64)) as f32;
        d_q.clear();
        d_q.resize(q.len(), 0.0);
        let mut sum = UpdateStats::default();
        for step in &part.transitions {
            let taken = step.row * n_actions + usize::from(step.action);
            let mut y = step.reward;
            if !step.terminal {
                let next = step.next * n_actions..(step.next + 1) * n_actions;
                let chooser = if self.double_q { q } else { target_q };
                let best = draws::greedy(&chooser[next.clone()], &part.avail[next.clone()]);
                let allowed = part.avail[next.start + best] != 0;
                y += self.gamma * if allowed { target_q[next.start + best] } else { FORBIDDEN };
            }
            let error = q[taken] - y;
            d_q[taken] = scale * error;
            sum.loss += f64::from(error) * f64::from(error);
            sum.td_error_abs += f64::from(error.abs());
            sum.q_taken_mean += f64::from(q[taken]);
            sum.target_mean += f64::from(y);
        }
        stats.loss += sum.loss / count;
        stats.td_error_abs += sum.td_error_abs / count;
        stats.q_taken_mean += sum.q_taken_mean / count;
        stats.target_mean += sum.target_mean / count;
    }
}

#[cfg(test)]
mod tests;
