//! Logs: readable warnings on stderr, JSON lines for all events in the role's folder.

use std::fs::File;
use std::io::IsTerminal;
use std::sync::Mutex;

use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer};

/// Starts logging. stderr gets warnings, or what `RONDO_LOG` selects (for example `info` or `agent=debug`). `file`, if
/// given, gets `info` and above as JSON lines. zenoh's own messages are omitted from both unless selected. A second
/// call changes nothing.
pub fn start_logs(file: Option<File>) {
    let chosen = EnvFilter::try_from_env("RONDO_LOG").unwrap_or_else(|_| EnvFilter::new("warn,zenoh=off"));
    let to_stderr = tracing_subscriber::fmt::layer()
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        .with_filter(chosen);
    let own =
        EnvFilter::builder().with_default_directive(LevelFilter::INFO.into()).parse_lossy("info,zenoh=off");
    let to_file = file
        .map(|file| tracing_subscriber::fmt::layer().json().with_writer(Mutex::new(file)).with_filter(own));
    // Fails only if a test or an embedding program has already started logging; that one stays.
    let _ = tracing_subscriber::registry().with(to_stderr).with(to_file).try_init();
}
