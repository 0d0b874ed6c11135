//! How foraging episodes start (lbf §3, §8), as frequencies over many resets with fixed seeds.

use std::collections::BTreeMap;

use envs::lbf::{Config, Foraging, Rules, State};
use envs::World;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::uniform::{assert_uniform, quantile};

const RESETS: usize = 20_000;

fn config(side: u16, players: u16, foods: u16, coop: bool, rules: Rules) -> Config {
    Config {
        rows: side,
        cols: side,
        players,
        foods,
        coop,
        sight: side,
        penalty: 0.0,
        episode_limit: 50,
        rules,
    }
}

/// The states after many resets of one world.
fn starts(config: Config) -> Vec<State> {
    let mut world = Foraging::new(config).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(20_240_917);
    let reset = |_| {
        world.reset(&mut rng);
        world.state()
    };
    (0..RESETS).map(reset).collect()
}

fn cells(rows: std::ops::Range<u16>, cols: std::ops::Range<u16>) -> impl Iterator<Item = (u16, u16)> {
    rows.flat_map(move |row| cols.clone().map(move |col| (row, col)))
}

#[test]
fn each_player_starts_anywhere_on_the_grid_at_either_level() {
    for (side, players) in [(8, 2), (10, 3)] {
        let states = starts(config(side, players, 2, false, Rules::V3));
        for i in 0..usize::from(players) {
            let player = |state: &State| state.players[i];
            let places = states.iter().map(player).map(|player| (player.row, player.col));
            assert_uniform("places", cells(0..side, 0..side), places);
            assert_uniform("levels", 1..=2, states.iter().map(player).map(|player| player.level));
        }
    }
}

#[test]
fn pairs_of_players_start_on_any_two_cells_with_independent_levels() {
    let states = starts(config(4, 2, 1, false, Rules::V3));
    let pair = |state: &State| {
        let [a, b] = [state.players[0], state.players[1]];
        (a.row * 4 + a.col, b.row * 4 + b.col)
    };
    let different = (0..16).flat_map(|a| (0..16).map(move |b| (a, b))).filter(|(a, b)| a != b);
    assert_uniform("pairs of places", different, states.iter().map(pair));
    let levels = |state: &State| (state.players[0].level, state.players[1].level);
    assert_uniform(
        "pairs of levels",
        [(1, 1), (1, 2), (2, 1), (2, 2)].into_iter(),
        states.iter().map(levels),
    );
}

#[test]
fn players_of_old_versions_never_start_in_the_last_row_or_column() {
    for (rules, end) in [(Rules::V0, 7), (Rules::V1, 7), (Rules::V2, 8), (Rules::V3, 8)] {
        let states = starts(config(8, 2, 2, false, rules));
        let places = states.iter().flat_map(|state| &state.players).map(|player| (player.row, player.col));
        assert_uniform(rules.name(), cells(0..end, 0..end), places);
    }
}

#[test]
fn foods_lie_off_the_border_three_steps_apart_and_on_nobody() {
    for rules in Rules::ALL {
        for state in starts(config(10, 4, 4, false, rules)) {
            assert_eq!(state.foods.len(), 4);
            for (k, food) in state.foods.iter().enumerate() {
                assert!((1..=8).contains(&food.row) && (1..=8).contains(&food.col), "{state:?}");
                for other in &state.foods[..k] {
                    let (rows, cols) = (food.row.abs_diff(other.row), food.col.abs_diff(other.col));
                    assert!(rows + cols >= 3, "{state:?}");
                }
                let on = |player: &envs::lbf::Player| (player.row, player.col) == (food.row, food.col);
                assert!(!state.players.iter().any(on), "{state:?}");
            }
            let levels: u32 = state.foods.iter().map(|food| u32::from(food.level)).sum();
            assert_eq!((state.food_level_sum_at_reset, state.step), (levels, 0));
        }
    }
}

#[test]
fn a_single_food_lies_anywhere_off_the_border() {
    let states = starts(config(8, 2, 1, false, Rules::V3));
    let places = states.iter().map(|state| (state.foods[0].row, state.foods[0].col));
    // The players start before it and evenly, so no cell is preferred.
    assert_uniform("food", cells(1..7, 1..7), places);
}

#[test]
fn two_foods_lie_on_any_two_cells_three_steps_apart() {
    // Interior of 4 x 4. The order of placing is lost in the list, so pairs are unordered; the second food is
    // drawn among those cells that the first leaves, so a pair's weight is the mean of both orders.
    let states = starts(config(6, 1, 2, true, Rules::V3));
    let inner: Vec<(u16, u16)> = cells(1..5, 1..5).collect();
    let apart = |a: (u16, u16), b: (u16, u16)| a.0.abs_diff(b.0) + a.1.abs_diff(b.1) >= 3;
    let room = |a| inner.iter().filter(|&&b| apart(a, b)).count() as f64;
    let mut counts = BTreeMap::new();
    for state in &states {
        let [a, b] = [0, 1].map(|k| (state.foods[k].row, state.foods[k].col));
        *counts.entry((a, b)).or_insert(0.0) += 1.0;
    }
    let open = inner.iter().filter(|&&a| room(a) > 0.0).count() as f64;
    assert_eq!(open, 16.0, "every first food leaves room for a second");
    let (mut statistic, mut pairs) = (0.0, 0);
    for (k, &a) in inner.iter().enumerate() {
        for &b in inner[k + 1..].iter().filter(|&&b| apart(a, b)) {
            let expected = RESETS as f64 / 16.0 * (1.0 / room(a) + 1.0 / room(b));
            let found: f64 = counts.remove(&(a, b)).unwrap_or(0.0);
            statistic += (found - expected).powi(2) / expected;
            pairs += 1;
        }
    }
    assert!(counts.is_empty(), "pairs that must not occur: {counts:?}");
    // The player takes a cell now and then and bends the weights a little, evenly over all cells.
    let most = quantile(pairs - 1);
    assert!(statistic < most, "chi-square {statistic:.1}, expected below {most:.1}");
}

/// M by the words of the spec.
fn bound(rules: Rules, state: &State) -> u16 {
    let mut levels: Vec<u16> = state.players.iter().map(|player| player.level).collect();
    levels.sort_unstable();
    let counted = if rules == Rules::V0 { levels.len() } else { levels.len().min(3) };
    levels[..counted].iter().sum()
}

#[test]
fn food_of_cooperative_tasks_needs_the_three_weakest_players() {
    for rules in Rules::ALL {
        for players in [2, 3, 5] {
            for state in starts(config(10, players, 3, true, rules)) {
                let level = bound(rules, &state);
                assert!(state.foods.iter().all(|food| food.level == level), "{rules}: {state:?}");
            }
        }
    }
}

#[test]
fn food_levels_of_other_tasks_are_even_up_to_the_bound_of_the_version() {
    for (rules, below_bound) in [(Rules::V0, 1), (Rules::V1, 1), (Rules::V2, 1), (Rules::V3, 0)] {
        for players in [1, 2, 4] {
            let states = starts(config(10, players, 3, false, rules));
            let mut by_bound: BTreeMap<u16, Vec<u16>> = BTreeMap::new();
            for state in &states {
                let levels = state.foods.iter().map(|food| food.level);
                by_bound.entry(bound(rules, state)).or_default().extend(levels);
            }
            let bounds: Vec<u16> = by_bound.keys().copied().collect();
            let most = if players == 4 && rules != Rules::V0 { 6 } else { 2 * players };
            let least = if players == 4 && rules != Rules::V0 { 3 } else { players };
            assert_eq!(bounds, (least..=most).collect::<Vec<u16>>(), "{rules}, {players} players");
            for (top, levels) in by_bound {
                let top = (top - below_bound).max(1);
                let what = format!("{rules}, {players} players, up to {top}");
                assert_uniform(&what, 1..=top, levels.into_iter());
            }
        }
    }
}

#[test]
fn a_grid_without_room_for_all_foods_gets_fewer() {
    for state in starts(config(5, 2, 4, true, Rules::V3)).iter().take(1000) {
        assert!((1..=2).contains(&state.foods.len()), "{state:?}");
    }
}

#[test]
fn a_grid_that_is_all_but_full_is_still_filled() {
    let mut world = Foraging::new(config(3, 8, 1, false, Rules::V3)).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut foods = 0;
    for _ in 0..1000 {
        world.reset(&mut rng);
        let state = world.state();
        let mut places: Vec<_> = state.players.iter().map(|player| (player.row, player.col)).collect();
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), 8, "{state:?}");
        foods += state.foods.len();
    }
    // The only cell for food is free in one of nine cases.
    assert!((60..170).contains(&foods), "{foods} foods in 1000 resets");
}
