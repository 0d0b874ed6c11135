//! Checks of a run folder before a start: whether it holds a run, its configuration, and whether it is finished.

use std::path::{Path, PathBuf};

use process::Failure;
use proto::config::Config;
use proto::exit;
use serde::Deserialize;
use store::RunFolder;

/// Whether a folder is that of a run.
pub fn is_run(path: &Path) -> bool {
    path.join("config.toml").is_file()
}

/// Rejects a folder that holds something other than a run.
///
/// # Errors
/// What is there.
pub fn is_vacant(path: &Path) -> Result<(), Failure> {
    let refuse = |what: &str| {
        let text = format!(
            "{} is {what}, a run needs a folder\nhint: choose another one with --out",
            path.display()
        );
        Err(Failure::new(exit::CONFIG, text))
    };
    let mut entries = match std::fs::read_dir(path) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return if path.is_symlink() { refuse("a link to nothing") } else { Ok(()) };
        }
        Err(_) if path.is_file() => return refuse("a file"),
        Err(error) => return Err(cannot_list(path, &error)),
    };
    if entries.next().is_none() {
        return Ok(());
    }
    let text = format!(
        "{} holds something other than a run, a new run needs a new folder\nhint: choose another folder with \
         --out",
        path.display()
    );
    Err(Failure::new(exit::CONFIG, text))
}

fn cannot_list(path: &Path, error: &std::io::Error) -> Failure {
    let hint = match error.kind() {
        std::io::ErrorKind::NotADirectory => "a part of this path is a file; choose another folder",
        std::io::ErrorKind::InvalidFilename => "choose a shorter name",
        _ => "choose another folder, or give this user the right to it",
    };
    Failure::new(exit::IO, format!("cannot list {}: {error}\nhint: {hint}", path.display()))
}

/// The runs below a folder of seeds, by seed.
///
/// # Errors
/// If the folder cannot be listed; one that is missing has none.
pub fn seeds(path: &Path) -> Result<Vec<(u64, PathBuf)>, Failure> {
    let failed = |error| cannot_list(path, &error);
    let entries = match std::fs::read_dir(path) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(vec![]),
        Err(error) => return Err(failed(error)),
    };
    let mut seeds = Vec::new();
    for entry in entries {
        let entry = entry.map_err(failed)?;
        let seed = entry.file_name().to_str().and_then(|name| name.strip_prefix("seed-")?.parse().ok());
        if let (Some(seed), true) = (seed, is_run(&entry.path())) {
            seeds.push((seed, entry.path()));
        }
    }
    seeds.sort_unstable();
    Ok(seeds)
}

/// Compares a configuration with the one that each role's checkpoints in a run folder were made with.
///
/// # Errors
/// The role and the first key that differs.
pub fn check_unchanged(folder: &RunFolder, config: &Config) -> Result<(), Failure> {
    for name in folder.roles()? {
        let Some(made_with) = folder.role(&name)?.config_toml()? else { continue };
        process::check_unchanged(config, &made_with).map_err(|what| {
            let text = format!(
                "{}/config.toml is not the configuration that `{name}` was trained with: {what}\nhint: restore that \
                 value; `rondo resume RUN --t-max N` trains longer, `--set` changes save.interval, log.interval and \
                 bus.low_latency",
                folder.path().display()
            );
            Failure::new(exit::CONFIG, text)
        })?;
    }
    Ok(())
}

/// The env-server's result of its last start.
#[derive(Deserialize)]
struct WorldResult {
    t_env: u64,
    rounds: u64,
    test_return_mean: Option<f64>,
}

/// One line about a finished run: it has used its budget, and its env-server and agents have all saved the last round.
/// `None` otherwise.
///
/// # Errors
/// If the folder cannot be read.
pub fn finished(folder: &RunFolder, config: &Config) -> Result<Option<String>, Failure> {
    // Absent before the first end of a run, damaged after a crash: in both cases the run is not finished.
    let result = std::fs::read_to_string(folder.path().join("world").join("result.json")).ok();
    let Some(result) = result.and_then(|text| serde_json::from_str::<WorldResult>(&text).ok()) else {
        return Ok(None);
    };
    if result.t_env < config.t_max {
        return Ok(None);
    }
    let roles = folder.roles()?;
    let agents = (0..config.world.agents).map(|agent| format!("agent-{agent}"));
    for name in std::iter::once("world".to_owned()).chain(agents) {
        if !roles.contains(&name) || !folder.role(&name)?.held_rounds()?.contains(&result.rounds) {
            return Ok(None);
        }
    }
    let score = result.test_return_mean.map_or(String::new(), |score| format!(", test return {score:.4}"));
    Ok(Some(format!("{} is finished: {} steps{score}", folder.path().display(), result.t_env)))
}
