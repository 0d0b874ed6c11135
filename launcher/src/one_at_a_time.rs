//! Keeps a second `rondo` out of a run that one is busy with: they would overwrite each other's checkpoints.

use std::fs::File;
use std::path::Path;

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use process::Failure;
use proto::exit;

/// Holds the run in folder `path` for as long as the value lives. The system lets go of it when this
/// process ends, however it ends; children do not inherit it.
///
/// # Errors
/// If another process holds it, or config.toml cannot be opened.
pub fn hold(path: &Path) -> Result<Flock<File>, Failure> {
    let config = path.join("config.toml");
    let failed = |error: &dyn std::fmt::Display| {
        Failure::new(exit::IO, format!("cannot lock {}: {error}", config.display()))
    };
    let file = File::open(&config).map_err(|error| failed(&error))?;
    Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|(_, error)| match error {
        Errno::EWOULDBLOCK => {
            let text = format!("another rondo is busy with the run in {}", path.display());
            Failure::new(exit::AGAIN, format!("{text}\nhint: wait until it ends, or stop it"))
        }
        other => failed(&other),
    })
}
