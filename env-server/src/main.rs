//! The env-server as a process: steps the shared world until the budget is used.

use std::process::ExitCode;

/// Steps the shared world and sends each agent what that agent sees
#[derive(clap::Parser)]
#[command(name = "rondo-env-server", version)]
struct Cli {
    #[command(flatten)]
    arguments: env_server::Arguments,
}

fn main() -> ExitCode {
    bus::use_one_runtime();
    process::exit_on_panic();
    match process::parse_arguments::<Cli>() {
        Ok(cli) => env_server::main(&cli.arguments),
        Err(code) => code,
    }
}
