//! Files and folders that are either complete or absent, also after a power cut.

use std::fs::{self, File, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use tempfile::NamedTempFile;

use crate::Error;

/// Prefix of the names of unfinished files and folders. Readers ignore them.
pub(crate) const WRITING: &str = ".writing-";

/// Creates the folder and its parents if it is missing.
pub(crate) fn ensure_folder(path: &Path) -> Result<(), Error> {
    if path.is_dir() {
        return Ok(());
    }
    fs::create_dir_all(path).map_err(Error::io("create the folder", path))?;
    sync_folder(parent(path))
}

/// The names in a folder, sorted; none if the folder is missing. Names that are not UTF-8 are not ours and are
/// skipped.
pub(crate) fn names(path: &Path) -> Result<Vec<String>, Error> {
    let failed = || Error::io("list", path);
    let entries = match fs::read_dir(path) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(failed()(error)),
    };
    let mut names = Vec::new();
    for entry in entries {
        names.extend(entry.map_err(failed())?.file_name().into_string());
    }
    names.sort();
    Ok(names)
}

/// Writes and flushes a file that must not exist yet. Its name is durable only after [`sync_folder`].
pub(crate) fn write_new(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let mut file = File::create_new(path).map_err(Error::io("create", path))?;
    file.write_all(bytes).map_err(Error::io("write", path))?;
    file.sync_all().map_err(Error::io("flush", path))
}

/// Replaces a file in one step: a reader sees the old one or the new one. The returned file is open for writing after
/// `bytes`.
pub(crate) fn replace(path: &Path, bytes: &[u8]) -> Result<File, Error> {
    let file = unfinished(path, bytes)?
        .persist(path)
        .map_err(|error| Error::io("rename a temporary file to", path)(error.error))?;
    sync_folder(parent(path))?;
    Ok(file)
}

/// Like [`replace`], but returns `false` without a change if the file already exists. Any number of processes may try
/// at once.
pub(crate) fn place(path: &Path, bytes: &[u8]) -> Result<bool, Error> {
    let placed = match unfinished(path, bytes)?.persist_noclobber(path) {
        Ok(_) => Ok(()),
        Err(error) if error.error.kind() == io::ErrorKind::AlreadyExists => return Ok(false),
        // There is neither a rename that replaces nothing nor a second name for a file.
        Err(_) => write_new(path, bytes).inspect_err(|error| {
            // A part of it would be worse than nothing; another process's file stays.
            if !matches!(error, Error::Io { cause, .. } if cause.kind() == io::ErrorKind::AlreadyExists) {
                let _ = fs::remove_file(path);
            }
        }),
    };
    match placed {
        Ok(()) => sync_folder(parent(path)).map(|()| true),
        Err(Error::Io { cause, .. }) if cause.kind() == io::ErrorKind::AlreadyExists => Ok(false),
        Err(error) => Err(error),
    }
}

/// Makes renamed, created and removed names durable, as far as the file system lets us: some flush no folders, and
/// one that may be written to but not be read cannot be opened for it.
pub(crate) fn sync_folder(path: &Path) -> Result<(), Error> {
    match File::open(path).and_then(|folder| folder.sync_all()) {
        Err(error) if !is_refusal(&error) => Err(Error::io("flush the folder", path)(error)),
        _ => Ok(()),
    }
}

/// Whether a call failed because it is not for this kind of file or file system, or not for this user. That the
/// file cannot be written or that the disk fails is something else.
pub(crate) fn is_refusal(error: &io::Error) -> bool {
    const EBADF: i32 = 9;
    let kind = error.kind();
    // ENOSYS, EOPNOTSUPP and ENOTSUP are `Unsupported`, EACCES and EPERM `PermissionDenied`, EINVAL is `InvalidInput`.
    matches!(kind, io::ErrorKind::Unsupported | io::ErrorKind::PermissionDenied | io::ErrorKind::InvalidInput)
        || error.raw_os_error() == Some(EBADF)
}

/// A flushed temporary file beside `path`, under a random name: roles on different hosts may
/// share a folder and a process number.
fn unfinished(path: &Path, bytes: &[u8]) -> Result<NamedTempFile, Error> {
    let mut file = tempfile::Builder::new()
        .prefix(WRITING)
        // The run folder restricts access. The default mode of a temporary file would allow the owner only.
        .permissions(Permissions::from_mode(0o644))
        .tempfile_in(parent(path))
        .map_err(Error::io("create a temporary file for", path))?;
    // On the file itself: the wrapper's errors name the temporary path a second time.
    file.as_file_mut().write_all(bytes).map_err(Error::io("write", path))?;
    file.as_file().sync_all().map_err(Error::io("flush", path))?;
    Ok(file)
}

fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}
