//! The actor: the clipped step on the policy.

use rand::Rng;

use super::batch::{Batch, Part, Step};
use super::{loss, Config, UpdateStats};
use crate::network::Network;
use crate::rollout::Episode;
use crate::trained::{Descent, Trained};

#[derive(Clone, Debug)]
pub struct Actor {
    pub policy: Trained,
    /// Sums over the epochs of an update call.
    pub stats: UpdateStats,
    // Buffers of an update call, allocated once.
    part: Part,
    d_logits: Vec<f32>,
    /// Of all rows, part after part.
    log_p_old: Vec<f32>,
    /// Rows of this epoch's parts before this one.
    done: usize,
}

impl Actor {
    pub fn new(network: Network, rng: &mut impl Rng) -> Self {
        Self {
            policy: Trained::new(network, rng),
            stats: UpdateStats::default(),
            part: Part::default(),
            d_logits: Vec::new(),
            log_p_old: Vec::new(),
            done: 0,
        }
    }

    pub fn begin_update(&mut self) {
        self.policy.begin_update();
        self.stats = UpdateStats::default();
        self.log_p_old.clear();
    }

    /// The policy of a part's rows, which does not depend on the critic.
    pub fn evaluate(&mut self, batch: &Batch, episodes: &[Episode], step: Step) {
        let Self { policy, part, .. } = self;
        part.fill(batch, step.part, episodes, policy.network.inputs);
        policy.forward(&part.obs, &part.steps);
    }

    /// Adds the gradient of the part's share of the actor loss. The last part of an epoch makes the step of Adam.
    /// `take` waits for the advantages of the part's rows.
    pub fn descend(
        &mut self,
        config: &Config,
        batch: &Batch,
        step: Step,
        take: &mut dyn FnMut() -> Vec<f32>,
        by: Descent,
    ) {
        let Self { policy, stats, part, d_logits, log_p_old, done } = self;
        let advantages = take();
        policy.has_waited();
        let rows = batch.rows as f64;
        let terms = loss::Terms {
            avail: &part.avail,
            actions: &part.actions,
            advantages: &advantages,
            clip: config.clip,
            entropy_coef: config.entropy_coef,
            scale: 1.0 / (rows as f32 * config.agents as f32),
        };
        if step.epoch == 0 {
            // The actor is still the one that acted, so this forward pass gives p_old.
            terms.log_probabilities(policy.out(), log_p_old);
        }
        let found = terms.gradient(policy.out(), &log_p_old[*done..], d_logits);
        *done = if step.ends_epoch { 0 } else { *done + part.steps.rows() };
        stats.actor_loss += found.loss / rows;
        stats.entropy += found.entropy / rows;
        stats.clip_fraction += f64::from(found.clipped) / rows;
        policy.backward(&part.obs, &part.steps, d_logits);
        if step.ends_epoch {
            stats.actor_grad_norm += policy.descend(by);
        }
    }
}
