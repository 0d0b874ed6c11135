//! The experiment's configuration: everything that decides its result, in one value.
//!
//! Every process of a run holds the same [`Config`] and compares [`Config::digest`] when it joins. Where a process
//! listens and where it writes is not part of it. Every key is always present in the file; defaults come from
//! [`crate::presets`]. Unknown keys are errors, because a misspelt key that is silently ignored is a known way to
//! publish wrong results (algorithms §11).

mod difference;
pub mod limits;
mod parse;
mod period;
mod validate;

pub use difference::{Difference, MAY_CHANGE};
pub use parse::ConfigError;
pub use period::{Period, PeriodError};

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// One experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Name of the run: part of every key on the bus and the name of its folder.
    pub run: String,
    /// The random seed: every random stream is derived from it ([`crate::stream`]).
    pub seed: u64,
    /// Environment steps to learn from, summed over copies; the round that reaches it is the last (algorithms §8.1).
    pub t_max: u64,
    pub world: World,
    pub algo: Algo,
    /// Present when `algo.name` is one of the policy-gradient family, and only then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ppo: Option<Ppo>,
    /// Present when `algo.name` is one of the Q-learning family, and only then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q: Option<QLearning>,
    pub schedule: Schedule,
    pub test: Test,
    pub save: Save,
    pub log: Log,
    pub bus: BusOptions,
}

/// The task and its settings.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct World {
    /// Canonical name of the task, the version of its rules included; opaque here.
    pub task: String,
    /// The text of the map's file, where the task is a battle on a map of the user's own; opaque here. So every role
    /// has it, and a run that goes on does so on the same map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
    /// Agents in the team.
    pub agents: u32,
    /// Environment copies. Each plays one episode of a round (algorithms §2.3): with PPO these are the episodes of a
    /// batch, with Q-learning the new episodes of a round.
    pub copies: u32,
    /// Who plays what the team does not control: `builtin`, `random`, `still`, or the BLAKE3 digest of a file of
    /// weights in hexadecimal; opaque here.
    pub opponent: String,
    /// Observations and action sets are padded to the largest of the team, as in the reference (algorithms §2.4).
    pub pad: bool,
    /// The reward that each agent learns from (algorithms §2.5).
    pub reward: Reward,
}

/// The reward that each agent learns from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reward {
    /// The sum over the team: all agents learn from the same number.
    Sum,
    /// The mean over the team.
    Mean,
    /// Its own, as the world defines it.
    Individual,
}

impl Reward {
    pub const ALL: [Self; 3] = [Self::Sum, Self::Mean, Self::Individual];

    /// As in the configuration file.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Sum => "sum",
            Self::Mean => "mean",
            Self::Individual => "individual",
        }
    }
}

impl FromStr for Reward {
    type Err = UnknownChoice;

    fn from_str(text: &str) -> Result<Self, UnknownChoice> {
        choose(text, "reward", Self::ALL, Self::as_str)
    }
}

/// Settings that all algorithms have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Algo {
    pub name: AlgoName,
    /// The published variant that the other keys started from. It has no effect by itself (algorithms §11).
    pub profile: Profile,
    /// The network of the policy or of the Q values; PPO's critic is always fully connected (algorithms §1.2).
    pub network: Network,
    /// Width of the hidden layers of all networks.
    pub hidden: u32,
    /// Discount factor.
    pub gamma: f64,
    /// Above 1: update calls between hard copies of the target network. Up to 1: Polyak's τ (algorithms §4.4).
    pub target_update: f64,
    /// Longer gradients are scaled down to this norm, for each network of an agent by itself.
    pub max_grad_norm: f64,
    pub clip_scope: ClipScope,
    pub reward_standardisation: RewardStandardisation,
    pub frozen_moments: FrozenMoments,
    /// Appends a one-hot agent index to the input of the policy or Q network (algorithms §1.4).
    pub agent_id_input: bool,
    /// Appends a one-hot of the agent's own last action to that input, before the index (algorithms §1.4).
    pub last_action_input: bool,
}

/// Independent PPO (algorithms §4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ppo {
    /// Passes over the batch in one update call.
    pub epochs: u32,
    /// PPO's clip ε.
    pub clip: f64,
    pub entropy_coef: f64,
    /// Rewards in an n-step return before it bootstraps, `N` (algorithms §4.3).
    pub n_step: u32,
    pub end_of_batch: EndOfBatch,
    pub policy_test: PolicyTest,
}

/// Independent Q-learning (algorithms §5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QLearning {
    /// Episodes that each agent stores.
    pub buffer: u32,
    /// Episodes drawn for an update call. There is no update call before this many are stored.
    pub batch: u32,
    /// Whether all agents draw the same episodes (algorithms §5.1). Files from before this key lack it; then each agent
    /// drew its own.
    #[serde(default = "Draws::of_old_runs")]
    pub draws: Draws,
    /// Double Q-learning: the online network chooses the action whose target value counts (algorithms §5.2).
    pub double: bool,
    /// Probability of a random action at the beginning.
    pub epsilon_start: f64,
    /// The same after `epsilon_anneal` environment steps; linear in between.
    pub epsilon_finish: f64,
    pub epsilon_anneal: u64,
    /// Probability of a random action in tests.
    pub test_epsilon: f64,
    /// The step limit counts as a termination: no bootstrap after it (algorithms §3.4).
    pub time_limit_is_terminal: bool,
}

/// Which episodes the agents of a team draw for the same update call (algorithms §5.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Draws {
    /// The same for all, as in the reference. They follow from the seed; no message carries them.
    Joint,
    /// Each agent draws its own.
    Independent,
}

impl Draws {
    fn of_old_runs() -> Self {
        Self::Independent
    }
}

/// How a policy chooses actions in tests (algorithms §8.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PolicyTest {
    /// It samples, as in training.
    Sample,
    /// It takes the most probable action.
    Greedy,
}

/// The published algorithms: two kinds of learner, and three ways to choose their rates (algorithms §6.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlgoName {
    /// Independent PPO: one rate for all agents.
    Ippo,
    /// Multi-timescale PPO: one rate for each level.
    Mtppo,
    /// Sequential PPO: every rate but the first is zero.
    Sppo,
    /// Independent Q-learning.
    Iql,
    /// Multi-timescale Q-learning.
    Mtql,
    /// Sequential Q-learning.
    Sql,
}

/// What kind of learner an algorithm is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Learner {
    /// On-policy: each batch of episodes is used in one update call.
    Ppo,
    /// Off-policy: episodes are stored and drawn again.
    Q,
}

/// How an algorithm's rates relate to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Timescales {
    /// All rates are equal.
    One,
    /// Any rates.
    Many,
    /// One agent learns at a time: all rates but the first are zero.
    OneAtATime,
}

impl AlgoName {
    pub const ALL: [Self; 6] = [Self::Ippo, Self::Mtppo, Self::Sppo, Self::Iql, Self::Mtql, Self::Sql];

    /// As in the configuration file.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ippo => "ippo",
            Self::Mtppo => "mtppo",
            Self::Sppo => "sppo",
            Self::Iql => "iql",
            Self::Mtql => "mtql",
            Self::Sql => "sql",
        }
    }

    pub fn learner(self) -> Learner {
        match self {
            Self::Ippo | Self::Mtppo | Self::Sppo => Learner::Ppo,
            Self::Iql | Self::Mtql | Self::Sql => Learner::Q,
        }
    }

    pub fn timescales(self) -> Timescales {
        match self {
            Self::Ippo | Self::Iql => Timescales::One,
            Self::Mtppo | Self::Mtql => Timescales::Many,
            Self::Sppo | Self::Sql => Timescales::OneAtATime,
        }
    }
}

impl fmt::Display for AlgoName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for AlgoName {
    type Err = UnknownChoice;

    fn from_str(text: &str) -> Result<Self, UnknownChoice> {
        choose(text, "algorithm", Self::ALL, Self::as_str)
    }
}

/// Variants of the same algorithm: Rondo's and two published ones (algorithms §11).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// The default: as EPyMARL, but without a bootstrap after a terminated episode.
    Rondo,
    /// The reference: EPyMARL as it is today.
    Epymarl,
    /// The 2021 benchmark's rules for rewards and for the end of a batch.
    Benchmark2021,
}

impl Profile {
    pub const ALL: [Self; 3] = [Self::Rondo, Self::Epymarl, Self::Benchmark2021];

    /// As in the configuration file.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Rondo => "rondo",
            Self::Epymarl => "epymarl",
            Self::Benchmark2021 => "benchmark2021",
        }
    }
}

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for Profile {
    type Err = UnknownChoice;

    fn from_str(text: &str) -> Result<Self, UnknownChoice> {
        choose(text, "profile", Self::ALL, Self::as_str)
    }
}

/// An unknown name on the command line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown {what} `{found}`: expected {expected}")]
pub struct UnknownChoice {
    what: &'static str,
    found: String,
    expected: String,
}

fn choose<T: Copy, const N: usize>(
    text: &str,
    what: &'static str,
    all: [T; N],
    name: fn(T) -> &'static str,
) -> Result<T, UnknownChoice> {
    all.into_iter().find(|&choice| name(choice) == text).ok_or_else(|| UnknownChoice {
        what,
        found: text.to_owned(),
        expected: all.map(|choice| format!("`{}`", name(choice))).join(" or "),
    })
}

/// The network of a policy, or the Q network (algorithms §1.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Network {
    /// Two fully connected hidden layers.
    Fc,
    /// A fully connected layer, then a gated recurrent unit.
    Gru,
}

/// Whose gradients are clipped to one norm (algorithms §6.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClipScope {
    PerAgent,
    /// The team's. Rejected by [`Config::validate`]: agents in separate processes do not share gradients.
    Joint,
}

/// What an n-step return adds where a batch or an episode ends (algorithms §4.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndOfBatch {
    /// The target critic's value at the last slot of the batch, for every episode and without a mask.
    Epymarl,
    /// Nothing.
    NoBootstrap,
    /// The target critic's value one slot earlier, in place of the last reward.
    Benchmark2021,
    /// The target critic's value at each episode's own end if the step limit ended it, else nothing.
    Correct,
}

impl EndOfBatch {
    pub const ALL: [Self; 4] = [Self::Correct, Self::Epymarl, Self::Benchmark2021, Self::NoBootstrap];

    /// As in the configuration file.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Epymarl => "epymarl",
            Self::NoBootstrap => "no_bootstrap",
            Self::Benchmark2021 => "benchmark2021",
            Self::Correct => "correct",
        }
    }
}

impl fmt::Display for EndOfBatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// How rewards are scaled before learning (algorithms §2.6).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RewardStandardisation {
    Off,
    /// With mean and variance of all rewards so far.
    Running,
    /// With mean and standard deviation of this batch.
    Batch,
}

/// What happens to Adam's moments in an update call at rate 0 (algorithms §6.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrozenMoments {
    /// They follow the gradients; the parameters do not change.
    Update,
    /// They do not change either.
    Hold,
}

/// Which agent learns at which rate, and when that changes (algorithms §6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// Learning rate of each level: for all networks that an agent learns.
    pub rates: Vec<f64>,
    /// The level of each agent in period 0; in period `p` agent `i` has `levels[(i - p) mod n]`.
    pub levels: Vec<u32>,
    /// How long a period lasts.
    pub switch_period: Period,
    pub switch_unit: SwitchUnit,
}

/// What a period is counted in (algorithms §6.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SwitchUnit {
    UpdateCall,
    /// One for each epoch of PPO, one for each update call of Q-learning. Rates change between update calls only, so a
    /// period has to be a whole number of update calls.
    GradientStep,
}

/// When to test, and over how many episodes (algorithms §8.2).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Test {
    /// Environment steps between tests.
    pub interval: u64,
    /// Episodes in a test.
    pub episodes: u32,
}

/// When to write checkpoints.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Save {
    /// Rounds between checkpoints. A lost process costs at most this much work.
    pub interval: u64,
}

/// When to write metric rows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Log {
    /// Environment steps between rows.
    pub interval: u64,
}

/// Settings of the transport. Both sides of a connection need the same ones.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BusOptions {
    /// zenoh's low-latency transport. It cannot carry a tick of 32 KiB or more.
    pub low_latency: bool,
}
