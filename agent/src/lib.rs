//! Role: one learner; its experience and weights stay in its process.
//!
//! It joins a run (`join`), answers every tick with actions, and learns after every round, in update calls at the
//! rates of the schedule (`timetable`). It saves checkpoints and metric rows. It publishes only actions, progress and
//! scalars.
//!
//! What it learns changes only between rounds. Whenever it has to leave, it saves the state after its last complete
//! round.

mod join;
mod timetable;
mod train;

mod diverged;
mod host;
mod input;
mod learner;
mod replay;
mod settings;

mod progress;

use std::process::ExitCode;

use algos::device::DeviceName;
use process::Failure;
use proto::exit;

pub use learner::{owner, Learner};
pub use train::{run, Left};

/// The device option of every command that runs an agent. It is not part of the configuration, which does not depend
/// on the machine.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct DeviceArgument {
    /// Device for update calls and large batches: cpu, cuda (the first GPU) or cuda:N
    #[arg(long, value_name = "DEVICE", default_value_t = DeviceName::Cpu)]
    pub device: DeviceName,
}

impl DeviceArgument {
    /// Rejects a device that this build cannot use, before anything starts.
    ///
    /// # Errors
    /// With [`exit::CONFIG`].
    pub fn check(&self) -> Result<DeviceName, Failure> {
        self.device.check().map_err(|error| Failure::new(exit::CONFIG, error))?;
        Ok(self.device)
    }
}

/// The hardware that an agent uses. It is not part of the configuration.
#[derive(Debug, Clone, Copy)]
pub struct Machine {
    /// The device for update calls and large batches.
    pub device: DeviceName,
    /// With more than one, actor and critic learn in parallel.
    pub threads: usize,
}

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
    /// Threads for update calls, 1 or 2: with two, actor and critic learn in parallel; the result is the same. By
    /// default as many as there are processors
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=2))]
    pub threads: Option<u8>,
    #[command(flatten)]
    pub device: DeviceArgument,
}

/// The whole process: opens configuration, folder and bus, and runs until the run ends.
pub fn main(arguments: &Arguments) -> ExitCode {
    let attempt = || {
        let device = arguments.device.check()?;
        let name = format!("agent-{}", arguments.id);
        let role = arguments.common.open(&name, vec![], arguments.connect.clone())?;
        let processors = || std::thread::available_parallelism().map_or(1, usize::from);
        let threads = arguments.threads.map_or_else(processors, usize::from);
        run(role, arguments.id, Machine { device, threads })
    };
    match attempt() {
        Ok(Left::Finished) => ExitCode::from(exit::DONE),
        Ok(Left::Stopped) => ExitCode::from(exit::AGAIN),
        Err(failure) => process::report(&failure),
    }
}
