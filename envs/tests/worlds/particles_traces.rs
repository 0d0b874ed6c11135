//! Replays particle traces recorded from the reference: excerpts always, all of them where `RONDO_GOLDEN` names
//! the folder that holds them. Excerpts are whole episodes that together have every policy and every event.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::spoilt_traces::{damage, excerpt, leaves, with_line};
use crate::traces::{excerpts, replay_text, text};

fn particles(folder: &Path) -> Vec<PathBuf> {
    let tasks = ["mpe-simple-adversary", "mpe-simple-speaker-listener", "mpe-simple-tag"];
    tasks.iter().map(|task| folder.join(format!("{task}.jsonl.gz"))).collect()
}

#[test]
fn the_excerpts_come_out_as_recorded() {
    let reports: Vec<String> =
        particles(&excerpts()).iter().map(|path| replay_text(&text(path)).unwrap().to_string()).collect();
    let expected = [
        "mpe-simple-adversary: 5 episodes, 125 steps, 0 mismatches",
        "mpe-simple-speaker-listener: 3 episodes, 75 steps, 0 mismatches",
        "mpe-simple-tag: 7 episodes, 175 steps, 0 mismatches",
    ];
    assert_eq!(reports, expected);
}

#[test]
fn the_full_traces_come_out_as_recorded() {
    let Some(folder) = std::env::var_os("RONDO_GOLDEN") else {
        eprintln!("skipped: RONDO_GOLDEN does not name the folder of the full traces");
        return;
    };
    for path in particles(Path::new(&folder)) {
        let report = replay_text(&text(&path)).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        println!("{report}");
        assert_eq!(report.mismatches, 0, "{}: {report}", path.display());
        assert!(report.episodes >= 25, "{}: {report}", path.display());
    }
}

/// Changes one leaf: a number by a little more than the tolerance, or a flag.
fn alter(record: &Value, path: &str) -> String {
    let mut record = record.clone();
    let leaf = record.pointer_mut(path).expect("a path of this record");
    *leaf = match leaf {
        Value::Bool(flag) => Value::from(!*flag),
        Value::Number(number) if number.is_f64() => Value::from(number.as_f64().expect("a float") + 1e-5),
        Value::Number(number) => Value::from(number.as_i64().expect("an integer") + 1),
        other => panic!("{other} is no leaf"),
    };
    record.to_string()
}

fn assert_noticed(lines: &[String], number: usize, fields: &[&str], at_least: usize) {
    let record: Value = serde_json::from_str(&lines[number]).unwrap();
    let paths = leaves(&record, fields);
    assert!(paths.len() >= at_least, "only {} numbers in {fields:?}", paths.len());
    for path in paths {
        if let Ok(report) = replay_text(&with_line(lines, number, &alter(&record, &path))) {
            assert!(report.mismatches > 0, "line {}, {path}: unnoticed", number + 1);
        }
    }
}

const TASKS: [(&str, usize); 3] =
    [("mpe-simple-speaker-listener", 14), ("mpe-simple-adversary", 28), ("mpe-simple-tag", 62)];

#[test]
fn every_altered_number_of_a_record_is_noticed() {
    // Line 7 is an action in the middle of an episode, line 26 the last one.
    let fields =
        ["episode", "t", "rewards", "obs", "terminated", "truncated", "avail_actions", "epymarl", "state"];
    for (task, numbers) in TASKS {
        // The first episode suffices, and the whole excerpt takes long.
        let lines = &excerpt(task)[..27];
        for number in [6, 26] {
            assert_noticed(lines, number, &fields, numbers + 20);
        }
        assert_noticed(lines, 1, &["episode", "state", "obs", "avail_actions"], numbers + 10);
        assert_noticed(
            lines,
            0,
            &["format_version", "n_agents", "n_actions", "obs_sizes", "params", "epymarl"],
            30,
        );
    }
}

#[test]
fn an_altered_action_is_noticed() {
    for (task, _) in TASKS {
        let lines = excerpt(task);
        let record: Value = serde_json::from_str(&lines[6]).unwrap();
        for path in leaves(&record, &["actions"]) {
            let mut altered = record.clone();
            let action = altered.pointer_mut(&path).unwrap();
            *action = Value::from((action.as_u64().unwrap() + 1) % 3);
            let report = replay_text(&with_line(&lines, 6, &altered.to_string())).unwrap();
            assert!(report.mismatches > 0, "{task}, {path}: unnoticed");
        }
    }
}

#[test]
fn it_is_noticed_where_the_wrapper_shows_another_observation() {
    let lines = excerpt("mpe-simple-tag");
    let mismatch = |number: usize, from: &str, to: &str| {
        assert!(lines[number].contains(from), "line {} has no `{from}`", number + 1);
        let spoilt = with_line(&lines, number, &lines[number].replacen(from, to, 1));
        replay_text(&spoilt).unwrap().first.expect("a mismatch").field
    };
    assert!(mismatch(26, r#","obs":"as_before_step""#, "").starts_with("epymarl.obs[0]["));
    let repeated = r#""truncated":false,"obs":"as_before_step"},"state""#;
    assert!(mismatch(6, r#""truncated":false},"state""#, repeated).starts_with("epymarl.obs[0]["));
}

#[test]
fn a_damaged_record_is_an_error_with_its_line_and_what_was_expected() {
    let cases: &[(&str, usize, &str, &str, &str)] = &[
        ("tag", 0, r#""task":"mpe-simple-tag""#, r#""task":"mpe-tag""#, "line 1: expected a task of `mpe-simple-speaker-listener`, `mpe-simple-adversary`, `mpe-simple-tag`, found `mpe-tag`"),
        ("tag", 0, r#""max_speed":1.3"#, r#""max_speed":1.2"#, "line 1: expected Some(1.3) in `params.agents[3].max_speed`, found Some(1.2)"),
        ("adversary", 0, r#""accel":null"#, r#""accel":3.0"#, "line 1: expected 5.0 in `params.agents[0].accel`, found 3.0"),
        ("adversary", 0, r#""controlled":[1,2]"#, r#""controlled":[0,1]"#, "line 1: expected [1, 2] in `epymarl.controlled`, found [0, 1]"),
        ("adversary", 1, r#""goal_landmark":"#, r#""goal_landmark":9"#, "line 2: state: expected a number below 2 as goal_landmark, found 9"),
        ("adversary", 1, r#""goal_landmark":"#, r#""goal_landmark":-1,"was":"#, "line 2: expected a record as JSON: invalid value: integer `-1`, expected usize"),
        ("tag", 1, r#""goal_landmark":null"#, r#""goal_landmark":0"#, "line 2: state: expected null as goal_landmark, found 0"),
        ("tag", 1, r#""pos":["#, r#""pos":[1e308,"#, "line 2: expected a record as JSON: trailing characters"),
        ("tag", 1, r#""step":0"#, r#""step":25"#, "line 2: state: expected a step before 25, where episodes end, found 25"),
        ("tag", 1, r#""landmarks":[["#, r#""landmarks":[[0,0],["#, "line 2: state: expected 2 landmarks, found 3"),
        ("tag", 1, r#""comm":[0.0,0.0]"#, r#""comm":[0.0,1.0]"#, "line 2: state: expected 2 numbers in the comm of agent 0, zeros or one 1 if it is a speaker, found [0.0, 1.0]"),
        ("speaker-listener", 1, r#""comm":[0.0,0.0,0.0]"#, r#""comm":[0.5,0.5,0.0]"#, "line 2: state: expected 3 numbers in the comm of agent 0, zeros or one 1 if it is a speaker, found [0.5, 0.5, 0.0]"),
        ("speaker-listener", 1, r#""vel":[0.0,0.0]"#, r#""vel":[0.0,0.1]"#, "line 2: state: the agent 0 has a velocity, but this body cannot move"),
        ("speaker-listener", 2, r#""actions":["#, r#""actions":[0,"#, "line 3: expected 2 entries in `actions`, found 3"),
        ("speaker-listener", 2, r#""actions":["#, r#""actions":[3,0],"was":["#, "line 3: expected an action below 3 of agent 0, found 3"),
        ("speaker-listener", 2, r#""obs":[["#, r#""obs":[[0,"#, "line 3: expected 3 entries in `obs[0]`, found 4"),
        ("tag", 2, r#""rewards":["#, r#""rewards":[0,"#, "line 3: expected 4 entries in `rewards`, found 5"),
        ("tag", 2, r#""t":1"#, r#""t":2"#, "line 3: expected step 1 of episode"),
        ("tag", 26, r#""as_before_step""#, r#""as_after_step""#, "line 27: expected a record as JSON: unknown variant `as_after_step`, expected `as_before_step`"),
        ("tag", 1, r#""reset""#, r#""rest""#, "line 2: expected a record of type `reset` or `step`, found `rest`"),
    ];
    for (task, number, from, to, expected) in cases {
        let lines = excerpt(&format!("mpe-simple-{task}"));
        assert!(lines[*number].contains(from), "line {} has no `{from}`", number + 1);
        let found = damage(&with_line(&lines, *number, &lines[*number].replacen(from, to, 1)));
        assert!(found.starts_with(expected), "{from} as {to}: {found}, expected {expected}");
    }
}

#[test]
fn places_that_no_game_comes_to_are_refused() {
    let lines = excerpt("mpe-simple-tag");
    let mut record: Value = serde_json::from_str(&lines[1]).unwrap();
    record["state"]["agents"][2]["pos"][1] = Value::from(1e308);
    let found = damage(&with_line(&lines, 1, &record.to_string()));
    assert!(
        found.starts_with("line 2: state: expected numbers within ±1000000 for the place of agent 2"),
        "{found}"
    );
}

#[test]
fn a_trace_that_lacks_lines_is_an_error() {
    let lines = excerpt("mpe-simple-adversary");
    let without = |number: usize| damage(&[&lines[..number], &lines[number + 1..]].concat().join("\n"));
    assert_eq!(damage(&lines[0]), "line 2: expected an episode, found the end of the file");
    assert_eq!(without(1), "line 2: expected a reset before the first step");
    assert_eq!(without(26), "line 27: expected step 25 of episode 1, which is not over");
    assert_eq!(without(27), "line 28: expected a reset, as the episode is over");
    assert_eq!(damage(&lines[..40].join("\n")), "line 41: expected step 13 of episode 7, which is not over");
}

#[test]
fn two_bodies_in_one_place_do_not_stop_a_replay() {
    let lines = excerpt("mpe-simple-tag");
    let mut record: Value = serde_json::from_str(&lines[1]).unwrap();
    record["state"]["agents"][1]["pos"] = record["state"]["agents"][0]["pos"].clone();
    record["state"]["landmarks"][1] = record["state"]["agents"][0]["pos"].clone();
    let report = replay_text(&with_line(&lines, 1, &record.to_string())).unwrap();
    assert!(report.mismatches > 0);
}
