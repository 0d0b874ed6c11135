//! Errors of a run folder, written for the person who must act.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Every failure of this crate. [`Error::is_config`], [`Error::is_io`] and [`Error::is_unfinished`] group them by exit
/// code. An error in none of the three groups is a bug of the calling program.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error("could not {doing} `{}`: {cause}{}", path.display(), hint(cause))]
    Io { doing: &'static str, path: PathBuf, cause: io::Error },

    #[error(
        "no space left: could not {doing} `{}`: {cause}\n\
         hint: free disk space, then run `rondo resume`; the last checkpoint is intact",
        path.display()
    )]
    Full { doing: &'static str, path: PathBuf, cause: io::Error },

    #[error(
        "`{0}` exists and is not empty, a new run needs a new folder\n\
         hint: continue that run with `rondo resume {0}`, or choose another folder with --out",
        path.display()
    )]
    Exists { path: PathBuf },

    #[error(
        "`{}` is not a run folder: there is no config.toml in it\n\
         hint: name the folder that was given to --out when the run was started",
        path.display()
    )]
    NotARun { path: PathBuf },

    #[error(
        "`{}` belongs to a run with another configuration; line {line} is the first that differs\n  \
         there: {}\n  here:  {}\n\
         hint: start this role with the run's own config.toml, or choose another folder with --out",
        path.display(), quoted(theirs), quoted(ours)
    )]
    OtherConfig {
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// The line in the folder's config.toml; `None` after its end.
        theirs: Option<String>,
        /// The line in the given configuration; `None` after its end.
        ours: Option<String>,
    },

    #[error(
        "`{}` ends after {found} bytes, but the checkpoint expects {expected}\n\
         hint: the file was cut or replaced; copy it back, or start the run again in a new folder",
        path.display()
    )]
    ShortMetrics { path: PathBuf, expected: u64, found: u64 },

    #[error(
        "`{}` does not match the checkpoint: {problem}\n\
         hint: the file was changed or replaced; copy it back, or start the run again in a new folder",
        path.display()
    )]
    DamagedMetrics { path: PathBuf, problem: String },

    #[error(
        "`{}` lacks episodes that the learner needs: {problem}\n\
         hint: files were changed or lost; copy them back, or start the run again in a new folder",
        path.display()
    )]
    DamagedEpisodes { path: PathBuf, problem: String },

    #[error("there is no record {number} in `{}`, only those from {} up to {}, exclusive", path.display(), held.start, held.end)]
    NoSuchEpisode { path: PathBuf, number: u64, held: Range<u64> },

    #[error(
        "the checkpoint `{}` is damaged: {problem}\n\
         hint: start from an earlier round; this folder can be removed",
        path.display()
    )]
    DamagedCheckpoint { path: PathBuf, problem: String },

    #[error("there is no checkpoint of round {round} in `{}`, only of {held:?}", path.display())]
    NoSuchRound { path: PathBuf, round: u64, held: Vec<u64> },

    #[error(
        "`{}` has no complete checkpoint\n\
         hint: continue the run with `rondo resume` until its next save, or copy here what this role has saved on \
         another host",
        path.display()
    )]
    NoCheckpoint { path: PathBuf },

    #[error(
        "the agents' latest checkpoints are of different rounds: {first} has {first_round}, {other} has {other_round}\n\
         hint: the run has not ended; continue it with `rondo resume`"
    )]
    RoundsDiffer { first: String, first_round: u64, other: String, other_round: u64 },

    #[error(
        "`{}` has no folder of {}\n\
         hint: a role that ran on another host keeps its folder there, copy it here; a run without a checkpoint \
         continues with `rondo resume`",
        path.display(), roles.join(", ")
    )]
    MissingRoles { path: PathBuf, roles: Vec<String> },

    #[error(
        "there is no `{}`\n\
         hint: a role writes that file from its start, and the digest includes its rows; copy it here",
        path.display()
    )]
    NoMetrics { path: PathBuf },

    #[error(
        "`{}` has {found} whole rows, the latest checkpoint counts on {expected}\n\
         hint: the file was cut or copied in part, copy it again",
        path.display()
    )]
    MissingRows { path: PathBuf, expected: u64, found: u64 },

    #[error("`{name}` is not a role: expected `world`, `coordinator` or `agent-<number>`")]
    RoleName { name: String },

    #[error("the metric row of t_env {t_env} names `{name}` twice")]
    MetricTwice { t_env: u64, name: String },

    #[error("cannot save round {round}: {problem}")]
    Tensors { round: u64, problem: String },
}

impl Error {
    /// The request does not fit what the folder holds: exit code 78.
    pub fn is_config(&self) -> bool {
        matches!(self, Self::Exists { .. } | Self::NotARun { .. } | Self::OtherConfig { .. })
    }

    /// The disk failed or is full, or a file is damaged: exit code 74.
    pub fn is_io(&self) -> bool {
        matches!(
            self,
            Self::Io { .. }
                | Self::Full { .. }
                | Self::ShortMetrics { .. }
                | Self::DamagedMetrics { .. }
                | Self::DamagedEpisodes { .. }
                | Self::DamagedCheckpoint { .. }
                | Self::NoSuchRound { .. }
        )
    }

    /// The run is not far enough, or parts of it are missing: exit code 75.
    pub fn is_unfinished(&self) -> bool {
        matches!(
            self,
            Self::NoCheckpoint { .. }
                | Self::RoundsDiffer { .. }
                | Self::MissingRoles { .. }
                | Self::NoMetrics { .. }
                | Self::MissingRows { .. }
        )
    }

    /// For `map_err`: names the failed operation and its path.
    pub(crate) fn io(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Error {
        let path = path.to_owned();
        move |cause| match cause.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Self::Full { doing, path, cause },
            _ => Self::Io { doing, path, cause },
        }
    }
}

/// What to do about a path that the system refuses; nothing where the reason says it.
fn hint(cause: &io::Error) -> &'static str {
    const ENFILE: i32 = 23;
    const EMFILE: i32 = 24;
    const ELOOP: i32 = 40;
    match (cause.kind(), cause.raw_os_error()) {
        (io::ErrorKind::PermissionDenied, _) => {
            "\nhint: give this user the right to it, or choose another folder with --out"
        }
        (io::ErrorKind::ReadOnlyFilesystem, _) => {
            "\nhint: choose another folder with --out, or copy the run to where it can be written"
        }
        (io::ErrorKind::NotADirectory, _) => {
            "\nhint: a part of this path is a file; choose another folder with --out"
        }
        (io::ErrorKind::AlreadyExists, _) => {
            "\nhint: a file or a link to nothing has this name; choose another folder with --out"
        }
        (io::ErrorKind::InvalidFilename, _) => "\nhint: choose a shorter name with --out",
        (_, Some(ELOOP)) => "\nhint: links lead in a circle here; choose another folder with --out",
        (_, Some(ENFILE | EMFILE)) => "\nhint: raise the limit on open files (`ulimit -n`)",
        _ => "",
    }
}

/// Escaped, because the difference may be invisible, such as a line ending.
fn quoted(line: &Option<String>) -> String {
    line.as_ref().map_or_else(|| "(end of the file)".to_owned(), |line| format!("{line:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_has_its_own_message() {
        const ENOSPC: i32 = 28;
        let error = Error::io("write", Path::new("runs/a/result.json"))(io::Error::from_raw_os_error(ENOSPC));
        assert_eq!(
            error.to_string(),
            "no space left: could not write `runs/a/result.json`: No space left on device (os error 28)\n\
             hint: free disk space, then run `rondo resume`; the last checkpoint is intact"
        );
        assert!(error.is_io() && !error.is_config());
    }

    #[test]
    fn what_the_system_refuses_comes_with_what_to_do() {
        for (errno, part) in [
            (1, "give this user the right to it"),
            (17, "a file or a link to nothing has this name"),
            (20, "a part of this path is a file"),
            (23, "`ulimit -n`"),
            (24, "`ulimit -n`"),
            (30, "copy the run to where it can be written"),
            (36, "choose a shorter name"),
            (40, "links lead in a circle"),
            (122, "free disk space, then run `rondo resume`"),
        ] {
            let error =
                Error::io("create the folder", Path::new("runs/a"))(io::Error::from_raw_os_error(errno));
            let text = error.to_string();
            assert!(error.is_io() && text.contains("`runs/a`") && text.contains(part), "{errno}: {text}");
        }
    }

    #[test]
    fn other_failures_say_what_was_done_to_which_path() {
        const EACCES: i32 = 13;
        let error = Error::io("list", Path::new("runs/a"))(io::Error::from_raw_os_error(EACCES));
        assert_eq!(
            error.to_string(),
            "could not list `runs/a`: Permission denied (os error 13)\n\
             hint: give this user the right to it, or choose another folder with --out"
        );
        assert!(error.is_io() && !error.is_config() && !error.is_unfinished());
    }
}
