//! Scalars for a live display of a run.

use std::time::{Duration, Instant};

use bus::Publisher;
use proto::codec::encode;
use proto::control::Metrics;

/// Shortest time between two messages; a display needs no more.
const BETWEEN_SCALARS: Duration = Duration::from_millis(100);

/// Publishes a role's scalars, best effort, at most one message per `BETWEEN_SCALARS`.
pub struct Scalars {
    publisher: Publisher,
    next: Instant,
}

impl Scalars {
    /// `publisher` is for the role's metrics key.
    pub fn new(publisher: Publisher) -> Self {
        Self { publisher, next: Instant::now() }
    }

    /// Publishes what `metrics` returns, unless the last message is recent. With `now` it always publishes.
    pub fn show(&mut self, now: bool, metrics: impl FnOnce() -> Metrics) {
        if !now && Instant::now() < self.next {
            return;
        }
        self.next = Instant::now() + BETWEEN_SCALARS;
        // There may be no display, and nothing depends on it.
        let sent = encode(&metrics()).map(|bytes| self.publisher.send(&bytes));
        tracing::trace!(?sent, "scalars");
    }
}
