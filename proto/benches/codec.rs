//! Writing and reading the two messages of a tick.
//!
//! ```text
//! cargo bench -p proto
//! ```

use divan::counter::BytesCount;
use divan::{black_box, Bencher};
use proto::{Act, End, Observe};

fn main() {
    divan::main();
}

/// 21 numbers and 6 actions for each copy, as in a large foraging task.
fn observe(copies: usize) -> Observe {
    Observe {
        tick: 1,
        copies: (0..copies as u16).collect(),
        ends: vec![End::Running; copies],
        rewards: vec![0.5; copies],
        obs_size: 21,
        n_actions: 6,
        obs: vec![1.0; copies * 21],
        avail: vec![1; copies * 6],
        ..Observe::default()
    }
}

#[divan::bench(args = [1, 10, 64, 1024])]
fn encode_observe(bencher: Bencher, copies: usize) {
    let (message, mut bytes) = (observe(copies), Vec::new());
    message.encode(&mut bytes);
    bencher.counter(BytesCount::new(bytes.len())).bench_local(|| message.encode(black_box(&mut bytes)));
}

#[divan::bench(args = [1, 10, 64, 1024])]
fn decode_observe(bencher: Bencher, copies: usize) {
    let (message, mut bytes, mut read) = (observe(copies), Vec::new(), Observe::default());
    message.encode(&mut bytes);
    bencher
        .counter(BytesCount::new(bytes.len()))
        .bench_local(|| read.decode(black_box(&bytes)).expect("what was encoded"));
}

#[divan::bench(args = [1, 10, 64, 1024])]
fn act_there_and_back(bencher: Bencher, copies: usize) {
    let message = Act { actions: vec![3; copies], ..Act::default() };
    let (mut bytes, mut read) = (Vec::new(), Act::default());
    message.encode(&mut bytes);
    bencher.counter(BytesCount::new(bytes.len())).bench_local(|| {
        message.encode(black_box(&mut bytes));
        read.decode(&bytes).expect("what was encoded");
    });
}
