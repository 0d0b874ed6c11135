//! What a role works with, both as a separate process and as a thread.

use std::sync::Arc;
use std::time::Duration;

use bus::{Bus, Events, Inbox};
use proto::config::Config;
use proto::exit;
use proto::keys::Keys;
use store::RoleFolder;

use crate::Failure;

/// One role's configuration, folder, side of the bus and inbox.
pub struct Role {
    /// The validated configuration.
    pub config: Config,
    /// The keys of its run.
    pub keys: Keys,
    /// The role's part of the run folder.
    pub folder: RoleFolder,
    /// Its side of the bus.
    pub bus: Arc<dyn Bus>,
    /// How long to wait for other processes.
    pub wait: Duration,
    /// The sending end of `events`.
    pub inbox: Inbox,
    /// All that the role receives.
    pub events: Events,
}

impl Role {
    /// With an empty inbox.
    ///
    /// # Errors
    /// If the configuration's run name cannot be part of a key, or the role's checkpoints were made with another
    /// configuration.
    pub fn new(
        bus: Arc<dyn Bus>,
        config: Config,
        folder: RoleFolder,
        wait: Duration,
    ) -> Result<Self, Failure> {
        let keys = Keys::new(&config.run).map_err(|error| Failure::new(exit::CONFIG, error))?;
        if let Some(text) = folder.config_toml()? {
            check_unchanged(&config, &text).map_err(|what| {
                let text = format!(
                    "{} holds checkpoints of another configuration: {what}\nhint: start with the run's own \
                     config.toml; `rondo resume RUN --set KEY=VALUE` changes what may change",
                    folder.path().display()
                );
                Failure::new(exit::CONFIG, text)
            })?;
        }
        let (inbox, events) = bus::inbox();
        Ok(Self { config, keys, folder, bus, wait, inbox, events })
    }

    /// Moves the role's old state, if any, to another folder and logs which. Called when a run starts from the
    /// beginning. Another process has decided that, so nothing is deleted.
    ///
    /// # Errors
    /// I/O errors.
    pub fn set_aside(&self) -> Result<(), Failure> {
        if let Some(folder) = self.folder.set_aside()? {
            tracing::warn!(folder = %folder.display(), "the run starts from the beginning; old state is set aside");
        }
        Ok(())
    }

    /// For its result.json: key, messages and payload bytes of all that it sent.
    pub fn traffic(&self) -> Vec<(String, u64, u64)> {
        self.bus.traffic().into_iter().map(|sent| (sent.key, sent.messages, sent.bytes)).collect()
    }
}

/// Compares a configuration with the one that checkpoints were made with.
///
/// # Errors
/// The first key that differs and must not, or why the old configuration cannot be read.
pub fn check_unchanged(config: &Config, made_with: &str) -> Result<(), String> {
    let before = Config::from_toml(made_with).map_err(|error| format!("it cannot be read: {error}"))?;
    match config.first_difference(&before) {
        Some(difference) => Err(difference.to_string()),
        None => Ok(()),
    }
}
