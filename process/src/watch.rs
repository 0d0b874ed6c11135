//! Requests to a role to leave: a signal, or stdin, whose other end the launcher holds.

use std::io::Read;
use std::sync::OnceLock;
use std::thread;
use std::time::Duration;

use bus::{Event, Inbox};
use proto::exit;

use crate::signals::{on_stop_request, StopRequest};
use crate::Failure;

/// What a listening role prints on stdout, followed by a space and the endpoint, when it can be dialled.
pub const LISTENING: &str = "listening";

/// The line that the launcher writes to a role's stdin: save the last complete round and leave now.
pub const LEAVE_NOW: &[u8] = b"leave now\n";

/// When the launcher is gone, the env-server has this long to end the round for the whole team. Then every role
/// saves the last round that it has completed.
const TO_END_THE_ROUND: Duration = Duration::from_secs(1);

/// A role that has not left by then hangs.
const TO_SAVE: Duration = Duration::from_secs(10);

/// Turns signals into [`Event::Stop`]: the first ends the run after the round, the next ends this role now.
///
/// # Errors
/// If the system refuses the handler.
pub(crate) fn stop_on_signals(inbox: Inbox) -> Result<(), Failure> {
    on_stop_request(move |request| match request {
        // The role may have left already.
        StopRequest::AfterThisRound | StopRequest::Now => drop(inbox.send(Event::Stop)),
        StopRequest::Abort => leave(),
    })
}

/// Where [`follow_launcher`] sends events. Empty until the role has an inbox.
pub(crate) static INBOX: OnceLock<Inbox> = OnceLock::new();

/// Watches the launcher through stdin. [`LEAVE_NOW`] makes the role save and leave. When stdin closes, the launcher
/// has ended: the role with `ends_rounds` (the env-server) then closes the run after the round, and the others follow
/// it or leave soon after. A role without a seat leaves at once: it has nothing to save.
pub(crate) fn follow_launcher(ends_rounds: bool) {
    thread::spawn(move || {
        let mut line = [0; LEAVE_NOW.len()];
        while matches!(std::io::stdin().read(&mut line), Ok(n) if n > 0) {
            match INBOX.get() {
                Some(inbox) => stop_now(inbox),
                None => leave(),
            }
        }
        // Not a warning: warnings go to stderr, whose other end the launcher held too.
        tracing::info!("the launcher has ended; saving and leaving");
        let Some(inbox) = INBOX.get() else { leave() };
        if ends_rounds {
            let _ = inbox.send(Event::Stop);
        }
        thread::sleep(TO_END_THE_ROUND);
        stop_now(inbox);
        thread::sleep(TO_SAVE);
        leave();
    });
}

/// The env-server ends the round at the first [`Event::Stop`], and stops now at the second.
fn stop_now(inbox: &Inbox) {
    for _ in 0..2 {
        let _ = inbox.send(Event::Stop);
    }
}

fn leave() -> ! {
    std::process::exit(exit::AGAIN.into());
}

/// Calls `act` once stdin closes: the process that started this one is gone.
pub fn when_stdin_closes(act: impl FnOnce() + Send + 'static) {
    thread::spawn(move || {
        let mut bytes = [0; 64];
        while matches!(std::io::stdin().read(&mut bytes), Ok(n) if n > 0) {}
        act();
    });
}
