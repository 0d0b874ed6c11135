//! The schedule of learning rates that the coordinator publishes, and the progress that agents report to it.

use crate::codec::Message;
use crate::config::limits::{MAX_AGENTS, MAX_LEVELS};
use serde::{Deserialize, Serialize};

/// Which agent learns at which rate in the update calls from `from` up to, not including, `until`.
///
/// - key: `schedule`, as a publication and as the reply to [`RatesQuery`]
/// - from the coordinator to every agent
/// - if lost: the agent queries it; no agent makes an update call that no schedule covers
///
/// This is all that agents receive about each other. It is small: a number for each level and a byte for each agent,
/// at most 64 bytes for 25 agents with two levels ([`Rates::longest`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// First update call that this covers, counted from zero.
    pub from: u64,
    /// First update call that this does not cover; [`Rates::FOR_EVER`] if the rates never change again.
    pub until: u64,
    /// The agent at the head of the pattern of levels, `fast(u)` in algorithms §6.2. Its rate may be the smaller one.
    pub fast_agent: u32,
    /// The learning rate of each level.
    pub rates: Vec<f64>,
    /// The present level of each agent, by agent.
    pub levels: Vec<u8>,
}

impl Rates {
    /// The value of `until` for a schedule that never changes again.
    pub const FOR_EVER: u64 = u64::MAX;

    /// The learning rate of an agent; `None` if there is no such agent.
    pub fn rate_of(&self, agent: u32) -> Option<f64> {
        let level = self.levels.get(usize::try_from(agent).ok()?)?;
        self.rates.get(usize::from(*level)).copied()
    }

    /// Whether this gives the rates of an update call.
    pub fn covers(&self, update_call: u64) -> bool {
        (self.from..self.until).contains(&update_call)
    }

    /// Bytes of the longest message for a team of this size with this many levels.
    pub const fn longest(agents: usize, levels: usize) -> usize {
        let frame = 2;
        let from_and_until = 2 * varint_bytes(u64::MAX);
        let fast_agent = varint_bytes((agents as u64).saturating_sub(1));
        let rates = varint_bytes(levels as u64) + 8 * levels;
        let level_of_each = varint_bytes(agents as u64) + agents;
        frame + from_and_until + fast_agent + rates + level_of_each
    }
}

/// Bytes of an unsigned number in the encoding.
const fn varint_bytes(value: u64) -> usize {
    match value {
        0..=250 => 1,
        251..=0xffff => 3,
        0x1_0000..=0xffff_ffff => 5,
        _ => 9,
    }
}

impl Message for Rates {
    const TAG: u8 = 5;
    const NAME: &'static str = "Rates";
    const MAX_BYTES: usize = Self::longest(MAX_AGENTS as usize, MAX_LEVELS);

    fn check(&self) -> Result<(), String> {
        if self.from >= self.until {
            return Err(format!(
                "covers update calls {} to {}: expected at least one",
                self.from, self.until
            ));
        }
        if let Some(rate) = self.rates.iter().find(|rate| !(rate.is_finite() && **rate >= 0.0)) {
            return Err(format!("a rate is {rate}: expected a finite number from 0"));
        }
        if self.levels.get(self.fast_agent as usize).is_none() {
            let agents = self.levels.len();
            return Err(format!("the fast agent is {} in a team of {agents}", self.fast_agent));
        }
        if let Some(level) = self.levels.iter().find(|&&level| usize::from(level) >= self.rates.len()) {
            return Err(format!("an agent has level {level}, but there are {} rates", self.rates.len()));
        }
        Ok(())
    }
}

/// An agent's query for the schedule of an update call.
///
/// - key: query on `schedule`
/// - from an agent to the coordinator, which replies with the [`Rates`] that cover it
/// - if lost: sent again
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct RatesQuery {
    /// Number of the update call: update calls completed before it.
    pub update_call: u64,
}

impl Message for RatesQuery {
    const TAG: u8 = 6;
    const NAME: &'static str = "RatesQuery";
    const MAX_BYTES: usize = 11;
}

/// An agent reports its update calls, so that the coordinator can publish ahead, and that its run is finished, so that
/// the coordinator knows how it ended.
///
/// - key: `agent/{i}/progress`
/// - from agent i to the coordinator, after every update call, and before it leaves a finished run
/// - if lost: the next one replaces it; at worst the agent queries its rates
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Progress {
    /// Update calls that this agent has completed.
    pub update_calls: u64,
    /// The run has used its budget, and this agent is about to leave.
    pub finished: bool,
}

impl Message for Progress {
    const TAG: u8 = 7;
    const NAME: &'static str = "Progress";
    const MAX_BYTES: usize = 12;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::{decode, encode, WireError};

    fn rates() -> Rates {
        Rates { from: 100, until: 200, fast_agent: 1, rates: vec![2e-4, 5e-5], levels: vec![1, 0, 1] }
    }

    #[test]
    fn each_agent_reads_its_own_rate() {
        let rates = rates();
        assert_eq!(
            [0, 1, 2, 3].map(|agent| rates.rate_of(agent)),
            [Some(5e-5), Some(2e-4), Some(5e-5), None]
        );
    }

    #[test]
    fn the_last_covered_update_call_is_the_one_before_until() {
        assert_eq!([99, 100, 199, 200].map(|u| rates().covers(u)), [false, true, true, false]);
        let for_ever = Rates { until: Rates::FOR_EVER, ..rates() };
        assert!(for_ever.covers(u64::MAX - 1));
    }

    #[test]
    fn queries_progress_and_rates_come_back_as_they_were_sent() {
        for value in [0, 250, 251, 65_535, 65_536, u64::MAX] {
            let query = RatesQuery { update_call: value };
            assert_eq!(decode(&encode(&query).unwrap()), Ok(query));
            let progress = Progress { update_calls: value, finished: false };
            assert_eq!(decode(&encode(&progress).unwrap()), Ok(progress));
        }
        assert_eq!(decode(&encode(&rates()).unwrap()), Ok(rates()));
    }

    /// The longest message of a team in which every level has an agent.
    fn largest(agents: usize, levels: usize) -> Rates {
        Rates {
            from: u64::MAX - 1,
            until: u64::MAX,
            fast_agent: agents as u32 - 1,
            rates: vec![1e-4; levels],
            levels: (0..agents).map(|agent| (agent % levels) as u8).collect(),
        }
    }

    #[test]
    fn the_longest_message_is_as_long_as_computed_and_comes_back() {
        let a_rate_each = (1..=64).map(|n| (n, n));
        let large = [(250, 2), (251, 2), (252, 2), (256, 256), (1_000, 2), (65_535, 2), (65_535, 256)];
        for (agents, levels) in a_rate_each.chain(large) {
            let rates = largest(agents, levels);
            let bytes = encode(&rates).unwrap();
            assert_eq!(bytes.len(), Rates::longest(agents, levels), "{agents} agents, {levels} levels");
            assert_eq!(decode(&bytes), Ok(rates), "{agents} agents, {levels} levels");
        }
    }

    #[test]
    fn a_message_has_eight_bytes_for_each_level_and_one_for_each_agent() {
        for (agents, levels) in [(1, 1), (2, 2), (25, 2), (10, 10), (64, 64), (250, 250)] {
            assert_eq!(Rates::longest(agents, levels), 23 + 8 * levels + agents);
        }
        assert_eq!((Rates::longest(25, 2), Rates::longest(10, 10)), (64, 113));
        assert_eq!(Rates::longest(251, 1), 2 + 18 + 1 + 9 + 3 + 251);
        assert_eq!(Rates::longest(252, 1), 2 + 18 + 3 + 9 + 3 + 252);
        assert_eq!(Rates::MAX_BYTES, 2 + 18 + 3 + (3 + 8 * 256) + (3 + 65_535));
    }

    #[test]
    fn a_message_that_is_longer_than_any_team_needs_is_refused() {
        let too_long = Rates { levels: vec![0; 65_536 + 2_048], ..largest(1, 1) };
        assert!(matches!(encode(&too_long), Err(WireError::TooLong { name: "Rates", .. })));
    }

    #[test]
    fn schedules_that_cannot_be_followed_are_refused() {
        let refused = |rates: Rates| match encode(&rates).unwrap_err() {
            WireError::Value { what, .. } => what,
            other => panic!("expected a value error, got {other:?}"),
        };
        assert_eq!(
            refused(Rates { until: 100, ..rates() }),
            "covers update calls 100 to 100: expected at least one"
        );
        assert_eq!(refused(Rates { fast_agent: 3, ..rates() }), "the fast agent is 3 in a team of 3");
        assert_eq!(
            refused(Rates { levels: vec![1, 0, 2], ..rates() }),
            "an agent has level 2, but there are 2 rates"
        );
        for rate in [-1e-4, f64::NAN, f64::INFINITY] {
            assert_eq!(
                refused(Rates { rates: vec![rate, 0.0], ..rates() }),
                format!("a rate is {rate}: expected a finite number from 0")
            );
        }
    }

    #[test]
    fn what_would_not_be_sent_is_not_accepted_either() {
        let mut bytes = encode(&rates()).unwrap();
        bytes[2] = 200;
        assert_eq!(
            decode::<Rates>(&bytes).unwrap_err().to_string(),
            "Rates message: covers update calls 200 to 200: expected at least one"
        );
    }
}
