//! The rules of a warehouse step, worked out by hand, on the floor of `rware-tiny` (10 x 11 cells).
//!
//! Slots are x 1, 2, 7, 8 in rows 1 to 8; shelf 1 is at (1, 1), 2 at (2, 1), 3 at (7, 1), 5 at (1, 2).

use envs::rware::{
    Config, Direction, Robot, Rules, State, Warehouse, FORWARD, NOOP, TOGGLE_LOAD, TURN_LEFT, TURN_RIGHT,
};
use envs::{End, World};
use rand::RngCore;
use Direction::{Down, Left, Right, Up};

/// Hands out the listed words, and no more of them.
struct Words(Vec<u32>);

impl RngCore for Words {
    fn next_u32(&mut self) -> u32 {
        self.0.remove(0)
    }
    fn next_u64(&mut self) -> u64 {
        unreachable!("only 32-bit words are drawn")
    }
    fn fill_bytes(&mut self, _: &mut [u8]) {
        unreachable!("only 32-bit words are drawn")
    }
}

/// A word that draws number `choice` of `count`.
fn word(choice: u64, count: u64) -> u32 {
    (((2 * choice + 1) << 32) / (2 * count)) as u32
}

struct Game {
    world: Warehouse,
    rewards: Vec<f64>,
}

/// Unloaded robots; shelves 31 and 32 are requested.
fn start(robots: &[(u16, u16, Direction)]) -> Game {
    let config = Config {
        shelf_rows: 1,
        shelf_columns: 3,
        column_height: 8,
        robots: robots.len() as u16,
        requests: 2,
        sensor_range: 1,
        episode_limit: 500,
        rules: Rules::V2,
    };
    let mut game = Game { world: Warehouse::new(config).unwrap(), rewards: vec![f64::NAN; robots.len()] };
    game.set(|state| {
        for (robot, &(x, y, direction)) in state.robots.iter_mut().zip(robots) {
            *robot = Robot { x, y, direction, carrying: None };
        }
        state.request_queue = vec![31, 32];
    });
    game
}

impl Game {
    fn play(&mut self, actions: &[u16]) -> End {
        self.play_drawing(actions, vec![])
    }

    fn play_drawing(&mut self, actions: &[u16], words: Vec<u32>) -> End {
        let mut words = Words(words);
        let end = self.world.step(actions, &mut words, &mut self.rewards);
        assert!(words.0.is_empty(), "not all was drawn");
        end
    }

    fn set(&mut self, change: impl Fn(&mut State)) {
        let mut state = self.world.state();
        change(&mut state);
        self.world.set_state(&state).unwrap();
    }

    /// Puts a shelf on a robot's back, wherever that is.
    fn load(&mut self, robot: usize, id: u16) {
        self.set(|state| {
            state.robots[robot].carrying = Some(id);
            state.shelves[usize::from(id) - 1] = (state.robots[robot].x, state.robots[robot].y);
        });
    }

    fn places(&self) -> Vec<(u16, u16)> {
        self.world.state().robots.iter().map(|robot| (robot.x, robot.y)).collect()
    }

    /// All go forward; who is granted it.
    fn all_forward(&mut self) -> Vec<u16> {
        self.play(&vec![FORWARD; self.rewards.len()]);
        self.world.effective_actions().to_vec()
    }

    fn shelf(&self, id: u16) -> (u16, u16) {
        self.world.state().shelves[usize::from(id) - 1]
    }
}

#[test]
fn forward_leads_ahead_and_against_a_wall_nowhere() {
    for (direction, place) in [(Up, (4, 2)), (Down, (4, 4)), (Left, (3, 3)), (Right, (5, 3))] {
        let mut game = start(&[(4, 3, direction)]);
        game.play(&[FORWARD]);
        assert_eq!(game.places(), [place]);
    }
    for (x, y, direction) in [(4, 0, Up), (4, 10, Down), (0, 3, Left), (9, 3, Right)] {
        let mut game = start(&[(x, y, direction)]);
        game.play(&[FORWARD]);
        assert_eq!(game.places(), [(x, y)]);
        assert_eq!(game.world.effective_actions(), [FORWARD]);
    }
}

#[test]
fn four_turns_either_way_lead_back() {
    let mut game = start(&[(4, 3, Up), (6, 3, Up)]);
    for expected in [(Right, Left), (Down, Down), (Left, Right), (Up, Up)] {
        game.play(&[TURN_RIGHT, TURN_LEFT]);
        let robots = game.world.state().robots;
        assert_eq!((robots[0].direction, robots[1].direction), expected);
    }
    assert_eq!(game.places(), [(4, 3), (6, 3)]);
}

#[test]
fn a_convoy_moves_as_one_and_a_blocked_head_blocks_it() {
    let mut game = start(&[(2, 9, Right), (4, 9, Right), (3, 9, Right)]);
    assert_eq!(game.all_forward(), [FORWARD; 3]);
    assert_eq!(game.places(), [(3, 9), (5, 9), (4, 9)]);
    // A head that turns, or that faces a wall, holds up the rest.
    game.play(&[FORWARD, TURN_LEFT, FORWARD]);
    assert_eq!(game.world.effective_actions(), [NOOP, TURN_LEFT, NOOP]);
    let mut game = start(&[(8, 9, Right), (9, 9, Right)]);
    assert_eq!(game.all_forward(), [NOOP, FORWARD]);
    assert_eq!(game.places(), [(8, 9), (9, 9)]);
}

#[test]
fn two_robots_cannot_swap_and_hold_up_who_follows() {
    let mut game = start(&[(4, 9, Right), (5, 9, Left), (3, 9, Right)]);
    assert_eq!(game.all_forward(), [NOOP; 3]);
    assert_eq!(game.places(), [(4, 9), (5, 9), (3, 9)]);
}

#[test]
fn a_ring_of_four_turns_and_nobody_joins_it() {
    let mut game = start(&[(4, 3, Right), (5, 3, Down), (5, 4, Left), (4, 4, Up), (3, 3, Right)]);
    assert_eq!(game.all_forward(), [FORWARD, FORWARD, FORWARD, FORWARD, NOOP]);
    assert_eq!(game.places(), [(5, 3), (5, 4), (4, 4), (4, 3), (3, 3)]);
}

#[test]
fn of_several_who_want_a_cell_the_longest_train_goes() {
    // 0 alone from above, 1 with 2 behind it from the left, 3 alone from below.
    let mut game = start(&[(5, 8, Down), (4, 9, Right), (3, 9, Right), (5, 10, Up)]);
    assert_eq!(game.all_forward(), [NOOP, FORWARD, FORWARD, NOOP]);
    assert_eq!(game.world.ties(), Vec::<Vec<usize>>::new());
    // The longest path counts, not the nearest branch: behind 1 stand 2, and 3 with 4 behind it.
    let mut game = start(&[(6, 4, Left), (4, 4, Right), (4, 3, Down), (4, 5, Up), (4, 6, Up)]);
    assert_eq!(game.all_forward(), [NOOP, FORWARD, NOOP, FORWARD, FORWARD]);
}

#[test]
fn direct_rivals_with_equal_trains_are_decided_by_number() {
    let mut game = start(&[(3, 9, Right), (5, 9, Left)]);
    assert_eq!(game.all_forward(), [FORWARD, NOOP]);
    assert_eq!(game.world.ties(), [[0, 1]]);
    let mut game = start(&[(5, 9, Left), (3, 9, Right)]);
    assert_eq!(game.all_forward(), [FORWARD, NOOP]);
}

#[test]
fn a_rival_whose_cell_was_mentioned_earlier_goes_first() {
    // Robot 0 wants the cell of 3, so that cell is mentioned before that of 1. Both 0 and 2 make trains of two.
    let mut game = start(&[(3, 10, Up), (4, 8, Down), (4, 7, Down), (3, 9, Right)]);
    assert_eq!(game.all_forward(), [FORWARD, NOOP, NOOP, FORWARD]);
    assert_eq!(game.world.ties(), [[1, 3]]);
}

#[test]
fn among_seven_cells_the_order_of_a_python_set_decides_whatever_the_numbers() {
    // What rware 2.0.0 under CPython 3.11 made of rivals left and right of (x, 9), two others being under way.
    let left_wins = [5, 8];
    for x in 1..=8 {
        let (left, right) = ((x - 1, 9, Right), (x + 1, 9, Left));
        let others = [(3, 0, Down), (6, 0, Down)];
        let expected = if left_wins.contains(&x) { [FORWARD, NOOP] } else { [NOOP, FORWARD] };
        let mut game = start(&[left, right, others[0], others[1]]);
        assert_eq!(game.all_forward(), [expected[0], expected[1], FORWARD, FORWARD], "x {x}");
        assert_eq!(game.world.ties(), [[0, 1]]);
        let mut game = start(&[right, left, others[0], others[1]]);
        assert_eq!(game.all_forward(), [expected[1], expected[0], FORWARD, FORWARD], "x {x}");
    }
}

#[test]
fn a_loaded_robot_is_stopped_by_standing_shelves_and_an_unloaded_one_is_not() {
    // At (3, 1) with shelf 31 on its back, shelf 2 stands ahead at (2, 1).
    let mut game = start(&[(3, 1, Left)]);
    assert_eq!(game.all_forward(), [FORWARD]);
    assert_eq!(game.places(), [(2, 1)]);
    let mut game = start(&[(3, 1, Left)]);
    game.load(0, 31);
    assert_eq!(game.all_forward(), [NOOP]);
    // Also where an unloaded robot under that shelf drives off.
    let mut game = start(&[(3, 1, Left), (2, 1, Left)]);
    game.load(0, 31);
    assert_eq!(game.all_forward(), [NOOP, FORWARD]);
    // Not where the robot ahead drives off with the shelf.
    let mut game = start(&[(3, 1, Left), (2, 1, Up)]);
    game.load(0, 31);
    game.load(1, 2);
    assert_eq!(game.all_forward(), [FORWARD; 2]);
    assert_eq!((game.shelf(31), game.shelf(2)), ((2, 1), (2, 0)));
    // Nor where that one stays after all: then it is a robot in the way, as any other.
    let mut game = start(&[(3, 1, Left), (2, 1, Up)]);
    game.load(0, 31);
    game.load(1, 2);
    game.play(&[FORWARD, TOGGLE_LOAD]);
    assert_eq!(game.world.effective_actions(), [NOOP, TOGGLE_LOAD]);
}

#[test]
fn a_robot_without_load_passes_over_no_other_robot_but_under_any_shelf() {
    let mut game = start(&[(0, 1, Right)]);
    for x in 1..=3 {
        assert_eq!(game.all_forward(), [FORWARD]);
        assert_eq!(game.places(), [(x, 1)]);
    }
    assert_eq!((game.shelf(1), game.shelf(2)), ((1, 1), (2, 1)));
}

#[test]
fn loads_are_lifted_anywhere_and_put_down_on_slots_only() {
    let carrying = |game: &Game| game.world.state().robots[0].carrying;
    let mut game = start(&[(3, 1, Left)]);
    game.play(&[TOGGLE_LOAD]); // nothing here
    assert_eq!(carrying(&game), None);
    game.play(&[FORWARD]);
    game.play(&[TOGGLE_LOAD]);
    assert_eq!((carrying(&game), game.shelf(2)), (Some(2), (2, 1)));
    game.play(&[TURN_RIGHT]);
    game.play(&[FORWARD]);
    game.play(&[TOGGLE_LOAD]); // on a highway
    assert_eq!((carrying(&game), game.shelf(2)), (Some(2), (2, 0)));
    // Another slot than its own is as good.
    game.set(|state| state.shelves[0] = (0, 10));
    game.play(&[TURN_LEFT]);
    game.play(&[FORWARD]);
    game.play(&[TURN_LEFT]);
    game.play(&[FORWARD]);
    game.play(&[TOGGLE_LOAD]);
    assert_eq!((carrying(&game), game.shelf(2), game.places()), (None, (1, 1), vec![(1, 1)]));
}

#[test]
fn who_arrives_at_a_goal_with_a_requested_shelf_is_paid_once_and_keeps_it() {
    let mut game = start(&[(4, 9, Down), (0, 0, Up)]);
    game.load(0, 32);
    // 30 shelves are not requested, 1 to 30 in order.
    game.play_drawing(&[FORWARD, NOOP], vec![word(16, 30)]);
    assert_eq!(game.rewards, [1.0, 0.0]);
    let state = game.world.state();
    assert_eq!((&state.request_queue[..], state.robots[0].carrying), (&[31, 17][..], Some(32)));
    game.play(&[NOOP, NOOP]);
    assert_eq!(game.rewards, [0.0, 0.0]);
    // When it is requested again it counts again, without an action.
    game.set(|state| state.request_queue = vec![32, 17]);
    game.play_drawing(&[NOOP, NOOP], vec![word(29, 30)]);
    assert_eq!(game.rewards, [1.0, 0.0]);
    assert_eq!(game.world.state().request_queue, [31, 17]);
}

#[test]
fn a_shelf_that_nobody_asked_for_earns_nothing() {
    let mut game = start(&[(5, 9, Down)]);
    game.load(0, 3);
    game.play(&[FORWARD]);
    assert_eq!((game.places(), game.rewards.as_slice()), (vec![(5, 10)], &[0.0][..]));
}

#[test]
fn both_goals_can_be_served_in_one_step() {
    let mut game = start(&[(5, 9, Down), (4, 9, Down)]);
    game.load(0, 31);
    game.load(1, 32);
    // The first goal is served first: 32 is replaced by 1, then 31 by the second of 2 to 30 and 32.
    game.play_drawing(&[FORWARD, FORWARD], vec![word(0, 30), word(1, 30)]);
    assert_eq!(game.rewards, [1.0, 1.0]);
    assert_eq!(game.world.state().request_queue, [3, 1]);
}

#[test]
fn a_draw_at_the_first_goal_can_be_delivered_at_the_second_and_drawn_again() {
    let mut game = start(&[(4, 10, Down), (5, 10, Down)]);
    game.load(0, 32);
    game.load(1, 9);
    // Shelf 9 is the ninth that is not requested; then 32 is the last that is not.
    game.play_drawing(&[NOOP, NOOP], vec![word(8, 30), word(29, 30)]);
    assert_eq!(game.rewards, [1.0, 1.0]);
    assert_eq!(game.world.state().request_queue, [31, 32]);
}

#[test]
fn a_lone_shelf_on_a_goal_of_an_arranged_state_pays_the_last_robot() {
    let mut game = start(&[(0, 0, Up), (9, 0, Up), (0, 9, Up)]);
    game.set(|state| state.shelves[31] = (4, 10));
    game.play_drawing(&[NOOP; 3], vec![word(0, 30)]);
    assert_eq!(game.rewards, [0.0, 0.0, 1.0]);
}

#[test]
fn only_the_step_limit_ends_an_episode() {
    let mut game = start(&[(0, 0, Up)]);
    for _ in 0..499 {
        assert_eq!(game.play(&[NOOP]), End::Running);
    }
    assert_eq!(game.play(&[NOOP]), End::TimeLimit);
    assert_eq!(game.world.state().step, 500);
}

#[test]
fn a_robot_sees_itself_and_the_square_around_it() {
    // Robot 0 stands under shelf 2 at (2, 1), loaded with it; robot 1 looks left at (3, 2); 1 and 6 are requested.
    let mut game = start(&[(2, 1, Down), (3, 2, Left)]);
    game.load(0, 2);
    game.set(|state| state.request_queue = vec![1, 6]);
    let sees = |game: &Game, robot| {
        let mut seen = vec![f32::NAN; game.world.sizes().obs_size[robot]];
        game.world.observe(robot, &mut seen);
        seen
    };
    let empty = [0., 1., 0., 0., 0., 0., 0.];
    let (shelf, requested) = ([0., 1., 0., 0., 0., 1., 0.], [0., 1., 0., 0., 0., 1., 1.]);
    let (me, other) = ([1., 0., 1., 0., 0., 1., 0.], [1., 0., 0., 1., 0., 0., 0.]);
    let around = [empty, empty, empty, requested, me, empty, shelf, requested, other].concat();
    assert_eq!(sees(&game, 0), [&[2., 1., 1., 0., 1., 0., 0., 0.][..], &around].concat());
    // Cells outside of the grid look empty; the last number marks a highway.
    let mut game = start(&[(0, 0, Right), (9, 10, Up)]);
    let me = [1., 0., 0., 0., 1., 0., 0.];
    let around = [empty, empty, empty, empty, me, empty, empty, empty, shelf].concat();
    assert_eq!(sees(&game, 0), [&[0., 0., 0., 0., 0., 0., 1., 1.][..], &around].concat());
    // What was seen before a step is not seen after it.
    game.play(&[FORWARD, NOOP]);
    let around = [empty, empty, empty, empty, me, empty, empty, shelf, shelf].concat();
    assert_eq!(sees(&game, 0), [&[1., 0., 0., 0., 0., 0., 1., 1.][..], &around].concat());
}

#[test]
fn a_state_that_cannot_be_is_refused_and_leaves_the_world_alone() {
    let mut game = start(&[(4, 9, Up), (5, 9, Up)]);
    let good = game.world.state();
    for (change, expected) in [
        (&(|s: &mut State| s.robots.truncate(1)) as &dyn Fn(&mut State), "expected 2 robots, found 1"),
        (&|s| s.shelves.truncate(31), "expected 32 shelves, found 31"),
        (&|s| s.request_queue.push(3), "expected 2 requested shelves, found 3"),
        (&|s| s.robots[1].x = 10, "robot 2 is at x 10, y 9, outside of the 10x11 grid"),
        (&|s| s.shelves[2].1 = 65535, "shelf 3 is at x 7, y 65535, outside of the 10x11 grid"),
        (&|s| s.robots[1].x = 4, "robot 2 is on the cell of robot 1 (x 4, y 9)"),
        (&|s| s.shelves[4] = (1, 1), "shelf 5 is on the cell of shelf 1 (x 1, y 1)"),
        (&|s| s.robots[0].carrying = Some(33), "robot 1 carries shelf 33; there are shelves 1 to 32"),
        (&|s| s.robots[0].carrying = Some(0), "robot 1 carries shelf 0; there are shelves 1 to 32"),
        (&|s| s.robots[0].carrying = Some(1), "robot 1 at x 4, y 9 carries shelf 1, which is at x 1, y 1"),
        (&|s| s.request_queue[1] = 40, "the request queue has shelf 40; there are shelves 1 to 32"),
        (&|s| s.request_queue[1] = 31, "the request queue has shelf 31 twice"),
    ] {
        let mut state = good.clone();
        change(&mut state);
        assert_eq!(game.world.set_state(&state).unwrap_err().to_string(), expected);
        assert_eq!(game.world.state(), good);
    }
}

#[test]
fn the_picture_shows_all_shelves_and_robots_and_says_what_is_requested() {
    let mut game = start(&[(4, 9, Down), (0, 0, Up)]);
    game.load(0, 32);
    let mut words = Words(vec![word(0, 30)]);
    game.world.step(&[FORWARD, NOOP], &mut words, &mut game.rewards);
    let scene = game.world.scene();
    assert_eq!((scene.width, scene.height), (10.0, 11.0));
    assert_eq!(scene.caption, "step 1, 1 delivered, shelves requested: 31 1");
}
