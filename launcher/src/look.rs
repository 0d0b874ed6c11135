//! Commands that read runs and tasks: digest, plot, compare, example, tasks.

mod tasks;

use std::fmt::Display;
use std::path::PathBuf;

use monitor::estimation::Problem;
use monitor::{Found, PlotOptions};
use process::Failure;
use proto::exit;
use serde::Serialize;
use store::RunFolder;

use crate::notes;

pub use tasks::Tasks;

pub fn unusable(error: monitor::Error) -> Failure {
    let code = match error {
        monitor::Error::Read { .. } | monitor::Error::Write { .. } | monitor::Error::Terminal(_) => exit::IO,
        monitor::Error::Raster { .. } => exit::BUG,
        monitor::Error::Extension { .. } => exit::USAGE,
        _ => exit::CONFIG,
    };
    Failure::new(code, error)
}

/// Print digests of the final weights and the metric rows
#[derive(Debug, Clone, clap::Args)]
pub struct Digest {
    /// The run folder
    run: PathBuf,
    /// One line of JSON
    #[arg(long)]
    json: bool,
}

impl Digest {
    pub fn run(&self) -> Result<(), Failure> {
        process::start_logs(None);
        let folder = RunFolder::open(&self.run)?;
        let agents = agents(&folder)?;
        match store::digest(&folder, agents) {
            Ok(digest) => self.print(&digest),
            Err(why) if why.is_unfinished() => {
                self.print(&store::partial_digest(&folder, agents)?)?;
                Err(Failure::new(exit::AGAIN, format!("this is not the digest of the run: {why}")))
            }
            Err(error) => Err(error.into()),
        }
    }

    fn print(&self, digest: &(impl Display + Serialize)) -> Result<(), Failure> {
        if self.json {
            let line = serde_json::to_string(digest).map_err(|error| Failure::new(exit::BUG, error))?;
            println!("{line}");
        } else {
            println!("{digest}");
        }
        Ok(())
    }
}

/// Number of agents of a run. Reads this key only, because the rest may be of another version of Rondo.
fn agents(folder: &RunFolder) -> Result<usize, Failure> {
    let table = folder.config_toml().parse::<toml::Table>().ok();
    let agents = table.as_ref().and_then(|table| table.get("world")?.get("agents")?.as_integer());
    agents.and_then(|agents| usize::try_from(agents).ok()).filter(|&agents| agents > 0).ok_or_else(|| {
        let text = format!(
            "{}/config.toml does not have the number of agents (`world.agents`)\nhint: it is damaged or half \
             copied, copy it again",
            folder.path().display()
        );
        Failure::new(exit::CONFIG, text)
    })
}

/// Draw learning curves
#[derive(Debug, Clone, clap::Args)]
pub struct Plot {
    /// Run folders, folders of runs, or reference curves (.json)
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// The picture, .png or .svg
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The metric, for example `return_mean` or `agent-0/entropy`
    #[arg(long, default_value = "test_return_mean")]
    metric: String,
    /// Smooth over this many points, centred
    #[arg(long, default_value_t = 1)]
    smooth: usize,
    /// Largest number of environment steps to show
    #[arg(long, value_name = "N")]
    x_max: Option<f64>,
    /// Title of the picture
    #[arg(long)]
    title: Option<String>,
}

impl Plot {
    pub fn run(&self) -> Result<(), Failure> {
        let curves = load(&self.runs, &self.metric)?;
        let differences = monitor::meaning::differences(curves.iter());
        if !differences.is_empty() {
            let list: Vec<String> = differences.iter().map(ToString::to_string).collect();
            eprintln!("warning: the numbers of these runs do not have the same meaning: {}", list.join(", "));
        }
        let groups = monitor::group(curves);
        let defaults = PlotOptions::default();
        let options = PlotOptions {
            title: self.title.clone().unwrap_or(defaults.title),
            metric: self.metric.clone(),
            smooth: self.smooth,
            x_max: self.x_max,
        };
        monitor::plot(&groups, &options, &self.out).map_err(unusable)?;
        println!("{}", self.out.display());
        Ok(())
    }
}

/// The curves of all runs that can be read. The others are named on stderr.
fn load(paths: &[PathBuf], metric: &str) -> Result<Vec<monitor::Curve>, Failure> {
    let Found { curves, mut left_out } = monitor::load_all(paths, metric);
    if curves.is_empty() && !left_out.is_empty() {
        // The first one is the returned error, so each cause is reported once.
        let first = left_out.remove(0);
        left_out.iter().for_each(|error| eprintln!("skipped: {error}"));
        return Err(unusable(first));
    }
    left_out.iter().for_each(|error| eprintln!("skipped: {error}"));
    let role = metric.split_once('/').map_or("world", |(role, _)| role);
    for curve in curves.iter().filter(|curve| curve.source.is_dir()) {
        // What can be read is drawn; only what is known to be missing is named.
        if let Err(error @ store::Error::MissingRows { .. }) =
            RunFolder::open(&curve.source).and_then(|run| run.check_rows(role))
        {
            eprintln!("skipped: {error}");
        }
    }
    Ok(curves)
}

/// Compare learning curves with reference curves, or print the scores of each group of runs
#[derive(Debug, Clone, clap::Args)]
pub struct Compare {
    /// Run folders, folders of runs, or reference curves (.json)
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Reference curves (.json), or runs to compare with; without it only the scores are printed: final, mean of the
    /// last five test points, best and mean over all (AUC), each as mean, standard error and interquartile mean
    #[arg(long, num_args = 1..)]
    reference: Vec<PathBuf>,
    /// The metric, for example `return_mean` or `agent-0/entropy`
    #[arg(long, default_value = "test_return_mean")]
    metric: String,
}

impl Compare {
    pub fn run(&self) -> Result<(), Failure> {
        let ours = load(&self.runs, &self.metric)?;
        for note in notes::on_curves(&ours) {
            eprintln!("note: {note}");
        }
        if self.reference.is_empty() {
            let scores = monitor::scores(&monitor::group(ours));
            let tables: Vec<String> = scores.iter().map(ToString::to_string).collect();
            println!("{}", tables.join("\n\n"));
            return Ok(());
        }
        let reference = load(&self.reference, &self.metric)?;
        println!("{}", monitor::compare(&ours, &reference));
        Ok(())
    }
}

/// Work out an example from the paper
#[derive(Debug, Clone, clap::Args)]
pub struct Example {
    #[command(subcommand)]
    which: Which,
}

#[derive(Debug, Clone, clap::Subcommand)]
enum Which {
    /// Agents estimate one quantity; the order of their updates decides whether they converge
    Estimation {
        /// Weight of the square of each agent's error
        #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
        p: f64,
        /// Weight of the product of two agents' errors
        #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
        q: f64,
        /// Variance of the noise in what each agent sees
        #[arg(long, default_value_t = 0.5, allow_negative_numbers = true)]
        variance: f64,
        /// Number of agents
        #[arg(long, default_value_t = 3)]
        n: usize,
        /// Where to draw it, .png or .svg
        #[arg(long, value_name = "FILE", default_value = "estimation.svg")]
        out: PathBuf,
    },
}

impl Example {
    pub fn run(&self) -> Result<(), Failure> {
        let Which::Estimation { p, q, variance, n, out } = &self.which;
        let problem =
            Problem::new(*p, *q, *variance, *n).map_err(|error| Failure::new(exit::USAGE, error))?;
        println!("{}", monitor::estimation_report(&problem));
        monitor::estimation_plot(&problem, out).map_err(unusable)?;
        println!("drawn in {}", out.display());
        Ok(())
    }
}
