//! Errors of the bus, written for the person who must act.

use std::time::Duration;

/// An error of the bus.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The string is not an endpoint.
    #[error("`{endpoint}` is not an endpoint: {reason}; write `unixsock-stream/PATH` or `tcp/HOST:PORT`")]
    Endpoint {
        /// The string as given.
        endpoint: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Another process already listens on the endpoint.
    #[error("cannot listen on `{endpoint}`: it is in use; hint: {hint}")]
    InUse {
        /// The endpoint as given.
        endpoint: String,
        /// What to do.
        hint: &'static str,
    },
    /// The endpoint cannot be listened on for another reason.
    #[error("cannot listen on `{endpoint}`: {reason}\nhint: {hint}")]
    Listen {
        /// The endpoint as given.
        endpoint: String,
        /// The operating system's reason.
        reason: String,
        /// What to do.
        hint: &'static str,
    },
    /// A required endpoint did not answer.
    #[error(
        "no answer at {} within {waited:?}; hint: start the process that listens there, or check the \
         address and the firewall",
        quoted(endpoints)
    )]
    Unreachable {
        /// The endpoints that did not answer.
        endpoints: Vec<String>,
        /// How long this side tried.
        waited: Duration,
    },
    /// The string is not a key or not a key expression.
    #[error("`{key}` is not {expected}: {reason}")]
    Key {
        /// The string as given.
        key: String,
        /// What it should be.
        expected: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// The payload is too large for the transport.
    #[error(
        "a message of {bytes} bytes on `{key}` is too large for the low-latency transport, which carries \
         {limit} bytes; hint: turn `low_latency` off on every side"
    )]
    TooLarge {
        /// The key of the message.
        key: String,
        /// The size of its payload.
        bytes: usize,
        /// The largest payload that may be sent.
        limit: usize,
    },
    /// This side of the bus was dropped.
    #[error("cannot send on `{key}`: this side of the bus is closed")]
    Closed {
        /// The key that was to be sent on.
        key: String,
    },
    /// The operating system refused something that zenoh needs, such as one more file or thread.
    #[error("cannot {action}: {reason}")]
    System {
        /// What was tried.
        action: String,
        /// What zenoh and the operating system say.
        reason: String,
    },
    /// Any other error of zenoh.
    #[error("zenoh cannot {action}: {reason}")]
    Zenoh {
        /// What was tried.
        action: String,
        /// zenoh's message.
        reason: String,
    },
}

fn quoted(endpoints: &[String]) -> String {
    let quoted: Vec<_> = endpoints.iter().map(|e| format!("`{e}`")).collect();
    quoted.join(" and ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_say_where_and_what_to_do() {
        let unreachable = Error::Unreachable {
            endpoints: vec!["tcp/10.0.0.5:7447".into(), "unixsock-stream/run/bus.sock".into()],
            waited: Duration::from_millis(1500),
        };
        assert_eq!(
            unreachable.to_string(),
            "no answer at `tcp/10.0.0.5:7447` and `unixsock-stream/run/bus.sock` within 1.5s; hint: start \
             the process that listens there, or check the address and the firewall"
        );
        let large = Error::TooLarge { key: "a/b".into(), bytes: 40_000, limit: 32_768 };
        assert_eq!(
            large.to_string(),
            "a message of 40000 bytes on `a/b` is too large for the low-latency transport, which carries \
             32768 bytes; hint: turn `low_latency` off on every side"
        );
    }
}
