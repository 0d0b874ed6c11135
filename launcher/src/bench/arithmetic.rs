//! The arithmetic of an environment step of training, and the peak of this machine.

use std::time::{Duration, Instant};

use algos::kernels::gemm::{product, Matrix};
use proto::config::{Config, Network};

/// Floating-point operations of training per environment step, for all agents together: only the matrix products of
/// the algorithm, with two operations for each multiply-add.
///
/// ```text
/// PPO  acting: actor forward;  update: target critic forward, epochs × (actor and critic, forward and backward)
/// Q    acting: forward;        update: a minibatch for each episode: target forward, forward and backward
/// ```
///
/// A backward pass counts as two forward passes.
pub fn flops_per_env_step(config: &Config, sizes: &envs::Sizes) -> f64 {
    let agents = sizes.obs_size.iter().zip(&sizes.n_actions);
    let multiply_adds: f64 = agents
        .map(|(&inputs, &outputs)| {
            let network = multiply_adds(config.algo.network, inputs, config.algo.hidden, outputs);
            match (&config.ppo, &config.q) {
                (Some(ppo), _) => {
                    let critic = multiply_adds(Network::Fc, inputs, config.algo.hidden, 1);
                    network + critic + f64::from(ppo.epochs) * 3.0 * (network + critic)
                }
                (None, Some(q)) => network + f64::from(q.batch) * (1.0 + 3.0) * network,
                (None, None) => unreachable!("a valid configuration has the section of its learner"),
            }
        })
        .sum();
    2.0 * multiply_adds
}

/// Multiply-adds of one row through a network (algorithms §1.1).
fn multiply_adds(network: Network, inputs: usize, hidden: u32, outputs: usize) -> f64 {
    let (i, h, o) = (inputs as f64, f64::from(hidden), outputs as f64);
    let middle = match network {
        Network::Fc => h * h,
        Network::Gru => 6.0 * h * h,
    };
    i * h + middle + h * o
}

/// Operations per second of single-precision matrix products: on one core, and on `cores` at once. The best of several
/// tries, because other work on the machine can only slow it down.
pub fn peak_flops(cores: usize) -> (f64, f64) {
    const TRIES: usize = 5;
    let together = || {
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..cores).map(|_| scope.spawn(peak_of_a_core)).collect();
            threads.into_iter().map(|thread| thread.join().expect("products do not panic")).sum()
        })
    };
    let best = |peak: &dyn Fn() -> f64| (0..TRIES).map(|_| peak()).fold(0.0, f64::max);
    (best(&peak_of_a_core), best(&together))
}

/// The best of many products of 1024 × 1024 matrices within some time.
fn peak_of_a_core() -> f64 {
    const N: usize = 1024;
    const TIME: Duration = Duration::from_millis(300);
    let (a, b) = (vec![1.0; N * N], vec![0.5; N * N]);
    let mut c = vec![0.0; N * N];
    let (begin, mut best) = (Instant::now(), 0.0_f64);
    while begin.elapsed() < TIME {
        let start = Instant::now();
        product(&mut c, Matrix::new(&a, N, N), Matrix::new(&b, N, N));
        best = best.max(2.0 * (N as f64).powi(3) / start.elapsed().as_secs_f64());
    }
    best
}

#[cfg(test)]
mod tests {
    use proto::config::AlgoName;
    use proto::presets::{self, Family};

    use super::*;

    fn flops(name: AlgoName, family: Family, obs_size: usize, n_actions: usize) -> f64 {
        let config = presets::config("bench", "task", 1, name, family);
        let sizes = envs::Sizes {
            agents: 1,
            obs_size: vec![obs_size],
            n_actions: vec![n_actions],
            episode_limit: 50,
        };
        flops_per_env_step(&config, &sizes)
    }

    #[test]
    fn the_arithmetic_of_a_step_is_that_computed_by_hand() {
        // Actor 20·128 + 128² + 128·5 = 19,584, critic 20·128 + 128² + 128 = 19,072 multiply-adds:
        // 2 (19,584 + 19,072 + 4 · 3 · 38,656)
        assert_eq!(flops(AlgoName::Ippo, Family::Mpe, 20, 5), 1_005_056.0);
        // Actor 12·128 + 6·128² + 128·6 = 100,608, critic 12·128 + 128² + 128 = 18,048.
        assert_eq!(flops(AlgoName::Ippo, Family::Lbf, 12, 6), 3_085_056.0);
        // 12·64 + 6·64² + 64·6 = 25,728 multiply-adds, 32 · 4 times, and once more to act.
        assert_eq!(flops(AlgoName::Iql, Family::Lbf, 12, 6), 6_637_824.0);
    }
}
