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
            bus::Error::InUse { .. } | bus::Error::Listen { .. } => exit::IO,
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
        let text = panic.payload().downcast_ref::<String>().map_or("", String::as_str);
        if text.starts_with("failed printing to stdout") && text.contains("Broken pipe") {
            std::process::exit(exit::DONE.into());
        }
        tell(panic);
        eprintln!(
            "error: this is a bug in rondo; the last checkpoint is intact, `rondo resume` continues from it"
        );
        std::process::exit(exit::BUG.into());
    }));
}
