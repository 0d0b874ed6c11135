//! Independent PPO, one learner per agent. Steps and symbols are those of algorithms §4.1.
//!
//! ```text
//! V̄      = target critic on o_0 … o_T                          G = n-step return (algorithms §4.3)
//! repeat for every epoch, over the full batch:
//!   A     = G − V                                              V before this epoch's critic step
//!   critic loss = Σ m (G − V)² / Σ m                           clip, Adam
//!   ρ     = exp( log(π(a)+1e-10) − log(p_old+1e-10) )
//!   S     = min( ρ A, clip(ρ, 1−ε, 1+ε) A )                    H = −Σ_a π(a) log(π(a)+1e-10)
//!   actor loss  = −Σ m (S + c_ent H) / Σ m                     clip, Adam
//! target critic update (algorithms §4.4)
//! ```
//!
//! The reference sums over the team, so one agent's gradient is `1/n` of that of its own mean loss (algorithms §3.3).
//! The factor is kept because it matters for the clip. The clipped norm is that of this agent only
//! (`clip_scope = per_agent`, algorithms §6.4), because agents never see each other's gradients.
//!
//! The batch goes through the networks in parts that fit the cache. This is not minibatching: gradients add up over
//! the parts of an epoch. The critic does not depend on the actor, so both may learn at the same time.
//!
//! Multi-timescale learning (algorithms §6) needs no other algorithm: the caller passes the learning rate of this
//! call, and Adam's moments stay when it changes. Absent on purpose: GAE, advantage normalisation, minibatches, value
//! clipping, early stopping, rate decay.

mod actor;
mod batch;
mod critic;
mod loss;

use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::adam::Adam;
use crate::device::Device;
use crate::host::{Host, Seconds};
use crate::learner::{Choice, Learner, OnPolicy, Scalars};
use crate::network::{Kind, Network};
use crate::returns::EndOfBatch;
use crate::reward_stats::{RewardStats, Standardisation};
use crate::rollout::Episode;
use crate::saved::{self, NamedTensor, RestoreError, Vector};
use crate::trained::Descent;
use actor::Actor;
use batch::Batch;
use critic::Critic;

/// Hyperparameters of one learner; defaults and sources are in algorithms §4.2, §9.1.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Shape of the actor; the critic is always feed-forward (algorithms §1.2).
    pub actor: Kind,
    /// Hidden width of actor and critic, `H`.
    pub hidden: usize,
    /// Number of learning agents, `n`.
    pub agents: usize,
    /// Discount, γ.
    pub gamma: f32,
    /// Passes over the batch per update call, `E`.
    pub epochs: usize,
    /// Clip range of the ratio, ε.
    pub clip: f32,
    /// Weight of the entropy, `c_ent`.
    pub entropy_coef: f32,
    /// Steps of the return, `N`.
    pub n_step: usize,
    /// Above 1: a hard copy every that many update calls. Otherwise Polyak's τ.
    pub target_update: f64,
    /// Largest L2 norm of the actor's and of the critic's gradient.
    pub max_grad_norm: f64,
    /// The rule at the end of the batch (algorithms §4.3).
    pub end_of_batch: EndOfBatch,
    /// Reward standardisation.
    pub reward_standardisation: Standardisation,
    /// At learning rate 0 Adam's moments stand still too (`hold`) instead of following the gradient.
    pub hold_frozen_moments: bool,
}

/// What one update call reports: means over its epochs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpdateStats {
    /// `−Σ m (S + c_ent H) / Σ m`, this agent's own mean.
    pub actor_loss: f64,
    /// `Σ m (G − V)² / Σ m`, this agent's own mean.
    pub critic_loss: f64,
    /// Mean entropy of the policy in nats.
    pub entropy: f64,
    /// L2 norm of the actor's gradient before clipping.
    pub actor_grad_norm: f64,
    /// L2 norm of the critic's gradient before clipping.
    pub critic_grad_norm: f64,
    /// Share of steps whose ratio lies outside `[1−ε, 1+ε]`.
    pub clip_fraction: f64,
    /// Mean of `A`.
    pub advantage_mean: f64,
    /// Mean of `G`.
    pub target_mean: f64,
}

/// The part of a checkpoint that is not a tensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Update calls completed.
    pub update_calls: u64,
    /// Value of `update_calls` at the last hard copy of the target critic.
    pub last_target_copy: u64,
    /// Adam steps of the actor.
    pub actor_steps: u64,
    /// Adam steps of the critic.
    pub critic_steps: u64,
    /// Running reward statistics.
    pub reward_stats: RewardStats,
}

/// One agent's learner: actor, critic and target critic with their optimisers.
#[derive(Clone, Debug)]
pub struct Ppo {
    config: Config,
    actor: Actor,
    critic: Critic,
    reward_stats: RewardStats,
    update_calls: u64,
    batch: Batch,
    host: Host,
}

impl Ppo {
    /// A fresh learner; `rng` gives the initial weights of the actor, then of the critic (algorithms §1.3).
    pub fn new(config: Config, obs_size: usize, n_actions: usize, rng: &mut impl Rng) -> Self {
        Self::with_extra_inputs(config, (obs_size, 0), n_actions, rng)
    }

    /// The same with `extra` numbers after each observation, which only the actor receives (algorithms §1.4).
    pub fn with_extra_inputs(
        config: Config,
        (obs_size, extra): (usize, usize),
        n_actions: usize,
        rng: &mut impl Rng,
    ) -> Self {
        let (kind, hidden) = (config.actor, config.hidden);
        let actor = Network { kind, inputs: obs_size + extra, hidden, outputs: n_actions };
        let critic = Network { kind: Kind::Fc, inputs: obs_size, hidden, outputs: 1 };
        Self {
            config,
            actor: Actor::new(actor, rng),
            critic: Critic::new(critic, rng),
            reward_stats: RewardStats::default(),
            update_calls: 0,
            batch: Batch::default(),
            host: Host::default(),
        }
    }

    /// One update call on the episodes of a round, with learning rate `lr` for actor and critic in all epochs.
    ///
    /// # Panics
    /// If there is an episode without steps.
    pub fn update(&mut self, episodes: &[Episode], lr: f64) -> UpdateStats {
        let Self { config, actor, critic, batch, host, .. } = self;
        batch.begin(episodes, &actor.policy.network);
        self.reward_stats.standardise(config.reward_standardisation, &mut batch.rewards);
        critic.compute_returns(config, batch, episodes);
        actor.begin_update();

        let (config, batch) = (&*config, &*batch);
        let by = config.descent(lr);
        // The critic needs returns only and does not wait for the actor. The actor waits for A.
        host.pipelined(
            batch.steps(config.epochs),
            |step, give| {
                give(critic.advantages(config, batch, episodes, step));
                critic.descend(step, by);
            },
            |step, take| {
                actor.evaluate(batch, episodes, step);
                actor.descend(config, batch, step, take, by);
            },
        );
        self.update_calls += 1;
        self.critic.update_target(&self.config, self.update_calls);
        self.critic.stats.plus(self.actor.stats).scaled(1.0 / self.config.epochs as f64)
    }

    fn vectors(&self) -> [Vector<'_>; 7] {
        let (policy, value) = (&self.actor.policy, &self.critic.value);
        [
            ("actor", &policy.network, &policy.values),
            ("critic", &value.network, &value.values),
            ("target_critic", &value.network, &self.critic.target_values),
            ("adam.actor.m", &policy.network, &policy.adam.m),
            ("adam.actor.v", &policy.network, &policy.adam.v),
            ("adam.critic.m", &value.network, &value.adam.m),
            ("adam.critic.v", &value.network, &value.adam.v),
        ]
    }
}

impl Learner for Ppo {
    const KIND: &'static str = "Ppo";

    type Counters = Counters;

    fn compute_on(&mut self, device: &Device) {
        self.actor.policy.compute_on(device);
        self.critic.value.compute_on(device);
        self.batch.part_size = device.part_size();
    }

    fn run_on(&mut self, host: Host) {
        self.actor.policy.run_on(host);
        self.critic.value.run_on(host);
        self.host = host;
    }

    fn seconds(&self) -> Seconds {
        self.actor.policy.seconds().plus(self.critic.value.seconds())
    }

    fn update_calls(&self) -> u64 {
        self.update_calls
    }

    fn begin_round(&mut self, copies: usize) {
        self.actor.policy.begin_round(copies);
    }

    fn learn(&mut self, episodes: &[Episode], lr: f64) -> Scalars {
        let stats = self.update(episodes, lr);
        vec![
            ("actor_loss", stats.actor_loss),
            ("critic_loss", stats.critic_loss),
            ("entropy", stats.entropy),
            ("actor_grad_norm", stats.actor_grad_norm),
            ("critic_grad_norm", stats.critic_grad_norm),
            ("clip_fraction", stats.clip_fraction),
            ("advantage_mean", stats.advantage_mean),
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
            last_target_copy: self.critic.last_target_copy,
            actor_steps: self.actor.policy.adam.steps,
            critic_steps: self.critic.value.adam.steps,
            reward_stats: self.reward_stats,
        }
    }

    fn restore<'a>(
        &mut self,
        counters: &Counters,
        tensor: impl Fn(&str) -> Option<&'a [f32]>,
    ) -> Result<(), RestoreError> {
        let [of_actor, of_critic, target, actor_m, actor_v, critic_m, critic_v] =
            saved::restored(self.vectors(), tensor)?;
        let (policy, value) = (&mut self.actor.policy, &mut self.critic.value);
        (policy.values, value.values, self.critic.target_values) = (of_actor, of_critic, target);
        policy.adam = Adam { m: actor_m, v: actor_v, steps: counters.actor_steps };
        value.adam = Adam { m: critic_m, v: critic_v, steps: counters.critic_steps };
        self.critic.last_target_copy = counters.last_target_copy;
        self.reward_stats = counters.reward_stats;
        self.update_calls = counters.update_calls;
        Ok(())
    }
}

impl OnPolicy for Ppo {
    fn act(
        &mut self,
        copies: &[u16],
        obs: &[f32],
        avail: &[u8],
        choice: Choice,
        rng: &mut impl Rng,
        actions: &mut Vec<u16>,
    ) {
        let n_actions = self.actor.policy.network.outputs;
        let logits = self.actor.policy.act(copies, obs);
        actions.clear();
        for (logits, avail) in logits.chunks_exact_mut(n_actions).zip(avail.chunks_exact(n_actions)) {
            loss::softmax(logits, avail);
            let u = rng.random();
            actions.push(match choice {
                Choice::Sample => loss::sample(logits, u),
                Choice::Greedy => loss::most_probable(logits),
            });
        }
        self.actor.policy.has_chosen();
    }
}

impl Config {
    fn descent(&self, lr: f64) -> Descent {
        Descent { lr, max_grad_norm: self.max_grad_norm, hold_frozen_moments: self.hold_frozen_moments }
    }
}

impl UpdateStats {
    fn plus(self, other: Self) -> Self {
        Self {
            actor_loss: self.actor_loss + other.actor_loss,
            critic_loss: self.critic_loss + other.critic_loss,
            entropy: self.entropy + other.entropy,
            actor_grad_norm: self.actor_grad_norm + other.actor_grad_norm,
            critic_grad_norm: self.critic_grad_norm + other.critic_grad_norm,
            clip_fraction: self.clip_fraction + other.clip_fraction,
            advantage_mean: self.advantage_mean + other.advantage_mean,
            target_mean: self.target_mean + other.target_mean,
        }
    }

    fn scaled(self, by: f64) -> Self {
        Self {
            actor_loss: self.actor_loss * by,
            critic_loss: self.critic_loss * by,
            entropy: self.entropy * by,
            actor_grad_norm: self.actor_grad_norm * by,
            critic_grad_norm: self.critic_grad_norm * by,
            clip_fraction: self.clip_fraction * by,
            advantage_mean: self.advantage_mean * by,
            target_mean: self.target_mean * by,
        }
    }
}
