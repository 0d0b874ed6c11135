//! Counting messages that a role cannot use.

use std::fmt;

/// Number of messages that a role has ignored. A peer can send any number of bad messages, so only the 1st, 2nd, 4th,
/// 8th, … is logged.
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

    /// Messages ignored so far.
    pub fn count(self) -> u64 {
        self.count
    }
}
