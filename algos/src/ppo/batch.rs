//! A round's episodes for one update call: the returns of the whole round, and the rows of one part at a time.

use std::cmp::Reverse;
use std::ops::Range;

use crate::kernels::gru::Steps;
use crate::network::Network;
use crate::parts::{parts, PartSize};
use crate::returns::{self, n_step_returns, EndOfBatch};
use crate::rollout::{End, Episode};

/// `B` episodes; `T` is the longest length.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// The episode that is the `k`-th longest.
    order: Vec<usize>,
    /// Numbers in a row of an episode: the actor's inputs.
    shown: usize,
    n_actions: usize,
    /// The parts, as ranges of `order`.
    pub parts: Vec<Range<usize>>,
    pub part_size: PartSize,
    /// Number of steps, `Σ m`.
    pub rows: usize,
    /// `B × T` rewards, zero after an episode's end.
    pub rewards: Vec<f32>,
    /// `B × (T + 1)` values of the target critic.
    values: Vec<f32>,
    /// `B × T`: `G` of every step.
    returns: Vec<f32>,
}

impl Batch {
    /// Sorts `episodes`, takes their rewards and divides them into parts for `actor`.
    ///
    /// # Panics
    /// If there is an episode without steps.
    pub fn begin(&mut self, episodes: &[Episode], actor: &Network) {
        (self.shown, self.n_actions) = (actor.inputs, actor.outputs);
        assert!(episodes.iter().all(|episode| !episode.is_empty()), "every episode has a step");
        self.order.clear();
        self.order.extend(0..episodes.len());
        // Stable: equally long episodes stay in the order of their copies.
        self.order.sort_by_key(|&k| Reverse(episodes[k].len()));
        let lengths: Vec<_> = self.order.iter().map(|&k| episodes[k].len()).collect();
        self.parts = parts(actor.kind, &lengths, self.part_size);
        self.rows = lengths.iter().sum();
        let longest = lengths.first().copied().unwrap_or(0);
        self.rewards.clear();
        for episode in self.order.iter().map(|&k| &episodes[k]) {
            self.rewards.extend_from_slice(&episode.rewards);
            self.rewards.resize(self.rewards.len() + longest - episode.len(), 0.0);
        }
        self.values.clear();
        self.values.resize(episodes.len() * (longest + 1), 0.0);
        self.returns.clear();
        self.returns.resize(episodes.len() * longest, 0.0);
    }

    /// All parts, in every epoch.
    pub fn steps(&self, epochs: usize) -> impl Iterator<Item = Step> + Clone + Send + use<> {
        let parts = self.parts.len();
        let of_epoch =
            move |epoch| (0..parts).map(move |part| Step { epoch, part, ends_epoch: part + 1 == parts });
        (0..epochs).flat_map(of_epoch)
    }

    fn longest(&self) -> usize {
        self.rewards.len() / self.order.len()
    }

    /// Stores the target critic's values of a part, final observations included. `padding` is its value of the all-zero
    /// observation, for all later slots.
    pub fn place_values(&mut self, part: &Part, by_row: &[f32], padding: f32) {
        let slots = self.longest() + 1;
        let of_part = part.episodes.start * slots..part.episodes.end * slots;
        self.values[of_part.clone()].fill(padding);
        for t in 0..part.steps.len() {
            let of_step = &by_row[part.steps.offset(t)..][..part.steps.count(t)];
            for (values, v) in self.values[of_part.clone()].chunks_exact_mut(slots).zip(of_step) {
                values[t] = *v;
            }
        }
    }

    /// Computes `G` of every step.
    pub fn compute_returns(&mut self, episodes: &[Episode], n: usize, gamma: f32, rule: EndOfBatch) {
        let longest = self.longest();
        for (k, episode) in self.order.iter().map(|&k| &episodes[k]).enumerate() {
            let slots = k * longest..(k + 1) * longest;
            let episode = returns::Episode {
                rewards: &self.rewards[slots.clone()],
                values: &self.values[k * (longest + 1)..(k + 1) * (longest + 1)],
                length: episode.len(),
                time_limit: episode.end == End::TimeLimit,
            };
            n_step_returns(&episode, n, gamma, rule, &mut self.returns[slots]);
        }
    }
}

/// One part of a batch in one epoch.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    pub epoch: usize,
    pub part: usize,
    /// It is the last part.
    pub ends_epoch: bool,
}

/// The rows of some episodes, packed by time. Only played steps have rows, so the mask is implicit (algorithms §2.2):
/// a row is a slot with `m = 1`.
#[derive(Clone, Debug, Default)]
pub struct Part {
    /// Range of the sorted episodes.
    episodes: Range<usize>,
    /// The packing of the rows.
    pub steps: Steps,
    /// `rows × inputs`.
    pub obs: Vec<f32>,
    /// `rows × n_actions`.
    pub avail: Vec<u8>,
    /// The actions taken, by row.
    pub actions: Vec<u16>,
    /// `G` by row.
    pub returns: Vec<f32>,
}

impl Part {
    /// Lays out the steps of part number `part`, with the first `inputs` numbers of each row.
    pub fn fill(&mut self, batch: &Batch, part: usize, episodes: &[Episode], inputs: usize) {
        self.begin(batch, part, episodes, 0);
        self.avail.clear();
        self.actions.clear();
        self.returns.clear();
        let (longest, n_actions) = (batch.longest(), batch.n_actions);
        for t in 0..self.steps.len() {
            for k in self.episodes.clone().take(self.steps.count(t)) {
                let episode = &episodes[batch.order[k]];
                self.obs.extend_from_slice(&episode.obs[t * batch.shown..][..inputs]);
                self.avail.extend_from_slice(&episode.avail[t * n_actions..][..n_actions]);
                self.actions.push(episode.actions[t]);
                self.returns.push(batch.returns[k * longest + t]);
            }
        }
    }

    /// Lays out only observations: the first `inputs` numbers of all rows of part number `part`, final ones included.
    pub fn fill_observations(&mut self, batch: &Batch, part: usize, episodes: &[Episode], inputs: usize) {
        self.begin(batch, part, episodes, 1);
        for t in 0..self.steps.len() {
            for k in self.episodes.clone().take(self.steps.count(t)) {
                let episode = &episodes[batch.order[k]];
                self.obs.extend_from_slice(&episode.obs[t * batch.shown..][..inputs]);
            }
        }
    }

    fn begin(&mut self, batch: &Batch, part: usize, episodes: &[Episode], final_slots: usize) {
        self.episodes = batch.parts[part].clone();
        let of_part = batch.order[self.episodes.clone()].iter();
        let lengths: Vec<_> = of_part.map(|&k| episodes[k].len() + final_slots).collect();
        self.steps = Steps::of_lengths(&lengths);
        self.obs.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Kind;

    /// `count` episodes of 50 steps; each row holds the number of its episode.
    fn episodes(count: usize) -> Vec<Episode> {
        let episode = |k: usize| Episode {
            obs: vec![k as f32; 51],
            avail: vec![1; 51],
            actions: vec![0; 50],
            rewards: vec![k as f32; 50],
            end: End::Terminated,
        };
        (0..count).map(episode).collect()
    }

    #[test]
    fn what_goes_through_a_network_at_once_does_not_grow_with_the_copies() {
        for (kind, most) in [(Kind::Fc, 512), (Kind::Gru, 16 * 50)] {
            let network = Network { kind, inputs: 1, hidden: 1, outputs: 1 };
            for copies in [64, 1024] {
                let (mut batch, mut part, episodes) = (Batch::default(), Part::default(), episodes(copies));
                batch.begin(&episodes, &network);
                batch.compute_returns(&episodes, 1, 0.0, EndOfBatch::Correct);
                let mut rows = 0;
                for k in 0..batch.parts.len() {
                    part.fill(&batch, k, &episodes, 1);
                    assert!(part.steps.rows() <= most, "{kind:?}: {}", part.steps.rows());
                    // Without discounting the return is the reward, here the number of the episode.
                    assert_eq!(part.returns, part.obs);
                    rows += part.steps.rows();
                }
                assert_eq!((rows, batch.rows), (50 * copies, 50 * copies));
            }
        }
    }
}
