//! Scalars for whoever looks at a run while it goes on.

use std::time::{Duration, Instant};

use bus::Publisher;
use proto::codec::encode;
use proto::control::Metrics;

/// A display gains nothing from more than this.
const BETWEEN_SCALARS: Duration = Duration::from_millis(100);

/// Publishes a role's scalars, best effort, at a rate that a person can follow.
pub struct Scalars {
    publisher: Publisher,
    next: Instant,
}

impl Scalars {
    /// `publisher` is for the role's metrics key.
    pub fn new(publisher: Publisher) -> Self {
        Self { publisher, next: Instant::now() }
    }

    /// Publishes what `metrics` gives, unless the last scalars are recent; `now`: in any case.
    pub fn show(&mut self, now: bool, metrics: impl FnOnce() -> Metrics) {
        if !now && Instant::now() < self.next {
            return;
        }
        self.next = Instant::now() + BETWEEN_SCALARS;
        // Nobody may be looking, and nothing depends on it.
        let sent = encode(&metrics()).map(|bytes| self.publisher.send(&bytes));
        tracing::trace!(?sent, "scalars");
    }
}
