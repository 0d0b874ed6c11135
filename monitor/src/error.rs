//! Errors of reading runs and drawing pictures.

use std::path::PathBuf;

/// Every variant names the file, and if useful the line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error("cannot read {path}: {source}", path = .path.display())]
    Read { path: PathBuf, source: std::io::Error },

    #[error("cannot write {path}: {source}", path = .path.display())]
    Write { path: PathBuf, source: std::io::Error },

    #[error(
        "{path} is neither a run (a folder with config.toml), nor a folder of runs, nor a curve file (.json)",
        path = .path.display()
    )]
    NotARun { path: PathBuf },

    /// `config.toml` cannot be parsed, or lacks a key that a label needs.
    #[error("{path}: {problem}", path = .path.display())]
    Config { path: PathBuf, problem: String },

    /// Rows that cannot be used; the others are used. `place` is the first one's line or, in a curve file, its entry
    /// (`rows[3]`).
    #[error("{count} rows of {path}, the first at {place}: {problem}", path = .path.display())]
    Rows { path: PathBuf, count: usize, place: String, problem: String },

    #[error("{path} is not a curve file: {problem}", path = .path.display())]
    CurveFile { path: PathBuf, problem: String },

    /// The file is valid, but no row has a number of this name.
    #[error("no row of {path} has a number named `{metric}`; {found}", path = .path.display())]
    NoRows { path: PathBuf, metric: String, found: String },

    /// The same seed twice is one sample, and would make the standard error too small.
    #[error(
        "{second} is seed {seed} of `{label}` once more; {first} is the one that counts",
        first = .first.display(), second = .second.display()
    )]
    RepeatedSeed { label: String, seed: u64, first: PathBuf, second: PathBuf },

    #[error("unknown picture format in {path}; end the name in .svg or .png", path = .path.display())]
    Extension { path: PathBuf },

    #[error("nothing to draw: {0}")]
    Empty(String),

    #[error("cannot turn the drawing into {path}: {problem}", path = .path.display())]
    Raster { path: PathBuf, problem: String },

    /// A scene without area, or more pixels than a picture may have.
    #[error("cannot draw the world: {0}")]
    Scene(String),

    #[error("cannot draw on the terminal: {0}")]
    Terminal(std::io::Error),
}
