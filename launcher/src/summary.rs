//! The result of a run: `result.json` and the summary on the terminal.

use std::collections::BTreeMap;
use std::fmt;
use std::time::{SystemTime, UNIX_EPOCH};

use process::Failure;
use proto::config::Config;
use proto::exit;
use serde::Serialize;
use serde_json::Value;
use store::RunFolder;

use crate::display::thousands;
use crate::notes;

/// The result of a run, as in its result.json.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    pub rondo_version: &'static str,
    pub task: String,
    pub algo: String,
    pub seed: u64,
    pub t_env: u64,
    pub update_calls: u64,
    pub test_return_mean: Option<f64>,
    pub best_test_return_mean: Option<f64>,
    /// What the world reports of the episodes of the last test, by the names of metric rows.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub test_facts: BTreeMap<String, f64>,
    /// Why these returns do not compare with published tables, if a reader could compare them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_comparable: Option<String>,
    /// Of this process, without the time before a resume.
    pub wall_seconds: f64,
    /// From the launcher's start to the first environment step.
    pub start_seconds: f64,
    /// Training steps per second between the first tick and the last, without tests.
    pub env_steps_per_second: f64,
    pub digest: Option<String>,
    /// Payload bytes that the roles sent, by key.
    pub bytes_by_key: BTreeMap<String, u64>,
    /// The content of each role's own result.json.
    pub roles: BTreeMap<String, Value>,
    #[serde(skip)]
    pub folder: String,
}

/// Reads the results of the roles of a run that began at `start`.
///
/// # Errors
/// If the env-server's result cannot be read.
pub fn collect(folder: &RunFolder, config: &Config, start: SystemTime) -> Result<Summary, Failure> {
    let mut roles = BTreeMap::new();
    let mut bytes_by_key = BTreeMap::new();
    for role in folder.roles()? {
        let path = folder.path().join(&role).join("result.json");
        // A role that failed has written none.
        let Ok(text) = std::fs::read_to_string(&path) else { continue };
        let Ok(mut value) = serde_json::from_str::<Value>(&text) else { continue };
        let traffic = value.as_object_mut().and_then(|o| o.remove("traffic")).unwrap_or_default();
        for entry in traffic.as_array().into_iter().flatten() {
            if let (Some(key), Some(bytes)) = (entry[0].as_str(), entry[2].as_u64()) {
                *bytes_by_key.entry(key.to_owned()).or_insert(0) += bytes;
            }
        }
        roles.insert(role, value);
    }
    let world = roles.get("world").cloned().ok_or_else(|| {
        let text = format!("there is no world/result.json in {}", folder.path().display());
        Failure::new(exit::BUG, text)
    })?;
    let steps = world["steps_played"].as_u64().unwrap_or(0);
    let mut summary = Summary {
        rondo_version: env!("CARGO_PKG_VERSION"),
        task: config.world.task.clone(),
        algo: config.algo.name.to_string(),
        seed: config.seed,
        t_env: world["t_env"].as_u64().unwrap_or(0),
        update_calls: roles.get("agent-0").and_then(|role| role["update_calls"].as_u64()).unwrap_or(0),
        test_return_mean: world["test_return_mean"].as_f64(),
        best_test_return_mean: world["best_test_return_mean"].as_f64(),
        test_facts: serde_json::from_value(world["test_facts"].clone()).unwrap_or_default(),
        not_comparable: notes::opponent(config),
        wall_seconds: start.elapsed().unwrap_or_default().as_secs_f64(),
        start_seconds: world["first_step_at"]
            .as_f64()
            .map_or(0.0, |at| at - start.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()),
        env_steps_per_second: 0.0,
        digest: store::digest(folder, config.world.agents as usize).ok().map(|digest| digest.digest),
        bytes_by_key,
        roles,
        folder: folder.path().display().to_string(),
    };
    if summary.training_seconds() > 0.0 {
        summary.env_steps_per_second = steps as f64 / summary.training_seconds();
    }
    Ok(summary)
}

impl Summary {
    /// A role's seconds of one activity; 0 if it reports none.
    pub fn seconds(&self, role: &str, part: &str) -> f64 {
        self.roles.get(role).and_then(|role| role["seconds"][part].as_f64()).unwrap_or(0.0)
    }

    /// From the first tick to the last, without tests.
    pub fn training_seconds(&self) -> f64 {
        self.seconds("world", "total") - self.seconds("world", "tests")
    }
}

/// A fact for people, by its name in metric rows: `battle won` for `test_battle_won_mean`.
pub fn fact(name: &str) -> String {
    let name = name.strip_prefix("test_").unwrap_or(name);
    name.strip_suffix("_mean").unwrap_or(name).replace('_', " ")
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |x: Option<f64>| x.map_or("–".to_owned(), |x| format!("{x:.4}"));
        writeln!(f, "{} · {} · seed {}", self.task, self.algo, self.seed)?;
        writeln!(
            f,
            "  test return      {} (best {})",
            number(self.test_return_mean),
            number(self.best_test_return_mean)
        )?;
        if !self.test_facts.is_empty() {
            let facts = self.test_facts.iter().map(|(name, mean)| format!("{} {mean:.3}", fact(name)));
            writeln!(f, "  in that test     {}", facts.collect::<Vec<_>>().join(", "))?;
        }
        if let Some(why) = &self.not_comparable {
            writeln!(f, "  not comparable   {why}")?;
        }
        writeln!(
            f,
            "  environment      {} steps, {} per second, {} update calls",
            thousands(self.t_env),
            thousands(self.env_steps_per_second.round() as u64),
            thousands(self.update_calls)
        )?;
        writeln!(f, "  on the bus       bytes by key")?;
        for (key, bytes) in &self.bytes_by_key {
            writeln!(f, "    {:>14}  {key}", thousands(*bytes))?;
        }
        writeln!(f, "  run folder       {}", self.folder)?;
        write!(f, "  digest           {}", self.digest.as_deref().unwrap_or("–"))
    }
}
