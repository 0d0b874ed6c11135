//! What every listed task keeps to, whatever its family.

use envs::{task, tasks, End, World};
use rand::{Rng, RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Of random play, per task.
const STEPS: u32 = 10_000;

/// Everything that came out of one episode of random available actions.
#[derive(Debug, PartialEq)]
struct Episode {
    observations: Vec<u32>,
    rewards: Vec<u64>,
    length: u32,
    end: End,
}

fn play(world: &mut dyn World, chance: &mut ChaCha8Rng, policy: &mut ChaCha8Rng) -> Episode {
    let sizes = world.sizes().clone();
    let mut rewards = vec![f64::NAN; sizes.agents];
    let mut actions = vec![0; sizes.agents];
    let mut episode = Episode { observations: vec![], rewards: vec![], length: 0, end: End::Running };
    world.reset(chance);
    loop {
        for (agent, action) in actions.iter_mut().enumerate() {
            // What a world does not write stays a NaN or a 7 and is noticed.
            let mut seen = vec![f32::NAN; sizes.obs_size[agent]];
            world.observe(agent, &mut seen);
            assert!(seen.iter().all(|number| number.is_finite()), "agent {agent} sees {seen:?}");
            episode.observations.extend(seen.iter().map(|number| number.to_bits()));
            let mut mask = vec![7; sizes.n_actions[agent]];
            world.available(agent, &mut mask);
            assert!(mask.iter().all(|&entry| entry <= 1), "agent {agent} has the mask {mask:?}");
            let open: Vec<u16> = (0..).zip(&mask).filter(|(_, &entry)| entry == 1).map(|(a, _)| a).collect();
            assert!(!open.is_empty(), "agent {agent} can do nothing");
            *action = open[policy.random_range(0..open.len() as u32) as usize];
        }
        if episode.end != End::Running {
            return episode;
        }
        episode.end = world.step(&actions, chance, &mut rewards);
        episode.length += 1;
        assert!(rewards.iter().all(|reward| reward.is_finite()), "rewards {rewards:?}");
        episode.rewards.extend(rewards.iter().map(|reward| reward.to_bits()));
        match episode.end {
            End::Running => assert!(episode.length < sizes.episode_limit, "no end at the step limit"),
            End::Terminated => assert!(episode.length <= sizes.episode_limit),
            End::TimeLimit => assert_eq!(episode.length, sizes.episode_limit),
        }
    }
}

fn generators(seed: u64) -> (ChaCha8Rng, ChaCha8Rng) {
    (ChaCha8Rng::seed_from_u64(seed), ChaCha8Rng::seed_from_u64(!seed))
}

#[test]
fn every_task_names_its_sizes_and_keeps_to_them() {
    for info in tasks() {
        let world = task(info.name).unwrap().make();
        let sizes = world.sizes();
        assert_eq!(*sizes, info.sizes, "{}", info.name);
        assert!(sizes.agents > 0 && sizes.episode_limit > 0, "{}", info.name);
        assert_eq!(sizes.obs_size.len(), sizes.agents, "{}", info.name);
        assert_eq!(sizes.n_actions.len(), sizes.agents, "{}", info.name);
    }
}

#[test]
fn random_episodes_of_every_task_end_by_the_limit_and_show_finite_numbers() {
    for info in tasks() {
        println!("{}", info.name);
        let mut world = task(info.name).unwrap().make();
        let (mut chance, mut policy) = generators(1);
        for _ in 0..STEPS.div_ceil(info.sizes.episode_limit) {
            play(&mut *world, &mut chance, &mut policy);
        }
    }
}

#[test]
fn an_episode_depends_on_the_seed_and_on_nothing_before_it() {
    for info in tasks() {
        let task = task(info.name).unwrap();
        let (mut fresh, mut used) = (task.make(), task.make());
        let (mut chance, mut policy) = generators(99);
        play(&mut *used, &mut chance, &mut policy);
        let run = |world: &mut dyn World, seed| {
            let (mut chance, mut policy) = generators(seed);
            let episode = play(world, &mut chance, &mut policy);
            (episode, chance.next_u64())
        };
        let first = run(&mut *fresh, 5);
        assert_eq!(first, run(&mut *used, 5), "{}", info.name);
        assert_ne!(first, run(&mut *fresh, 6), "{}", info.name);
    }
}

#[test]
fn actions_that_do_not_exist_count_as_doing_nothing() {
    for info in tasks() {
        let task = task(info.name).unwrap();
        let (mut hostile, mut idle) = (task.make(), task.make());
        let agents = info.sizes.agents;
        let outcome = |world: &mut dyn World, actions: &[u16]| {
            let (mut chance, _) = generators(3);
            world.reset(&mut chance);
            let mut rewards = vec![0.0; agents];
            let end = world.step(actions, &mut chance, &mut rewards);
            let mut seen = vec![0.0; info.sizes.obs_size[0]];
            world.observe(0, &mut seen);
            (end, rewards, seen)
        };
        let expected = outcome(&mut *idle, &vec![0; agents]);
        for action in [info.sizes.n_actions.iter().max().map(|&n| n as u16).unwrap(), 255, u16::MAX] {
            assert_eq!(outcome(&mut *hostile, &vec![action; agents]), expected, "{}, {action}", info.name);
        }
    }
}
