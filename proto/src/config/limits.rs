//! The largest numbers that a configuration may hold, each with its reason.

/// Agent indices fit a u16.
pub const MAX_AGENTS: u32 = 65_535;

/// The schedule message has a byte for the level of each agent.
pub const MAX_LEVELS: usize = 256;

/// Rows of a tick are counted in a u16, and a checkpoint holds a random stream for each copy.
pub const MAX_COPIES: u32 = 10_000;

/// A test may run all its episodes in one round, so the bound on rows holds here too.
pub const MAX_TEST_EPISODES: u32 = 10_000;

/// Far beyond the published widths (spec §9.1); keeps a slip of the finger from claiming all memory.
pub const MAX_HIDDEN: u32 = 4_096;

/// Far beyond the published 4 (spec §4.2).
pub const MAX_EPOCHS: u32 = 1_000;

/// The longest name of a task, in bytes.
pub const MAX_TASK_NAME: usize = 256;

/// The longest name of an opponent, in bytes: a digest has 64.
pub const MAX_OPPONENT: usize = 64;

/// The longest text of a map, in bytes: a hundred times those that come with the program.
pub const MAX_MAP: usize = 65_536;

/// Two hundred times the published 5,000 (spec §5.1).
pub const MAX_BUFFER: u32 = 1_000_000;
