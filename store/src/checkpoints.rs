//! A role's checkpoints: one folder per saved round. Incomplete ones do not count.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::files::{self, WRITING};
use crate::metrics::Position;
use crate::weights::{self, Tensor};
use crate::Error;

/// How many saved rounds a role keeps. If the newest is damaged, or other roles do not have it yet, the run resumes
/// from the one before.
pub const KEEP: usize = 2;

/// Increased whenever the format changes so that older programs cannot read it.
const FORMAT_VERSION: u32 = 1;

const WEIGHTS: &str = "weights.safetensors";
const STATE: &str = "state.bin";
const MANIFEST: &str = "manifest.json";

/// Prefix of the names of folders that are being removed.
const REMOVING: &str = ".removing-";

/// Everything a role needs to resume after a round.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    pub round: u64,
    /// Everything that is not a tensor, in the role's own format: counters, settings, the position in its metrics.
    pub state: Vec<u8>,
    /// Loaded in the order of their names.
    pub tensors: Vec<Tensor>,
}

/// The checkpoints of one role. Reading (`rounds`, `load`) changes nothing on disk. The next call that writes
/// removes what a killed save left.
#[derive(Debug, Clone)]
pub struct Checkpoints {
    path: PathBuf,
}

/// Describes the other files and is written last. A checkpoint without it is invalid.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    format_version: u32,
    round: u64,
    files: BTreeMap<String, FileRecord>,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileRecord {
    bytes: u64,
    /// In lower-case hexadecimal digits.
    blake3: String,
}

/// The part of a role's state that any reader may understand.
#[derive(Deserialize)]
struct Rows {
    metrics: Position,
}

impl Manifest {
    fn of(round: u64, weights: &[u8], state: &[u8]) -> Self {
        let record = |bytes: &[u8]| FileRecord {
            bytes: bytes.len() as u64,
            blake3: blake3::hash(bytes).to_hex().to_string(),
        };
        let files = [(WEIGHTS.to_owned(), record(weights)), (STATE.to_owned(), record(state))].into();
        Self { format_version: FORMAT_VERSION, round, files }
    }
}

impl Checkpoints {
    pub(crate) fn new(path: PathBuf) -> Self {
        Self { path }
    }

    /// Saves a round. When this returns, the checkpoint survives a power cut. If the process dies before that, the
    /// earlier ones are unchanged. Of the rounds up to this one, the newest [`KEEP`] complete ones stay. An existing
    /// checkpoint of the same round is replaced.
    ///
    /// # Errors
    /// [`Error::Tensors`] for tensors that cannot be stored, or I/O errors.
    pub fn save(&self, checkpoint: &Checkpoint) -> Result<(), Error> {
        let round = checkpoint.round;
        let weights =
            weights::encode(&checkpoint.tensors).map_err(|problem| Error::Tensors { round, problem })?;
        let manifest = Manifest::of(round, &weights, &checkpoint.state);
        files::ensure_folder(&self.path)?;
        self.remove_leftovers()?;
        // A repeated round gives the same bits: the existing checkpoint stays untouched.
        if !self.read(round).is_ok_and(|there| there.manifest == manifest) {
            let unfinished = self.path.join(format!("{WRITING}{}", folder_name(round)));
            if let Err(error) = write_all(&unfinished, &weights, &checkpoint.state, &manifest) {
                // Frees the space on a full disk. If this fails, the next save tries again.
                if let Err(error) = fs::remove_dir_all(&unfinished) {
                    tracing::warn!(path = %unfinished.display(), %error, "cannot remove an unfinished checkpoint");
                }
                return Err(error);
            }
            // A different checkpoint of this round, or a damaged one, is removed first.
            self.remove(round)?;
            let path = self.folder(round);
            fs::rename(&unfinished, &path).map_err(Error::io("rename a finished checkpoint to", &path))?;
            files::sync_folder(&self.path)?;
        }
        self.prune(round)?;
        self.remove_leftovers()
    }

    /// Whether any round has a folder, damaged or not.
    pub(crate) fn exist(&self) -> Result<bool, Error> {
        Ok(!self.listed()?.is_empty())
    }

    /// The rounds that can be loaded, ascending. Every digest is checked; a damaged checkpoint is
    /// logged as a warning and skipped.
    pub fn rounds(&self) -> Result<Vec<u64>, Error> {
        let mut rounds = self.listed()?;
        rounds.retain(|&round| match self.read(round) {
            Ok(_) => true,
            Err(error) => {
                tracing::warn!(round, %error, "skipped a damaged checkpoint");
                false
            }
        });
        Ok(rounds)
    }

    /// Loads a round after checking every digest.
    ///
    /// # Errors
    /// [`Error::NoSuchRound`] or [`Error::DamagedCheckpoint`].
    pub fn load(&self, round: u64) -> Result<Checkpoint, Error> {
        if !self.folder(round).is_dir() {
            return Err(Error::NoSuchRound { path: self.path.clone(), round, held: self.listed()? });
        }
        let Contents { weights, state, .. } = self.read(round)?;
        let tensors = weights::decode(&weights).map_err(|problem| self.damaged(round, problem))?;
        Ok(Checkpoint { round, state, tensors })
    }

    /// How far the latest checkpoint that says so counts on the metric rows. The digests are not checked.
    pub(crate) fn counts_on(&self) -> Result<Option<Position>, Error> {
        let says = |round: u64| {
            let state = fs::read(self.folder(round).join(STATE)).ok()?;
            serde_json::from_slice::<Rows>(&state).ok().map(|rows| rows.metrics)
        };
        Ok(self.listed()?.into_iter().rev().find_map(says))
    }

    /// Removes the rounds after `round`, damaged ones too: the run resumes from `round`.
    pub fn discard_after(&self, round: u64) -> Result<(), Error> {
        for later in self.listed()?.into_iter().rev().take_while(|&later| later > round) {
            self.remove(later)?;
        }
        self.remove_leftovers()
    }

    fn folder(&self, round: u64) -> PathBuf {
        self.path.join(folder_name(round))
    }

    /// The rounds that have a folder, complete or not, ascending.
    fn listed(&self) -> Result<Vec<u64>, Error> {
        let names = files::names(&self.path)?;
        let mut rounds: Vec<u64> = names.iter().filter_map(|name| round_of(name)).collect();
        rounds.sort_unstable(); // Names sort like numbers up to 12 digits only.
        Ok(rounds)
    }

    fn damaged(&self, round: u64, problem: String) -> Error {
        Error::DamagedCheckpoint { path: self.folder(round), problem }
    }

    /// Reads the files of a round and compares them with the manifest.
    fn read(&self, round: u64) -> Result<Contents, Error> {
        let manifest = self.manifest(round)?;
        let read = |name: &str| {
            fs::read(self.folder(round).join(name))
                .map_err(|error| self.damaged(round, format!("cannot read {name}: {error}")))
        };
        let (weights, state) = (read(WEIGHTS)?, read(STATE)?);
        let found = Manifest::of(round, &weights, &state);
        for (name, found) in &found.files {
            if manifest.files.get(name) != Some(found) {
                return Err(self.damaged(round, format!("{name} is not the file that {MANIFEST} describes")));
            }
        }
        if manifest != found {
            return Err(self.damaged(round, format!("{MANIFEST} is that of another checkpoint")));
        }
        Ok(Contents { manifest, weights, state })
    }

    fn manifest(&self, round: u64) -> Result<Manifest, Error> {
        let bytes = fs::read(self.folder(round).join(MANIFEST))
            .map_err(|error| self.damaged(round, format!("cannot read {MANIFEST}: {error}")))?;
        let manifest: Manifest = serde_json::from_slice(&bytes)
            .map_err(|error| self.damaged(round, format!("cannot parse {MANIFEST}: {error}")))?;
        if manifest.format_version != FORMAT_VERSION {
            let problem = format!(
                "it has format version {}, this program reads {FORMAT_VERSION}",
                manifest.format_version
            );
            return Err(self.damaged(round, problem));
        }
        Ok(manifest)
    }

    /// Whether the files have the right sizes. Digests would take too long here; loading a round checks them.
    fn looks_whole(&self, round: u64) -> bool {
        let size = |name: &str| fs::metadata(self.folder(round).join(name)).ok().map(|file| file.len());
        self.manifest(round).is_ok_and(|manifest| {
            manifest.files.iter().all(|(name, record)| size(name) == Some(record.bytes))
        })
    }

    /// Removes what is older than the newest [`KEEP`] up to `newest`, which has just been written and is complete.
    /// [`Checkpoints::discard_after`] removes later rounds.
    fn prune(&self, newest: u64) -> Result<(), Error> {
        let mut kept = 1;
        for round in self.listed()?.into_iter().rev().skip_while(|&round| round >= newest) {
            if kept < KEEP && self.looks_whole(round) {
                kept += 1;
            } else {
                self.remove(round)?;
            }
        }
        Ok(())
    }

    /// Removes a round. It is renamed first, so that a folder that is removed in part does not look like a damaged one.
    fn remove(&self, round: u64) -> Result<(), Error> {
        let path = self.folder(round);
        let removing = self.path.join(format!("{REMOVING}{}", folder_name(round)));
        match fs::rename(&path, &removing) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            other => other.map_err(Error::io("rename before removing", &path))?,
        }
        fs::remove_dir_all(&removing).map_err(Error::io("remove", &removing))
    }

    fn remove_leftovers(&self) -> Result<(), Error> {
        let names = files::names(&self.path)?;
        for name in names.iter().filter(|name| name.starts_with(WRITING) || name.starts_with(REMOVING)) {
            let path = self.path.join(name);
            fs::remove_dir_all(&path).map_err(Error::io("remove", &path))?;
        }
        Ok(())
    }
}

struct Contents {
    manifest: Manifest,
    weights: Vec<u8>,
    state: Vec<u8>,
}

fn write_all(folder: &Path, weights: &[u8], state: &[u8], manifest: &Manifest) -> Result<(), Error> {
    fs::create_dir(folder).map_err(Error::io("create the folder", folder))?;
    files::write_new(&folder.join(WEIGHTS), weights)?;
    files::write_new(&folder.join(STATE), state)?;
    let mut text = serde_json::to_string_pretty(manifest).expect("texts and numbers can be written as JSON");
    text.push('\n');
    files::write_new(&folder.join(MANIFEST), text.as_bytes())?;
    files::sync_folder(folder)
}

fn folder_name(round: u64) -> String {
    format!("round-{round:012}")
}

fn round_of(name: &str) -> Option<u64> {
    let round = name.strip_prefix("round-")?.parse().ok()?;
    (folder_name(round) == name).then_some(round)
}

#[cfg(test)]
mod tests;
