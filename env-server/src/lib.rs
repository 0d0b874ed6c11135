//! Role: steps one world, and sends each agent only what that agent sees.
//!
//! It is the run's clock: it waits until every seat is taken (`seats`), plays rounds (`round`), counts environment
//! steps, starts tests and closes the run (`run`). It has no knowledge of algorithms.

mod convert;
mod record;
mod round;
mod run;
mod seats;
mod task;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use process::Failure;
use proto::exit;

pub use convert::{Copies, Played};
pub use run::{run, Closed};
pub use task::{check_transport, fits_low_latency, task, OPPONENT_FILE};

/// Arguments of the role's process.
#[derive(Debug, Clone, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub common: process::Common,
    /// Endpoint to listen on, for example `tcp/192.0.2.7:7447`
    #[arg(long, value_name = "ENDPOINT", required = true)]
    pub listen: Vec<String>,
    /// The opponent's weights, if the configuration names a file of its own; kept in the run folder
    #[arg(long, value_name = "FILE")]
    pub opponent: Option<PathBuf>,
    /// Start from the beginning if no round is held by every role; the old checkpoints and rows are set aside
    #[arg(long)]
    pub start_over: bool,
}

/// The whole process: opens configuration, folder and bus, and runs until the run is closed.
pub fn main(arguments: &Arguments) -> ExitCode {
    let attempt = || {
        let role = arguments.common.open("world", arguments.listen.clone(), vec![])?;
        if let Some(file) = &arguments.opponent {
            let bytes = read(file)?;
            // A wrong file must not replace the one in the run folder.
            task::check_opponent(&role.config.world.opponent, &bytes, file)?;
            role.folder.keep_in_run(OPPONENT_FILE, &bytes)?;
        }
        run(role, arguments.start_over)
    };
    match attempt() {
        Ok(Closed::Finished) => ExitCode::from(exit::DONE),
        Ok(Closed::Stopped) => ExitCode::from(exit::AGAIN),
        Err(failure) => process::report(&failure),
    }
}

/// Reads a whole file.
fn read(file: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(file)
        .map_err(|error| Failure::new(exit::IO, format!("cannot read {}: {error}", file.display())))
}
