//! Lock: one `rondo` per run folder. Two would overwrite each other's checkpoints.

use std::fs::File;
use std::path::Path;

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use process::Failure;
use proto::exit;

/// Locks the run in folder `path` while the value exists. The system releases the lock when this process ends for any
/// reason; children do not inherit it.
///
/// # Errors
/// If another process has the lock, or config.toml cannot be opened.
pub fn hold(path: &Path) -> Result<Flock<File>, Failure> {
    let config = path.join("config.toml");
    let failed = |error: &dyn std::fmt::Display| {
        Failure::new(exit::IO, format!("cannot lock {}: {error}", config.display()))
    };
    let file = File::open(&config).map_err(|error| failed(&error))?;
    Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|(_, error)| match error {
        Errno::EWOULDBLOCK => {
            let text = format!("another `rondo` process is running {}", path.display());
            Failure::new(exit::AGAIN, format!("{text}\nhint: wait until it ends, or stop it"))
        }
        other => failed(&other),
    })
}
