//! What every listed task keeps to, whatever its family; and that the checks notice a world that does not.

use std::panic::{catch_unwind, AssertUnwindSafe};

use envs::conformance::check;
use envs::scene::Scene;
use envs::{task, tasks, End, Sizes, World};
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn every_listed_task_keeps_to_what_worlds_promise() {
    for info in tasks() {
        println!("{}", info.name);
        let task = task(info.name).unwrap();
        assert_eq!(*task.sizes(), info.sizes);
        check(&*task.make(), ChaCha8Rng::seed_from_u64);
    }
}

#[test]
fn other_chance_is_another_episode() {
    for info in tasks() {
        let mut world = task(info.name).unwrap().make();
        // Where everybody starts may be fixed. Then chance decides who of two falls first, and it takes some battles
        // until that matters.
        let mut episode = |seed, policy| {
            let mut chance = ChaCha8Rng::seed_from_u64(seed);
            let mut policy = ChaCha8Rng::seed_from_u64(policy);
            world.reset(&mut chance);
            let mut rewards = vec![0.0; info.sizes.agents];
            let mut seen = vec![0.0; info.sizes.obs_size[0]];
            world.observe(0, &mut seen);
            let mut came: Vec<f64> = seen.iter().copied().map(f64::from).collect();
            for _ in 0..info.sizes.episode_limit {
                let mut action = |agent: usize| {
                    let mut mask = vec![0; info.sizes.n_actions[agent]];
                    world.available(agent, &mut mask);
                    let open: Vec<u16> =
                        (0..).zip(&mask).filter(|(_, &entry)| entry == 1).map(|(action, _)| action).collect();
                    open[policy.next_u32() as usize % open.len()]
                };
                let actions: Vec<u16> = (0..info.sizes.agents).map(&mut action).collect();
                let end = world.step(&actions, &mut chance, &mut rewards);
                came.extend(&rewards);
                if end != End::Running {
                    break;
                }
            }
            came
        };
        assert!((0..1_000).any(|policy| episode(1, policy) != episode(2, policy)), "{}", info.name);
    }
}

/// What is wrong with a [`Faulty`] world.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    NoAgents,
    SizesOfOneAgent,
    BlankObservation,
    NoRewards,
    NoActions,
    OddMask,
    NoEnd,
    EarlyLimit,
    Memory,
    ForgetfulCopy,
    ActionsAreAmounts,
    NoPicture,
}

/// Counts the actions other than 0, two agents, three actions, five steps.
#[derive(Clone)]
struct Faulty {
    fault: Fault,
    sizes: Sizes,
    start: f32,
    count: f32,
    step: u32,
}

impl Faulty {
    fn new(fault: Fault) -> Self {
        let agents = if fault == Fault::NoAgents { 0 } else { 2 };
        let sizes_of = if fault == Fault::SizesOfOneAgent { 1 } else { agents };
        let sizes =
            Sizes { agents, obs_size: vec![3; sizes_of], n_actions: vec![3; agents], episode_limit: 5 };
        Self { fault, sizes, start: 0.0, count: 0.0, step: 0 }
    }
}

impl World for Faulty {
    fn sizes(&self) -> &Sizes {
        &self.sizes
    }

    fn reset(&mut self, rng: &mut dyn RngCore) {
        self.start = (rng.next_u32() % 100) as f32;
        self.step = 0;
        if self.fault != Fault::Memory {
            self.count = 0.0;
        }
    }

    fn step(&mut self, actions: &[u16], _: &mut dyn RngCore, rewards: &mut [f64]) -> End {
        let amount = |&action: &u16| match self.fault {
            Fault::ActionsAreAmounts => f32::from(action),
            _ => f32::from(u8::from((1..3).contains(&action))),
        };
        self.count += actions.iter().map(amount).sum::<f32>();
        self.step += 1;
        if self.fault != Fault::NoRewards {
            rewards.fill(f64::from(self.count));
        }
        match self.step {
            3 if self.fault == Fault::EarlyLimit => End::TimeLimit,
            5 if self.fault != Fault::NoEnd => End::TimeLimit,
            _ => End::Running,
        }
    }

    fn observe(&self, _: usize, out: &mut [f32]) {
        (out[0], out[1]) = (self.start, self.count);
        if self.fault != Fault::BlankObservation {
            out[2] = self.step as f32;
        }
    }

    fn available(&self, _: usize, out: &mut [u8]) {
        out.fill(match self.fault {
            Fault::NoActions => 0,
            Fault::OddMask => 2,
            _ => 1,
        });
    }

    fn scene(&self) -> Scene {
        let width = if self.fault == Fault::NoPicture { 0.0 } else { 1.0 };
        let background = envs::scene::Colour::PAPER;
        Scene { width, height: 1.0, background, shapes: vec![], caption: String::new() }
    }

    fn copy(&self) -> Box<dyn World> {
        let count = if self.fault == Fault::ForgetfulCopy { 0.0 } else { self.count };
        Box::new(Self { count, ..self.clone() })
    }
}

#[test]
fn a_broken_promise_is_named() {
    for (fault, complaint) in [
        (Fault::NoAgents, "expected agents and steps"),
        (Fault::SizesOfOneAgent, "expected a size from 1 to 65535 for each agent"),
        (Fault::BlankObservation, "not all are numbers"),
        (Fault::NoRewards, "not one for each agent"),
        (Fault::NoActions, "no action is available"),
        (Fault::OddMask, "not of 0 and 1"),
        (Fault::NoEnd, "Running after 5 steps, with a limit of 5"),
        (Fault::EarlyLimit, "TimeLimit after 3 steps, with a limit of 5"),
        (Fault::Memory, "an episode must depend on its chance alone"),
        (Fault::ForgetfulCopy, "a copy must go on like the world it is a copy of"),
        (Fault::ActionsAreAmounts, "actions 3 and 255 do not exist and must do the same"),
        (Fault::NoPicture, "a picture of 0 x 1"),
    ] {
        let world = Faulty::new(fault);
        let checked = catch_unwind(AssertUnwindSafe(|| check(&world, ChaCha8Rng::seed_from_u64)));
        let panic = checked.expect_err("a promise is broken");
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or(panic.downcast_ref::<&str>().copied()).expect("a text");
        assert!(text.contains(complaint), "{fault:?}: {text}");
    }
    check(&Faulty::new(Fault::None), ChaCha8Rng::seed_from_u64);
}
