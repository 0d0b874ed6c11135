//! `rondo bench`: training speed on this machine, in processes and in one process, with the time by activity.
//!
//! Every line is a real run with the paper's settings and tests of one episode. The table has medians over the runs.
//! Steps per second are those of the env-server between its first and last tick. Machines differ and are shared, so
//! each speed is also given as a share of the arithmetic limit measured in the same call.

mod arithmetic;
mod busy;
mod cases;
mod compare;

use std::path::PathBuf;
use std::time::Duration;

use algos::device::DeviceName;
use nix::sched::{sched_setaffinity, CpuSet};
use nix::unistd::Pid;
use process::Failure;
use proto::exit;
use serde::{Deserialize, Serialize};
use store::RunFolder;

use crate::display::Show;
use crate::drive::{drive, Options, Place};
use crate::experiment::{unknown, Experiment};
use crate::roles::{Ended, Transport};
use crate::summary::Summary;
use arithmetic::{flops_per_env_step, peak_flops};
use busy::Loops;
use cases::{Beside, Case, Suite, Where, SUITES};

/// Runs before the measured ones: caches, and the processor's clock.
const WARM_UP: u64 = 1;

/// Measure training speed
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = suites())]
pub struct Bench {
    /// Which cases to measure; `all` for all of them
    #[arg(long, default_value = "lbf")]
    suite: String,
    /// Runs of each case; the table gives medians
    #[arg(long, default_value_t = 5)]
    runs: u32,
    /// Environment steps of each run instead of those of the suite
    #[arg(long)]
    steps: Option<u64>,
    /// Only cases in this place: processes or in-process
    #[arg(long, value_name = "PLACE")]
    only: Option<String>,
    /// Write everything measured into this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Print ratios to the cases of an earlier `--json` file
    #[arg(long, value_name = "FILE")]
    compare: Option<PathBuf>,
}

fn suites() -> String {
    let line = |suite: &Suite| format!("  {:8} {}\n", suite.name, suite.about);
    let suites: String = SUITES.iter().map(line).collect();
    format!("Suites:\n{suites}\nAllocations are counted by a build with `--features count-allocations`.")
}

/// All results of a call.
#[derive(Debug, Serialize, Deserialize)]
struct Report {
    rondo_version: String,
    machine: Machine,
    cases: Vec<Measured>,
}

/// One case, medians over its runs.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Measured {
    task: String,
    algo: String,
    copies: u32,
    place: String,
    /// Other work on the machine; `None` for an idle machine.
    #[serde(default)]
    beside: Option<String>,
    /// Of one run; of both runs of a pair.
    env_steps_per_second: Spread,
    /// Floating-point operations per second in the algorithm's products, relative to the peak of all cores.
    share_of_limit: f64,
    ticks_per_second: f64,
    /// Shares of the run's time in the env-server.
    parts: Parts,
    /// Shares of the agents' update calls.
    update_call: UpdateCall,
    bytes_per_tick: f64,
    /// In all roles; only in builds that count allocations.
    allocations_per_tick: Option<f64>,
    /// Processor time of all roles for an environment step, from their start to their end, in microseconds.
    cpu_us_per_env_step: Option<f64>,
    /// From the start of the launcher's work to the first environment step.
    start_seconds: f64,
    agent_memory_mb: Option<f64>,
    env_server_memory_mb: Option<f64>,
}

/// The time of a run by activity.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Parts {
    /// Waiting for update calls.
    update: f64,
    /// Forward passes of the slowest agent, to act.
    inference: f64,
    /// Choosing actions, of the slowest agent.
    sampling: f64,
    /// Observing worlds, writing and reading messages: the env-server, and the slowest agent.
    encode: f64,
    /// Handing messages to the bus.
    send: f64,
    /// The rest of the wait for actions: the bus, and agents that wait for a processor.
    bus: f64,
    /// Resetting and stepping worlds.
    world: f64,
    /// Checkpoints and metric rows.
    disk: f64,
}

/// An update call by activity.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct UpdateCall {
    /// Batch layout.
    layout: f64,
    forward: f64,
    /// Returns, losses, and the gradients of the networks' outputs.
    loss: f64,
    backward: f64,
    /// Clipping, Adam, target networks.
    optimiser: f64,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Spread {
    min: f64,
    median: f64,
    max: f64,
}

#[derive(Debug, Serialize, Deserialize)]
struct Machine {
    processor: String,
    cores: usize,
    sgemm_gflops_one_core: f64,
    sgemm_gflops_all_cores: f64,
}

impl Bench {
    pub fn run(&self) -> Result<(), Failure> {
        let cases = self.cases()?;
        // Before minutes of measurement.
        let before = self.compare.as_deref().map(compare::read).transpose()?;
        if self.runs == 0 || self.steps == Some(0) {
            return Err(Failure::new(exit::USAGE, "`--runs` and `--steps` must be at least 1"));
        }
        let machine = Machine::here();
        println!(
            "{}, {} cores, sgemm {:.0} GFLOP/s on one core, {:.0} on all",
            machine.processor, machine.cores, machine.sgemm_gflops_one_core, machine.sgemm_gflops_all_cores
        );
        println!("{} runs of each case after one to warm up; medians (min – max)\n", self.runs);
        println!("{HEAD}");
        let mut report =
            Report { rondo_version: env!("CARGO_PKG_VERSION").to_owned(), machine, cases: vec![] };
        for (case, place, beside) in cases {
            let measured = self.measure(&case, place, beside, &report.machine)?;
            println!("{measured}");
            report.cases.push(measured);
        }
        print!("{}", busy::ratios(&report.cases));
        if let Some(path) = &self.json {
            let text = serde_json::to_string_pretty(&report).map_err(|e| Failure::new(exit::BUG, e))?;
            std::fs::write(path, text + "\n")
                .map_err(|e| Failure::new(exit::IO, format!("cannot write {}: {e}", path.display())))?;
        }
        if let Some(before) = before {
            print!("\n{}", compare::ratios(&before, &report));
        }
        Ok(())
    }

    fn cases(&self) -> Result<Vec<(Case, Where, Beside)>, Failure> {
        let mut names: Vec<&str> = SUITES.iter().map(|suite| suite.name).collect();
        names.push("all");
        if !names.contains(&self.suite.as_str()) {
            return Err(unknown(&self.suite, "suite", &names));
        }
        let places = [Where::Processes, Where::InProcess].map(Where::as_str);
        if let Some(only) = self.only.as_deref().filter(|only| !places.contains(only)) {
            return Err(unknown(only, "place", &places));
        }
        let chosen = SUITES.iter().filter(|suite| self.suite == "all" || suite.name == self.suite);
        let cases = chosen.flat_map(|suite| suite.cases);
        let lines = cases.flat_map(|case| {
            let places = case.places.iter();
            places.flat_map(move |&place| case.beside.iter().map(move |&beside| (*case, place, beside)))
        });
        Ok(lines
            .filter(|(_, place, _)| self.only.as_deref().is_none_or(|only| place.as_str() == only))
            .collect())
    }

    fn measure(
        &self,
        case: &Case,
        place: Where,
        beside: Beside,
        machine: &Machine,
    ) -> Result<Measured, Failure> {
        let steps = self.steps.unwrap_or(case.steps);
        let experiment = Experiment {
            t_max: Some(steps),
            envs: Some(case.copies),
            test_interval: Some(steps),
            test_episodes: Some(1),
            ..Experiment::of(case.task, case.algo)
        };
        let config = experiment.configure("bench")?;
        let task = envs::task(&config.world.task).map_err(|e| Failure::new(exit::CONFIG, e))?;
        let flops = flops_per_env_step(&config, task.sizes());
        let mut runs = Vec::new();
        let _loops = Loops::start(beside, machine.cores)?;
        for seed in 1..=WARM_UP + u64::from(self.runs) {
            let experiment = Experiment { seed, ..experiment.clone() };
            let (place, one_core_each) = match place {
                Where::Processes => (Place::Processes(Some(Transport::Unix)), false),
                Where::InProcess => (Place::InProcess, false),
                Where::PairInProcess => (Place::InProcess, true),
            };
            let summaries = if one_core_each || beside == Beside::ARun {
                pair(&experiment, place, one_core_each)?
            } else {
                vec![one(&experiment, place)?]
            };
            if seed > WARM_UP {
                runs.push(summaries);
            }
        }
        let speed_of = |runs: &Vec<Summary>| {
            let sum = runs.iter().map(|run| run.env_steps_per_second).sum::<f64>();
            if beside == Beside::ARun {
                sum / runs.len() as f64
            } else {
                sum
            }
        };
        let speed = spread(runs.iter().map(speed_of).collect());
        let firsts: Vec<&Summary> = runs.iter().map(|runs| &runs[0]).collect();
        let of = |f: &dyn Fn(&Summary) -> f64| spread(firsts.iter().map(|run| f(run)).collect()).median;
        let world = |name: &'static str| of(&|run| run.seconds("world", name) / run.training_seconds());
        let of_agents = |run: &Summary, account: &str, name: &str| -> Vec<f64> {
            let agents = run.roles.iter().filter(|(role, _)| role.starts_with("agent"));
            agents.filter_map(|(_, report)| report[account][name].as_f64()).collect()
        };
        let slowest = |account: &'static str, name: &'static str| {
            of(&|run| of_agents(run, account, name).into_iter().fold(0.0, f64::max) / run.training_seconds())
        };
        let whole_answer = slowest("seconds", "inference") + slowest("seconds", "encode");
        let in_update_calls = |name: &'static str| {
            const ALL: [&str; 5] = ["layout", "forward", "loss", "backward", "optimiser"];
            of(&|run| {
                let sum = |name| of_agents(run, "learner_seconds", name).into_iter().sum::<f64>();
                // A short run of Q-learning may make no update call at all.
                sum(name) / ALL.into_iter().map(sum).sum::<f64>().max(f64::MIN_POSITIVE)
            })
        };
        let memory = |role: &'static str| {
            let of_role = |run: &Summary| Some(run.roles[role]["peak_memory_bytes"].as_f64()? / 1e6);
            median_of_known(&firsts, of_role).filter(|_| place == Where::Processes)
        };
        let ticks = |run: &Summary| run.roles["world"]["ticks"].as_f64().unwrap_or(f64::NAN);
        Ok(Measured {
            task: case.task.to_owned(),
            algo: case.algo.to_owned(),
            copies: case.copies,
            place: place.as_str().to_owned(),
            beside: beside.name(),
            env_steps_per_second: speed,
            share_of_limit: speed.median * flops / (1e9 * machine.sgemm_gflops_all_cores),
            ticks_per_second: of(&|run| ticks(run) / run.training_seconds()),
            parts: Parts {
                update: world("updates"),
                inference: slowest("learner_seconds", "acting"),
                sampling: slowest("learner_seconds", "choosing"),
                encode: world("encode") + slowest("seconds", "encode"),
                send: world("send"),
                bus: (world("actions") - whole_answer).max(0.0),
                world: world("world"),
                disk: world("disk"),
            },
            update_call: UpdateCall {
                layout: in_update_calls("layout"),
                forward: in_update_calls("forward"),
                loss: in_update_calls("loss"),
                backward: in_update_calls("backward"),
                optimiser: in_update_calls("optimiser"),
            },
            bytes_per_tick: of(&|run| {
                let of_ticks = run.bytes_by_key.iter();
                let of_ticks = of_ticks.filter(|(key, _)| key.ends_with("/observe") || key.ends_with("/act"));
                of_ticks.map(|(_, &bytes)| bytes as f64).sum::<f64>() / ticks(run)
            }),
            allocations_per_tick: median_of_known(&firsts, |run| {
                let counts = run.roles.values().map(|role| role["allocations"].as_f64());
                // The coordinator does not take part in ticks.
                let counted: Vec<f64> = counts.flatten().collect();
                (!counted.is_empty()).then(|| counted.iter().sum::<f64>() / ticks(run))
            })
            .filter(|_| place == Where::Processes),
            cpu_us_per_env_step: (place == Where::Processes).then(|| {
                of(&|run| {
                    let seconds =
                        run.roles.values().filter_map(|role| role["cpu_seconds"].as_f64()).sum::<f64>();
                    1e6 * seconds / run.t_env as f64
                })
            }),
            start_seconds: of(&|run| run.start_seconds),
            agent_memory_mb: memory("agent-0"),
            env_server_memory_mb: memory("world"),
        })
    }
}

/// One run in a new folder.
fn one(experiment: &Experiment, place: Place) -> Result<Summary, Failure> {
    let config = experiment.configure("bench")?;
    let place_of_run = tempfile::tempdir()
        .map_err(|e| Failure::new(exit::IO, format!("cannot make a folder for the run: {e}")))?;
    let folder = RunFolder::create(place_of_run.path().join("run"), &config.to_toml())?;
    let options = Options {
        start_over: false,
        with_launcher: false,
        place,
        device: DeviceName::Cpu,
        wait: Duration::from_secs(60),
        show: Show::Nothing,
        teams: 1,
    };
    let (ended, summary) = drive(&folder, &config, options)?;
    if ended == Ended::Stopped {
        return Err(Failure::new(exit::AGAIN, "the measurement was stopped"));
    }
    Ok(summary)
}

/// Two runs at once, with different seeds.
fn pair(experiment: &Experiment, place: Place, one_core_each: bool) -> Result<Vec<Summary>, Failure> {
    std::thread::scope(|scope| {
        let run = |core: usize| {
            let experiment = Experiment { seed: 1000 * core as u64 + experiment.seed, ..experiment.clone() };
            scope.spawn(move || {
                if one_core_each {
                    // The threads of the roles inherit it.
                    stay_on(core)?;
                }
                one(&experiment, place)
            })
        };
        let runs = [run(0), run(1)];
        runs.into_iter().map(|run| run.join().expect("a run reports failures as such")).collect()
    })
}

fn stay_on(core: usize) -> Result<(), Failure> {
    let mut cores = CpuSet::new();
    let set = cores.set(core).and_then(|()| sched_setaffinity(Pid::from_raw(0), &cores));
    set.map_err(|e| Failure::new(exit::USAGE, format!("cannot keep a run on core {core}: {e}")))
}

fn spread(mut values: Vec<f64>) -> Spread {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    let median =
        if values.len() % 2 == 1 { values[middle] } else { (values[middle - 1] + values[middle]) / 2.0 };
    Spread { min: values[0], median, max: values[values.len() - 1] }
}

impl Machine {
    fn here() -> Machine {
        let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let name = cpu.lines().find_map(|line| line.strip_prefix("model name"));
        let name = name.and_then(|rest| rest.split_once(": "));
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let (one, all) = peak_flops(cores);
        Machine {
            processor: name.map_or("unknown processor", |(_, name)| name).to_owned(),
            cores,
            sgemm_gflops_one_core: one / 1e9,
            sgemm_gflops_all_cores: all / 1e9,
        }
    }
}

/// The median over the runs, if all of them have a value.
fn median_of_known(runs: &[&Summary], of: impl Fn(&Summary) -> Option<f64>) -> Option<f64> {
    let known: Option<Vec<f64>> = runs.iter().map(|run| of(run)).collect();
    known.map(|values| spread(values).median)
}

/// Above the lines of [`Measured`].
const HEAD: &str = "\
task                         algo   copies place                         env steps/s  limit  ticks/s update infer. sample encode \
send   bus world  disk  B/tick allocs/tick CPU us/step start s MB/agent MB/server | layout forward loss backward optimiser";

impl Measured {
    /// The measured case, without the other work on the machine.
    fn case(&self) -> (&str, &str, u32, &str) {
        (&self.task, &self.algo, self.copies, &self.place)
    }
}

impl std::fmt::Display for Measured {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let steps = self.env_steps_per_second;
        let Parts { update, inference, sampling, encode, send, bus, world, disk } = self.parts;
        let UpdateCall { layout, forward, loss, backward, optimiser } = self.update_call;
        let known = |x: Option<f64>, digits: usize| x.map_or("–".to_owned(), |x| format!("{x:.digits$}"));
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        if let Some(beside) = &self.beside {
            writeln!(f, "beside {beside}:")?;
        }
        write!(
            f,
            "{:<28} {:<6} {:>6} {:<12} {:>28} {:>6} {:>8.0} {:>6} {:>6} {:>6} {:>6} {:>4} {:>5} {:>5} {:>5} {:>7.0} {:>11} {:>11} {:>7.2} {:>8} {:>9} | {:>6} {:>7} {:>4} {:>8} {:>9}",
            self.task,
            self.algo,
            self.copies,
            self.place,
            format!("{:.0} ({:.0} – {:.0})", steps.median, steps.min, steps.max),
            percent(self.share_of_limit),
            self.ticks_per_second,
            percent(update),
            percent(inference),
            percent(sampling),
            percent(encode),
            percent(send),
            percent(bus),
            percent(world),
            percent(disk),
            self.bytes_per_tick,
            known(self.allocations_per_tick, 0),
            known(self.cpu_us_per_env_step, 1),
            self.start_seconds,
            known(self.agent_memory_mb, 0),
            known(self.env_server_memory_mb, 0),
            percent(layout),
            percent(forward),
            percent(loss),
            percent(backward),
            percent(optimiser)
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
