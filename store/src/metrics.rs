//! The rows of `metrics.jsonl`: one flat JSON object a line. Rows are appended during training and truncated to the
//! position of a checkpoint when a run resumes. The bytes do not depend on the time.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use crate::tensorboard::EventFile;
use crate::{files, Error};

/// What learners and the world count beside environment steps.
const COUNTED: [&str; 2] = ["update_calls", "rounds"];

/// What a role reports at one point of a run, such as
/// `{"t_env":362,"update_calls":1,"test_return_mean":0.43}`.
///
/// Scalars are written in the given order, in the shortest form that parses to the same bits; infinities and NaN as
/// `null`.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Environment steps so far.
    pub t_env: u64,
    /// The role's own counter: its name in the file and its value.
    count: (&'static str, u64),
    pub scalars: Vec<(Cow<'static, str>, f64)>,
}

impl Row {
    /// A row of a learner that has made `update_calls`.
    pub fn of_learner(t_env: u64, update_calls: u64) -> Self {
        Self { t_env, count: (COUNTED[0], update_calls), scalars: Vec::new() }
    }

    /// A row of the world after `rounds`.
    pub fn of_world(t_env: u64, rounds: u64) -> Self {
        Self { t_env, count: (COUNTED[1], rounds), scalars: Vec::new() }
    }

    /// Adds one scalar.
    pub fn with(mut self, name: impl Into<Cow<'static, str>>, value: f64) -> Self {
        self.scalars.push((name.into(), value));
        self
    }

    /// The line with its newline.
    fn to_line(&self) -> Result<String, Error> {
        let mut names = vec!["t_env", COUNTED[0], COUNTED[1]];
        for (name, _) in &self.scalars {
            if names.contains(&name.as_ref()) {
                return Err(Error::MetricTwice { t_env: self.t_env, name: name.to_string() });
            }
            names.push(name);
        }
        let mut line = serde_json::to_string(self).expect("texts and numbers can be written as JSON");
        line.push('\n');
        Ok(line)
    }
}

impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(2 + self.scalars.len()))?;
        map.serialize_entry("t_env", &self.t_env)?;
        map.serialize_entry(self.count.0, &self.count.1)?;
        for (name, value) in &self.scalars {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }
}

/// The length of `metrics.jsonl`. A checkpoint stores it, and a role that resumes passes it to
/// [`crate::RoleFolder::metrics`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Position {
    pub bytes: u64,
    pub rows: u64,
}

impl Position {
    /// No row: for a new run.
    pub const START: Self = Self { bytes: 0, rows: 0 };
}

/// Appends rows to `metrics.jsonl` and to the role's TensorBoard file, without a buffer: [`MetricsWriter::append`]
/// writes the row before it returns, or fails.
#[derive(Debug)]
pub struct MetricsWriter {
    path: PathBuf,
    file: File,
    position: Position,
    events: EventFile,
}

impl MetricsWriter {
    pub(crate) fn open(path: &Path, tensorboard: &Path, keep: Position) -> Result<Self, Error> {
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(Error::io("open", path))?;
        let found = file.metadata().map_err(Error::io("ask for the size of", path))?.len();
        if found < keep.bytes {
            return Err(Error::ShortMetrics { path: path.to_owned(), expected: keep.bytes, found });
        }
        let mut kept = Vec::new();
        file.by_ref().take(keep.bytes).read_to_end(&mut kept).map_err(Error::io("read", path))?;
        let rows = parse(&kept, keep.rows)
            .map_err(|problem| Error::DamagedMetrics { path: path.to_owned(), problem })?;
        if found > keep.bytes {
            file.set_len(keep.bytes).map_err(Error::io("cut", path))?;
        }
        let events = EventFile::start(
            tensorboard,
            since_1970(),
            rows.iter()
                .map(|row| (row.t_env, row.scalars.iter().map(|(name, value)| (name.as_str(), *value)))),
        )?;
        Ok(Self { path: path.to_owned(), file, position: keep, events })
    }

    /// Writes one row to `metrics.jsonl` and, as scalars over `t_env`, for TensorBoard.
    ///
    /// # Errors
    /// [`Error::MetricTwice`] if a name is repeated or is that of a fixed column (nothing is written then), or I/O
    /// errors. A row that was written in part is cut off again if the disk allows it.
    pub fn append(&mut self, row: &Row) -> Result<(), Error> {
        let line = row.to_line()?;
        // At a tracked position, so that the next row overwrites one that was written in part.
        if let Err(error) = self.file.write_all_at(line.as_bytes(), self.position.bytes) {
            if let Err(error) = self.file.set_len(self.position.bytes) {
                tracing::warn!(path = %self.path.display(), %error, "cannot cut off a row written in part");
            }
            return Err(Error::io("append a row to", &self.path)(error));
        }
        self.position.bytes += line.len() as u64;
        self.position.rows += 1;
        let scalars = row.scalars.iter().map(|(name, value)| (name.as_ref(), *value));
        self.events.append(since_1970(), row.t_env, scalars)
    }

    /// The present length of the file.
    pub fn position(&self) -> Position {
        self.position
    }

    /// Flushes the rows to the disk and returns the position. A checkpoint stores this and not
    /// [`MetricsWriter::position`]: after a power cut it must not expect rows that are lost.
    pub fn sync(&self) -> Result<Position, Error> {
        self.file.sync_data().map_err(Error::io("flush", &self.path))?;
        if let Some(folder) = self.path.parent() {
            files::sync_folder(folder)?;
        }
        Ok(self.position)
    }
}

/// The bytes of a `metrics.jsonl` up to the last newline; none if the file is missing.
pub(crate) fn complete_lines(path: &Path) -> Result<Vec<u8>, Error> {
    let mut bytes = match fs::read(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
        other => other.map_err(Error::io("read", path))?,
    };
    let end = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |newline| newline + 1);
    bytes.truncate(end);
    Ok(bytes)
}

/// A row read back. The order of its scalars is lost; TensorBoard does not need it.
#[derive(Deserialize)]
struct KeptRow {
    t_env: u64,
    #[serde(flatten, deserialize_with = "null_is_nan")]
    scalars: BTreeMap<String, f64>,
}

fn null_is_nan<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<BTreeMap<String, f64>, D::Error> {
    let mut scalars = BTreeMap::<String, Option<f64>>::deserialize(deserializer)?;
    scalars.retain(|name, _| !COUNTED.contains(&name.as_str()));
    Ok(scalars.into_iter().map(|(name, value)| (name, value.unwrap_or(f64::NAN))).collect())
}

fn parse(kept: &[u8], expected: u64) -> Result<Vec<KeptRow>, String> {
    if !kept.is_empty() && !kept.ends_with(b"\n") {
        return Err(format!("no row ends at byte {}", kept.len()));
    }
    let rows = kept
        .split_inclusive(|&byte| byte == b'\n')
        .enumerate()
        .map(|(i, line)| serde_json::from_slice(line).map_err(|error| format!("row {}: {error}", i + 1)))
        .collect::<Result<Vec<_>, _>>()?;
    if rows.len() as u64 != expected {
        return Err(format!(
            "expected {expected} rows in the first {} bytes, found {}",
            kept.len(),
            rows.len()
        ));
    }
    Ok(rows)
}

/// For TensorBoard's files only.
fn since_1970() -> Duration {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Folder(tempfile::TempDir);

    impl Folder {
        fn new() -> Self {
            Self(tempfile::tempdir().unwrap())
        }
        fn path(&self) -> PathBuf {
            self.0.path().join("metrics.jsonl")
        }
        fn open(&self, keep: Position) -> Result<MetricsWriter, Error> {
            MetricsWriter::open(&self.path(), &self.0.path().join("tensorboard"), keep)
        }
        fn text(&self) -> String {
            fs::read_to_string(self.path()).unwrap()
        }
        fn events(&self) -> Vec<(u64, String, f32)> {
            crate::tensorboard::tests::scalars_in(&self.0.path().join("tensorboard"))
        }
    }

    fn row(i: u64) -> Row {
        Row::of_learner(i * 362, i).with("test_return_mean", 1.0 / i as f64).with("loss", -0.25 * i as f64)
    }

    #[test]
    fn rows_are_flat_json_in_a_fixed_order_and_shortest_form() {
        let folder = Folder::new();
        let mut writer = folder.open(Position::START).unwrap();
        writer
            .append(&Row::of_learner(362, 1).with("test_return_mean", 0.43).with("loss", 0.1 + 0.2))
            .unwrap();
        writer
            .append(
                &Row::of_learner(u64::MAX, 2).with("a", f64::NAN).with("b", f64::INFINITY).with("c", -0.0),
            )
            .unwrap();
        writer.append(&Row::of_learner(3, 3).with(format!("lr_{}", 1), 1e-300).with("d", 5.0)).unwrap();
        let expected = "{\"t_env\":362,\"update_calls\":1,\"test_return_mean\":0.43,\"loss\":0.30000000000000004}\n\
                        {\"t_env\":18446744073709551615,\"update_calls\":2,\"a\":null,\"b\":null,\"c\":-0.0}\n\
                        {\"t_env\":3,\"update_calls\":3,\"lr_1\":1e-300,\"d\":5.0}\n";
        assert_eq!(folder.text(), expected);
        assert_eq!(writer.position(), Position { bytes: expected.len() as u64, rows: 3 });
        assert_eq!(writer.sync().unwrap(), writer.position());
    }

    #[test]
    fn a_run_that_starts_again_from_a_checkpoint_has_the_same_bytes() {
        let undisturbed = Folder::new();
        let mut writer = undisturbed.open(Position::START).unwrap();
        (1..=9).for_each(|i| writer.append(&row(i)).unwrap());

        let disturbed = Folder::new();
        let mut writer = disturbed.open(Position::START).unwrap();
        (1..=4).for_each(|i| writer.append(&row(i)).unwrap());
        let saved = writer.sync().unwrap();
        (5..=6).for_each(|i| writer.append(&row(i)).unwrap());
        drop(writer);
        let mut torn = OpenOptions::new().append(true).open(disturbed.path()).unwrap();
        io::Write::write_all(&mut torn, b"{\"t_env\":25").unwrap();
        let mut writer = disturbed.open(saved).unwrap();
        assert_eq!(writer.position(), saved);
        (5..=9).for_each(|i| writer.append(&row(i)).unwrap());

        assert_eq!(disturbed.text(), undisturbed.text());
        let sorted = |folder: &Folder| {
            let mut events = folder.events();
            events.sort_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
            events
        };
        assert_eq!(sorted(&disturbed).len(), 18);
        assert_eq!(sorted(&disturbed), sorted(&undisturbed));
        let event_files = files::names(&disturbed.0.path().join("tensorboard")).unwrap();
        assert_eq!(event_files.len(), 1, "{event_files:?}");
    }

    #[test]
    fn a_fresh_start_drops_the_rows_of_a_run_killed_before_its_first_checkpoint() {
        let folder = Folder::new();
        folder.open(Position::START).unwrap().append(&row(1)).unwrap();
        let writer = folder.open(Position::START).unwrap();
        assert_eq!(writer.position(), Position::START);
        assert_eq!(folder.text(), "");
        assert_eq!(folder.events(), []);
    }

    #[test]
    fn a_file_that_is_not_what_the_checkpoint_counts_on_is_refused_and_left_alone() {
        let folder = Folder::new();
        let text = "{\"t_env\":1,\"update_calls\":1}\n{\"t_env\":2,\"update_calls\":\"x\"}\n";
        fs::write(folder.path(), text).unwrap();
        let path = folder.path().display().to_string();
        let refusal = |bytes, rows| folder.open(Position { bytes, rows }).unwrap_err().to_string();
        assert!(refusal(200, 2)
            .starts_with(&format!("`{path}` ends after 60 bytes, but the checkpoint expects 200\n")));
        for (bytes, rows, problem) in [
            (20, 1, "no row ends at byte 20"),
            (29, 2, "expected 2 rows in the first 29 bytes, found 1"),
            (60, 2, "row 2: invalid type: string \"x\", expected f64 at line 1 column 30"),
        ] {
            let start = format!("`{path}` does not match the checkpoint: {problem}\n");
            assert!(refusal(bytes, rows).starts_with(&start), "{}", refusal(bytes, rows));
        }
        assert!(folder.open(Position { bytes: 200, rows: 2 }).unwrap_err().is_io());
        assert_eq!(folder.text(), text);
    }

    #[test]
    fn a_metric_cannot_be_named_twice_or_like_a_fixed_column() {
        let folder = Folder::new();
        let mut writer = folder.open(Position::START).unwrap();
        for name in ["loss", "t_env", "update_calls"] {
            let error = writer.append(&Row::of_learner(7, 1).with("loss", 1.0).with(name, 2.0)).unwrap_err();
            assert_eq!(error.to_string(), format!("the metric row of t_env 7 names `{name}` twice"));
        }
        assert_eq!((writer.position(), folder.text().as_str()), (Position::START, ""));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_reported_by_the_append_that_meets_it() {
        let folder = Folder::new();
        std::os::unix::fs::symlink("/dev/full", folder.path()).unwrap();
        let mut writer = folder.open(Position::START).unwrap();
        let error = writer.append(&row(1)).unwrap_err();
        assert_eq!(
            error.to_string(),
            format!(
                "no space left: could not append a row to `{}`: No space left on device (os error 28)\n\
                 hint: free disk space, then run `rondo resume`; the last checkpoint is intact",
                folder.path().display()
            )
        );
        assert_eq!(writer.position(), Position::START);
    }

    #[test]
    fn only_complete_lines_count() {
        let folder = Folder::new();
        assert_eq!(complete_lines(&folder.path()).unwrap(), b"");
        for (text, complete) in [("", ""), ("{\"t", ""), ("{}\n", "{}\n"), ("{}\n{}\n{", "{}\n{}\n")] {
            fs::write(folder.path(), text).unwrap();
            assert_eq!(complete_lines(&folder.path()).unwrap(), complete.as_bytes());
        }
    }
}
