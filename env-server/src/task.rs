//! The world that a configuration describes.

use std::path::Path;
use std::sync::Arc;

use envs::{Opponent, Task};
use process::Failure;
use proto::config::{Config, World};
use proto::exit;

/// Where a run keeps the weights of an opponent that did not come with the task.
pub const OPPONENT_FILE: &str = "opponent.safetensors";

/// The task of a run whose folder is `run`.
///
/// # Errors
/// If there is no such task, it has another number of agents, or its opponent is not there.
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

/// The opponent that `world.opponent` names; weights are read from the run's folder and compared with their digest,
/// so that no run goes on against another opponent.
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

/// Whether a file holds the opponent of this run, which `world.opponent` calls `named`.
///
/// # Errors
/// If it holds another, or the run's opponent does not come in a file.
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
