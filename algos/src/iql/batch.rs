//! A minibatch of episodes for one update call: the rewards of all episodes, and the rows and transitions of one part
//! at a time.

use std::cmp::Reverse;
use std::ops::Range;

use crate::kernels::gru::Steps;
use crate::network::Network;
use crate::parts::{parts, PartSize};
use crate::rollout::{End, Episode};

/// `B` episodes; `T` is the longest length.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// The episode that is the `k`-th longest.
    order: Vec<usize>,
    /// The parts, as ranges of `order`.
    pub parts: Vec<Range<usize>>,
    pub part_size: PartSize,
    /// Number of steps, `Σ m`.
    pub count: usize,
    /// `B × T` rewards, zero after an episode's end, as standardisation needs them (algorithms §2.6).
    pub rewards: Vec<f32>,
}

impl Batch {
    /// Sorts `episodes`, takes their rewards and divides them into parts for `network`.
    ///
    /// # Panics
    /// If there is an episode without steps.
    pub fn begin(&mut self, episodes: &[Episode], network: &Network) {
        assert!(episodes.iter().all(|episode| !episode.is_empty()), "every episode has a step");
        self.order.clear();
        self.order.extend(0..episodes.len());
        // Stable: equally long episodes stay in the order in which they were sampled.
        self.order.sort_by_key(|&k| Reverse(episodes[k].len()));
        let sorted = || self.order.iter().map(|&k| &episodes[k]);
        let rows: Vec<_> = sorted().map(|episode| episode.len() + 1).collect();
        self.parts = parts(network.kind, &rows, self.part_size);
        self.count = sorted().map(Episode::len).sum();
        let longest = sorted().next().map_or(0, Episode::len);
        self.rewards.clear();
        for episode in sorted() {
            self.rewards.extend_from_slice(&episode.rewards);
            self.rewards.resize(self.rewards.len() + longest - episode.len(), 0.0);
        }
    }
}

/// The rows of some episodes. Only played slots have rows, so the mask is implicit (algorithms §2.2): a slot with
/// `m = 1` is a [`Transition`].
#[derive(Clone, Debug, Default)]
pub struct Part {
    /// How the rows of slots `0 … L` are packed: by time, the longest episode first.
    pub steps: Steps,
    /// `rows × obs_size`.
    pub obs: Vec<f32>,
    /// `rows × n_actions`.
    pub avail: Vec<u8>,
    /// All steps.
    pub transitions: Vec<Transition>,
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
    /// Its reward, standardised if configured.
    pub reward: f32,
    /// `term`: the target has no bootstrap.
    pub terminal: bool,
}

impl Part {
    /// Lays out part number `part`. `time_limit_is_terminal`: the end by the step limit counts as one (algorithms
    /// §3.4).
    pub fn fill(
        &mut self,
        batch: &Batch,
        part: usize,
        episodes: &[Episode],
        network: &Network,
        time_limit_is_terminal: bool,
    ) {
        let (obs_size, n_actions) = (network.inputs, network.outputs);
        let longest = batch.rewards.len() / batch.order.len();
        let of_part = batch.parts[part].clone();
        let lengths: Vec<_> = batch.order[of_part.clone()].iter().map(|&k| episodes[k].len() + 1).collect();
        self.steps = Steps::of_lengths(&lengths);
        self.obs.clear();
        self.avail.clear();
        self.transitions.clear();
        for t in 0..self.steps.len() {
            for (i, k) in of_part.clone().take(self.steps.count(t)).enumerate() {
                let episode = &episodes[batch.order[k]];
                self.obs.extend_from_slice(&episode.obs[t * obs_size..(t + 1) * obs_size]);
                self.avail.extend_from_slice(&episode.avail[t * n_actions..(t + 1) * n_actions]);
                if t < episode.len() {
                    let ended = match episode.end {
                        End::Running => false,
                        End::Terminated => true,
                        End::TimeLimit => time_limit_is_terminal,
                    };
                    self.transitions.push(Transition {
                        row: self.steps.offset(t) + i,
                        next: self.steps.offset(t + 1) + i,
                        action: episode.actions[t],
                        reward: batch.rewards[k * longest + t],
                        terminal: ended && t + 1 == episode.len(),
                    });
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Kind;

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
        let network = Network { kind: Kind::Fc, inputs: 1, hidden: 1, outputs: 1 };
        let episodes = [episode(10.0, 1, End::Terminated), episode(20.0, 2, End::TimeLimit)];
        let (mut batch, mut part) = (Batch::default(), Part::default());
        batch.begin(&episodes, &network);
        assert_eq!((batch.parts.len(), batch.parts[0].clone(), batch.count), (1, 0..2, 3));
        assert_eq!(batch.rewards, [-20.0, -21.0, -10.0, 0.0]);
        for limit_is_terminal in [true, false] {
            part.fill(&batch, 0, &episodes, &network, limit_is_terminal);
            assert_eq!(part.obs, [20.0, 10.0, 21.0, 11.0, 22.0]);
            let step = |row, next, reward, terminal| Transition { row, next, action: 0, reward, terminal };
            let expected =
                [step(0, 2, -20.0, false), step(1, 3, -10.0, true), step(2, 4, -21.0, limit_is_terminal)];
            assert_eq!(part.transitions, expected);
        }
    }

    #[test]
    fn a_part_has_the_rows_of_its_own_episodes() {
        let network = Network { kind: Kind::Gru, inputs: 1, hidden: 1, outputs: 1 };
        let episodes: Vec<_> = (0..40).map(|k| episode(100.0 * k as f32, 1 + k, End::Terminated)).collect();
        let (mut batch, mut part) = (Batch::default(), Part::default());
        batch.begin(&episodes, &network);
        let mut count = 0;
        for k in 0..batch.parts.len() {
            part.fill(&batch, k, &episodes, &network, true);
            count += part.transitions.len();
            for step in &part.transitions {
                assert_eq!(part.obs[step.row], -step.reward);
                assert_eq!(part.obs[step.next], 1.0 - step.reward);
            }
        }
        assert_eq!((batch.parts.len() > 1, count), (true, batch.count));
    }
}
