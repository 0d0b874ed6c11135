//! Joining: requests a seat from the env-server until it answers.

use std::sync::mpsc::TryRecvError;
use std::time::{Duration, Instant};

use bus::Event;
use process::{Failure, Role};
use proto::codec::{decode, encode};
use proto::control::{Join, Refusal, Seat, Welcome};
use proto::exit;

/// The env-server holds the request until the whole team has joined. The request is repeated after this time.
const ASK_AGAIN: Duration = Duration::from_secs(5);

/// Pause between requests while no env-server serves them.
const PAUSE: Duration = Duration::from_millis(10);

/// Requests the seat of agent `id` until it is granted.
///
/// # Errors
/// If the env-server refuses, does not answer within `role.wait`, or sends a malformed answer; or on
/// [`Event::Stop`].
pub fn take_seat(role: &Role, id: u32, join: &Join) -> Result<Seat, Failure> {
    let Role { ref bus, ref keys, ref events, wait, .. } = *role;
    let question = encode(join).map_err(|error| Failure::new(exit::BUG, error))?;
    let deadline = Instant::now() + wait;
    loop {
        match events.try_recv() {
            Ok(Event::Stop) | Err(TryRecvError::Disconnected) => {
                return Err(Failure::new(
                    exit::AGAIN,
                    format!("agent {id} was stopped before it had a seat"),
                ));
            }
            Ok(_) | Err(TryRecvError::Empty) => {}
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(Failure::new(
                exit::AGAIN,
                format!(
                    "agent {id} got no seat within {wait:?}: the env-server did not answer on `{}`\n\
                     hint: it waits for the whole team; is every agent started, and the env-server's endpoint \
                     among the `--connect`?",
                    keys.join(id)
                ),
            ));
        }
        match bus.ask(&keys.join(id), &question, left.min(ASK_AGAIN))? {
            None => std::thread::sleep(PAUSE.min(left)),
            Some(reply) => match decode(&reply) {
                Ok(Welcome::Seat(seat)) => return Ok(seat),
                Ok(Welcome::Refused(refusal)) => return Err(refused(id, &refusal)),
                Err(error) => {
                    let text = format!("agent {id} requested a seat and cannot decode the answer: {error}");
                    return Err(Failure::new(exit::CONFIG, text));
                }
            },
        }
    }
}

fn refused(id: u32, refusal: &Refusal) -> Failure {
    let code = if matches!(refusal, Refusal::Closing) { exit::AGAIN } else { exit::CONFIG };
    Failure::new(code, format!("agent {id} was refused a seat: {refusal}"))
}
