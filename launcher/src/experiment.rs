//! From the words on the command line to a complete configuration.

use std::path::{Path, PathBuf};

use envs::{Opponent, Task};
use process::Failure;
use proto::config::{AlgoName, Config, ConfigError, Period, Profile, Reward, Timescales};
use proto::presets::{self, Family};
use proto::{exit, Observe};
use store::RunFolder;

/// The task that `rondo train` takes when it is given none: small enough to watch it being learned.
pub const DEFAULT_TASK: &str = "lbf-5x5-2p-1f";

/// Environment steps without `--paper` or `--t-max`: half a minute on two cores.
const DEFAULT_BUDGET: u64 = 200_000;

/// Tests per run without `--test-interval`, besides the first.
const DEFAULT_TESTS: u64 = 20;

/// What to learn, how and for how long.
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
    /// All chance in a run follows from it
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Environment copies: episodes per update call of PPO; with Q-learning, episodes played side by side, with an
    /// update call for each
    #[arg(long, value_name = "B")]
    pub envs: Option<u32>,
    /// Version of the world's rules; `rondo tasks TASK` lists them
    #[arg(long, value_name = "VERSION")]
    pub rules: Option<String>,
    /// Who plays what the team does not control: builtin, random, still, or a file of weights
    #[arg(long, value_name = "WHO")]
    pub opponent: Option<String>,
    /// A battle on a map of your own, in place of TASK: a file as described in docs/spec/smaclite.md
    #[arg(long, value_name = "FILE")]
    pub map: Option<PathBuf>,
    /// What agents learn from: sum or mean of the team's rewards, or individual
    #[arg(long, value_name = "REWARD", default_value = "sum")]
    pub reward: String,
    /// Pad observations and actions to the largest of the team (`--pad=false` takes it back from `--paper`)
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
    /// What `rondo train TASK --algo ALGO` means.
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
    /// All that is wrong, in one message.
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
        if !self.paper {
            config.t_max = DEFAULT_BUDGET;
        }
        config.t_max = self.t_max.unwrap_or(config.t_max);
        if !self.paper || self.t_max.is_some() {
            config.test.interval = (config.t_max / DEFAULT_TESTS).max(1);
        }
        config.test.interval = self.test_interval.unwrap_or(config.test.interval);
        config.test.episodes = self.test_episodes.unwrap_or(config.test.episodes);
        config.log.interval = (config.test.interval / 5).max(1);
        config.world.copies = self.envs.unwrap_or(config.world.copies);
        let config = overridden(config, &self.settings)?;
        let task = if config.world.pad { task.padded() } else { task };
        let config = with_transport(config, task);
        config.validate()?;
        Ok(config)
    }

    /// The battle on the map in a file. TASK is the default then, or says the same.
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

    /// The opponent and what the configuration calls it: a file is named by its digest.
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

    /// Puts what a run needs beside its configuration into its new folder.
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
            // One rate for all: either option says it.
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

/// Somebody wrote a name that stands for nothing: which ones there are, and the nearest of them.
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
        // Else a whole section would be made of this one key, and its others would be missing.
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
        // Nobody has seen that file, so its line numbers help nobody.
        ConfigError::UnknownKeys(keys) => {
            let keys = keys.iter().map(|key| key.split_once(": ").map_or(key.as_str(), |(_, what)| what));
            Failure::new(exit::CONFIG, format!("`--set`: {}", keys.collect::<Vec<_>>().join("; ")))
        }
        other => other.into(),
    })
}

/// Chooses the faster transport where the largest message fits it.
fn with_transport(mut config: Config, task: Task) -> Config {
    let rows = config.world.copies.max(config.test.episodes) as usize;
    let sizes = task.sizes();
    let largest =
        (0..sizes.agents).map(|i| Observe::encoded_len(rows, sizes.obs_size[i], sizes.n_actions[i])).max();
    config.bus.low_latency = largest.is_some_and(|bytes| bytes <= bus::LOW_LATENCY_MAX_BYTES);
    config
}
