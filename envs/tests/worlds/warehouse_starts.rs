//! What is drawn in a warehouse, as frequencies with fixed seeds: the start (rware §4) and the next request after a
//! delivery (rware §5.5).

use std::collections::BTreeSet;

use envs::rware::{Config, Direction, Robot, Rules, State, Warehouse, NOOP};
use envs::World;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::uniform::assert_uniform;

const DRAWS: usize = 20_000;

fn config(shelf_rows: u16, robots: u16, requests: u16) -> Config {
    Config {
        shelf_rows,
        shelf_columns: 3,
        column_height: 8,
        robots,
        requests,
        sensor_range: 1,
        episode_limit: 500,
        rules: Rules::V2,
    }
}

fn starts(config: Config) -> Vec<State> {
    let mut world = Warehouse::new(config).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(20_240_918);
    let reset = |_| {
        world.reset(&mut rng);
        world.state()
    };
    (0..DRAWS).map(reset).collect()
}

fn cells(width: u16, height: u16) -> impl Iterator<Item = (u16, u16)> {
    (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)))
}

#[test]
fn each_robot_starts_on_any_cell_in_any_direction_without_a_load() {
    for (shelf_rows, height, robots) in [(1, 11, 2), (1, 11, 4), (2, 20, 4)] {
        let states = starts(config(shelf_rows, robots, robots));
        for i in 0..usize::from(robots) {
            let robot = |state: &State| state.robots[i];
            assert_uniform("places", cells(10, height), states.iter().map(robot).map(|r| (r.x, r.y)));
            assert_uniform(
                "directions",
                Direction::ALL.into_iter(),
                states.iter().map(|s| robot(s).direction),
            );
            assert!(states.iter().all(|state| robot(state).carrying.is_none()));
        }
    }
}

#[test]
fn two_robots_start_on_any_two_cells_with_independent_directions() {
    let small = Config { shelf_columns: 1, column_height: 1, shelf_rows: 2, ..config(1, 2, 1) };
    let states = starts(small);
    let pair = |state: &State| {
        let [a, b] = [state.robots[0], state.robots[1]];
        (a.y * 4 + a.x, b.y * 4 + b.x)
    };
    let different = (0..24).flat_map(|a| (0..24).map(move |b| (a, b))).filter(|(a, b)| a != b);
    assert_uniform("pairs of places", different, states.iter().map(pair));
    let all = Direction::ALL.into_iter();
    let directions = all.flat_map(|a| Direction::ALL.into_iter().map(move |b| (a, b)));
    let found = states.iter().map(|state| (state.robots[0].direction, state.robots[1].direction));
    assert_uniform("pairs of directions", directions, found);
}

#[test]
fn any_shelves_are_requested_first_and_all_are_at_home() {
    for requests in [1, 2, 4, 8] {
        let world = Warehouse::new(config(1, 2, requests)).unwrap();
        let states = starts(config(1, 2, requests));
        for slot in 0..usize::from(requests) {
            assert_uniform("requests", 1..=32, states.iter().map(|state| state.request_queue[slot]));
        }
        for state in states {
            let distinct: BTreeSet<u16> = state.request_queue.iter().copied().collect();
            assert_eq!(distinct.len(), usize::from(requests), "{:?}", state.request_queue);
            assert_eq!(state.shelves, world.layout().slots);
            assert_eq!(state.step, 0);
        }
    }
}

#[test]
fn two_requests_are_any_two_shelves() {
    let states = starts(Config { column_height: 2, ..config(1, 2, 2) });
    let different = (1..=8).flat_map(|a| (1..=8).map(move |b| (a, b))).filter(|(a, b)| a != b);
    let pairs = states.iter().map(|state| (state.request_queue[0], state.request_queue[1]));
    assert_uniform("pairs of requests", different, pairs);
}

#[test]
fn after_a_delivery_any_shelf_that_was_not_requested_takes_its_place() {
    let mut world = Warehouse::new(config(1, 2, 3)).unwrap();
    let mut state = world.state();
    // Shelf 7 is carried onto the first goal; 7, 20 and 31 are requested.
    let robot = |x, y, carrying| Robot { x, y, direction: Direction::Up, carrying };
    state.robots = vec![robot(4, 10, Some(7)), robot(0, 0, None)];
    state.shelves[6] = (4, 10);
    state.request_queue = vec![20, 7, 31];
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut rewards = [0.0; 2];
    let drawn = |_| {
        world.set_state(&state).unwrap();
        world.step(&[NOOP; 2], &mut rng, &mut rewards);
        assert_eq!(rewards, [1.0, 0.0]);
        let queue = world.state().request_queue;
        assert_eq!((queue[0], queue[2]), (20, 31));
        queue[1]
    };
    let drawn: Vec<u16> = (0..DRAWS).map(drawn).collect();
    let support = (1..=32).filter(|id| ![7, 20, 31].contains(id));
    assert_uniform("next requests", support, drawn.into_iter());
}
