//! The queue of events that a role reads.
//!
//! A standard channel wakes its reader for every message. The env-server can only continue when the whole team has
//! answered, so it waits for that many messages ([`Events::recv_together`]): one wake-up per tick for a team of any
//! size. Wake-ups are most of the cost of a message.

use std::collections::VecDeque;
use std::sync::mpsc::{RecvError, RecvTimeoutError, SendError, TryRecvError};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::Event;

/// An empty, unbounded inbox and its reader. Any number of declarations may share the inbox.
pub fn inbox() -> (Inbox, Events) {
    let shared = Arc::new(Shared::default());
    lock(&shared.state).inboxes = 1;
    (Inbox { shared: shared.clone() }, Events { shared })
}

/// The sending end; a clone is the same inbox.
#[derive(Debug)]
pub struct Inbox {
    shared: Arc<Shared>,
}

/// The reader of an [`Inbox`], in order of arrival. Errors are those of a standard channel.
#[derive(Debug)]
pub struct Events {
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    enough: Condvar,
}

#[derive(Debug, Default)]
struct State {
    events: VecDeque<Event>,
    /// True if a queued event is not a message; the reader must not wait then.
    urgent: bool,
    /// Number of messages that the sleeping reader waits for; 0 while it does not sleep.
    awaited: usize,
    inboxes: usize,
    reader_is_gone: bool,
}

impl Inbox {
    /// Adds an event, and wakes the reader if its condition is met.
    ///
    /// # Errors
    /// If the reader is gone; the event is returned.
    pub fn send(&self, event: Event) -> Result<(), SendError<Event>> {
        let mut state = lock(&self.shared.state);
        if state.reader_is_gone {
            return Err(SendError(event));
        }
        state.urgent |= !matches!(event, Event::Message { .. });
        state.events.push_back(event);
        let wake = state.awaited > 0 && (state.urgent || state.events.len() >= state.awaited);
        drop(state);
        if wake {
            self.shared.enough.notify_one();
        }
        Ok(())
    }
}

impl Inbox {
    /// As [`Inbox::send`], without an error. An inbox without a reader belongs to a role that is ending; its guards are
    /// about to be dropped.
    pub(crate) fn push(&self, event: Event) {
        let _ = self.send(event);
    }
}

impl Clone for Inbox {
    fn clone(&self) -> Self {
        lock(&self.shared.state).inboxes += 1;
        Self { shared: self.shared.clone() }
    }
}

impl Drop for Inbox {
    fn drop(&mut self) {
        let mut state = lock(&self.shared.state);
        state.inboxes -= 1;
        let last = state.inboxes == 0;
        drop(state);
        if last {
            self.shared.enough.notify_one();
        }
    }
}

impl Events {
    /// The next event, if there is one.
    ///
    /// # Errors
    /// [`TryRecvError`]: empty now, or closed.
    pub fn try_recv(&self) -> Result<Event, TryRecvError> {
        let mut state = lock(&self.shared.state);
        match state.take() {
            Some(event) => Ok(event),
            None if state.inboxes == 0 => Err(TryRecvError::Disconnected),
            None => Err(TryRecvError::Empty),
        }
    }

    /// Waits for the next event.
    ///
    /// # Errors
    /// [`RecvError`]: closed.
    pub fn recv(&self) -> Result<Event, RecvError> {
        self.recv_timeout(Duration::MAX).map_err(|_| RecvError)
    }

    /// Waits for the next event, at most for `timeout`.
    ///
    /// # Errors
    /// [`RecvTimeoutError`]: timeout, or closed.
    pub fn recv_timeout(&self, timeout: Duration) -> Result<Event, RecvTimeoutError> {
        self.recv_together(1, timeout)
    }

    /// Waits until `count` events are queued, or one that is not a message, or `timeout` is over; then returns the
    /// next event, if there is one.
    ///
    /// # Errors
    /// [`RecvTimeoutError`]: timeout, or closed.
    pub fn recv_together(&self, count: usize, timeout: Duration) -> Result<Event, RecvTimeoutError> {
        // A deadline that cannot be represented means no deadline.
        let deadline = Instant::now().checked_add(timeout);
        let mut state = lock(&self.shared.state);
        while state.events.len() < count.max(1) && !state.urgent && state.inboxes > 0 {
            let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
            if left == Some(Duration::ZERO) {
                break;
            }
            state.awaited = count.max(1);
            let wait = left.unwrap_or(Duration::MAX);
            let woken = self.shared.enough.wait_timeout(state, wait);
            state = woken.unwrap_or_else(PoisonError::into_inner).0;
            state.awaited = 0;
        }
        match state.take() {
            Some(event) => Ok(event),
            None if state.inboxes == 0 => Err(RecvTimeoutError::Disconnected),
            None => Err(RecvTimeoutError::Timeout),
        }
    }
}

impl Drop for Events {
    fn drop(&mut self) {
        let mut state = lock(&self.shared.state);
        state.reader_is_gone = true;
        // Dropping a query answers it, which may take other locks.
        let unread = std::mem::take(&mut state.events);
        drop(state);
        drop(unread);
    }
}

impl State {
    fn take(&mut self) -> Option<Event> {
        let event = self.events.pop_front();
        self.urgent = self.urgent && self.events.iter().any(|event| !matches!(event, Event::Message { .. }));
        event
    }
}

/// Ignores poisoning: the state is consistent between any two statements that can panic.
pub(crate) fn lock<T>(state: &Mutex<T>) -> MutexGuard<'_, T> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    fn message(payload: u8) -> Event {
        Event::Message { key: "k".into(), payload: vec![payload] }
    }

    fn payload(event: Event) -> u8 {
        match event {
            Event::Message { payload, .. } => payload[0],
            other => panic!("{other:?} is not a message"),
        }
    }

    /// Waits until the reader sleeps.
    fn asleep(inbox: &Inbox) {
        let deadline = Instant::now() + LONG;
        while lock(&inbox.shared.state).awaited == 0 {
            assert!(Instant::now() < deadline, "the reader does not sleep");
            thread::yield_now();
        }
    }

    #[test]
    fn events_come_out_in_order() {
        let (inbox, events) = inbox();
        for k in 0..3 {
            inbox.clone().send(message(k)).unwrap();
        }
        assert_eq!([(); 3].map(|()| payload(events.try_recv().unwrap())), [0, 1, 2]);
        assert_eq!(events.try_recv().unwrap_err(), TryRecvError::Empty);
    }

    #[test]
    fn a_reader_of_several_messages_sleeps_until_all_are_there() {
        let (inbox, events) = inbox();
        thread::scope(|scope| {
            let reader = scope.spawn(|| payload(events.recv_together(3, LONG).unwrap()));
            for k in 0..2 {
                asleep(&inbox);
                inbox.send(message(k)).unwrap();
            }
            assert_eq!(lock(&inbox.shared.state).events.len(), 2, "nothing is taken before the third");
            inbox.send(message(2)).unwrap();
            assert_eq!(reader.join().unwrap(), 0);
        });
        assert_eq!(payload(events.recv_together(2, LONG).unwrap()), 1);
    }

    #[test]
    fn anything_but_a_message_wakes_at_once_and_keeps_its_place() {
        let (inbox, events) = inbox();
        thread::scope(|scope| {
            let reader = scope.spawn(|| payload(events.recv_together(3, LONG).unwrap()));
            asleep(&inbox);
            inbox.send(message(7)).unwrap();
            inbox.send(Event::Stop).unwrap();
            assert_eq!(reader.join().unwrap(), 7);
        });
        assert!(matches!(events.recv_together(3, LONG), Ok(Event::Stop)));
    }

    #[test]
    fn what_came_in_time_is_given_out_when_time_is_over() {
        let (inbox, events) = inbox();
        inbox.send(message(1)).unwrap();
        assert_eq!(payload(events.recv_together(2, Duration::from_millis(5)).unwrap()), 1);
        let nothing = events.recv_together(2, Duration::from_millis(5));
        assert_eq!(nothing.unwrap_err(), RecvTimeoutError::Timeout);
    }

    #[test]
    fn each_end_learns_that_the_other_is_gone() {
        let (one, events) = inbox();
        let other = one.clone();
        thread::scope(|scope| {
            let reader = scope.spawn(|| events.recv_timeout(Duration::MAX).unwrap_err());
            asleep(&one);
            drop((one, other));
            assert_eq!(reader.join().unwrap(), RecvTimeoutError::Disconnected);
        });
        assert_eq!(events.try_recv().unwrap_err(), TryRecvError::Disconnected);

        let (inbox, events) = inbox();
        drop(events);
        assert!(inbox.send(Event::Stop).is_err());
    }
}
