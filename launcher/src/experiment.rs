//! From the command line to a complete configuration.

use std::path::{Path, PathBuf};

use envs::{Opponent, Task};
use process::Failure;
use proto::config::{AlgoName, Config, ConfigError, Period, Profile, Reward, Timescales};
use proto::exit;
use proto::presets::{self, Family};
use store::RunFolder;

/// The default task of `rondo train`: learned in half a minute.
pub const DEFAULT_TASK: &str = "lbf-5x5-2p-1f";

/// Environment steps without `--paper` or `--t-max`: half a minute on two cores.
const DEFAULT_BUDGET: u64 = 200_000;

/// Tests per run without `--test-interval`, besides the first.
const DEFAULT_TESTS: u64 = 20;

/// The options that make a configuration.
#[derive(Debug, Clone, clap::Args)]
pub struct Experiment {
    /// The task, for example lbf-8x8-2p-2f-coop; `rondo tasks` lists them
    #[arg(default_value = DEFAULT_TASK)]
    pub task: String,
    /// Algorithm: mtppo (multi-timescale), ippo (independent) or sppo (sequential), and the same three with
    /// Q-learning: mtql, iql, sql
    #[arg(long, default_value = "mtppo")]
    pub algo: String,
    /// Learning rate of the agent whose turn it is
    #[arg(long, value_name = "RATE", allow_negative_numbers = true)]
    pub lr_fast: Option<f64>,
    /// Learning rate of the other agents
    #[arg(long, value_name = "RATE", allow_negative_numbers = true)]
    pub lr_slow: Option<f64>,
    /// Update calls until the turn goes to the next agent, or `inf`
    #[arg(long, value_name = "S")]
    pub switch_period: Option<String>,
    /// Environment steps to train for
    #[arg(long, value_name = "N")]
    pub t_max: Option<u64>,
    /// Random seed
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Environment copies: episodes per update call of PPO; with Q-learning, episodes played side by side, with an
    /// update call for each
    #[arg(long, value_name = "B")]
    pub envs: Option<u32>,
    /// Version of the world's rules; `rondo tasks TASK` lists them
    #[arg(long, value_name = "VERSION")]
    pub rules: Option<String>,
    /// The opponent, in tasks that have one: builtin, random, still, or a file of weights
    #[arg(long, value_name = "WHO")]
    pub opponent: Option<String>,
    /// A battle on a map of your own, in place of TASK: a file as described in docs/spec/smaclite.md
    #[arg(long, value_name = "FILE")]
    pub map: Option<PathBuf>,
    /// Reward that agents learn from: sum or mean of the team's rewards, or individual
    #[arg(long, value_name = "REWARD", default_value = "sum")]
    pub reward: String,
    /// Pad observations and actions to the largest of the team (`--pad=false` overrides `--paper`)
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true", require_equals = true)]
    pub pad: Option<bool>,
    /// Environment steps between tests
    #[arg(long, value_name = "N")]
    pub test_interval: Option<u64>,
    /// Episodes per test
    #[arg(long, value_name = "N")]
    pub test_episodes: Option<u32>,
    /// The paper's budget, test points, rule version and padding for this task, and the profile epymarl
    #[arg(long)]
    pub paper: bool,
    /// Variant of the algorithms: rondo (the default), epymarl (the reference's rule at the end of a batch) or
    /// benchmark2021 (also the reward statistics of 2021)
    #[arg(long, value_name = "PROFILE")]
    pub profile: Option<String>,
    /// Set any key of the configuration, for example `algo.hidden=64`, `q.batch=64` or `schedule.levels=[0,1,1]`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
}

impl Experiment {
    /// The options of `rondo train TASK --algo ALGO`.
    pub fn of(task: &str, algo: &str) -> Self {
        Self {
            task: task.to_owned(),
            algo: algo.to_owned(),
            lr_fast: None,
            lr_slow: None,
            switch_period: None,
            t_max: None,
            seed: 1,
            envs: None,
            rules: None,
            opponent: None,
            map: None,
            reward: Reward::Sum.as_str().to_owned(),
            pad: None,
            test_interval: None,
            test_episodes: None,
            paper: false,
            profile: None,
            settings: vec![],
        }
    }

    /// The validated configuration of a run with this name.
    ///
    /// # Errors
    /// All mistakes, in one message.
    pub fn configure(&self, run: &str) -> Result<Config, Failure> {
        let usage = |error: &dyn std::fmt::Display| Failure::new(exit::CONFIG, error);
        let mut task = match &self.map {
            None => envs::task(&self.task).map_err(|e| usage(&e))?,
            Some(file) => self.task_of_map(file)?,
        };
        let paper_rules = self.paper.then_some(task.family().paper_rules);
        if let Some(rules) = self.rules.as_deref().or(paper_rules) {
            task = task.with_rules(rules).map_err(|e| usage(&e))?;
        }
        let opponent = self.opponent()?;
        if opponent.policy != Opponent::Builtin {
            task = task.with_opponent(&opponent.policy).map_err(|e| usage(&e))?;
        }
        let family = Family::named(task.family().name);
        let name = named::<AlgoName>(&self.algo, "algorithm", &AlgoName::ALL.map(AlgoName::as_str))?;
        let profile = match &self.profile {
            Some(profile) => named::<Profile>(profile, "profile", &Profile::ALL.map(Profile::as_str))?,
            None if self.paper => Profile::Epymarl,
            None => Profile::Rondo,
        };
        if self.settings.iter().any(|setting| setting.starts_with("algo.profile=")) {
            let text = "`--set algo.profile`: a profile is a name for values of other keys; choose it with `--profile`";
            return Err(Failure::new(exit::CONFIG, text));
        }
        let agents = task.sizes().agents as u32;
        let mut config = presets::config(run, task.name(), agents, name, family);
        config.seed = self.seed;
        presets::apply_profile(&mut config, profile, family);
        config.world.map = task.map().map(str::to_owned);
        config.world.opponent = opponent.name;
        config.world.reward = named::<Reward>(&self.reward, "reward", &Reward::ALL.map(Reward::as_str))?;
        config.world.pad = self.pad.unwrap_or(self.paper);
        self.choose_rates(&mut config, name);
        if let Some(period) = &self.switch_period {
            config.schedule.switch_period = period.parse::<Period>().map_err(|e| usage(&e))?;
        }
        // What follows from other keys follows from what `--set` makes of them, and is overridden itself at the end.
        let set = |config: &Config| overridden(config.clone(), &self.settings);
        let published = config.t_max;
        config.t_max = self.t_max.unwrap_or(if self.paper { published } else { DEFAULT_BUDGET });
        config.t_max = set(&config)?.t_max;
        if !self.paper || self.t_max.is_some() || config.t_max != published {
            config.test.interval = (config.t_max / DEFAULT_TESTS).max(1);
        }
        config.test.interval = self.test_interval.unwrap_or(config.test.interval);
        config.test.episodes = self.test_episodes.unwrap_or(config.test.episodes);
        config.log.interval = (set(&config)?.test.interval / 5).max(1);
        config.world.copies = self.envs.unwrap_or(config.world.copies);
        let chosen = set(&config)?;
        chosen.validate()?;
        let task = self.world_of(&chosen)?;
        config.bus.low_latency = env_server::fits_low_latency(&chosen, &task);
        let config = set(&config)?;
        env_server::check_transport(&config, &task)?;
        Ok(config)
    }

    /// The battle on the map in a file. TASK is the default then, or the same task.
    fn task_of_map(&self, file: &Path) -> Result<Task, Failure> {
        let task = read_map(file)?;
        let is_family = self.task.eq_ignore_ascii_case(task.family().name);
        if self.task == DEFAULT_TASK || is_family || self.task.eq_ignore_ascii_case(task.name()) {
            return Ok(task);
        }
        let text = format!(
            "`--map {}` is the task `{}`, and the command line has the task `{}`: give one of them",
            file.display(),
            task.name(),
            self.task
        );
        Err(Failure::new(exit::CONFIG, text))
    }

    /// The world of a complete configuration. Weights of an opponent are not in a run folder yet, and have been read.
    fn world_of(&self, config: &Config) -> Result<Task, Failure> {
        let mut config = config.clone();
        match config.world.opponent.as_str() {
            "builtin" | "random" | "still" => {}
            file if file == self.opponent()?.name => config.world.opponent = "builtin".to_owned(),
            other => {
                let text = format!(
                    "`world.opponent` is `{other}`: expected builtin, random or still; `--opponent FILE` takes weights"
                );
                return Err(Failure::new(exit::CONFIG, text));
            }
        }
        env_server::task(&config, Path::new(""))
    }

    /// The opponent and its name in the configuration: a file is named by its digest.
    fn opponent(&self) -> Result<Chosen, Failure> {
        let name = self.opponent.as_deref().unwrap_or("builtin");
        let policy = match name {
            "builtin" => Opponent::Builtin,
            "random" => Opponent::Random,
            "still" => Opponent::Still,
            file => {
                let bytes = std::fs::read(file).map_err(|error| {
                    let text = format!(
                        "`--opponent {file}`: expected builtin, random, still or a file of weights, which cannot be \
                         read: {error}"
                    );
                    Failure::new(exit::IO, text)
                })?;
                let name = store::digest_of(&bytes);
                return Ok(Chosen { policy: Opponent::Weights(bytes.into()), name });
            }
        };
        Ok(Chosen { policy, name: name.to_owned() })
    }

    /// Copies the opponent's weights, if they come from a file, into the new run folder.
    ///
    /// # Errors
    /// If the opponent's weights cannot be read or written.
    pub fn furnish(&self, folder: &RunFolder) -> Result<(), Failure> {
        if let Opponent::Weights(bytes) = self.opponent()?.policy {
            folder.keep(env_server::OPPONENT_FILE, &bytes)?;
        }
        Ok(())
    }

    fn choose_rates(&self, config: &mut Config, name: AlgoName) {
        let rates = &mut config.schedule.rates;
        match (name.timescales(), self.lr_fast, self.lr_slow) {
            // One rate for all: either option sets it.
            (Timescales::One, Some(lr), None) | (Timescales::One, None, Some(lr)) => rates.fill(lr),
            (_, fast, slow) => {
                rates[0] = fast.unwrap_or(rates[0]);
                if let (Some(slow), Some(rate)) = (slow, rates.get_mut(1)) {
                    *rate = slow;
                }
            }
        }
    }
}

/// The task of a map's file.
///
/// # Errors
/// If the file cannot be read, or holds no map that can be played: with the line.
pub fn read_map(file: &Path) -> Result<Task, Failure> {
    let text = std::fs::read_to_string(file).map_err(|error| {
        Failure::new(exit::IO, format!("`--map {}`: cannot read the file: {error}", file.display()))
    })?;
    envs::task_of_map(&text)
        .map_err(|error| Failure::new(exit::CONFIG, format!("`--map {}`: {error}", file.display())))
}

/// An opponent from the command line.
struct Chosen {
    policy: Opponent,
    name: String,
}

/// A choice by name, with the nearest known one in the error.
fn named<T: std::str::FromStr>(text: &str, what: &str, known: &[&str]) -> Result<T, Failure> {
    text.parse().map_err(|_| unknown(text, what, known))
}

/// Error for an unknown name: the known ones and the nearest.
pub fn unknown(text: &str, what: &str, known: &[&str]) -> Failure {
    let nearest = proto::suggest::nearest(text, known.iter().copied());
    let hint = nearest.map_or(String::new(), |name| format!("; did you mean `{name}`?"));
    Failure::new(exit::CONFIG, format!("unknown {what} `{text}`: expected {}{hint}", known.join(", ")))
}

/// Applies `KEY=VALUE` settings; the value is TOML, or a bare word.
pub fn overridden(config: Config, settings: &[String]) -> Result<Config, Failure> {
    if settings.is_empty() {
        return Ok(config);
    }
    let bug = |error: &dyn std::fmt::Display| Failure::new(exit::BUG, error);
    let mut table: toml::Table = config.to_toml().parse().map_err(|e| bug(&e))?;
    for setting in settings {
        let bad = |why: &str| {
            let text = format!("`--set {setting}`: {why}; write KEY=VALUE, for example algo.hidden=64");
            Failure::new(exit::USAGE, text)
        };
        let (key, value) = setting.split_once('=').ok_or_else(|| bad("there is no `=`"))?;
        let value = format!("x = {value}").parse::<toml::Table>().ok().and_then(|mut t| t.remove("x"));
        let value = value.unwrap_or_else(|| toml::Value::String(setting[key.len() + 1..].to_owned()));
        // Otherwise a new section with only this key would be made, and its other keys would be missing.
        for (section, other) in [("ppo", "q"), ("q", "ppo")] {
            if key.starts_with(&format!("{section}.")) && !table.contains_key(section) {
                let text = format!(
                    "`--set {setting}`: `{section}` has no meaning for `{}`, whose own keys are in `{other}`",
                    config.algo.name
                );
                return Err(Failure::new(exit::CONFIG, text));
            }
        }
        let mut place = &mut table;
        let mut parts: Vec<&str> = key.split('.').collect();
        let last = parts.pop().filter(|last| !last.is_empty()).ok_or_else(|| bad("the key is empty"))?;
        for part in parts {
            let entry = place.entry(part).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            place = entry.as_table_mut().ok_or_else(|| bad(&format!("`{part}` holds no keys")))?;
        }
        place.insert(last.to_owned(), value);
    }
    Config::from_toml(&table.to_string()).map_err(|error| match error {
        // The user has not seen this file, so line numbers do not help.
        ConfigError::UnknownKeys(keys) => {
            let keys = keys.iter().map(|key| key.split_once(": ").map_or(key.as_str(), |(_, what)| what));
            Failure::new(exit::CONFIG, format!("`--set`: {}", keys.collect::<Vec<_>>().join("; ")))
        }
        other => other.into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(algo: &str, settings: &[&str]) -> Result<Config, Failure> {
        let settings = settings.iter().map(|setting| (*setting).to_owned()).collect();
        Experiment { settings, ..Experiment::of("lbf-5x5-2p-1f", algo) }.configure("run")
    }

    /// Another value for every key, except those in [`REFUSED`]. A new key belongs into one of the two lists.
    const CHOSEN: &[&str] = &[
        "run=other",
        "seed=9",
        "t_max=1000",
        "world.task=\"lbf-6x6-2p-1f\"",
        "world.copies=3",
        "world.pad=true",
        "world.reward=mean",
        "algo.network=fc",
        "algo.hidden=7",
        "algo.gamma=0.5",
        "algo.target_update=0.25",
        "algo.max_grad_norm=3.5",
        "algo.reward_standardisation=batch",
        "algo.frozen_moments=hold",
        "algo.agent_id_input=true",
        "algo.last_action_input=true",
        "ppo.epochs=2",
        "ppo.clip=0.3",
        "ppo.entropy_coef=0.5",
        "ppo.n_step=2",
        "ppo.end_of_batch=epymarl",
        "ppo.policy_test=greedy",
        "q.buffer=77",
        "q.batch=16",
        "q.draws=independent",
        "q.double=false",
        "q.epsilon_start=0.75",
        "q.epsilon_finish=0.25",
        "q.epsilon_anneal=60",
        "q.test_epsilon=0.125",
        "q.time_limit_is_terminal=false",
        "schedule.rates=[0.25, 0.125]",
        "schedule.levels=[1, 0]",
        "schedule.switch_period=8",
        "schedule.switch_unit=gradient_step",
        "test.interval=77",
        "test.episodes=7",
        "save.interval=7",
        "log.interval=7",
        "bus.low_latency=false",
    ];

    /// What decides other keys, has an option of its own, or cannot work.
    const REFUSED: &[&str] = &[
        "world.agents=3",
        "world.opponent=else",
        "algo.name=ippo",
        "algo.profile=epymarl",
        "algo.clip_scope=joint",
    ];

    /// Keys that follow from a key unless they are chosen too.
    fn follows(key: &str) -> &'static [&'static str] {
        match key {
            "t_max" => &["test.interval", "log.interval"],
            "test.interval" => &["log.interval"],
            _ => &[],
        }
    }

    fn keys(prefix: &str, table: &toml::Table, found: &mut Vec<String>) {
        for (key, value) in table {
            match value {
                toml::Value::Table(inner) => keys(&format!("{prefix}{key}."), inner, found),
                _ => found.push(format!("{prefix}{key}")),
            }
        }
    }

    #[test]
    fn what_is_set_stays_set_and_nothing_else_changes_but_what_follows_from_it() {
        let mut seen = Vec::new();
        for algo in ["mtppo", "mtql"] {
            let default = with(algo, &[]).unwrap();
            let mut there = Vec::new();
            keys("", &default.to_toml().parse().unwrap(), &mut there);
            for key in there {
                let is_of_key = |setting: &&&str| setting.split('=').next() == Some(&key);
                if let Some(setting) = REFUSED.iter().find(is_of_key) {
                    let refusal = with(algo, &[setting]).expect_err(setting);
                    assert_eq!(refusal.code, exit::CONFIG, "{refusal}");
                } else {
                    let setting =
                        CHOSEN.iter().find(is_of_key).unwrap_or_else(|| panic!("`{key}` is not tried"));
                    let chosen = with(algo, &[setting]).unwrap_or_else(|error| panic!("{setting}: {error}"));
                    let changed: Vec<String> =
                        chosen.differences(&default).into_iter().map(|difference| difference.key).collect();
                    assert!(changed.contains(&key), "`--set {setting}` changes nothing");
                    let follow =
                        |changed: &String| *changed == key || follows(&key).contains(&changed.as_str());
                    assert!(changed.iter().all(follow), "`--set {setting}` changes {changed:?}");
                }
                seen.push(key);
            }
        }
        let tried = CHOSEN.iter().chain(REFUSED).map(|setting| setting.split('=').next().unwrap());
        for key in tried {
            assert!(seen.iter().any(|seen| seen == key), "there is no key `{key}`");
        }
    }

    #[test]
    fn what_follows_from_a_key_follows_from_what_is_set() {
        let config = with("ippo", &["t_max=1000"]).unwrap();
        assert_eq!((config.test.interval, config.log.interval), (50, 10));
        let config = with("ippo", &["t_max=1000", "test.interval=500", "log.interval=3"]).unwrap();
        assert_eq!((config.test.interval, config.log.interval), (500, 3));
        // A section at once is as good as a key.
        assert!(!with("ippo", &["bus={low_latency=false}"]).unwrap().bus.low_latency);
    }

    #[test]
    fn messages_that_do_not_fit_the_low_latency_transport_decide_it_or_refuse_it() {
        assert!(!with("ippo", &["world.copies=1000"]).unwrap().bus.low_latency);
        let refusal = with("ippo", &["world.copies=1000", "bus.low_latency=true"]).unwrap_err();
        assert_eq!(refusal.code, exit::CONFIG);
        assert_eq!(
            refusal.message,
            "`bus.low_latency` is true, but that transport carries 32768 bytes a message and an observation of this \
             run has up to 49040 (`world.copies` is 1000, `test.episodes` 100)\nhint: `bus.low_latency` = false"
        );
    }

    #[test]
    fn a_world_that_is_set_has_the_agents_that_it_has() {
        let refusal = with("ippo", &["world.task=lbf-8x8-3p-2f"]).unwrap_err();
        assert_eq!(refusal.code, exit::CONFIG);
        assert_eq!(refusal.message, "`world.agents` is 2, but lbf-8x8-3p-2f has 3");
        let larger = with("ippo", &["world.task=lbf-8x8-2p-30f", "world.copies=300"]);
        assert!(!larger.unwrap().bus.low_latency, "the messages are those of the world that is played");
    }
}
