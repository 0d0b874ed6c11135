//! The rules of a particle step, worked out by hand (mpe §4 to §7, §9).

use envs::mpe::{Agent, Game, Particles, Rules, State};
use envs::{End, World};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// A world whose agents rest at the named places.
fn at(
    game: Game,
    rules: Rules,
    agents: &[[f64; 2]],
    landmarks: &[[f64; 2]],
    goal: Option<usize>,
) -> Particles {
    let comm = vec![0.0; if game == Game::SpeakerListener { 3 } else { 2 }];
    let agents = agents.iter().map(|&pos| Agent { pos, vel: [0.0; 2], comm: comm.clone() }).collect();
    let mut world = Particles::new(game, rules);
    world.set_state(&State { agents, landmarks: landmarks.to_vec(), goal_landmark: goal, step: 0 }).unwrap();
    world
}

/// Tag with obstacles that are too far away to be felt.
fn tag(rules: Rules, agents: [[f64; 2]; 4]) -> Particles {
    at(Game::Tag, rules, &agents, &[[-50.0, -50.0], [50.0, 50.0]], None)
}

fn adversary(rules: Rules) -> Particles {
    let agents = [[0.0, 0.0], [3.0, 3.0], [3.0, 2.0]];
    at(Game::Adversary, rules, &agents, &[[-9.0, 8.0], [3.0, 4.0]], Some(1))
}

fn speaker_listener(rules: Rules) -> Particles {
    let landmarks = [[1.0, 0.0], [0.5, -0.5], [0.25, 0.75]];
    at(Game::SpeakerListener, rules, &[[0.5, 0.5], [-0.125, 0.25]], &landmarks, Some(2))
}

fn play(world: &mut Particles, actions: &[u16]) -> Vec<f64> {
    let mut rewards = vec![f64::NAN; actions.len()];
    world.play(actions, &mut rewards);
    rewards
}

fn sees(world: &Particles, agent: usize) -> Vec<f32> {
    let mut seen = vec![f32::NAN; world.sizes().obs_size[agent]];
    world.observe(agent, &mut seen);
    seen
}

/// Place and velocity of an agent.
fn motion(world: &Particles, agent: usize) -> ([f64; 2], [f64; 2]) {
    let agent = &world.state().agents[agent];
    (agent.pos, agent.vel)
}

fn with_velocity(mut world: Particles, agent: usize, vel: [f64; 2]) -> Particles {
    let mut state = world.state();
    state.agents[agent].vel = vel;
    world.set_state(&state).unwrap();
    world
}

#[track_caller]
fn assert_near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-12, "found {found}, expected {expected}");
}

const FAR: [[f64; 2]; 4] = [[10.0, 0.0], [20.0, 0.0], [30.0, 0.0], [0.0, 0.5]];

#[test]
fn an_action_shows_in_the_velocity_at_once_and_in_the_place_one_step_later() {
    for rules in [Rules::Current, Rules::Epymarl] {
        let mut world = adversary(rules);
        play(&mut world, &[0, 2, 0]);
        assert_eq!(motion(&world, 1), ([3.0, 3.0], [0.5, 0.0]));
        play(&mut world, &[0, 0, 0]);
        assert_eq!(motion(&world, 1), ([3.05, 3.0], [0.375, 0.0]));
    }
}

#[test]
fn in_the_code_of_2021_an_action_shows_in_the_place_at_once() {
    let mut world = adversary(Rules::Study2021);
    play(&mut world, &[0, 1, 0]);
    assert_eq!(motion(&world, 1), ([3.05, 3.0], [0.5, 0.0]));
    play(&mut world, &[0, 0, 0]);
    assert_eq!(motion(&world, 1), ([3.05 + 0.375 * 0.1, 3.0], [0.375, 0.0]));
}

#[test]
fn each_action_pushes_to_its_side_with_the_force_of_its_body() {
    let current = [[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]];
    let study = [[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
    for (rules, directions) in
        [(Rules::Current, current), (Rules::Epymarl, current), (Rules::Study2021, study)]
    {
        for (action, direction) in (0..).zip(directions) {
            let mut world = tag(rules, FAR);
            play(&mut world, &[action; 4]);
            for (agent, push) in [(0, 3.0), (2, 3.0), (3, 4.0)] {
                assert_eq!(
                    motion(&world, agent).1,
                    direction.map(|unit| unit * push * 0.1),
                    "{rules}, {action}"
                );
            }
            let mut world = adversary(rules);
            play(&mut world, &[action; 3]);
            assert_eq!(motion(&world, 0).1, direction.map(|unit| unit * 0.5), "{rules}, {action}");
        }
    }
}

#[test]
fn who_is_faster_than_its_limit_keeps_the_direction_and_loses_the_rest() {
    // (1.2, 1.2) becomes (0.9, 0.9), pushed to (1.3, 0.9): sqrt(2.5) is above the prey's 1.3.
    let speed = 2.5_f64.sqrt();
    let limited = [1.3 / speed * 1.3, 0.9 / speed * 1.3];
    for (rules, right, moved) in
        [(Rules::Current, 2, [0.12, 0.12]), (Rules::Study2021, 1, [limited[0] * 0.1, limited[1] * 0.1])]
    {
        let mut world = with_velocity(tag(rules, FAR), 3, [1.2, 1.2]);
        play(&mut world, &[0, 0, 0, right]);
        let (pos, vel) = motion(&world, 3);
        for axis in 0..2 {
            assert_near(vel[axis], limited[axis]);
            assert_near(pos[axis], FAR[3][axis] + moved[axis]);
        }
    }
    // A predator's limit is 1: 0.75 + 0.3 is above it, 0.675 + 0.3 is not.
    for (before, after) in [(1.0, 1.0), (0.9, 0.975)] {
        let mut world = with_velocity(tag(Rules::Current, FAR), 0, [before, 0.0]);
        play(&mut world, &[2, 0, 0, 0]);
        assert_near(motion(&world, 0).1[0], after);
    }
}

#[test]
fn bodies_push_each_other_apart_the_more_the_deeper_they_overlap() {
    // Two predators touch at 0.15. The margin is 0.001, so z is 0, 50 and -10; the force is 0.1 ln(1 + exp(z)).
    for (distance, force) in
        [(0.15, 0.1 * 2.0_f64.ln()), (0.1, 5.0), (0.16, 0.1 * (-10.0_f64).exp().ln_1p()), (0.95, 0.0)]
    {
        // Along a line with slope 4/3, far from the others.
        let other = [0.6 * distance, 0.8 * distance];
        let mut world = tag(Rules::Current, [[0.0, 0.0], other, [30.0, 0.0], [0.0, 20.0]]);
        play(&mut world, &[0; 4]);
        let (first, second) = (motion(&world, 0).1, motion(&world, 1).1);
        for (axis, unit) in [0.6, 0.8].into_iter().enumerate() {
            assert_near(first[axis], -unit * force * 0.1);
            assert_near(second[axis], unit * force * 0.1);
        }
        assert_eq!(motion(&world, 2).1, [0.0, 0.0], "who is far away feels exactly nothing");
    }
}

#[test]
fn an_obstacle_pushes_and_is_not_pushed() {
    // The prey touches an obstacle at 0.25; at 0.2 it is 0.05 too near.
    let agents = [[10.0, 0.0], [20.0, 0.0], [30.0, 0.0], [0.0, 0.2]];
    let mut world = at(Game::Tag, Rules::Current, &agents, &[[0.0, 0.0], [50.0, 0.0]], None);
    play(&mut world, &[0; 4]);
    assert_near(motion(&world, 3).1[1], 0.5);
    assert_eq!(world.state().landmarks[0], [0.0, 0.0]);
}

#[test]
fn bodies_in_adversary_pass_through_each_other() {
    let agents = [[0.0, 0.0], [0.0, 0.01], [0.01, 0.0]];
    let mut world = at(Game::Adversary, Rules::Current, &agents, &[[0.0, 0.0], [0.0, 0.0]], Some(0));
    play(&mut world, &[0; 3]);
    assert!((0..3).all(|agent| motion(&world, agent).1 == [0.0, 0.0]));
}

#[test]
fn bodies_with_one_centre_do_not_push_each_other() {
    let mut world = tag(Rules::Current, [[0.0, 0.0], [0.0, 0.0], [30.0, 0.0], [0.0, 20.0]]);
    play(&mut world, &[0; 4]);
    assert_eq!(motion(&world, 0).1, [0.0, 0.0]);
}

#[test]
fn all_predators_are_rewarded_for_each_that_touches_the_prey_more_than_just() {
    let touching = 0.125;
    for (first, second, caught) in [
        (touching, 20.0, 0.0),
        (f64::next_down(touching), 20.0, 10.0),
        (f64::next_down(touching), -0.1, 20.0),
    ] {
        let mut world = tag(Rules::Current, [[first, 0.0], [second, 0.0], [30.0, 0.0], [0.0, 0.0]]);
        assert_eq!(play(&mut world, &[0; 4]), [caught, caught, caught, -caught]);
    }
}

#[test]
fn the_prey_pays_for_leaving_the_middle_on_each_axis() {
    for (place, cost) in [
        ([0.5, 0.9], 0.0),
        ([0.95, 0.0], 0.5),
        ([1.0, 0.0], 1.0),
        ([0.0, -2.0], 2.0_f64.exp()),
        ([-3.0, 0.95], 10.5),
    ] {
        let mut world = tag(Rules::Current, [[10.0, 0.0], [20.0, 0.0], [30.0, 0.0], place]);
        assert_near(play(&mut world, &[0; 4])[3], -cost);
    }
}

#[test]
fn the_good_agents_earn_the_adversarys_distance_minus_that_of_the_nearer_one() {
    // Distances to the goal (3, 4): 5, 1 and 2.
    assert_eq!(play(&mut adversary(Rules::Current), &[0; 3]), [-5.0, 4.0, 4.0]);
    assert_eq!(play(&mut adversary(Rules::Study2021), &[0; 3]), [-25.0, 4.0, 4.0]);
}

#[test]
fn speaker_and_listener_pay_the_squared_distance_and_in_2021_the_sum_of_both() {
    // From (-0.125, 0.25) to (0.25, 0.75): 0.140625 + 0.25.
    assert_eq!(play(&mut speaker_listener(Rules::Current), &[0, 0]), [-0.390625; 2]);
    assert_eq!(play(&mut speaker_listener(Rules::Study2021), &[0, 0]), [-0.78125; 2]);
}

#[test]
fn the_listener_hears_a_word_after_the_step_in_which_it_was_said() {
    let mut world = speaker_listener(Rules::Current);
    let heard = |world: &Particles| sees(world, 1)[8..].to_vec();
    assert_eq!(heard(&world), [0.0, 0.0, 0.0]);
    play(&mut world, &[2, 0]);
    assert_eq!(heard(&world), [0.0, 0.0, 1.0]);
    play(&mut world, &[0, 0]);
    assert_eq!(heard(&world), [1.0, 0.0, 0.0]);
    // A word that does not exist is silence.
    play(&mut world, &[3, 0]);
    assert_eq!(heard(&world), [0.0, 0.0, 0.0]);
}

#[test]
fn the_speaker_stays_where_it_is() {
    let mut world = speaker_listener(Rules::Current);
    for _ in 0..3 {
        play(&mut world, &[2, 2]);
    }
    assert_eq!(motion(&world, 0), ([0.5, 0.5], [0.0, 0.0]));
    assert!(motion(&world, 1).0[0] > -0.125);
}

#[test]
fn observations_list_what_the_specification_lists() {
    let world = speaker_listener(Rules::Current);
    assert_eq!(sees(&world, 0), [0.15, 0.15, 0.65]);
    assert_eq!(sees(&world, 1), [0.0, 0.0, 1.125, -0.25, 0.625, -0.75, 0.375, 0.5, 0.0, 0.0, 0.0]);

    let world = adversary(Rules::Current);
    assert_eq!(sees(&world, 0), [-9.0, 8.0, 3.0, 4.0, 3.0, 3.0, 3.0, 2.0]);
    assert_eq!(sees(&world, 2), [0.0, 2.0, -12.0, 6.0, 0.0, 2.0, -3.0, -2.0, 0.0, 1.0]);

    let agents = [[1.0, 2.0], [4.0, 8.0], [16.0, 32.0], [-64.0, -128.0]];
    let mut world = at(Game::Tag, Rules::Current, &agents, &[[0.5, 0.25], [-0.5, -0.25]], None);
    for (agent, vel) in (0..4).zip([[0.5, 0.0], [0.0, 0.25], [0.125, 0.0], [0.75, -0.5]]) {
        world = with_velocity(world, agent, vel);
    }
    assert_eq!(
        sees(&world, 1),
        [0.0, 0.25, 4.0, 8.0, -3.5, -7.75, -4.5, -8.25, -3.0, -6.0, 12.0, 24.0, -68.0, -136.0, 0.75, -0.5]
    );
    assert_eq!(
        sees(&world, 3),
        [0.75, -0.5, -64.0, -128.0, 64.5, 128.25, 63.5, 127.75, 65.0, 130.0, 68.0, 136.0, 80.0, 160.0]
    );
}

#[test]
fn an_episode_has_twenty_five_steps_and_only_under_epymarl_the_last_is_lost() {
    for rules in Rules::ALL {
        let mut world = adversary(rules);
        let mut rewards = [0.0; 3];
        for step in 1..25 {
            assert_eq!(world.play(&[1, 2, 4], &mut rewards), End::Running, "{rules}, step {step}");
            assert_ne!(rewards[1], 0.0);
        }
        let before = sees(&world, 1);
        assert_eq!(world.play(&[1, 2, 4], &mut rewards), End::TimeLimit);
        let lost = rules == Rules::Epymarl;
        assert_eq!(rewards == [0.0; 3], lost, "{rules}");
        assert_eq!(sees(&world, 1) == before, lost, "{rules}");
        assert_eq!(world.state().step, 25);
    }
}

#[test]
fn steps_draw_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let before = rng.clone();
    for game in Game::ALL {
        let mut world = Particles::new(game, Rules::Current);
        let agents = world.sizes().agents;
        world.step(&vec![1; agents], &mut rng, &mut vec![0.0; agents]);
    }
    assert_eq!(rng, before);
}
