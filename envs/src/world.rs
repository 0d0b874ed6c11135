//! The interface of every world. Agents are numbered from 0 and may differ in observation size and actions.

use rand::RngCore;

use crate::scene::Scene;

/// One simulated world with a fixed number of agents.
///
/// Slices must have the lengths of [`World::sizes`]; other lengths are a bug of the caller and panic. Contents are not
/// trusted: an action that does not exist counts as doing nothing.
pub trait World: Send {
    /// The sizes, which never change.
    fn sizes(&self) -> &Sizes;

    /// A warning for the user, if the world differs from what its name says.
    fn warning(&self) -> Option<String> {
        None
    }

    /// Starts a new episode. Its start depends on `rng` only, not on the episode before.
    fn reset(&mut self, rng: &mut dyn RngCore);

    /// Optional: precomputes the part of the next step that does not depend on the team's actions. Results do not
    /// change. The env-server calls it while the agents choose their actions.
    fn think_ahead(&mut self) {}

    /// Plays one joint action (`actions[agent]`) and writes each agent's own reward of this step into
    /// `rewards[agent]`. Worlds without randomness inside a step leave `rng` untouched.
    fn step(&mut self, actions: &[u16], rng: &mut dyn RngCore, rewards: &mut [f64]) -> End;

    /// Whether the team earns one reward, which every agent is given: then that is the team's reward, not the sum over
    /// its agents.
    fn shares_reward(&self) -> bool {
        false
    }

    /// Writes the observation of `agent`; `out` has `sizes().obs_size[agent]` places and all are written.
    fn observe(&self, agent: usize, out: &mut [f32]);

    /// Writes 1 for each available action of `agent`, 0 for the others; `out` has `sizes().n_actions[agent]` places. By
    /// default all actions are available.
    fn available(&self, agent: usize, out: &mut [u8]) {
        debug_assert!(agent < self.sizes().agents);
        out.fill(1);
    }

    /// How the episode has gone so far, in the world's own words: each fact has a name, `battle_won`, and a finite
    /// number. Metric rows have the mean of a fact over episodes as `battle_won_mean`, so names are of small letters,
    /// digits and `_`; always the same ones, and those that say most come first.
    fn facts(&self, _report: &mut dyn FnMut(&'static str, f64)) {}

    /// The picture of the present state.
    fn scene(&self) -> Scene;

    /// A second world in the same state.
    fn copy(&self) -> Box<dyn World>;
}

/// The fixed sizes of a world.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sizes {
    pub agents: usize,
    /// Length of the observation, per agent.
    pub obs_size: Vec<usize>,
    /// Number of actions, per agent; action `a` of agent `i` exists when `a < n_actions[i]`.
    pub n_actions: Vec<usize>,
    /// Steps after which an episode ends in any case.
    pub episode_limit: u32,
}

/// Whether and why the episode is over after a step. Learners treat the two ends differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    Running,
    /// The world itself ended the episode, possibly in the last allowed step.
    Terminated,
    /// The step limit ended the episode.
    TimeLimit,
}
