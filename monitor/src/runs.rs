//! Run folders and reference curve files become curves; curves of several seeds become groups.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Map, Value};

use crate::Error;

/// Folders between a sweep and its runs, at most; a guard against a folder that contains itself.
const MAX_DEPTH: usize = 4;

/// One measurement of one run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Environment steps made when it was taken.
    pub t_env: u64,
    pub value: f64,
}

/// One metric of one run against environment steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Algorithm, task and learning rates: what a legend says.
    pub label: String,
    pub task: String,
    pub seed: u64,
    /// What may change the result, as `section.key` and text. Where to save, what to log, how long
    /// to train and the seed are not part of it.
    pub settings: BTreeMap<String, String>,
    /// In rising order of `t_env`; never empty when it comes from [`load`].
    pub points: Vec<Point>,
    /// The run folder or file it was read from.
    pub source: PathBuf,
}

/// The seeds of one configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    pub label: String,
    pub curves: Vec<Curve>,
}

/// Reads `metric` of one run folder or one reference curve file (`.json`).
///
/// A plain name is looked up in the world's rows, `agent-1/loss` in that role's. Rows without the
/// metric, and rows where it is `null` (not finite when measured), are skipped. A last line that
/// is cut short is a row still being written, and is skipped too.
///
/// # Errors
/// [`Error::NotARun`], [`Error::Config`], [`Error::Damaged`] with the line, [`Error::NoRows`] if no
/// row has the metric, [`Error::Read`].
pub fn load(path: &Path, metric: &str) -> Result<Curve, Error> {
    if is_run(path) {
        load_run(path, metric)
    } else if path.extension().is_some_and(|extension| extension == "json") {
        load_curve_file(path, metric)
    } else {
        Err(Error::NotARun { path: path.to_owned() })
    }
}

/// Like [`load`], but a folder that is not a run itself stands for the runs inside it
/// (`seed-1`, `seed-2`, … `seed-10`, in that order).
///
/// # Errors
/// Those of [`load`]; [`Error::NotARun`] if the folder holds no run.
pub fn load_all(path: &Path, metric: &str) -> Result<Vec<Curve>, Error> {
    if is_run(path) || !path.is_dir() {
        return Ok(vec![load(path, metric)?]);
    }
    let mut runs = Vec::new();
    find_runs(path, MAX_DEPTH, &mut runs)?;
    if runs.is_empty() {
        return Err(Error::NotARun { path: path.to_owned() });
    }
    runs.iter().map(|run| load_run(run, metric)).collect()
}

/// Puts the seeds of each configuration together, in the order in which they come.
///
/// Runs with one label but different settings stay apart; their labels then get the settings in
/// which they differ, for instance `…, algo.hidden=64`.
///
/// # Errors
/// [`Error::RepeatedSeed`] if a configuration has the same seed twice.
pub fn group(curves: Vec<Curve>) -> Result<Vec<Group>, Error> {
    let mut groups: Vec<Group> = Vec::new();
    for curve in curves {
        let same =
            |group: &&mut Group| group.label == curve.label && group.curves[0].settings == curve.settings;
        match groups.iter_mut().find(same) {
            None => groups.push(Group { label: curve.label.clone(), curves: vec![curve] }),
            Some(group) => {
                if let Some(twin) = group.curves.iter().find(|other| other.seed == curve.seed) {
                    return Err(Error::RepeatedSeed {
                        label: curve.label,
                        seed: curve.seed,
                        first: twin.source.clone(),
                        second: curve.source,
                    });
                }
                group.curves.push(curve);
            }
        }
    }
    let labels: Vec<String> = (0..groups.len()).map(|index| distinct_label(&groups, index)).collect();
    for (group, label) in groups.iter_mut().zip(labels) {
        group.label = label;
    }
    Ok(groups)
}

/// The group's label and, where others have the same one, the settings that tell them apart.
fn distinct_label(groups: &[Group], index: usize) -> String {
    let own = &groups[index];
    let settings = &own.curves[0].settings;
    let namesakes: Vec<_> = groups.iter().filter(|group| group.label == own.label).collect();
    let keys: BTreeSet<&String> =
        namesakes.iter().flat_map(|group| group.curves[0].settings.keys()).collect();
    let mut label = own.label.clone();
    for key in keys {
        let value = settings.get(key);
        if namesakes.iter().any(|group| group.curves[0].settings.get(key) != value) {
            label += &format!(", {key}={}", value.map_or("unset", String::as_str));
        }
    }
    label
}

fn is_run(path: &Path) -> bool {
    path.join("config.toml").is_file()
}

fn find_runs(folder: &Path, depth: usize, runs: &mut Vec<PathBuf>) -> Result<(), Error> {
    if is_run(folder) {
        runs.push(folder.to_owned());
        return Ok(());
    }
    if depth == 0 {
        return Ok(());
    }
    let read = |source| Error::Read { path: folder.to_owned(), source };
    let mut inner = Vec::new();
    for entry in fs::read_dir(folder).map_err(read)? {
        let path = entry.map_err(read)?.path();
        if path.is_dir() {
            inner.push(path);
        }
    }
    // `seed-10` belongs after `seed-2`: numbers at the end count as numbers.
    inner.sort_by_key(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let stem = name.trim_end_matches(|c: char| c.is_ascii_digit()).to_owned();
        let number: Option<u64> = name[stem.len()..].parse().ok();
        (stem, number, name)
    });
    inner.iter().try_for_each(|path| find_runs(path, depth - 1, runs))
}

fn load_run(run: &Path, metric: &str) -> Result<Curve, Error> {
    let config = run.join("config.toml");
    let text = fs::read_to_string(&config).map_err(|source| Error::Read { path: config.clone(), source })?;
    let about = describe(&text).map_err(|problem| Error::Config { path: config, problem })?;

    let (role, name) = metric.split_once('/').unwrap_or(("world", metric));
    let path = run.join(role).join("metrics.jsonl");
    let bytes = fs::read(&path).map_err(|source| Error::Read { path: path.clone(), source })?;
    let mut rows = Rows::new(&path, name);
    for (index, line) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
        if line.trim_ascii().is_empty() {
            continue;
        }
        let line_number = (index + 1).to_string();
        match serde_json::from_slice::<Map<String, Value>>(line) {
            Ok(row) => rows.take(&line_number, &row)?,
            Err(_) if !line.ends_with(b"\n") => break,
            Err(error) => return Err(rows.damaged(&line_number, format!("not a flat JSON object: {error}"))),
        }
    }
    let points = rows.finish()?;
    let About { label, task, seed, settings } = about;
    Ok(Curve { label, task, seed, settings, points, source: run.to_owned() })
}

struct About {
    label: String,
    task: String,
    seed: u64,
    settings: BTreeMap<String, String>,
}

/// Label, seed and settings of a run, from its `config.toml`.
fn describe(config: &str) -> Result<About, String> {
    let table: toml::Table = config.parse().map_err(|error: toml::de::Error| error.to_string())?;
    let text = |section: &str, key: &str| {
        let value = table.get(section).and_then(|section| section.get(key)).and_then(toml::Value::as_str);
        value.map(str::to_owned).ok_or(format!("expected a text `{key}` in section `{section}`"))
    };
    let algorithm = text("algo", "name")?;
    let task = text("world", "task")?;
    let seed = table.get("seed").and_then(toml::Value::as_integer);
    let seed =
        seed.and_then(|seed| u64::try_from(seed).ok()).ok_or("expected a whole number `seed` from 0 up")?;

    let mut label = format!("{algorithm} {task}");
    let schedule = table.get("schedule");
    let rates = schedule.and_then(|schedule| schedule.get("rates")).and_then(toml::Value::as_array);
    let mut rates: Vec<f64> = rates.into_iter().flatten().filter_map(number).collect();
    if rates.iter().all(|rate| *rate == rates[0]) {
        rates.truncate(1);
    }
    if !rates.is_empty() {
        let written: Vec<String> = rates.iter().map(|rate| format!("{rate:e}").replace("0e0", "0")).collect();
        label += &format!(", lr {}", written.join(" / "));
    }
    // With equal rates the switching period has no effect (spec §12, check 2).
    if let (true, Some(period)) = (rates.len() > 1, schedule.and_then(|it| it.get("switch_period"))) {
        label += &format!(", s = {}", plain(period));
    }

    let mut settings = BTreeMap::new();
    flatten("", &toml::Value::Table(table), &mut settings);
    settings.retain(|key, _| {
        let section = key.split('.').next().unwrap_or_default();
        !["run", "seed", "t_max", "test", "save", "log", "bus"].contains(&section)
    });
    Ok(About { label, task, seed, settings })
}

fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|integer| integer as f64))
}

fn flatten(prefix: &str, value: &toml::Value, into: &mut BTreeMap<String, String>) {
    match value {
        toml::Value::Table(table) => {
            for (key, inner) in table {
                let name = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
                flatten(&name, inner, into);
            }
        }
        leaf => {
            into.insert(prefix.to_owned(), plain(leaf));
        }
    }
}

/// A value as people write it: texts without quotes.
fn plain(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// A curve of another implementation; the rows hold the same names as our metric rows.
#[derive(Deserialize)]
struct CurveFile {
    source: String,
    algorithm: String,
    task: String,
    seed: u64,
    #[serde(default)]
    settings: BTreeMap<String, Value>,
    rows: Vec<Map<String, Value>>,
}

fn load_curve_file(path: &Path, metric: &str) -> Result<Curve, Error> {
    let bytes = fs::read(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
    let mut rows = Rows::new(path, metric);
    let file: CurveFile = serde_json::from_slice(&bytes)
        .map_err(|error| rows.damaged(&error.line().to_string(), format!("not a curve file: {error}")))?;
    for (index, row) in file.rows.iter().enumerate() {
        rows.take(&format!("rows[{index}]"), row)?;
    }
    let points = rows.finish()?;
    let program = file.source.split(" (").next().unwrap_or_default();
    let settings = file.settings.into_iter().map(|(key, value)| {
        let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        (key, text)
    });
    Ok(Curve {
        label: format!("{} {} ({program})", file.algorithm, file.task),
        task: file.task,
        seed: file.seed,
        settings: settings.collect(),
        points,
        source: path.to_owned(),
    })
}

/// Collects one metric from rows, and remembers which names there were, for the error message.
struct Rows<'a> {
    path: &'a Path,
    metric: &'a str,
    points: Vec<Point>,
    names: BTreeSet<String>,
}

impl<'a> Rows<'a> {
    fn new(path: &'a Path, metric: &'a str) -> Self {
        Self { path, metric, points: Vec::new(), names: BTreeSet::new() }
    }

    fn damaged(&self, place: &str, problem: String) -> Error {
        Error::Damaged { path: self.path.to_owned(), place: place.to_owned(), problem }
    }

    fn take(&mut self, place: &str, row: &Map<String, Value>) -> Result<(), Error> {
        let value = match row.get(self.metric) {
            None => {
                let new = row.keys().filter(|name| !self.names.contains(*name)).cloned().collect::<Vec<_>>();
                self.names.extend(new);
                return Ok(());
            }
            Some(Value::Null) => return Ok(()),
            Some(value) => value.as_f64().ok_or_else(|| {
                self.damaged(place, format!("expected a number for `{}`, got {value}", self.metric))
            })?,
        };
        let t_env = row.get("t_env").and_then(Value::as_u64).ok_or_else(|| {
            self.damaged(place, "expected a whole number `t_env` (environment steps) beside the value".into())
        })?;
        if let Some(last) = self.points.last().filter(|last| last.t_env >= t_env) {
            return Err(
                self.damaged(place, format!("t_env {t_env} comes after {}, expected rising", last.t_env))
            );
        }
        self.points.push(Point { t_env, value });
        Ok(())
    }

    fn finish(self) -> Result<Vec<Point>, Error> {
        if !self.points.is_empty() {
            return Ok(self.points);
        }
        let names: Vec<String> = self.names.iter().map(|name| format!("`{name}`")).collect();
        let found = match names.is_empty() {
            true => "it has no rows with a value yet".to_owned(),
            false => format!("there are {}", names.join(", ")),
        };
        Err(Error::NoRows { path: self.path.to_owned(), metric: self.metric.to_owned(), found })
    }
}

#[cfg(test)]
#[path = "runs_tests.rs"]
pub(crate) mod tests;
