//! Each bound, the text of each mistake, and that all are reported together.

use super::*;
use crate::presets::{self, Family};

fn example(name: AlgoName) -> Config {
    presets::config("lbf-s1", "lbf-8x8-2p-2f-coop", 2, name, Family::Lbf)
}

/// The mistakes of the multi-timescale example after a change.
fn mistakes(change: impl FnOnce(&mut Config)) -> Vec<String> {
    let mut config = example(AlgoName::Mtppo);
    change(&mut config);
    match config.validate() {
        Ok(()) => Vec::new(),
        Err(ConfigError::Invalid(mistakes)) => mistakes,
        Err(other) => panic!("expected mistakes, got {other:?}"),
    }
}

#[test]
fn all_mistakes_are_in_one_report() {
    let mut config = example(AlgoName::Mtppo);
    config.run = "a/b".to_owned();
    config.world.copies = 0;
    config.algo.gamma = 1.5;
    config.schedule.levels = vec![0, 2];
    config.test.episodes = 10_001;
    assert_eq!(
        config.validate().unwrap_err().to_string(),
        "the configuration has 6 mistakes\
         \n  - `run`: run name `a/b` cannot be used: expected 1 to 64 characters out of A-Z, a-z, 0-9, `.`, `_` \
         and `-`, the first of them a letter or a digit\
         \n  - `world.copies` is 0: expected a number from 1 to 10000\
         \n  - `algo.gamma` is 1.5: expected a number from 0 to 1\
         \n  - `schedule.levels` names level 2: `schedule.rates` has 2 levels, from 0\
         \n  - `schedule.rates[1]` is used by no agent: give it one, or remove it\
         \n  - `test.episodes` is 10001: expected a number from 1 to 10000"
    );
}

#[test]
fn every_number_has_its_bounds() {
    let bad: [fn(&mut Config); 26] = [
        |c| c.t_max = 0,
        |c| c.world.task.clear(),
        |c| c.world.task = "a\nb".to_owned(),
        |c| c.world.task = "a".repeat(257),
        |c| c.world.copies = 10_001,
        |c| c.world.opponent.clear(),
        |c| c.algo.hidden = 0,
        |c| c.algo.hidden = 4_097,
        |c| c.algo.gamma = -0.1,
        |c| c.algo.gamma = f64::NAN,
        |c| c.ppo.as_mut().unwrap().epochs = 0,
        |c| c.ppo.as_mut().unwrap().epochs = 1_001,
        |c| c.ppo.as_mut().unwrap().clip = 0.0,
        |c| c.ppo.as_mut().unwrap().clip = f64::INFINITY,
        |c| c.ppo.as_mut().unwrap().entropy_coef = -1e-9,
        |c| c.ppo.as_mut().unwrap().n_step = 0,
        |c| c.algo.target_update = 0.0,
        |c| c.algo.target_update = 1.5,
        |c| c.algo.target_update = f64::NAN,
        |c| c.algo.max_grad_norm = 0.0,
        |c| c.schedule.rates[0] = -1e-4,
        |c| c.schedule.rates[0] = 1.5,
        |c| c.schedule.switch_period = Period::Every(0),
        |c| c.test.interval = 0,
        |c| c.save.interval = 0,
        |c| c.log.interval = 0,
    ];
    for (i, change) in bad.into_iter().enumerate() {
        assert_eq!(mistakes(change).len(), 1, "change {i}");
    }
    let good: [fn(&mut Config); 8] = [
        |c| c.world.copies = 10_000,
        |c| c.algo.gamma = 0.0,
        |c| c.algo.gamma = 1.0,
        |c| c.ppo.as_mut().unwrap().entropy_coef = 0.0,
        |c| c.algo.target_update = 1.0,
        |c| c.algo.target_update = 2.0,
        |c| c.schedule.rates = vec![0.0, 1.0],
        |c| c.schedule.switch_period = Period::Infinite,
    ];
    for (i, change) in good.into_iter().enumerate() {
        assert_eq!(mistakes(change), [""; 0], "change {i}");
    }
}

#[test]
fn every_number_of_q_learning_has_its_bounds() {
    let mistakes = |change: fn(&mut QLearning)| {
        let mut config = example(AlgoName::Mtql);
        change(config.q.as_mut().unwrap());
        config.validate().map_err(|error| error.to_string())
    };
    let bad: [fn(&mut QLearning); 8] = [
        |q| q.buffer = 1_000_001,
        |q| q.batch = 0,
        |q| q.batch = q.buffer + 1,
        |q| q.epsilon_start = 1.5,
        |q| q.epsilon_finish = -0.1,
        |q| q.epsilon_start = 0.01,
        |q| q.test_epsilon = f64::NAN,
        |q| q.epsilon_finish = f64::NAN,
    ];
    for (i, change) in bad.into_iter().enumerate() {
        assert!(mistakes(change).is_err(), "change {i}");
    }
    let good: [fn(&mut QLearning); 4] = [
        |q| q.batch = q.buffer,
        |q| q.epsilon_anneal = 0,
        |q| q.epsilon_finish = q.epsilon_start,
        |q| q.test_epsilon = 0.05,
    ];
    for (i, change) in good.into_iter().enumerate() {
        assert_eq!(mistakes(change), Ok(()), "change {i}");
    }
}

#[test]
fn the_settings_of_another_learner_are_refused() {
    let mut config = example(AlgoName::Mtql);
    config.ppo = Some(presets::ppo_defaults(Family::Lbf));
    config.q = None;
    assert_eq!(
        config.validate().unwrap_err().to_string(),
        "the configuration has 2 mistakes\
         \n  - `q` is missing: `algo.name` = `mtql` needs that section\
         \n  - `ppo` has no meaning for `algo.name` = `mtql`: remove that section"
    );
}

#[test]
fn a_joint_gradient_norm_is_refused_with_the_reason() {
    assert_eq!(
        mistakes(|c| c.algo.clip_scope = ClipScope::Joint),
        ["`algo.clip_scope` is `joint`: expected `per_agent`, because agents in processes of their own cannot \
          share a gradient norm"]
    );
}

#[test]
fn every_agent_has_a_level_and_every_level_an_agent() {
    assert_eq!(
        mistakes(|c| c.world.agents = 3),
        ["`schedule.levels` has 2 entries: expected one for each of the 3 agents"]
    );
    assert_eq!(
        mistakes(|c| c.schedule.rates.push(0.1)),
        ["`schedule.rates[2]` is used by no agent: give it one, or remove it"]
    );
    assert_eq!(
        mistakes(|c| c.schedule.rates.clear()),
        [
            "`schedule.rates` is empty: expected a learning rate for each level",
            "`schedule.levels` names level 0: `schedule.rates` has 0 levels, from 0",
        ]
    );
}

#[test]
fn every_agent_of_a_team_may_have_a_rate_of_its_own_up_to_256_levels() {
    let with_levels = |agents: u32, levels: u32| {
        let mut config = presets::config("r", "t", agents, AlgoName::Mtppo, Family::Lbf);
        config.schedule.rates = (1..=levels).map(|level| 1e-4 / f64::from(level)).collect();
        config.schedule.levels = (0..agents).map(|agent| agent % levels).collect();
        config.validate().map_err(|error| error.to_string())
    };
    for agents in 1..=64 {
        assert_eq!(with_levels(agents, agents), Ok(()), "{agents}");
    }
    for (agents, levels) in [(1_000, 2), (256, 256), (65_535, 256)] {
        assert_eq!(with_levels(agents, levels), Ok(()), "{agents} agents, {levels} levels");
    }
    let refused = with_levels(257, 257).unwrap_err();
    assert!(refused.ends_with("- `schedule.rates` has 257 levels: expected at most 256"), "{refused}");
}

#[test]
fn an_algorithm_is_not_run_under_the_name_of_another() {
    let with_rates = |name: AlgoName, rates: [f64; 2]| {
        let mut config = example(name);
        config.schedule.rates = rates.to_vec();
        config.validate().map_err(|error| error.to_string())
    };
    for (name, rates) in [
        (AlgoName::Ippo, [1e-4, 1e-4]),
        (AlgoName::Sppo, [1e-4, 0.0]),
        (AlgoName::Mtppo, [1e-4, 1e-4]),
        (AlgoName::Mtppo, [1e-4, 0.0]),
        (AlgoName::Mtppo, [0.0, 1e-4]),
        (AlgoName::Iql, [1e-4, 1e-4]),
        (AlgoName::Sql, [1e-4, 0.0]),
        (AlgoName::Mtql, [0.0, 1e-4]),
    ] {
        assert_eq!(with_rates(name, rates), Ok(()));
    }
    assert_eq!(
        with_rates(AlgoName::Ippo, [2e-4, 1e-4]),
        Err("the configuration has 1 mistake\n  - `schedule.rates` with `algo.name` = `ippo`: \
             expected equal rates; for other rates use `mtppo`"
            .to_owned())
    );
    for rates in [[1e-4, 1e-5], [0.0, 1e-4]] {
        assert!(with_rates(AlgoName::Sppo, rates).is_err());
        let refused = with_rates(AlgoName::Sql, rates).unwrap_err();
        assert!(refused.ends_with("a first rate above 0 and zero for the others; for other rates use `mtql`"));
    }
}
