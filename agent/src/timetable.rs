//! The part of the learning-rate schedule that this agent has received.

use std::collections::BTreeMap;

use proto::control::Rates;

/// The schedules received so far; an agent never computes them.
#[derive(Debug, Default)]
pub struct Timetable {
    by_start: BTreeMap<u64, Rates>,
}

impl Timetable {
    /// Adds a schedule from the coordinator.
    pub fn learn(&mut self, rates: Rates) {
        self.by_start.insert(rates.from, rates);
    }

    /// The rates of an update call, if received.
    pub fn covering(&self, update_call: u64) -> Option<&Rates> {
        self.by_start
            .range(..=update_call)
            .next_back()
            .map(|(_, rates)| rates)
            .filter(|r| r.covers(update_call))
    }

    /// Removes schedules that end before an update call.
    pub fn forget_before(&mut self, update_call: u64) {
        self.by_start.retain(|_, rates| rates.until > update_call);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(from: u64, until: u64) -> Rates {
        Rates { from, until, fast_agent: 0, rates: vec![1e-3], levels: vec![0] }
    }

    #[test]
    fn an_update_call_without_schedule_is_not_covered() {
        let mut timetable = Timetable::default();
        assert_eq!(timetable.covering(0), None);
        timetable.learn(told(20, 30));
        timetable.learn(told(0, 10));
        let covered = [0, 9, 10, 19, 20, 29, 30].map(|u| timetable.covering(u).is_some());
        assert_eq!(covered, [true, true, false, false, true, true, false]);
        timetable.forget_before(10);
        assert_eq!(timetable.covering(9), None);
        assert_eq!(timetable.covering(25), Some(&told(20, 30)));
    }
}
