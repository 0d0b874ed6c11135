//! Run folders and reference curve files become curves; curves of several seeds become groups.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::Value;

use crate::meaning::MEANING;
use crate::rows::{self, Rows};
use crate::Error;

/// Most folders between a sweep and its runs; protects against a folder that contains itself.
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
    /// Algorithm, task and learning rates, for the legend.
    pub label: String,
    pub task: String,
    pub seed: u64,
    /// Settings that may change the result, as `section.key` and text, without saving, logging, the budget and the
    /// seed.
    pub settings: BTreeMap<String, String>,
    /// In rising order of `t_env`; not empty if read from a run folder.
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

/// The result of reading paths.
#[derive(Debug)]
pub struct Found {
    pub curves: Vec<Curve>,
    /// Skipped runs, or rows of a run, each with the reason.
    pub left_out: Vec<Error>,
}

/// Reads `metric` from `paths`: run folders, reference curve files (`.json`), or folders with runs inside (`seed-1`,
/// `seed-2`, … `seed-10`, in that order).
///
/// A plain name is a metric of the world, `agent-1/loss` one of that role. Rows without the metric, and rows where it
/// is not finite (`null`), are skipped. So is an incomplete last line: it is still being written. A run that cannot be
/// read is skipped, and so is a second run of one seed: it is the same sample, and would make the standard error too
/// small.
pub fn load_all(paths: &[PathBuf], metric: &str) -> Found {
    let mut left_out = Vec::new();
    let mut curves: Vec<Curve> = Vec::new();
    for path in paths {
        for run in runs_in(path, &mut left_out) {
            match load(&run, metric) {
                Err(error) => left_out.push(error),
                Ok((curve, rows)) => {
                    left_out.extend(rows);
                    match curves.iter().find(|other| other.is_twin_of(&curve)) {
                        None => curves.push(curve),
                        Some(twin) => left_out.push(Error::RepeatedSeed {
                            label: curve.label,
                            seed: curve.seed,
                            first: twin.source.clone(),
                            second: curve.source,
                        }),
                    }
                }
            }
        }
    }
    Found { curves, left_out }
}

/// One run folder or curve file, and its skipped rows.
fn load(path: &Path, metric: &str) -> Result<(Curve, Option<Error>), Error> {
    if path.is_dir() {
        load_run(path, metric)
    } else if path.extension().is_some_and(|extension| extension == "json") {
        load_curve_file(path, metric)
    } else {
        Err(Error::NotARun { path: path.to_owned() })
    }
}

impl Curve {
    fn is_like(&self, other: &Curve) -> bool {
        self.label == other.label && self.settings == other.settings
    }

    fn is_twin_of(&self, other: &Curve) -> bool {
        self.seed == other.seed && self.is_like(other)
    }
}

/// Groups the seeds of each configuration, in their order.
///
/// Runs with one label but different settings are different groups. Their labels then get the settings in which they
/// differ, for instance `…, algo.hidden=64`. A label also gets the settings that change the meaning of a return (see
/// [`crate::meaning`]) if any two groups differ in them.
pub fn group(curves: Vec<Curve>) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for curve in curves {
        match groups.iter_mut().find(|group| group.curves[0].is_like(&curve)) {
            None => groups.push(Group { label: curve.label.clone(), curves: vec![curve] }),
            Some(group) => group.curves.push(curve),
        }
    }
    let labels: Vec<String> = (0..groups.len()).map(|index| distinct_label(&groups, index)).collect();
    for (group, label) in groups.iter_mut().zip(labels) {
        group.label = label;
    }
    groups
}

/// The group's label with the settings that distinguish it from others of the same label, or from all others in
/// meaning.
fn distinct_label(groups: &[Group], index: usize) -> String {
    let own = &groups[index];
    let settings = |group: &Group| group.curves[0].settings.clone();
    let namesakes: Vec<_> = groups.iter().filter(|group| group.label == own.label).map(settings).collect();
    let all: Vec<_> = groups.iter().map(settings).collect();
    let own_settings = settings(own);
    let mut label = own.label.clone();
    let keys: BTreeSet<&String> = all.iter().flat_map(BTreeMap::keys).collect();
    for key in keys {
        let value = own_settings.get(key);
        let among_namesakes = namesakes.iter().any(|other| other.get(key) != value);
        let in_meaning = MEANING.contains(&key.as_str())
            && value.is_some()
            && all.iter().any(|other| other.get(key).is_some_and(|other| Some(other) != value));
        if among_namesakes || in_meaning {
            label += &format!(", {key}={}", value.map_or("unset", String::as_str));
        }
    }
    label
}

fn is_run(path: &Path) -> bool {
    path.join("config.toml").is_file()
}

/// The runs at a path. A path without a run is returned itself, so that reading it gives the error.
fn runs_in(path: &Path, left_out: &mut Vec<Error>) -> Vec<PathBuf> {
    let mut runs = Vec::new();
    let before = left_out.len();
    if path.is_dir() {
        find_runs(path, MAX_DEPTH, &mut runs, left_out);
        if runs.is_empty() && left_out.len() == before {
            left_out.push(Error::NotARun { path: path.to_owned() });
        }
    } else {
        runs.push(path.to_owned());
    }
    runs
}

/// Whether this folder belongs to a run, with or without its configuration: it may be new or incompletely copied.
fn is_part_of_run(folder: &Path) -> bool {
    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let is_seed = name.strip_prefix("seed-").is_some_and(|seed| seed.parse::<u64>().is_ok());
    let has_role = ["world", "coordinator", "agent-0"].iter().any(|role| folder.join(role).is_dir());
    is_run(folder) || has_role || is_seed && !holds_folder(folder)
}

fn holds_folder(folder: &Path) -> bool {
    fs::read_dir(folder).is_ok_and(|entries| entries.flatten().any(|entry| entry.path().is_dir()))
}

fn find_runs(folder: &Path, depth: usize, runs: &mut Vec<PathBuf>, left_out: &mut Vec<Error>) {
    if is_part_of_run(folder) {
        runs.push(folder.to_owned());
        return;
    }
    if depth == 0 {
        return;
    }
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(source) => return left_out.push(Error::Read { path: folder.to_owned(), source }),
    };
    let mut inner: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    // `seed-10` comes after `seed-2`: numbers at the end are compared as numbers.
    inner.sort_by_key(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let stem = name.trim_end_matches(|c: char| c.is_ascii_digit()).to_owned();
        let number: Option<u64> = name[stem.len()..].parse().ok();
        (stem, number, name)
    });
    inner.iter().for_each(|path| find_runs(path, depth - 1, runs, left_out));
}

fn load_run(run: &Path, metric: &str) -> Result<(Curve, Option<Error>), Error> {
    let config = run.join("config.toml");
    let text = fs::read_to_string(&config).map_err(|source| Error::Read { path: config.clone(), source })?;
    let about = describe(&text).map_err(|problem| Error::Config { path: config, problem })?;

    let (role, name) = metric.split_once('/').unwrap_or(("world", metric));
    let path = run.join(role).join("metrics.jsonl");
    let bytes = fs::read(&path).map_err(|source| Error::Read { path: path.clone(), source })?;
    let mut rows = Rows::new(&path, name);
    rows.take_lines(&bytes);
    let (points, left_out) = rows.finish()?;
    let About { label, task, seed, settings } = about;
    Ok((Curve { label, task, seed, settings, points, source: run.to_owned() }, left_out))
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
    // With equal rates the switching period has no effect (algorithms §12, check 2).
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

/// A value for labels: texts without quotes.
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
    rows: Vec<Value>,
}

fn load_curve_file(path: &Path, metric: &str) -> Result<(Curve, Option<Error>), Error> {
    let bytes = fs::read(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
    let mut rows = Rows::new(path, metric);
    let file: CurveFile = rows::parse(&bytes)
        .map_err(|problem| Error::CurveFile { path: path.to_owned(), problem: problem.to_string() })?;
    for (index, row) in file.rows.iter().enumerate() {
        let place = format!("rows[{index}]");
        match row.as_object() {
            Some(row) => rows.take(&place, row),
            None => rows.leave_out(&place, format!("expected an object, got {row}")),
        }
    }
    let (points, left_out) = rows.finish()?;
    let program = file.source.split(" (").next().unwrap_or_default();
    let settings = file.settings.into_iter().map(|(key, value)| {
        let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        (key, text)
    });
    let curve = Curve {
        label: format!("{} {} ({program})", file.algorithm, file.task),
        task: file.task,
        seed: file.seed,
        settings: settings.collect(),
        points,
        source: path.to_owned(),
    };
    Ok((curve, left_out))
}

#[cfg(test)]
#[path = "runs_tests.rs"]
pub(crate) mod tests;
