//! The published settings (spec §9) as a place to start from.

use crate::config::{
    Algo, AlgoName, BusOptions, ClipScope, Config, EndOfBatch, FrozenMoments, Log, Network, Period, Profile,
    RewardStandardisation, Save, Schedule, SwitchUnit, Test, World,
};

/// Families of tasks that share their settings (spec §9.1).
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

    /// The family whose tasks' names begin so. Worlds that the paper does not have are treated like foraging.
    pub fn named(name: &str) -> Self {
        match name {
            "rware" => Self::Rware,
            "mpe" => Self::Mpe,
            "smac" => Self::Smac,
            _ => Self::Lbf,
        }
    }
}

/// A row of spec §9.1.
struct Row {
    hidden: u32,
    standardise_rewards: bool,
    network: Network,
    entropy_coef: f64,
    target_update: f64,
    n_step: u32,
}

/// Spec §9.1.
const LBF: Row = Row {
    hidden: 128,
    standardise_rewards: false,
    network: Network::Gru,
    entropy_coef: 0.001,
    target_update: 200.0,
    n_step: 5,
};

/// Spec §9.1.
const RWARE: Row = Row {
    hidden: 128,
    standardise_rewards: false,
    network: Network::Fc,
    entropy_coef: 0.001,
    target_update: 0.01,
    n_step: 10,
};

/// Spec §9.1.
const MPE: Row = Row {
    hidden: 128,
    standardise_rewards: true,
    network: Network::Fc,
    entropy_coef: 0.01,
    target_update: 0.01,
    n_step: 10,
};

/// Spec §9.1.
const SMAC: Row = Row {
    hidden: 64,
    standardise_rewards: true,
    network: Network::Fc,
    entropy_coef: 0.001,
    target_update: 0.01,
    n_step: 10,
};

impl Family {
    fn row(self) -> &'static Row {
        match self {
            Self::Lbf => &LBF,
            Self::Rware => &RWARE,
            Self::Mpe => &MPE,
            Self::Smac => &SMAC,
        }
    }
}

/// Spec §4.2: discount factor.
const GAMMA: f64 = 0.99;
/// Spec §4.2: passes over a batch.
const EPOCHS: u32 = 4;
/// Spec §4.2: PPO's clip.
const CLIP: f64 = 0.2;
/// Spec §4.2: bound on the norm of the gradient.
const MAX_GRAD_NORM: f64 = 10.0;
/// Spec §2.3, §4.2: environment copies, which are the episodes of a batch.
const COPIES: u32 = 10;
/// Spec §8.2: episodes in a test.
const TEST_EPISODES: u32 = 100;
/// One of the published periods (spec §9.3); which of them was best is not published, so we take the middle one.
const SWITCH_PERIOD: u64 = 100;
/// Our choice: a lost process costs at most this many rounds, a few seconds of work.
const SAVE_INTERVAL: u64 = 100;
/// Our choice: 2,000 metric rows in 20 M environment steps.
const LOG_INTERVAL: u64 = 10_000;

/// The algorithm's settings for a family of tasks, in profile `epymarl` (spec §9.1, §4.2).
pub fn algo_defaults(name: AlgoName, family: Family) -> Algo {
    let row = family.row();
    let mut algo = Algo {
        name,
        profile: Profile::Epymarl,
        network: row.network,
        hidden: row.hidden,
        gamma: GAMMA,
        epochs: EPOCHS,
        clip: CLIP,
        entropy_coef: row.entropy_coef,
        n_step: row.n_step,
        target_update: row.target_update,
        max_grad_norm: MAX_GRAD_NORM,
        clip_scope: ClipScope::PerAgent,
        end_of_batch: EndOfBatch::Epymarl,
        reward_standardisation: RewardStandardisation::Off,
        frozen_moments: FrozenMoments::Update,
    };
    apply_profile(&mut algo, Profile::Epymarl, family);
    algo
}

/// Sets the keys in which the profiles differ (spec §11), and the profile's name.
pub fn apply_profile(algo: &mut Algo, profile: Profile, family: Family) {
    let (standardise, end_of_batch) = match profile {
        Profile::Epymarl => (RewardStandardisation::Running, EndOfBatch::Epymarl),
        Profile::Benchmark2021 => (RewardStandardisation::Batch, EndOfBatch::Benchmark2021),
    };
    algo.profile = profile;
    algo.end_of_batch = end_of_batch;
    algo.reward_standardisation =
        if family.row().standardise_rewards { standardise } else { RewardStandardisation::Off };
}

/// The published grid of learning rates, ascending, an odd number of them (spec §9.3).
pub fn rate_grid(family: Family) -> &'static [f64] {
    match family {
        Family::Mpe | Family::Lbf => &[1.25e-5, 2.5e-5, 5e-5, 1e-4, 2e-4, 4e-4, 8e-4],
        Family::Rware => &[6.25e-5, 1.25e-4, 2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3],
        Family::Smac => &[1.25e-4, 2.5e-4, 5e-4, 1e-3, 2e-3],
    }
}

/// The rates `(fast, slow)` to start from, all on the published grid (spec §9.3).
///
/// Independent learning takes the grid's centre, which is the benchmark's rate; sequential learning takes it for
/// the one agent that learns. Which pairs were best for multi-timescale learning is not published: a factor of two
/// to each side of the centre is our choice.
pub fn default_rates(name: AlgoName, family: Family) -> (f64, f64) {
    let grid = rate_grid(family);
    let centre = grid.len() / 2;
    match name {
        AlgoName::Ippo => (grid[centre], grid[centre]),
        AlgoName::Mtppo => (grid[centre + 1], grid[centre - 1]),
        AlgoName::Sppo => (grid[centre], 0.0),
    }
}

/// The paper's pattern: agent 0 begins at the fast rate, all others at the slow one (spec §6.1). A team of one has
/// the fast rate alone.
pub fn default_schedule(name: AlgoName, family: Family, agents: u32) -> Schedule {
    let (fast, slow) = default_rates(name, family);
    let rates = if agents > 1 { vec![fast, slow] } else { vec![fast] };
    Schedule {
        rates,
        levels: (0..agents).map(|agent| agent.min(1)).collect(),
        switch_period: Period::Every(SWITCH_PERIOD),
        switch_unit: SwitchUnit::UpdateCall,
    }
}

/// Environment steps of a run of an on-policy algorithm (spec §8.1).
pub fn budget(family: Family) -> u64 {
    match family {
        Family::Lbf | Family::Mpe => 20_000_000,
        Family::Rware | Family::Smac => 40_000_000,
    }
}

/// Tests as published: 41 in a run, the first at its beginning (spec §8.1, §8.2).
pub fn default_test(family: Family) -> Test {
    Test { interval: budget(family) / 40, episodes: TEST_EPISODES }
}

/// A complete experiment with the published settings; seed 1, and the transport that carries messages of any size.
pub fn config(run: &str, task: &str, agents: u32, name: AlgoName, family: Family) -> Config {
    Config {
        run: run.to_owned(),
        seed: 1,
        t_max: budget(family),
        world: World { task: task.to_owned(), agents, copies: COPIES },
        algo: algo_defaults(name, family),
        schedule: default_schedule(name, family, agents),
        test: default_test(family),
        save: Save { interval: SAVE_INTERVAL },
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
                for agents in [1, 2, 10, 25] {
                    assert_eq!(config("r", "t", agents, name, family).validate(), Ok(()));
                }
            }
        }
    }

    #[test]
    fn foraging_has_the_settings_of_the_appendix() {
        let algo = algo_defaults(AlgoName::Mtppo, Family::Lbf);
        assert_eq!((algo.network, algo.hidden, algo.n_step), (Network::Gru, 128, 5));
        assert_eq!((algo.entropy_coef, algo.target_update), (0.001, 200.0));
        assert_eq!((algo.clip, algo.epochs, algo.gamma, algo.max_grad_norm), (0.2, 4, 0.99, 10.0));
        assert_eq!(algo.reward_standardisation, RewardStandardisation::Off);
    }

    #[test]
    fn the_profiles_differ_in_rewards_and_in_the_end_of_a_batch_only() {
        for family in Family::ALL {
            let epymarl = algo_defaults(AlgoName::Ippo, family);
            let mut benchmark = epymarl.clone();
            apply_profile(&mut benchmark, Profile::Benchmark2021, family);
            let standardises = matches!(family, Family::Mpe | Family::Smac);
            let expected =
                if standardises { RewardStandardisation::Batch } else { RewardStandardisation::Off };
            assert_eq!(benchmark.reward_standardisation, expected);
            assert_eq!(benchmark.end_of_batch, EndOfBatch::Benchmark2021);
            assert_eq!(benchmark.profile, Profile::Benchmark2021);
            apply_profile(&mut benchmark, Profile::Epymarl, family);
            assert_eq!(benchmark, epymarl);
        }
    }

    #[test]
    fn neighbours_on_the_grid_differ_by_a_factor_of_two_and_the_centre_is_the_benchmarks_rate() {
        for (family, centre) in
            [(Family::Mpe, 1e-4), (Family::Lbf, 1e-4), (Family::Rware, 5e-4), (Family::Smac, 5e-4)]
        {
            let grid = rate_grid(family);
            assert_eq!(grid[grid.len() / 2], centre);
            for pair in grid.windows(2) {
                assert!((pair[1] / pair[0] - 2.0).abs() < 1e-12, "{pair:?}");
            }
        }
    }

    #[test]
    fn the_default_rates_make_each_algorithm_what_its_name_says() {
        assert_eq!(default_rates(AlgoName::Ippo, Family::Lbf), (1e-4, 1e-4));
        assert_eq!(default_rates(AlgoName::Mtppo, Family::Lbf), (2e-4, 5e-5));
        assert_eq!(default_rates(AlgoName::Sppo, Family::Rware), (5e-4, 0.0));
        let schedule = default_schedule(AlgoName::Mtppo, Family::Smac, 3);
        assert_eq!((schedule.rates, schedule.levels), (vec![1e-3, 2.5e-4], vec![0, 1, 1]));
    }

    #[test]
    fn a_run_has_forty_test_intervals() {
        assert_eq!((budget(Family::Lbf), default_test(Family::Lbf).interval), (20_000_000, 500_000));
        assert_eq!((budget(Family::Rware), default_test(Family::Rware).interval), (40_000_000, 1_000_000));
        assert_eq!(default_test(Family::Mpe).episodes, 100);
    }
}
