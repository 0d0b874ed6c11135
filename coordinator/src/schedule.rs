//! The multi-timescale schedule (algorithms §6) as a pure function of the update call.
//!
//! ```text
//! period of update call u       p = ⌊ u / s ⌋
//! level of agent i in period p  h_{(i − p) mod n}          for the paper h = 0, 1, 1, …, 1
//! fast(u) = p mod n             the agent at the head of the pattern
//! ```
//!
//! This follows the paper's text. Its Algorithm 1 differs in an index (algorithms §6.2).

use proto::config::{Config, Period, SwitchUnit};
use proto::control::Rates;

/// The agent at the head of the pattern in update call `u`. With the paper's pattern it learns with `lr_0` and all
/// others with `lr_1`. It is called the fast agent, although `lr_0` may be the smaller rate.
pub fn turn(u: u64, s: u64, n: u64) -> u64 {
    (u / s) % n
}

/// The rates of update call `u`, and the range of update calls that they cover.
pub fn rates(config: &Config, u: u64) -> Rates {
    let n = u64::from(config.world.agents);
    // In gradient steps, an update call of PPO has `epochs` steps and one of Q-learning a single step. In a valid
    // configuration a period is a whole number of update calls.
    let steps_per_call = match (config.schedule.switch_unit, &config.ppo) {
        (SwitchUnit::GradientStep, Some(ppo)) => u64::from(ppo.epochs),
        (SwitchUnit::UpdateCall, _) | (SwitchUnit::GradientStep, None) => 1,
    };
    let (period, from, until) = match config.schedule.switch_period {
        Period::Infinite => (0, 0, Rates::FOR_EVER),
        Period::Every(s) => {
            let calls = s / steps_per_call;
            let from = u / calls * calls;
            (u / calls, from, from.saturating_add(calls))
        }
    };
    let fast_agent = turn(period, 1, n);
    let level = |agent: u64| config.schedule.levels[((agent + n - fast_agent) % n) as usize];
    Rates {
        from,
        until,
        fast_agent: fast_agent as u32,
        rates: config.schedule.rates.clone(),
        levels: (0..n).map(|agent| level(agent) as u8).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::config::AlgoName;
    use proto::presets::{self, Family};

    fn config(agents: u32, rates: &[f64], levels: &[u32], period: Period) -> Config {
        let mut config = presets::config("test", "any", agents, AlgoName::Mtppo, Family::Lbf);
        config.schedule.rates = rates.to_vec();
        config.schedule.levels = levels.to_vec();
        config.schedule.switch_period = period;
        config
    }

    #[test]
    fn three_agents_take_turns_every_hundred_update_calls() {
        let turns = [0, 99, 100, 199, 200, 299, 300].map(|u| turn(u, 100, 3));
        assert_eq!(turns, [0, 0, 1, 1, 2, 2, 0]);
    }

    #[test]
    fn the_turn_goes_round_for_other_team_sizes_and_periods() {
        for n in [2, 3, 10] {
            for s in [1, 100] {
                let mut expected = (0..n).cycle();
                for period in 0..3 * n {
                    let agent = expected.next().expect("endless");
                    assert_eq!((turn(period * s, s, n), turn(period * s + s - 1, s, n)), (agent, agent));
                }
            }
        }
    }

    #[test]
    fn one_agent_has_the_first_rate_and_all_others_the_second() {
        let config = config(3, &[4e-4, 1e-4], &[0, 1, 1], Period::Every(100));
        for (u, fast) in [(0, 0), (99, 0), (100, 1), (299, 2), (300, 0)] {
            let rates = rates(&config, u);
            assert_eq!(
                (rates.fast_agent, rates.from, rates.until),
                (fast, u / 100 * 100, u / 100 * 100 + 100)
            );
            for agent in 0..3 {
                assert_eq!(rates.rate_of(agent), Some(if agent == fast { 4e-4 } else { 1e-4 }));
            }
        }
    }

    #[test]
    fn a_pattern_of_three_levels_moves_on_by_one_agent_each_period() {
        let config = config(4, &[1e-3, 1e-4, 0.0], &[0, 1, 2, 2], Period::Every(1));
        let levels: Vec<_> = (0..5).map(|u| rates(&config, u).levels).collect();
        assert_eq!(levels, [[0, 1, 2, 2], [2, 0, 1, 2], [2, 2, 0, 1], [1, 2, 2, 0], [0, 1, 2, 2]]);
    }

    #[test]
    fn an_infinite_period_keeps_agent_zero_fast_for_ever() {
        let config = config(2, &[1e-3, 1e-4], &[0, 1], Period::Infinite);
        let told = rates(&config, 123_456_789);
        assert_eq!((told.fast_agent, told.from, told.until), (0, 0, Rates::FOR_EVER));
    }

    /// The paper's periods, and small ones around the epochs of an update call.
    const PERIODS: [u64; 8] = [1, 2, 3, 4, 10, 100, 1_000, 10_000];

    #[test]
    fn every_agent_gets_as_many_turns_or_the_period_is_refused() {
        for (unit, name) in [
            (SwitchUnit::UpdateCall, AlgoName::Mtppo),
            (SwitchUnit::GradientStep, AlgoName::Mtppo),
            (SwitchUnit::UpdateCall, AlgoName::Mtql),
            (SwitchUnit::GradientStep, AlgoName::Mtql),
        ] {
            for s in PERIODS {
                for n in 1..=12 {
                    let mut config = presets::config("test", "any", n, name, Family::Lbf);
                    config.schedule.switch_period = Period::Every(s);
                    config.schedule.switch_unit = unit;
                    let steps = match (&config.ppo, unit) {
                        (Some(ppo), SwitchUnit::GradientStep) => u64::from(ppo.epochs),
                        _ => 1,
                    };
                    if !s.is_multiple_of(steps) {
                        let refused = config.validate().unwrap_err().to_string();
                        let reason =
                            format!("is {s} gradient steps: expected a multiple of `ppo.epochs` = 4");
                        assert!(refused.contains(&reason), "{refused}");
                        continue;
                    }
                    assert_eq!(config.validate(), Ok(()));
                    let cycle = u64::from(n) * s / steps;
                    let mut turns = vec![0; n as usize];
                    for u in 0..cycle {
                        turns[rates(&config, u).fast_agent as usize] += 1;
                    }
                    assert_eq!(turns, vec![s / steps; n as usize], "{unit:?}, {name}, s = {s}, n = {n}");
                    assert_eq!(rates(&config, cycle).fast_agent, 0, "the next cycle begins");
                }
            }
        }
    }

    #[test]
    fn segments_meet_without_gap_or_overlap_in_both_units() {
        for (unit, periods) in [
            (SwitchUnit::UpdateCall, [1, 2, 3, 4, 7, 10]),
            (SwitchUnit::GradientStep, [4, 8, 12, 16, 20, 40]),
        ] {
            for s in periods {
                let mut config = config(3, &[1e-3, 1e-4], &[0, 1, 1], Period::Every(s));
                config.schedule.switch_unit = unit;
                let mut next = 0;
                while next < 50 {
                    let segment = rates(&config, next);
                    assert_eq!(segment.from, next, "{unit:?}, s = {s}");
                    for u in segment.from..segment.until {
                        assert_eq!(rates(&config, u), segment, "{unit:?}, s = {s}, u = {u}");
                    }
                    next = segment.until;
                }
            }
        }
    }

    #[test]
    fn gradient_steps_are_counted_four_to_an_update_call() {
        let mut config = config(2, &[1e-3, 1e-4], &[0, 1], Period::Every(8));
        config.schedule.switch_unit = SwitchUnit::GradientStep;
        let fast: Vec<_> = (0..6).map(|u| rates(&config, u).fast_agent).collect();
        assert_eq!(fast, [0, 0, 1, 1, 0, 0]);
    }
}
