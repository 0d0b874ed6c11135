//! `rondo train-opponent`: the networks that play the prey of Tag and the adversary of Adversary.
//!
//! All agents of the whole game learn together, each with its own PPO learner, in this process on one thread. Then the
//! actor of the role is written as a frozen network. The result depends on the arguments only.

use std::collections::BTreeMap;
use std::fs::Permissions;
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use algos::learner::{Choice, Learner, OnPolicy};
use algos::network::Kind;
use algos::ppo::{Config, Ppo};
use algos::returns::EndOfBatch;
use algos::reward_stats::Standardisation;
use algos::rollout::{End, Rollout};
use envs::mpe::{encode, Dense, Role};
use envs::World;
use process::Failure;
use proto::exit;
use proto::stream::stream;
use rand_chacha::ChaCha8Rng;

use crate::experiment::unknown;

/// Environment copies, each with one episode of an update call: more than a team's, so that the gradients of agents
/// that learn against each other have less noise.
const COPIES: usize = 32;
const LEARNING_RATE: f64 = 5e-4;
/// Lines of progress over a whole training.
const REPORTS: u64 = 20;

/// Train a frozen opponent
#[derive(Debug, Clone, clap::Args)]
pub struct TrainOpponent {
    /// prey (of Simple Tag) or adversary (of Simple Adversary)
    role: String,
    /// Write the weights into this new file
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Environment steps, all copies of the game together; whole rounds of 32 episodes are played
    #[arg(long, default_value_t = 4_000_000)]
    t_max: u64,
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Width of the hidden layers
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u16).range(1..=1024))]
    hidden: u16,
}

impl TrainOpponent {
    /// Checks that the file does not exist before it trains.
    pub fn run(&self) -> Result<(), Failure> {
        let names = Role::ALL.map(Role::name);
        let role = Role::ALL.into_iter().find(|role| role.name() == self.role);
        let role = role.ok_or_else(|| unknown(&self.role, "role", &names))?;
        if self.out.exists() {
            let out = self.out.display();
            return Err(Failure::new(exit::USAGE, format!("{out} already exists; name a new file")));
        }
        // Checked now and not after minutes.
        if !folder(&self.out).is_dir() {
            let folder = folder(&self.out).display();
            return Err(Failure::new(
                exit::IO,
                format!("there is no folder {folder} to write into; create it"),
            ));
        }
        let bytes = self.train(role, |line| eprintln!("{line}"));
        write_new(&self.out, &bytes)
            .map_err(|e| Failure::new(exit::IO, format!("cannot write {}: {e}", self.out.display())))?;
        println!("{}", self.out.display());
        Ok(())
    }

    /// Trains and returns the bytes of the file.
    fn train(&self, role: Role, mut report: impl FnMut(&str)) -> Vec<u8> {
        let mut arena = Arena::new(role, self.seed, usize::from(self.hidden));
        let per_round = COPIES as u64 * u64::from(role.arena().sizes().episode_limit);
        let rounds = self.t_max.div_ceil(per_round).max(1);
        let mut sums = vec![0.0; arena.seats.len()];
        let mut counted = 0;
        for round in 1..=rounds {
            arena.play();
            arena.learn();
            counted += 1;
            for (sum, seat) in sums.iter_mut().zip(&arena.seats) {
                *sum += seat.mean_return();
            }
            if round * REPORTS / rounds > (round - 1) * REPORTS / rounds {
                let means: Vec<String> =
                    sums.iter().map(|sum| format!("{:.1}", sum / f64::from(counted))).collect();
                report(&format!("{} steps: mean returns {}", round * per_round, means.join(", ")));
                sums.fill(0.0);
                counted = 0;
            }
        }
        self.encode(role, &arena.seats[role.agent()].learner, rounds * per_round)
    }

    fn encode(&self, role: Role, learner: &Ppo, steps: u64) -> Vec<u8> {
        let tensors = learner.tensors();
        let tensor = |layer: &str, part: &str| {
            let name = format!("actor.{layer}.{part}");
            tensors.iter().find(|tensor| tensor.0 == name).expect("a feed-forward actor has it").2
        };
        let layers = ["fc1", "fc2", "head"]
            .map(|layer| Dense { weight: tensor(layer, "weight"), bias: tensor(layer, "bias") });
        let Self { t_max, seed, hidden, .. } = self;
        let name = role.name();
        let command = format!("rondo train-opponent {name} --t-max {t_max} --seed {seed} --hidden {hidden}");
        let provenance = BTreeMap::from([
            ("role", name.to_owned()),
            ("task", format!("{}, every agent learning", role.arena_task())),
            ("actions", "0 nothing, 1 +x, 2 -x, 3 +y, 4 -y".to_owned()),
            ("command", command),
            ("seed", seed.to_string()),
            ("env_steps", steps.to_string()),
            ("rondo_version", env!("CARGO_PKG_VERSION").to_owned()),
            ("licence", "MIT OR Apache-2.0".to_owned()),
        ]);
        encode(layers, &provenance)
    }
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Writes the complete file or nothing, and never replaces another file.
fn write_new(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    // The mode of the user's other files; that of a temporary file would be more restrictive.
    let mode = Permissions::from_mode(0o666);
    let mut file = tempfile::Builder::new().permissions(mode).tempfile_in(folder(path))?;
    file.write_all(bytes)?;
    file.persist_noclobber(path)?;
    Ok(())
}

/// Copies of the whole game, and a learner for every agent.
struct Arena {
    worlds: Vec<Box<dyn World>>,
    seats: Vec<Seat>,
    /// Draws the starts of episodes.
    chance: ChaCha8Rng,
}

struct Seat {
    learner: Ppo,
    rollout: Rollout,
    /// Draws the actions.
    chance: ChaCha8Rng,
    obs_size: usize,
    n_actions: usize,
    /// Work space of a tick: observations and actions by row.
    obs: Vec<f32>,
    avail: Vec<u8>,
    actions: Vec<u16>,
}

impl Arena {
    fn new(role: Role, seed: u64, hidden: usize) -> Arena {
        let world = role.arena();
        let sizes = world.sizes();
        let seat =
            |agent: usize| Seat::new(agent, seed, sizes.obs_size[agent], sizes.n_actions[agent], hidden);
        Arena {
            seats: (0..sizes.agents).map(seat).collect(),
            chance: stream(seed, "arena", "starts", &[]),
            worlds: (0..COPIES).map(|_| world.copy()).collect(),
        }
    }

    /// Plays one episode in every copy; all of them end in the same step.
    fn play(&mut self) {
        for seat in &mut self.seats {
            seat.learner.begin_round(COPIES);
            seat.rollout.begin(COPIES);
        }
        for world in &mut self.worlds {
            world.reset(&mut self.chance);
        }
        let agents = self.seats.len();
        let (mut joint, mut rewards) = (vec![0; agents], vec![0.0; agents]);
        let mut end = End::Running;
        while end == End::Running {
            for (agent, seat) in self.seats.iter_mut().enumerate() {
                seat.look(agent, &self.worlds);
                seat.act();
            }
            for (copy, world) in self.worlds.iter_mut().enumerate() {
                for (action, seat) in joint.iter_mut().zip(&self.seats) {
                    *action = seat.actions[copy];
                }
                end = match world.step(&joint, &mut self.chance, &mut rewards) {
                    envs::End::Running => End::Running,
                    envs::End::Terminated => End::Terminated,
                    envs::End::TimeLimit => End::TimeLimit,
                };
                for (seat, &reward) in self.seats.iter_mut().zip(&rewards) {
                    seat.rollout.outcome(copy, reward as f32, end);
                }
            }
        }
        for (agent, seat) in self.seats.iter_mut().enumerate() {
            seat.look(agent, &self.worlds);
        }
    }

    /// One update call of every agent.
    fn learn(&mut self) {
        for seat in &mut self.seats {
            seat.learner.update(seat.rollout.episodes(), LEARNING_RATE);
        }
    }
}

impl Seat {
    fn new(agent: usize, seed: u64, obs_size: usize, n_actions: usize, hidden: usize) -> Seat {
        let config = Config {
            actor: Kind::Fc,
            hidden,
            // No team shares this loss.
            agents: 1,
            gamma: 0.99,
            epochs: 4,
            clip: 0.2,
            entropy_coef: 0.01,
            n_step: 10,
            target_update: 0.01,
            max_grad_norm: 10.0,
            end_of_batch: EndOfBatch::Correct,
            reward_standardisation: Standardisation::Running,
            hold_frozen_moments: false,
        };
        let owner = format!("arena-{agent}");
        let mut weights = stream(seed, &owner, "initial-weights", &[]);
        Seat {
            learner: Ppo::new(config, obs_size, n_actions, &mut weights),
            rollout: Rollout::default(),
            chance: stream(seed, &owner, "actions", &[]),
            obs_size,
            n_actions,
            obs: vec![0.0; COPIES * obs_size],
            avail: vec![0; COPIES * n_actions],
            actions: Vec::new(),
        }
    }

    /// Records what the agent sees in every copy.
    fn look(&mut self, agent: usize, worlds: &[Box<dyn World>]) {
        let rows = self.obs.chunks_exact_mut(self.obs_size).zip(self.avail.chunks_exact_mut(self.n_actions));
        for (copy, (world, (obs, avail))) in worlds.iter().zip(rows).enumerate() {
            world.observe(agent, obs);
            world.available(agent, avail);
            self.rollout.observe(copy, obs, avail);
        }
    }

    /// Chooses an action in every copy.
    fn act(&mut self) {
        let copies: [u16; COPIES] = std::array::from_fn(|copy| copy as u16);
        self.learner.act(
            &copies,
            &self.obs,
            &self.avail,
            Choice::Sample,
            &mut self.chance,
            &mut self.actions,
        );
        for (copy, &action) in self.actions.iter().enumerate() {
            self.rollout.act(copy, action);
        }
    }

    fn mean_return(&self) -> f64 {
        let returns = self.rollout.episodes().iter().map(|episode| episode.episode_return());
        returns.sum::<f64>() / COPIES as f64
    }
}

#[cfg(test)]
mod tests {
    use envs::mpe::FrozenNetwork;

    use super::*;

    fn command(role: &str, out: PathBuf, t_max: u64) -> TrainOpponent {
        TrainOpponent { role: role.to_owned(), out, t_max, seed: 3, hidden: 8 }
    }

    #[test]
    fn the_same_arguments_give_the_same_file_which_holds_a_network_of_the_role() {
        let folder = tempfile::tempdir().unwrap();
        for role in Role::ALL {
            let files = ["a", "b"].map(|name| folder.path().join(format!("{}-{name}", role.name())));
            for file in &files {
                command(role.name(), file.clone(), 1000).run().unwrap();
            }
            let [a, b] = files.map(|file| std::fs::read(file).unwrap());
            assert_eq!(a, b);
            FrozenNetwork::parse(&a, role.obs_size()).unwrap();
        }
    }

    #[test]
    fn a_file_that_is_there_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("mine");
        std::fs::write(&file, "mine").unwrap();
        let refusal = command("prey", file.clone(), u64::MAX).run().unwrap_err();
        assert_eq!(refusal.code, exit::USAGE);
        assert_eq!(std::fs::read(file).unwrap(), b"mine");
    }

    #[test]
    fn an_unknown_role_and_a_missing_folder_are_told_at_once() {
        let refusal = |role: &str, out: &str| command(role, out.into(), u64::MAX).run().unwrap_err();
        let unknown = refusal("pray", "x");
        assert_eq!(
            unknown.to_string(),
            "unknown role `pray`: expected prey, adversary; did you mean `prey`?"
        );
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("missing").join("prey.safetensors");
        assert_eq!(refusal("prey", out.to_str().unwrap()).code, exit::IO);
        assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none());
    }

    #[test]
    fn the_adversary_learns_to_stay_near_the_landmarks() {
        let mean = |rounds: u32| {
            let mut arena = Arena::new(Role::Adversary, 1, 32);
            let mut last = 0.0;
            for _ in 0..rounds {
                arena.play();
                arena.learn();
                last = arena.seats[0].mean_return();
            }
            last
        };
        // The return is minus the sum of 25 squared distances to the goal.
        let (before, after) = (mean(1), mean(60));
        assert!(after > 0.7 * before, "{before} before, {after} after 60 update calls");
    }
}
