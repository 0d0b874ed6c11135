//! What a learner borrows from the process it runs in: a clock, and whether two things may be done at once. Neither
//! can change a result.

use serde::Serialize;

/// The services of a process; the default has no clock and does one thing after the other.
#[derive(Clone, Copy, Debug)]
pub struct Host {
    /// Seconds since some fixed moment.
    pub clock: fn() -> f64,
    /// Runs two things to their ends, at once or the first one first. The second may wait for the first.
    pub both: fn(&mut (dyn FnMut() + Send), &mut (dyn FnMut() + Send)),
}

impl Default for Host {
    fn default() -> Self {
        let one_after_the_other = |first: &mut (dyn FnMut() + Send), second: &mut (dyn FnMut() + Send)| {
            first();
            second();
        };
        Self { clock: || 0.0, both: one_after_the_other }
    }
}

/// Where a learner's time went, in seconds. What was done at once counts twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Forward passes to act.
    pub acting: f64,
    /// Choosing actions by what came out of them.
    pub choosing: f64,
    /// Laying out the rows of update calls.
    pub layout: f64,
    /// Forward passes of update calls.
    pub forward: f64,
    /// Losses, returns and their gradients by the networks' outputs.
    pub loss: f64,
    /// Backward passes.
    pub backward: f64,
    /// Clipping, Adam and target networks.
    pub optimiser: f64,
    /// Waiting for what is done at the same time.
    pub waiting: f64,
}

impl Seconds {
    /// The sums of both.
    pub fn plus(self, other: Self) -> Self {
        Self {
            acting: self.acting + other.acting,
            choosing: self.choosing + other.choosing,
            layout: self.layout + other.layout,
            forward: self.forward + other.forward,
            loss: self.loss + other.loss,
            backward: self.backward + other.backward,
            optimiser: self.optimiser + other.optimiser,
            waiting: self.waiting + other.waiting,
        }
    }
}

/// Splits time into laps.
pub(crate) struct Stopwatch {
    clock: fn() -> f64,
    last: f64,
}

impl Stopwatch {
    pub fn start(host: Host) -> Self {
        Self { clock: host.clock, last: (host.clock)() }
    }

    /// Adds the time since the last lap, or the start, to `account`.
    pub fn lap(&mut self, account: &mut f64) {
        let now = (self.clock)();
        *account += now - self.last;
        self.last = now;
    }
}
