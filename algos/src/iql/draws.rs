//! Random choices of Q-learning: exploring actions, and the episodes of a minibatch.

use rand::Rng;

/// ε after `t_env` environment steps (algorithms §5.3): linear from `start` to `finish`, which it reaches after
/// `anneal` steps; with `anneal` 0 at once.
pub fn epsilon(t_env: u64, start: f64, finish: f64, anneal: u64) -> f64 {
    if t_env >= anneal {
        return finish;
    }
    finish.max(start - (start - finish) * t_env as f64 / anneal as f64)
}

/// `count` different numbers below `from`; every ordered choice is equally likely.
///
/// # Panics
/// If there are fewer than `count` numbers.
pub fn sample_distinct(count: usize, from: usize, rng: &mut impl Rng) -> Vec<usize> {
    assert!(count <= from, "{count} different numbers cannot be drawn from {from}");
    // The first steps of a Fisher–Yates shuffle. The list is cheap: a buffer holds a few thousand episodes.
    let mut all: Vec<usize> = (0..from).collect();
    for i in 0..count {
        all.swap(i, rng.random_range(i..from));
    }
    all.truncate(count);
    all
}

/// The available action with the largest value, the first of several; action 0 if none is available.
pub(super) fn greedy(q: &[f32], avail: &[u8]) -> usize {
    let mut best = None;
    for (action, (&value, &allowed)) in q.iter().zip(avail).enumerate() {
        if allowed != 0 && best.is_none_or(|(_, largest)| value > largest) {
            best = Some((action, value));
        }
    }
    best.map_or(0, |(action, _)| action)
}

/// With probability `epsilon` a uniformly random available action, otherwise the greedy one.
///
/// Always draws two numbers of 32 bits, the coin and the action, so that later draws do not depend on values.
pub(super) fn epsilon_greedy(q: &[f32], avail: &[u8], epsilon: f64, rng: &mut impl Rng) -> usize {
    let (coin, choice) = (rng.random::<f32>(), rng.random::<u32>());
    if f64::from(coin) >= epsilon {
        return greedy(q, avail);
    }
    let allowed = || avail.iter().enumerate().filter(|(_, &allowed)| allowed != 0).map(|(action, _)| action);
    // The high half of the product is uniform up to a few parts in 2³².
    let nth = (u64::from(choice) * allowed().count() as u64) >> 32;
    allowed().nth(nth as usize).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use rand::{RngCore, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn epsilon_falls_on_a_straight_line_and_then_stays() {
        let epsilon = |t_env| epsilon(t_env, 1.0, 0.05, 50_000);
        assert_eq!(epsilon(0), 1.0);
        assert_eq!(epsilon(25_000), 0.525);
        assert!((epsilon(49_999) - 0.050_019).abs() < 1e-12);
        assert_eq!(epsilon(50_000), 0.05);
        assert_eq!(epsilon(u64::MAX), 0.05);
    }

    #[test]
    fn epsilon_without_an_annealing_time_is_the_final_one_from_the_start() {
        assert_eq!(epsilon(0, 1.0, 0.05, 0), 0.05);
        assert_eq!(epsilon(7, 0.0, 0.0, 0), 0.0);
    }

    #[test]
    fn a_sample_has_no_number_twice_and_can_be_everything() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for count in [0, 1, 5, 31, 32] {
            let mut sample = sample_distinct(count, 32, &mut rng);
            sample.sort_unstable();
            sample.dedup();
            assert_eq!(sample.len(), count);
            assert!(sample.iter().all(|&i| i < 32));
        }
        assert_ne!(sample_distinct(32, 32, &mut rng), (0..32).collect::<Vec<_>>(), "the order is random");
        assert_eq!(sample_distinct(0, 0, &mut rng), [0usize; 0]);
    }

    #[test]
    fn every_ordered_choice_is_equally_likely() {
        // 6·5 = 30 ordered pairs, 1,000 expected of each. χ² with 29 degrees of freedom exceeds 58.3 once
        // in a thousand times; the seed is fixed.
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut counts = [[0u32; 6]; 6];
        for _ in 0..30_000 {
            let pair = sample_distinct(2, 6, &mut rng);
            counts[pair[0]][pair[1]] += 1;
        }
        let mut chi_square = 0.0;
        for (a, b) in (0..6).flat_map(|a| (0..6).map(move |b| (a, b))).filter(|(a, b)| a != b) {
            chi_square += (f64::from(counts[a][b]) - 1_000.0).powi(2) / 1_000.0;
        }
        assert!(chi_square < 58.3, "{chi_square}");
    }

    #[test]
    fn the_greedy_action_is_the_first_of_the_best_allowed_ones() {
        assert_eq!(greedy(&[1.0, 3.0, 2.0, 3.0], &[1, 1, 1, 1]), 1);
        assert_eq!(greedy(&[1.0, 3.0, 2.0, 3.0], &[1, 0, 1, 1]), 3);
        assert_eq!(greedy(&[1.0, 3.0, 2.0, 3.0], &[1, 0, 1, 0]), 2);
        assert_eq!(greedy(&[1.0, f32::NAN, f32::NAN], &[0, 0, 1]), 2, "also when the learner has diverged");
        assert_eq!(greedy(&[1.0, 3.0], &[0, 0]), 0);
    }

    #[test]
    fn exploring_takes_every_allowed_action_equally_often_and_no_other() {
        // 4 allowed actions, 2,500 expected of each; χ² with 3 degrees of freedom exceeds 16.3 once in a
        // thousand times.
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (q, avail) = ([9.0, 0.0, 0.0, 0.0, 0.0, 9.0], [0, 1, 1, 1, 1, 0]);
        let mut counts = [0u32; 6];
        for _ in 0..10_000 {
            counts[epsilon_greedy(&q, &avail, 1.0, &mut rng)] += 1;
        }
        assert_eq!((counts[0], counts[5]), (0, 0));
        let chi_square: f64 = counts[1..5].iter().map(|&n| (f64::from(n) - 2_500.0).powi(2) / 2_500.0).sum();
        assert!(chi_square < 16.3, "{chi_square} {counts:?}");
    }

    #[test]
    fn the_coin_falls_as_often_as_epsilon_says() {
        // 10,000 tosses at ε = 0.3; exploring hits the greedy action in half of its cases. Expected 8,500
        // with a standard deviation of 35.7.
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let greedy = (0..10_000).filter(|_| epsilon_greedy(&[0.0, 1.0], &[1, 1], 0.3, &mut rng) == 1).count();
        assert!(greedy.abs_diff(8_500) < 3 * 36, "{greedy}");
    }

    #[test]
    fn as_many_numbers_are_drawn_whatever_happens() {
        let mut expected = ChaCha8Rng::seed_from_u64(5);
        expected.next_u32();
        expected.next_u32();
        let next = expected.next_u32();
        for (epsilon, avail) in [(0.0, [1, 1]), (1.0, [1, 1]), (1.0, [0, 1]), (1.0, [0, 0])] {
            let mut rng = ChaCha8Rng::seed_from_u64(5);
            epsilon_greedy(&[0.0, 1.0], &avail, epsilon, &mut rng);
            assert_eq!(rng.next_u32(), next);
        }
    }
}
