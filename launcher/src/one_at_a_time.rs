//! Lock: one `rondo` per run folder. Two would overwrite each other's checkpoints.

use std::fs::File;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::{SocketAddr, UnixListener};
use std::path::Path;

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use process::Failure;
use proto::exit;

/// A run that is held for as long as this lives. The system lets go of it when this process ends, however it ends;
/// children do not inherit it.
#[derive(Debug)]
pub enum Held {
    /// By a lock on its config.toml.
    Locked { _lock: Flock<File> },
    /// On this host alone, by a name that only one process can have: the file system refuses locks.
    Named { _name: UnixListener },
    /// Not at all: there are neither locks nor names.
    Not,
}

/// Holds the run in folder `path`. Where the file system refuses locks, as some network file systems do, only a
/// process on this host is kept out, and a warning says so.
///
/// # Errors
/// If another process holds it, or config.toml cannot be opened for writing.
pub fn hold(path: &Path) -> Result<Held, Failure> {
    let config = path.join("config.toml");
    let failed = |error: io::Error| {
        let text = format!("cannot open {} for writing: {error}", config.display());
        Failure::new(exit::IO, format!("{text}\nhint: a run goes on only in a folder that can be written to"))
    };
    // For writing: a network file system makes another kind of lock of it, which needs that.
    let file = File::options().read(true).write(true).open(&config).map_err(failed)?;
    let about = file.metadata().map_err(failed)?;
    match Flock::lock(file, FlockArg::LockExclusiveNonblock) {
        Ok(lock) => Ok(Held::Locked { _lock: lock }),
        Err((_, Errno::EWOULDBLOCK)) => Err(busy(path)),
        Err((_, refused)) => {
            let held = hold_by_name(path, about.dev(), about.ino())?;
            let desc = refused.desc();
            match held {
                Held::Not => tracing::warn!(
                    "the file system of {} refuses locks ({desc}): take care that no other rondo works on this run",
                    path.display()
                ),
                _ => tracing::warn!(
                    "the file system of {} refuses locks ({desc}): take care that no other host works on this run",
                    path.display()
                ),
            }
            Ok(held)
        }
    }
}

/// The name is that of an abstract socket, which is in no file system. It is made of the file's device and number,
/// so that every path to the run comes to the same name.
fn hold_by_name(path: &Path, device: u64, number: u64) -> Result<Held, Failure> {
    let name = SocketAddr::from_abstract_name(format!("rondo/{device:x}/{number:x}"));
    match name.and_then(|name| UnixListener::bind_addr(&name)) {
        Ok(name) => Ok(Held::Named { _name: name }),
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => Err(busy(path)),
        Err(_) => Ok(Held::Not),
    }
}

fn busy(path: &Path) -> Failure {
    let text = format!("another `rondo` process is running {}", path.display());
    Failure::new(exit::AGAIN, format!("{text}\nhint: wait until it ends, or stop it"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_held_once_by_its_lock_or_by_its_name() {
        let run = tempfile::tempdir().expect("a folder");
        std::fs::write(run.path().join("config.toml"), "").expect("written");
        let about = std::fs::metadata(run.path().join("config.toml")).expect("it is there");
        for hold in [&|path: &Path| hold(path), &|path: &Path| {
            hold_by_name(path, about.dev(), about.ino()) as Result<Held, Failure>
        }] as [&dyn Fn(&Path) -> Result<Held, Failure>; 2]
        {
            let held = hold(run.path()).expect("nobody holds it");
            let failure = hold(run.path()).expect_err("it is held");
            assert_eq!(failure.code, exit::AGAIN, "{failure}");
            assert!(failure.message.starts_with("another `rondo` process is running "), "{failure}");
            drop(held);
            hold(run.path()).expect("it is free again");
        }
    }
}
