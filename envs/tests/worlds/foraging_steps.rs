//! The rules of a foraging step, worked out by hand.
//!
//! Starts are drawn as maps: `.` free, digits foods by level, letters players in index order (`a` is player 0),
//! small ones of level 1, capital ones of level 2.

use envs::lbf::{
    Config, Food, Foraging, Player, Rules, State, StateError, EAST, LOAD, NONE, NORTH, SOUTH, WEST,
};
use envs::{End, World};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

struct Game {
    world: Foraging,
    rewards: Vec<f64>,
}

fn start(map: &[&str]) -> Game {
    start_with(map, 99, 0.0)
}

fn start_with(map: &[&str], sight: u16, penalty: f64) -> Game {
    let (mut players, mut foods) = (vec![], vec![]);
    for (row, line) in (0..).zip(map) {
        for (col, cell) in (0..).zip(line.chars()) {
            match cell {
                '.' => {}
                '1'..='9' => foods.push(Food { row, col, level: cell as u16 - '0' as u16 }),
                'a'..='z' => players.push((cell, Player { row, col, level: 1 })),
                'A'..='Z' => players.push((cell.to_ascii_lowercase(), Player { row, col, level: 2 })),
                _ => panic!("`{cell}` means nothing on a map"),
            }
        }
    }
    players.sort_by_key(|(letter, _)| *letter);
    let players: Vec<Player> = players.into_iter().map(|(_, player)| player).collect();
    let config = Config {
        rows: map.len() as u16,
        cols: map[0].len() as u16,
        players: players.len() as u16,
        foods: foods.len().max(1) as u16,
        coop: false,
        sight,
        penalty,
        episode_limit: 50,
        rules: Rules::V3,
    };
    let food_level_sum_at_reset = foods.iter().map(|food| u32::from(food.level)).sum();
    let mut world = Foraging::new(config).unwrap();
    let rewards = vec![f64::NAN; players.len()];
    world.set_state(&State { players, foods, food_level_sum_at_reset, step: 0 }).unwrap();
    Game { world, rewards }
}

impl Game {
    fn play(&mut self, actions: &[u16]) -> End {
        self.world.step(actions, &mut ChaCha8Rng::seed_from_u64(0), &mut self.rewards)
    }

    /// Row and column per player.
    fn places(&self) -> Vec<(u16, u16)> {
        self.world.state().players.iter().map(|player| (player.row, player.col)).collect()
    }

    fn sees(&self, agent: usize) -> Vec<f32> {
        let mut seen = vec![f32::NAN; self.world.sizes().obs_size[agent]];
        self.world.observe(agent, &mut seen);
        seen
    }

    fn set(&mut self, change: impl Fn(&mut State)) {
        let mut state = self.world.state();
        change(&mut state);
        self.world.set_state(&state).unwrap();
    }
}

#[test]
fn each_move_leads_to_its_side() {
    for (action, place) in [(NONE, (1, 1)), (NORTH, (0, 1)), (SOUTH, (2, 1)), (WEST, (1, 0)), (EAST, (1, 2))]
    {
        let mut game = start(&["...", ".a.", "..."]);
        game.play(&[action]);
        assert_eq!(game.places(), [place], "action {action}");
        assert_eq!(game.world.effective_actions(), [action]);
    }
}

#[test]
fn two_players_can_swap_places() {
    let mut game = start(&["ab.", "...", "..1"]);
    game.play(&[EAST, WEST]);
    assert_eq!(game.places(), [(0, 1), (0, 0)]);
}

#[test]
fn a_ring_of_players_turns() {
    let mut game = start(&["ab.", "dc.", "...", "..1"]);
    game.play(&[EAST, SOUTH, WEST, NORTH]);
    assert_eq!(game.places(), [(0, 1), (1, 1), (1, 0), (0, 0)]);
}

#[test]
fn a_player_can_follow_into_a_cell_that_is_being_left() {
    let mut game = start(&["abc.", "....", "...1"]);
    game.play(&[EAST, EAST, EAST]);
    assert_eq!(game.places(), [(0, 1), (0, 2), (0, 3)]);
}

#[test]
fn a_cell_that_two_players_want_goes_to_neither() {
    let mut game = start(&["a.b", "...", ".1."]);
    game.play(&[EAST, WEST]);
    assert_eq!(game.places(), [(0, 0), (0, 2)]);
    assert_eq!(game.world.effective_actions(), [EAST, WEST]);
}

#[test]
fn nobody_enters_the_cell_of_a_player_who_stays() {
    for stay in [NONE, LOAD] {
        let mut game = start(&["ab.", ".1.", "..."]);
        game.play(&[EAST, stay]);
        assert_eq!(game.places(), [(0, 0), (0, 1)], "action {stay}");
    }
}

#[test]
fn a_player_who_fails_to_leave_is_joined_on_its_cell() {
    // b and c want the same cell, a wants b's.
    let mut game = start(&["ab.c", "....", "1..."]);
    game.play(&[EAST, EAST, WEST]);
    assert_eq!(game.places(), [(0, 1), (0, 1), (0, 3)]);
    // Both stay where both stay.
    game.play(&[NONE, NONE, NONE]);
    assert_eq!(game.places(), [(0, 1), (0, 1), (0, 3)]);
    // They hinder each other on the way to one cell, not on the way to two.
    game.play(&[SOUTH, SOUTH, NONE]);
    assert_eq!(game.places(), [(0, 1), (0, 1), (0, 3)]);
    game.play(&[SOUTH, WEST, NONE]);
    assert_eq!(game.places(), [(1, 1), (0, 0), (0, 3)]);
}

#[test]
fn one_of_two_players_on_a_cell_can_leave_and_nobody_comes_in() {
    let mut game = start(&["ab.", "..c", ".1."]);
    game.set(|state| (state.players[1].row, state.players[1].col) = (0, 0));
    game.play(&[NONE, EAST, NONE]);
    assert_eq!(game.places(), [(0, 0), (0, 1), (1, 2)]);
    game.set(|state| (state.players[1].row, state.players[1].col) = (0, 0));
    game.set(|state| (state.players[2].row, state.players[2].col) = (1, 0));
    game.play(&[NONE, NONE, NORTH]);
    assert_eq!(game.places(), [(0, 0), (0, 0), (1, 0)]);
}

#[test]
fn actions_without_sense_become_none() {
    // a is in a corner, b beside the food, c nowhere near it.
    let mut game = start(&["a...", "..1b", "....", "c..."]);
    for (actions, effective) in [
        ([NORTH, WEST, LOAD], [NONE, NONE, NONE]), // wall, food, nothing to load
        ([WEST, EAST, SOUTH], [NONE, NONE, NONE]), // walls
        ([LOAD, NONE, WEST], [NONE, NONE, NONE]),
        ([6, 99, u16::MAX], [NONE, NONE, NONE]),
    ] {
        let before = game.places();
        assert_eq!(game.play(&actions), End::Running);
        assert_eq!(game.world.effective_actions(), effective, "{actions:?}");
        assert_eq!(game.places(), before, "{actions:?}");
        assert_eq!(game.rewards, [0.0; 3]);
    }
}

#[test]
fn a_player_loads_food_on_each_of_its_four_sides_and_none_diagonally() {
    for (map, eaten) in [
        (["...", ".1.", ".a."], true),
        (["...", "a1.", "..."], true),
        (["...", ".1a", "..."], true),
        ([".a.", ".1.", "..."], true),
        (["a..", ".1.", "..."], false),
        (["...", ".1.", "..a"], false),
    ] {
        let mut game = start(&map);
        let end = game.play(&[LOAD]);
        assert_eq!(end == End::Terminated, eaten, "{map:?}");
        assert_eq!(game.rewards, [f64::from(u8::from(eaten))], "{map:?}");
    }
}

#[test]
fn food_needs_the_levels_of_all_who_load_it() {
    let mut game = start(&[".A.", "c4B", "..."]);
    // c stands beside the food but does not load.
    assert_eq!(game.play(&[LOAD, LOAD, NONE]), End::Terminated);
    assert_eq!(game.rewards, [0.5, 0.5, 0.0]);

    let mut game = start(&[".A.", "c5B", "..."]);
    assert_eq!(game.play(&[LOAD, LOAD, NONE]), End::Running);
    assert_eq!(game.rewards, [0.0, 0.0, 0.0]);
    assert_eq!(game.play(&[LOAD, LOAD, LOAD]), End::Terminated);
    assert_eq!(game.rewards, [0.4, 0.4, 0.2]);
}

#[test]
fn the_reward_is_one_quotient_of_whole_numbers_over_the_levels_at_reset() {
    // S = 3 + 4. First a (1) and B (2) take 3: (1*3)/(3*7) and (2*3)/(3*7).
    let mut game = start(&["....c.", "a3B.4D", "......"]);
    assert_eq!(game.play(&[LOAD, LOAD, NONE, NONE]), End::Running);
    assert_eq!(game.rewards, [3.0 / 21.0, 6.0 / 21.0, 0.0, 0.0]);
    // Then B walks over and takes 4 with c and D; S is still 7, L is 5.
    assert_eq!(game.play(&[NONE, EAST, LOAD, LOAD]), End::Running);
    assert_eq!(game.rewards, [0.0; 4]);
    assert_eq!(game.play(&[NONE, LOAD, LOAD, LOAD]), End::Terminated);
    assert_eq!(game.rewards, [0.0, 8.0 / 35.0, 4.0 / 35.0, 8.0 / 35.0]);
}

#[test]
fn players_move_before_others_load() {
    // b leaves the food's side in the step in which A loads, c arrives only now: A is alone.
    let mut game = start(&["A2b.", "....", ".c.."]);
    game.play(&[LOAD, EAST, NORTH]);
    assert_eq!(game.rewards, [1.0, 0.0, 0.0]);
}

#[test]
fn two_foods_can_be_loaded_in_one_step() {
    let mut game = start(&["......", "a1..1b", "......"]);
    assert_eq!(game.play(&[LOAD, LOAD]), End::Terminated);
    assert_eq!(game.rewards, [0.5, 0.5]);
}

#[test]
fn players_on_one_cell_both_count_as_loaders() {
    let mut game = start(&["...", "a3B", "..."]);
    game.set(|state| state.players[1].col = 0);
    assert_eq!(game.play(&[LOAD, LOAD]), End::Terminated);
    assert_eq!(game.rewards, [1.0 / 3.0, 2.0 / 3.0]);
}

#[test]
fn only_those_who_load_in_vain_pay_the_penalty() {
    let mut game = start_with(&["......", "a4B.1c", "...d.."], 99, 0.1);
    assert_eq!(game.play(&[LOAD, LOAD, LOAD, NONE]), End::Running);
    assert_eq!(game.rewards, [-0.1, -0.1, 0.2, 0.0]);
    // An eaten food cannot be loaded, not even without success.
    game.play(&[NONE, LOAD, LOAD, NORTH]);
    assert_eq!(game.rewards, [0.0, -0.1, 0.0, 0.0]);
}

#[test]
fn without_penalty_a_failed_load_earns_plain_zero() {
    let mut game = start(&["...", "a2.", "..."]);
    game.play(&[LOAD]);
    assert_eq!(game.rewards[0].to_bits(), 0.0_f64.to_bits());
}

#[test]
fn a_player_between_two_foods_of_an_arranged_state_loads_the_northern_one() {
    let mut game = start(&["...", ".2.", ".A.", ".1.", "..."]);
    game.play(&[LOAD]);
    assert_eq!(game.rewards, [2.0 / 3.0]);
    assert_eq!(game.world.state().foods, [Food { row: 3, col: 1, level: 1 }]);
}

#[test]
fn the_step_limit_ends_an_episode_unless_the_last_food_went_in_the_same_step() {
    let mut game = start(&["...", "a1.", "..."]);
    for _ in 0..49 {
        assert_eq!(game.play(&[NONE]), End::Running);
    }
    let mut other = Game { world: game.world.clone(), rewards: vec![0.0] };
    assert_eq!(game.play(&[NONE]), End::TimeLimit);
    assert_eq!(other.play(&[LOAD]), End::Terminated);
    assert_eq!(other.world.state().step, 50);
}

#[test]
fn foods_are_listed_row_by_row_and_move_up_when_one_is_eaten() {
    let mut game = start(&["......", ".3..1a", "......", "......", "...2..", "B....."]);
    assert_eq!(game.sees(0), [1., 1., 3., 1., 4., 1., 4., 3., 2., 1., 5., 1., 5., 0., 2.]);
    assert_eq!(game.sees(1), [1., 1., 3., 1., 4., 1., 4., 3., 2., 5., 0., 2., 1., 5., 1.]);
    game.play(&[LOAD, NONE]);
    assert_eq!(game.sees(0), [1., 1., 3., 4., 3., 2., -1., -1., 0., 1., 5., 1., 5., 0., 2.]);
}

#[test]
fn others_are_listed_in_index_order_after_the_observer() {
    let game = start(&["c..", ".1.", "bA."]);
    // The letters give a = (2, 1), b = (2, 0), c = (0, 0).
    assert_eq!(game.sees(1), [1., 1., 1., 2., 0., 1., 2., 1., 2., 0., 0., 1.]);
}

#[test]
fn with_sight_two_coordinates_count_from_the_corner_of_the_window() {
    let map =
        ["........", ".1......", "........", "...2....", "...a....", "......C.", ".....3..", "b......."];
    let game = start_with(&map, 2, 0.0);
    // a at (4, 3): its window begins at (2, 1). Food 1 is three rows up, outside; food 3 is in the window's last
    // corner; C is three columns away.
    assert_eq!(game.sees(0), [1., 2., 2., 4., 4., 3., -1., -1., 0., 2., 2., 1., -1., -1., 0., -1., -1., 0.]);
    // b at (7, 0): the window begins at (5, 0), cut off by the grid's edges.
    assert_eq!(
        game.sees(1),
        [-1., -1., 0., -1., -1., 0., -1., -1., 0., 2., 0., 1., -1., -1., 0., -1., -1., 0.]
    );
    // C at (5, 6): the window begins at (3, 4).
    assert_eq!(
        game.sees(2),
        [3., 1., 3., -1., -1., 0., -1., -1., 0., 2., 2., 2., -1., -1., 0., -1., -1., 0.]
    );
}

#[test]
fn at_the_upper_and_left_edge_players_are_seen_further_than_foods() {
    // The window of a starts at the corner of the grid. For players it keeps its full five cells, as in the
    // reference; foods must be within two cells of a.
    let game = start_with(&["a..1b", ".....", "....."], 2, 0.0);
    assert_eq!(game.sees(0), [-1., -1., 0., 0., 0., 1., 0., 4., 1.]);
    let game = start_with(&["a.1..b", "......", "......"], 2, 0.0);
    assert_eq!(game.sees(0), [0., 2., 1., 0., 0., 1., -1., -1., 0.]);
}

#[test]
fn unseen_players_leave_their_places_at_the_end() {
    let game = start_with(&["a....b", "......", "..c...", "....1."], 2, 0.0);
    assert_eq!(game.sees(0), [-1., -1., 0., 0., 0., 1., 2., 2., 1., -1., -1., 0.]);
}

#[test]
fn a_state_that_cannot_be_is_refused_and_leaves_the_world_alone() {
    let mut game = start(&["ab.", ".1.", "..."]);
    let good = game.world.state();
    let refusal = |world: &mut Foraging, change: &dyn Fn(&mut State)| {
        let mut state = good.clone();
        change(&mut state);
        let error: StateError = world.set_state(&state).unwrap_err();
        assert_eq!(world.state(), good);
        error.to_string()
    };
    for (change, expected) in [
        (&(|s: &mut State| s.players.truncate(1)) as &dyn Fn(&mut State), "expected 2 players, found 1"),
        (&|s| s.foods.push(Food { row: 2, col: 2, level: 1 }), "expected at most 1 foods, found 2"),
        (&|s| s.players[1].row = 3, "player 1 is at row 3, column 1, outside of the 3x3 grid"),
        (&|s| s.foods[0].col = 65535, "food 0 is at row 1, column 65535, outside of the 3x3 grid"),
        (
            &|s| s.players[0] = Player { row: 1, col: 1, level: 1 },
            "player 0 is on the cell of a food (row 1, column 1)",
        ),
        (&|s| s.players[0].level = 0, "player 0 has level 0; levels are 1 to 65534"),
        (&|s| s.foods[0].level = 65535, "food 0 has level 65535; levels are 1 to 65534"),
        (
            &|s| s.food_level_sum_at_reset = 0,
            "food_level_sum_at_reset is 0, but there are foods; rewards are divided by it",
        ),
    ] {
        assert_eq!(refusal(&mut game.world, change), expected);
    }
}
