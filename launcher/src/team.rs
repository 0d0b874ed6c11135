//! A trained team from a run's checkpoints, for `eval` and `render`. It plays without learning.

use std::path::Path;

use agent::Learner;
use algos::learner::Choice;
use env_server::Copies;
use process::Failure;
use proto::config::Config;
use proto::stream::stream;
use proto::{exit, Mode, Observe};
use store::{Checkpoints, RunFolder};

use crate::state;

/// All agents of a run at their latest common checkpoint, and its world.
pub struct Team {
    pub config: Config,
    /// Training rounds that the agents had completed.
    pub round: u64,
    pub task: envs::Task,
    learners: Vec<Learner>,
}

impl Team {
    /// Reads the agents' checkpoints; changes nothing.
    ///
    /// # Errors
    /// If the folder is not a run, or there is no round of which all agents have a checkpoint here. The error names
    /// each agent's rounds.
    pub fn open(run: &Path) -> Result<Self, Failure> {
        let folder = RunFolder::open(run)?;
        let config = Config::from_toml(folder.config_toml()).map_err(|error| {
            let text = format!("{}/config.toml: {error}", folder.path().display());
            Failure::new(exit::CONFIG, text)
        })?;
        config.validate()?;
        state::check_unchanged(&folder, &config)?;
        let task = env_server::task(&config, folder.path())?;
        let names: Vec<String> = (0..config.world.agents).map(|id| format!("agent-{id}")).collect();
        let here = folder.roles()?;
        let (there, missing): (Vec<_>, Vec<_>) = names.iter().partition(|name| here.contains(name));
        let checkpoints: Vec<_> =
            there.iter().map(|name| Ok(folder.role(name)?.checkpoints())).collect::<Result<_, Failure>>()?;
        let held = checkpoints.iter().map(Checkpoints::rounds).collect::<Result<Vec<_>, _>>()?;
        let common = |round: &&u64| held.iter().all(|rounds| rounds.contains(round));
        let round = held.first().and_then(|first| first.iter().rev().find(common)).copied();
        let round = round.filter(|_| missing.is_empty()).ok_or_else(|| {
            let who_holds_what = names.iter().map(|name| {
                match there.iter().position(|other| *other == name).map(|at| &held[at]) {
                    None => format!("{name} has no folder here"),
                    Some(rounds) if rounds.is_empty() => format!("{name} has no complete checkpoint"),
                    Some(rounds) => format!("{name} has {}", listed(rounds)),
                }
            });
            let who_holds_what: Vec<String> = who_holds_what.collect();
            let hint = if held.iter().all(Vec::is_empty) {
                "`rondo resume` it until its first checkpoint, or copy here what its agents have saved on other hosts"
            } else {
                "copy the folders of these agents, with all their checkpoints, from the hosts on which they ran"
            };
            let text = format!(
                "the agents of {} have no checkpoint of the same round: {}\nhint: {hint}",
                folder.path().display(),
                who_holds_what.join(", "),
            );
            Failure::new(exit::CONFIG, text)
        })?;
        let mut learners = Vec::new();
        for (id, checkpoints) in checkpoints.iter().enumerate() {
            let sizes = task.sizes();
            let mut learner = Learner::new(&config, id as u32, (sizes.obs_size[id], sizes.n_actions[id]));
            learner.restore(&checkpoints.load(round)?)?;
            learners.push(learner);
        }
        Ok(Self { config, round, task, learners })
    }

    /// Sets how PPO chooses actions.
    pub fn choose(&mut self, choice: Choice) {
        self.learners.iter_mut().for_each(|learner| learner.choose_in_tests(choice));
    }

    /// Plays one episode in each of `copies` environment copies, with random streams from `seed`. `watch` gets the
    /// start and the state after every step, with the joint action (`actions[agent][row]`, by running copy).
    ///
    /// # Errors
    /// The error of `watch`.
    pub fn play(
        &mut self,
        copies: u32,
        seed: u64,
        mut watch: impl FnMut(&Copies, &[Vec<u16>]) -> Result<(), Failure>,
    ) -> Result<Copies, Failure> {
        let mut worlds = Copies::of(&self.task, copies, self.config.world.reward);
        worlds.reset(seed, EPISODES, 0);
        let mut chance: Vec<_> = (0..self.learners.len())
            .map(|id| stream(seed, &agent::owner(id as u32), "evaluation-actions", &[]))
            .collect();
        let mut observe = Observe { mode: Mode::Test, ..Observe::default() };
        let mut actions = vec![Vec::new(); self.learners.len()];
        watch(&worlds, &actions)?;
        for learner in &mut self.learners {
            learner.begin_round(copies as usize, false);
        }
        while worlds.running() > 0 {
            for (id, learner) in self.learners.iter_mut().enumerate() {
                worlds.show(id, &mut observe);
                learner.tick(&observe, false, &mut chance[id]).clone_into(&mut actions[id]);
            }
            worlds.step(&actions);
            observe.tick += 1;
            watch(&worlds, &actions)?;
        }
        Ok(worlds)
    }
}

fn listed(rounds: &[u64]) -> String {
    rounds.iter().map(u64::to_string).collect::<Vec<_>>().join(" and ")
}

/// Purpose of the random stream, different from those of training and tests.
const EPISODES: &str = "evaluation-episode";
