//! `rondo bench`: how fast teams train here, in processes and in one process, and where the time goes.
//!
//! Every case is a real run with the paper's settings, its test reduced to one episode. The table quotes
//! medians over the runs; steps per second are those of the env-server between its first and last tick.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use algos::kernels::gemm::{product, Matrix};
use process::Failure;
use proto::exit;
use serde::Serialize;
use store::RunFolder;

use crate::display::Show;
use crate::drive::{drive, Options, Place};
use crate::experiment::{unknown, Experiment};
use crate::roles::{Ended, Transport};
use crate::summary::Summary;

/// The training cases of each suite: task and environment copies.
const SUITES: [(&str, &[(&str, u32)]); 2] =
    [("lbf", &[("lbf-8x8-2p-2f-coop", 10), ("lbf-15x15-4p-3f", 10)]), ("quick", &[("lbf-5x5-2p-1f", 10)])];

/// Measure training speed
#[derive(Debug, Clone, clap::Args)]
pub struct Bench {
    /// Which cases: lbf (the paper's settings for IPPO: GRU 128, 10 copies) or quick
    #[arg(long, default_value = "lbf")]
    suite: String,
    /// Runs of each case; the table gives medians
    #[arg(long, default_value_t = 3)]
    runs: u32,
    /// Environment steps of each run
    #[arg(long, default_value_t = 60_000)]
    steps: u64,
    /// Write everything measured into this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// One case, medians over its runs.
#[derive(Debug, Serialize)]
struct Measured {
    task: String,
    copies: u32,
    place: &'static str,
    env_steps_per_second: Spread,
    ticks_per_second: f64,
    /// Shares of the run's time: update calls (with what the agents do meanwhile), forward passes and
    /// sampling, the rest of a tick (bus and waiting), building and reading messages, worlds.
    update: f64,
    inference: f64,
    bus: f64,
    messages: f64,
    world: f64,
    agent_memory_mb: Option<f64>,
    env_server_memory_mb: Option<f64>,
}

#[derive(Debug, Clone, Copy, Serialize)]
struct Spread {
    min: f64,
    median: f64,
    max: f64,
}

#[derive(Debug, Serialize)]
struct Machine {
    processor: String,
    cores: usize,
    /// Single-precision product of two 1024 × 1024 matrices on one core, best of several.
    sgemm_gflops_one_core: f64,
}

impl Bench {
    pub fn run(&self) -> Result<(), Failure> {
        let names: Vec<&str> = SUITES.iter().map(|(name, _)| *name).collect();
        let suite = SUITES.iter().find(|(name, _)| *name == self.suite);
        let (_, cases) = suite.ok_or_else(|| unknown(&self.suite, "suite", &names))?;
        if self.runs == 0 || self.steps == 0 {
            return Err(Failure::new(exit::USAGE, "`--runs` and `--steps` are counted from 1"));
        }
        let machine = machine();
        println!(
            "{}, {} cores, sgemm {:.0} GFLOP/s on one core",
            machine.processor, machine.cores, machine.sgemm_gflops_one_core
        );
        println!("{} runs of {} environment steps each, IPPO; medians (min – max)\n", self.runs, self.steps);
        println!(
            "{:<20} {:>6} {:<10} {:>28} {:>8} {:>7} {:>7} {:>7} {:>7} {:>7} {:>9} {:>10}",
            "task",
            "copies",
            "place",
            "env steps/s",
            "ticks/s",
            "update",
            "infer.",
            "bus",
            "messag.",
            "world",
            "MB/agent",
            "MB/server"
        );
        let mut all = Vec::new();
        for &(task, copies) in *cases {
            for place in [Place::Processes(Transport::Unix), Place::InProcess] {
                let case = self.measure(task, copies, place)?;
                println!("{case}");
                all.push(case);
            }
        }
        if let Some(path) = &self.json {
            let report = serde_json::json!({ "machine": machine, "cases": all });
            std::fs::write(path, format!("{report:#}\n"))
                .map_err(|e| Failure::new(exit::IO, format!("cannot write {}: {e}", path.display())))?;
        }
        Ok(())
    }

    fn measure(&self, task: &str, copies: u32, place: Place) -> Result<Measured, Failure> {
        let experiment = Experiment {
            t_max: Some(self.steps),
            envs: Some(copies),
            test_interval: Some(self.steps),
            test_episodes: Some(1),
            ..Experiment::of(task, "ippo")
        };
        let mut runs = Vec::new();
        for seed in 1..=self.runs {
            let config = Experiment { seed: seed.into(), ..experiment.clone() }.configure("bench")?;
            let place_of_run = tempfile::tempdir()
                .map_err(|e| Failure::new(exit::IO, format!("cannot make a folder for the run: {e}")))?;
            let folder = RunFolder::create(place_of_run.path().join("run"), &config.to_toml())?;
            let options = Options { place, wait: Duration::from_secs(60), show: Show::Nothing };
            let (ended, summary) = drive(&folder, &config, options)?;
            if ended == Ended::Stopped {
                return Err(Failure::new(exit::AGAIN, "the measurement was stopped"));
            }
            runs.push(summary);
        }
        let of = |f: &dyn Fn(&Summary) -> f64| spread(runs.iter().map(f).collect());
        let world =
            |name: &'static str| of(&|run| run.seconds("world", name) / run.training_seconds()).median;
        let inference = of(&|run| {
            let agents = run.roles.keys().filter(|role| role.starts_with("agent"));
            agents.map(|agent| run.seconds(agent, "inference")).fold(0.0, f64::max) / run.training_seconds()
        });
        let memory = |role: &'static str| {
            let of_role = |run: &Summary| run.roles[role]["peak_memory_bytes"].as_f64();
            let known: Option<Vec<f64>> = runs.iter().map(of_role).collect();
            known.map(|bytes| spread(bytes).median / 1e6).filter(|_| place != Place::InProcess)
        };
        Ok(Measured {
            task: task.to_owned(),
            copies,
            place: if place == Place::InProcess { "in-process" } else { "processes" },
            env_steps_per_second: of(&|run| run.env_steps_per_second),
            ticks_per_second: of(&|run| {
                run.roles["world"]["ticks"].as_f64().unwrap_or(0.0) / run.training_seconds()
            })
            .median,
            update: world("updates"),
            inference: inference.median,
            bus: (world("actions") - inference.median).max(0.0),
            messages: world("messages"),
            world: world("world"),
            agent_memory_mb: memory("agent-0"),
            env_server_memory_mb: memory("world"),
        })
    }
}

fn spread(mut values: Vec<f64>) -> Spread {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    let median =
        if values.len() % 2 == 1 { values[middle] } else { (values[middle - 1] + values[middle]) / 2.0 };
    Spread { min: values[0], median, max: values[values.len() - 1] }
}

fn machine() -> Machine {
    let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name =
        cpu.lines().find_map(|line| line.strip_prefix("model name")).and_then(|rest| rest.split_once(": "));
    Machine {
        processor: name.map_or("unknown processor", |(_, name)| name).to_owned(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
        sgemm_gflops_one_core: sgemm(),
    }
}

fn sgemm() -> f64 {
    const N: usize = 1024;
    let (a, b) = (vec![1.0; N * N], vec![0.5; N * N]);
    let mut c = vec![0.0; N * N];
    let one = |c: &mut [f32]| {
        let start = Instant::now();
        product(c, Matrix::new(&a, N, N), Matrix::new(&b, N, N));
        2.0 * (N as f64).powi(3) / start.elapsed().as_secs_f64() / 1e9
    };
    (0..8).map(|_| one(&mut c)).fold(0.0, f64::max)
}

impl std::fmt::Display for Measured {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let steps = self.env_steps_per_second;
        let memory = |mb: Option<f64>| mb.map_or("–".to_owned(), |mb| format!("{mb:.0}"));
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        write!(
            f,
            "{:<20} {:>6} {:<10} {:>28} {:>8.0} {:>7} {:>7} {:>7} {:>7} {:>7} {:>9} {:>10}",
            self.task,
            self.copies,
            self.place,
            format!("{:.0} ({:.0} – {:.0})", steps.median, steps.min, steps.max),
            self.ticks_per_second,
            percent(self.update),
            percent(self.inference),
            percent(self.bus),
            percent(self.messages),
            percent(self.world),
            memory(self.agent_memory_mb),
            memory(self.env_server_memory_mb)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_an_even_number_of_runs_lies_between_the_middle_two() {
        let Spread { min, median, max } = spread(vec![4.0, 1.0, 2.0, 9.0]);
        assert_eq!((min, median, max), (1.0, 3.0, 9.0));
    }
}
