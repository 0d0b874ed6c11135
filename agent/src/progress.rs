//! An agent's reports: metric rows, scalars for a live display, and its seconds by activity.

use std::time::Instant;

use proto::control::{Metrics, Rates};
use serde::{Deserialize, Serialize};
use store::Row;

use crate::learner::Scalars;

/// Sums over the update calls that are not yet in a metric row. Part of a checkpoint, so that an interrupted run has
/// the same rows.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Unlogged {
    update_calls: u64,
    /// Environment steps at the last row.
    last_row: u64,
    sums: Vec<f64>,
}

impl Unlogged {
    /// Adds an update call at `t_env` environment steps. Returns a row of means when `interval` steps have passed since
    /// the last row.
    pub fn add(&mut self, scalars: &Scalars, t_env: u64, update_calls: u64, interval: u64) -> Option<Row> {
        self.sums.resize(scalars.len(), 0.0);
        self.update_calls += 1;
        for (sum, (_, value)) in self.sums.iter_mut().zip(scalars) {
            *sum += value;
        }
        if t_env - self.last_row < interval {
            return None;
        }
        let count = self.update_calls as f64;
        let mut row = Row::of_learner(t_env, update_calls);
        for ((name, _), sum) in scalars.iter().zip(&self.sums) {
            row = row.with(*name, sum / count);
        }
        *self = Self { update_calls: 0, last_row: t_env, sums: vec![] };
        Some(row)
    }
}

/// The scalars of an update call for a display.
pub fn metrics(scalars: &Scalars, rates: &Rates, t_env: u64, update_calls: u64) -> Metrics {
    let mut named: Vec<_> = scalars.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
    named.push(("fast_agent".to_owned(), f64::from(rates.fast_agent)));
    Metrics { t_env, update_calls, scalars: named }
}

/// Wall time of this process by activity, for reports only.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Seconds {
    /// Forward passes and sampling.
    pub inference: f64,
    /// Update calls.
    pub update: f64,
    /// Reading and writing messages.
    pub encode: f64,
    /// Handing messages to the bus.
    pub send: f64,
    /// Checkpoints and metric rows.
    pub disk: f64,
    /// From the first tick to the last.
    pub total: f64,
}

/// Adds the time that `work` took to `account`.
pub fn timed<R>(account: &mut f64, work: impl FnOnce() -> R) -> R {
    let start = Instant::now();
    let result = work();
    *account += start.elapsed().as_secs_f64();
    result
}
