//! Whole runs of Q-learning: one result in processes and threads, and an update call for every episode
//! (algorithms §5.1).

use std::fs;
use std::sync::OnceLock;

use crate::cluster::Cluster;

const NOTHING: [&str; 0] = [];

/// Episodes in a minibatch of [`experiment`]: with fewer stored episodes there is no update call.
pub const BATCH: u64 = 4;

/// Capacity of the buffer in [`experiment`], a fraction of the played episodes.
pub const BUFFER: u64 = 16;

/// Rounds between two checkpoints in [`experiment`].
pub const SAVE_INTERVAL: u64 = 5;

/// A run of two agents in which ε falls quickly, and targets are copied and turns taken several times.
fn experiment(task: &str, algo: &str, t_max: u64) -> Vec<String> {
    let words = [
        task.to_owned(),
        format!("--algo={algo}"),
        "--seed=1".to_owned(),
        format!("--t-max={t_max}"),
        "--switch-period=7".to_owned(),
        "--test-interval=900".to_owned(),
        "--test-episodes=10".to_owned(),
        "--set=algo.hidden=8".to_owned(),
        format!("--set=q.batch={BATCH}"),
        format!("--set=q.buffer={BUFFER}"),
        "--set=q.epsilon_anneal=1000".to_owned(),
        format!("--set=save.interval={SAVE_INTERVAL}"),
        "--set=log.interval=300".to_owned(),
    ];
    words.into()
}

/// The experiment of most tests: recurrent networks, about a hundred episodes of up to 50 steps.
pub fn foraging() -> Vec<String> {
    foraging_with("mtql")
}

/// The same with another algorithm.
pub fn foraging_with(algo: &str) -> Vec<String> {
    let mut words = experiment("lbf-5x5-2p-1f", algo, 4_000);
    words.push("--set=algo.target_update=20".to_owned());
    words
}

/// Feed-forward networks, agents that are not alike, 60 episodes of 25 steps each.
pub fn speaking() -> Vec<String> {
    speaking_with("mtql")
}

/// The same with another algorithm.
pub fn speaking_with(algo: &str) -> Vec<String> {
    experiment("mpe-simple-speaker-listener", algo, 1_500)
}

/// The digest line of [`foraging`] without a disturbance; computed once for all tests.
pub fn undisturbed() -> &'static str {
    static DIGEST: OnceLock<String> = OnceLock::new();
    DIGEST.get_or_init(|| {
        let cluster = Cluster::new();
        cluster.train("undisturbed", foraging(), ["--in-process"]).succeeds();
        cluster.digest("undisturbed")
    })
}

/// Update calls that an agent has made in a run that has ended.
fn update_calls(cluster: &Cluster, run: &str, agent: u32) -> u64 {
    let path = cluster.path(run).join(format!("agent-{agent}")).join("result.json");
    let text = fs::read_to_string(path).expect("a result");
    let result: serde_json::Value = serde_json::from_str(&text).expect("a result is JSON");
    result["update_calls"].as_u64().expect("a number")
}

#[test]
fn processes_threads_and_both_transports_come_to_one_digest_in_foraging() {
    let cluster = Cluster::new();
    for (run, more) in [("unix", &[][..]), ("tcp", &["--transport=tcp"]), ("threads", &["--in-process"])] {
        cluster.train(run, foraging(), more).succeeds();
        assert_eq!(cluster.digest(run), undisturbed(), "{run}");
    }
    let config = fs::read_to_string(cluster.path("unix").join("config.toml")).expect("it was written");
    assert!(config.contains("network = \"gru\""), "{config}");
    // The digest is over something, and something was learned.
    for role in ["world", "agent-0", "agent-1"] {
        assert!(cluster.run("unix").rows(role).len() > 5, "{role}");
    }
    assert!(update_calls(&cluster, "unix", 0) > 4 * BUFFER, "the buffer was filled several times");
}

#[test]
fn agents_that_are_not_alike_come_to_one_digest_in_processes_and_threads() {
    let cluster = Cluster::new();
    for algo in ["iql", "mtql"] {
        let (processes, threads) = (format!("{algo}-processes"), format!("{algo}-threads"));
        cluster.train(&processes, speaking_with(algo), NOTHING).succeeds();
        cluster.train(&threads, speaking_with(algo), ["--in-process"]).succeeds();
        assert_eq!(cluster.digest(&processes), cluster.digest(&threads), "{algo}");
    }
    assert_ne!(cluster.digest("iql-threads"), cluster.digest("mtql-threads"), "they have other rates");
    let config = fs::read_to_string(cluster.path("iql-threads").join("config.toml")).expect("it was written");
    assert!(config.contains("network = \"fc\""), "{config}");
}

#[test]
fn episodes_side_by_side_make_as_many_update_calls_as_one_after_the_other() {
    let cluster = Cluster::new();
    // 60 episodes; all but those of the warm-up are followed by an update call.
    for (run, copies, rounds) in [("one", 1, 60), ("three", 3, 20)] {
        cluster.train(run, speaking(), [&format!("--envs={copies}"), "--in-process"]).succeeds();
        for agent in [0, 1] {
            assert_eq!(update_calls(&cluster, run, agent), 60 - BATCH + 1, "{copies} copies, agent {agent}");
            let newest = cluster.run(run).checkpoints(&format!("agent-{agent}")).last().copied();
            assert_eq!(newest, Some(rounds), "{copies} copies");
        }
    }
    assert_ne!(cluster.digest("one"), cluster.digest("three"), "three act before the first is learned from");
}

/// The running statistics of the rewards in an agent's newest checkpoint, as they were written.
fn reward_stats(cluster: &Cluster, run: &str, agent: u32) -> serde_json::Value {
    let role = format!("agent-{agent}");
    let newest = *cluster.run(run).checkpoints(&role).last().expect("a checkpoint");
    let text =
        fs::read_to_string(cluster.run(run).checkpoint(&role, newest).join("state.bin")).expect("a state");
    let state: serde_json::Value = serde_json::from_str(&text).expect("a state is JSON");
    let stats = state["counters"]["Q"]["counters"]["reward_stats"].clone();
    assert!(stats["count"].as_f64().is_some_and(|count| count > 100.0), "{state}");
    stats
}

#[test]
fn a_team_that_shares_its_reward_comes_to_the_same_statistics_unless_each_agent_draws_its_own_episodes() {
    let cluster = Cluster::new();
    for (draws, equal) in [("joint", true), ("independent", false)] {
        let more = [format!("--set=q.draws={draws}"), "--reward=sum".to_owned(), "--in-process".to_owned()];
        cluster.train(draws, foraging_with("iql"), &more).succeeds();
        let stats = [0, 1].map(|agent| reward_stats(&cluster, draws, agent));
        // Numbers are written so that they parse to the same bits.
        assert_eq!(stats[0] == stats[1], equal, "{draws}: {stats:?}");
    }
    assert_ne!(cluster.digest("joint"), cluster.digest("independent"));
}
