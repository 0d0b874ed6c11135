//! The experiment's configuration: everything that decides its result, in one value.
//!
//! Every process of a run holds the same [`Config`] and compares [`Config::digest`] when it joins. Where a process
//! listens and where it writes is not part of it. Every key is always present in the file; defaults come from
//! [`crate::presets`], and keys that do not exist are errors, because a misspelt key that is silently ignored is a
//! known way to publish wrong results (spec §11).

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
    /// All chance follows from it ([`crate::stream`]).
    pub seed: u64,
    /// Environment steps to learn from, summed over copies; the round that reaches it is the last (spec §8.1).
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

/// What is learned in.
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
    /// Environment copies, each good for one episode of a round (spec §2.3): the episodes in a batch of PPO, the
    /// new episodes between two rounds of Q-learning.
    pub copies: u32,
    /// Who plays what the team does not control: `builtin`, `random`, `still`, or the BLAKE3 digest of a file of
    /// weights in hexadecimal; opaque here.
    pub opponent: String,
    /// Observations and action sets are padded to the largest of the team, as in the reference (spec §2.4).
    pub pad: bool,
    /// What each agent is rewarded with (spec §2.5).
    pub reward: Reward,
}

/// What each agent is rewarded with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reward {
    /// The sum over the team: everybody learns from the same number (spec §2.5).
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

/// How each agent learns: what all algorithms have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Algo {
    pub name: AlgoName,
    /// Which published variant the other keys started from; it decides nothing by itself.
    pub profile: Profile,
    /// The network of the policy or of the action values; PPO's critic is always fully connected (spec §1.2).
    pub network: Network,
    /// Width of the hidden layers of all networks.
    pub hidden: u32,
    /// Discount factor.
    pub gamma: f64,
    /// Above 1: the target network is copied every that many update calls. Up to 1: Polyak τ (spec §4.4).
    pub target_update: f64,
    /// The gradients of each of an agent's networks are scaled down to this norm.
    pub max_grad_norm: f64,
    pub clip_scope: ClipScope,
    pub reward_standardisation: RewardStandardisation,
    pub frozen_moments: FrozenMoments,
    /// A one-hot agent index is appended to the network's input (spec §1.4).
    pub agent_id_input: bool,
    /// A one-hot of the agent's own last action is appended to the network's input, before the index (spec §1.4).
    pub last_action_input: bool,
}

/// Independent PPO (spec §4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ppo {
    /// Passes over the batch in one update call.
    pub epochs: u32,
    /// PPO's clip ε.
    pub clip: f64,
    pub entropy_coef: f64,
    /// Rewards in an n-step return before it bootstraps (spec §4.3).
    pub n_step: u32,
    pub end_of_batch: EndOfBatch,
    pub policy_test: PolicyTest,
}

/// Independent Q-learning (spec §5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QLearning {
    /// Episodes that each agent remembers.
    pub buffer: u32,
    /// Episodes drawn for an update call; there is none before so many are remembered.
    pub batch: u32,
    /// Whether the team draws the same episodes. A file without this key is older than it: then each agent drew its
    /// own.
    #[serde(default = "Draws::of_old_runs")]
    pub draws: Draws,
    /// The online network chooses the action that the target network values.
    pub double: bool,
    /// Probability of a random action at the beginning.
    pub epsilon_start: f64,
    /// The same after `epsilon_anneal` environment steps, reached in a straight line.
    pub epsilon_finish: f64,
    pub epsilon_anneal: u64,
    /// Probability of a random action in tests.
    pub test_epsilon: f64,
    /// An episode that the step limit ends is worth nothing beyond it (spec §3.4).
    pub time_limit_is_terminal: bool,
}

/// Which episodes the agents of a team draw for the same update call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Draws {
    /// The same for all, as in the reference. The seed decides which, so no agent sends another anything.
    Joint,
    /// Each agent draws its own.
    Independent,
}

impl Draws {
    fn of_old_runs() -> Self {
        Self::Independent
    }
}

/// What a policy does in tests (spec §8.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PolicyTest {
    /// It draws from its probabilities, as in training.
    Sample,
    /// It takes the most probable action.
    Greedy,
}

/// The published algorithms: two kinds of learner, and three ways to choose their rates (spec §6.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlgoName {
    /// Independent PPO: one rate for everyone.
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
    /// On-policy: each batch of episodes is used once.
    Ppo,
    /// Off-policy: episodes are remembered and drawn again.
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

/// Variants of the same algorithm: ours and two published ones (spec §11).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// The default: as EPyMARL, but an episode that has come to its end is worth nothing beyond it.
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

/// A name given on the command line that stands for nothing.
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

/// The actor's network (spec §1.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Network {
    /// Two fully connected hidden layers.
    Fc,
    /// A fully connected layer, then a gated recurrent unit.
    Gru,
}

/// Over whose gradients the norm is taken that is clipped (spec §6.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClipScope {
    PerAgent,
    /// Understood, but refused by [`Config::validate`]: agents in processes of their own share no gradients.
    Joint,
}

/// What stands in for the future at the last slot of a batch (spec §4.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndOfBatch {
    /// The target critic at the last slot, for every episode and without a mask.
    Epymarl,
    /// Nothing.
    NoBootstrap,
    /// The target critic one slot earlier, in place of the last reward.
    Benchmark2021,
    /// The target critic at each episode's own end if the step limit ended it, else nothing.
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

/// How rewards are scaled before learning (spec §2.6).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RewardStandardisation {
    Off,
    /// By mean and variance of all rewards so far.
    Running,
    /// By mean and deviation of this batch.
    Batch,
}

/// What Adam's moments do in an update call at rate 0 (spec §6.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrozenMoments {
    /// They follow the gradients while the parameters stand still.
    Update,
    /// They stand still too.
    Hold,
}

/// Who learns at which rate, and when that changes (spec §6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// Learning rate of each level, for actor and critic alike.
    pub rates: Vec<f64>,
    /// The level of each agent in period 0; in period `p` agent `i` has `levels[(i - p) mod n]`.
    pub levels: Vec<u32>,
    /// How long a period lasts.
    pub switch_period: Period,
    pub switch_unit: SwitchUnit,
}

/// What a period is counted in (spec §6.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SwitchUnit {
    UpdateCall,
    /// One for each epoch of PPO, one for each update call of Q-learning. Rates change between update calls only, so
    /// that a period has to be a whole number of them.
    GradientStep,
}

/// When and how long to test (spec §8.2).
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
    /// Rounds between checkpoints: the most work that a lost process costs.
    pub interval: u64,
}

/// When to write metric rows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Log {
    /// Environment steps between rows.
    pub interval: u64,
}

/// How processes talk; the same on both sides of a connection, or they would not understand each other.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BusOptions {
    /// The faster transport, which cannot carry a tick of 32 KiB or more.
    pub low_latency: bool,
}
