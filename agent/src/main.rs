//! One learning agent as a process: joins a run, acts, learns, leaves.

use std::process::ExitCode;

/// One learning agent: its observations, experience and networks stay in this process
#[derive(clap::Parser)]
#[command(name = "rondo-agent", version)]
struct Cli {
    #[command(flatten)]
    arguments: agent::Arguments,
}

fn main() -> ExitCode {
    bus::use_one_runtime();
    process::exit_on_panic();
    match process::parse_arguments::<Cli>() {
        Ok(cli) => agent::main(&cli.arguments),
        Err(code) => code,
    }
}
