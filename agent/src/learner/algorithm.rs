//! What the learner of an agent needs from an algorithm.

use algos::device::Device;
use algos::host::{Host, Seconds};
use algos::learner::{Choice, Scalars};
use algos::rollout::Episode;
use algos::saved::NamedTensor;
use process::Failure;
use proto::Mode;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use store::RoleFolder;

/// The rows of a tick whose episodes are running.
pub struct Rows<'a> {
    pub mode: Mode,
    /// Environment steps before this round.
    pub t_env: u64,
    /// Environment copy of each row.
    pub copies: &'a [u16],
    /// `rows × inputs`.
    pub inputs: &'a [f32],
    /// `rows × n_actions`.
    pub avail: &'a [u8],
}

/// Finds the numbers of a saved tensor by its name.
pub type Find<'a> = dyn Fn(&str) -> Option<&'a [f32]> + 'a;

/// An algorithm on the bus: [`super::on_policy`] and [`super::off_policy`] are the two kinds.
///
/// A recorded round has one or more lessons. Each lesson takes the next episodes and makes at most one update call.
pub trait Algorithm {
    /// Prepares for learning: opens what the algorithm stores beside the checkpoints. `restored`: a checkpoint was
    /// restored before.
    ///
    /// # Errors
    /// I/O errors.
    fn open(&mut self, folder: &RoleFolder, restored: bool) -> Result<(), Failure>;

    fn compute_on(&mut self, device: &Device);

    fn run_on(&mut self, host: Host);

    fn seconds(&self) -> Seconds;

    /// Update calls completed.
    fn update_calls(&self) -> u64;

    /// Chooses actions in tests in this way, if the algorithm has a choice.
    fn choose_in_tests(&mut self, choice: Choice);

    /// Starts an episode in each of `copies` environment copies.
    fn begin_round(&mut self, copies: usize);

    /// Chooses an action for each row.
    fn act(&mut self, rows: &Rows, rng: &mut ChaCha8Rng, actions: &mut Vec<u16>);

    /// Episodes in a lesson of a round with this many.
    fn lesson_size(&self, episodes: usize) -> usize;

    /// Update calls that the lessons of a round of `episodes` episodes will make.
    fn updates_due(&self, episodes: usize) -> u64;

    /// One lesson: at most one update call with learning rate `lr`, and what it reports.
    ///
    /// # Errors
    /// I/O errors.
    fn learn(&mut self, episodes: &[Episode], t_env: u64, lr: f64) -> Result<Option<Scalars>, Failure>;

    fn tensors(&self) -> Vec<NamedTensor<'_>>;

    /// The first tensor that holds an infinite or NaN number, with that number.
    fn first_not_finite(&self) -> Option<(String, f32)>;

    /// Names the kind of learner in checkpoints.
    fn kind(&self) -> &'static str;

    /// What a checkpoint keeps beside the tensors. Everything that is stored elsewhere
    /// is on the disk after this.
    ///
    /// # Errors
    /// I/O errors.
    fn counters(&self) -> Result<Value, Failure>;

    /// Restores what [`Algorithm::counters`] gave.
    ///
    /// # Errors
    /// If the counters or a tensor do not fit this learner.
    fn restore(&mut self, counters: &Value, tensor: &Find) -> Result<(), String>;

    /// Call after a checkpoint was written: frees what no kept checkpoint needs.
    ///
    /// # Errors
    /// I/O errors.
    fn saved(&mut self) -> Result<(), Failure>;
}
