//! Role: one learner; its experience and weights stay in its process.
//!
//! It joins a run (`join`), answers every tick with actions, learns once per round with the rate that
//! the schedule gives it (`timetable`), saves and reports. It publishes actions, progress and scalars,
//! and nothing else.
//!
//! Its state changes only at round edges, in the update call: whenever it has to leave, what it saves is
//! the last edge.

mod join;
mod timetable;
mod train;

mod host;
mod input;
mod learner;
mod replay;
mod settings;

mod progress;

use std::process::ExitCode;

use proto::exit;

pub use learner::{owner, Learner};
pub use train::{run, Left};

/// Arguments of the role's process.
#[derive(Debug, Clone, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    pub common: process::Common,
    /// Which agent of the team this is, from 0
    #[arg(long, value_name = "N")]
    pub id: u32,
    /// Endpoints to dial: the env-server's and the coordinator's, for example `tcp/192.0.2.7:7447`
    #[arg(long, value_name = "ENDPOINT", required = true)]
    pub connect: Vec<String>,
    /// Threads for update calls, 1 or 2: with two, actor and critic learn at once; the result is the same. By default
    /// as many as there are processors
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=2))]
    pub threads: Option<u8>,
}

/// The whole process: opens what the arguments say and runs until the run ends.
pub fn main(arguments: &Arguments) -> ExitCode {
    let attempt = || {
        let name = format!("agent-{}", arguments.id);
        let role = arguments.common.open(&name, vec![], arguments.connect.clone())?;
        let processors = || std::thread::available_parallelism().map_or(1, usize::from);
        run(role, arguments.id, arguments.threads.map_or_else(processors, usize::from))
    };
    match attempt() {
        Ok(Left::Finished) => ExitCode::from(exit::DONE),
        Ok(Left::Stopped) => ExitCode::from(exit::AGAIN),
        Err(failure) => process::report(&failure),
    }
}
