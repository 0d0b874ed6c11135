//! Independent PPO, one learner per agent. Steps and symbols are those of spec §4.1.
//!
//! ```text
//! V̄      = target critic on o_0 … o_T                          G = n-step return (§4.3)
//! repeat for every epoch, over the full batch:
//!   A     = G − V                                              V before this epoch's critic step
//!   critic loss = Σ m (G − V)² / Σ m                           clip, Adam
//!   ρ     = exp( log(π(a)+1e-10) − log(p_old+1e-10) )
//!   S     = min( ρ A, clip(ρ, 1−ε, 1+ε) A )                    H = −Σ_a π(a) log(π(a)+1e-10)
//!   actor loss  = −Σ m (S + c_ent H) / Σ m                     clip, Adam
//! target critic update (§4.4)
//! ```
//!
//! The sums run over the team in the reference, so that one agent's gradient is `1/n` of its own mean
//! loss (§3.3); the factor is kept because it matters for the clip, whose norm is this agent's alone
//! (`clip_scope = per_agent`): agents never see each other's gradients.
//!
//! The batch goes through the networks in parts that fit the cache. Gradients add up over the parts of an epoch, so
//! that these are no minibatches; the critic's step waits for the actor's pass, which does not look at its weights.
//!
//! Multi-timescale learning (§6) is no other algorithm: the caller passes this call's learning rates,
//! and Adam's moments are kept when they change. Absent on purpose: GAE, advantage normalisation,
//! minibatches, value clipping, early stopping, rate decay.

mod batch;
mod loss;

use rand::Rng;
use serde::{Deserialize, Serialize};

use crate::acting::Acting;
use crate::adam::{clip, Adam};
use crate::device::Device;
use crate::kernels::gru::Steps;
use crate::network::{Activations, Kind, Network};
use crate::params::initial;
use crate::returns::EndOfBatch;
use crate::reward_stats::{RewardStats, Standardisation};
use crate::rollout::{Episode, Rollout};
use crate::saved::{self, Vector};
use crate::target;
use batch::{Batch, Part};

pub use crate::saved::{NamedTensor, RestoreError};

/// Hyperparameters of one learner; defaults and sources are in spec §§4.2, 9.1.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Shape of the actor; the critic is always feed-forward (§1.2).
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
    /// Largest L2 norm of actor's and critic's gradient, each.
    pub max_grad_norm: f64,
    /// What a return does at the end of the batch.
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

/// Everything small that a checkpoint keeps beside the tensors.
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

/// How probabilities become an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// By chance, as in training.
    Sample,
    /// The most probable one, the lowest of equals.
    Greedy,
}

/// One agent's learner: actor, critic, target critic and their optimisers.
#[derive(Clone, Debug)]
pub struct Ppo {
    config: Config,
    actor: Network,
    critic: Network,
    actor_values: Vec<f32>,
    critic_values: Vec<f32>,
    target_values: Vec<f32>,
    actor_adam: Adam,
    critic_adam: Adam,
    reward_stats: RewardStats,
    update_calls: u64,
    last_target_copy: u64,
    acting: Acting,
    batch: Batch,
    work: Work,
}

/// Buffers of an update call, kept so that none is allocated twice.
#[derive(Clone, Debug, Default)]
struct Work {
    part: Part,
    /// Of whichever network is at it.
    activations: Activations,
    actor_gradient: Vec<f32>,
    critic_gradient: Vec<f32>,
    /// `A` of the part's rows.
    advantages: Vec<f32>,
    d_values: Vec<f32>,
    d_logits: Vec<f32>,
    /// Of all rows, part after part.
    log_p_old: Vec<f32>,
}

impl Ppo {
    /// A fresh learner; `rng` gives the initial weights of the actor, then of the critic (§1.3).
    pub fn new(config: Config, obs_size: usize, n_actions: usize, rng: &mut impl Rng) -> Self {
        let actor =
            Network { kind: config.actor, inputs: obs_size, hidden: config.hidden, outputs: n_actions };
        let critic = Network { kind: Kind::Fc, outputs: 1, ..actor };
        let actor_values = initial(&actor.blocks(), rng);
        let critic_values = initial(&critic.blocks(), rng);
        Self {
            actor_adam: Adam::new(actor_values.len()),
            critic_adam: Adam::new(critic_values.len()),
            target_values: critic_values.clone(),
            reward_stats: RewardStats::default(),
            update_calls: 0,
            last_target_copy: 0,
            acting: Acting::default(),
            batch: Batch::default(),
            work: Work {
                actor_gradient: vec![0.0; actor_values.len()],
                critic_gradient: vec![0.0; critic_values.len()],
                ..Work::default()
            },
            config,
            actor,
            critic,
            actor_values,
            critic_values,
        }
    }

    /// From now on the networks' passes are computed there. The caller asks [`Device::check`] before it relies on
    /// what an update call or an action came to.
    pub fn compute_on(&mut self, device: &Device) {
        self.acting.compute_on(device);
        self.work.activations.on = device.passes();
        self.batch.part_size = device.part_size();
    }

    /// Update calls completed, the `u` of the schedule.
    pub fn update_calls(&self) -> u64 {
        self.update_calls
    }

    /// Starts an episode in each of `copies` environment copies: recurrent states are zero.
    pub fn begin_round(&mut self, copies: usize) {
        self.acting.begin(copies, self.config.hidden);
    }

    /// Chooses one action for each row by the policy, which gives forbidden ones probability zero.
    ///
    /// Row `k` shows environment copy `copies[k]`: `obs` is `rows × obs_size`, `avail` is
    /// `rows × n_actions`. Draws exactly one number per row from `rng`.
    pub fn act(
        &mut self,
        copies: &[u16],
        obs: &[f32],
        avail: &[u8],
        choice: Choice,
        rng: &mut impl Rng,
        actions: &mut Vec<u16>,
    ) {
        let n_actions = self.actor.outputs;
        let out = self.acting.step(&self.actor, &self.actor_values, copies, obs);
        actions.clear();
        for (logits, avail) in out.chunks_exact_mut(n_actions).zip(avail.chunks_exact(n_actions)) {
            loss::softmax(logits, avail);
            let u = rng.random();
            actions.push(match choice {
                Choice::Sample => loss::sample(logits, u),
                Choice::Greedy => loss::most_probable(logits),
            });
        }
    }

    /// One update call on a finished round, with learning rate `lr` for actor and critic in all epochs.
    ///
    /// # Panics
    /// If there is an episode without steps.
    pub fn update(&mut self, rollout: &Rollout, lr: f64) -> UpdateStats {
        let mut batch = std::mem::take(&mut self.batch);
        batch.begin(rollout.episodes(), &self.actor);
        self.reward_stats.standardise(self.config.reward_standardisation, &mut batch.rewards);
        self.compute_returns(&mut batch, rollout.episodes());

        let mut sum = UpdateStats::default();
        self.work.log_p_old.clear();
        for _ in 0..self.config.epochs {
            self.work.critic_gradient.fill(0.0);
            self.work.actor_gradient.fill(0.0);
            let mut done = 0;
            for part in 0..batch.parts.len() {
                self.work.part.fill(&batch, part, rollout.episodes());
                self.add_critic_gradient(batch.rows, &mut sum);
                self.add_actor_gradient(batch.rows, done, &mut sum);
                done += self.work.part.steps.rows();
            }
            self.step(lr, &mut sum);
        }
        self.batch = batch;
        self.update_calls += 1;
        let (rule, target) = (self.config.target_update, &mut self.target_values);
        target::update(rule, self.update_calls, &mut self.last_target_copy, target, &self.critic_values);
        sum.scaled(1.0 / self.config.epochs as f64)
    }

    /// Values of the target critic and, from them, `G` of every step: the same in all epochs.
    fn compute_returns(&mut self, batch: &mut Batch, episodes: &[Episode]) {
        let Work { part, activations: to, .. } = &mut self.work;
        let nothing = vec![0.0; self.critic.inputs];
        self.critic.forward(&self.target_values, &nothing, &Steps::of_lengths(&[1]), to);
        let padding = to.out[0];
        for k in 0..batch.parts.len() {
            part.fill_observations(batch, k, episodes);
            self.critic.forward(&self.target_values, &part.obs, &part.steps, to);
            batch.place_values(part, &to.out, padding);
        }
        batch.compute_returns(episodes, self.config.n_step, self.config.gamma, self.config.end_of_batch);
    }

    /// The critic's pass over the rows of one part, which leaves their advantages; `rows`: of the whole batch.
    fn add_critic_gradient(&mut self, rows: usize, sum: &mut UpdateStats) {
        let Work { part, activations: to, critic_gradient: gradient, advantages, d_values, .. } =
            &mut self.work;
        // dL/dV = 2 (V − G) / (n Σ m)
        let scale = (2.0 / (rows as f64 * self.config.agents as f64)) as f32;
        self.critic.forward(&self.critic_values, &part.obs, &part.steps, to);
        advantages.clear();
        advantages.extend(part.returns.iter().zip(&to.out).map(|(g, v)| g - v));
        d_values.clear();
        d_values.extend(advantages.iter().map(|a| -a * scale));
        self.critic.backward(&self.critic_values, &part.obs, &part.steps, d_values, to, gradient);
        let share =
            |f: &dyn Fn(f64) -> f64, x: &[f32]| x.iter().map(|&x| f(f64::from(x))).sum::<f64>() / rows as f64;
        sum.critic_loss += share(&|a| a * a, advantages);
        sum.advantage_mean += share(&|a| a, advantages);
        sum.target_mean += share(&|g| g, &part.returns);
    }

    /// The actor's pass over the rows of one part, the first of which is row `first` of the batch's `rows`.
    fn add_actor_gradient(&mut self, rows: usize, first: usize, sum: &mut UpdateStats) {
        let Work { part, activations: to, actor_gradient: gradient, advantages, d_logits, log_p_old, .. } =
            &mut self.work;
        self.actor.forward(&self.actor_values, &part.obs, &part.steps, to);
        let terms = loss::Terms {
            avail: &part.avail,
            actions: &part.actions,
            advantages,
            clip: self.config.clip,
            entropy_coef: self.config.entropy_coef,
            scale: 1.0 / (rows as f32 * self.config.agents as f32),
        };
        if log_p_old.len() == first {
            // The first epoch: the actor is still the one that acted, so this forward pass gives p_old.
            terms.log_probabilities(&to.out, log_p_old);
        }
        let found = terms.gradient(&to.out, &log_p_old[first..], d_logits);
        self.actor.backward(&self.actor_values, &part.obs, &part.steps, d_logits, to, gradient);
        sum.actor_loss += found.loss / rows as f64;
        sum.entropy += found.entropy / rows as f64;
        sum.clip_fraction += f64::from(found.clipped) / rows as f64;
    }

    /// The step of critic and actor that ends an epoch.
    fn step(&mut self, lr: f64, sum: &mut UpdateStats) {
        let Work { critic_gradient, actor_gradient, .. } = &self.work;
        let (critic_norm, critic_factor) = clip(critic_gradient, self.config.max_grad_norm);
        let (actor_norm, actor_factor) = clip(actor_gradient, self.config.max_grad_norm);
        if lr > 0.0 || !self.config.hold_frozen_moments {
            self.critic_adam.step(&mut self.critic_values, critic_gradient, critic_factor, lr);
            self.actor_adam.step(&mut self.actor_values, actor_gradient, actor_factor, lr);
        }
        sum.critic_grad_norm += critic_norm;
        sum.actor_grad_norm += actor_norm;
    }

    /// All tensors of the learner, named; those of the optimisers start with `adam.`.
    pub fn tensors(&self) -> Vec<NamedTensor<'_>> {
        saved::tensors(&self.vectors())
    }

    fn vectors(&self) -> [Vector<'_>; 7] {
        [
            ("actor", &self.actor, &self.actor_values),
            ("critic", &self.critic, &self.critic_values),
            ("target_critic", &self.critic, &self.target_values),
            ("adam.actor.m", &self.actor, &self.actor_adam.m),
            ("adam.actor.v", &self.actor, &self.actor_adam.v),
            ("adam.critic.m", &self.critic, &self.critic_adam.m),
            ("adam.critic.v", &self.critic, &self.critic_adam.v),
        ]
    }

    /// The small part of a checkpoint.
    pub fn counters(&self) -> Counters {
        Counters {
            update_calls: self.update_calls,
            last_target_copy: self.last_target_copy,
            actor_steps: self.actor_adam.steps,
            critic_steps: self.critic_adam.steps,
            reward_stats: self.reward_stats,
        }
    }

    /// Puts a saved learner back; `tensor` finds the numbers of a name.
    ///
    /// # Errors
    /// If a tensor is missing or has another size; this learner is then unchanged.
    pub fn restore<'a>(
        &mut self,
        counters: &Counters,
        tensor: impl Fn(&str) -> Option<&'a [f32]>,
    ) -> Result<(), RestoreError> {
        let [actor, critic, target, actor_m, actor_v, critic_m, critic_v] =
            saved::restored(self.vectors(), tensor)?;
        (self.actor_values, self.critic_values, self.target_values) = (actor, critic, target);
        self.actor_adam = Adam { m: actor_m, v: actor_v, steps: counters.actor_steps };
        self.critic_adam = Adam { m: critic_m, v: critic_v, steps: counters.critic_steps };
        self.reward_stats = counters.reward_stats;
        self.update_calls = counters.update_calls;
        self.last_target_copy = counters.last_target_copy;
        Ok(())
    }
}

impl UpdateStats {
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
