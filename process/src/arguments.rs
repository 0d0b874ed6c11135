//! The arguments of every role, and what they open: configuration, run folder, bus.

use std::path::PathBuf;
use std::time::Duration;

use bus::Options;
use proto::config::Config;
use proto::exit;
use store::RunFolder;

use crate::{record, start_logs, watch, Failure, Role};

/// The arguments of every role.
#[derive(Debug, Clone, clap::Args)]
pub struct Common {
    /// The experiment's configuration: the same file for every process of the run (`rondo config` writes one)
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// The run folder: this role writes its checkpoints, metrics and logs below it, and finds them there again
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Endpoint of a monitor to send scalars to; it may be absent
    #[arg(long, value_name = "ENDPOINT")]
    pub monitor: Option<String>,
    /// Seconds to wait for the other processes of the run
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    pub wait: u64,
    /// Write down everything this role sends and declares on the bus, as JSON lines
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Save and leave when stdin closes: set by the launcher, which holds the other end
    #[arg(long, hide = true)]
    pub with_launcher: bool,
}

impl Common {
    /// Opens configuration, folder and bus, in this order, which is that in which mistakes are reported.
    ///
    /// # Errors
    /// The first of them that cannot be opened.
    pub fn open(&self, role: &str, listen: Vec<String>, connect: Vec<String>) -> Result<Role, Failure> {
        if self.with_launcher {
            watch::follow_launcher(role == "world");
        }
        let text = std::fs::read_to_string(&self.config).map_err(|error| {
            let hint = "hint: `rondo config TASK` writes a configuration";
            Failure::new(exit::CONFIG, format!("cannot read {}: {error}; {hint}", self.config.display()))
        })?;
        let config = Config::from_toml(&text)
            .map_err(|error| Failure::new(exit::CONFIG, format!("{}: {error}", self.config.display())))?;
        config.validate()?;
        let folder = RunFolder::create_or_open(&self.out, &config.to_toml())?.role(role)?;
        start_logs(Some(folder.log_file()?));

        let wait = Duration::from_secs(self.wait);
        let mut bus = bus::open(&Options {
            listen,
            connect,
            optional_connect: self.monitor.iter().cloned().collect(),
            connect_timeout: wait,
            low_latency: config.bus.low_latency,
        })?;
        if let Some(path) = &self.record {
            bus = record::record_to(bus, path)?;
        }
        for endpoint in bus.endpoints() {
            println!("{} {endpoint}", watch::LISTENING);
        }
        let role = Role::new(bus, config, folder, wait)?;
        if self.with_launcher {
            // Fails only if one process opens two roles; the launcher starts one process for each.
            let _ = watch::INBOX.set(role.inbox.clone());
        }
        watch::stop_on_signals(role.inbox.clone())?;
        Ok(role)
    }
}
