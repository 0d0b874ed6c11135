//! Files and folders that are either whole or not there, also after a power cut.

use std::fs::{self, File, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use tempfile::NamedTempFile;

use crate::Error;

/// How the names of unfinished files and folders start. Readers ignore them.
pub(crate) const WRITING: &str = ".writing-";

/// Creates the folder and its parents unless it is there.
pub(crate) fn ensure_folder(path: &Path) -> Result<(), Error> {
    if path.is_dir() {
        return Ok(());
    }
    fs::create_dir_all(path).map_err(Error::io("create the folder", path))?;
    sync_folder(parent(path))
}

/// The names in a folder, sorted; none where the folder is missing. Names that are not UTF-8 are
/// not ours and left out.
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

/// Writes a file that must not be there yet, down to the disk. Its name is durable only after
/// [`sync_folder`].
pub(crate) fn write_new(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let mut file = File::create_new(path).map_err(Error::io("create", path))?;
    file.write_all(bytes).map_err(Error::io("write", path))?;
    file.sync_all().map_err(Error::io("flush", path))
}

/// Replaces a file in one step: whoever reads sees the old one or the new one. The file that is
/// returned is open for writing behind `bytes`.
pub(crate) fn replace(path: &Path, bytes: &[u8]) -> Result<File, Error> {
    let file = unfinished(path, bytes)?
        .persist(path)
        .map_err(|error| Error::io("rename a temporary file to", path)(error.error))?;
    sync_folder(parent(path))?;
    Ok(file)
}

/// Like [`replace`], but `false` and no change where the file is already there, however many
/// processes try at once.
pub(crate) fn place(path: &Path, bytes: &[u8]) -> Result<bool, Error> {
    match unfinished(path, bytes)?.persist_noclobber(path) {
        Ok(_) => sync_folder(parent(path)).map(|()| true),
        Err(error) if error.error.kind() == io::ErrorKind::AlreadyExists => Ok(false),
        Err(error) => Err(Error::io("rename a temporary file to", path)(error.error)),
    }
}

/// Makes renamed, created and removed names durable.
pub(crate) fn sync_folder(path: &Path) -> Result<(), Error> {
    File::open(path).and_then(|folder| folder.sync_all()).map_err(Error::io("flush the folder", path))
}

/// A flushed temporary file beside `path`, under a random name: roles on different hosts may
/// share a folder and a process number.
fn unfinished(path: &Path, bytes: &[u8]) -> Result<NamedTempFile, Error> {
    let mut file = tempfile::Builder::new()
        .prefix(WRITING)
        // What keeps others out is the run folder; temporary files would be for the owner alone.
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
