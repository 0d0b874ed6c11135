//! `rondo`: starts and resumes runs, and reads their results.

mod bench;
mod child_processes;
mod display;
mod drive;
mod eval;
mod experiment;
mod in_process;
mod look;
mod meeting;
mod notes;
mod one_at_a_time;
mod presets;
mod render;
mod replay;
mod roles;
mod state;
mod summary;
mod sweep;
mod team;
mod train;
mod train_opponent;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use process::Failure;
use proto::exit;

/// Cooperative multi-agent reinforcement learning where every agent is a separate process
#[derive(Parser)]
#[command(name = "rondo", version, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "Exit codes: 0 done, 64 usage, 70 a bug in rondo, 74 input/output, \
                          75 stopped or interrupted (resume or try again), 78 configuration";

#[derive(Subcommand)]
enum Command {
    /// Train a team: env-server, coordinator and one process per agent, on a local bus
    Train(train::Train),
    /// Continue a run that was stopped or killed
    Resume(train::Resume),
    /// Print digests of the final weights and the metric rows of a run
    Digest(look::Digest),
    /// Play episodes with the trained agents of a run, without learning
    Eval(eval::Eval),
    /// Draw episodes of the trained agents of a run: a film, pictures, or live in the terminal
    Render(render::Render),
    /// Replay recorded traces of the reference environments and compare every number
    Replay(replay::Replay),
    /// Draw learning curves: mean and standard error over seeds
    Plot(look::Plot),
    /// Compare learning curves with reference curves, as a table
    Compare(look::Compare),
    /// Measure training speed, in processes and in one process
    Bench(bench::Bench),
    /// Train a frozen opponent for the particle worlds and write its weights
    TrainOpponent(train_opponent::TrainOpponent),
    /// Work out an example from the paper
    Example(look::Example),
    /// List the tasks, or explain one
    Tasks(look::Tasks),
    /// Print the published settings of every family of tasks, with their sources
    Presets(presets::Presets),
    /// Write the configuration that `train` would run with: the file for roles started one by one
    Config(train::WriteConfig),
    /// Run one agent (the same as `rondo-agent`)
    Agent(agent::Arguments),
    /// Run the env-server (the same as `rondo-env-server`)
    EnvServer(env_server::Arguments),
    /// Run the coordinator (the same as `rondo-coordinator`)
    Coordinator(coordinator::Arguments),
}

fn main() -> ExitCode {
    bus::use_one_runtime();
    process::exit_on_panic();
    let cli = match process::parse_arguments::<Cli>() {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    let done = |()| ExitCode::from(exit::DONE);
    let result: Result<ExitCode, Failure> = match cli.command {
        Command::Train(command) => command.run(),
        Command::Resume(command) => command.run(),
        Command::Digest(command) => command.run().map(done),
        Command::Eval(command) => command.run().map(done),
        Command::Render(command) => command.run().map(done),
        Command::Replay(command) => command.run(),
        Command::Plot(command) => command.run().map(done),
        Command::Compare(command) => command.run().map(done),
        Command::Bench(command) => command.run().map(done),
        Command::TrainOpponent(command) => command.run().map(done),
        Command::Example(command) => command.run().map(done),
        Command::Tasks(command) => command.run().map(done),
        Command::Presets(command) => command.run().map(done),
        Command::Config(command) => command.run().map(done),
        Command::Agent(arguments) => Ok(agent::main(&arguments)),
        Command::EnvServer(arguments) => Ok(env_server::main(&arguments)),
        Command::Coordinator(arguments) => Ok(coordinator::main(&arguments)),
    };
    result.unwrap_or_else(|failure| process::report(&failure))
}
