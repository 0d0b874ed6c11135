//! Checks that a world keeps the contract of [`World`]. For tests: a violation is a panic that names it.

use rand::RngCore;

use crate::draw::below;
use crate::scene::{Scene, Shape};
use crate::{End, Sizes, World};

/// Steps of random play.
const STEPS: u32 = 10_000;
/// Number of seeds whose episode is played twice.
const TWICE: u64 = 10;

/// Checks that a world keeps the contract of [`World`], by playing random actions: its sizes agree with each other,
/// observations are written in full, episodes end within the step limit and depend on nothing but their generator,
/// all actions that do not exist have the same effect, copies are alike, and the world can be drawn.
///
/// `world` is as its family makes it, never reset; `seeded` makes a generator from a seed.
///
/// # Panics
/// If the world violates one of these.
pub fn check<R: RngCore>(world: &dyn World, seeded: impl Fn(u64) -> R) {
    sizes_agree(world.sizes());
    let names = names_of_facts(world);
    // The generator of the world, then that of the actions.
    let generators = |seed: u64| (seeded(seed), seeded(!seed));

    let mut used = world.copy();
    let (mut chance, mut policy) = generators(0);
    let mut steps = 0;
    while steps < STEPS {
        used.reset(&mut chance);
        can_be_drawn(&used.scene());
        steps += play(&mut *used, 0, u32::MAX, 0, &mut chance, &mut policy).steps;
        can_be_drawn(&used.scene());
        assert_eq!(names_of_facts(&*used), names, "a world must report the same facts always");
    }

    let episode = |world: &mut dyn World, seed, ahead| {
        let (mut chance, mut policy) = generators(seed);
        world.reset(&mut chance);
        // With the next number of the generator, to compare how much was drawn.
        (play(world, 0, u32::MAX, ahead, &mut chance, &mut policy), chance.next_u64())
    };
    for seed in 1..=TWICE {
        let first = episode(&mut *world.copy(), seed, 0);
        let again = episode(&mut *used, seed, 2);
        assert!(
            first == again,
            "an episode must depend on its chance alone, not on episodes before it nor on thinking ahead"
        );
    }

    for seed in 1..=TWICE {
        let (mut chance, mut policy) = generators(seed);
        used.reset(&mut chance);
        let before = play(&mut *used, 0, seed as u32, 1, &mut chance, &mut policy);
        if before.end == End::Running {
            let mut copy = used.copy();
            let rest = |world: &mut dyn World| {
                let (mut chance, mut policy) = generators(!seed);
                play(world, before.steps, u32::MAX, 0, &mut chance, &mut policy)
            };
            assert!(rest(&mut *copy) == rest(&mut *used), "a copy must go on like the world it is a copy of");
        }
    }

    let most = world.sizes().n_actions.iter().copied().max().unwrap_or(0) as u16;
    let outcome = |action| {
        let (mut copy, mut chance) = (world.copy(), seeded(3));
        copy.reset(&mut chance);
        let mut rewards = vec![0.0; copy.sizes().agents];
        let end = copy.step(&vec![action; rewards.len()], &mut chance, &mut rewards);
        (end, rewards, everybodys_view(&*copy))
    };
    for action in [255.max(most), u16::MAX] {
        let expected = outcome(most);
        assert_eq!(
            outcome(action),
            expected,
            "actions {most} and {action} do not exist and must do the same"
        );
    }
}

/// The record of steps with random available actions.
#[derive(Debug, PartialEq)]
struct Played {
    observations: Vec<u32>,
    rewards: Vec<u64>,
    steps: u32,
    end: End,
    /// Of the world's report at the end.
    facts: Vec<u64>,
}

fn sizes_agree(sizes: &Sizes) {
    let Sizes { agents, obs_size, n_actions, episode_limit } = sizes;
    assert!(*agents > 0 && *episode_limit > 0, "expected agents and steps, found {sizes:?}");
    for of_agents in [obs_size, n_actions] {
        let one_for_each = of_agents.len() == *agents;
        let in_range = of_agents.iter().all(|size| (1..=usize::from(u16::MAX)).contains(size));
        assert!(one_for_each && in_range, "expected a size from 1 to 65535 for each agent, found {sizes:?}");
    }
}

/// Continues an episode after `before` steps, until it ends or for `most` steps. Calls `think_ahead` `ahead` times
/// before each.
fn play(
    world: &mut dyn World,
    before: u32,
    most: u32,
    ahead: u32,
    chance: &mut dyn RngCore,
    policy: &mut dyn RngCore,
) -> Played {
    let Sizes { agents, n_actions, episode_limit, .. } = world.sizes().clone();
    let mut played =
        Played { observations: vec![], rewards: vec![], steps: 0, end: End::Running, facts: vec![] };
    let mut actions = vec![0; agents];
    loop {
        played.observations.extend(everybodys_view(world));
        for (agent, action) in actions.iter_mut().enumerate() {
            // Places that the world does not write keep the 7 and are noticed.
            let mut mask = vec![7; n_actions[agent]];
            world.available(agent, &mut mask);
            assert!(
                mask.iter().all(|&entry| entry <= 1),
                "agent {agent}: a mask of {mask:?}, not of 0 and 1"
            );
            let open: Vec<u16> = (0..).zip(&mask).filter(|(_, &entry)| entry == 1).map(|(a, _)| a).collect();
            assert!(!open.is_empty(), "agent {agent}: no action is available");
            *action = open[below(policy, open.len() as u32) as usize];
        }
        if played.end != End::Running || played.steps == most {
            world.facts(&mut |_, value| played.facts.push(value.to_bits()));
            return played;
        }
        (0..ahead).for_each(|_| world.think_ahead());
        let mut rewards = vec![f64::NAN; agents];
        played.end = world.step(&actions, chance, &mut rewards);
        played.steps += 1;
        assert!(
            rewards.iter().all(|reward| reward.is_finite()),
            "rewards {rewards:?}: not one for each agent"
        );
        played.rewards.extend(rewards.iter().map(|reward| reward.to_bits()));
        let steps = before + played.steps;
        let in_time = match played.end {
            End::Running => steps < episode_limit,
            End::Terminated => steps <= episode_limit,
            End::TimeLimit => steps == episode_limit,
        };
        assert!(in_time, "{:?} after {steps} steps, with a limit of {episode_limit}", played.end);
    }
}

/// The bits of all agents' observations.
fn everybodys_view(world: &dyn World) -> Vec<u32> {
    let mut view = Vec::new();
    for (agent, &size) in world.sizes().obs_size.iter().enumerate() {
        // Places that the world does not write stay infinite and are noticed.
        let mut seen = vec![f32::INFINITY; size];
        world.observe(agent, &mut seen);
        assert!(
            seen.iter().all(|number| number.is_finite()),
            "agent {agent} sees {seen:?}: not all are numbers"
        );
        view.extend(seen.iter().map(|number| number.to_bits()));
    }
    view
}

/// The names of what a world reports of an episode.
fn names_of_facts(world: &dyn World) -> Vec<&'static str> {
    let mut names = Vec::new();
    world.facts(&mut |name, value| {
        let is_part = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_';
        let good = !name.is_empty() && name.bytes().all(is_part) && !names.contains(&name);
        assert!(good, "`{name}` is no name of a fact, or one that was there already");
        assert!(value.is_finite(), "the fact {name} is {value}");
        names.push(name);
    });
    names
}

fn can_be_drawn(scene: &Scene) {
    let side = |length: f64| length.is_finite() && length > 0.0;
    assert!(side(scene.width) && side(scene.height), "a picture of {} x {}", scene.width, scene.height);
    for shape in &scene.shapes {
        let numbers = match shape {
            Shape::Rectangle { x, y, width, height, .. } => vec![*x, *y, *width, *height],
            Shape::Circle { x, y, radius, .. } => vec![*x, *y, *radius],
            Shape::Line { from, to, width, .. } => vec![from.0, from.1, to.0, to.1, *width],
            Shape::Polygon { corners, .. } => corners.iter().flat_map(|&(x, y)| [x, y]).collect(),
            Shape::Text { x, y, size, .. } => vec![*x, *y, *size],
        };
        assert!(numbers.iter().all(|number| number.is_finite()), "a picture with {shape:?}");
    }
}
