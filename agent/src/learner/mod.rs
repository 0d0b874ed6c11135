//! Connects this process with the learners of `algos`: ticks to inputs, rounds to lessons, state to checkpoints.

mod algorithm;
mod off_policy;
mod on_policy;

use algos::device::{Device, DeviceName};
use algos::host::{Host, Seconds};
use algos::learner::Choice;
use algos::rollout::{self, Episode, Rollout};
use process::Failure;
use proto::config::Config;
use proto::control::Seat;
use proto::exit;
use proto::stream::stream;
use proto::{End, Observe};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use store::{Checkpoint, Position, RoleFolder, Tensor};

use crate::diverged;
use crate::input::Input;
use crate::progress::Unlogged;
use crate::settings;

pub use algorithm::Algorithm;
use algorithm::Rows;
pub use algos::learner::Scalars;
pub use off_policy::OffPolicy;
pub use on_policy::OnPolicy;

/// The part of a checkpoint that is not a tensor.
#[derive(Serialize, Deserialize)]
pub struct Saved {
    /// Training rounds completed.
    rounds: u64,
    /// The kind of learner and its counters.
    counters: Map<String, Value>,
    /// Scalars that are not yet in a metric row.
    pub unlogged: Unlogged,
    /// Position in metrics.jsonl.
    pub metrics: Position,
    /// The kind of device of the last round's update calls.
    #[serde(default = "on_cpu")]
    pub device: String,
}

/// Device of checkpoints that record none.
fn on_cpu() -> String {
    DeviceName::Cpu.kind().to_owned()
}

/// The agent's learner and the round it is in.
pub struct Learner {
    algorithm: Box<dyn Algorithm>,
    input: Input,
    rounds: u64,
    id: u32,
    device: Device,
    /// The device's kind.
    device_kind: &'static str,
    rollout: Rollout,
    actions: Vec<u16>,
    /// Buffers for the running rows of a tick in which not all rows run.
    running: Running,
}

#[derive(Default)]
struct Running {
    copies: Vec<u16>,
    inputs: Vec<f32>,
    avail: Vec<u8>,
}

impl Learner {
    /// A learner for acting, with the initial weights that follow from seed and id.
    pub fn new(config: &Config, id: u32, (obs_size, n_actions): (usize, usize)) -> Self {
        let mut rng = stream(config.seed, &owner(id), "initial-weights", &[]);
        let input = Input::new(&config.algo, (id, config.world.agents), (obs_size, n_actions));
        let algorithm =
            settings::algorithm(config, id, (obs_size, input.size() - obs_size), n_actions, &mut rng);
        Self {
            algorithm,
            input,
            rounds: 0,
            id,
            device: Device::default(),
            device_kind: DeviceName::Cpu.kind(),
            rollout: Rollout::default(),
            actions: Vec::new(),
            running: Running::default(),
        }
    }

    /// A learner for training, from the round of its seat, and the rest of that checkpoint.
    ///
    /// # Errors
    /// If the checkpoint is of another kind of learner or cannot be read, or on I/O errors.
    pub fn start(
        config: &Config,
        id: u32,
        seat: &Seat,
        folder: &RoleFolder,
    ) -> Result<(Self, Option<Saved>), Failure> {
        let mut learner = Self::new(config, id, (seat.obs_size as usize, seat.n_actions as usize));
        let saved = match seat.round {
            0 => None,
            round => Some(learner.restore(&folder.checkpoints().load(round)?)?),
        };
        learner.algorithm.open(folder, saved.is_some())?;
        Ok((learner, saved))
    }

    /// Computes on this device from now on. It must have been opened in this thread.
    pub fn compute_on(&mut self, name: DeviceName, device: Device) {
        self.algorithm.compute_on(&device);
        (self.device, self.device_kind) = (device, name.kind());
    }

    /// Checks that no computation on the device has failed. After a failure, everything learned or chosen since the
    /// last checkpoint is invalid.
    ///
    /// # Errors
    /// The first failure.
    pub fn check_device(&self) -> Result<(), Failure> {
        self.device.check().map_err(|error| {
            let hint =
                "hint: the last checkpoint is intact; is the GPU's memory full? `rondo resume` continues from \
                        there, with `--device cpu` too";
            Failure::new(exit::AGAIN, format!("{error}\n{hint}"))
        })
    }

    /// Training rounds completed.
    pub fn rounds(&self) -> u64 {
        self.rounds
    }

    /// Update calls completed.
    pub fn update_calls(&self) -> u64 {
        self.algorithm.update_calls()
    }

    /// Uses this clock and these threads from now on.
    pub fn run_on(&mut self, host: Host) {
        self.algorithm.run_on(host);
    }

    /// The learner's own seconds so far.
    pub fn seconds(&self) -> Seconds {
        self.algorithm.seconds()
    }

    /// Overrides how PPO chooses actions in tests. Q-learning has no such choice.
    pub fn choose_in_tests(&mut self, choice: Choice) {
        self.algorithm.choose_in_tests(choice);
    }

    /// Starts a round of `copies` episodes. Tests are not recorded.
    pub fn begin_round(&mut self, copies: usize, record: bool) {
        self.algorithm.begin_round(copies);
        self.input.begin_round(copies);
        if record {
            self.rollout.begin(copies);
        }
    }

    /// Processes one tick and chooses an action for every running row.
    pub fn tick(&mut self, observe: &Observe, record: bool, rng: &mut ChaCha8Rng) -> &[u16] {
        let size = self.input.size();
        let inputs = self.input.rows(observe);
        if record {
            record_tick(&mut self.rollout, observe, inputs, size);
        }
        let all_run = observe.ends.iter().all(|&end| end == End::Running);
        let (copies, inputs, avail) = if all_run {
            (&observe.copies[..], inputs, &observe.avail[..])
        } else {
            let Running { copies, inputs: of_running, avail } = &mut self.running;
            copies.clear();
            of_running.clear();
            avail.clear();
            for row in observe.running() {
                copies.push(observe.copies[row]);
                of_running.extend_from_slice(&inputs[row * size..(row + 1) * size]);
                avail.extend_from_slice(observe.available(row));
            }
            (&copies[..], &of_running[..], &avail[..])
        };
        let rows = Rows { mode: observe.mode, t_env: observe.t_env, copies, inputs, avail };
        self.algorithm.act(&rows, rng, &mut self.actions);
        for (&copy, &action) in copies.iter().zip(&self.actions) {
            self.input.acted(copy, action);
            if record {
                self.rollout.act(usize::from(copy), action);
            }
        }
        &self.actions
    }

    /// Environment steps of the recorded round.
    pub fn steps(&self) -> u64 {
        self.rollout.episodes().iter().map(|episode| episode.len() as u64).sum()
    }

    /// Number of lessons in the recorded round: one with PPO, one for each episode with Q-learning (algorithms §5.1).
    pub fn lessons(&self) -> usize {
        let episodes = self.rollout.episodes().len();
        episodes / self.algorithm.lesson_size(episodes)
    }

    /// Number of update calls in the lessons of the recorded round: fewer than lessons while too few episodes are
    /// stored.
    pub fn updates_due(&self) -> u64 {
        self.algorithm.updates_due(self.rollout.episodes().len())
    }

    /// One lesson, with at most one update call at the learning rate `lr`. Returns its report.
    ///
    /// # Errors
    /// If the device or the disk fails, or a number is infinite or NaN. The learner must not be used after that.
    pub fn learn(&mut self, lesson: usize, t_env: u64, lr: f64) -> Result<Option<Scalars>, Failure> {
        let update_call = self.update_calls();
        let episodes = self.rollout.episodes();
        let size = self.algorithm.lesson_size(episodes.len());
        let (first, episodes) = (lesson * size, &episodes[lesson * size..][..size]);
        self.check_rewards(first, episodes, update_call)?;
        let scalars = self.algorithm.learn(episodes, t_env, lr)?;
        self.check_device()?;
        if let Some(scalars) = &scalars {
            self.check_numbers(scalars, update_call)?;
        }
        Ok(scalars)
    }

    /// Checks that the rewards of a lesson are finite. `first` is the copy of its first episode.
    fn check_rewards(&self, first: usize, episodes: &[Episode], update_call: u64) -> Result<(), Failure> {
        for (copy, episode) in (first..).zip(episodes) {
            if let Some(step) = episode.rewards.iter().position(|reward| !reward.is_finite()) {
                return Err(diverged::by_reward(self.id, update_call, episode.rewards[step], (copy, step)));
            }
        }
        Ok(())
    }

    /// Checks that the scalars of an update call and all tensors are finite.
    fn check_numbers(&self, scalars: &Scalars, update_call: u64) -> Result<(), Failure> {
        let bad_scalar = scalars.iter().find(|(_, value)| !value.is_finite());
        let bad = bad_scalar
            .map(|&(name, value)| (name.to_owned(), value))
            .or_else(|| self.algorithm.first_not_finite().map(|(name, value)| (name, f64::from(value))));
        bad.map_or(Ok(()), |(name, value)| Err(diverged::by_learning(self.id, update_call, &name, value)))
    }

    /// Ends the round after its lessons.
    pub fn end_round(&mut self) {
        self.rounds += 1;
    }

    /// Everything that the next round depends on.
    ///
    /// # Errors
    /// I/O errors of the stored episodes.
    pub fn checkpoint(&mut self, unlogged: &Unlogged, metrics: Position) -> Result<Checkpoint, Failure> {
        let counters = self.algorithm.counters()?;
        let saved = Saved {
            rounds: self.rounds,
            counters: Map::from_iter([(self.algorithm.kind().to_owned(), counters)]),
            unlogged: unlogged.clone(),
            metrics,
            device: self.device_kind.to_owned(),
        };
        let state = serde_json::to_vec(&saved).expect("numbers and strings always serialise");
        let tensors = self.algorithm.tensors().into_iter();
        let tensors =
            tensors.map(|(name, shape, data)| Tensor { name, shape, data: data.to_vec() }).collect();
        Ok(Checkpoint { round: self.rounds, state, tensors })
    }

    /// Call after a save: removes episodes that no kept checkpoint needs.
    ///
    /// # Errors
    /// I/O errors.
    pub fn saved(&mut self) -> Result<(), Failure> {
        self.algorithm.saved()
    }

    /// Restores the networks and counters of a checkpoint.
    ///
    /// # Errors
    /// If it is of another kind of learner or its state cannot be read.
    pub fn restore(&mut self, checkpoint: &Checkpoint) -> Result<Saved, Failure> {
        let of_round = |problem: String| {
            let text = format!("the checkpoint of round {} cannot be used: {problem}", checkpoint.round);
            Failure::new(exit::CONFIG, text)
        };
        let saved: Saved = serde_json::from_slice(&checkpoint.state).map_err(|e| of_round(e.to_string()))?;
        let find = |name: &str| {
            checkpoint.tensors.iter().find(|tensor| tensor.name == name).map(|tensor| tensor.data.as_slice())
        };
        let counters = saved.counters.get(self.algorithm.kind());
        let counters =
            counters.ok_or_else(|| of_round("it was written by another kind of learner".to_owned()))?;
        self.algorithm.restore(counters, &find).map_err(of_round)?;
        self.rounds = saved.rounds;
        Ok(saved)
    }
}

/// Records the observation of each copy in a tick, and the reward of its last action.
fn record_tick(rollout: &mut Rollout, observe: &Observe, inputs: &[f32], size: usize) {
    for (row, input) in inputs.chunks_exact(size).enumerate() {
        let copy = usize::from(observe.copies[row]);
        if observe.tick > 0 {
            let end = match observe.ends[row] {
                End::Running => rollout::End::Running,
                End::Terminated => rollout::End::Terminated,
                End::TimeLimit => rollout::End::TimeLimit,
            };
            rollout.outcome(copy, observe.rewards[row], end);
        }
        rollout.observe(copy, input, observe.available(row));
    }
}

/// The owner of an agent's random streams.
pub fn owner(id: u32) -> String {
    format!("agent/{id}")
}

#[cfg(test)]
mod tests;
