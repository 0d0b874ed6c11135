//! Upper limits for the numbers of a configuration, each with its reason.

/// Agent indices fit a u16.
pub const MAX_AGENTS: u32 = 65_535;

/// The schedule message has a byte for the level of each agent.
pub const MAX_LEVELS: usize = 256;

/// Far beyond the published 10 (algorithms §4.2). A tick numbers its copies in a u16.
pub const MAX_COPIES: u32 = 10_000;

/// A test plays all its episodes side by side, so the limit of [`MAX_COPIES`] holds here too.
pub const MAX_TEST_EPISODES: u32 = 10_000;

/// Far beyond the published widths (algorithms §9.1). Prevents a typo from using all memory.
pub const MAX_HIDDEN: u32 = 4_096;

/// Far beyond the published 4 (algorithms §4.2).
pub const MAX_EPOCHS: u32 = 1_000;

/// The longest name of a task, in bytes.
pub const MAX_TASK_NAME: usize = 256;

/// The longest name of an opponent, in bytes: a digest has 64.
pub const MAX_OPPONENT: usize = 64;

/// The longest text of a map, in bytes: a hundred times those that come with the program.
pub const MAX_MAP: usize = 65_536;

/// Two hundred times the published 5,000 (algorithms §5.1).
pub const MAX_BUFFER: u32 = 1_000_000;
