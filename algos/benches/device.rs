//! Whole update calls of PPO on the kernels and on a GPU, over episodes of 50 steps, with the copies to and from the
//! GPU. Needs the feature `cuda`; without a GPU only the kernels are measured.
//!
//! ```text
//! cargo bench -p algos --features cuda --bench device
//! ```

use algos::device::DeviceName;
use algos::learner::{Learner, OnPolicy};
use algos::network::Kind;
use algos::ppo::{Config, Ppo};
use algos::returns::EndOfBatch;
use algos::reward_stats::Standardisation;
use algos::rollout::{End, Rollout};
use divan::counter::ItemsCount;
use divan::Bencher;
use rand_chacha::rand_core::SeedableRng;
use rand_chacha::ChaCha8Rng;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() {
    divan::main();
}

const OBS: usize = 70;
const ACTIONS: usize = 5;
const STEPS: usize = 50;

/// Episodes and hidden width.
const SIZES: [(usize, usize); 4] = [(10, 128), (100, 128), (1000, 128), (100, 512)];

fn learner(kind: Kind, hidden: usize) -> Ppo {
    let config = Config {
        actor: kind,
        hidden,
        agents: 2,
        gamma: 0.99,
        epochs: 4,
        clip: 0.2,
        entropy_coef: 0.001,
        n_step: 5,
        target_update: 0.01,
        max_grad_norm: 10.0,
        end_of_batch: EndOfBatch::Epymarl,
        reward_standardisation: Standardisation::Off,
        hold_frozen_moments: false,
    };
    Ppo::new(config, OBS, ACTIONS, &mut ChaCha8Rng::seed_from_u64(1))
}

fn rollout(episodes: usize) -> Rollout {
    let mut rollout = Rollout::default();
    rollout.begin(episodes);
    for copy in 0..episodes {
        for t in 0..=STEPS {
            let at = |k: usize| ((copy * STEPS + t) as f32 * 0.37 + k as f32).sin();
            rollout.observe(copy, &(0..OBS).map(at).collect::<Vec<_>>(), &[1; ACTIONS]);
            if t < STEPS {
                rollout.act(copy, ((copy + t) % ACTIONS) as u16);
                let end = if t + 1 == STEPS { End::TimeLimit } else { End::Running };
                rollout.outcome(copy, at(0), end);
            }
        }
    }
    rollout
}

fn update_call(bencher: Bencher, kind: Kind, (episodes, hidden): (usize, usize), device: DeviceName) {
    let opened = match device.open() {
        Ok(opened) => opened,
        Err(error) => return eprintln!("not measured: {error}"),
    };
    let (mut learner, rollout) = (learner(kind, hidden), rollout(episodes));
    learner.compute_on(&opened);
    bencher
        .counter(ItemsCount::new(episodes * STEPS))
        .bench_local(|| learner.update(rollout.episodes(), 1e-4));
    opened.check().expect("the GPU has computed everything");
}

#[divan::bench(args = SIZES)]
fn feed_forward_on_the_kernels(bencher: Bencher, size: (usize, usize)) {
    update_call(bencher, Kind::Fc, size, DeviceName::Cpu);
}

#[divan::bench(args = SIZES)]
fn recurrent_on_the_kernels(bencher: Bencher, size: (usize, usize)) {
    update_call(bencher, Kind::Gru, size, DeviceName::Cpu);
}

#[divan::bench(args = SIZES)]
fn feed_forward_on_a_gpu(bencher: Bencher, size: (usize, usize)) {
    update_call(bencher, Kind::Fc, size, DeviceName::Cuda(0));
}

#[divan::bench(args = SIZES)]
fn recurrent_on_a_gpu(bencher: Bencher, size: (usize, usize)) {
    update_call(bencher, Kind::Gru, size, DeviceName::Cuda(0));
}
