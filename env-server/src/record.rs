//! The env-server's records: metric rows, the content of its checkpoints, a report, scalars for a display.

use std::collections::BTreeMap;

use proto::config::Reward;
use proto::control::Metrics;
use serde::{Deserialize, Serialize};
use store::Row;

use crate::convert::Played;

/// The state of a run between rounds: everything that its continuation depends on.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Edge {
    /// Training rounds completed.
    pub round: u64,
    /// Environment steps counted.
    pub t_env: u64,
    /// Environment steps at the last test; none before the first.
    pub last_test: Option<u64>,
    /// Episodes since the last row of training returns.
    pub unlogged: Unlogged,
    /// Environment steps at that row.
    pub last_row: u64,
    /// Of all tests so far: the last mean return, and the best.
    pub test_return_mean: Option<f64>,
    pub best_test_return_mean: Option<f64>,
    /// Means over the episodes of the last test of what the world reports of them.
    #[serde(default)]
    pub test_facts: BTreeMap<String, f64>,
}

/// Sums over episodes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Unlogged {
    episodes: u64,
    returns: f64,
    squares: f64,
    lengths: u64,
    /// Of each agent's own returns with `world.reward = individual`; else empty.
    #[serde(default)]
    of_agents: Vec<f64>,
    /// Of what the world reports of an episode, by name.
    #[serde(default)]
    facts: BTreeMap<String, f64>,
}

impl Unlogged {
    /// Adds the episodes of a round, with each agent's own returns if agents learn from them.
    pub fn add<'a>(&mut self, played: impl Iterator<Item = Played<'a>>, reward: Reward) {
        for episode in played {
            self.episodes += 1;
            self.returns += episode.episode_return;
            self.squares += episode.episode_return * episode.episode_return;
            self.lengths += episode.length;
            for &(name, value) in episode.facts {
                match self.facts.get_mut(name) {
                    Some(sum) => *sum += value,
                    None => drop(self.facts.insert(name.to_owned(), value)),
                }
            }
            if reward == Reward::Individual {
                self.of_agents.resize(episode.returns.len(), 0.0);
                for (sum, own) in self.of_agents.iter_mut().zip(episode.returns) {
                    *sum += own;
                }
            }
        }
    }

    /// Adds the agents' own mean returns to a row, if they are recorded.
    fn own_returns(&self, row: Row, prefix: &str) -> Row {
        let own = self.of_agents.iter().enumerate();
        own.fold(row, |row, (agent, sum)| {
            row.with(format!("{prefix}agent_{agent}_return_mean"), sum / self.episodes as f64)
        })
    }

    /// The mean of each fact over episodes, under the name that it has in a row.
    fn facts(&self, prefix: &str) -> BTreeMap<String, f64> {
        let mean =
            |(name, sum): (&String, &f64)| (format!("{prefix}{name}_mean"), sum / self.episodes as f64);
        self.facts.iter().map(mean).collect()
    }

    fn mean(&self) -> f64 {
        self.returns / self.episodes as f64
    }

    /// Divisor `k`, as the reference reports it.
    fn std(&self) -> f64 {
        (self.squares / self.episodes as f64 - self.mean() * self.mean()).max(0.0).sqrt()
    }

    fn ep_length_mean(&self) -> f64 {
        self.lengths as f64 / self.episodes as f64
    }

    /// Environment steps of these episodes.
    pub fn steps(&self) -> u64 {
        self.lengths
    }
}

impl Edge {
    /// Whether a test is due: after the first round, and whenever `interval` steps have passed since the last test
    /// (algorithms §8.1).
    pub fn test_is_due(&self, interval: u64) -> bool {
        self.last_test.is_none_or(|last| self.t_env - last >= interval)
    }

    /// The row of the training returns since the last one, if `interval` steps have passed.
    pub fn training_row(&mut self, interval: u64) -> Option<Row> {
        if self.t_env - self.last_row < interval {
            return None;
        }
        self.last_row = self.t_env;
        let played = std::mem::take(&mut self.unlogged);
        let row = Row::of_world(self.t_env, self.round)
            .with("return_mean", played.mean())
            .with("return_std", played.std())
            .with("ep_length_mean", played.ep_length_mean())
            .with("episodes", played.episodes as f64);
        let row = played.own_returns(row, "");
        Some(played.facts("").into_iter().fold(row, |row, (name, mean)| row.with(name, mean)))
    }

    /// The scalars of this edge for a display.
    pub fn metrics(&self) -> Metrics {
        let test = self.test_return_mean.map(|mean| ("test_return_mean".to_owned(), mean));
        let facts = self.test_facts.iter().map(|(name, mean)| (name.clone(), *mean));
        let scalars = test.into_iter().chain(facts).collect();
        Metrics { t_env: self.t_env, update_calls: self.round, scalars }
    }

    /// The row of a test at this edge.
    pub fn test_row(&mut self, test: &Unlogged) -> Row {
        let mean = test.mean();
        self.last_test = Some(self.t_env);
        self.test_return_mean = Some(mean);
        self.best_test_return_mean = Some(self.best_test_return_mean.map_or(mean, |best| best.max(mean)));
        let row = Row::of_world(self.t_env, self.round)
            .with("test_return_mean", mean)
            .with("test_return_std", test.std())
            .with("test_ep_length_mean", test.ep_length_mean())
            .with("test_episodes", test.episodes as f64);
        self.test_facts = test.facts("test_");
        let row = test.own_returns(row, "test_");
        self.test_facts.iter().fold(row, |row, (name, mean)| row.with(name.clone(), *mean))
    }
}

/// Wall time of this process by activity, for reports only.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Seconds {
    /// Resetting and stepping worlds.
    pub world: f64,
    /// Observing worlds and writing messages.
    pub encode: f64,
    /// Handing messages to the bus.
    pub send: f64,
    /// Waiting for actions in the middle of a round: the bus and the agents' inference.
    pub actions: f64,
    /// Waiting at the last tick of a round, after which agents learn, and at tick 0 of the next.
    pub updates: f64,
    /// Tests, without the wait at their tick 0.
    pub tests: f64,
    /// Checkpoints and metric rows.
    pub disk: f64,
    /// From the first tick to the last.
    pub total: f64,
}

/// The content of the role's result.json.
#[derive(Serialize)]
pub struct Report {
    pub role: &'static str,
    pub t_env: u64,
    pub rounds: u64,
    /// Environment steps that this process played, without those before a resume.
    pub steps_played: u64,
    pub ticks: u64,
    pub test_return_mean: Option<f64>,
    pub best_test_return_mean: Option<f64>,
    pub test_facts: BTreeMap<String, f64>,
    pub seconds: Seconds,
    pub ignored_messages: u64,
    pub peak_memory_bytes: Option<u64>,
    pub cpu_seconds: Option<f64>,
    /// In all threads of the process since the first tick; only in builds that count allocations.
    pub allocations: Option<u64>,
    /// Time of the first environment step, in seconds since 1970. The launcher computes from it how long the start
    /// took.
    pub first_step_at: Option<f64>,
    pub traffic: Vec<(String, u64, u64)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_deviation_of_returns_are_those_computed_by_hand() {
        let mut sums = Unlogged::default();
        let of =
            |episode_return, length| Played { episode_return, returns: &[], length, facts: &[("wins", 0.5)] };
        sums.add([of(0.0, 50), of(1.0, 10), of(0.5, 30)].into_iter(), Reward::Sum);
        assert_eq!((sums.mean(), sums.ep_length_mean(), sums.steps()), (0.5, 30.0, 90));
        assert_eq!(sums.facts("test_"), BTreeMap::from([("test_wins_mean".to_owned(), 0.5)]));
        assert!((sums.std() - (1.0f64 / 6.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn tests_come_after_the_first_round_and_then_at_every_interval() {
        let mut edge = Edge { t_env: 300, round: 1, ..Edge::default() };
        assert!(edge.test_is_due(1000));
        let mut test = Unlogged::default();
        let facts = &[("battle_won", 1.0)];
        let played = Played { episode_return: 0.25, returns: &[], length: 4, facts };
        test.add(std::iter::once(played), Reward::Sum);
        let row = edge.test_row(&test);
        assert_eq!(row.scalars.last(), Some(&("test_battle_won_mean".into(), 1.0)));
        let shown = [("test_return_mean".to_owned(), 0.25), ("test_battle_won_mean".to_owned(), 1.0)];
        assert_eq!(edge.metrics().scalars, shown);
        assert_eq!((edge.last_test, edge.best_test_return_mean), (Some(300), Some(0.25)));
        edge.t_env = 1299;
        assert!(!edge.test_is_due(1000));
        edge.t_env = 1300;
        assert!(edge.test_is_due(1000));
    }
}
