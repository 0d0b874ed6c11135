//! Every family of worlds with every algorithm, and the rewards that agents learn from (algorithms §2.5).

use std::collections::BTreeMap;

use proto::keys::Keys;
use proto::{Mode, Observe};

use crate::cluster::{experiment, Cluster, RunFolder};
use crate::hosts::Hosts;
use crate::isolation::unhex;

const ALGORITHMS: [&str; 6] = ["ippo", "mtppo", "sppo", "iql", "mtql", "sql"];

/// Trains for a few episodes with every algorithm, and checks the results of every role.
fn is_learned_in(task: &[&str], agents: u32) {
    for algo in ALGORITHMS {
        let cluster = Cluster::new();
        let mut words: Vec<String> = task.iter().map(|&word| word.to_owned()).collect();
        words.extend(["--t-max=2000", "--envs=2", "--test-interval=1000"].map(str::to_owned));
        words.extend(["--test-episodes=2", "--set=algo.hidden=8", "--set=log.interval=1"].map(str::to_owned));
        words.push(format!("--algo={algo}"));
        if algo.ends_with("ql") {
            words.push("--set=q.batch=2".to_owned());
        }
        cluster.train("run", words, ["--in-process"]).succeeds();
        let run = cluster.run("run");
        let tests: Vec<_> =
            run.rows("world").iter().filter_map(|row| row["test_return_mean"].as_f64()).collect();
        assert!(tests.len() >= 2 && tests.iter().all(|mean| mean.is_finite()), "{task:?} {algo}: {tests:?}");
        for agent in 0..agents {
            let rows = run.rows(&format!("agent-{agent}"));
            let last =
                rows.last().unwrap_or_else(|| panic!("{task:?} {algo}: agent {agent} has not learned"));
            let own = if algo.ends_with("ql") {
                ["loss", "epsilon", "lr"]
            } else {
                ["actor_loss", "entropy", "lr"]
            };
            assert!(own.iter().all(|name| last[name].as_f64().is_some_and(f64::is_finite)), "{algo}: {last}");
        }
    }
}

#[test]
fn foraging_is_learned_in_with_every_algorithm() {
    is_learned_in(&["lbf-8x8-3p-2f"], 3);
}

#[test]
fn the_warehouse_is_learned_in_with_every_algorithm() {
    is_learned_in(&["rware-tiny-2ag"], 2);
}

#[test]
fn speaker_and_listener_learn_with_every_algorithm() {
    is_learned_in(&["mpe-simple-speaker-listener"], 2);
}

#[test]
fn battles_are_learned_in_with_every_algorithm() {
    is_learned_in(&["smaclite-3m"], 3);
}

#[test]
fn teams_with_an_opponent_learn_with_every_algorithm() {
    is_learned_in(&["mpe-simple-tag", "--opponent=random"], 3);
    is_learned_in(&["mpe-simple-adversary", "--opponent=still"], 2);
}

#[test]
fn a_warehouse_run_in_processes_comes_to_the_digest_of_threads() {
    let cluster = Cluster::new();
    let words = || {
        let words =
            ["rware-tiny-2ag", "--algo=mtql", "--t-max=2000", "--test-episodes=2", "--set=algo.hidden=8"];
        [&words[..], &["--set=q.batch=2", "--set=log.interval=1"]]
            .concat()
            .into_iter()
            .map(str::to_owned)
            .collect()
    };
    cluster.train("processes", words(), ["--transport=unix"]).succeeds();
    cluster.train("threads", words(), ["--in-process"]).succeeds();
    assert_eq!(cluster.digest("processes"), cluster.digest("threads"));
}

/// The rows of training of a short run in threads, one for every round.
fn rows_with(reward: &str) -> (Vec<serde_json::Value>, String) {
    let cluster = Cluster::new();
    let words = [format!("--reward={reward}"), "--set=log.interval=1".to_owned(), "--in-process".to_owned()];
    cluster.train("run", experiment(5, 2_000), words).succeeds();
    (cluster.run("run").rows("world"), cluster.digest("run"))
}

fn number(row: &serde_json::Value, name: &str) -> f64 {
    row[name].as_f64().unwrap_or_else(|| panic!("no `{name}` in {row}"))
}

#[test]
fn rewards_are_summed_averaged_or_each_agents_own() {
    let ((sum, of_sum), (mean, of_mean), (own, of_own)) =
        (rows_with("sum"), rows_with("mean"), rows_with("individual"));
    // Nothing is learned before the first round: the same episodes, with three kinds of rewards.
    let total = number(&sum[0], "return_mean");
    assert!(total > 0.0, "somebody has found food by chance");
    assert_eq!(number(&mean[0], "return_mean"), total / 2.0);
    assert_eq!(number(&own[0], "return_mean"), total);
    let each = [number(&own[0], "agent_0_return_mean"), number(&own[0], "agent_1_return_mean")];
    assert!((each[0] + each[1] - total).abs() < 1e-9, "{each:?} make {total}");
    assert_ne!(each[0], each[1]);

    let tests: Vec<_> = own.iter().filter(|row| !row["test_return_mean"].is_null()).collect();
    assert!(!tests.is_empty());
    for test in tests {
        let each = [number(test, "test_agent_0_return_mean"), number(test, "test_agent_1_return_mean")];
        assert!((each[0] + each[1] - number(test, "test_return_mean")).abs() < 1e-9, "{test}");
    }
    // With the team's reward there are no separate returns.
    for row in sum.iter().chain(&mean) {
        assert!(row.as_object().expect("a row").keys().all(|name| !name.contains("agent_0")), "{row}");
    }
    assert!(of_sum != of_mean && of_mean != of_own && of_sum != of_own, "they learn other things");
}

#[test]
fn each_agent_is_told_its_own_rewards_and_nobody_elses() {
    let words = ["--reward=individual", "--set=log.interval=1", "--envs=4"].map(str::to_owned);
    let hosts = Hosts::new([experiment(5, 1_500), words.into()].concat());
    let (world, coordinator) = (hosts.start_env_server(&[]), hosts.start_coordinator(&[]));
    let agents = [hosts.start_agent(0, &[]), hosts.start_agent(1, &[])];
    for process in agents.into_iter().chain([world, coordinator]) {
        process.succeeds();
    }
    let keys = Keys::new("run").expect("a good name");
    let rows = RunFolder { path: hosts.folder("world") }.rows("world");
    let rows: Vec<_> = rows.iter().filter(|row| row["test_return_mean"].is_null()).collect();
    assert!(rows.len() > 5, "{}", rows.len());
    for agent in 0..2 {
        // By round and tick, which may be repeated; over all episodes.
        let mut told = BTreeMap::new();
        for line in hosts.recorded("world") {
            if line["key"] == keys.observe(agent) && line["op"] == "published" {
                let mut observe = Observe::default();
                observe.decode(&unhex(line["hex"].as_str().expect("a payload"))).expect("a tick");
                if observe.mode == Mode::Train {
                    let rewards: f64 = observe.rewards.iter().map(|&reward| f64::from(reward)).sum();
                    told.insert((observe.round, observe.tick), rewards);
                }
            }
        }
        for (round, row) in (0..).zip(&rows) {
            let told: f64 = told.range((round, 0)..(round + 1, 0)).map(|(_, rewards)| rewards).sum();
            let earned = 4.0 * number(row, &format!("agent_{agent}_return_mean"));
            assert!((earned - told).abs() < 1e-5, "agent {agent} earned {earned} and was told {told}");
        }
    }
}
