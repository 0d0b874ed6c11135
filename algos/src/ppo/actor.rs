//! The actor: the clipped step on the policy.

use rand::Rng;

use super::batch::{Batch, Part};
use super::{loss, Config, UpdateStats};
use crate::adam::Adam;
use crate::device::Device;
use crate::host::{Host, Seconds, Stopwatch};
use crate::network::{Activations, Network};
use crate::params::initial;
use crate::rollout::Episode;

#[derive(Clone, Debug)]
pub struct Actor {
    pub network: Network,
    pub values: Vec<f32>,
    pub adam: Adam,
    pub seconds: Seconds,
    // Buffers of an update call, reused by the next one.
    part: Part,
    activations: Activations,
    gradient: Vec<f32>,
    d_logits: Vec<f32>,
    /// By row, part after part.
    log_p_old: Vec<f32>,
}

impl Actor {
    pub fn new(network: Network, rng: &mut impl Rng) -> Self {
        let values = initial(&network.blocks(), rng);
        Self {
            adam: Adam::new(values.len()),
            seconds: Seconds::default(),
            part: Part::default(),
            activations: Activations::default(),
            gradient: vec![0.0; values.len()],
            d_logits: Vec::new(),
            log_p_old: Vec::new(),
            network,
            values,
        }
    }

    pub fn compute_on(&mut self, device: &Device) {
        self.activations.on = device.passes();
    }

    /// The actor's steps of all epochs. `take` returns `A` of the rows of the next part, from the critic.
    pub fn learn(
        &mut self,
        config: &Config,
        batch: &Batch,
        episodes: &[Episode],
        lr: f64,
        host: Host,
        mut take: impl FnMut() -> Vec<f32>,
    ) -> UpdateStats {
        let Self { network, values, adam, seconds, part, activations: to, gradient, d_logits, log_p_old } =
            self;
        let mut watch = Stopwatch::start(host);
        let mut sum = UpdateStats::default();
        let rows = batch.rows as f64;
        log_p_old.clear();
        for epoch in 0..config.epochs {
            gradient.fill(0.0);
            let mut done = 0;
            for k in 0..batch.parts.len() {
                part.fill(batch, k, episodes, network.inputs);
                watch.lap(&mut seconds.layout);
                network.forward(values, &part.obs, &part.steps, to);
                watch.lap(&mut seconds.forward);
                let advantages = take();
                watch.lap(&mut seconds.waiting);
                let terms = loss::Terms {
                    avail: &part.avail,
                    actions: &part.actions,
                    advantages: &advantages,
                    clip: config.clip,
                    entropy_coef: config.entropy_coef,
                    scale: 1.0 / (rows as f32 * config.agents as f32),
                };
                if epoch == 0 {
                    // The actor has not changed since it acted, so this forward pass gives p_old.
                    terms.log_probabilities(&to.out, log_p_old);
                }
                let found = terms.gradient(&to.out, &log_p_old[done..], d_logits);
                done += part.steps.rows();
                sum.actor_loss += found.loss / rows;
                sum.entropy += found.entropy / rows;
                sum.clip_fraction += f64::from(found.clipped) / rows;
                watch.lap(&mut seconds.loss);
                network.backward(values, &part.obs, &part.steps, d_logits, to, gradient);
                watch.lap(&mut seconds.backward);
            }
            sum.actor_grad_norm +=
                adam.clipped_step(values, gradient, config.max_grad_norm, lr, config.hold_frozen_moments);
            watch.lap(&mut seconds.optimiser);
        }
        sum
    }
}
