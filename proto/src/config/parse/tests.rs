//! Reading, writing and digesting the configuration file.

use super::*;
use crate::config::{
    ClipScope, Draws, EndOfBatch, FrozenMoments, Network, Period, PolicyTest, Profile, Reward,
    RewardStandardisation, SwitchUnit,
};

fn example() -> Config {
    presets::config("lbf-s1", "lbf-8x8-2p-2f-coop", 2, AlgoName::Mtppo, Family::Lbf)
}

/// The example's file with `old` replaced; it must occur.
fn with(old: &str, new: &str) -> String {
    let text = example().to_toml();
    assert!(text.contains(old), "the example has no `{old}`");
    text.replacen(old, new, 1)
}

#[test]
fn the_file_has_every_key_in_the_order_of_the_structs() {
    let expected = r#"run = "lbf-s1"
seed = 1
t_max = 20000000

[world]
task = "lbf-8x8-2p-2f-coop"
agents = 2
copies = 10
opponent = "builtin"
pad = false
reward = "sum"

[algo]
name = "mtppo"
profile = "rondo"
network = "gru"
hidden = 128
gamma = 0.99
target_update = 200.0
max_grad_norm = 10.0
clip_scope = "per_agent"
reward_standardisation = "off"
frozen_moments = "update"
agent_id_input = false
last_action_input = false

[ppo]
epochs = 4
clip = 0.2
entropy_coef = 0.001
n_step = 5
end_of_batch = "correct"
policy_test = "sample"

[schedule]
rates = [0.0002, 0.00005]
levels = [0, 1]
switch_period = 100
switch_unit = "update_call"

[test]
interval = 500000
episodes = 100

[save]
interval = 100

[log]
interval = 10000

[bus]
low_latency = false
"#;
    assert_eq!(example().to_toml(), expected);
    assert_eq!(Config::from_toml(expected), Ok(example()));
}

#[test]
fn extreme_values_survive_the_file() {
    let mut config = example();
    config.seed = u64::MAX;
    config.t_max = u64::MAX;
    config.schedule.switch_period = Period::Infinite;
    config.schedule.rates = vec![f64::MIN_POSITIVE, 0.1 + 0.2];
    config.world.task = "quote \" backslash \\ newline \n".to_owned();
    assert_eq!(Config::from_toml(&config.to_toml()), Ok(config));
}

#[test]
fn the_digest_changes_with_every_key() {
    let changes: [fn(&mut Config); 48] = [
        |c| c.run.push('x'),
        |c| c.seed += 1,
        |c| c.t_max += 1,
        |c| c.world.task.push('x'),
        |c| c.world.agents += 1,
        |c| c.world.copies += 1,
        |c| c.world.opponent = "random".to_owned(),
        |c| c.world.map = Some("name = \"m\"".to_owned()),
        |c| c.world.pad = true,
        |c| c.world.reward = Reward::Mean,
        |c| c.algo.name = AlgoName::Sppo,
        |c| c.algo.profile = Profile::Benchmark2021,
        |c| c.algo.network = Network::Fc,
        |c| c.algo.hidden += 1,
        |c| c.algo.gamma = c.algo.gamma.next_down(),
        |c| c.ppo.as_mut().unwrap().epochs += 1,
        |c| c.ppo.as_mut().unwrap().clip = c.ppo.as_ref().unwrap().clip.next_down(),
        |c| c.ppo.as_mut().unwrap().entropy_coef = c.ppo.as_ref().unwrap().entropy_coef.next_down(),
        |c| c.ppo.as_mut().unwrap().n_step += 1,
        |c| c.algo.target_update = 0.01,
        |c| c.algo.max_grad_norm = c.algo.max_grad_norm.next_down(),
        |c| c.algo.clip_scope = ClipScope::Joint,
        |c| c.ppo.as_mut().unwrap().end_of_batch = EndOfBatch::Epymarl,
        |c| c.algo.reward_standardisation = RewardStandardisation::Batch,
        |c| c.algo.frozen_moments = FrozenMoments::Hold,
        |c| c.algo.agent_id_input = true,
        |c| c.algo.last_action_input = true,
        |c| c.ppo.as_mut().unwrap().policy_test = PolicyTest::Greedy,
        |c| c.q.as_mut().unwrap().buffer += 1,
        |c| c.q.as_mut().unwrap().batch += 1,
        |c| c.q.as_mut().unwrap().draws = Draws::Independent,
        |c| c.q.as_mut().unwrap().double = false,
        |c| c.q.as_mut().unwrap().epsilon_start = 0.5,
        |c| c.q.as_mut().unwrap().epsilon_finish = 0.5,
        |c| c.q.as_mut().unwrap().epsilon_anneal += 1,
        |c| c.q.as_mut().unwrap().test_epsilon = 0.5,
        |c| c.q.as_mut().unwrap().time_limit_is_terminal = false,
        |c| c.schedule.rates[1] = c.schedule.rates[1].next_down(),
        |c| c.schedule.levels = vec![1, 0],
        |c| c.schedule.switch_period = Period::Infinite,
        |c| c.schedule.switch_unit = SwitchUnit::GradientStep,
        |c| c.test.interval += 1,
        |c| c.test.episodes += 1,
        |c| c.save.interval += 1,
        |c| c.log.interval += 1,
        |c| c.bus.low_latency = true,
        |c| c.schedule.switch_period = Period::Every(101),
        |_| {},
    ];
    let mut digests: Vec<_> = changes
        .map(|change| {
            // With the sections of both learners, which no run has: all keys are counted.
            let mut config = Config { q: Some(presets::q_defaults()), ..example() };
            change(&mut config);
            config.digest()
        })
        .into();
    digests.sort_unstable();
    digests.dedup();
    assert_eq!(digests.len(), changes.len());
    // Every key once, one of them twice, and the unchanged example. A new key needs a change above.
    let keys: usize = known_keys().values().map(|value| value.as_table().map_or(1, Table::len)).sum();
    assert_eq!(changes.len(), keys + 2);
}

#[test]
fn the_digest_is_that_of_the_file() {
    let config = example();
    assert_eq!(config.digest(), *blake3::hash(config.to_toml().as_bytes()).as_bytes());
    assert_eq!(Config::from_toml(&config.to_toml()).unwrap().digest(), config.digest());
}

#[test]
fn an_unknown_key_is_answered_with_its_line_and_the_nearest_known_one() {
    let error = Config::from_toml(&with("epochs", "epoch")).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the configuration has 1 unknown key\n  - line 28: `ppo.epoch` is not a key; did you mean `ppo.epochs`?"
    );
}

#[test]
fn all_unknown_keys_are_reported_in_the_order_of_the_file() {
    let text =
        with("seed = 1", "sead = 1\nhidden = 3\nlearning_rate_of_agents = 1e-4").replace("[bus]", "[buss]");
    let ConfigError::UnknownKeys(entries) = Config::from_toml(&text).unwrap_err() else {
        panic!("expected unknown keys")
    };
    assert_eq!(
        entries,
        [
            "line 2: `sead` is not a key; did you mean `seed`?",
            "line 3: `hidden` is not a key; did you mean `algo.hidden`?",
            "line 4: `learning_rate_of_agents` is not a key; expected one of \
             algo, bus, log, ppo, q, run, save, schedule, seed, t_max, test, world",
            "line 53: `buss` is not a key; did you mean `bus`?",
        ]
    );
}

#[test]
fn an_unknown_key_is_found_however_it_is_written() {
    let dotted = with("[bus]\nlow_latency = false", "").replace("run =", "bus.low_latancy = true\nrun =");
    assert_eq!(
        Config::from_toml(&dotted),
        Err(ConfigError::UnknownKeys(vec![
            "line 1: `bus.low_latancy` is not a key; did you mean `bus.low_latency`?".to_owned()
        ]))
    );
}

#[test]
fn missing_keys_and_wrong_kinds_are_shown_where_they_are() {
    let message = |text: &str| match Config::from_toml(text).unwrap_err() {
        ConfigError::Toml(message) => message,
        other => panic!("expected a TOML error, got {other:?}"),
    };
    let missing = message(&with("n_step = 5\n", ""));
    assert!(missing.contains("missing field `n_step`") && missing.contains("line 27"), "{missing}");
    let choice = message(&with("\"gru\"", "\"lstm\""));
    assert!(choice.contains("unknown variant `lstm`, expected `fc` or `gru`"), "{choice}");
    assert!(choice.contains("line 16"), "{choice}");
    let kind = message(&with("hidden = 128", "hidden = -1"));
    assert!(kind.contains("line 17") && kind.contains("`-1`"), "{kind}");
    let section = message(&with("[bus]\nlow_latency = false", "").replace("run =", "bus = 3\nrun ="));
    assert!(section.contains("line 1"), "{section}");
    let syntax = message("run = \"x\nseed = 1");
    assert!(syntax.contains("line 1"), "{syntax}");
}

#[test]
fn a_file_from_before_the_team_drew_together_means_what_it_meant() {
    let config = presets::config("q", "lbf-8x8-2p-2f-coop", 2, AlgoName::Iql, Family::Lbf);
    let text = config.to_toml();
    assert!(text.contains("draws = \"joint\"\n"), "{text}");
    let old = Config::from_toml(&text.replace("draws = \"joint\"\n", "")).unwrap();
    assert_eq!(old.q.map(|q| q.draws), Some(Draws::Independent));
}

#[test]
fn a_file_cut_off_anywhere_is_refused() {
    let text = example().to_toml();
    let complete = text.trim_end().len();
    for end in 0..complete {
        assert!(Config::from_toml(&text[..end]).is_err(), "{:?}", &text[..end]);
    }
}

#[test]
fn a_rule_for_the_end_of_a_batch_is_printed_as_it_is_written() {
    for rule in EndOfBatch::ALL {
        let mut config = example();
        config.ppo.as_mut().unwrap().end_of_batch = rule;
        assert!(config.to_toml().contains(&format!("end_of_batch = \"{rule}\"\n")), "{rule}");
    }
}
