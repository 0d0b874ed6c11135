//! Role: steps one world; tells each agent what that agent sees, and nothing else.
//!
//! It is the run's clock: it waits until every seat is taken (`seats`), plays rounds (`round`), counts
//! environment steps, orders tests and closes the run (`run`). It does not know what an algorithm is.

mod convert;
mod record;
mod round;
mod run;
mod seats;

use std::process::ExitCode;

use proto::exit;

pub use run::{run, Closed};

/// Arguments of the role's process.
#[derive(Debug, Clone, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub common: process::Common,
    /// Endpoint to listen on, for example `tcp/192.0.2.7:7447`
    #[arg(long, value_name = "ENDPOINT", required = true)]
    pub listen: Vec<String>,
}

/// The whole process: opens what the arguments say and runs until the run is closed.
pub fn main(arguments: &Arguments) -> ExitCode {
    let attempt = || run(arguments.common.open("world", arguments.listen.clone(), vec![])?);
    match attempt() {
        Ok(Closed::Finished) => ExitCode::from(exit::DONE),
        Ok(Closed::Stopped) => ExitCode::from(exit::AGAIN),
        Err(failure) => process::report(&failure),
    }
}
