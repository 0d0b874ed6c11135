//! Whole update calls: batch layout, forward and backward passes, losses, clipping and Adam. Items are the
//! floating-point operations of the matrix products only, so items per second compare with those of `matrix_product`
//! in the `kernels` bench, the machine's peak.
//!
//! ```text
//! cargo bench -p algos --bench updates
//! ```

use algos::iql::{self, Iql};
use algos::network::{Kind, Network};
use algos::ppo::{self, Ppo};
use algos::returns::EndOfBatch;
use algos::reward_stats::Standardisation;
use algos::rollout::{End, Rollout};
use divan::counter::ItemsCount;
use divan::{black_box, Bencher};
use rand_chacha::rand_core::SeedableRng;
use rand_chacha::ChaCha8Rng;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() {
    divan::main();
}

/// The episodes of one update call, all of one length.
struct Task {
    obs_size: usize,
    n_actions: usize,
    length: usize,
}

const SPEAKER_LISTENER: Task = Task { obs_size: 11, n_actions: 5, length: 25 };
const TAG: Task = Task { obs_size: 16, n_actions: 5, length: 25 };
const FORAGING: Task = Task { obs_size: 12, n_actions: 6, length: 50 };
const WAREHOUSE: Task = Task { obs_size: 71, n_actions: 5, length: 500 };

impl Task {
    fn episodes(&self, count: usize) -> Rollout {
        let mut rollout = Rollout::default();
        rollout.begin(count);
        for k in 0..count {
            for t in 0..=self.length {
                let obs: Vec<f32> =
                    (0..self.obs_size).map(|i| ((k * 31 + t * 7 + i) as f32 * 0.37).sin()).collect();
                rollout.observe(k, &obs, &vec![1; self.n_actions]);
                if t < self.length {
                    rollout.act(k, ((k + t) % self.n_actions) as u16);
                    let end = if t + 1 == self.length { End::TimeLimit } else { End::Running };
                    rollout.outcome(k, ((k + 3 * t) as f32).cos(), end);
                }
            }
        }
        rollout
    }

    fn network(&self, kind: Kind, hidden: usize) -> Network {
        Network { kind, inputs: self.obs_size, hidden, outputs: self.n_actions }
    }
}

/// Operations of a forward pass of one row, and of its backward pass without the gradient of the observation.
fn flops(network: &Network) -> (usize, usize) {
    let h = network.hidden;
    let middle = if network.kind == Kind::Fc { 1 } else { 6 };
    let (first, rest) = (network.inputs * h, middle * h * h + h * network.outputs);
    (2 * (first + rest), 2 * (first + 2 * rest))
}

fn ppo(bencher: Bencher, task: &Task, kind: Kind, episodes: usize) {
    let config = ppo::Config {
        actor: kind,
        hidden: 128,
        agents: 3,
        gamma: 0.99,
        epochs: 4,
        clip: 0.2,
        entropy_coef: 0.01,
        n_step: 5,
        target_update: 0.01,
        max_grad_norm: 10.0,
        end_of_batch: EndOfBatch::Epymarl,
        reward_standardisation: Standardisation::Running,
        hold_frozen_moments: false,
    };
    let (actor, critic) = (task.network(kind, 128), Network { outputs: 1, ..task.network(Kind::Fc, 128) });
    let ((actor_forward, actor_backward), (forward, backward)) = (flops(&actor), flops(&critic));
    let rows = episodes * task.length;
    let count = rows * (config.epochs * (actor_forward + actor_backward + forward + backward) + forward);
    let rollout = task.episodes(episodes);
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    let mut learner = Ppo::new(config, task.obs_size, task.n_actions, rng);
    bencher
        .counter(ItemsCount::new(count))
        .bench_local(|| learner.update(black_box(rollout.episodes()), 1e-5));
}

fn iql(bencher: Bencher, task: &Task, kind: Kind, hidden: usize) {
    let config = iql::Config {
        network: kind,
        hidden,
        agents: 3,
        gamma: 0.99,
        target_update: 0.01,
        max_grad_norm: 10.0,
        reward_standardisation: Standardisation::Running,
        hold_frozen_moments: false,
        time_limit_is_terminal: true,
        double_q: true,
    };
    let (forward, backward) = flops(&task.network(kind, hidden));
    let count = 32 * (task.length + 1) * (2 * forward + backward);
    let rollout = task.episodes(32);
    let rng = &mut ChaCha8Rng::seed_from_u64(1);
    let mut learner = Iql::new(config, task.obs_size, task.n_actions, rng);
    bencher
        .counter(ItemsCount::new(count))
        .bench_local(|| learner.update(black_box(rollout.episodes()), 1e-5));
}

/// Episodes of 25 steps: 200 make 5,000 rows.
#[divan::bench(args = [10, 200])]
fn ppo_fc_speaker_listener(bencher: Bencher, episodes: usize) {
    ppo(bencher, &SPEAKER_LISTENER, Kind::Fc, episodes);
}

#[divan::bench(args = [10, 64, 200, 1024])]
fn ppo_fc_tag(bencher: Bencher, episodes: usize) {
    ppo(bencher, &TAG, Kind::Fc, episodes);
}

/// Episodes of 50 steps.
#[divan::bench(args = [10, 64, 1024])]
fn ppo_gru_foraging(bencher: Bencher, episodes: usize) {
    ppo(bencher, &FORAGING, Kind::Gru, episodes);
}

/// 32 episodes of 25 steps.
#[divan::bench(args = [128])]
fn iql_fc_tag(bencher: Bencher, hidden: usize) {
    iql(bencher, &TAG, Kind::Fc, hidden);
}

/// 32 episodes of 500 steps.
#[divan::bench(args = [64])]
fn iql_fc_warehouse(bencher: Bencher, hidden: usize) {
    iql(bencher, &WAREHOUSE, Kind::Fc, hidden);
}

/// 32 episodes of 50 steps.
#[divan::bench(args = [64, 128])]
fn iql_gru_foraging(bencher: Bencher, hidden: usize) {
    iql(bencher, &FORAGING, Kind::Gru, hidden);
}
