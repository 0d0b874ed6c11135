//! How particle episodes start (mpe §3), over many resets with fixed seeds.
//!
//! Places are compared with the uniform distribution by Kolmogorov and Smirnov's statistic and in cells of a
//! grid by chi-square, goals by chi-square; bounds are the quantiles for p = 1e-4. With fixed seeds the outcome
//! never changes.

use envs::mpe::{Game, Particles, Rules, State};
use envs::World;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const RESETS: usize = 10_000;
/// sqrt(ln(2 / 1e-4) / 2), for many values.
const KOLMOGOROV: f64 = 2.225;

fn starts(game: Game) -> Vec<State> {
    let mut world = Particles::new(game, Rules::Current);
    let mut rng = ChaCha8Rng::seed_from_u64(20_261_123);
    let reset = |_| {
        world.reset(&mut rng);
        world.state()
    };
    (0..RESETS).map(reset).collect()
}

/// All coordinates of a start, in the order of their draws, with the half width of their range.
fn coordinates(game: Game, state: &State) -> Vec<(f64, f64)> {
    let spread = if game == Game::Tag { 0.9 } else { 1.0 };
    let agents = state.agents.iter().flat_map(|agent| agent.pos).map(|x| (x, 1.0));
    agents.chain(state.landmarks.iter().copied().flatten().map(|x| (x, spread))).collect()
}

/// The share of `[-spread, spread)` below `x`.
fn share((x, spread): (f64, f64)) -> f64 {
    assert!((-spread..spread).contains(&x), "{x} is outside of ±{spread}");
    (x + spread) / (2.0 * spread)
}

/// sqrt(n) times the largest distance between the shares' distribution and the even one.
fn kolmogorov(mut shares: Vec<f64>) -> f64 {
    shares.sort_by(f64::total_cmp);
    let n = shares.len() as f64;
    let distance = |(k, share): (usize, &f64)| (share - k as f64 / n).max((k + 1) as f64 / n - share);
    shares.iter().enumerate().map(distance).fold(0.0, f64::max) * n.sqrt()
}

/// Pearson's statistic of counts that should be equal.
fn chi_square(counts: &[u32]) -> f64 {
    let expected = f64::from(counts.iter().sum::<u32>()) / counts.len() as f64;
    counts.iter().map(|&count| (f64::from(count) - expected).powi(2) / expected).sum()
}

#[test]
fn every_coordinate_is_even_over_its_range() {
    for game in Game::ALL {
        let states: Vec<_> = starts(game).iter().map(|state| coordinates(game, state)).collect();
        for k in 0..states[0].len() {
            let found = kolmogorov(states.iter().map(|state| share(state[k])).collect());
            assert!(found < KOLMOGOROV, "{game:?}, coordinate {k}: {found}");
        }
    }
}

#[test]
fn a_slightly_smaller_range_would_be_noticed() {
    let shares: Vec<f64> =
        starts(Game::Tag).iter().map(|state| share((0.97 * state.agents[0].pos[0], 1.0))).collect();
    let found = kolmogorov(shares);
    assert!(found < KOLMOGOROV, "3 % of the range are within the noise of {RESETS} starts: {found}");
    let shares: Vec<f64> =
        starts(Game::Tag).iter().map(|state| share((0.9 * state.agents[0].pos[0], 1.0))).collect();
    assert!(kolmogorov(shares) > KOLMOGOROV);
}

#[test]
fn neighbouring_coordinates_are_independent() {
    for game in Game::ALL {
        let states: Vec<_> = starts(game).iter().map(|state| coordinates(game, state)).collect();
        for k in 1..states[0].len() {
            let mut counts = [0; 100];
            for state in &states {
                let cell = |at: usize| (10.0 * share(state[at])) as usize;
                counts[10 * cell(k - 1) + cell(k)] += 1;
            }
            // 99 degrees of freedom.
            let found = chi_square(&counts);
            assert!(found < 161.3, "{game:?}, coordinates {} and {k}: {found}", k - 1);
        }
    }
}

#[test]
fn each_landmark_is_the_goal_equally_often_and_tag_has_none() {
    // The quantiles for 2 and 1 degrees of freedom.
    for (game, goals, most) in [(Game::SpeakerListener, 3, 18.42), (Game::Adversary, 2, 15.14)] {
        let mut counts = vec![0; goals];
        for state in starts(game) {
            counts[state.goal_landmark.expect("a goal")] += 1;
        }
        let found = chi_square(&counts);
        assert!(found < most, "{game:?}: {counts:?}, {found}");
    }
    assert!(starts(Game::Tag).iter().all(|state| state.goal_landmark.is_none()));
}

#[test]
fn everybody_rests_and_is_silent_at_the_start_whatever_happened_before() {
    for game in Game::ALL {
        let mut world = Particles::new(game, Rules::Current);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let agents = world.sizes().agents;
        world.reset(&mut rng);
        for _ in 0..3 {
            world.step(&vec![2; agents], &mut rng, &mut vec![0.0; agents]);
        }
        world.reset(&mut rng);
        let state = world.state();
        assert_eq!(state.step, 0);
        for agent in &state.agents {
            assert_eq!(agent.vel, [0.0, 0.0]);
            assert!(agent.comm.iter().all(|&number| number == 0.0));
        }
    }
}
