//! Counting messages that a role cannot use.

use std::fmt;

/// How many messages a role has ignored. A peer can send anything and any amount of it, so only the 1st,
/// 2nd, 4th, 8th … is told.
#[derive(Debug, Clone, Copy, Default)]
pub struct Ignored {
    count: u64,
}

impl Ignored {
    /// Counts one more, ignored because of `why`.
    pub fn add(&mut self, why: impl fmt::Display) {
        self.count += 1;
        if self.count.is_power_of_two() {
            tracing::warn!(%why, so_far = self.count, "ignored a message");
        }
    }

    /// How many there were.
    pub fn count(self) -> u64 {
        self.count
    }
}
