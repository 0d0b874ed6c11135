//! The critic and its target: returns, and the step on values.

use rand::Rng;

use super::batch::{Batch, Part, Step};
use super::{Config, UpdateStats};
use crate::kernels::gru::Steps;
use crate::network::Network;
use crate::rollout::Episode;
use crate::target;
use crate::trained::{Descent, Trained};

#[derive(Clone, Debug)]
pub struct Critic {
    pub value: Trained,
    pub target_values: Vec<f32>,
    /// Update call of the last hard copy of the target.
    pub last_target_copy: u64,
    /// Sums over the epochs of an update call.
    pub stats: UpdateStats,
    // Buffers of an update call, allocated once.
    part: Part,
    d_values: Vec<f32>,
}

impl Critic {
    pub fn new(network: Network, rng: &mut impl Rng) -> Self {
        let value = Trained::new(network, rng);
        Self {
            target_values: value.values.clone(),
            last_target_copy: 0,
            stats: UpdateStats::default(),
            part: Part::default(),
            d_values: Vec::new(),
            value,
        }
    }

    /// Begins an update call: the target critic's values and, from them, `G` of every step. Both are the same in all
    /// epochs.
    pub fn compute_returns(&mut self, config: &Config, batch: &mut Batch, episodes: &[Episode]) {
        let Self { value, target_values, part, stats, .. } = self;
        *stats = UpdateStats::default();
        value.begin_update();
        let inputs = value.network.inputs;
        value.forward_with(target_values, &vec![0.0; inputs], &Steps::of_lengths(&[1]));
        let padding = value.out()[0];
        for k in 0..batch.parts.len() {
            part.fill_observations(batch, k, episodes, inputs);
            value.forward_with(target_values, &part.obs, &part.steps);
            batch.place_values(part, value.out(), padding);
        }
        batch.compute_returns(episodes, config.n_step, config.gamma, config.end_of_batch);
    }

    /// `A = G − V` of a part's rows.
    pub fn advantages(
        &mut self,
        config: &Config,
        batch: &Batch,
        episodes: &[Episode],
        step: Step,
    ) -> Vec<f32> {
        let Self { value, part, d_values, stats, .. } = self;
        part.fill(batch, step.part, episodes, value.network.inputs);
        value.forward(&part.obs, &part.steps);
        let advantages: Vec<f32> = part.returns.iter().zip(value.out()).map(|(g, v)| g - v).collect();
        let rows = batch.rows as f64;
        // dL/dV = 2 (V − G) / (n Σ m)
        let scale = (2.0 / (rows * config.agents as f64)) as f32;
        d_values.clear();
        d_values.extend(advantages.iter().map(|a| -a * scale));
        let mean = |f: &dyn Fn(f64) -> f64, x: &[f32]| x.iter().map(|&x| f(f64::from(x))).sum::<f64>() / rows;
        stats.critic_loss += mean(&|a| a * a, &advantages);
        stats.advantage_mean += mean(&|a| a, &advantages);
        stats.target_mean += mean(&|g| g, &part.returns);
        advantages
    }

    /// Adds the gradient of the part's share of the critic loss. The last part of an epoch makes the step of Adam.
    pub fn descend(&mut self, step: Step, by: Descent) {
        let Self { value, part, d_values, stats, .. } = self;
        value.backward(&part.obs, &part.steps, d_values);
        if step.ends_epoch {
            stats.critic_grad_norm += value.descend(by);
        }
    }

    /// Updates the target after update call number `update_calls`.
    pub fn update_target(&mut self, config: &Config, update_calls: u64) {
        let (last_copy, values) = (&mut self.last_target_copy, &self.value.values);
        target::update(config.target_update, update_calls, last_copy, &mut self.target_values, values);
    }
}
