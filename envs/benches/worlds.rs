//! Steps per second of the worlds on one core: random actions, resets included, all agents observed. Takes
//! about seven seconds.

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
/// Per task and measurement.
const TIME: Duration = Duration::from_millis(300);
/// Steps between two readings of the clock.
const BATCH: u32 = 10_000;

fn main() {
    for name in TASKS {
        let bare = steps_per_second(name, false);
        let observed = steps_per_second(name, true);
        println!("{name:27} {:6.2} M steps/s, {:6.2} M with observations", bare / 1e6, observed / 1e6);
        println!("{:27} {:6.2} M resets/s", "", resets_per_second(name) / 1e6);
    }
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
    rate(|| {
        for _ in 0..BATCH {
            world.reset(&mut rng);
        }
    })
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
