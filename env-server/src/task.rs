//! The world that a configuration describes.

use std::path::Path;
use std::sync::Arc;

use envs::{Opponent, Task};
use process::Failure;
use proto::config::{Config, World};
use proto::{exit, Observe};

/// The file in a run folder with the weights of an opponent that is not built in.
pub const OPPONENT_FILE: &str = "opponent.safetensors";

/// The task of a run whose folder is `run`.
///
/// # Errors
/// If there is no such task, it has another number of agents, or its opponent is missing.
pub fn task(config: &Config, run: &Path) -> Result<Task, Failure> {
    let World { task: name, agents, pad, .. } = &config.world;
    let refused = |error| Failure::new(exit::CONFIG, error);
    let mut task = match &config.world.map {
        None => envs::task(name).map_err(refused)?,
        Some(map) => envs::named_task_of_map(name, map)
            .map_err(|error| Failure::new(exit::CONFIG, format!("`world.map`: {error}")))?,
    };
    if task.sizes().agents != *agents as usize {
        let has = task.sizes().agents;
        return Err(Failure::new(exit::CONFIG, format!("`world.agents` is {agents}, but {name} has {has}")));
    }
    let opponent = opponent(&config.world.opponent, run)?;
    if opponent != Opponent::Builtin {
        task = task.with_opponent(&opponent).map_err(refused)?;
    }
    Ok(if *pad { task.padded() } else { task })
}

/// Bytes of the largest message of a run: what an agent sees at once in all environment copies.
fn largest_message(config: &Config, task: &Task) -> usize {
    let rows = config.world.copies.max(config.test.episodes) as usize;
    let sizes = task.sizes();
    let of_agent = |i: usize| Observe::encoded_len(rows, sizes.obs_size[i], sizes.n_actions[i]);
    (0..sizes.agents).map(of_agent).max().unwrap_or(0)
}

/// Whether every message of a run fits the low-latency transport.
pub fn fits_low_latency(config: &Config, task: &Task) -> bool {
    largest_message(config, task) <= bus::LOW_LATENCY_MAX_BYTES
}

/// Refuses the low-latency transport for a run whose messages do not fit it.
///
/// # Errors
/// The largest message, and what to do.
pub fn check_transport(config: &Config, task: &Task) -> Result<(), Failure> {
    if !config.bus.low_latency || fits_low_latency(config, task) {
        return Ok(());
    }
    let text = format!(
        "`bus.low_latency` is true, but that transport carries {} bytes a message and an observation of this run has \
         up to {} (`world.copies` is {}, `test.episodes` {})\nhint: `bus.low_latency` = false",
        bus::LOW_LATENCY_MAX_BYTES,
        largest_message(config, task),
        config.world.copies,
        config.test.episodes
    );
    Err(Failure::new(exit::CONFIG, text))
}

/// The opponent that `world.opponent` names. Weights are read from the run's folder and compared with their digest, so
/// that a run never continues against another opponent.
fn opponent(named: &str, run: &Path) -> Result<Opponent, Failure> {
    match named {
        "builtin" => return Ok(Opponent::Builtin),
        "random" => return Ok(Opponent::Random),
        "still" => return Ok(Opponent::Still),
        _ => {}
    }
    let path = run.join(OPPONENT_FILE);
    let bytes = std::fs::read(&path).map_err(|error| {
        let text = format!(
            "cannot read the opponent's weights in {}: {error}\n\
             hint: copy there the file that the run was started with (its digest is `world.opponent`)",
            path.display()
        );
        Failure::new(exit::IO, text)
    })?;
    check_opponent(named, &bytes, &path)?;
    Ok(Opponent::Weights(Arc::from(bytes)))
}

/// Checks that a file holds the opponent `named` of this run (`world.opponent`).
///
/// # Errors
/// If it holds another one, or the run's opponent is not from a file.
pub fn check_opponent(named: &str, bytes: &[u8], file: &Path) -> Result<(), Failure> {
    let found = store::digest_of(bytes);
    if found == named {
        return Ok(());
    }
    let text = format!(
        "{} is not the opponent of this run: `world.opponent` is {named}, the file has the digest {found}",
        file.display()
    );
    Err(Failure::new(exit::CONFIG, text))
}
