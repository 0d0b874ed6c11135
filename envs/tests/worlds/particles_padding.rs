//! Teams whose agents differ, made alike.

use envs::{task, Opponent, Task, World};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

fn speaker_listener() -> Task {
    task("mpe-simple-speaker-listener").unwrap()
}

fn started(task: &Task) -> Box<dyn World> {
    let mut world = task.make();
    world.reset(&mut ChaCha8Rng::seed_from_u64(4));
    world
}

fn sees(world: &dyn World, agent: usize) -> Vec<f32> {
    let mut seen = vec![f32::NAN; world.sizes().obs_size[agent]];
    world.observe(agent, &mut seen);
    seen
}

fn mask(world: &dyn World, agent: usize) -> Vec<u8> {
    let mut mask = vec![7; world.sizes().n_actions[agent]];
    world.available(agent, &mut mask);
    mask
}

#[test]
fn agents_that_differ_are_padded_to_the_largest() {
    let plain = speaker_listener();
    assert_eq!((&plain.sizes().obs_size, &plain.sizes().n_actions), (&vec![3, 11], &vec![3, 5]));
    let padded = plain.padded();
    assert_eq!((&padded.sizes().obs_size, &padded.sizes().n_actions), (&vec![11, 11], &vec![5, 5]));
    assert_eq!((plain.is_padded(), padded.is_padded()), (false, true));
    assert_eq!(padded.name(), plain.name());

    let (plain, padded) = (started(&plain), started(&padded));
    let seen = sees(&*padded, 0);
    assert_eq!(seen[..3], sees(&*plain, 0));
    assert_eq!(seen[3..], [0.0; 8]);
    assert_eq!(sees(&*padded, 1), sees(&*plain, 1));
    assert_eq!(mask(&*padded, 0), [1, 1, 1, 0, 0]);
    assert_eq!(mask(&*padded, 1), [1; 5]);
    assert_eq!(padded.scene(), plain.scene());
}

#[test]
fn a_padded_action_does_nothing() {
    let mut world = started(&speaker_listener().padded());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    world.step(&[1, 0], &mut rng, &mut [0.0; 2]);
    assert_eq!(sees(&*world, 1)[8..], [0.0, 1.0, 0.0]);
    for action in [3, 4] {
        world.step(&[action, 0], &mut rng, &mut [0.0; 2]);
        assert_eq!(sees(&*world, 1)[8..], [0.0; 3], "action {action}");
    }
}

#[test]
fn padding_twice_is_padding_once_and_a_copy_keeps_it() {
    let twice = speaker_listener().padded().padded();
    assert!(twice.is_padded() && twice.clone().is_padded());
    assert_eq!(twice.sizes().obs_size, [11, 11]);
    let world = started(&twice);
    assert_eq!(sees(&*world.copy(), 0), sees(&*world, 0));
}

#[test]
fn other_rules_are_padded_too() {
    let task = speaker_listener().padded().with_rules("2021").unwrap();
    assert_eq!((task.name(), task.is_padded()), ("mpe-simple-speaker-listener-2021", true));
    assert_eq!(task.sizes().obs_size, [11, 11]);
    assert!(!speaker_listener().with_rules("2021").unwrap().is_padded());
    assert!(task.with_opponent(&Opponent::Builtin).unwrap().is_padded());
}

#[test]
fn a_team_of_equals_stays_as_it_is() {
    for name in ["lbf-8x8-2p-2f-coop", "mpe-simple-tag"] {
        let task = task(name).unwrap();
        assert!(!task.padded().is_padded());
        assert_eq!(task.padded().sizes(), task.sizes());
    }
}
