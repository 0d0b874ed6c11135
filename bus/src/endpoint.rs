//! Endpoints: their syntax, and checks of an endpoint before or after zenoh uses it.

use std::fs::{remove_file, File};
use std::io;
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::Duration;

use nix::fcntl::{Flock, FlockArg};

use crate::Error;

/// The longest path of a Unix socket: `sun_path` has 108 bytes, one of them for the closing zero.
const MAX_PATH_BYTES: usize = 107;

/// Long enough for a connection to any host that is up. Only used to name the unreachable endpoint in an error.
const PROBE_TIMEOUT: Duration = Duration::from_millis(250);

/// The endpoint of a Unix socket called `name` in a folder, if the bus can listen there. A socket and a lock, which
/// zenoh puts beside each socket, are tried: many network, foreign and user-space file systems refuse one of them.
///
/// # Errors
/// Why not, in words about the folder.
pub fn unix_endpoint(folder: &Path, name: &str) -> Result<String, String> {
    let path = folder.join(name);
    let text = path.to_str().ok_or("its path is not UTF-8")?;
    let endpoint = Endpoint::parse(&format!("unixsock-stream/{text}")).map_err(|error| match error {
        Error::Endpoint { reason, .. } => reason,
        other => other.to_string(),
    })?;
    try_socket(folder).map_err(|error| error.to_string())?;
    Ok(endpoint.to_string())
}

/// Listens, dials and locks as zenoh does, under a name that nobody else uses.
fn try_socket(folder: &Path) -> io::Result<()> {
    let socket = folder.join(format!(".{}", std::process::id()));
    let lock = folder.join(format!(".{}.lock", std::process::id()));
    let attempt = || {
        // A process with this number may have been killed here.
        let _ = remove_file(&socket);
        let listener = UnixListener::bind(&socket)?;
        UnixStream::connect(&socket)?;
        drop(listener);
        File::create(&lock)?;
        // For reading only, as zenoh does it: NFS refuses that.
        let lock = File::open(&lock)?;
        Flock::lock(lock, FlockArg::LockExclusiveNonblock).map_err(|(_, error)| error)?;
        Ok(())
    };
    let result = attempt();
    // What could not be made cannot be removed.
    let _ = (remove_file(&socket), remove_file(&lock));
    result
}

/// A place to listen on or to dial.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Endpoint {
    /// `unixsock-stream/PATH`
    Unix(PathBuf),
    /// `tcp/HOST:PORT`; the host may be a name, an IPv4 address or an IPv6 address in brackets.
    Tcp { host: String, port: u16 },
}

impl Endpoint {
    pub(crate) fn parse(text: &str) -> Result<Self, Error> {
        let fail = |reason: String| Error::Endpoint { endpoint: text.into(), reason };
        // `?` and `#` have a meaning in zenoh's endpoints, and a line break is never intended.
        if let Some(c) = text.chars().find(|&c| c == '?' || c == '#' || c.is_control()) {
            return Err(fail(format!("{c:?} is not allowed")));
        }
        match text.split_once('/') {
            Some(("unixsock-stream", "")) => Err(fail("the path is missing".into())),
            Some(("unixsock-stream", path)) if path.len() > MAX_PATH_BYTES => Err(fail(format!(
                "the path has {} bytes and a Unix socket allows {MAX_PATH_BYTES}, take a shorter folder",
                path.len()
            ))),
            Some(("unixsock-stream", path)) => Ok(Self::Unix(path.into())),
            Some(("tcp", address)) => {
                let (host, port) =
                    address.rsplit_once(':').ok_or_else(|| fail("the port is missing".into()))?;
                if host.is_empty() {
                    return Err(fail("the host is missing".into()));
                }
                let port = port.parse().map_err(|_| fail(format!("`{port}` is not a port")))?;
                Ok(Self::Tcp { host: host.into(), port })
            }
            Some((protocol, _)) => Err(fail(format!("`{protocol}` is not a protocol of this bus"))),
            None => Err(fail("the protocol is missing".into())),
        }
    }

    /// Rejects an endpoint that is in use or cannot be bound, with the operating system's reason, and replaces port 0
    /// by a free port.
    ///
    /// zenoh distinguishes these cases only by the text of its errors, and does not report its port. Another process
    /// can take the port between this check and zenoh's own bind; zenoh then reports that.
    pub(crate) fn ready_to_listen(&self) -> Result<Self, Error> {
        match self {
            Self::Unix(path) => {
                if UnixStream::connect(path).is_ok() {
                    return Err(self.in_use());
                }
                let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
                match folder.map(std::fs::metadata) {
                    Some(Err(error)) => Err(self.cannot_listen(&error.to_string())),
                    _ => Ok(self.clone()),
                }
            }
            Self::Tcp { host, .. } => match TcpListener::bind(self.address()).and_then(|l| l.local_addr()) {
                Ok(bound) => Ok(Self::Tcp { host: host.clone(), port: bound.port() }),
                Err(error) if error.kind() == io::ErrorKind::AddrInUse => Err(self.in_use()),
                Err(error) => Err(self.cannot_listen(&error.to_string())),
            },
        }
    }

    /// The error for an endpoint that another process uses.
    pub(crate) fn in_use(&self) -> Error {
        let hint = match self {
            Self::Unix(_) => "another process of this run is alive; stop it, or choose another run folder",
            Self::Tcp { .. } => {
                "stop the process that listens there, choose another port, or port 0 for a free one"
            }
        };
        Error::InUse { endpoint: self.to_string(), hint }
    }

    /// Whether a process accepts connections here.
    pub(crate) fn answers(&self) -> bool {
        match self {
            Self::Unix(path) => UnixStream::connect(path).is_ok(),
            Self::Tcp { .. } => {
                let Ok(mut addresses) = self.address().to_socket_addrs() else { return false };
                addresses.any(|address| TcpStream::connect_timeout(&address, PROBE_TIMEOUT).is_ok())
            }
        }
    }

    fn address(&self) -> String {
        match self {
            // It was parsed from text.
            Self::Unix(path) => path.to_string_lossy().into_owned(),
            Self::Tcp { host, port } => format!("{host}:{port}"),
        }
    }

    /// The operating system refuses it.
    pub(crate) fn cannot_listen(&self, reason: &str) -> Error {
        let hint = match self {
            _ if reason.contains("Too many open files") => "raise the limit on open files (`ulimit -n`)",
            Self::Unix(_) => {
                "take another folder: a Unix socket needs one that exists and whose file system has sockets and \
                 locks; or `tcp/127.0.0.1:0`, to which `rondo train` changes with `--transport tcp`"
            }
            Self::Tcp { .. } => "listen on an address of this host",
        };
        Error::Listen { endpoint: self.to_string(), reason: reason.to_owned(), hint }
    }
}

impl std::fmt::Display for Endpoint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let protocol = match self {
            Self::Unix(_) => "unixsock-stream",
            Self::Tcp { .. } => "tcp",
        };
        write!(f, "{protocol}/{}", self.address())
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::ffi::OsStrExt;

    use super::*;

    #[test]
    fn endpoints_read_back_as_written() {
        for text in [
            "unixsock-stream//run/dir/bus.sock",
            "unixsock-stream/bus.sock",
            "tcp/10.0.0.5:7447",
            "tcp/[::1]:0",
        ] {
            assert_eq!(Endpoint::parse(text).unwrap().to_string(), text);
        }
    }

    #[test]
    fn what_is_no_endpoint_is_refused_with_the_reason() {
        let long = format!("unixsock-stream/{}", "x".repeat(108));
        for (text, reason) in [
            ("", "the protocol is missing"),
            ("localhost:7447", "the protocol is missing"),
            ("udp/1.2.3.4:7447", "`udp` is not a protocol of this bus"),
            ("tcp/1.2.3.4", "the port is missing"),
            ("tcp/:7447", "the host is missing"),
            ("tcp/1.2.3.4:77777", "`77777` is not a port"),
            ("unixsock-stream/", "the path is missing"),
            ("tcp/1.2.3.4:7447#iface=lo", "'#' is not allowed"),
            (&long, "the path has 108 bytes and a Unix socket allows 107, take a shorter folder"),
        ] {
            let error = Endpoint::parse(text).unwrap_err();
            assert_eq!(error, Error::Endpoint { endpoint: text.into(), reason: reason.into() });
        }
        assert!(Endpoint::parse(&long[..long.len() - 1]).is_ok());
    }

    #[test]
    fn a_folder_that_cannot_hold_a_socket_is_refused_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let inside = |name: &[u8]| {
            let path = folder.path().join(std::ffi::OsStr::from_bytes(name));
            std::fs::create_dir(&path).unwrap();
            unix_endpoint(&path, "a.sock")
        };
        assert_eq!(inside(b"caf\xe9"), Err("its path is not UTF-8".to_owned()));
        assert_eq!(inside(b"a#b"), Err("'#' is not allowed".to_owned()));
        assert!(inside(&[b'x'; 100]).unwrap_err().contains("a Unix socket allows 107"));
        let missing = unix_endpoint(&folder.path().join("missing"), "a.sock");
        assert_eq!(missing, Err("No such file or directory (os error 2)".to_owned()));
        let found = unix_endpoint(folder.path(), "a.sock").unwrap();
        assert_eq!(Endpoint::parse(&found).unwrap(), Endpoint::Unix(folder.path().join("a.sock")));
        assert!(std::fs::read_dir(folder.path()).unwrap().all(|entry| entry.unwrap().path().is_dir()));
    }
}
