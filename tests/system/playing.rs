//! Playing with a trained team: `rondo eval` reports, `rondo render` draws, and neither changes the run.

use std::fs;
use std::path::Path;

use crate::cluster::{rondo, short, Cluster, Process};
use crate::q_learning::{foraging, speaking};

/// A run that has ended.
fn trained(experiment: Vec<String>) -> Cluster {
    let cluster = Cluster::new();
    cluster.train("run", experiment, ["--in-process"]).succeeds();
    cluster
}

/// `rondo COMMAND RUN` with these words, in a new folder beside the run.
fn play(cluster: &Cluster, command: &str, words: &[&str]) -> Process {
    fs::create_dir_all(cluster.path("here")).expect("created");
    let mut process = rondo();
    process.arg(command).arg(cluster.path("run")).args(words).current_dir(cluster.path("here"));
    Process::start(process)
}

fn json(path: &Path) -> serde_json::Value {
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).expect("an evaluation is JSON")
}

/// Evaluates, and returns the written result.
fn evaluation(cluster: &Cluster, words: &[&str]) -> serde_json::Value {
    play(cluster, "eval", &[words, &["--json=result.json"]].concat()).succeeds();
    json(&cluster.path("here").join("result.json"))
}

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|number| number.as_f64().expect("a number")).collect()
}

#[test]
fn an_evaluation_says_the_same_every_time_and_changes_nothing() {
    let cluster = trained(foraging());
    let before = cluster.digest("run");
    let words = ["--episodes=40", "--seed=3"];
    let first = evaluation(&cluster, &words);
    assert_eq!(evaluation(&cluster, &words), first);
    assert_ne!(evaluation(&cluster, &["--episodes=40", "--seed=4"])["returns"], first["returns"]);
    // Each episode has its own random stream: fewer episodes are the first of many.
    let few = numbers(&evaluation(&cluster, &["--episodes=7", "--seed=3"])["returns"]);
    assert_eq!(few, numbers(&first["returns"])[..7]);
    assert_eq!(cluster.digest("run"), before);

    // Without a name the result is written into the run folder, where it affects neither digest nor resume.
    play(&cluster, "eval", &words).succeeds();
    assert_eq!(json(&cluster.path("run").join("evaluation.json")), first);
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), before);
}

#[test]
fn an_evaluation_counts_as_one_would_by_hand() {
    let cluster = trained(foraging());
    let result = evaluation(&cluster, &["--episodes=12"]);
    let digest: serde_json::Value = serde_json::from_str(&cluster.digest("run")).expect("a digest is JSON");
    assert_eq!((&result["task"], &result["algo"]), (&"lbf-5x5-2p-1f".into(), &"mtql".into()));
    assert_eq!((&result["seed"], &result["episodes"]), (&1.into(), &12.into()));
    assert_eq!((&result["round"], &result["actions"]), (&digest["round"], &"greedy".into()));

    let returns = numbers(&result["returns"]);
    assert_eq!(returns.len(), 12);
    let mean = returns.iter().sum::<f64>() / 12.0;
    let squares: f64 = returns.iter().map(|r| (r - mean) * (r - mean)).sum();
    assert!(squares > 0.0, "some episodes went better than others: {returns:?}");
    let own: f64 = numbers(&result["agent_return_means"]).iter().sum();
    for (name, found, expected) in [
        ("return_mean", &result["return_mean"], mean),
        ("return_std", &result["return_std"], (squares / 12.0).sqrt()),
        ("return_stderr", &result["return_stderr"], (squares / 11.0 / 12.0).sqrt()),
        ("the agents' own returns", &own.into(), mean),
    ] {
        let found = found.as_f64().expect("a number");
        assert!((found - expected).abs() < 1e-12, "{name}: {found} instead of {expected}");
    }
    let one = evaluation(&cluster, &["--episodes=1"]);
    assert_eq!((one["return_stderr"].is_null(), &one["return_std"]), (true, &0.0.into()));
}

#[test]
fn a_team_whose_agents_differ_plays_whole_episodes() {
    let cluster = trained(speaking());
    let result = evaluation(&cluster, &["--episodes=5"]);
    assert_eq!(result["ep_length_mean"], 25.0);
    // Both are rewarded with the same distance.
    let own = numbers(&result["agent_return_means"]);
    assert!(own.len() == 2 && own[0] == own[1] && own[0] < 0.0, "{own:?}");
}

#[test]
fn a_policy_draws_its_actions_as_in_tests_or_takes_the_best() {
    let cluster = trained(short());
    let by_default = evaluation(&cluster, &[]);
    assert_eq!(by_default["actions"], "sample");
    assert_eq!(evaluation(&cluster, &["--sample"]), by_default);
    let greedy = evaluation(&cluster, &["--greedy"]);
    assert_eq!(greedy["actions"], "greedy");
    assert_ne!(greedy["returns"], by_default["returns"]);
    play(&cluster, "eval", &["--greedy", "--sample"]).wait().fails_with(64, &["cannot be used with"]);

    let cluster = trained([short(), vec!["--set=ppo.policy_test=greedy".to_owned()]].concat());
    assert_eq!(evaluation(&cluster, &[])["actions"], "greedy");
    assert_eq!(evaluation(&cluster, &["--sample"])["actions"], "sample");
}

#[test]
fn what_cannot_be_evaluated_is_refused_before_anything_is_written() {
    let cluster = trained(foraging());
    let run = cluster.path("run");
    let refused = |words: &[&str], code: u8, parts: &[&str]| {
        play(&cluster, "eval", words).wait().fails_with(code, parts);
        assert!(!run.join("evaluation.json").exists());
    };
    refused(
        &["--sample"],
        64,
        &["error: `--sample`: mtql has no probabilities to draw from, it takes the best action"],
    );
    refused(&["--episodes=0"], 64, &["0 is not in 1..=10000"]);
    refused(&["--json=nowhere/result.json"], 74, &["error: cannot write nowhere/result.json: "]);

    let (there, away) = (run.join("agent-1"), cluster.path("agent-1"));
    fs::rename(&there, &away).expect("moved");
    let apart = format!("error: the agents of {} have no checkpoint of the same round: ", run.display());
    let copy = "hint: copy the folders of these agents, with all their checkpoints, from the hosts on which they ran";
    refused(&[], 78, &[&apart, "agent-1 has no folder here", copy]);
    assert!(!there.exists(), "looking creates nothing");
    fs::create_dir(&there).expect("created");
    refused(&[], 78, &[&apart, "agent-1 has no complete checkpoint", copy]);
    // A run before its first checkpoint.
    let (checkpoints, aside) = (run.join("agent-0").join("checkpoints"), cluster.path("checkpoints"));
    fs::rename(&checkpoints, &aside).expect("moved");
    let young = "agent-0 has no complete checkpoint, agent-1 has no complete checkpoint\nhint: `rondo resume` it until its \
                 first checkpoint, or copy here";
    refused(&[], 78, &[&apart, young]);
    fs::rename(&aside, &checkpoints).expect("moved");
    fs::remove_dir(&there).expect("removed");
    fs::rename(&away, &there).expect("moved");
    play(&cluster, "eval", &[]).succeeds();

    fs::remove_file(run.join("config.toml")).expect("removed");
    play(&cluster, "eval", &[])
        .wait()
        .fails_with(78, &["is not a run folder: there is no config.toml in it"]);
}

#[test]
fn a_digest_of_a_part_of_a_run_says_what_is_missing() {
    let cluster = trained(foraging());
    let run = cluster.path("run");
    let whole: serde_json::Value = serde_json::from_str(&cluster.digest("run")).expect("JSON");
    fs::rename(run.join("agent-1"), cluster.path("agent-1")).expect("moved");
    let part = play(&cluster, "digest", &["--json"]).wait();
    part.fails_with(
        75,
        &["error: this is not the digest of the run: ", "has no folder of agent-1\nhint: a role that"],
    );
    let part: serde_json::Value = serde_json::from_str(&part.stdout).expect("JSON");
    assert_eq!((&part["digest"], &part["agents"][1]), (&serde_json::Value::Null, &serde_json::Value::Null));
    assert_eq!(part["agents"][0], whole["agents"][0]);
    assert!(play(&cluster, "digest", &[])
        .wait()
        .stdout
        .contains("digest    none, this is a part of a run\n"));
    fs::rename(cluster.path("agent-1"), run.join("agent-1")).expect("moved");
    // An incompletely copied configuration.
    let config = fs::read_to_string(run.join("config.toml")).expect("read");
    fs::write(run.join("config.toml"), &config[..20]).expect("written");
    let half =
        "/config.toml does not have the number of agents (`world.agents`)\nhint: it is damaged or half";
    play(&cluster, "digest", &[]).wait().fails_with(78, &[half]);
    let toml = format!("error: {}/config.toml: the configuration cannot be read: ", run.display());
    play(&cluster, "eval", &[]).wait().fails_with(78, &[&toml]);
}

#[test]
fn the_newest_round_that_all_agents_hold_is_evaluated() {
    let cluster = trained(foraging());
    let run = cluster.run("run");
    let newest = *run.checkpoints("agent-0").last().expect("it has saved");
    let before = run.checkpoints("agent-0")[0];
    assert_eq!(evaluation(&cluster, &[])["round"], newest);
    fs::remove_dir_all(run.checkpoint("agent-1", newest)).expect("removed");
    assert_eq!(evaluation(&cluster, &[])["round"], before);
}

#[test]
fn episodes_become_a_film_or_numbered_pictures() {
    let cluster = trained(speaking());
    let before = cluster.digest("run");
    let here = cluster.path("here");
    let small = ["--width=120", "--episodes=2"];
    play(&cluster, "render", &[&small[..], &["--out=film.gif"]].concat()).succeeds();
    let film = fs::read(here.join("film.gif")).expect("a film");
    assert!(film.starts_with(b"GIF89a") && film.ends_with(b";"));

    let ended = play(&cluster, "render", &[&small[..], &["--out=still.png"]].concat()).succeeds();
    assert_eq!(ended.stdout, "still-0001.png to still-0052.png\n");
    // Both episodes have a start and 25 steps.
    for number in 1..=52 {
        let picture = fs::read(here.join(format!("still-{number:04}.png"))).expect("a picture");
        assert!(picture.starts_with(b"\x89PNG\r\n\x1a\n"), "{number}");
    }
    assert_eq!(fs::read_dir(&here).expect("a folder").count(), 53);
    play(&cluster, "render", &[&small[..], &["--out=vector.svg"]].concat()).succeeds();
    assert!(fs::read_to_string(here.join("vector-0052.svg")).expect("a picture").starts_with("<svg"));
    assert_eq!(cluster.digest("run"), before);
}

#[test]
fn films_of_one_seed_are_equal_and_those_of_another_are_not() {
    let cluster = trained(foraging());
    let film = |seed: &str| {
        play(&cluster, "render", &["--width=120", "--out=film.gif", seed]).succeeds();
        fs::read(cluster.path("here").join("film.gif")).expect("a film")
    };
    let first = film("--seed=1");
    assert!(film("--seed=1") == first);
    assert!(film("--seed=2") != first);
}

#[test]
fn pictures_of_another_kind_are_refused_before_an_episode_is_played() {
    let cluster = trained(speaking());
    for out in ["film.mp4", "film", "film.GIF"] {
        play(&cluster, "render", &[&format!("--out={out}")])
            .wait()
            .fails_with(64, &["error: `--out`: expected a name that ends with .gif, .png or .svg"]);
    }
    play(&cluster, "render", &["--sample", "--out=film.gif"])
        .wait()
        .fails_with(64, &["error: `--sample`: mtql has no probabilities"]);
    play(&cluster, "render", &["--fps=0"]).wait().fails_with(64, &["0 is not in 1..=50"]);
    assert_eq!(fs::read_dir(cluster.path("here")).expect("a folder").count(), 0);
}
