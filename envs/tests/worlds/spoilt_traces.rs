//! Altered and damaged traces: every altered number is noticed, every damage is an error that names the place.

use envs::replay::ReplayError;
use serde_json::Value;

use crate::traces::{excerpts, replay_text, text};

pub fn excerpt(name: &str) -> Vec<String> {
    text(&excerpts().join(format!("{name}.jsonl.gz"))).lines().map(str::to_owned).collect()
}

/// The number (from 0) of the first line of a step in which something was loaded.
fn first_load(lines: &[String]) -> usize {
    lines.iter().position(|line| line.contains(r#""load""#)).expect("the excerpt has a load")
}

pub fn with_line(lines: &[String], number: usize, line: &str) -> String {
    let mut lines = lines.to_vec();
    line.clone_into(&mut lines[number]);
    lines.join("\n")
}

/// The paths of all numbers and flags of a record, below the named fields.
pub fn leaves(record: &Value, fields: &[&str]) -> Vec<String> {
    fn collect(value: &Value, path: String, found: &mut Vec<String>) {
        match value {
            Value::Array(entries) => {
                for (k, entry) in entries.iter().enumerate() {
                    collect(entry, format!("{path}/{k}"), found);
                }
            }
            Value::Object(entries) => {
                for (key, entry) in entries {
                    collect(entry, format!("{path}/{key}"), found);
                }
            }
            Value::Number(_) | Value::Bool(_) => found.push(path),
            Value::Null | Value::String(_) => {}
        }
    }
    let mut found = vec![];
    for field in fields {
        collect(&record[field], format!("/{field}"), &mut found);
    }
    found
}

/// Changes one leaf by as little as its kind allows.
fn alter(record: &Value, path: &str) -> String {
    let mut record = record.clone();
    let leaf = record.pointer_mut(path).expect("a path of this record");
    *leaf = match leaf {
        Value::Bool(flag) => Value::from(!*flag),
        Value::Number(number) if number.is_f64() => Value::from(number.as_f64().expect("a float").next_up()),
        Value::Number(number) => Value::from(number.as_i64().expect("an integer") + 1),
        other => panic!("{other} is no leaf"),
    };
    record.to_string()
}

pub fn assert_noticed(lines: &[String], number: usize, fields: &[&str], at_least: usize) {
    let record: Value = serde_json::from_str(&lines[number]).unwrap();
    let paths = leaves(&record, fields);
    assert!(paths.len() >= at_least, "only {} numbers in {fields:?}", paths.len());
    for path in paths {
        let altered = with_line(lines, number, &alter(&record, &path));
        if let Ok(report) = replay_text(&altered) {
            assert!(report.mismatches > 0, "line {}, {path}: unnoticed", number + 1);
            assert!(report.first.is_some());
        }
    }
}

#[test]
fn every_altered_number_of_a_step_is_noticed() {
    // Not the actions: one without effect can be altered into another.
    let fields = [
        "episode",
        "t",
        "effective_actions",
        "rewards",
        "obs",
        "terminated",
        "truncated",
        "avail_actions",
        "epymarl",
        "state",
    ];
    for name in ["lbf-10x10-3p-3f", "lbf-2s-6x6-4p-2f-pen"] {
        let lines = excerpt(name);
        assert_noticed(&lines, first_load(&lines), &fields, 3 * 18 + 3 * 6 + 3 + 3 + 18);
    }
}

#[test]
fn an_altered_action_that_loaded_is_noticed() {
    let lines = excerpt("lbf-8x8-2p-2f-coop");
    assert_noticed(&lines, first_load(&lines), &["actions"], 2);
}

#[test]
fn every_altered_number_of_a_start_is_noticed() {
    for name in ["lbf-10x10-3p-3f", "lbf-2s-6x6-4p-2f-pen"] {
        let lines = excerpt(name);
        assert_noticed(&lines, 1, &["episode", "state", "obs", "avail_actions"], 3 * 18 + 3 * 6 + 15);
    }
}

#[test]
fn an_altered_header_is_noticed() {
    let lines = excerpt("lbf-2s-6x6-4p-2f-pen");
    let fields = ["format_version", "n_agents", "n_actions", "obs_sizes", "episode_limit", "epymarl"];
    assert_noticed(&lines, 0, &fields, 20);
    for path in ["/params/rows", "/params/cols", "/params/max_num_food", "/params/sight", "/params/penalty"] {
        let record: Value = serde_json::from_str(&lines[0]).unwrap();
        let outcome = replay_text(&with_line(&lines, 0, &alter(&record, path)));
        assert!(outcome.map_or(true, |report| report.mismatches > 0), "{path}: unnoticed");
    }
}

#[test]
fn the_report_shows_the_first_difference_in_full() {
    let lines = excerpt("lbf-8x8-2p-2f-coop");
    let load = first_load(&lines);
    let record: Value = serde_json::from_str(&lines[load]).unwrap();
    let spoilt = with_line(&lines, load, &alter(&record, "/rewards/1"));
    let report = replay_text(&spoilt).unwrap();
    let first = report.first.as_ref().unwrap();
    assert_eq!((first.line, first.field.as_str()), (load as u64 + 1, "rewards[1]"));
    assert_eq!(report.mismatches, 1);
    assert_eq!(
        report.to_string(),
        "lbf-8x8-2p-2f-coop: 10 episodes, 453 steps, 1 mismatches; the first: line 236, episode 4, t 30, \
         rewards[1]: expected 0.33333333333333337, found 0.3333333333333333"
    );
}

pub fn damage(text: &str) -> String {
    let error = replay_text(text).expect_err("the trace is damaged");
    assert!(matches!(error, ReplayError::Damaged { .. }), "{error:?}");
    error.to_string().strip_prefix("trace, ").expect("the name of the trace comes first").to_owned()
}

#[test]
fn a_damaged_record_is_an_error_with_its_line_and_what_was_expected() {
    let lines = excerpt("lbf-8x8-2p-2f-coop");
    // Line (from 0), what stands there, what is put in its place, the message.
    for (number, from, to, expected) in [
        (0, r#""header""#, r#""head""#, "line 1: expected a record of type `header` first, found `head`"),
        (0, r#""format_version":1"#, r#""format_version":2"#, "line 1: expected format_version 1, found 2"),
        (0, r#""rows":8"#, r#""rows":2"#, "line 1: impossible task: the number of rows must be 3 to 255 (no food lies on the border), not 2"),
        (0, r#""rows":8"#, r#""rows":-8"#, "line 1: expected a record as JSON: invalid value: integer `-8`, expected u16 (column 293)"),
        (0, r#""rows":8,"#, "", "line 1: expected a record as JSON: missing field `rows` (column 394)"),
        (0, r#""obs_sizes":[12,12]"#, r#""obs_sizes":[12]"#, "line 1: expected [12, 12] in `obs_sizes`, found [12]"),
        (0, r#""state_size":24"#, r#""state_size":12"#, "line 1: expected 24 in `epymarl.state_size`, found 12"),
        (1, r#""reset""#, r#""rest""#, "line 2: expected a record of type `reset` or `step`, found `rest`"),
        (1, r#""reset""#, r#""header""#, "line 2: expected a record of type `reset` or `step`, found `header`"),
        (1, r#""row":4"#, r#""row":8"#, "line 2: state: player 0 is at row 8, column 6, outside of the 8x8 grid"),
        (1, r#""row":4"#, r#""row":"4""#, "line 2: expected a record as JSON: invalid type: string \"4\", expected u16 (column 106)"),
        (1, r#""obs":[[2,"#, r#""obs":[["#, "line 2: expected 12 entries in `obs[0]`, found 11"),
        (2, r#""t":1"#, r#""t":2"#, "line 3: expected step 1 of episode 0, found step 2 of episode 0"),
        (2, r#""actions":[5,3]"#, r#""actions":[6,3]"#, "line 3: expected actions below 6, found 6"),
        (2, r#""actions":[5,3]"#, r#""actions":[5]"#, "line 3: expected 2 entries in `actions`, found 1"),
        (2, r#""rewards":[0.0,0.0]"#, r#""rewards":[0.0,1e999]"#, "line 3: expected a record as JSON: number out of range (column 109)"),
        (2, r#","terminated":false"#, "", "line 3: expected a record as JSON: missing field `terminated` (column 514)"),
        (2, r#"{"type""#, r#""type""#, "line 3: expected a record as JSON: invalid type: string \"type\", expected an object (column 6)"),
    ] {
        assert!(lines[number].contains(from), "line {} has no `{from}`", number + 1);
        let spoilt = with_line(&lines, number, &lines[number].replacen(from, to, 1));
        assert_eq!(damage(&spoilt), expected, "{from} as {to}");
    }
}

#[test]
fn a_trace_that_lacks_lines_is_an_error() {
    let lines = excerpt("lbf-8x8-2p-2f-coop");
    let whole = lines.join("\n");
    let second = 1 + lines[2..].iter().position(|line| line.contains(r#""reset""#)).unwrap() + 1;
    let without = |number: usize| damage(&[&lines[..number], &lines[number + 1..]].concat().join("\n"));
    assert_eq!(damage(""), "line 1: expected a header, found the end of the file");
    assert_eq!(damage(&lines[0]), "line 2: expected an episode, found the end of the file");
    assert_eq!(without(0), "line 1: expected a record as JSON: missing field `format_version` (column 363)");
    assert_eq!(without(1), "line 2: expected a reset before the first step");
    assert_eq!(without(2), "line 3: expected step 1 of episode 0, found step 2 of episode 0");
    assert_eq!(without(second - 1), "line 52: expected step 50 of episode 0, which is not over");
    assert_eq!(without(second), "line 53: expected a reset, as the episode is over");
    assert_eq!(
        damage(&lines[..lines.len() - 1].join("\n")),
        "line 464: expected step 33 of episode 22, which is not over"
    );
    assert_eq!(damage(&whole[..whole.len() - 40]), "line 464: expected a record as JSON: EOF while parsing an object (column 468); the line looks cut off");
}

#[test]
fn text_that_is_no_text_is_an_error() {
    let error = envs::replay::replay(&b"\xff\xfe\n"[..], "bytes").unwrap_err();
    assert_eq!(error.to_string(), "bytes, line 1: expected a record as JSON: expected value (column 1)");
}

#[test]
fn a_stream_that_breaks_is_an_error_with_its_line() {
    struct Broken;
    impl std::io::Read for Broken {
        fn read(&mut self, _: &mut [u8]) -> std::io::Result<usize> {
            Err(std::io::Error::other("the disk is gone"))
        }
    }
    let lines = excerpt("lbf-8x8-2p-2f-coop");
    let head = format!("{}\n", lines[..2].join("\n"));
    let stream = std::io::BufReader::new(std::io::Read::chain(head.as_bytes(), Broken));
    let error = envs::replay::replay(stream, "trace").unwrap_err();
    assert_eq!(error.to_string(), "trace, line 3: cannot read on: the disk is gone");
}

#[test]
fn a_trace_of_another_family_is_named() {
    let header = r#"{"type":"header","format_version":1,"env":"chess","task":"chess-8x8"}"#;
    let error = replay_text(header).unwrap_err();
    assert!(matches!(error, ReplayError::Unsupported { .. }));
    assert_eq!(
        error.to_string(),
        "trace is a trace of `chess` (task `chess-8x8`), which cannot be replayed; lbf, rware, mpe and smaclite can"
    );
}
