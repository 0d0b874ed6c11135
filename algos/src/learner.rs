//! What all learners of this crate have in common: the part of an algorithm that a process needs to know.
//!
//! A new algorithm implements [`Learner`], and [`OnPolicy`] or [`OffPolicy`].

use rand::Rng;
use serde::de::DeserializeOwned;
use serde::Serialize;

use crate::device::Device;
use crate::host::{Host, Seconds};
use crate::rollout::Episode;
use crate::saved::{NamedTensor, RestoreError};

/// What an update call reports, by name and in the order of metric rows.
pub type Scalars = Vec<(&'static str, f64)>;

/// One agent's learner.
pub trait Learner {
    /// Names the kind of learner in checkpoints.
    const KIND: &'static str;

    /// What a checkpoint keeps beside the tensors.
    type Counters: Serialize + DeserializeOwned;

    /// Computes the networks' passes on this device from now on. The caller calls [`Device::check`] before it uses
    /// the result of an update call or an action.
    fn compute_on(&mut self, device: &Device);

    /// Uses the clock and the threads of `host` from now on.
    fn run_on(&mut self, host: Host);

    /// Seconds so far.
    fn seconds(&self) -> Seconds;

    /// Update calls completed, the `u` of the schedule.
    fn update_calls(&self) -> u64;

    /// Starts an episode in each of `copies` environment copies: recurrent states are zero.
    fn begin_round(&mut self, copies: usize);

    /// One update call with learning rate `lr`. Every episode has at least one step.
    fn learn(&mut self, episodes: &[Episode], lr: f64) -> Scalars;

    /// All tensors, named; those of the optimisers start with `adam.`.
    fn tensors(&self) -> Vec<NamedTensor<'_>>;

    /// The first of [`Self::tensors`] that holds an infinite or NaN number, with that number.
    fn first_not_finite(&self) -> Option<(String, f32)>;

    /// The small part of a checkpoint.
    fn counters(&self) -> Self::Counters;

    /// Restores a saved learner; `tensor` finds the numbers of a name.
    ///
    /// # Errors
    /// If a tensor is missing or has another size; this learner is then unchanged.
    fn restore<'a>(
        &mut self,
        counters: &Self::Counters,
        tensor: impl Fn(&str) -> Option<&'a [f32]>,
    ) -> Result<(), RestoreError>;
}

/// How a policy's probabilities become an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// Drawn, as in training.
    Sample,
    /// The most probable one, the lowest of equals.
    Greedy,
}

/// A learner with a policy, which learns once from each round.
///
/// Row `k` of a tick shows environment copy `copies[k]`: `obs` is `rows × inputs`, `avail` is `rows × n_actions`.
pub trait OnPolicy: Learner {
    /// Chooses one available action for each row. Draws exactly one number per row from `rng`.
    fn act(
        &mut self,
        copies: &[u16],
        obs: &[f32],
        avail: &[u8],
        choice: Choice,
        rng: &mut impl Rng,
        actions: &mut Vec<u16>,
    );
}

/// A learner of action values, which learns from stored episodes. Rows are as in [`OnPolicy`].
pub trait OffPolicy: Learner {
    /// Chooses one available action for each row, at random with probability `epsilon`, else the best. Draws the
    /// same count of numbers from `rng` for every row, whatever `epsilon` is.
    fn act(
        &mut self,
        copies: &[u16],
        obs: &[f32],
        avail: &[u8],
        epsilon: f64,
        rng: &mut impl Rng,
        actions: &mut Vec<u16>,
    );
}
