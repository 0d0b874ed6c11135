//! What a role works with, wherever it runs: as a process of its own or as a thread beside others.

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
    /// How long to wait for others.
    pub wait: Duration,
    /// Where everything arrives that the role reads from `events`.
    pub inbox: Inbox,
    /// The one place that the role listens to.
    pub events: Events,
}

impl Role {
    /// With an empty inbox.
    ///
    /// # Errors
    /// If the configuration's run name cannot be part of a key.
    pub fn new(
        bus: Arc<dyn Bus>,
        config: Config,
        folder: RoleFolder,
        wait: Duration,
    ) -> Result<Self, Failure> {
        let keys = Keys::new(&config.run).map_err(|error| Failure::new(exit::CONFIG, error))?;
        let (inbox, events) = bus::inbox();
        Ok(Self { config, keys, folder, bus, wait, inbox, events })
    }

    /// For its result.json: key, messages and payload bytes of everything that it sent.
    pub fn traffic(&self) -> Vec<(String, u64, u64)> {
        self.bus.traffic().into_iter().map(|sent| (sent.key, sent.messages, sent.bytes)).collect()
    }
}
