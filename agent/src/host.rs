//! Services of this process for its learner.

use std::sync::LazyLock;
use std::thread::scope;
use std::time::Instant;

use algos::host::Host;

/// A clock, and a second thread if `threads` allows it.
pub fn host(threads: usize) -> Host {
    Host { clock, both: if threads > 1 { at_once } else { Host::default().both } }
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
