//! Altered and damaged records of battles: what is altered is noticed, what is damaged is an error that says where.

use serde_json::Value;

use crate::spoilt_traces::{damage, excerpt, leaves, with_line};
use crate::traces::replay_text;

/// More than bodies that touch are off by.
const MUCH: f64 = 0.07;

/// Changes one number or flag at a time and expects that it is noticed.
fn assert_noticed(lines: &[String], number: usize, fields: &[&str], at_least: usize) {
    let record: Value = serde_json::from_str(&lines[number]).unwrap();
    let paths = leaves(&record, fields);
    assert!(paths.len() >= at_least, "only {} numbers in {fields:?}", paths.len());
    for path in paths {
        let mut altered = record.clone();
        let leaf = altered.pointer_mut(&path).expect("a path of this record");
        *leaf = match leaf {
            Value::Bool(flag) => Value::from(!*flag),
            Value::Number(number) if number.is_f64() => Value::from(number.as_f64().expect("a float") + MUCH),
            Value::Number(number) => Value::from(number.as_i64().expect("an integer") + 1),
            other => panic!("{other} is no leaf"),
        };
        if let Ok(report) = replay_text(&with_line(lines, number, &altered.to_string())) {
            assert!(report.mismatches > 0, "line {}, {path}: unnoticed: {report}", number + 1);
        }
    }
}

/// The number (from 0) of the first line of a step with that event.
fn first(lines: &[String], event: &str) -> usize {
    let event = format!("\"{event}\"");
    lines.iter().position(|line| line.contains(&event)).expect("the excerpt has such an event")
}

/// The header and the first episode.
fn first_episode(lines: &[String]) -> Vec<String> {
    let is_reset = |line: &String| line.contains(r#""type":"reset""#);
    let end = lines[2..].iter().position(is_reset).map_or(lines.len(), |length| length + 2);
    lines[..end].to_vec()
}

#[test]
fn every_altered_number_of_a_step_is_noticed() {
    let fields = [
        "episode",
        "t",
        "random",
        "rewards",
        "obs",
        "terminated",
        "truncated",
        "info",
        "avail_actions",
        "epymarl",
        "state",
        "global_state",
    ];
    let lines = first_episode(&excerpt("smaclite-mmm2"));
    assert_noticed(&lines, first(&lines, "revived"), &fields, 10 * (176 + 18) + 322);
    let lines = first_episode(&excerpt("smaclite-3s_vs_5z"));
    assert_noticed(&lines, first(&lines, "enemy_killed"), &fields, 3 * (48 + 11) + 68);
}

#[test]
fn every_altered_number_of_a_start_is_noticed() {
    let lines = first_episode(&excerpt("smaclite-3s_vs_5z"));
    assert_noticed(&lines, 1, &["obs", "avail_actions", "global_state"], 3 * (48 + 11) + 68);
}

#[test]
fn an_altered_header_is_noticed() {
    let lines = first_episode(&excerpt("smaclite-mmm2"));
    let fields = ["format_version", "n_agents", "n_actions", "obs_sizes", "episode_limit", "epymarl"];
    assert_noticed(&lines, 0, &fields, 20);
    for (from, to, expected) in [
        (r#""n_enemies":12"#, r#""n_enemies":13"#, "line 1: expected 12 in `params.n_enemies`, found 13"),
        (
            r#""max_reward":1205.0"#,
            r#""max_reward":1200.0"#,
            "line 1: expected 1205.0 in `params.max_reward`, found 1200.0",
        ),
        (
            r#""max_unit_radius":0.75"#,
            r#""max_unit_radius":1.0"#,
            "line 1: expected 0.75 in `params.max_unit_radius`, found 1.0",
        ),
        (
            r#""ticks_per_step":8"#,
            r#""ticks_per_step":16"#,
            "line 1: expected 8 in `params.ticks_per_step`, found 16",
        ),
        (r#""marauder":0,"marine":1"#, r#""marauder":1,"marine":0"#, "line 1: expected {"),
        (
            r#""id_in_faction":1,"#,
            r#""id_in_faction":2,"#,
            "line 1: expected 1 in `params.units[1].id_in_faction`, found 2",
        ),
        (
            r#""faction":"ALLY""#,
            r#""faction":"ENEMY""#,
            "line 1: expected 13 in `params.n_enemies`, found 12",
        ),
        (
            r#""type":"marine""#,
            r#""type":"ghost""#,
            "line 1: params: unknown unit `ghost`: expected one of baneling, ",
        ),
        (
            r#""width":32"#,
            r#""width":0"#,
            "line 1: params: expected a map of up to 256 cells each way, found 0 x 32",
        ),
        (
            r#"[0,24,32,8]"#,
            r#"[0,24,33,8]"#,
            "line 1: params: expected obstacles on the map of 32 x 32 cells, found [0, 24, 33, 8]",
        ),
        (
            r#"[0,24,32,8]"#,
            r#"[0,24,32]"#,
            "line 1: expected a record as JSON: invalid length 3, expected an array of length 4",
        ),
    ] {
        assert!(lines[0].contains(from), "the header has no `{from}`");
        let message = damage(&with_line(&lines, 0, &lines[0].replacen(from, to, 1)));
        assert!(message.starts_with(expected), "{from} as {to}: {message}");
    }
}

#[test]
fn a_damaged_record_is_an_error_with_its_line_and_what_was_expected() {
    let lines = first_episode(&excerpt("smaclite-3s_vs_5z"));
    for (number, from, to, expected) in [
        (1, r#"{"id":0,"#, r#"{"id":7,"#, "line 2: expected 0 in `state.units[0].id`, found 7"),
        (1, r#""pos":["#, r#""pos":[1e9,"#, "line 2: expected a record as JSON: "),
        (1, r#""hp":80.0"#, r#""hp":800.0"#, "line 2: state: unit 0: expected `hp` from 0 to 80, found 800"),
        (
            1,
            r#""shield":80.0"#,
            r#""shield":-1.0"#,
            "line 2: state: unit 0: expected `shield` from 0 to 80, found -1",
        ),
        (
            1,
            r#""target":-1"#,
            r#""target":8"#,
            "line 2: state: unit 0: expected another unit or -1 in `target`, found 8",
        ),
        (
            1,
            r#""attacking":0"#,
            r#""attacking":2"#,
            "line 2: state: unit 0: expected 0 or 1 in `attacking`, found 2",
        ),
        (2, r#""t":1"#, r#""t":2"#, "line 3: expected step 1 of episode 26, found step 2 of episode 26"),
        (2, r#""actions":["#, r#""actions":[11,"#, "line 3: expected 3 entries in `actions`, found 4"),
        (2, r#""fields":["id","#, r#""fields":["no","#, "line 3: expected [\"id\", "),
        (
            2,
            r#""units":[[0,"#,
            r#""units":[[1,"#,
            "line 3: expected another unit of the battle in `state.units[1]`, found 1",
        ),
        (
            2,
            r#""units":[[0,"#,
            r#""units":[[9,"#,
            "line 3: expected another unit of the battle in `state.units[0]`, found 9",
        ),
        (
            2,
            r#""tick_orders":["#,
            r#""tick_orders":[[0],"#,
            "line 3: expected 8 entries in `random.tick_orders`, found 9",
        ),
    ] {
        assert!(lines[number].contains(from), "line {} has no `{from}`", number + 1);
        let message = damage(&with_line(&lines, number, &lines[number].replacen(from, to, 1)));
        assert!(message.starts_with(expected), "{from} as {to}: {message}");
    }
    let cut = lines[..lines.len() - 1].join("\n");
    assert!(damage(&cut).contains(", which is not over"), "{}", damage(&cut));
}

#[test]
fn a_place_that_is_off_a_little_is_excused_once_and_not_twice() {
    let lines = first_episode(&excerpt("smaclite-3s_vs_5z"));
    let last = lines.len() - 1;
    let shifted = |lines: &[String], number: usize, by: f64| {
        let mut record: Value = serde_json::from_str(&lines[number]).unwrap();
        let x = record.pointer_mut("/state/units/0/1/0").expect("the place of a unit");
        *x = Value::from(x.as_f64().unwrap() + by);
        with_line(lines, number, &record.to_string())
    };
    let report = replay_text(&shifted(&lines, last, 0.001)).unwrap();
    assert_eq!((report.mismatches, report.excused), (0, 1));
    assert!(
        report.to_string().ends_with("0 mismatches (1 steps excused: bodies touch to the last bit)"),
        "{report}"
    );
    // A step from a place that is off ends off as well.
    let report = replay_text(&shifted(&lines, last - 5, 0.001)).unwrap();
    assert!(report.mismatches > 0 && report.excused == 0, "{report}");
    let report = replay_text(&shifted(&lines, last, 0.1)).unwrap();
    assert!(report.mismatches > 0 && report.excused == 0, "{report}");
}

#[test]
fn altered_and_damaged_ticks_are_noticed_too() {
    let lines = excerpt("smaclite-ticks")[..40].to_vec();
    let fields = ["t", "tick", "order", "units"];
    assert_noticed(&lines, 20, &fields, 8 + 8 * 10);
    for (number, from, to, expected) in [
        (
            0,
            "smaclite-3s_vs_5z",
            "smaclite-4s",
            "line 1: expected a battle that comes with the program in `task`, found `smaclite-4s`",
        ),
        (0, "new_vel", "velocity", "line 1: expected [\"id\", "),
        (1, r#""tick":0"#, r#""tick":1"#, "line 2: expected (1, 0) in `(t, tick)`, found (1, 1)"),
        (
            1,
            r#""order":["#,
            r#""order":[1,"#,
            "line 2: expected [0, 1, 2, 3, 4, 5, 6, 7] in `order`, found [",
        ),
        (1, r#""actions":["#, r#""actions":[1,"#, "line 2: expected 3 entries in `actions`, found 4"),
        (
            1,
            r#""type":"tick""#,
            r#""type":"step""#,
            "line 2: expected a record of type `episode` or `tick`, found `step`",
        ),
    ] {
        let message = damage(&with_line(&lines, number, &lines[number].replacen(from, to, 1)));
        assert!(message.starts_with(expected), "{from} as {to}: {message}");
    }
    let message = damage(&lines[..5].join("\n"));
    assert!(
        message.ends_with("expected tick 4 of step 1 of episode 30, found the end of the episode"),
        "{message}"
    );
}
