//! `rondo train`, `rondo resume` and `rondo config`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use process::Failure;
use proto::config::Config;
use proto::exit;
use store::RunFolder;

use crate::display::Show;
use crate::drive::{drive, Options, Place};
use crate::experiment::Experiment;
use crate::roles::{Ended, Transport};
use crate::sweep;

/// Where runs go without `--out`.
const RUNS: &str = "runs";

/// Options of every command that runs a team.
#[derive(Debug, Clone, clap::Args)]
pub struct Running {
    /// Run all roles as threads of this process instead of processes; the result is the same
    #[arg(long)]
    pub in_process: bool,
    /// How the processes reach each other
    #[arg(long, value_enum, default_value = "unix")]
    pub transport: Transport,
    #[command(flatten)]
    pub device: agent::DeviceArgument,
    /// Seconds that roles wait for each other before they give up
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    pub wait: u64,
    /// Show nothing but the summary
    #[arg(long)]
    pub quiet: bool,
    /// End when stdin closes, and show plain lines: set by a sweep, which holds the other end
    #[arg(long, hide = true)]
    pub with_launcher: bool,
}

impl Running {
    /// `teams`: how many train on this machine at the same time.
    ///
    /// # Errors
    /// If this build cannot compute on the device.
    fn options(&self, teams: u32) -> Result<Options, Failure> {
        if self.with_launcher {
            process::leave_with_launcher();
        }
        Ok(Options {
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
    /// Folder for the run; it must not exist yet
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
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
            return Err(Failure::new(exit::USAGE, "`--seeds` and `--jobs` are counted from 1"));
        }
        let options = self.running.options(self.jobs)?;
        let algo = &self.experiment.algo;
        if self.seeds > 1 {
            // Mistakes are found before the first seed starts.
            let config = self.experiment.configure("check")?;
            let out = self.out.clone().unwrap_or_else(|| fresh(&format!("{}-{algo}", config.world.task)));
            let first = self.experiment.seed;
            let seeds: Vec<u64> = (0..self.seeds).map(|k| first.wrapping_add(k.into())).collect();
            return sweep::run(&seeds, self.jobs as usize, &out);
        }
        // The name needs the task's canonical spelling.
        let config = self.experiment.configure("run")?;
        let name = format!("{}-{algo}-seed-{}", config.world.task, config.seed);
        let out = self.out.clone().unwrap_or_else(|| fresh(&name));
        let config = self.experiment.configure(&run_name(&out))?;
        process::start_logs(None);
        let folder = RunFolder::create(&out, &config.to_toml())?;
        self.experiment.furnish(&folder)?;
        finish(&folder, &config, options)
    }
}

/// Go on with a run
#[derive(Debug, Clone, clap::Args)]
pub struct Resume {
    /// The run folder
    pub run: PathBuf,
    #[command(flatten)]
    pub running: Running,
}

impl Resume {
    pub fn run(&self) -> Result<ExitCode, Failure> {
        let options = self.running.options(1)?;
        let folder = RunFolder::open(&self.run)?;
        let config = Config::from_toml(folder.config_toml())?;
        config.validate()?;
        process::start_logs(None);
        finish(&folder, &config, options)
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
        print!("{}", self.experiment.configure(&self.run)?.to_toml());
        Ok(())
    }
}

fn finish(folder: &RunFolder, config: &Config, options: Options) -> Result<ExitCode, Failure> {
    let (ended, summary) = drive(folder, config, options)?;
    println!("{summary}");
    Ok(match ended {
        Ended::Finished => ExitCode::from(exit::DONE),
        Ended::Stopped => {
            println!("stopped before its end; go on with `rondo resume {}`", folder.path().display());
            ExitCode::from(exit::AGAIN)
        }
    })
}

/// A folder below `runs` that does not exist yet.
fn fresh(name: &str) -> PathBuf {
    let first = Path::new(RUNS).join(name);
    let later = (2..).map(|n| Path::new(RUNS).join(format!("{name}-{n}")));
    std::iter::once(first).chain(later).find(|path| !path.exists()).expect("there are enough numbers")
}

/// The name of a run: that of its folder, in the characters that keys may have.
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
