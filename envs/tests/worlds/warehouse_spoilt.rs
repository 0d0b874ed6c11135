//! Altered and damaged warehouse traces: every alteration is noticed, every damage is an error that names the place.

use serde_json::Value;

use crate::spoilt_traces::{assert_noticed, damage, excerpt, with_line};
use crate::traces::replay_text;

/// The number (from 0) of the first line of a step with that event.
fn first(lines: &[String], event: &str) -> usize {
    let event = format!("\"{event}\"");
    lines.iter().position(|line| line.contains(&event)).expect("the excerpt has such an event")
}

/// The header and the episode that first has that event.
fn episode_with(lines: &[String], event: &str) -> Vec<String> {
    let is_reset = |line: &String| line.contains(r#""type":"reset""#);
    let event = first(lines, event);
    let start = lines[..event].iter().rposition(is_reset).expect("a reset comes first");
    let end = lines[event..].iter().position(is_reset).map_or(lines.len(), |length| event + length);
    [&lines[..1], &lines[start..end]].concat()
}

#[test]
fn every_altered_number_of_a_step_is_noticed() {
    let fields = [
        "episode",
        "t",
        "random",
        "effective_actions",
        "ties",
        "rewards",
        "obs",
        "terminated",
        "truncated",
        "avail_actions",
        "epymarl",
        "state",
    ];
    for event in ["double_delivery", "tie"] {
        let lines = episode_with(&excerpt("rware-tiny-2ag"), event);
        assert_noticed(&lines, first(&lines, event), &fields, 2 * 71 + 2 * 5 + 2 * 4 + 8);
    }
}

#[test]
fn every_altered_number_of_a_start_is_noticed() {
    let lines = episode_with(&excerpt("rware-tiny-2ag"), "double_delivery");
    assert_noticed(&lines, 1, &["state", "obs", "avail_actions"], 2 * 71 + 2 * 5 + 2 * 4 + 32 * 3 + 3);
}

#[test]
fn an_altered_header_is_noticed() {
    let lines = excerpt("rware-2s-2x1-4h-5ag-hard");
    let fields =
        ["format_version", "n_agents", "n_actions", "obs_sizes", "episode_limit", "epymarl", "params"];
    assert_noticed(&lines, 0, &fields, 20 + 2 + 4 + 2);
}

#[test]
fn a_damaged_record_is_an_error_with_its_line_and_what_was_expected() {
    let lines = excerpt("rware-tiny-2ag");
    // Line (from 0), what stands there, what is put in its place, the message.
    for (number, from, to, expected) in [
        (0, r#""height":11"#, r#""height":12"#, "line 1: expected 12 entries in `params.highways`, found 11"),
        (0, r#""width":10"#, r#""width":11"#, "line 1: expected a grid of shelf blocks between highways, 3 columns each and 1 more, found 11x11 cells"),
        (0, r#""width":10"#, r#""width":65530"#, "line 1: impossible task: the grid would have 65530x11 cells; no side may be longer than 255"),
        (0, r#""height":11"#, r#""height":2"#, "line 1: expected a grid of shelf blocks between highways, 3 columns each and 1 more, found 10x2 cells"),
        (0, r#""1001111001""#, r#""1001110001""#, "line 1: expected \"1001111001\" in `params.highways[1]`, found \"1001110001\""),
        (0, "[[4,10],[5,10]]", "[[5,10],[4,10]]", "line 1: expected [(4, 10), (5, 10)] in `params.goals_xy`, found [(5, 10), (4, 10)]"),
        (0, r#""request_queue_size":2"#, r#""request_queue_size":32"#, "line 1: impossible task: 32 requests are too many for 32 shelves; one at least must be left to be requested next"),
        (0, r#""n_agents":2"#, r#""n_agents":70000"#, "line 1: n_agents is 70000"),
        (0, r#""sensor_range":1"#, r#""sensor_range":2"#, "line 1: expected [183, 183] in `obs_sizes`, found [71, 71]"),
        (0, r#""state_size":142"#, r#""state_size":71"#, "line 1: expected 142 in `epymarl.state_size`, found 71"),
        (1, r#"{"id":1,"#, r#"{"id":2,"#, "line 2: expected 1 in `state.agents[0].id`, found 2"),
        (1, "[1,1,1]", "[3,1,1]", "line 2: expected 1 in `state.shelves[0][0]`, found 3"),
        (1, "[1,1,1]", "[1,2,1]", "line 2: state: shelf 2 is on the cell of shelf 1 (x 2, y 1)"),
        (1, "[32,8,8]", "[32,8,99999]", "line 2: expected a record as JSON: invalid value: integer `99999`, expected u16"),
        (1, "[32,8,8]", "[32,8]", "line 2: expected a record as JSON: invalid length 2, expected a tuple of size 3"),
        (1, ",[32,8,8]", "", "line 2: state: expected 32 shelves, found 31"),
        (1, r#""carrying":0"#, r#""carrying":7"#, "line 2: state: robot 1 at x "),
        (1, r#""carrying":0"#, r#""carrying":-1"#, "line 2: expected a record as JSON: invalid value: integer `-1`, expected u16"),
        (1, r#""dir":""#, r#""dir":"N"#, "line 2: expected a record as JSON: unknown variant `N"),
        (2, r#""t":1"#, r#""t":2"#, "line 3: expected step 1 of episode 11, found step 2 of episode 11"),
        (2, r#""actions":["#, r#""actions":[1,"#, "line 3: expected 2 entries in `actions`, found 3"),
        (2, r#""actions":["#, r#""actions":[5"#, "line 3: expected actions below 5, found 5"),
        (2, r#""new_requests":[]"#, r#""new_requests":[""]"#, "line 3: expected a record as JSON: invalid type: string \"\", expected u16"),
        (2, r#""effective_actions":["#, r#""effective_actions":[1,"#, "line 3: expected 2 entries in `effective_actions`, found 3"),
        (2, r#""random""#, r#""chance""#, "line 3: expected a record as JSON: missing field `random`"),
    ] {
        assert!(lines[number].contains(from), "line {} has no `{from}`", number + 1);
        let spoilt = with_line(&lines, number, &lines[number].replacen(from, to, 1));
        let message = damage(&spoilt);
        assert!(message.starts_with(expected), "{from} as {to}: {message}");
    }
}

#[test]
fn robots_on_one_cell_and_doubles_in_the_queue_are_refused() {
    let lines = excerpt("rware-tiny-2ag");
    let with_state = |change: &dyn Fn(&mut Value)| {
        let mut record: Value = serde_json::from_str(&lines[1]).unwrap();
        change(&mut record["state"]);
        damage(&with_line(&lines, 1, &record.to_string()))
    };
    let message = with_state(&|state| {
        for axis in ["x", "y"] {
            state["agents"][1][axis] = state["agents"][0][axis].clone();
        }
    });
    assert!(message.starts_with("line 2: state: robot 2 is on the cell of robot 1 (x "), "{message}");
    let message = with_state(&|state| state["request_queue"] = Value::from(vec![4, 4]));
    assert_eq!(message, "line 2: state: the request queue has shelf 4 twice");
    let message = with_state(&|state| state["request_queue"] = Value::from(vec![4, 33]));
    assert_eq!(message, "line 2: state: the request queue has shelf 33; there are shelves 1 to 32");
}

#[test]
fn a_draw_that_was_not_needed_lacks_or_is_not_allowed_is_a_mismatch() {
    let lines = excerpt("rware-tiny-2ag");
    let delivery = first(&lines, "delivery");
    let mut record: Value = serde_json::from_str(&lines[delivery]).unwrap();
    let drawn = record["random"]["new_requests"].clone();
    let queue = record["state"]["request_queue"][0].clone();
    let other = record["state"]["request_queue"][1].clone();
    assert_eq!(drawn.as_array().map(Vec::len), Some(1));
    let kept = if drawn[0] == queue { other } else { queue };
    for spoilt in [vec![], vec![drawn[0].clone(), Value::from(1)], vec![kept], vec![Value::from(60_000)]] {
        record["random"]["new_requests"] = Value::from(spoilt);
        let report = replay_text(&with_line(&lines, delivery, &record.to_string())).unwrap();
        let first = report.first.expect("a mismatch");
        assert_eq!(first.line, delivery as u64 + 1);
    }
}
