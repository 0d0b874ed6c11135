//! Recorded traces, found and unpacked.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use envs::replay::{replay, ReplayError, Report};
use flate2::read::GzDecoder;

/// The folder of the excerpts that are part of the sources.
pub fn excerpts() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data")
}

/// The unpacked text of a trace.
pub fn text(path: &Path) -> String {
    let unpack = || {
        let mut text = String::new();
        GzDecoder::new(File::open(path)?).read_to_string(&mut text).map(|_| text)
    };
    unpack().unwrap_or_else(|error: std::io::Error| panic!("cannot read {}: {error}", path.display()))
}

pub fn replay_text(text: &str) -> Result<Report, ReplayError> {
    replay(text.as_bytes(), "trace")
}

/// The foraging traces of a folder, by name.
pub fn foraging(folder: &Path) -> Vec<PathBuf> {
    of_family(folder, "lbf-")
}

/// The warehouse traces of a folder, by name.
pub fn warehouse(folder: &Path) -> Vec<PathBuf> {
    of_family(folder, "rware-")
}

/// The battles of a folder, by name.
pub fn battles(folder: &Path) -> Vec<PathBuf> {
    of_family(folder, "smaclite-")
}

fn of_family(folder: &Path, prefix: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder)
        .unwrap_or_else(|error| panic!("cannot read the folder {}: {error}", folder.display()));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    paths.retain(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(prefix) && name.ends_with(".jsonl.gz")
    });
    paths.sort();
    paths
}
