//! Reward standardisation (algorithms §2.6): with running statistics, or with those of the batch.

/// The statistics to use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standardisation {
    /// None: rewards stay as they are.
    Off,
    /// Statistics over all rewards that ever entered an update call.
    Running,
    /// Statistics of the batch, with 1e-5 added to the standard deviation, as in the 2021 benchmark.
    Batch,
}

/// Running mean and variance of the rewards; part of a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RewardStats {
    mean: f64,
    var: f64,
    count: f64,
}

impl Default for RewardStats {
    fn default() -> Self {
        Self { mean: 0.0, var: 1.0, count: 1e-4 }
    }
}

impl RewardStats {
    /// Standardises `rewards` in place: **all** `B·T` slots of the batch, also the zeros after the end of episodes.
    pub fn standardise(&mut self, rule: Standardisation, rewards: &mut [f32]) {
        let k = rewards.len() as f64;
        // A single reward has no variance, an empty batch no mean.
        if rule == Standardisation::Off || rewards.len() < 2 {
            return;
        }
        let batch_mean = rewards.iter().map(|&r| f64::from(r)).sum::<f64>() / k;
        let batch_var = rewards.iter().map(|&r| (f64::from(r) - batch_mean).powi(2)).sum::<f64>() / (k - 1.0);
        let (mean, root) = if rule == Standardisation::Batch {
            (batch_mean, batch_var.sqrt() + 1e-5)
        } else {
            let delta = batch_mean - self.mean;
            let count = self.count + k;
            let squares = self.var * self.count + batch_var * k + delta * delta * self.count * k / count;
            *self = Self { mean: self.mean + delta * k / count, var: squares / count, count };
            (self.mean, self.var.sqrt())
        };
        for r in rewards {
            *r = ((f64::from(*r) - mean) / root) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_close(found: &[f32], expected: &[f32]) {
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-5, "found {found:?}, expected {expected:?}");
        }
    }

    #[test]
    fn running_statistics_give_the_vector_of_the_spec() {
        let mut stats = RewardStats::default();
        let mut rewards = [0.0, 0.0, 1.0, 0.0];
        stats.standardise(Standardisation::Running, &mut rewards);
        assert!((stats.mean - 0.249_994).abs() < 1e-6 && (stats.var - 0.250_020).abs() < 1e-6, "{stats:?}");
        assert_close(&rewards, &[-0.499_967, -0.499_967, 1.499_952, -0.499_967]);

        let mut rewards = [0.0; 4];
        stats.standardise(Standardisation::Running, &mut rewards);
        assert!((stats.mean - 0.124_998).abs() < 1e-6 && (stats.var - 0.140_636).abs() < 1e-6, "{stats:?}");
        assert_close(&rewards, &[-0.333_316; 4]);
    }

    #[test]
    fn the_first_success_after_sixteen_thousand_zeros_is_huge() {
        let mut stats = RewardStats::default();
        stats.standardise(Standardisation::Running, &mut vec![0.0; 16_000]);
        let mut rewards = vec![0.0; 16_000];
        rewards[5] = 1.0;
        stats.standardise(Standardisation::Running, &mut rewards);
        assert!((stats.var - 3.125e-5).abs() < 1e-8, "{stats:?}");
        assert!((rewards[5] - 178.9).abs() < 0.05, "{}", rewards[5]);
    }

    #[test]
    fn batch_statistics_have_no_memory() {
        let mut stats = RewardStats::default();
        let mut rewards = [0.0, 0.0, 1.0, 0.0];
        stats.standardise(Standardisation::Batch, &mut rewards);
        assert_close(&rewards, &[-0.499_99, -0.499_99, 1.499_97, -0.499_99]);
        assert_eq!(stats, RewardStats::default());
    }
}
