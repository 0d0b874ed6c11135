//! Logs: readable lines on stderr for warnings, JSON lines in the role's folder for everything.

use std::fs::File;
use std::io::IsTerminal;
use std::sync::Mutex;

use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer};

/// Starts logging. stderr gets warnings, or what `RONDO_LOG` says (for example `info` or
/// `agent=debug`); `file`, if given, gets information and above as JSON lines. The bus library's own
/// chatter is left out of both unless asked for. A second call changes nothing.
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
    // Fails only if logging was started before, by a test or an embedding program: then that one stays.
    let _ = tracing_subscriber::registry().with(to_stderr).with(to_file).try_init();
}
