//! The layout of `Observe` byte by byte, and each reason to refuse one.

use super::*;

/// Three rows: copies and ends have nine bytes and need three bytes of padding.
fn example() -> Observe {
    Observe {
        mode: Mode::Train,
        epoch: 1,
        round: 2,
        tick: 3,
        t_env: 1000,
        obs_size: 2,
        n_actions: 3,
        copies: vec![0, 2, 258],
        ends: vec![End::Running, End::Terminated, End::TimeLimit],
        rewards: vec![0.5, 1.0, -2.0],
        obs: vec![0.0, 1.0, 2.0, 3.0, -1.0, -0.0],
        avail: vec![1, 0, 1, 0, 0, 0, 1, 1, 1],
    }
}

fn encoded(observe: &Observe) -> Vec<u8> {
    let mut out = vec![9; 1000];
    observe.encode(&mut out);
    out
}

fn value_error(bytes: &[u8]) -> String {
    match Observe::default().decode(bytes) {
        Err(WireError::Value { what, .. }) => what,
        other => panic!("expected a value error, got {other:?}"),
    }
}

/// The error for the example with one change.
fn refused(change: impl FnOnce(&mut Observe)) -> String {
    let mut observe = example();
    change(&mut observe);
    value_error(&encoded(&observe))
}

#[test]
fn sections_follow_a_header_of_40_bytes() {
    #[rustfmt::skip]
    let expected = [
        2, 1, 0, 0,  1, 0, 0, 0,  2, 0, 0, 0, 0, 0, 0, 0,  3, 0, 0, 0,  3, 0, 2, 0, 3, 0, 0, 0,  0, 0, 0, 0,
        232, 3, 0, 0, 0, 0, 0, 0,
        0, 0, 2, 0, 2, 1,  0, 1, 2,  0, 0, 0,
        0, 0, 0, 0x3f,  0, 0, 0x80, 0x3f,  0, 0, 0, 0xc0,
        0, 0, 0, 0,  0, 0, 0x80, 0x3f,  0, 0, 0, 0x40,  0, 0, 0x40, 0x40,  0, 0, 0x80, 0xbf,  0, 0, 0, 0x80,
        1, 0, 1, 0, 0, 0, 1, 1, 1,
    ];
    assert_eq!(encoded(&example()), expected);
    assert_eq!(Observe::encoded_len(3, 2, 3), expected.len());
}

#[test]
fn decoding_replaces_what_the_buffer_held_before() {
    let mut observe = Observe { copies: vec![7; 50], obs: vec![1.0; 99], epoch: 44, ..Observe::default() };
    observe.decode(&encoded(&example())).unwrap();
    assert_eq!(observe, example());
    assert_eq!(observe.id().to_string(), "epoch 1, train round 2, tick 3");
}

#[test]
fn decoding_into_a_grown_buffer_does_not_allocate_again() {
    let bytes = encoded(&example());
    let mut observe = Observe::default();
    observe.decode(&bytes).unwrap();
    let before =
        [observe.obs.as_ptr().addr(), observe.rewards.as_ptr().addr(), observe.avail.as_ptr().addr()];
    observe.decode(&bytes).unwrap();
    let after = [observe.obs.as_ptr().addr(), observe.rewards.as_ptr().addr(), observe.avail.as_ptr().addr()];
    assert_eq!(before, after);
}

#[test]
fn rows_are_cut_out_of_the_row_major_arrays() {
    let observe = example();
    assert_eq!(observe.rows(), 3);
    assert_eq!(observe.observation(1), [2.0, 3.0]);
    assert_eq!(observe.available(0), [1, 0, 1]);
    assert_eq!(observe.running().collect::<Vec<_>>(), [0]);
}

#[test]
fn a_closing_message_has_no_rows_and_the_others_have_some() {
    for mode in [Mode::Finished, Mode::Stopped] {
        let closing = Observe { mode, round: 9, ..Observe::default() };
        let mut read = example();
        read.decode(&encoded(&closing)).unwrap();
        assert_eq!(read, closing);
    }
    assert_eq!(refused(|o| o.mode = Mode::Stopped), "3 rows in mode stopped: expected none");
    let empty = Observe { mode: Mode::Test, ..Observe::default() };
    assert_eq!(value_error(&encoded(&empty)), "0 rows in mode test: expected at least one");
}

#[test]
fn impossible_values_are_refused() {
    let finite = "a reward or an observation is not finite";
    assert_eq!(refused(|o| o.rewards[2] = f32::NAN), finite);
    assert_eq!(refused(|o| o.obs[5] = f32::INFINITY), finite);
    assert_eq!(refused(|o| o.obs[0] = f32::NEG_INFINITY), finite);
    assert_eq!(refused(|o| o.avail[8] = 2), "an availability is neither 0 nor 1");
    assert_eq!(refused(|o| o.avail[3] = 255), "an availability is neither 0 nor 1");
    assert_eq!(refused(|o| o.copies[1] = 0), "the copies are not strictly increasing");
    assert_eq!(refused(|o| o.copies[2] = 1), "the copies are not strictly increasing");
    assert_eq!(refused(|o| o.avail[..3].fill(0)), "row 0 is running but has no available action");
    let start = "tick 0 has an end or a reward: expected neither before the first step";
    assert_eq!(refused(|o| o.tick = 0), start);
}

#[test]
fn unknown_codes_and_nonzero_reserved_bytes_are_refused() {
    let with = |at: usize, value: u8| {
        let mut bytes = encoded(&example());
        bytes[at] = value;
        value_error(&bytes)
    };
    assert_eq!(with(2, 9), "mode is 9: expected 0 (train), 1 (test), 2 (finished) or 3 (stopped)");
    assert_eq!(with(47, 3), "end is 3: expected 0 (running), 1 (terminated) or 2 (time limit)");
    for reserved in [3, 26, 27, 28, 29, 30, 31] {
        assert_eq!(with(reserved, 1), "a reserved byte of the header is not zero");
    }
    for padding in [49, 50, 51] {
        assert_eq!(with(padding, 1), "a byte of padding is not zero");
    }
}

#[test]
fn a_header_that_promises_gigabytes_is_refused_by_its_length() {
    let mut bytes = encoded(&example());
    bytes[20..26].fill(0xff);
    assert_eq!(
        Observe::default().decode(&bytes),
        // 40 + 3·65535 rounded up to a multiple of 4 + 4·65535 + 4·65535² + 65535²
        Err(WireError::Length { name: "Observe", expected: 21_474_639_913, found: bytes.len() })
    );
}

#[test]
fn a_refused_message_leaves_the_buffer_as_it_was() {
    let mut bytes = encoded(&Observe { epoch: 7, ..example() });
    *bytes.last_mut().unwrap() = 2;
    let mut observe = example();
    observe.decode(&bytes).unwrap_err();
    assert_eq!(observe, example());
}
