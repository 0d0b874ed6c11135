//! Between this process and the pure learner: its configuration, its rollouts, its checkpoints.

use algos::network::Kind;
use algos::ppo::{self, Counters, Ppo, UpdateStats};
use algos::returns::EndOfBatch;
use algos::reward_stats::Standardisation;
use algos::rollout::{self, Rollout};
use process::Failure;
use proto::config::{self, Config};
use proto::control::Seat;
use proto::exit;
use proto::stream::stream;
use proto::{End, Observe};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use store::{Checkpoint, Position, Tensor};

use crate::progress::Unlogged;

/// What a checkpoint holds beside the tensors.
#[derive(Serialize, Deserialize)]
pub struct Saved {
    counters: Counters,
    /// Scalars that no metric row has yet.
    pub unlogged: Unlogged,
    /// How far metrics.jsonl had come.
    pub metrics: Position,
}

/// The agent's learner and the round it is in.
pub struct Learner {
    ppo: Ppo,
    rollout: Rollout,
    actions: Vec<u16>,
    /// Rows that still run, when not all of a tick do.
    running: Running,
}

#[derive(Default)]
struct Running {
    copies: Vec<u16>,
    obs: Vec<f32>,
    avail: Vec<u8>,
}

impl Learner {
    /// A fresh learner with the initial weights that seed and id determine.
    pub fn new(config: &Config, id: u32, seat: &Seat) -> Self {
        let mut rng = stream(config.seed, &owner(id), "initial-weights", &[]);
        let sizes = (seat.obs_size as usize, seat.n_actions as usize);
        Self {
            ppo: Ppo::new(hyperparameters(config), sizes.0, sizes.1, &mut rng),
            rollout: Rollout::default(),
            actions: Vec::new(),
            running: Running::default(),
        }
    }

    /// Update calls completed.
    pub fn update_calls(&self) -> u64 {
        self.ppo.update_calls()
    }

    /// Starts a round of `copies` episodes; only those to learn from are recorded.
    pub fn begin_round(&mut self, copies: usize, record: bool) {
        self.ppo.begin_round(copies);
        if record {
            self.rollout.begin(copies);
        }
    }

    /// Takes in one tick and chooses an action for every row that still runs.
    pub fn tick(&mut self, observe: &Observe, record: bool, rng: &mut ChaCha8Rng) -> &[u16] {
        if record {
            self.record(observe);
        }
        let all_run = observe.ends.iter().all(|&end| end == End::Running);
        let (copies, obs, avail) = if all_run {
            (&observe.copies, &observe.obs, &observe.avail)
        } else {
            let Running { copies, obs, avail } = &mut self.running;
            copies.clear();
            obs.clear();
            avail.clear();
            for row in observe.running() {
                copies.push(observe.copies[row]);
                obs.extend_from_slice(observe.observation(row));
                avail.extend_from_slice(observe.available(row));
            }
            (&*copies, &*obs, &*avail)
        };
        self.ppo.act(copies, obs, avail, rng, &mut self.actions);
        if record {
            for (&copy, &action) in copies.iter().zip(&self.actions) {
                self.rollout.act(usize::from(copy), action);
            }
        }
        &self.actions
    }

    fn record(&mut self, observe: &Observe) {
        for row in 0..observe.rows() {
            let copy = usize::from(observe.copies[row]);
            if observe.tick > 0 {
                let end = match observe.ends[row] {
                    End::Running => rollout::End::Running,
                    End::Terminated => rollout::End::Terminated,
                    End::TimeLimit => rollout::End::TimeLimit,
                };
                self.rollout.outcome(copy, observe.rewards[row], end);
            }
            self.rollout.observe(copy, observe.observation(row), observe.available(row));
        }
    }

    /// Environment steps of the recorded round.
    pub fn steps(&self) -> u64 {
        self.rollout.episodes().iter().map(|episode| episode.len() as u64).sum()
    }

    /// The update call on the recorded round.
    pub fn update(&mut self, lr: f64) -> UpdateStats {
        self.ppo.update(&self.rollout, lr)
    }

    /// Everything that the next update call depends on.
    pub fn checkpoint(&self, unlogged: &Unlogged, metrics: Position) -> Checkpoint {
        let saved = Saved { counters: self.ppo.counters(), unlogged: unlogged.clone(), metrics };
        let state = serde_json::to_vec(&saved).expect("numbers and strings always serialise");
        let tensors = self.ppo.tensors().into_iter();
        let tensors =
            tensors.map(|(name, shape, data)| Tensor { name, shape, data: data.to_vec() }).collect();
        Checkpoint { round: self.ppo.update_calls(), state, tensors }
    }

    /// Goes back to a checkpoint.
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
        self.ppo.restore(&saved.counters, find).map_err(|e| of_round(e.to_string()))?;
        Ok(saved)
    }
}

/// The owner of an agent's random streams.
pub fn owner(id: u32) -> String {
    format!("agent/{id}")
}

fn hyperparameters(config: &Config) -> ppo::Config {
    let algo = &config.algo;
    ppo::Config {
        actor: match algo.network {
            config::Network::Fc => Kind::Fc,
            config::Network::Gru => Kind::Gru,
        },
        hidden: algo.hidden as usize,
        agents: config.world.agents as usize,
        gamma: algo.gamma as f32,
        epochs: algo.epochs as usize,
        clip: algo.clip as f32,
        entropy_coef: algo.entropy_coef as f32,
        n_step: algo.n_step as usize,
        target_update: algo.target_update,
        max_grad_norm: algo.max_grad_norm,
        end_of_batch: match algo.end_of_batch {
            config::EndOfBatch::Epymarl => EndOfBatch::Epymarl,
            config::EndOfBatch::NoBootstrap => EndOfBatch::NoBootstrap,
            config::EndOfBatch::Benchmark2021 => EndOfBatch::Benchmark2021,
            config::EndOfBatch::Correct => EndOfBatch::Correct,
        },
        reward_standardisation: match algo.reward_standardisation {
            config::RewardStandardisation::Off => Standardisation::Off,
            config::RewardStandardisation::Running => Standardisation::Running,
            config::RewardStandardisation::Batch => Standardisation::Batch,
        },
        hold_frozen_moments: algo.frozen_moments == config::FrozenMoments::Hold,
    }
}
