//! Steps per second of the worlds on one core: random actions, resets included, all agents observed. In battles the
//! actions are random available ones, chosen while the clock runs. Takes about ten seconds.

use std::time::{Duration, Instant};

use envs::{task, End};
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;

const TASKS: [&str; 7] = [
    "lbf-8x8-2p-2f-coop",
    "lbf-15x15-4p-3f",
    "rware-tiny-4ag",
    "rware-small-4ag",
    "mpe-simple-speaker-listener",
    "mpe-simple-adversary",
    "mpe-simple-tag",
];
const BATTLES: [&str; 5] =
    ["smaclite-3s_vs_5z", "smaclite-3s5z", "smaclite-mmm2", "smaclite-27m_vs_30m", "smaclite-2c_vs_64zg"];
/// Per task and measurement.
const TIME: Duration = Duration::from_millis(300);
/// Steps between two readings of the clock.
const BATCH: u32 = 10_000;
const BATTLE_STEPS: u32 = 500;

fn main() {
    for name in TASKS {
        let bare = steps_per_second(name, false);
        let observed = steps_per_second(name, true);
        println!("{name:27} {:6.2} M steps/s, {:6.2} M with observations", bare / 1e6, observed / 1e6);
        println!("{:27} {:6.2} M resets/s", "", resets_per_second(name) / 1e6);
    }
    for name in BATTLES {
        let bare = battle_steps_per_second(name, false);
        let observed = battle_steps_per_second(name, true);
        println!("{name:27} {:6.1} k steps/s, {:6.1} k with observations", bare / 1e3, observed / 1e3);
    }
}

fn battle_steps_per_second(name: &str, observing: bool) -> f64 {
    let mut world = task(name).expect("a listed task").make();
    let (agents, n_actions) = (world.sizes().agents, world.sizes().n_actions[0]);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut rewards, mut actions) = (vec![0.0; agents], vec![0; agents]);
    let (mut mask, mut seen) = (vec![0; n_actions], vec![0.0; world.sizes().obs_size[0]]);
    world.reset(&mut rng);
    let step = || {
        for (agent, action) in actions.iter_mut().enumerate() {
            world.available(agent, &mut mask);
            if observing {
                world.observe(agent, &mut seen);
                std::hint::black_box(&seen);
            }
            let open = mask.iter().filter(|&&entry| entry == 1).count();
            let choice = rng.next_u32() as usize % open;
            let mut available = (0..).zip(&mask).filter(|(_, &entry)| entry == 1);
            *action = available.nth(choice).expect("one of them").0;
        }
        if world.step(&actions, &mut rng, &mut rewards) != End::Running {
            world.reset(&mut rng);
        }
    };
    rate_of(BATTLE_STEPS, step)
}

fn steps_per_second(name: &str, observing: bool) -> f64 {
    let mut world = task(name).expect("a listed task").make();
    let sizes = world.sizes().clone();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut rewards = vec![0.0; sizes.agents];
    let mut seen: Vec<Vec<f32>> = sizes.obs_size.iter().map(|&size| vec![0.0; size]).collect();
    // Drawn beforehand, because only the world is measured.
    let n_actions = sizes.n_actions.iter().cycle();
    let n_actions = n_actions.take(BATCH as usize * sizes.agents);
    let actions: Vec<u16> = n_actions.map(|&n| (rng.next_u32() % n as u32) as u16).collect();
    world.reset(&mut rng);
    rate(|| {
        for actions in actions.chunks_exact(sizes.agents) {
            if world.step(actions, &mut rng, &mut rewards) != End::Running {
                world.reset(&mut rng);
            }
            if observing {
                for (agent, seen) in seen.iter_mut().enumerate() {
                    world.observe(agent, seen);
                    std::hint::black_box(seen);
                }
            }
        }
        std::hint::black_box(&rewards);
    })
}

fn resets_per_second(name: &str) -> f64 {
    let mut world = task(name).expect("a listed task").make();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    rate_of(BATCH, || world.reset(&mut rng))
}

/// How often per second something happens, with a look at the clock after so many times.
fn rate_of(times: u32, mut once: impl FnMut()) -> f64 {
    f64::from(times) / f64::from(BATCH) * rate(|| (0..times).for_each(|_| once()))
}

/// Events per second, where one call of `batch` makes [`BATCH`] of them.
fn rate(mut batch: impl FnMut()) -> f64 {
    let start = Instant::now();
    let mut batches = 0.0;
    while start.elapsed() < TIME {
        batch();
        batches += 1.0;
    }
    batches * f64::from(BATCH) / start.elapsed().as_secs_f64()
}
