//! Between this process and the pure learners: ticks become inputs, rounds become lessons, state becomes
//! checkpoints.

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

/// What a checkpoint holds beside the tensors.
#[derive(Serialize, Deserialize)]
pub struct Saved {
    /// Training rounds completed.
    rounds: u64,
    /// The kind of learner and its counters.
    counters: Map<String, Value>,
    /// Scalars that no metric row has yet.
    pub unlogged: Unlogged,
    /// How far metrics.jsonl had come.
    pub metrics: Position,
    /// The kind of device that the last round was learned on.
    #[serde(default = "on_cpu")]
    pub device: String,
}

/// What checkpoints were made on that say nothing about it.
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
    /// Rows that still run, when not all of a tick do.
    running: Running,
}

#[derive(Default)]
struct Running {
    copies: Vec<u16>,
    inputs: Vec<f32>,
    avail: Vec<u8>,
}

impl Learner {
    /// A learner with the initial weights that seed and id determine, for acting.
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

    /// A learner that will learn, from the round that its seat names; with what else its checkpoint holds.
    ///
    /// # Errors
    /// If the checkpoint is of another kind of learner or cannot be read, or the disk fails.
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

    /// From now on computes on this device, which has been opened in this thread.
    pub fn compute_on(&mut self, name: DeviceName, device: Device) {
        self.algorithm.compute_on(&device);
        (self.device, self.device_kind) = (device, name.kind());
    }

    /// Whether the device has computed everything that it was asked for; if not, what was learned or chosen since
    /// the last checkpoint is of no use.
    ///
    /// # Errors
    /// With the first failure.
    pub fn check_device(&self) -> Result<(), Failure> {
        self.device.check().map_err(|error| {
            let hint =
                "hint: the last checkpoint is intact; is the GPU's memory full? `rondo resume` goes on from \
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

    /// From now on the learner uses this clock, and these threads.
    pub fn run_on(&mut self, host: Host) {
        self.algorithm.run_on(host);
    }

    /// Where the time of the learner itself went so far.
    pub fn seconds(&self) -> Seconds {
        self.algorithm.seconds()
    }

    /// Tests with the most probable actions, or with drawn ones, whatever the configuration says. Q-learning
    /// always takes the best.
    pub fn choose_in_tests(&mut self, choice: Choice) {
        self.algorithm.choose_in_tests(choice);
    }

    /// Starts a round of `copies` episodes; only those to learn from are recorded.
    pub fn begin_round(&mut self, copies: usize, record: bool) {
        self.algorithm.begin_round(copies);
        self.input.begin_round(copies);
        if record {
            self.rollout.begin(copies);
        }
    }

    /// Takes in one tick and chooses an action for every row that still runs.
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

    /// Into how many lessons the recorded round falls: one for PPO, one for each episode in Q-learning (algorithms
    /// §5.1).
    pub fn lessons(&self) -> usize {
        let episodes = self.rollout.episodes().len();
        episodes / self.algorithm.lesson_size(episodes)
    }

    /// Update calls that the lessons of the recorded round will make: fewer than lessons, while too few episodes
    /// are remembered.
    pub fn updates_due(&self) -> u64 {
        self.algorithm.updates_due(self.rollout.episodes().len())
    }

    /// One lesson, with at most one update call at the learning rate `lr`; what it reports.
    ///
    /// # Errors
    /// If the device fails, or the disk on which episodes are remembered, or a number is none any more. After that this
    /// learner is of no use.
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

    /// Whether all rewards of a lesson are finite; `first` is the copy of its first episode.
    fn check_rewards(&self, first: usize, episodes: &[Episode], update_call: u64) -> Result<(), Failure> {
        for (copy, episode) in (first..).zip(episodes) {
            if let Some(step) = episode.rewards.iter().position(|reward| !reward.is_finite()) {
                return Err(diverged::by_reward(self.id, update_call, episode.rewards[step], (copy, step)));
            }
        }
        Ok(())
    }

    /// Whether what an update call reports is finite, then everything that it learned.
    fn check_numbers(&self, scalars: &Scalars, update_call: u64) -> Result<(), Failure> {
        let bad_scalar = scalars.iter().find(|(_, value)| !value.is_finite());
        let bad = bad_scalar
            .map(|&(name, value)| (name.to_owned(), value))
            .or_else(|| self.algorithm.first_not_finite().map(|(name, value)| (name, f64::from(value))));
        bad.map_or(Ok(()), |(name, value)| Err(diverged::by_learning(self.id, update_call, &name, value)))
    }

    /// Ends the round whose lessons have been learned.
    pub fn end_round(&mut self) {
        self.rounds += 1;
    }

    /// Everything that the next round depends on.
    ///
    /// # Errors
    /// If the disk fails on which episodes are remembered.
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

    /// The checkpoint just made is on the disk: what no kept checkpoint can come back to is forgotten.
    ///
    /// # Errors
    /// If the disk fails.
    pub fn saved(&mut self) -> Result<(), Failure> {
        self.algorithm.saved()
    }

    /// Goes back to the networks and counters of a checkpoint.
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

/// Notes what a tick shows of each copy, and what its last action earned.
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
