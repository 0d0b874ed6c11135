//! Algorithms that learn from stored episodes: every episode of a round is a lesson, which stores it and learns from
//! a minibatch of all that are stored (algorithms §5.1).

use std::collections::VecDeque;

use algos::device::Device;
use algos::host::{Host, Seconds};
use algos::iql;
use algos::learner::{Choice, Scalars};
use algos::rollout::Episode;
use algos::saved::NamedTensor;
use process::Failure;
use proto::config::{Draws, QLearning};
use proto::stream::stream;
use proto::Mode;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use store::{RoleFolder, KEEP};

use super::algorithm::{Algorithm, Find, Rows};
use super::owner;
use crate::replay::{Replay, DEFAULT_MEMORY_BYTES};

/// Action values, and the episodes to learn them from.
pub struct OffPolicy<L> {
    learner: L,
    settings: QLearning,
    seed: u64,
    id: u32,
    /// Episodes that the restored checkpoint counted.
    restored: u64,
    /// None in a learner that only acts.
    replay: Option<Replay>,
    /// Episodes stored at the newest checkpoints, the oldest first.
    saved: VecDeque<u64>,
}

/// What a checkpoint keeps beside the tensors.
#[derive(Serialize, Deserialize)]
struct Counters<C> {
    counters: C,
    /// Episodes stored since the start of the run.
    remembered: u64,
}

impl<L> OffPolicy<L> {
    /// Agent `id` of a run with this seed; it can act.
    pub fn new(learner: L, settings: QLearning, seed: u64, id: u32) -> Self {
        Self { learner, settings, seed, id, restored: 0, replay: None, saved: VecDeque::new() }
    }

    fn epsilon(&self, t_env: u64) -> f64 {
        let QLearning { epsilon_start, epsilon_finish, epsilon_anneal, .. } = self.settings;
        iql::epsilon(t_env, epsilon_start, epsilon_finish, epsilon_anneal)
    }
}

impl<L: algos::learner::OffPolicy> Algorithm for OffPolicy<L> {
    fn open(&mut self, folder: &RoleFolder, restored: bool) -> Result<(), Failure> {
        let file = folder.episodes(self.restored)?;
        self.replay = Some(Replay::open(file, self.settings.buffer as usize, DEFAULT_MEMORY_BYTES)?);
        self.saved.extend(restored.then_some(self.restored));
        Ok(())
    }

    fn compute_on(&mut self, device: &Device) {
        self.learner.compute_on(device);
    }

    fn run_on(&mut self, host: Host) {
        self.learner.run_on(host);
    }

    fn seconds(&self) -> Seconds {
        self.learner.seconds()
    }

    fn update_calls(&self) -> u64 {
        self.learner.update_calls()
    }

    /// Has no effect: tests take the best action, except with probability `q.test_epsilon`.
    fn choose_in_tests(&mut self, _: Choice) {}

    fn begin_round(&mut self, copies: usize) {
        self.learner.begin_round(copies);
    }

    fn act(&mut self, rows: &Rows, rng: &mut ChaCha8Rng, actions: &mut Vec<u16>) {
        let epsilon = match rows.mode {
            Mode::Test => self.settings.test_epsilon,
            _ => self.epsilon(rows.t_env),
        };
        self.learner.act(rows.copies, rows.inputs, rows.avail, epsilon, rng, actions);
    }

    fn lesson_size(&self, _: usize) -> usize {
        1
    }

    /// Fewer than lessons while less than a minibatch is stored.
    fn updates_due(&self, episodes: usize) -> u64 {
        let stored = self.replay.as_ref().map_or(0, Replay::len);
        let first = (self.settings.batch as usize).max(stored + 1);
        (stored + episodes + 1).saturating_sub(first) as u64
    }

    fn learn(&mut self, episodes: &[Episode], t_env: u64, lr: f64) -> Result<Option<Scalars>, Failure> {
        let (epsilon, batch) = (self.epsilon(t_env), self.settings.batch as usize);
        let mut draws = draws(self.settings.draws, self.seed, self.id, self.learner.update_calls());
        let replay = self.replay.as_mut().expect("open comes before learn");
        for episode in episodes {
            replay.push(episode)?;
        }
        if replay.len() < batch {
            return Ok(None);
        }
        let mut scalars = self.learner.learn(replay.sample(batch, &mut draws)?, lr);
        scalars.extend([("epsilon", epsilon), ("lr", lr)]);
        Ok(Some(scalars))
    }

    fn tensors(&self) -> Vec<NamedTensor<'_>> {
        self.learner.tensors()
    }

    fn first_not_finite(&self) -> Option<(String, f32)> {
        self.learner.first_not_finite()
    }

    fn kind(&self) -> &'static str {
        L::KIND
    }

    fn counters(&self) -> Result<Value, Failure> {
        let remembered = self.replay.as_ref().map_or(Ok(0), Replay::sync)?;
        let counters = serde_json::to_value(Counters { counters: self.learner.counters(), remembered });
        Ok(counters.expect("numbers and strings always serialise"))
    }

    fn restore(&mut self, counters: &Value, tensor: &Find) -> Result<(), String> {
        let Counters { counters, remembered } =
            Counters::<L::Counters>::deserialize(counters).map_err(|error| error.to_string())?;
        self.learner.restore(&counters, tensor).map_err(|error| error.to_string())?;
        self.restored = remembered;
        Ok(())
    }

    fn saved(&mut self) -> Result<(), Failure> {
        let Self { replay: Some(replay), saved, .. } = self else { return Ok(()) };
        saved.push_back(replay.position());
        if saved.len() > KEEP {
            saved.pop_front();
        }
        if saved.len() == KEEP {
            replay.forget_before(saved[0])?;
        }
        Ok(())
    }
}

/// Draws the minibatch of an update call. All agents store the same episodes in the same order, so one stream gives
/// the whole team the same minibatch.
pub fn draws(draws: Draws, seed: u64, id: u32, update_call: u64) -> ChaCha8Rng {
    let owner = match draws {
        Draws::Joint => "team".to_owned(),
        Draws::Independent => owner(id),
    };
    stream(seed, &owner, "replay", &[update_call])
}
