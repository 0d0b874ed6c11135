//! A minibatch of episodes laid out for one update call: rows packed by time, and the steps to learn
//! from, which tie them together.

use std::cmp::Reverse;

use crate::kernels::gru::Steps;
use crate::rollout::{End, Episode};

/// `B` episodes; `T` is the longest length. Only slots that were filled have rows, so the mask of the
/// spec is implicit: what has `m = 1` is a [`Transition`].
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// How the rows of slots `0 … L` are packed: episodes sorted by length, the longest first.
    pub steps: Steps,
    /// `rows × obs_size`.
    pub obs: Vec<f32>,
    /// `rows × n_actions`.
    pub avail: Vec<u8>,
    /// `B × T` team rewards, zero after an episode's end: what standardisation works on (§2.6).
    pub rewards: Vec<f32>,
    /// Every step that was taken, `Σ m` of them.
    pub transitions: Vec<Transition>,
    /// Which episode is the `k`-th longest, and work space.
    order: Vec<usize>,
    lengths: Vec<usize>,
}

/// One step of one episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition {
    /// Row of slot `t`.
    pub row: usize,
    /// Row of slot `t + 1`.
    pub next: usize,
    /// The action taken at `t`.
    pub action: u16,
    /// Where the reward is in [`Batch::rewards`].
    pub reward: usize,
    /// `term`: nothing follows that a target may count on.
    pub terminal: bool,
}

impl Batch {
    /// Lays out `episodes`. `time_limit_is_terminal`: the end by the step limit counts as one (§3.4).
    ///
    /// # Panics
    /// If there is an episode without steps.
    pub fn fill(
        &mut self,
        episodes: &[Episode],
        obs_size: usize,
        n_actions: usize,
        time_limit_is_terminal: bool,
    ) {
        assert!(episodes.iter().all(|episode| !episode.is_empty()), "every episode has a step");
        self.order.clear();
        self.order.extend(0..episodes.len());
        // Stable, so that equally long episodes stay in the order in which they were sampled.
        self.order.sort_by_key(|&k| Reverse(episodes[k].len()));
        self.lengths.clear();
        self.lengths.extend(self.order.iter().map(|&k| episodes[k].len() + 1));
        self.steps = Steps::of_lengths(&self.lengths);
        let longest = self.steps.len().saturating_sub(1);

        self.obs.clear();
        self.avail.clear();
        self.transitions.clear();
        for t in 0..self.steps.len() {
            let running = &self.order[..self.steps.count(t)];
            for (k, episode) in running.iter().map(|&k| &episodes[k]).enumerate() {
                self.obs.extend_from_slice(&episode.obs[t * obs_size..(t + 1) * obs_size]);
                self.avail.extend_from_slice(&episode.avail[t * n_actions..(t + 1) * n_actions]);
                if t < episode.len() {
                    let ended = match episode.end {
                        End::Running => false,
                        End::Terminated => true,
                        End::TimeLimit => time_limit_is_terminal,
                    };
                    self.transitions.push(Transition {
                        row: self.steps.offset(t) + k,
                        next: self.steps.offset(t + 1) + k,
                        action: episode.actions[t],
                        reward: k * longest + t,
                        terminal: ended && t + 1 == episode.len(),
                    });
                }
            }
        }
        self.rewards.clear();
        for episode in self.order.iter().map(|&k| &episodes[k]) {
            self.rewards.extend_from_slice(&episode.rewards);
            self.rewards.resize(self.rewards.len() + longest - episode.len(), 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An episode of `length` steps with one observation and one action, recognisable by `id`.
    fn episode(id: f32, length: usize, end: End) -> Episode {
        Episode {
            obs: (0..=length).map(|t| id + t as f32).collect(),
            avail: vec![1; length + 1],
            actions: vec![0; length],
            rewards: (0..length).map(|t| -id - t as f32).collect(),
            end,
        }
    }

    #[test]
    fn rows_go_by_time_and_every_step_knows_the_row_after_it() {
        let mut batch = Batch::default();
        let episodes = [episode(10.0, 1, End::Terminated), episode(20.0, 2, End::TimeLimit)];
        for limit_is_terminal in [true, false] {
            batch.fill(&episodes, 1, 1, limit_is_terminal);
            assert_eq!(batch.obs, [20.0, 10.0, 21.0, 11.0, 22.0]);
            assert_eq!(batch.rewards, [-20.0, -21.0, -10.0, 0.0]);
            let step = |row, next, reward, terminal| Transition { row, next, action: 0, reward, terminal };
            let expected = [step(0, 2, 0, false), step(1, 3, 2, true), step(2, 4, 1, limit_is_terminal)];
            assert_eq!(batch.transitions, expected);
        }
    }
}
