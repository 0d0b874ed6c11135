//! The folder of a run and, in it, the folders of its roles.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::checkpoints::Checkpoints;
use crate::episodes::Episodes;
use crate::metrics::{complete_lines, MetricsWriter, Position};
use crate::{files, Error};

const CONFIG: &str = "config.toml";
const RESULT: &str = "result.json";
const EPOCH: &str = "epoch";
const LOG: &str = "log.jsonl";

/// Prefix of the folders to which a role's old state is moved.
const SET_ASIDE: &str = "set-aside-";

/// A folder that holds a run's `config.toml`.
#[derive(Debug, Clone)]
pub struct RunFolder {
    path: PathBuf,
    config_toml: String,
}

impl RunFolder {
    /// Starts a new run in a folder that is missing or empty; parents are created.
    ///
    /// The folder is closed to other users (mode 0700): the local bus has its sockets in it.
    ///
    /// # Errors
    /// [`Error::Exists`] if the folder is not empty, also if another process was faster.
    pub fn create(path: impl AsRef<Path>, config_toml: &str) -> Result<Self, Error> {
        let path = path.as_ref();
        if is_vacant(path, |_| false)? && files::place(&path.join(CONFIG), config_toml.as_bytes())? {
            return Ok(Self { path: path.to_owned(), config_toml: config_toml.to_owned() });
        }
        Err(Error::Exists { path: path.to_owned() })
    }

    /// Opens the folder of a run that was started before.
    ///
    /// # Errors
    /// [`Error::NotARun`] if there is no `config.toml` in it.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let config = path.join(CONFIG);
        match fs::read_to_string(&config) {
            Ok(config_toml) => Ok(Self { path: path.to_owned(), config_toml }),
            Err(error) if is_absence(&error) => Err(Error::NotARun { path: path.to_owned() }),
            Err(error) => Err(Error::io("read", &config)(error)),
        }
    }

    /// For a role that is started alone. The first role creates the folder; the others need the same configuration,
    /// byte for byte. Any number of roles may call this at once.
    ///
    /// # Errors
    /// [`Error::OtherConfig`] with the first line that differs; [`Error::NotARun`] if the folder
    /// is not empty and holds no run.
    pub fn create_or_open(path: impl AsRef<Path>, config_toml: &str) -> Result<Self, Error> {
        let path = path.as_ref();
        // The folder of a role may already exist: a foreign program or a person created it.
        if is_vacant(path, |name| role_order(name).is_some())? {
            files::place(&path.join(CONFIG), config_toml.as_bytes())?;
        }
        let run = Self::open(path)?;
        run.check_config(config_toml)?;
        Ok(run)
    }

    /// Replaces the configuration, for instance of a run that resumes with a larger budget. The caller checks that the
    /// change is allowed.
    pub fn replace_config(&mut self, config_toml: &str) -> Result<(), Error> {
        files::replace(&self.path.join(CONFIG), config_toml.as_bytes())?;
        config_toml.clone_into(&mut self.config_toml);
        Ok(())
    }

    /// The resolved configuration of the run.
    pub fn config_toml(&self) -> &str {
        &self.config_toml
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The folder of one role, created if it is missing.
    ///
    /// # Errors
    /// [`Error::RoleName`] unless `name` is `world`, `coordinator` or `agent-<number>`.
    pub fn role(&self, name: &str) -> Result<RoleFolder, Error> {
        if role_order(name).is_none() {
            return Err(Error::RoleName { name: name.to_owned() });
        }
        let role = RoleFolder {
            name: name.to_owned(),
            path: self.path.join(name),
            tensorboard: self.path.join("tensorboard").join(name),
        };
        files::ensure_folder(&role.path)?;
        Ok(role)
    }

    /// The roles that have a folder: the world, the coordinator, then the agents by number.
    pub fn roles(&self) -> Result<Vec<String>, Error> {
        let mut roles: Vec<_> =
            files::names(&self.path)?.into_iter().filter(|name| role_order(name).is_some()).collect();
        roles.sort_by_key(|name| role_order(name));
        Ok(roles)
    }

    /// Whether a role has as many complete metric rows as its latest checkpoint counts on.
    ///
    /// # Errors
    /// [`Error::MissingRows`] if some are not, [`Error::NoMetrics`] if there is no such file.
    pub fn check_rows(&self, role: &str) -> Result<(), Error> {
        let role = self.role(role)?;
        let path = role.metrics_path();
        if !path.exists() {
            return Err(Error::NoMetrics { path });
        }
        let expected = role.checkpoints().counts_on()?.map_or(0, |position| position.rows);
        let found = complete_lines(&path)?.iter().filter(|&&byte| byte == b'\n').count() as u64;
        if found < expected {
            return Err(Error::MissingRows { path, expected, found });
        }
        Ok(())
    }

    /// Writes a file of the whole run beside `config.toml`, in one step.
    pub fn keep(&self, name: &str, bytes: &[u8]) -> Result<(), Error> {
        files::replace(&self.path.join(name), bytes).map(|_| ())
    }

    /// Writes the run's `result.json` in one step.
    pub fn write_result(&self, result: &impl Serialize) -> Result<(), Error> {
        write_json(&self.path.join(RESULT), result)
    }

    fn check_config(&self, ours: &str) -> Result<(), Error> {
        if self.config_toml == ours {
            return Ok(());
        }
        // Split at '\n' alone, and not by `lines`, which hides carriage returns and a last newline.
        let (mut theirs, mut ours, mut line) = (self.config_toml.split('\n'), ours.split('\n'), 1);
        loop {
            let (a, b) = (theirs.next(), ours.next());
            // The texts differ, so a difference comes before both have ended. If not, this still ends.
            if a != b || a.is_none() {
                let path = self.path.clone();
                return Err(Error::OtherConfig {
                    path,
                    line,
                    theirs: a.map(str::to_owned),
                    ours: b.map(str::to_owned),
                });
            }
            line += 1;
        }
    }
}

/// The folder of one role. Only that role writes in it.
#[derive(Debug, Clone)]
pub struct RoleFolder {
    name: String,
    path: PathBuf,
    tensorboard: PathBuf,
}

impl RoleFolder {
    /// The folder of the run that this one is part of.
    pub fn run(&self) -> &Path {
        self.path.parent().expect("a role's folder is in the run's")
    }

    /// As [`RunFolder::keep`], from a role that is started alone.
    pub fn keep_in_run(&self, name: &str, bytes: &[u8]) -> Result<(), Error> {
        files::replace(&self.run().join(name), bytes).map(|_| ())
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Opens `metrics.jsonl` for appending after `keep`, the position in the checkpoint that the role resumes from;
    /// [`Position::START`] for a new run. Later rows are cut off, and the role's TensorBoard file is written again from
    /// the rows that are kept.
    ///
    /// # Errors
    /// [`Error::ShortMetrics`] or [`Error::DamagedMetrics`] if rows up to `keep` are missing or damaged; nothing is cut
    /// off then.
    pub fn metrics(&self, keep: Position) -> Result<MetricsWriter, Error> {
        MetricsWriter::open(&self.metrics_path(), &self.tensorboard, keep)
    }

    pub fn checkpoints(&self) -> Checkpoints {
        Checkpoints::new(self.path.join("checkpoints"))
    }

    /// Opens the role's `replay/` for appending after the first `position` records, the number in the checkpoint that
    /// the role resumes from; 0 for a new run. Later records are cut off.
    ///
    /// # Errors
    /// [`Error::DamagedEpisodes`] if one of these records is missing or damaged; nothing is cut off then.
    pub fn episodes(&self, position: u64) -> Result<Episodes, Error> {
        Episodes::open(self.path.join("replay"), position)
    }

    /// The configuration of this role's last seat; `None` before its first.
    pub fn config_toml(&self) -> Result<Option<String>, Error> {
        let path = self.path.join(CONFIG);
        match fs::read_to_string(&path) {
            Ok(text) => Ok(Some(text)),
            Err(error) if is_absence(&error) => Ok(None),
            Err(error) => Err(Error::io("read", &path)(error)),
        }
    }

    /// Stores the configuration that this role's checkpoints are made with.
    pub fn keep_config(&self, config_toml: &str) -> Result<(), Error> {
        if self.config_toml()?.as_deref() == Some(config_toml) {
            return Ok(());
        }
        files::replace(&self.path.join(CONFIG), config_toml.as_bytes()).map(|_| ())
    }

    /// The rounds that this role can start from, ascending: those of its checkpoints, and 0 if it had a seat before.
    /// None in a folder in which this run never began.
    pub fn held_rounds(&self) -> Result<Vec<u64>, Error> {
        let began = self.config_toml()?.map(|_| 0);
        Ok(began.into_iter().chain(self.checkpoints().rounds()?).collect())
    }

    /// Moves all files of the role except its log into a new folder below its own, and returns that folder; `None` if
    /// there are no checkpoints. Nothing is deleted.
    pub fn set_aside(&self) -> Result<Option<PathBuf>, Error> {
        if !self.checkpoints().exist()? {
            return Ok(None);
        }
        let aside = (1u32..).map(|n| self.path.join(format!("{SET_ASIDE}{n}"))).find(|path| !path.exists());
        let aside = aside.expect("there are enough numbers");
        files::ensure_folder(&aside)?;
        for name in files::names(&self.path)? {
            if name.starts_with(SET_ASIDE) || [LOG, EPOCH].contains(&name.as_str()) {
                continue;
            }
            let path = self.path.join(&name);
            fs::rename(&path, aside.join(&name))
                .map_err(Error::io("move to a folder for old state", &path))?;
        }
        files::sync_folder(&self.path)?;
        Ok(Some(aside))
    }

    /// A number that no earlier start of this role had, and at least `least`.
    pub fn next_epoch(&self, least: u32) -> Result<u32, Error> {
        let path = self.path.join(EPOCH);
        // A damaged file counts as absent: the number then follows from the checkpoint.
        let last = fs::read_to_string(&path).ok().and_then(|text| text.trim().parse::<u32>().ok());
        let epoch = last.map_or(0, |last| last.wrapping_add(1)).max(least);
        files::replace(&path, format!("{epoch}\n").as_bytes())?;
        Ok(epoch)
    }

    /// Writes the role's `result.json` in one step.
    pub fn write_result(&self, result: &impl Serialize) -> Result<(), Error> {
        write_json(&self.path.join(RESULT), result)
    }

    /// `log.jsonl`, open for appending.
    pub fn log_file(&self) -> Result<File, Error> {
        let path = self.path.join(LOG);
        OpenOptions::new().create(true).append(true).open(&path).map_err(Error::io("open", &path))
    }

    pub(crate) fn metrics_path(&self) -> PathBuf {
        self.path.join("metrics.jsonl")
    }
}

/// The order of a role in lists; `None` for a name that is not a role's.
fn role_order(name: &str) -> Option<(u8, u32)> {
    match name {
        "world" => Some((0, 0)),
        "coordinator" => Some((1, 0)),
        _ => {
            let digits = name.strip_prefix("agent-")?;
            let index: u32 = digits.parse().ok()?;
            // Each agent has one name: neither `agent-01` nor `agent-+1`.
            (index.to_string() == digits).then_some((2, index))
        }
    }
}

/// Creates the folder if it is missing. If it holds only unfinished files of other processes and what is `welcome`,
/// closes it to other users and returns `true`. A folder with other files is not changed.
fn is_vacant(path: &Path, welcome: impl Fn(&str) -> bool) -> Result<bool, Error> {
    files::ensure_folder(path)?;
    for entry in fs::read_dir(path).map_err(Error::io("list", path))? {
        let name = entry.map_err(Error::io("list", path))?.file_name();
        // A name that is not text is nobody's of ours.
        if !name.to_str().is_some_and(|name| name.starts_with(files::WRITING) || welcome(name)) {
            return Ok(false);
        }
    }
    match fs::set_permissions(path, Permissions::from_mode(0o700)) {
        // A mounted volume belongs to somebody else, and whoever mounted it decides; or it knows no permissions.
        Err(error) if files::is_refusal(&error) => {
            tracing::warn!(path = %path.display(), %error, "cannot close the run folder to other users");
        }
        other => other.map_err(Error::io("close to other users", path))?,
    }
    Ok(true)
}

fn is_absence(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    let mut text = serde_json::to_string_pretty(value)
        .map_err(|error| Error::io("express as JSON", path)(io::Error::other(error)))?;
    text.push('\n');
    files::replace(path, text.as_bytes()).map(drop)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use serde_json::json;

    use super::*;
    use crate::Checkpoint;

    const CONFIG_TOML: &str = "name = \"a\"\n\n[world]\ntask = \"lbf\"\n";

    #[test]
    fn a_new_run_is_private_and_holds_its_configuration() {
        let tmp = tempfile::tempdir().unwrap();
        let path = tmp.path().join("runs/today/a");
        let run = RunFolder::create(&path, CONFIG_TOML).unwrap();
        assert_eq!(run.path(), path);
        assert_eq!(fs::read_to_string(path.join("config.toml")).unwrap(), CONFIG_TOML);
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o700);
        assert_eq!(files::names(&path).unwrap(), ["config.toml"]);
        assert_eq!(RunFolder::open(&path).unwrap().config_toml(), CONFIG_TOML);
    }

    #[test]
    fn a_new_run_takes_an_empty_folder_but_not_a_used_one() {
        let tmp = tempfile::tempdir().unwrap();
        // Left by another process that was killed before its config.toml was complete.
        fs::write(tmp.path().join(".writing-x"), "na").unwrap();
        RunFolder::create(tmp.path(), CONFIG_TOML).unwrap();
        let error = RunFolder::create(tmp.path(), CONFIG_TOML).unwrap_err();
        let path = tmp.path().display();
        assert_eq!(
            error.to_string(),
            format!(
                "`{path}` exists and is not empty, a new run needs a new folder\nhint: continue that \
                 run with `rondo resume {path}`, or choose another folder with --out"
            )
        );
        assert!(error.is_config() && !error.is_io());
    }

    #[test]
    fn a_folder_without_config_is_not_a_run() {
        let tmp = tempfile::tempdir().unwrap();
        fs::write(tmp.path().join("thesis.tex"), "").unwrap();
        fs::set_permissions(tmp.path(), Permissions::from_mode(0o755)).unwrap();
        for path in [tmp.path().to_owned(), tmp.path().join("absent"), tmp.path().join("thesis.tex")] {
            let error = RunFolder::open(&path).unwrap_err();
            assert!(matches!(error, Error::NotARun { .. }), "{error}");
            assert!(error.is_config());
            let start =
                format!("`{}` is not a run folder: there is no config.toml in it\nhint: ", path.display());
            assert!(error.to_string().starts_with(&start), "{error}");
        }
        let error = RunFolder::create_or_open(tmp.path(), CONFIG_TOML).unwrap_err();
        assert!(matches!(error, Error::NotARun { .. }), "{error}");
        assert_eq!(files::names(tmp.path()).unwrap(), ["thesis.tex"]);
        assert_eq!(fs::metadata(tmp.path()).unwrap().permissions().mode() & 0o777, 0o755);
    }

    #[test]
    fn a_role_started_alone_must_bring_the_same_configuration() {
        let tmp = tempfile::tempdir().unwrap();
        let path = tmp.path().join("a");
        RunFolder::create_or_open(&path, CONFIG_TOML).unwrap();
        RunFolder::create_or_open(&path, CONFIG_TOML).unwrap();

        let difference = |config: &str| match RunFolder::create_or_open(&path, config).unwrap_err() {
            Error::OtherConfig { line, theirs, ours, .. } => (line, theirs, ours),
            other => panic!("{other}"),
        };
        let text = |text: &str| Some(text.to_owned());
        assert_eq!(
            difference(&CONFIG_TOML.replace("lbf", "rware")),
            (4, text("task = \"lbf\""), text("task = \"rware\""))
        );
        assert_eq!(difference(CONFIG_TOML.trim_end()), (5, text(""), None));
        assert_eq!(difference(&format!("{CONFIG_TOML}seed = 1")), (5, text(""), text("seed = 1")));
        assert_eq!(difference(&CONFIG_TOML.replace('\n', "\r\n")).0, 1);

        let error = RunFolder::create_or_open(&path, "name = \"a\"\n\n[world]\r\n").unwrap_err();
        assert!(error.is_config());
        assert_eq!(
            error.to_string(),
            format!(
                "`{}` belongs to a run with another configuration; line 3 is the first that differs\n  there: \
                 \"[world]\"\n  here:  \"[world]\\r\"\nhint: start this role with the run's own config.toml, \
                 or choose another folder with --out",
                path.display()
            )
        );
    }

    #[test]
    fn of_many_that_come_at_once_with_different_configurations_one_wins() {
        let tmp = tempfile::tempdir().unwrap();
        let path = tmp.path().join("a");
        let outcomes: Vec<_> = std::thread::scope(|scope| {
            let path = &path;
            let threads: Vec<_> = (0..8)
                .map(|i| {
                    scope.spawn(move || {
                        let run = RunFolder::create_or_open(path, &format!("seed = {i}\n"))?;
                        run.role(&format!("agent-{i}"))?;
                        Ok(run)
                    })
                })
                .collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        let won: Vec<_> =
            outcomes.iter().filter_map(|outcome: &Result<_, Error>| outcome.as_ref().ok()).collect();
        assert_eq!(won.len(), 1);
        assert_eq!(RunFolder::open(&path).unwrap().config_toml(), won[0].config_toml());
        for error in outcomes.iter().filter_map(|outcome| outcome.as_ref().err()) {
            assert!(matches!(error, Error::OtherConfig { line: 1, .. }), "{error}");
        }
        assert_eq!(files::names(&path).unwrap().len(), 2);
    }

    #[test]
    fn a_role_may_have_its_folder_before_the_run_has_its_configuration() {
        let tmp = tempfile::tempdir().unwrap();
        fs::create_dir(tmp.path().join("agent-1")).unwrap();
        let run = RunFolder::create_or_open(tmp.path(), CONFIG_TOML).unwrap();
        assert_eq!(run.config_toml(), CONFIG_TOML);
        fs::remove_file(tmp.path().join("config.toml")).unwrap();
        fs::write(tmp.path().join("thesis.tex"), "").unwrap();
        let error = RunFolder::create_or_open(tmp.path(), CONFIG_TOML).unwrap_err();
        assert!(matches!(error, Error::NotARun { .. }), "{error}");
    }

    #[test]
    fn the_beginning_is_held_once_a_role_has_had_a_seat() {
        let tmp = tempfile::tempdir().unwrap();
        let role = RunFolder::create(tmp.path(), CONFIG_TOML).unwrap().role("agent-0").unwrap();
        assert_eq!(role.held_rounds().unwrap(), [0; 0]);
        role.keep_config(CONFIG_TOML).unwrap();
        assert_eq!(role.held_rounds().unwrap(), [0]);
        role.checkpoints().save(&Checkpoint { round: 7, state: vec![], tensors: vec![] }).unwrap();
        assert_eq!(role.held_rounds().unwrap(), [0, 7]);
        assert_eq!(role.config_toml().unwrap().as_deref(), Some(CONFIG_TOML));
    }

    #[test]
    fn old_state_is_set_aside_whole_and_nothing_is_deleted() {
        let tmp = tempfile::tempdir().unwrap();
        let role = RunFolder::create(tmp.path(), CONFIG_TOML).unwrap().role("agent-0").unwrap();
        assert_eq!(role.set_aside().unwrap(), None);
        for n in 1..=2 {
            role.keep_config(CONFIG_TOML).unwrap();
            role.checkpoints().save(&Checkpoint { round: 7, state: vec![n], tensors: vec![] }).unwrap();
            fs::write(role.metrics_path(), "{}\n").unwrap();
            fs::write(role.path().join("log.jsonl"), "").unwrap();
            let aside = role.path().join(format!("set-aside-{n}"));
            assert_eq!(role.set_aside().unwrap(), Some(aside.clone()));
            assert_eq!(files::names(&aside).unwrap(), ["checkpoints", "config.toml", "metrics.jsonl"]);
            assert_eq!(role.held_rounds().unwrap(), [0; 0]);
        }
        assert_eq!(files::names(role.path()).unwrap(), ["log.jsonl", "set-aside-1", "set-aside-2"]);
    }

    #[test]
    fn every_start_has_an_epoch_of_its_own() {
        let tmp = tempfile::tempdir().unwrap();
        let role = RunFolder::create(tmp.path(), CONFIG_TOML).unwrap().role("world").unwrap();
        assert_eq!(role.next_epoch(0).unwrap(), 0);
        assert_eq!(role.next_epoch(0).unwrap(), 1);
        assert_eq!(role.next_epoch(7).unwrap(), 7);
        assert_eq!(role.next_epoch(0).unwrap(), 8);
    }

    #[test]
    fn roles_are_listed_world_first_and_agents_by_number() {
        let tmp = tempfile::tempdir().unwrap();
        let run = RunFolder::create(tmp.path(), CONFIG_TOML).unwrap();
        for name in ["agent-10", "agent-2", "coordinator", "agent-0", "world", "agent-1"] {
            assert_eq!(run.role(name).unwrap().name(), name);
        }
        fs::create_dir(tmp.path().join("tensorboard")).unwrap();
        fs::create_dir(tmp.path().join("agent-01")).unwrap();
        assert_eq!(
            run.roles().unwrap(),
            ["world", "coordinator", "agent-0", "agent-1", "agent-2", "agent-10"]
        );
    }

    #[test]
    fn a_role_cannot_be_called_anything_else() {
        let tmp = tempfile::tempdir().unwrap();
        let run = RunFolder::create(tmp.path().join("a"), CONFIG_TOML).unwrap();
        for name in ["", ".", "../b", "tensorboard", "agent-", "agent--1", "agent-01", "agent-+1", "World"] {
            let error = run.role(name).unwrap_err();
            assert_eq!(
                error.to_string(),
                format!("`{name}` is not a role: expected `world`, `coordinator` or `agent-<number>`")
            );
        }
        assert_eq!(files::names(run.path()).unwrap(), ["config.toml"]);
    }

    #[test]
    fn results_are_replaced_whole_and_logs_grow() {
        let tmp = tempfile::tempdir().unwrap();
        let run = RunFolder::create(tmp.path(), CONFIG_TOML).unwrap();
        let role = run.role("agent-0").unwrap();
        run.write_result(&json!({"score": 1})).unwrap();
        run.write_result(&json!({"score": 0.5})).unwrap();
        assert_eq!(fs::read_to_string(tmp.path().join("result.json")).unwrap(), "{\n  \"score\": 0.5\n}\n");
        role.write_result(&[1, 2]).unwrap();
        for line in ["one\n", "two\n"] {
            role.log_file().unwrap().write_all(line.as_bytes()).unwrap();
        }
        assert_eq!(fs::read_to_string(role.path().join("log.jsonl")).unwrap(), "one\ntwo\n");
        assert_eq!(files::names(role.path()).unwrap(), ["log.jsonl", "result.json"]);
    }
}
