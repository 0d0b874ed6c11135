//! Where the processes of a run reach each other: Unix sockets in a folder, or ports of 127.0.0.1.

use std::ffi::OsStr;
use std::fs::Permissions;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use process::Failure;
use proto::exit;
use tempfile::TempDir;

use crate::roles::Transport;

/// Any free port of this host.
const ANY_PORT: &str = "tcp/127.0.0.1:0";

/// The endpoints to listen on. The folder of sockets that is not in the run folder goes with this value.
pub struct Meeting {
    pub monitor: String,
    pub world: String,
    pub coordinator: String,
    _short: Option<TempDir>,
}

impl Meeting {
    /// Sockets in the run folder, or in a folder for temporary files where the run folder cannot hold any (its path
    /// is too long for a socket or not UTF-8, its file system has no sockets or no locks). Ports only if they are
    /// asked for, or where nothing is and no folder holds sockets: other users of this host can dial them.
    ///
    /// # Errors
    /// If there is no such place: each that was tried, and why it is none.
    pub fn at(run: &Path, transport: Option<Transport>) -> Result<Self, Failure> {
        let mut tried = Vec::new();
        if transport != Some(Transport::Tcp) {
            if let Some(meeting) = Self::with_sockets(run, &mut tried) {
                return Ok(meeting);
            }
        }
        let unavailable = |what: &str, hint: &str| {
            let text = format!("the processes of the run cannot reach each other: {what}\nhint: {hint}");
            Failure::new(exit::IO, text)
        };
        let no_sockets = format!("no folder can hold their Unix sockets ({})", tried.join("; "));
        if transport == Some(Transport::Unix) {
            return Err(unavailable(
                &no_sockets,
                "`--transport tcp` needs no folder, it takes ports of 127.0.0.1",
            ));
        }
        if let Err(error) = TcpListener::bind("127.0.0.1:0") {
            let no_port = format!("no port of 127.0.0.1 is to be had: {error}");
            let what = if tried.is_empty() { no_port } else { format!("{no_sockets}, and {no_port}") };
            let hint = "where the system allows ports, `--transport tcp` works; `--in-process` needs neither";
            return Err(unavailable(&what, hint));
        }
        if !tried.is_empty() {
            tracing::warn!(
                "{no_sockets}: the processes of this run use ports of 127.0.0.1, as with `--transport tcp`"
            );
        }
        let port = || ANY_PORT.to_owned();
        Ok(Self { monitor: port(), world: port(), coordinator: port(), _short: None })
    }

    /// The first folder that can hold sockets. Why the others cannot goes to `tried`.
    fn with_sockets(run: &Path, tried: &mut Vec<String>) -> Option<Self> {
        let own = run.join("bus");
        let own = std::path::absolute(&own).unwrap_or(own);
        let usable = std::fs::create_dir_all(&own)
            .map_err(|error| error.to_string())
            .and_then(|()| Self::in_folder(&own));
        match usable {
            Ok(meeting) => return Some(meeting),
            Err(reason) => tried.push(format!("{}: {reason}", own.display())),
        }
        // Only if it is empty: it serves for nothing then.
        let _ = std::fs::remove_dir(&own);
        let xdg = std::env::var_os("XDG_RUNTIME_DIR");
        for place in places(xdg.as_deref(), std::env::temp_dir()) {
            let usable = tempfile::Builder::new()
                .prefix("rondo-")
                // As the run folder: closed to other users.
                .permissions(Permissions::from_mode(0o700))
                .tempdir_in(&place)
                .map_err(|error| error.to_string())
                .and_then(|short| {
                    let meeting = Self::in_folder(short.path())?;
                    Ok(Self { _short: Some(short), ..meeting })
                });
            match usable {
                Ok(meeting) => return Some(meeting),
                Err(reason) => tried.push(format!("{}: {reason}", place.display())),
            }
        }
        None
    }

    fn in_folder(folder: &Path) -> Result<Self, String> {
        let endpoint = |name| bus::unix_endpoint(folder, name);
        Ok(Self {
            monitor: endpoint("monitor.sock")?,
            world: endpoint("world.sock")?,
            coordinator: endpoint("coordinator.sock")?,
            _short: None,
        })
    }
}

/// Folders for files that live as long as a program, each once.
fn places(xdg_runtime_dir: Option<&OsStr>, temporary: PathBuf) -> Vec<PathBuf> {
    let mut places: Vec<PathBuf> = Vec::new();
    for place in xdg_runtime_dir.map(PathBuf::from).into_iter().chain([temporary, "/tmp".into()]) {
        if place.is_absolute() && !places.contains(&place) {
            places.push(place);
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_folder_for_temporary_files_is_tried_once() {
        let paths = |places: Vec<PathBuf>| -> Vec<String> {
            places.iter().map(|place| place.display().to_string()).collect()
        };
        let xdg = |path: &'static str| Some(OsStr::new(path));
        assert_eq!(paths(places(xdg("/run/user/7"), "/scratch".into())), ["/run/user/7", "/scratch", "/tmp"]);
        assert_eq!(paths(places(None, "/tmp".into())), ["/tmp"]);
        assert_eq!(paths(places(xdg(""), "relative".into())), ["/tmp"]);
    }
}
