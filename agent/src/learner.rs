//! Connects this process with the learners of `algos`: ticks to inputs, rounds to lessons, state to checkpoints.

use std::collections::VecDeque;

use algos::device::{Device, DeviceName};
use algos::host::{Host, Seconds};
use algos::iql::{self, Iql};
use algos::ppo::{self, Choice, Ppo};
use algos::rollout::{self, Rollout};
use process::Failure;
use proto::config::{Config, Draws, PolicyTest, QLearning};
use proto::control::Seat;
use proto::exit;
use proto::stream::stream;
use proto::{End, Mode, Observe};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use store::{Checkpoint, Position, RoleFolder, Tensor, KEEP};

use crate::diverged;
use crate::input::Input;
use crate::progress::Unlogged;
use crate::replay::{Replay, DEFAULT_MEMORY_BYTES};
use crate::settings;

/// The part of a checkpoint that is not a tensor.
#[derive(Serialize, Deserialize)]
pub struct Saved {
    /// Training rounds completed.
    rounds: u64,
    counters: Counters,
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

/// The counters of one kind of learner.
#[derive(Serialize, Deserialize)]
enum Counters {
    Ppo(ppo::Counters),
    Q {
        counters: iql::Counters,
        /// Episodes stored so far.
        remembered: u64,
    },
}

/// The report of an update call: names and values, in the order of metric rows.
pub type Scalars = Vec<(&'static str, f64)>;

/// The agent's learner and the round it is in.
pub struct Learner {
    method: Method,
    input: Input,
    rounds: u64,
    seed: u64,
    id: u32,
    device: Device,
    /// The device's kind.
    device_kind: &'static str,
    rollout: Rollout,
    actions: Vec<u16>,
    /// Buffers for the running rows of a tick in which not all rows run.
    running: Running,
}

/// The kinds of learner.
enum Method {
    Ppo { ppo: Box<Ppo>, in_tests: Choice },
    Q(Box<Q>),
}

struct Q {
    iql: Iql,
    settings: QLearning,
    /// `None` in a learner that only acts.
    replay: Option<Replay>,
    /// Number of stored episodes at the newest checkpoints, the oldest first.
    saved: VecDeque<u64>,
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
        let size = input.size();
        let method = match (&config.ppo, &config.q) {
            (Some(ppo), _) => Method::Ppo {
                ppo: Box::new(Ppo::with_extra_inputs(
                    settings::ppo(config, ppo),
                    (obs_size, size - obs_size),
                    n_actions,
                    &mut rng,
                )),
                in_tests: match ppo.policy_test {
                    PolicyTest::Sample => Choice::Sample,
                    PolicyTest::Greedy => Choice::Greedy,
                },
            },
            (None, Some(q)) => Method::Q(Box::new(Q {
                iql: Iql::new(settings::iql(config, q), size, n_actions, &mut rng),
                settings: q.clone(),
                replay: None,
                saved: VecDeque::new(),
            })),
            (None, None) => unreachable!("a valid configuration has the section of its learner"),
        };
        Self {
            method,
            input,
            rounds: 0,
            seed: config.seed,
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
        if let Method::Q(q) = &mut learner.method {
            let remembered = match saved.as_ref().map(|saved| &saved.counters) {
                Some(Counters::Q { remembered, .. }) => *remembered,
                _ => 0,
            };
            let file = folder.episodes(remembered)?;
            q.replay = Some(Replay::open(file, q.settings.buffer as usize, DEFAULT_MEMORY_BYTES)?);
            q.saved.extend(saved.is_some().then_some(remembered));
        }
        Ok((learner, saved))
    }

    /// Computes on this device from now on. It must have been opened in this thread.
    pub fn compute_on(&mut self, name: DeviceName, device: Device) {
        match &mut self.method {
            Method::Ppo { ppo, .. } => ppo.compute_on(&device),
            Method::Q(q) => q.iql.compute_on(&device),
        }
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
        match &self.method {
            Method::Ppo { ppo, .. } => ppo.update_calls(),
            Method::Q(q) => q.iql.update_calls(),
        }
    }

    /// Uses this clock and these threads from now on.
    pub fn run_on(&mut self, host: Host) {
        match &mut self.method {
            Method::Ppo { ppo, .. } => ppo.run_on(host),
            Method::Q(q) => q.iql.run_on(host),
        }
    }

    /// The learner's own seconds so far.
    pub fn seconds(&self) -> Seconds {
        match &self.method {
            Method::Ppo { ppo, .. } => ppo.seconds(),
            Method::Q(q) => q.iql.seconds(),
        }
    }

    /// Overrides how PPO chooses actions in tests. Q-learning has no such choice.
    pub fn choose_in_tests(&mut self, choice: Choice) {
        if let Method::Ppo { in_tests, .. } = &mut self.method {
            *in_tests = choice;
        }
    }

    /// Starts a round of `copies` episodes. Tests are not recorded.
    pub fn begin_round(&mut self, copies: usize, record: bool) {
        match &mut self.method {
            Method::Ppo { ppo, .. } => ppo.begin_round(copies),
            Method::Q(q) => q.iql.begin_round(copies),
        }
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
        let actions = &mut self.actions;
        match &mut self.method {
            Method::Ppo { ppo, in_tests } => {
                let choice = if observe.mode == Mode::Test { *in_tests } else { Choice::Sample };
                ppo.act(copies, inputs, avail, choice, rng, actions);
            }
            Method::Q(q) => {
                let epsilon = match observe.mode {
                    Mode::Test => q.settings.test_epsilon,
                    _ => q.epsilon(observe.t_env),
                };
                q.iql.act(copies, inputs, avail, epsilon, rng, actions);
            }
        }
        for (&copy, &action) in copies.iter().zip(actions.iter()) {
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
        match &self.method {
            Method::Ppo { .. } => 1,
            Method::Q(_) => self.rollout.episodes().len(),
        }
    }

    /// Number of update calls in the lessons of the recorded round: fewer than lessons while too few episodes are
    /// stored.
    pub fn updates_due(&self) -> u64 {
        match &self.method {
            Method::Ppo { .. } => 1,
            Method::Q(q) => {
                let after = q.remembered() + self.rollout.episodes().len();
                let first = (q.settings.batch as usize).max(q.remembered() + 1);
                (after + 1).saturating_sub(first) as u64
            }
        }
    }

    /// One lesson, with at most one update call at the learning rate `lr`. Returns its report.
    ///
    /// # Errors
    /// If the device or the disk fails, or a number is infinite or NaN. The learner must not be used after that.
    pub fn learn(&mut self, lesson: usize, t_env: u64, lr: f64) -> Result<Option<Scalars>, Failure> {
        let update_call = self.update_calls();
        self.check_rewards(lesson, update_call)?;
        let scalars = match &mut self.method {
            Method::Ppo { ppo, .. } => Some(of_ppo(&ppo.update(&self.rollout, lr), lr)),
            Method::Q(q) => {
                let epsilon = q.epsilon(t_env);
                let replay = q.replay.as_mut().expect("a learner that learns was started with one");
                replay.push(&self.rollout.episodes()[lesson])?;
                let batch = q.settings.batch as usize;
                if replay.len() < batch {
                    return Ok(None);
                }
                let mut rng = draws(q.settings.draws, self.seed, self.id, q.iql.update_calls());
                let stats = q.iql.update(replay.sample(batch, &mut rng)?, lr);
                Some(of_q(&stats, lr, epsilon))
            }
        };
        self.check_device()?;
        if let Some(scalars) = &scalars {
            self.check_numbers(scalars, update_call)?;
        }
        Ok(scalars)
    }

    /// Checks that the rewards of a lesson are finite.
    fn check_rewards(&self, lesson: usize, update_call: u64) -> Result<(), Failure> {
        let episodes = self.rollout.episodes();
        let of_lesson = match &self.method {
            Method::Ppo { .. } => 0..episodes.len(),
            Method::Q(_) => lesson..lesson + 1,
        };
        for copy in of_lesson {
            if let Some(step) = episodes[copy].rewards.iter().position(|reward| !reward.is_finite()) {
                let reward = episodes[copy].rewards[step];
                return Err(diverged::by_reward(self.id, update_call, reward, (copy, step)));
            }
        }
        Ok(())
    }

    /// Checks that the scalars of an update call and all tensors are finite.
    fn check_numbers(&self, scalars: &[(&'static str, f64)], update_call: u64) -> Result<(), Failure> {
        let bad_scalar = scalars.iter().find(|(_, value)| !value.is_finite());
        let bad = bad_scalar.map(|&(name, value)| (name.to_owned(), value)).or_else(|| {
            let bad = match &self.method {
                Method::Ppo { ppo, .. } => ppo.first_not_finite(),
                Method::Q(q) => q.iql.first_not_finite(),
            };
            bad.map(|(name, value)| (name, f64::from(value)))
        });
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
        let (counters, tensors) = match &mut self.method {
            Method::Ppo { ppo, .. } => (Counters::Ppo(ppo.counters()), ppo.tensors()),
            Method::Q(q) => {
                let remembered = q.replay.as_ref().map_or(Ok(0), Replay::sync)?;
                (Counters::Q { counters: q.iql.counters(), remembered }, q.iql.tensors())
            }
        };
        let saved = Saved {
            rounds: self.rounds,
            counters,
            unlogged: unlogged.clone(),
            metrics,
            device: self.device_kind.to_owned(),
        };
        let state = serde_json::to_vec(&saved).expect("numbers and strings always serialise");
        let tensors = tensors.into_iter();
        let tensors =
            tensors.map(|(name, shape, data)| Tensor { name, shape, data: data.to_vec() }).collect();
        Ok(Checkpoint { round: self.rounds, state, tensors })
    }

    /// Call after a save: removes episodes that no kept checkpoint needs.
    ///
    /// # Errors
    /// I/O errors.
    pub fn saved(&mut self) -> Result<(), Failure> {
        let Method::Q(q) = &mut self.method else { return Ok(()) };
        let Q { replay: Some(replay), saved, .. } = &mut **q else { return Ok(()) };
        saved.push_back(replay.position());
        if saved.len() > KEEP {
            saved.pop_front();
        }
        if saved.len() == KEEP {
            replay.forget_before(saved[0])?;
        }
        Ok(())
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
        match (&mut self.method, &saved.counters) {
            (Method::Ppo { ppo, .. }, Counters::Ppo(counters)) => ppo.restore(counters, find),
            (Method::Q(q), Counters::Q { counters, .. }) => q.iql.restore(counters, find),
            _ => return Err(of_round("it was written by another kind of learner".to_owned())),
        }
        .map_err(|error| of_round(error.to_string()))?;
        self.rounds = saved.rounds;
        Ok(saved)
    }
}

impl Q {
    fn epsilon(&self, t_env: u64) -> f64 {
        let QLearning { epsilon_start, epsilon_finish, epsilon_anneal, .. } = self.settings;
        iql::epsilon(t_env, epsilon_start, epsilon_finish, epsilon_anneal)
    }

    fn remembered(&self) -> usize {
        self.replay.as_ref().map_or(0, Replay::len)
    }
}

/// The stream that draws the minibatch of an update call. All agents store the same episodes in the same order, so a
/// common stream draws the same ones for the whole team (algorithms §5.1).
fn draws(draws: Draws, seed: u64, id: u32, update_call: u64) -> ChaCha8Rng {
    let owner = match draws {
        Draws::Joint => "team".to_owned(),
        Draws::Independent => owner(id),
    };
    stream(seed, &owner, "replay", &[update_call])
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

fn of_ppo(stats: &ppo::UpdateStats, lr: f64) -> Scalars {
    vec![
        ("actor_loss", stats.actor_loss),
        ("critic_loss", stats.critic_loss),
        ("entropy", stats.entropy),
        ("actor_grad_norm", stats.actor_grad_norm),
        ("critic_grad_norm", stats.critic_grad_norm),
        ("clip_fraction", stats.clip_fraction),
        ("advantage_mean", stats.advantage_mean),
        ("target_mean", stats.target_mean),
        ("lr", lr),
    ]
}

fn of_q(stats: &iql::UpdateStats, lr: f64, epsilon: f64) -> Scalars {
    vec![
        ("loss", stats.loss),
        ("grad_norm", stats.grad_norm),
        ("td_error_abs", stats.td_error_abs),
        ("q_taken_mean", stats.q_taken_mean),
        ("target_mean", stats.target_mean),
        ("epsilon", epsilon),
        ("lr", lr),
    ]
}

/// The owner of an agent's random streams.
pub fn owner(id: u32) -> String {
    format!("agent/{id}")
}

#[cfg(test)]
mod tests;
