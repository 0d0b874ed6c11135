//! n-step returns by the rule of the reference, and by three other rules (algorithms §4.3).
//!
//! ```text
//! K    = min(N, T − t)
//! G[t] = Σ_{k<K} γ^k m[t+k] r[t+k]
//!        + γ^N     m[t+N] V̄(o_{t+N})     if t + N ≤ T − 1
//!        + γ^{T−t}        V̄(o_T)         if t + N ≥ T        (no mask, no termination test)
//! ```
//!
//! `T` is the length of the longest episode of the batch. In a shorter episode the last line uses the value of the
//! all-zero padding observation: a leak of the reference, which `Epymarl` has and `Correct` does not.

/// What a window adds that reaches the end of the batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndOfBatch {
    /// The rule above.
    Epymarl,
    /// The rule above without its last line.
    NoBootstrap,
    /// The window stops at slot `T − 1` and takes its value in place of its reward.
    Benchmark2021,
    /// Every episode by itself: a bootstrap at a step limit, none at a termination.
    Correct,
}

/// One episode inside a batch of length `T`.
#[derive(Clone, Copy, Debug)]
pub struct Episode<'a> {
    /// `T` rewards; zero after the end.
    pub rewards: &'a [f32],
    /// `T + 1` values of the target critic, padding observations included.
    pub values: &'a [f32],
    /// Steps taken, `L ≤ T`; the mask is 1 exactly for `t < L`.
    pub length: usize,
    /// The step limit ended it. Only `Correct` uses this.
    pub time_limit: bool,
}

/// Writes `G[0..length]` of one episode. Slots after its end are not part of any loss and are not written.
pub fn n_step_returns(episode: &Episode, n: usize, gamma: f32, rule: EndOfBatch, out: &mut [f32]) {
    let length = episode.length;
    let batch_length = episode.rewards.len();
    debug_assert_eq!(episode.values.len(), batch_length + 1);
    let masked = |t: usize, x: f32| if t < length { x } else { 0.0 };
    for (t, out) in out.iter_mut().enumerate().take(length) {
        let last = match rule {
            EndOfBatch::Correct => length,
            EndOfBatch::Benchmark2021 if t + n >= batch_length => batch_length - 1,
            _ => batch_length,
        };
        let end = (t + n).min(last);
        let mut discount = 1.0;
        let mut g = 0.0;
        for k in t..end {
            g += discount * masked(k, episode.rewards[k]);
            discount *= gamma;
        }
        let bootstrap = match rule {
            EndOfBatch::Epymarl if end == batch_length => episode.values[end],
            EndOfBatch::NoBootstrap if end == batch_length => 0.0,
            EndOfBatch::Correct if end == length && !episode.time_limit => 0.0,
            EndOfBatch::Correct => episode.values[end],
            _ => masked(end, episode.values[end]),
        };
        *out = g + discount * bootstrap;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test vector of algorithms §4.3: γ = 0.9, N = 2, T = 4.
    fn returns(rule: EndOfBatch, rewards: [f32; 4], values: [f32; 5], length: usize) -> Vec<f32> {
        let episode = Episode { rewards: &rewards, values: &values, length, time_limit: true };
        let mut out = vec![f32::NAN; 4];
        n_step_returns(&episode, 2, 0.9, rule, &mut out);
        out.truncate(length);
        out
    }

    const LONG: ([f32; 4], [f32; 5]) = ([1., 0., 2., 3.], [10., 20., 30., 40., 50.]);
    const SHORT: ([f32; 4], [f32; 5]) = ([4., 5., 0., 0.], [60., 70., 80., 90., 100.]);

    fn assert_close(found: &[f32], expected: &[f32]) {
        assert_eq!(found.len(), expected.len());
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-5, "found {found:?}, expected {expected:?}");
        }
    }

    #[test]
    fn epymarl_gives_the_vectors_of_the_spec_with_the_leak_into_short_episodes() {
        assert_close(&returns(EndOfBatch::Epymarl, LONG.0, LONG.1, 4), &[25.3, 34.2, 45.2, 48.0]);
        assert_close(&returns(EndOfBatch::Epymarl, SHORT.0, SHORT.1, 2), &[8.5, 5.0]);
        let three = returns(EndOfBatch::Epymarl, [4., 5., 6., 0.], SHORT.1, 3);
        assert_close(&three, &[73.3, 10.4, 87.0]);
    }

    #[test]
    fn no_bootstrap_drops_the_value_at_the_end_of_the_batch() {
        assert_close(&returns(EndOfBatch::NoBootstrap, LONG.0, LONG.1, 4), &[25.3, 34.2, 4.7, 3.0]);
        assert_close(&returns(EndOfBatch::NoBootstrap, SHORT.0, SHORT.1, 2), &[8.5, 5.0]);
    }

    #[test]
    fn benchmark2021_takes_the_last_value_in_place_of_the_last_reward() {
        assert_close(&returns(EndOfBatch::Benchmark2021, LONG.0, LONG.1, 4), &[25.3, 34.2, 38.0, 40.0]);
        assert_close(&returns(EndOfBatch::Benchmark2021, SHORT.0, SHORT.1, 2), &[8.5, 5.0]);
    }

    #[test]
    fn correct_bootstraps_at_each_episodes_own_step_limit_only() {
        let mut episode = Episode { rewards: &SHORT.0, values: &SHORT.1, length: 2, time_limit: true };
        let mut out = [0.0; 2];
        n_step_returns(&episode, 2, 0.9, EndOfBatch::Correct, &mut out);
        assert_close(&out, &[4.0 + 0.9 * 5.0 + 0.81 * 80.0, 5.0 + 0.9 * 80.0]);
        episode.time_limit = false;
        n_step_returns(&episode, 2, 0.9, EndOfBatch::Correct, &mut out);
        assert_close(&out, &[8.5, 5.0]);
    }

    #[test]
    fn padded_slots_of_a_short_episode_change_nothing() {
        // L = 2 ≤ T − N = 2 (algorithms §12, check 5).
        let expected = returns(EndOfBatch::Epymarl, SHORT.0, SHORT.1, 2);
        let changed = returns(EndOfBatch::Epymarl, [4., 5., 77., -7.], [60., 70., 1e6, -1e6, 5e5], 2);
        assert_eq!(expected, changed);
    }

    #[test]
    fn one_step_returns_are_temporal_difference_targets() {
        let episode = Episode { rewards: &LONG.0, values: &LONG.1, length: 4, time_limit: false };
        let mut out = [0.0; 4];
        n_step_returns(&episode, 1, 0.9, EndOfBatch::Epymarl, &mut out);
        assert_close(&out, &[19.0, 27.0, 38.0, 48.0]);
    }
    /// Two foraging episodes that end with the last food, worth 1, after 6 and 4 steps. The target critic's value is
    /// 0.9 everywhere, padding included.
    fn ended_by_the_last_food(rule: EndOfBatch, length: usize) -> Vec<f32> {
        let mut rewards = [0.0; 6];
        rewards[length - 1] = 1.0;
        let episode = Episode { rewards: &rewards, values: &[0.9; 7], length, time_limit: false };
        let mut out = vec![f32::NAN; length];
        n_step_returns(&episode, 5, 0.99, rule, &mut out);
        out
    }

    fn assert_to_three_digits(found: &[f32], expected: &[f32]) {
        assert_eq!(found.len(), expected.len());
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-3, "found {found:?}, expected {expected:?}");
        }
    }

    #[test]
    fn epymarl_expects_more_than_an_episode_can_bring() {
        // 0.99^5 0.9; then 0.99^k 1 + 0.99^(k+1) 0.9 with k rewardless steps before the last.
        let long = ended_by_the_last_food(EndOfBatch::Epymarl, 6);
        assert_to_three_digits(&long, &[0.856, 1.817, 1.835, 1.853, 1.872, 1.891]);
        // Its first window stops before the padding, where the mask is 0.
        let short = ended_by_the_last_food(EndOfBatch::Epymarl, 4);
        assert_to_three_digits(&short, &[0.970, 1.836, 1.854, 1.873]);
    }

    #[test]
    fn correct_expects_no_more_than_the_last_food() {
        let long = ended_by_the_last_food(EndOfBatch::Correct, 6);
        assert_to_three_digits(&long, &[0.856, 0.961, 0.970, 0.980, 0.990, 1.0]);
        let short = ended_by_the_last_food(EndOfBatch::Correct, 4);
        assert_to_three_digits(&short, &[0.970, 0.980, 0.990, 1.0]);
    }
}
