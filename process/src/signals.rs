//! The signals that ask a program to end, and the meaning of further ones. All programs use this list: the launcher,
//! a sweep, each role, `rondo render`.

use std::thread;
use std::time::{Duration, Instant};

use proto::exit;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2};
use signal_hook::iterator::Signals;

use crate::Failure;

/// Batch systems and users often send a signal twice. Within this time of the first, it is the same request.
const SAME_REQUEST: Duration = Duration::from_secs(1);

/// What the signals so far request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopRequest {
    /// Save after the present round, then end.
    AfterThisRound,
    /// Save the last complete round and end now.
    Now,
    /// End without waiting for anything.
    Abort,
}

/// SIGINT, SIGTERM, SIGUSR1 and SIGUSR2 (the warnings of batch systems), and SIGHUP unless it was ignored when this
/// process started, as under `nohup`.
pub fn stop_signals() -> Vec<i32> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mut signals = vec![SIGINT, SIGTERM, SIGUSR1, SIGUSR2];
    if !ignores(&status, SIGHUP) {
        signals.push(SIGHUP);
    }
    signals
}

/// Calls `act`, in a thread of its own, for every signal that changes what is asked for.
///
/// # Errors
/// If the system refuses the handler.
pub fn on_stop_request(mut act: impl FnMut(StopRequest) + Send + 'static) -> Result<(), Failure> {
    let mut signals = Signals::new(stop_signals())
        .map_err(|error| Failure::new(exit::IO, format!("cannot watch for signals: {error}")))?;
    thread::spawn(move || {
        let mut requests = Requests::default();
        for signal in signals.forever() {
            let request = requests.next(Instant::now());
            tracing::info!(signal, ?request, "received a signal");
            if let Some(request) = request {
                act(request);
            }
        }
    });
    Ok(())
}

/// Counts the signals.
#[derive(Default)]
struct Requests {
    first: Option<Instant>,
    count: u32,
}

impl Requests {
    /// What a signal at `now` asks for; nothing if it repeats the first.
    fn next(&mut self, now: Instant) -> Option<StopRequest> {
        self.count += 1;
        let Some(first) = self.first else {
            self.first = Some(now);
            return Some(StopRequest::AfterThisRound);
        };
        match self.count {
            _ if now.saturating_duration_since(first) < SAME_REQUEST => None,
            2 => Some(StopRequest::Now),
            _ => Some(StopRequest::Abort),
        }
    }
}

/// Whether the process with this `/proc/PID/status` ignores a signal: bit `signal - 1` of `SigIgn`.
fn ignores(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask & (1 << (signal - 1)) != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_within_a_second_repeats_the_first_and_a_third_later_one_aborts() {
        use StopRequest::{Abort, AfterThisRound, Now};
        let start = Instant::now();
        let asked = |seconds: &[f64]| -> Vec<Option<StopRequest>> {
            let mut requests = Requests::default();
            seconds.iter().map(|&s| requests.next(start + Duration::from_secs_f64(s))).collect()
        };
        assert_eq!(asked(&[0.0, 0.2, 5.0]), [Some(AfterThisRound), None, Some(Abort)]);
        assert_eq!(asked(&[0.0, 0.2, 0.9]), [Some(AfterThisRound), None, None]);
        assert_eq!(asked(&[0.0, 2.0, 3.0]), [Some(AfterThisRound), Some(Now), Some(Abort)]);
    }

    #[test]
    fn a_hang_up_that_was_ignored_at_the_start_is_recognised() {
        // SIGHUP is number 1, so its bit is the lowest.
        assert!(ignores("Name:\trondo\nSigIgn:\t0000000000001001\n", SIGHUP));
        assert!(!ignores("Name:\trondo\nSigIgn:\t0000000000001000\n", SIGHUP));
        assert!(!ignores("", SIGHUP));
        let signals = stop_signals();
        assert!([SIGINT, SIGTERM, SIGUSR1, SIGUSR2].iter().all(|signal| signals.contains(signal)));
    }
}
