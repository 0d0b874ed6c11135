//! Watching for the signals and for the launcher's death.

use std::io::Read;
use std::thread;

use bus::{Event, Inbox};
use proto::exit;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use crate::Failure;

/// What a listening role prints on stdout, followed by a space and the endpoint, when it can be dialled.
pub const LISTENING: &str = "listening";

/// Turns SIGINT, SIGTERM and SIGHUP into [`Event::Stop`]: the role saves and leaves.
///
/// # Errors
/// If the system refuses the handler.
pub(crate) fn stop_on_signals(inbox: Inbox) -> Result<(), Failure> {
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])
        .map_err(|error| Failure::new(exit::BUG, format!("cannot watch for signals: {error}")))?;
    thread::spawn(move || {
        for signal in signals.forever() {
            tracing::info!(signal, "asked to stop");
            // A role that has left needs no telling.
            let _ = inbox.send(Event::Stop);
        }
    });
    Ok(())
}

/// Ends this process as soon as stdin closes. The launcher holds the other end of the pipe, so however it
/// dies, SIGKILL included, none of its children outlives it.
pub fn leave_with_launcher() {
    thread::spawn(|| {
        let mut byte = [0; 64];
        while matches!(std::io::stdin().read(&mut byte), Ok(n) if n > 0) {}
        tracing::warn!("the launcher is gone");
        std::process::exit(exit::AGAIN.into());
    });
}
