//! Services that the process gives to a learner: a clock, and threads. Neither can change a result.

use serde::Serialize;

/// The services of a process. The default has no clock and no second thread.
#[derive(Clone, Copy, Debug)]
pub struct Host {
    /// Seconds since a fixed moment.
    pub clock: fn() -> f64,
    /// Runs both to completion, in parallel or in order. The second may wait for the first.
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

/// Seconds of a learner by activity. Parallel activities count twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Forward passes for acting.
    pub acting: f64,
    /// Choosing actions from their outputs.
    pub choosing: f64,
    /// Batch layout.
    pub layout: f64,
    /// Forward passes of update calls.
    pub forward: f64,
    /// Losses, returns and the gradients of the networks' outputs.
    pub loss: f64,
    /// Backward passes.
    pub backward: f64,
    /// Clipping, Adam and target networks.
    pub optimiser: f64,
    /// Waiting for the other thread.
    pub waiting: f64,
}

impl Seconds {
    /// The sum of both.
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
