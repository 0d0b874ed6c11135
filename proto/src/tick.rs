//! The two messages of every tick: what an agent sees, and what it does.
//!
//! They are the hot path: packed little-endian arrays behind a fixed header, so that encoding is a copy. Encoding and
//! decoding reuse their buffers and allocate nothing once these have grown. `docs/protocol.md` shows the layouts.

mod act;
mod observe;

pub use act::Act;
pub use observe::Observe;

use std::fmt;

/// The kind of round that a tick belongs to, or that the run ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Mode {
    /// Episodes to learn from; their steps are counted.
    #[default]
    Train = 0,
    /// A test (algorithms §8.2): current parameters, separate environment copies, no learning, steps not counted.
    Test = 1,
    /// The run has used its budget: save and leave.
    Finished = 2,
    /// The run stops early: save and leave; it can be resumed.
    Stopped = 3,
}

impl Mode {
    /// Whether the message closes the run and carries no rows.
    pub fn closes_the_run(self) -> bool {
        matches!(self, Self::Finished | Self::Stopped)
    }

    fn from_wire(code: u8) -> Result<Self, String> {
        match code {
            0 => Ok(Self::Train),
            1 => Ok(Self::Test),
            2 => Ok(Self::Finished),
            3 => Ok(Self::Stopped),
            _ => Err(format!("mode is {code}: expected 0 (train), 1 (test), 2 (finished) or 3 (stopped)")),
        }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Test => "test",
            Self::Finished => "finished",
            Self::Stopped => "stopped",
        })
    }
}

/// Whether an episode is running, and if not, why. Learners treat the two ends differently (algorithms §3.4, §4.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum End {
    /// The episode is running; the row needs an action.
    #[default]
    Running = 0,
    /// The task itself ended the episode.
    Terminated = 1,
    /// Only the step limit ended the episode.
    TimeLimit = 2,
}

impl End {
    fn from_wire(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Running),
            1 => Some(Self::Terminated),
            2 => Some(Self::TimeLimit),
            _ => None,
        }
    }
}

/// Identifies a tick: an [`Act`] answers the [`Observe`] with the same id.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TickId {
    /// Increases whenever the run starts again from a checkpoint. Messages of other epochs are ignored.
    pub epoch: u32,
    /// Training rounds completed. A test has the number of the training round that follows it.
    pub round: u64,
    pub mode: Mode,
    /// World steps made in this round so far.
    pub tick: u32,
}

impl fmt::Display for TickId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "epoch {}, {} round {}, tick {}", self.epoch, self.mode, self.round, self.tick)
    }
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) | u64::from(u32_at(bytes, at + 4)) << 32
}

/// `value` as the u16 of the header.
fn narrow(value: usize) -> u16 {
    u16::try_from(value).expect("rows, observation sizes and actions are bounded when the run is configured")
}

/// The numbers of a section, whose length is a multiple of their size.
fn u16s(section: &[u8]) -> impl ExactSizeIterator<Item = u16> + '_ {
    section.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]]))
}

/// The numbers of a section, whose length is a multiple of their size.
fn f32s(section: &[u8]) -> impl ExactSizeIterator<Item = f32> + '_ {
    section.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

fn put_u16s(section: &mut [u8], values: &[u16]) {
    for (bytes, value) in section.chunks_exact_mut(2).zip(values) {
        bytes.copy_from_slice(&value.to_le_bytes());
    }
}

fn put_f32s(section: &mut [u8], values: &[f32]) {
    for (bytes, value) in section.chunks_exact_mut(4).zip(values) {
        bytes.copy_from_slice(&value.to_le_bytes());
    }
}
