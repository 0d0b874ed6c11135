//! Default settings: the published ones (algorithms §9), and Rondo's choice where nothing is published.

use crate::config::{
    Algo, AlgoName, BusOptions, ClipScope, Config, Draws, EndOfBatch, FrozenMoments, Learner, Log, Network,
    Period, PolicyTest, Ppo, Profile, QLearning, Reward, RewardStandardisation, Save, Schedule, SwitchUnit,
    Test, Timescales, World,
};

/// Families of tasks that share their settings (algorithms §9.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Family {
    /// Level-based foraging.
    Lbf,
    /// The multi-robot warehouse.
    Rware,
    /// The multi-agent particle environment.
    Mpe,
    /// The StarCraft multi-agent challenge.
    Smac,
}

impl Family {
    pub const ALL: [Self; 4] = [Self::Lbf, Self::Rware, Self::Mpe, Self::Smac];

    /// The family whose task names begin with `name`. Worlds that are not in the paper get the settings of foraging.
    pub fn named(name: &str) -> Self {
        match name {
            "rware" => Self::Rware,
            "mpe" => Self::Mpe,
            "smaclite" => Self::Smac,
            _ => Self::Lbf,
        }
    }
}

/// Settings of a family for one kind of learner.
struct Row {
    hidden: u32,
    standardise_rewards: bool,
    network: Network,
    target_update: f64,
}

/// A [`Row`] with PPO's entropy coefficient and n-step.
struct PpoRow {
    row: Row,
    entropy_coef: f64,
    n_step: u32,
}

/// Width, reward standardisation, network, target update.
const fn row(hidden: u32, standardise_rewards: bool, network: Network, target_update: f64) -> Row {
    Row { hidden, standardise_rewards, network, target_update }
}

impl Family {
    /// The table of algorithms §9.1.
    fn ppo(self) -> PpoRow {
        let (row, entropy_coef, n_step) = match self {
            Self::Mpe => (row(128, true, Network::Fc, 0.01), 0.01, 10),
            Self::Smac => (row(64, true, Network::Fc, 0.01), 0.001, 10),
            Self::Lbf => (row(128, false, Network::Gru, 200.0), 0.001, 5),
            Self::Rware => (row(128, false, Network::Fc, 0.01), 0.001, 10),
        };
        PpoRow { row, entropy_coef, n_step }
    }

    /// The table of algorithms §9.2.
    fn q(self) -> Row {
        match self {
            Self::Mpe => row(128, true, Network::Fc, 0.01),
            Self::Smac => row(64, true, Network::Gru, 200.0),
            Self::Lbf => row(64, true, Network::Gru, 200.0),
            Self::Rware => row(64, true, Network::Fc, 0.01),
        }
    }

    fn row(self, learner: Learner) -> Row {
        match learner {
            Learner::Ppo => self.ppo().row,
            Learner::Q => self.q(),
        }
    }
}

/// Discount factor (algorithms §4.2).
const GAMMA: f64 = 0.99;
/// Passes over a batch (algorithms §4.2).
const EPOCHS: u32 = 4;
/// PPO's clip (algorithms §4.2).
const CLIP: f64 = 0.2;
/// Largest norm of a gradient (algorithms §4.2).
const MAX_GRAD_NORM: f64 = 10.0;
/// Environment copies, each with one episode of a batch (algorithms §2.3, §4.2).
const COPIES: u32 = 10;
/// Episodes in a test (algorithms §8.2).
const TEST_EPISODES: u32 = 100;
/// The middle one of the published periods (algorithms §9.3). Which was best is not published.
const SWITCH_PERIOD: u64 = 100;
/// Our choice: a lost process costs at most this many rounds, a few seconds of work. A round of Q-learning has one
/// episode, a round of PPO ten.
fn save_interval(learner: Learner) -> u64 {
    match learner {
        Learner::Ppo => 100,
        Learner::Q => 1_000,
    }
}
/// Our choice: 2,000 metric rows in 20 M environment steps.
const LOG_INTERVAL: u64 = 10_000;

/// Episodes that an agent stores (algorithms §5.1).
const BUFFER: u32 = 5_000;
/// Episodes in an update call (algorithms §5.1).
const BATCH: u32 = 32;
/// Environment steps until ε reaches its final value (algorithms §5.3). The paper does not give it; this is the value
/// of the reference's configurations without parameter sharing.
const EPSILON_ANNEAL: u64 = 50_000;
/// ε in tests (algorithms §5.3). The paper does not give it; this is the reference's value.
const TEST_EPSILON: f64 = 0.0;

/// Settings of both kinds of learner, in the default profile (algorithms §4.2, §9.1, §9.2).
pub fn algo_defaults(name: AlgoName, family: Family) -> Algo {
    let Row { hidden, network, target_update, .. } = family.row(name.learner());
    Algo {
        name,
        profile: Profile::Rondo,
        network,
        hidden,
        gamma: GAMMA,
        target_update,
        max_grad_norm: MAX_GRAD_NORM,
        clip_scope: ClipScope::PerAgent,
        reward_standardisation: standardisation(name, Profile::Rondo, family),
        frozen_moments: FrozenMoments::Update,
        agent_id_input: false,
        last_action_input: false,
    }
}

/// PPO's own settings in the default profile (algorithms §4.2, §9.1).
pub fn ppo_defaults(family: Family) -> Ppo {
    let PpoRow { entropy_coef, n_step, .. } = family.ppo();
    Ppo {
        epochs: EPOCHS,
        clip: CLIP,
        entropy_coef,
        n_step,
        end_of_batch: end_of_batch(Profile::Rondo),
        policy_test: PolicyTest::Sample,
    }
}

/// Q-learning's own settings, the same in all families (algorithms §5, §9.2).
pub fn q_defaults() -> QLearning {
    QLearning {
        buffer: BUFFER,
        batch: BATCH,
        draws: Draws::Joint,
        double: true,
        epsilon_start: 1.0,
        epsilon_finish: 0.05,
        epsilon_anneal: EPSILON_ANNEAL,
        test_epsilon: TEST_EPSILON,
        time_limit_is_terminal: true,
    }
}

/// Sets the profile's name and the keys in which the profiles differ (algorithms §11).
pub fn apply_profile(config: &mut Config, profile: Profile, family: Family) {
    config.algo.profile = profile;
    config.algo.reward_standardisation = standardisation(config.algo.name, profile, family);
    if let Some(ppo) = &mut config.ppo {
        ppo.end_of_batch = end_of_batch(profile);
    }
}

/// The reference bootstraps after the end of an episode, and foraging teams unlearn by it. So the default differs from
/// the reference here.
pub fn end_of_batch(profile: Profile) -> EndOfBatch {
    match profile {
        Profile::Rondo => EndOfBatch::Correct,
        Profile::Epymarl => EndOfBatch::Epymarl,
        Profile::Benchmark2021 => EndOfBatch::Benchmark2021,
    }
}

fn standardisation(name: AlgoName, profile: Profile, family: Family) -> RewardStandardisation {
    match (family.row(name.learner()).standardise_rewards, profile) {
        (false, _) => RewardStandardisation::Off,
        (true, Profile::Rondo | Profile::Epymarl) => RewardStandardisation::Running,
        (true, Profile::Benchmark2021) => RewardStandardisation::Batch,
    }
}

/// The published grid of learning rates, ascending; their number is odd (algorithms §9.3).
///
/// The smallest rate of Q-learning in foraging is printed as 3.7e-5, presumably 3.75e-5 rounded; we take the latter.
pub fn rate_grid(learner: Learner, family: Family) -> &'static [f64] {
    match (learner, family) {
        (Learner::Ppo, Family::Mpe | Family::Lbf) => &[1.25e-5, 2.5e-5, 5e-5, 1e-4, 2e-4, 4e-4, 8e-4],
        (Learner::Q, Family::Lbf) => &[3.75e-5, 7.5e-5, 1.5e-4, 3e-4, 6e-4, 1.2e-3, 2.4e-3],
        (_, Family::Rware) | (Learner::Q, Family::Mpe) => &[6.25e-5, 1.25e-4, 2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3],
        (_, Family::Smac) => &[1.25e-4, 2.5e-4, 5e-4, 1e-3, 2e-3],
    }
}

/// The rates `(fast, slow)` to start from.
///
/// Independent learning takes the centre `c` of the published grid, which is the benchmark's rate (algorithms §9.3).
/// Sequential learning takes it for the one agent that learns. Which pairs were best for multi-timescale learning is
/// not published. Our choice is `2c` for the fast agent, and for the `n − 1` slow ones the rate that keeps the
/// geometric mean of the team at `c`, for a team of any size:
///
/// ```text
/// 2c · (c · 2^(−1/(n−1)))^(n−1) = c^n
/// ```
///
/// With a slow rate of `c/2` for every team size, the mean of ten agents would be `0.57 c`. The slow rate is on the
/// grid for a team of two only.
pub fn default_rates(name: AlgoName, family: Family, agents: u32) -> (f64, f64) {
    let grid = rate_grid(name.learner(), family);
    let centre = grid[grid.len() / 2];
    match name.timescales() {
        Timescales::One => (centre, centre),
        Timescales::Many if agents < 2 => (centre, centre),
        Timescales::Many => (2.0 * centre, centre * (-1.0 / f64::from(agents - 1)).exp2()),
        Timescales::OneAtATime => (centre, 0.0),
    }
}

/// The paper's pattern: agent 0 begins at the fast rate, all others at the slow one (algorithms §6.1). A team of one
/// has one rate.
pub fn default_schedule(name: AlgoName, family: Family, agents: u32) -> Schedule {
    let (fast, slow) = default_rates(name, family, agents);
    let rates = if agents > 1 { vec![fast, slow] } else { vec![fast] };
    Schedule {
        rates,
        levels: (0..agents).map(|agent| agent.min(1)).collect(),
        switch_period: Period::Every(SWITCH_PERIOD),
        switch_unit: SwitchUnit::UpdateCall,
    }
}

/// Environment steps of a run (algorithms §8.1). Off-policy learners get a tenth, so that the number of update calls
/// is the same.
pub fn budget(learner: Learner, family: Family) -> u64 {
    let off_policy = match family {
        Family::Lbf | Family::Mpe => 2_000_000,
        Family::Rware | Family::Smac => 4_000_000,
    };
    match learner {
        Learner::Ppo => 10 * off_policy,
        Learner::Q => off_policy,
    }
}

/// Tests as published: 41 in a run, the first at its beginning (algorithms §8.1, §8.2).
pub fn default_test(learner: Learner, family: Family) -> Test {
    Test { interval: budget(learner, family) / 40, episodes: TEST_EPISODES }
}

/// A complete experiment with the published settings; seed 1, and the transport that carries messages of any size.
pub fn config(run: &str, task: &str, agents: u32, name: AlgoName, family: Family) -> Config {
    let learner = name.learner();
    let (ppo, q, copies) = match learner {
        Learner::Ppo => (Some(ppo_defaults(family)), None, COPIES),
        // One environment, one episode at a time (algorithms §2.3).
        Learner::Q => (None, Some(q_defaults()), 1),
    };
    Config {
        run: run.to_owned(),
        seed: 1,
        t_max: budget(learner, family),
        world: World {
            task: task.to_owned(),
            agents,
            copies,
            map: None,
            opponent: "builtin".to_owned(),
            pad: false,
            reward: Reward::Sum,
        },
        algo: algo_defaults(name, family),
        ppo,
        q,
        schedule: default_schedule(name, family, agents),
        test: default_test(learner, family),
        save: Save { interval: save_interval(learner) },
        log: Log { interval: LOG_INTERVAL },
        bus: BusOptions { low_latency: false },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_a_valid_configuration() {
        for name in AlgoName::ALL {
            for family in Family::ALL {
                for agents in [1, 2, 10, 25, 26, 64, 100, 1_000] {
                    assert_eq!(config("r", "t", agents, name, family).validate(), Ok(()));
                }
            }
        }
    }

    /// Network, width, reward standardisation, target update of every family: the tables of the appendix.
    fn table(name: AlgoName) -> [(Network, u32, bool, f64); 4] {
        [Family::Mpe, Family::Smac, Family::Lbf, Family::Rware].map(|family| {
            let algo = algo_defaults(name, family);
            let standardises = algo.reward_standardisation == RewardStandardisation::Running;
            (algo.network, algo.hidden, standardises, algo.target_update)
        })
    }

    #[test]
    fn ppo_has_the_settings_of_the_appendix() {
        use Network::{Fc, Gru};
        let expected =
            [(Fc, 128, true, 0.01), (Fc, 64, true, 0.01), (Gru, 128, false, 200.0), (Fc, 128, false, 0.01)];
        assert_eq!(table(AlgoName::Mtppo), expected);
        let own = [Family::Mpe, Family::Smac, Family::Lbf, Family::Rware].map(ppo_defaults);
        assert_eq!(own.clone().map(|ppo| ppo.entropy_coef), [0.01, 0.001, 0.001, 0.001]);
        assert_eq!(own.clone().map(|ppo| ppo.n_step), [10, 10, 5, 10]);
        assert!(own.iter().all(|ppo| (ppo.clip, ppo.epochs) == (0.2, 4)));
        let algo = algo_defaults(AlgoName::Ippo, Family::Lbf);
        assert_eq!((algo.gamma, algo.max_grad_norm), (0.99, 10.0));
    }

    #[test]
    fn q_learning_has_the_settings_of_the_appendix() {
        use Network::{Fc, Gru};
        let expected =
            [(Fc, 128, true, 0.01), (Gru, 64, true, 200.0), (Gru, 64, true, 200.0), (Fc, 64, true, 0.01)];
        assert_eq!(table(AlgoName::Mtql), expected);
        let config = config("r", "t", 2, AlgoName::Iql, Family::Lbf);
        let q = config.q.expect("its own section");
        assert_eq!((config.world.copies, q.buffer, q.batch, q.epsilon_anneal), (1, 5_000, 32, 50_000));
        assert_eq!((q.epsilon_start, q.epsilon_finish, q.test_epsilon), (1.0, 0.05, 0.0));
        assert_eq!(q.draws, Draws::Joint);
        assert!(q.double && q.time_limit_is_terminal && config.ppo.is_none());
    }

    #[test]
    fn no_default_counts_on_after_an_episode_is_over() {
        for family in Family::ALL {
            assert_eq!(ppo_defaults(family).end_of_batch, EndOfBatch::Correct, "{family:?}");
            for name in AlgoName::ALL {
                let ppo = config("r", "t", 2, name, family).ppo;
                assert!(ppo.is_none_or(|ppo| ppo.end_of_batch == EndOfBatch::Correct), "{name} {family:?}");
            }
        }
    }

    #[test]
    fn the_profiles_differ_in_rewards_and_in_the_end_of_a_batch_only() {
        for family in Family::ALL {
            for name in [AlgoName::Ippo, AlgoName::Iql] {
                let ours = config("r", "t", 2, name, family);
                assert_eq!(ours.algo.profile, Profile::Rondo);
                let batch = match ours.algo.reward_standardisation {
                    RewardStandardisation::Running => RewardStandardisation::Batch,
                    _ => RewardStandardisation::Off,
                };
                let mut config = ours.clone();
                for (profile, standardisation, rule) in [
                    (Profile::Epymarl, ours.algo.reward_standardisation, EndOfBatch::Epymarl),
                    (Profile::Benchmark2021, batch, EndOfBatch::Benchmark2021),
                ] {
                    apply_profile(&mut config, profile, family);
                    let mut expected = ours.clone();
                    expected.algo.profile = profile;
                    expected.algo.reward_standardisation = standardisation;
                    expected.ppo.iter_mut().for_each(|ppo| ppo.end_of_batch = rule);
                    assert_eq!(config, expected);
                }
                apply_profile(&mut config, Profile::Rondo, family);
                assert_eq!(config, ours);
            }
        }
    }

    #[test]
    fn neighbours_on_the_grid_differ_by_a_factor_of_two_and_the_centre_is_the_benchmarks_rate() {
        for (learner, family, centre) in [
            (Learner::Ppo, Family::Mpe, 1e-4),
            (Learner::Ppo, Family::Lbf, 1e-4),
            (Learner::Ppo, Family::Rware, 5e-4),
            (Learner::Ppo, Family::Smac, 5e-4),
            (Learner::Q, Family::Mpe, 5e-4),
            (Learner::Q, Family::Lbf, 3e-4),
            (Learner::Q, Family::Rware, 5e-4),
            (Learner::Q, Family::Smac, 5e-4),
        ] {
            let grid = rate_grid(learner, family);
            assert_eq!(grid[grid.len() / 2], centre);
            for pair in grid.windows(2) {
                assert!((pair[1] / pair[0] - 2.0).abs() < 1e-12, "{pair:?}");
            }
        }
    }

    #[test]
    fn the_default_rates_make_each_algorithm_what_its_name_says() {
        for agents in [2, 10] {
            assert_eq!(default_rates(AlgoName::Ippo, Family::Lbf, agents), (1e-4, 1e-4));
            assert_eq!(default_rates(AlgoName::Sppo, Family::Rware, agents), (5e-4, 0.0));
            assert_eq!(default_rates(AlgoName::Sql, Family::Mpe, agents), (5e-4, 0.0));
        }
        assert_eq!(default_rates(AlgoName::Mtppo, Family::Lbf, 2), (2e-4, 5e-5));
        assert_eq!(default_rates(AlgoName::Mtql, Family::Lbf, 2), (6e-4, 1.5e-4));
        let schedule = default_schedule(AlgoName::Mtppo, Family::Smac, 3);
        assert_eq!((schedule.rates, schedule.levels), (vec![1e-3, 5e-4 * 0.5_f64.sqrt()], vec![0, 1, 1]));
    }

    #[test]
    fn a_team_of_any_size_has_the_geometric_mean_rate_of_an_independent_one() {
        for (name, independent) in [(AlgoName::Mtppo, AlgoName::Ippo), (AlgoName::Mtql, AlgoName::Iql)] {
            for family in Family::ALL {
                for agents in [1, 2, 3, 4, 10, 64] {
                    let centre = default_rates(independent, family, agents).0;
                    let schedule = default_schedule(name, family, agents);
                    let rate_of = |&level: &u32| schedule.rates[level as usize] / centre;
                    let product: f64 = schedule.levels.iter().map(rate_of).product();
                    assert!((product - 1.0).abs() < 1e-12, "{name} {family:?} {agents}: {product}");
                    assert!(agents == 1 || schedule.rates[0] == 2.0 * centre, "{name} {family:?} {agents}");
                }
            }
        }
    }

    #[test]
    fn a_run_has_forty_test_intervals_and_as_many_update_calls_with_either_learner() {
        let of = |learner, family| (budget(learner, family), default_test(learner, family).interval);
        assert_eq!(of(Learner::Ppo, Family::Lbf), (20_000_000, 500_000));
        assert_eq!(of(Learner::Q, Family::Lbf), (2_000_000, 50_000));
        assert_eq!(of(Learner::Ppo, Family::Rware), (40_000_000, 1_000_000));
        assert_eq!(of(Learner::Q, Family::Rware), (4_000_000, 100_000));
        assert_eq!(default_test(Learner::Q, Family::Mpe).episodes, 100);
        // 80,000 update calls in the particle worlds, whose episodes have 25 steps (algorithms §12, check 7).
        let calls = [Learner::Ppo, Learner::Q].map(|learner| {
            let copies = config(
                "r",
                "t",
                2,
                if learner == Learner::Q { AlgoName::Iql } else { AlgoName::Ippo },
                Family::Mpe,
            )
            .world
            .copies;
            budget(learner, Family::Mpe) / (25 * u64::from(copies))
        });
        assert_eq!(calls, [80_000, 80_000]);
    }
}
