//! Makes the algorithm that the configuration names.

use algos::iql::{self, Iql};
use algos::learner::Choice;
use algos::network::Kind;
use algos::ppo::{self, Ppo};
use algos::returns::EndOfBatch;
use algos::reward_stats::Standardisation;
use proto::config::{self, Algo, Config, FrozenMoments, PolicyTest, QLearning, RewardStandardisation};
use rand_chacha::ChaCha8Rng;

use crate::learner::{Algorithm, OffPolicy, OnPolicy};

/// The algorithm of a valid configuration for agent `id`, with initial weights from `rng`. `extra`: inputs after each
/// observation that the critic does not receive.
pub fn algorithm(
    config: &Config,
    id: u32,
    (obs_size, extra): (usize, usize),
    n_actions: usize,
    rng: &mut ChaCha8Rng,
) -> Box<dyn Algorithm> {
    match (&config.ppo, &config.q) {
        (Some(settings), _) => Box::new(OnPolicy {
            learner: Ppo::with_extra_inputs(ppo(config, settings), (obs_size, extra), n_actions, rng),
            in_tests: match settings.policy_test {
                PolicyTest::Sample => Choice::Sample,
                PolicyTest::Greedy => Choice::Greedy,
            },
        }),
        (None, Some(settings)) => {
            let learner = Iql::new(iql(config, settings), obs_size + extra, n_actions, rng);
            Box::new(OffPolicy::new(learner, settings.clone(), config.seed, id))
        }
        (None, None) => unreachable!("a valid configuration has the section of its learner"),
    }
}

/// PPO's settings.
fn ppo(config: &Config, ppo: &config::Ppo) -> ppo::Config {
    let algo = &config.algo;
    ppo::Config {
        actor: kind(algo),
        hidden: algo.hidden as usize,
        agents: config.world.agents as usize,
        gamma: algo.gamma as f32,
        epochs: ppo.epochs as usize,
        clip: ppo.clip as f32,
        entropy_coef: ppo.entropy_coef as f32,
        n_step: ppo.n_step as usize,
        target_update: algo.target_update,
        max_grad_norm: algo.max_grad_norm,
        end_of_batch: match ppo.end_of_batch {
            config::EndOfBatch::Epymarl => EndOfBatch::Epymarl,
            config::EndOfBatch::NoBootstrap => EndOfBatch::NoBootstrap,
            config::EndOfBatch::Benchmark2021 => EndOfBatch::Benchmark2021,
            config::EndOfBatch::Correct => EndOfBatch::Correct,
        },
        reward_standardisation: standardisation(algo),
        hold_frozen_moments: algo.frozen_moments == FrozenMoments::Hold,
    }
}

/// Q-learning's settings.
fn iql(config: &Config, q: &QLearning) -> iql::Config {
    let algo = &config.algo;
    iql::Config {
        network: kind(algo),
        hidden: algo.hidden as usize,
        agents: config.world.agents as usize,
        gamma: algo.gamma as f32,
        target_update: algo.target_update,
        max_grad_norm: algo.max_grad_norm,
        reward_standardisation: standardisation(algo),
        hold_frozen_moments: algo.frozen_moments == FrozenMoments::Hold,
        time_limit_is_terminal: q.time_limit_is_terminal,
        double_q: q.double,
    }
}

fn kind(algo: &Algo) -> Kind {
    match algo.network {
        config::Network::Fc => Kind::Fc,
        config::Network::Gru => Kind::Gru,
    }
}

fn standardisation(algo: &Algo) -> Standardisation {
    match algo.reward_standardisation {
        RewardStandardisation::Off => Standardisation::Off,
        RewardStandardisation::Running => Standardisation::Running,
        RewardStandardisation::Batch => Standardisation::Batch,
    }
}
