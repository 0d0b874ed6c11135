//! The critic and its target: returns, and the step on values.

use rand::Rng;

use super::batch::{Batch, Part};
use super::{Config, UpdateStats};
use crate::adam::Adam;
use crate::device::Device;
use crate::host::{Host, Seconds, Stopwatch};
use crate::kernels::gru::Steps;
use crate::network::{Activations, Network};
use crate::params::initial;
use crate::rollout::Episode;
use crate::target;

#[derive(Clone, Debug)]
pub struct Critic {
    pub network: Network,
    pub values: Vec<f32>,
    pub target_values: Vec<f32>,
    pub adam: Adam,
    /// Update call of the last hard copy of the target.
    pub last_target_copy: u64,
    pub seconds: Seconds,
    // Buffers of an update call, reused by the next one.
    part: Part,
    activations: Activations,
    gradient: Vec<f32>,
    d_values: Vec<f32>,
}

impl Critic {
    pub fn new(network: Network, rng: &mut impl Rng) -> Self {
        let values = initial(&network.blocks(), rng);
        Self {
            target_values: values.clone(),
            adam: Adam::new(values.len()),
            last_target_copy: 0,
            seconds: Seconds::default(),
            part: Part::default(),
            activations: Activations::default(),
            gradient: vec![0.0; values.len()],
            d_values: Vec::new(),
            network,
            values,
        }
    }

    pub fn compute_on(&mut self, device: &Device) {
        self.activations.on = device.passes();
    }

    /// Computes the target critic's values and from them `G` of every step. Both are the same in all epochs.
    pub fn compute_returns(&mut self, config: &Config, batch: &mut Batch, episodes: &[Episode], host: Host) {
        let Self { network, target_values, part, activations: to, seconds, .. } = self;
        let mut watch = Stopwatch::start(host);
        network.forward(target_values, &vec![0.0; network.inputs], &Steps::of_lengths(&[1]), to);
        let padding = to.out[0];
        for k in 0..batch.parts.len() {
            part.fill_observations(batch, k, episodes, network.inputs);
            watch.lap(&mut seconds.layout);
            network.forward(target_values, &part.obs, &part.steps, to);
            watch.lap(&mut seconds.forward);
            batch.place_values(part, &to.out, padding);
        }
        batch.compute_returns(episodes, config.n_step, config.gamma, config.end_of_batch);
        watch.lap(&mut seconds.loss);
    }

    /// The critic's steps of all epochs. Calls `give` with `A` of the rows of each part, in every epoch.
    pub fn learn(
        &mut self,
        config: &Config,
        batch: &Batch,
        episodes: &[Episode],
        lr: f64,
        host: Host,
        mut give: impl FnMut(Vec<f32>),
    ) -> UpdateStats {
        let Self { network, values, adam, seconds, part, activations: to, gradient, d_values, .. } = self;
        let mut watch = Stopwatch::start(host);
        let mut sum = UpdateStats::default();
        let rows = batch.rows as f64;
        let mean = |f: &dyn Fn(f64) -> f64, x: &[f32]| x.iter().map(|&x| f(f64::from(x))).sum::<f64>() / rows;
        // dL/dV = 2 (V − G) / (n Σ m)
        let scale = (2.0 / (rows * config.agents as f64)) as f32;
        for _ in 0..config.epochs {
            gradient.fill(0.0);
            for k in 0..batch.parts.len() {
                part.fill(batch, k, episodes, network.inputs);
                watch.lap(&mut seconds.layout);
                network.forward(values, &part.obs, &part.steps, to);
                watch.lap(&mut seconds.forward);
                let advantages: Vec<f32> = part.returns.iter().zip(&to.out).map(|(g, v)| g - v).collect();
                d_values.clear();
                d_values.extend(advantages.iter().map(|a| -a * scale));
                sum.critic_loss += mean(&|a| a * a, &advantages);
                sum.advantage_mean += mean(&|a| a, &advantages);
                sum.target_mean += mean(&|g| g, &part.returns);
                give(advantages);
                watch.lap(&mut seconds.loss);
                network.backward(values, &part.obs, &part.steps, d_values, to, gradient);
                watch.lap(&mut seconds.backward);
            }
            sum.critic_grad_norm +=
                adam.clipped_step(values, gradient, config.max_grad_norm, lr, config.hold_frozen_moments);
            watch.lap(&mut seconds.optimiser);
        }
        sum
    }

    /// Updates the target after update call number `update_calls`.
    pub fn update_target(&mut self, config: &Config, update_calls: u64) {
        let last_copy = &mut self.last_target_copy;
        target::update(config.target_update, update_calls, last_copy, &mut self.target_values, &self.values);
    }
}
