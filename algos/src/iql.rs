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

use crate::adam::Adam;
use crate::device::Device;
use crate::host::{Host, Seconds};
use crate::learner::{Learner, OffPolicy, Scalars};
use crate::network::{Kind, Network};
use crate::reward_stats::{RewardStats, Standardisation};
use crate::rollout::Episode;
use crate::saved::{self, NamedTensor, RestoreError, Vector};
use crate::target;
use crate::trained::{Descent, Trained};
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
    q: Trained,
    target_values: Vec<f32>,
    reward_stats: RewardStats,
    update_calls: u64,
    last_target_copy: u64,
    // Buffers of an update call, allocated once.
    batch: Batch,
    part: Part,
    /// q̄ of the part, `rows × n_actions`.
    target_q: Vec<f32>,
    d_q: Vec<f32>,
}

impl Iql {
    /// A new learner. `rng` draws the initial weights (algorithms §1.3), which the target network shares.
    pub fn new(config: Config, obs_size: usize, n_actions: usize, rng: &mut impl Rng) -> Self {
        let network =
            Network { kind: config.network, inputs: obs_size, hidden: config.hidden, outputs: n_actions };
        let q = Trained::new(network, rng);
        Self {
            target_values: q.values.clone(),
            reward_stats: RewardStats::default(),
            update_calls: 0,
            last_target_copy: 0,
            batch: Batch::default(),
            part: Part::default(),
            target_q: Vec::new(),
            d_q: Vec::new(),
            config,
            q,
        }
    }

    /// One update call on a minibatch, with learning rate `lr`.
    ///
    /// # Panics
    /// If there is no episode, or one without steps.
    pub fn update(&mut self, episodes: &[Episode], lr: f64) -> UpdateStats {
        assert!(!episodes.is_empty(), "an update call has episodes to learn from");
        let Self { config, q, target_values, batch, part, target_q, d_q, .. } = self;
        q.begin_update();
        batch.begin(episodes, &q.network);
        self.reward_stats.standardise(config.reward_standardisation, &mut batch.rewards);

        let mut stats = UpdateStats::default();
        for k in 0..batch.parts.len() {
            part.fill(batch, k, episodes, &q.network, config.time_limit_is_terminal);
            // The target network first: the backward pass needs the activations of the other one.
            q.forward_with(target_values, &part.obs, &part.steps);
            std::mem::swap(&mut q.activations.out, target_q);
            q.forward(&part.obs, &part.steps);
            config.temporal_differences(part, batch.count, q.out(), target_q, d_q, &mut stats);
            q.backward(&part.obs, &part.steps, d_q);
        }
        let Config { max_grad_norm, hold_frozen_moments, target_update, .. } = *config;
        stats.grad_norm = q.descend(Descent { lr, max_grad_norm, hold_frozen_moments });

        self.update_calls += 1;
        target::update(
            target_update,
            self.update_calls,
            &mut self.last_target_copy,
            target_values,
            &q.values,
        );
        stats
    }

    fn vectors(&self) -> [Vector<'_>; 4] {
        let Self { q, target_values, .. } = self;
        [
            ("q", &q.network, &q.values),
            ("target_q", &q.network, target_values),
            ("adam.q.m", &q.network, &q.adam.m),
            ("adam.q.v", &q.network, &q.adam.v),
        ]
    }
}

impl Learner for Iql {
    const KIND: &'static str = "Q";

    type Counters = Counters;

    fn compute_on(&mut self, device: &Device) {
        self.q.compute_on(device);
        self.batch.part_size = device.part_size();
    }

    fn run_on(&mut self, host: Host) {
        self.q.run_on(host);
    }

    fn seconds(&self) -> Seconds {
        self.q.seconds()
    }

    fn update_calls(&self) -> u64 {
        self.update_calls
    }

    fn begin_round(&mut self, copies: usize) {
        self.q.begin_round(copies);
    }

    fn learn(&mut self, episodes: &[Episode], lr: f64) -> Scalars {
        let stats = self.update(episodes, lr);
        vec![
            ("loss", stats.loss),
            ("grad_norm", stats.grad_norm),
            ("td_error_abs", stats.td_error_abs),
            ("q_taken_mean", stats.q_taken_mean),
            ("target_mean", stats.target_mean),
        ]
    }

    fn tensors(&self) -> Vec<NamedTensor<'_>> {
        saved::tensors(&self.vectors())
    }

    fn first_not_finite(&self) -> Option<(String, f32)> {
        saved::first_not_finite(&self.vectors())
    }

    fn counters(&self) -> Counters {
        Counters {
            update_calls: self.update_calls,
            last_target_copy: self.last_target_copy,
            adam_steps: self.q.adam.steps,
            reward_stats: self.reward_stats,
        }
    }

    fn restore<'a>(
        &mut self,
        counters: &Counters,
        tensor: impl Fn(&str) -> Option<&'a [f32]>,
    ) -> Result<(), RestoreError> {
        let [values, target, m, v] = saved::restored(self.vectors(), tensor)?;
        (self.q.values, self.target_values) = (values, target);
        self.q.adam = Adam { m, v, steps: counters.adam_steps };
        self.reward_stats = counters.reward_stats;
        self.update_calls = counters.update_calls;
        self.last_target_copy = counters.last_target_copy;
        Ok(())
    }
}

impl OffPolicy for Iql {
    fn act(
        &mut self,
        copies: &[u16],
        obs: &[f32],
        avail: &[u8],
        epsilon: f64,
        rng: &mut impl Rng,
        actions: &mut Vec<u16>,
    ) {
        let n_actions = self.q.network.outputs;
        // Also for random actions: the recurrent state has to follow every observation.
        let q = self.q.act(copies, obs);
        actions.clear();
        for (q, avail) in q.chunks_exact(n_actions).zip(avail.chunks_exact(n_actions)) {
            actions.push(draws::epsilon_greedy(q, avail, epsilon, rng) as u16);
        }
        self.q.has_chosen();
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
