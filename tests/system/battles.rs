//! Battles end to end: every algorithm, one result however they are played, maps of one's own, and what the world says
//! of them on the way from the env-server to the person.

use std::fs;

use nix::sys::signal::Signal;

use crate::bad_input::refused;
use crate::cluster::{rondo, Cluster, Ended, Process};

const NOTHING: [&str; 0] = [];

/// Runs the user's command to its end.
fn command(words: &[&str]) -> Ended {
    let mut command = rondo();
    command.args(words);
    Process::start(command).wait()
}

/// Few steps of an easy battle, with rows for every round.
fn words(task: &[&str], t_max: u32) -> Vec<String> {
    let mut words: Vec<String> = task.iter().map(|&word| word.to_owned()).collect();
    words.extend(["--algo=ippo", "--envs=2", "--test-episodes=2", "--test-interval=1000"].map(str::to_owned));
    words.extend(["--set=algo.hidden=8", "--set=log.interval=1", "--set=save.interval=4"].map(str::to_owned));
    words.push(format!("--t-max={t_max}"));
    words
}

/// A map that is none of the program's.
const MAP: &str = r#"name = "skirmish"
limit = 25
size = [16, 12]
blocked = [[7, 0, 2, 3]]
attack = [4, 6]

[[allies]]
at = [4, 6]
units = [["marine", 2]]

[[enemies]]
at = [12, 6]
units = [["brute", 1]]

[units.brute]
health = 60
damage = 4
cooldown = 0.5
range = 1
speed = 2.5
size = 1.0
hits = ["ground"]
"#;

#[test]
fn battles_come_to_one_digest_in_processes_and_threads_and_over_tcp() {
    let cluster = Cluster::new();
    for (run, more) in [("unix", "--transport=unix"), ("tcp", "--transport=tcp"), ("threads", "--in-process")]
    {
        cluster.train(run, words(&["3m"], 2_000), [more]).succeeds();
    }
    let digest = cluster.digest("threads");
    assert_eq!(cluster.digest("unix"), digest);
    assert_eq!(cluster.digest("tcp"), digest);
}

#[test]
fn a_battle_on_a_map_of_ones_own_is_killed_and_goes_on_without_the_file() {
    let cluster = Cluster::new();
    let file = cluster.path("skirmish.toml");
    fs::write(&file, MAP).expect("a map");
    let map = format!("--map={}", file.display());
    let words = || words(&[&map], 6_000);
    cluster.train("undisturbed", words(), ["--in-process"]).succeeds();
    let training = cluster.train("run", words(), NOTHING);
    cluster.run("run").reaches(2_000);
    training.kill_all();
    fs::remove_file(&file).expect("it was there");
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), cluster.digest("undisturbed"));
    let config = fs::read_to_string(cluster.path("run").join("config.toml")).expect("a configuration");
    assert!(config.contains("task = \"smaclite-skirmish\"") && config.contains("[units.brute]"), "{config}");

    let run = cluster.path("run");
    let ended = command(&["eval", "--episodes=3", &run.display().to_string()]);
    assert!(ended.stdout.contains("smaclite-skirmish · ippo"), "{ended:#?}");
    // The map is part of what decides the result.
    let other = cluster.path("other.toml");
    fs::write(&other, MAP.replace("health = 60", "health = 61")).expect("a map");
    let words = words_of_map(&other.display().to_string());
    let text = cluster.train("run", words, NOTHING).wait();
    assert_eq!(text.code, Some(78), "{text:#?}");
    assert!(
        text.stderr.contains("another configuration: `world.map` is a long text and was a long text"),
        "{text:#?}"
    );
}

fn words_of_map(file: &str) -> Vec<String> {
    words(&[&format!("--map={file}")], 6_000)
}

#[test]
fn an_interrupted_battle_goes_on_to_the_same_digest() {
    let cluster = Cluster::new();
    cluster.train("undisturbed", words(&["smaclite-3m"], 4_000), ["--in-process"]).succeeds();
    let training = cluster.train("run", words(&["smaclite-3m"], 4_000), NOTHING);
    cluster.run("run").reaches(1_000);
    training.signal(Signal::SIGINT);
    assert_eq!(training.wait().code, Some(75));
    cluster.resume("run").succeeds();
    assert_eq!(cluster.digest("run"), cluster.digest("undisturbed"));
}

#[test]
fn what_the_world_says_of_an_episode_reaches_rows_summary_and_evaluation() {
    let cluster = Cluster::new();
    for (task, facts) in [
        ("smaclite-3m", &["battle_won", "allies_left", "enemies_left", "damage_dealt", "damage_taken"][..]),
        ("lbf-5x5-2p-1f", &["items_collected", "levels_collected"]),
        ("rware-tiny-2ag", &["deliveries"]),
        ("mpe-simple-tag", &["collisions", "prey_distance"]),
        ("mpe-simple-speaker-listener", &["goal_distance"]),
    ] {
        let ended = cluster.train(task, words(&[task], 1_500), ["--in-process"]).succeeds();
        let rows = cluster.run(task).rows("world");
        let with =
            |name: String| rows.iter().filter(|row| row[&name].as_f64().is_some_and(f64::is_finite)).count();
        let result = fs::read_to_string(cluster.path(task).join("result.json")).expect("a result");
        let run = cluster.path(task).display().to_string();
        let evaluated = command(&["eval", "--episodes=2", &run]);
        for fact in facts {
            assert!(with(format!("{fact}_mean")) > 0, "{task}: {fact}");
            assert!(with(format!("test_{fact}_mean")) > 0, "{task}: {fact}");
            assert!(result.contains(&format!("\"test_{fact}_mean\": ")), "{task}: {result}");
            assert!(ended.stdout.contains(&format!("{} ", fact.replace('_', " "))), "{ended:#?}");
            assert!(evaluated.stdout.contains(&format!("  {fact}_mean")), "{evaluated:#?}");
        }
    }
    let run = cluster.path("smaclite-3m").display().to_string();
    let compared = command(&["compare", "--metric=test_battle_won_mean", &run]);
    assert_eq!(compared.code, Some(0), "{compared:#?}");
    assert!(compared.stdout.contains("smaclite-3m"), "{compared:#?}");
}

#[test]
fn bad_maps_are_refused_before_anything_starts() {
    let cluster = Cluster::new();
    let of_map = |text: &str, more: &[&str]| {
        let file = cluster.path("bad.toml");
        fs::write(&file, text).expect("a map");
        refused(&[&["train", &format!("--map={}", file.display())], more].concat())
    };
    of_map(&MAP.replace("marine", "marin"), &[])
        .fails_with(78, &["bad.toml`: line 9: unknown unit `marin`: expected one of "]);
    of_map(MAP, &["smaclite-3s5z"]).fails_with(
        78,
        &["is the task `smaclite-skirmish`, and the command line has the task `smaclite-3s5z`"],
    );
    refused(&["train", "--map=/no/such/map.toml"])
        .fails_with(74, &["`--map /no/such/map.toml`: cannot read the file"]);
    refused(&["train", "sc2:MMM2"])
        .fails_with(78, &["`smaclite-mmm2` is that battle by SMAClite's simple rules, without the game"]);
}
