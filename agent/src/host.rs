//! What this process offers its learner.

use std::sync::LazyLock;
use std::thread::{available_parallelism, scope};
use std::time::Instant;

use algos::host::Host;

/// A clock, and a second thread where there is a second processor for it.
pub fn host() -> Host {
    let alone = available_parallelism().map_or(true, |processors| processors.get() == 1);
    Host { clock, both: if alone { Host::default().both } else { at_once } }
}

fn clock() -> f64 {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

fn at_once(first: &mut (dyn FnMut() + Send), second: &mut (dyn FnMut() + Send)) {
    scope(|threads| {
        threads.spawn(first);
        second();
    });
}
