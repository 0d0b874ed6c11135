//! The end of a process: one message for the person who must act, one exit code for the supervisor.

use std::fmt;
use std::process::ExitCode;

use proto::exit;

/// An error that ends a process: its message, and one of the codes of [`proto::exit`].
#[derive(Debug)]
pub struct Failure {
    /// Exit code.
    pub code: u8,
    /// What happened, where, and what to do.
    pub message: String,
}

impl Failure {
    /// With one of the codes of [`proto::exit`].
    pub fn new(code: u8, message: impl fmt::Display) -> Self {
        Self { code, message: message.to_string() }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}

impl From<store::Error> for Failure {
    fn from(error: store::Error) -> Self {
        let code = if error.is_config() {
            exit::CONFIG
        } else if error.is_io() {
            exit::IO
        } else if error.is_unfinished() {
            exit::AGAIN
        } else {
            exit::BUG
        };
        Self::new(code, error)
    }
}

impl From<bus::Error> for Failure {
    fn from(error: bus::Error) -> Self {
        let code = match &error {
            bus::Error::Endpoint { .. } => exit::USAGE,
            bus::Error::InUse { .. } | bus::Error::Listen { .. } | bus::Error::System { .. } => exit::IO,
            bus::Error::TooLarge { .. } => exit::CONFIG,
            bus::Error::Unreachable { .. } | bus::Error::Closed { .. } => exit::AGAIN,
            _ => exit::BUG,
        };
        Self::new(code, error)
    }
}

impl From<proto::config::ConfigError> for Failure {
    fn from(error: proto::config::ConfigError) -> Self {
        Self::new(exit::CONFIG, error)
    }
}

/// Prints the failure on stderr and gives its exit code.
pub fn report(failure: &Failure) -> ExitCode {
    eprintln!("error: {failure}");
    ExitCode::from(failure.code)
}

/// Parses the command line; help and version end with 0, a mistake with the message of clap and
/// [`exit::USAGE`].
pub fn parse_arguments<T: clap::Parser>() -> Result<T, ExitCode> {
    T::try_parse().map_err(|error| {
        // If stdout or stderr is closed, nothing can be reported.
        let _ = error.print();
        ExitCode::from(if error.use_stderr() { exit::USAGE } else { exit::DONE })
    })
}

/// A panic in any thread is a bug: this reports it and ends the process with [`exit::BUG`], so that no thread waits
/// for one that is gone. The exception is `println!` to a closed pipe, as in `rondo tasks | head`: the reader has all
/// that it wanted.
pub fn exit_on_panic() {
    let tell = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let payload = panic.payload();
        let text = payload.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or_default();
        if text.starts_with("failed printing to stdout") && text.contains("Broken pipe") {
            std::process::exit(exit::DONE.into());
        }
        if let Some(reason) = system_reason(text) {
            eprintln!(
                "error: the system refused what rondo needs: {reason}\nhint: look at the limits on open files and \
                 processes (`ulimit -n`, `ulimit -u`) and the space that is left; the last checkpoint is intact"
            );
            std::process::exit(exit::IO.into());
        }
        tell(panic);
        eprintln!(
            "error: this is a bug in rondo; the last checkpoint is intact, `rondo resume` continues from it"
        );
        std::process::exit(exit::BUG.into());
    }));
}

/// What the operating system said, if a panic is about that: `std::io::Error` in the form for people or for
/// programmers.
fn system_reason(panic: &str) -> Option<String> {
    // zenoh's runtime drops the reason, but has no other: a file or a thread too many.
    if panic.starts_with("Failed to init ") {
        return Some("the message bus cannot start its threads".to_owned());
    }
    if panic.contains("(os error ") {
        return Some(panic.to_owned());
    }
    let (_, error) = panic.split_once("Os { code: ")?;
    let (code, rest) = error.split_once(',')?;
    let (_, message) = rest.split_once("message: \"")?;
    Some(format!("{} (os error {code})", message.split('"').next()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_of_the_system_is_told_from_a_bug() {
        let full = std::io::Error::from_raw_os_error(28);
        let reason = "No space left on device (os error 28)";
        assert_eq!(
            system_reason(&format!("failed printing to stdout: {full}")).as_deref(),
            Some("failed printing to stdout: No space left on device (os error 28)")
        );
        let unwrapped = format!("failed to spawn thread: {full:?}");
        assert_eq!(system_reason(&unwrapped).as_deref(), Some(reason), "{unwrapped}");
        assert!(system_reason("Failed to init rx").is_some());
        assert_eq!(system_reason("index out of bounds: the len is 3 but the index is 3"), None);
    }
}
