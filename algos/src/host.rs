//! Services that the process gives to a learner: a clock, and threads. Neither can change a result.

use std::sync::mpsc;

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

impl Host {
    /// For each of `steps`, in order, calls `produce`, which gives one item, and `consume`, which takes it. Where the
    /// host runs two things at once, `produce` runs ahead in a thread of its own. The result is the same.
    pub(crate) fn pipelined<S: Copy, T: Send>(
        self,
        steps: impl Iterator<Item = S> + Clone + Send,
        mut produce: impl FnMut(S, &mut dyn FnMut(T)) + Send,
        mut consume: impl FnMut(S, &mut dyn FnMut() -> T) + Send,
    ) {
        let (sender, receiver) = mpsc::channel();
        let mut give = move |item| sender.send(item).expect("every item is taken");
        let mut take = move || receiver.recv().expect("every step gives an item");
        let ahead = steps.clone();
        let mut first = move || ahead.clone().for_each(|step| produce(step, &mut give));
        let mut second = move || steps.clone().for_each(|step| consume(step, &mut take));
        (self.both)(&mut first, &mut second);
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

/// The account of a learner's time: each lap goes to one of [`Seconds`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Laps {
    clock: fn() -> f64,
    last: f64,
    pub seconds: Seconds,
}

impl Default for Laps {
    fn default() -> Self {
        Self { clock: Host::default().clock, last: 0.0, seconds: Seconds::default() }
    }
}

impl Laps {
    /// Uses this clock from now on.
    pub fn run_on(&mut self, host: Host) {
        self.clock = host.clock;
        self.start();
    }

    /// The next lap begins now.
    pub fn start(&mut self) {
        self.last = (self.clock)();
    }

    /// Adds the time since the last lap, or the start, to an account.
    pub fn add(&mut self, account: impl FnOnce(&mut Seconds) -> &mut f64) {
        let now = (self.clock)();
        *account(&mut self.seconds) += now - self.last;
        self.last = now;
    }
}
