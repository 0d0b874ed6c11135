//! The coordinator as a process: publishes the agents' learning rates until all have left.

use std::process::ExitCode;

/// Publishes which learning rate each agent of a run has in which update call
#[derive(clap::Parser)]
#[command(name = "rondo-coordinator", version)]
struct Cli {
    #[command(flatten)]
    arguments: coordinator::Arguments,
}

fn main() -> ExitCode {
    bus::use_one_runtime();
    process::exit_on_panic();
    match process::parse_arguments::<Cli>() {
        Ok(cli) => coordinator::main(&cli.arguments),
        Err(code) => code,
    }
}
