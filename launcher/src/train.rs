//! `rondo train`, `rondo resume` and `rondo config`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use process::Failure;
use proto::config::{Config, MAY_CHANGE};
use proto::exit;
use store::RunFolder;

use crate::display::Show;
use crate::drive::{drive, Options, Place};
use crate::experiment::{overridden, Experiment};
use crate::notes;
use crate::roles::{Ended, Transport};
use crate::state;
use crate::sweep::{self, Part};

/// Folder of runs without `--out`.
const RUNS: &str = "runs";

/// Options of every command that runs a team.
#[derive(Debug, Clone, clap::Args)]
pub struct Running {
    /// Run all roles as threads of this process instead of processes; the result is the same
    #[arg(long)]
    pub in_process: bool,
    /// How the processes reach each other. Without it: unix, and tcp where no folder can hold Unix sockets
    #[arg(long, value_enum)]
    pub transport: Option<Transport>,
    #[command(flatten)]
    pub device: agent::DeviceArgument,
    /// Seconds that roles wait for each other before they give up
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    pub wait: u64,
    /// Show nothing but the summary
    #[arg(long)]
    pub quiet: bool,
    /// Save and end when stdin closes, and show plain lines: set by a sweep, which holds the other end
    #[arg(long, hide = true)]
    pub with_launcher: bool,
}

impl Running {
    /// `teams`: number of teams that train on this machine at the same time.
    ///
    /// # Errors
    /// If this build cannot compute on the device.
    fn options(&self, teams: u32) -> Result<Options, Failure> {
        Ok(Options {
            start_over: false,
            with_launcher: self.with_launcher,
            device: self.device.check()?,
            place: if self.in_process { Place::InProcess } else { Place::Processes(self.transport) },
            wait: Duration::from_secs(self.wait),
            teams,
            show: match (self.quiet, self.with_launcher) {
                (true, _) => Show::Nothing,
                (false, true) => Show::Lines,
                (false, false) => Show::Best,
            },
        })
    }
}

/// Train a team
#[derive(Debug, Clone, clap::Args)]
pub struct Train {
    #[command(flatten)]
    pub experiment: Experiment,
    #[command(flatten)]
    pub running: Running,
    /// Folder for the run. One that holds an unfinished run of the same configuration is continued
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Start anew under a new name, even where a run of the same configuration exists
    #[arg(long)]
    pub fresh: bool,
    /// Train this many seeds, from `--seed` on, each in its own folder below `--out`
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seeds: u32,
    /// How many of the seeds to train side by side
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub jobs: u32,
}

impl Train {
    pub fn run(&self) -> Result<ExitCode, Failure> {
        if self.seeds == 0 || self.jobs == 0 {
            return Err(Failure::new(exit::USAGE, "`--seeds` and `--jobs` must be at least 1"));
        }
        let options = self.running.options(self.jobs)?;
        let algo = &self.experiment.algo;
        // Finds mistakes before anything starts. The run's name needs the task's canonical name.
        let config = self.experiment.configure("check")?;
        if !self.running.with_launcher {
            notes::print(&self.experiment, &config);
        }
        if self.seeds > 1 {
            if self.experiment.settings.iter().any(|setting| setting.starts_with("seed=")) {
                let text = "`--set seed` with `--seeds`: each seed is another one; `--seed` says the first";
                return Err(Failure::new(exit::USAGE, text));
            }
            let out =
                self.choose(&format!("{}-{algo}", config.world.task), |out| self.no_other_seeds(out))?;
            let seeds = (0..self.seeds).map(|k| config.seed.wrapping_add(k.into()));
            let parts = seeds.map(|seed| Part::train(seed, &out)).collect();
            return sweep::run(parts, self.jobs as usize);
        }
        let name = format!("{}-{algo}-seed-{}", config.world.task, config.seed);
        let out = self.choose(&name, |out| self.is_this_run(out, &self.experiment))?;
        let config = self.experiment.configure(&run_name(&out))?;
        process::start_logs(None);
        let folder = if state::is_run(&out) {
            let folder = RunFolder::open(&out)?;
            state::check_unchanged(&folder, &config)?;
            if let Some(finished) = state::finished(&folder, &config)? {
                println!("{finished}\nhint: `--fresh` trains another team");
                return Ok(ExitCode::from(exit::DONE));
            }
            eprintln!("continuing the run in {}", out.display());
            folder
        } else {
            RunFolder::create(&out, &config.to_toml())?
        };
        self.experiment.furnish(&folder)?;
        finish(&folder, &config, options)
    }

    /// The folder to train in: `--out`, or one below `runs`. `fits` rejects a folder that another configuration uses.
    fn choose(&self, name: &str, fits: impl Fn(&Path) -> Result<(), Failure>) -> Result<PathBuf, Failure> {
        let wanted = self.out.clone().unwrap_or_else(|| Path::new(RUNS).join(name));
        let numbered = |n: u32| {
            let mut name = wanted.clone().into_os_string();
            name.push(format!("-{n}"));
            PathBuf::from(name)
        };
        let mut candidates = std::iter::once(wanted.clone()).chain((2..).map(numbered));
        if self.fresh {
            return Ok(candidates.find(|path| !path.exists()).expect("there are enough numbers"));
        }
        if self.out.is_some() {
            return fits(&wanted).map(|()| wanted);
        }
        for path in candidates {
            match fits(&path) {
                Ok(()) => return Ok(path),
                // Another configuration uses it.
                Err(failure) if failure.code == exit::CONFIG => {}
                Err(failure) => return Err(failure),
            }
        }
        unreachable!("there are enough numbers")
    }

    /// Checks that a folder is new, or that of a run with this configuration.
    fn is_this_run(&self, out: &Path, experiment: &Experiment) -> Result<(), Failure> {
        if !state::is_run(out) {
            return state::is_vacant(out);
        }
        let there = Config::from_toml(RunFolder::open(out)?.config_toml());
        let config = experiment.configure(&run_name(out))?;
        let what = match there.map(|there| config.differences(&there)) {
            Err(error) => format!("it cannot be read: {error}"),
            Ok(differences) => match differences.first() {
                None => return Ok(()),
                Some(difference) => difference.to_string(),
            },
        };
        let out = out.display();
        let text = format!(
            "{out} holds a run with another configuration: {what}\nhint: `rondo resume {out}` continues that run; \
             `--fresh` or another `--out` starts a new one"
        );
        Err(Failure::new(exit::CONFIG, text))
    }

    /// Checks that all seeds in a folder of seeds are of this experiment.
    fn no_other_seeds(&self, out: &Path) -> Result<(), Failure> {
        if state::is_run(out) {
            let text =
                format!("{} is the folder of one run, not of seeds; choose another `--out`", out.display());
            return Err(Failure::new(exit::CONFIG, text));
        }
        for (seed, folder) in state::seeds(out)? {
            let experiment = Experiment { seed, ..self.experiment.clone() };
            self.is_this_run(&folder, &experiment)?;
        }
        Ok(())
    }
}

/// Continue a run, or every seed below a folder
#[derive(Debug, Clone, clap::Args)]
pub struct Resume {
    /// The run folder, or a folder of seeds
    pub run: PathBuf,
    /// Train longer: environment steps in all
    #[arg(long, value_name = "N")]
    pub t_max: Option<u64>,
    /// Change a key that may change in a run: save.interval, log.interval or bus.low_latency
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
    /// Start from the beginning if no round is held by every role; the old checkpoints and rows are set aside
    #[arg(long)]
    pub start_over: bool,
    #[command(flatten)]
    pub running: Running,
}

impl Resume {
    pub fn run(&self) -> Result<ExitCode, Failure> {
        let options = Options { start_over: self.start_over, ..self.running.options(1)? };
        if !state::is_run(&self.run) {
            let parts: Vec<Part> = state::seeds(&self.run)?
                .into_iter()
                .map(|(seed, folder)| Part::resume(seed, &folder))
                .collect();
            if !parts.is_empty() {
                return sweep::run(parts, 1);
            }
        }
        let mut folder = RunFolder::open(&self.run)?;
        let before = Config::from_toml(folder.config_toml())?;
        before.validate()?;
        state::check_unchanged(&folder, &before)?;
        let config = self.changed(&before)?;
        notes::print_opponent(&config);
        if let Some(finished) = state::finished(&folder, &config)? {
            let run = self.run.display();
            println!("{finished}\nhint: `rondo resume {run} --t-max N` trains longer");
            return Ok(ExitCode::from(exit::DONE));
        }
        if config != before {
            folder.replace_config(&config.to_toml())?;
        }
        process::start_logs(None);
        finish(&folder, &config, options)
    }

    /// The configuration with this command's changes.
    fn changed(&self, before: &Config) -> Result<Config, Failure> {
        let mut config = overridden(before.clone(), &self.settings)?;
        config.t_max = self.t_max.unwrap_or(config.t_max);
        config.validate()?;
        if let Some(difference) = config.first_difference(before) {
            let text = format!(
                "a run cannot continue with this change: {difference}\nhint: what may change is {} (`t_max` only \
                 upwards); train a new run for anything else",
                MAY_CHANGE.join(", ")
            );
            return Err(Failure::new(exit::CONFIG, text));
        }
        if config.bus != before.bus {
            env_server::check_transport(&config, &env_server::task(&config, &self.run)?)?;
        }
        Ok(config)
    }
}

/// Write the configuration that `train` would run with
#[derive(Debug, Clone, clap::Args)]
pub struct WriteConfig {
    #[command(flatten)]
    pub experiment: Experiment,
    /// Name of the run, part of every key on the bus
    #[arg(long, default_value = "run")]
    pub run: String,
}

impl WriteConfig {
    pub fn run(&self) -> Result<(), Failure> {
        let config = self.experiment.configure(&self.run)?;
        notes::print(&self.experiment, &config);
        print!("{}", config.to_toml());
        Ok(())
    }
}

fn finish(folder: &RunFolder, config: &Config, options: Options) -> Result<ExitCode, Failure> {
    let (ended, summary) = drive(folder, config, options)?;
    println!("{summary}");
    Ok(match ended {
        Ended::Finished => ExitCode::from(exit::DONE),
        Ended::Stopped => {
            println!("stopped early; continue with `rondo resume {}`", folder.path().display());
            ExitCode::from(exit::AGAIN)
        }
    })
}

/// The name of a run: that of its folder, with only the characters that keys allow.
pub fn run_name(out: &Path) -> String {
    let name = out.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let allowed = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    let name: String = name.chars().map(|c| if allowed(c) { c } else { '-' }).take(60).collect();
    if name.starts_with(|c: char| c.is_ascii_alphanumeric()) {
        name
    } else {
        format!("run{name}")
    }
}
