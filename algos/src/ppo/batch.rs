//! A round's episodes laid out for one update call: rows packed by time, returns by row.

use crate::kernels::gru::Steps;
use crate::returns::{n_step_returns, EndOfBatch, Episode};
use crate::rollout::{End, Rollout};

/// `B` episodes; `T` is the longest length. Only steps that were taken have rows, so the mask of the
/// spec is implicit: a row is a slot with `m = 1`.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// How rows are packed: episodes sorted by length, the longest first.
    pub steps: Steps,
    /// `rows × obs_size`.
    pub obs: Vec<f32>,
    /// `rows × n_actions`.
    pub avail: Vec<u8>,
    /// The actions taken, by row.
    pub actions: Vec<u16>,
    /// `(B + 1) × obs_size`: each episode's final observation, then the all-zero padding one.
    pub final_obs: Vec<f32>,
    /// `B × T` team rewards, zero after an episode's end.
    pub rewards: Vec<f32>,
    /// `G` by row.
    pub returns: Vec<f32>,
    /// `B × (T + 1)` values of the target critic.
    values: Vec<f32>,
    /// Episodes in the order of the packing: length, ended by the step limit.
    episodes: Vec<(usize, bool)>,
}

impl Batch {
    /// Lays out `rollout`.
    pub fn fill(&mut self, rollout: &Rollout, obs_size: usize, n_actions: usize) {
        let mut order: Vec<_> = rollout.episodes().iter().collect();
        // Stable, so that equally long episodes stay in the order of their copies.
        order.sort_by_key(|episode| std::cmp::Reverse(episode.len()));
        let lengths: Vec<_> = order.iter().map(|episode| episode.len()).collect();
        assert!(lengths.iter().all(|&l| l > 0), "every episode has a step");
        self.steps = Steps::of_lengths(&lengths);
        let longest = self.steps.len();

        self.obs.clear();
        self.avail.clear();
        self.actions.clear();
        for t in 0..longest {
            for episode in &order[..self.steps.count(t)] {
                self.obs.extend_from_slice(&episode.obs[t * obs_size..(t + 1) * obs_size]);
                self.avail.extend_from_slice(&episode.avail[t * n_actions..(t + 1) * n_actions]);
                self.actions.push(episode.actions[t]);
            }
        }
        self.final_obs.clear();
        self.rewards.clear();
        self.episodes.clear();
        for episode in &order {
            self.final_obs.extend_from_slice(&episode.obs[episode.len() * obs_size..]);
            self.rewards.extend_from_slice(&episode.rewards);
            self.rewards.resize(self.rewards.len() + longest - episode.len(), 0.0);
            self.episodes.push((episode.len(), episode.end == End::TimeLimit));
        }
        self.final_obs.resize(self.final_obs.len() + obs_size, 0.0);
    }

    /// The packing of `final_obs`: all its rows at once.
    pub fn final_steps(&self) -> Steps {
        Steps::of_lengths(&vec![1; self.episodes.len() + 1])
    }

    /// Takes the target critic's values of the rows.
    pub fn scatter_values(&mut self, by_row: &[f32]) {
        let slots = self.steps.len() + 1;
        self.values.clear();
        self.values.resize(self.episodes.len() * slots, 0.0);
        for t in 0..self.steps.len() {
            for k in 0..self.steps.count(t) {
                self.values[k * slots + t] = by_row[self.steps.offset(t) + k];
            }
        }
    }

    /// Takes the values of `final_obs`: slot `L` of each episode, then the padding after it.
    pub fn place_final_values(&mut self, values: &[f32]) {
        let slots = self.steps.len() + 1;
        let padding = values[self.episodes.len()];
        for (k, &(length, _)) in self.episodes.iter().enumerate() {
            let row = &mut self.values[k * slots..(k + 1) * slots];
            row[length] = values[k];
            row[length + 1..].fill(padding);
        }
    }

    /// Computes `G` of every row.
    pub fn compute_returns(&mut self, n: usize, gamma: f32, rule: EndOfBatch) {
        let longest = self.steps.len();
        let mut of_episode = vec![0.0; longest];
        self.returns.clear();
        self.returns.resize(self.steps.rows(), 0.0);
        for (k, &(length, time_limit)) in self.episodes.iter().enumerate() {
            let episode = Episode {
                rewards: &self.rewards[k * longest..(k + 1) * longest],
                values: &self.values[k * (longest + 1)..(k + 1) * (longest + 1)],
                length,
                time_limit,
            };
            n_step_returns(&episode, n, gamma, rule, &mut of_episode);
            for (t, &g) in of_episode[..length].iter().enumerate() {
                self.returns[self.steps.offset(t) + k] = g;
            }
        }
    }
}
