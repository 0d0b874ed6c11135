//! One number for the result of a run. It is equal for two runs exactly if their weights and metric rows are equal;
//! hosts, kills and restarts do not matter.
//!
//! ```text
//! agent   = blake3( for each tensor by name: text(name), u64 dimensions, u64 sizes…, f32 elements… )
//! metrics = blake3( for world, agent-0, agent-1, …: text(role), u64 bytes, complete lines of metrics.jsonl )
//! digest  = blake3( "rondo digest 1", u64 agents, agent 0, agent 1, …, metrics )
//! text(t) = u64 bytes, t                                                    all little-endian
//! ```

use std::fmt;

use blake3::{Hash, Hasher};
use serde::{Deserialize, Serialize};

use crate::metrics::complete_lines;
use crate::{Error, RunFolder, Tensor};

/// BLAKE3 of some bytes, in lower-case hexadecimal digits. A configuration names a file by it.
pub fn digest_of(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Prefix of the optimiser's tensors. They are needed to resume, but are not part of the result.
const NOT_LEARNED: &str = "adam.";

/// The result of a run as digests, in hexadecimal digits. Serializes as one JSON object; `Display` prints a table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunDigest {
    /// Over all the others.
    pub digest: String,
    /// Over each agent's weights in its latest checkpoint.
    pub agents: Vec<String>,
    /// Over the metric rows of the world and the agents.
    pub metrics: String,
    /// The round of the latest checkpoints.
    pub round: u64,
}

impl fmt::Display for RunDigest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<9} {}", "digest", self.digest)?;
        for (i, agent) in self.agents.iter().enumerate() {
            writeln!(f, "{:<9} {agent}", format!("agent-{i}"))?;
        }
        writeln!(f, "{:<9} {}", "metrics", self.metrics)?;
        write!(f, "{:<9} {}", "round", self.round)
    }
}

/// The digests of a run of which parts are missing here: one per agent, and none over all of them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PartialDigest {
    /// Always `None`: a part of a run has no digest.
    pub digest: Option<String>,
    /// Over each agent's weights in its latest checkpoint; `None` without a checkpoint.
    pub agents: Vec<Option<String>>,
    /// The round of each agent's latest checkpoint.
    pub rounds: Vec<Option<u64>>,
}

impl fmt::Display for PartialDigest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<9} none, this is a part of a run", "digest")?;
        for (i, (agent, round)) in self.agents.iter().zip(&self.rounds).enumerate() {
            write!(f, "\n{:<9} ", format!("agent-{i}"))?;
            match (agent, round) {
                (Some(agent), Some(round)) => write!(f, "{agent} (round {round})")?,
                _ => write!(f, "missing")?,
            }
        }
        Ok(())
    }
}

/// Digests those of the run's `agents` that have a checkpoint here.
///
/// # Errors
/// If a checkpoint cannot be read.
pub fn partial_digest(run: &RunFolder, agents: usize) -> Result<PartialDigest, Error> {
    let here = run.roles()?;
    let latest = agent_names(agents)
        .map(|name| match here.contains(&name).then(|| agent_digest(run, &name)) {
            None | Some(Err(Error::NoCheckpoint { .. })) => Ok(None),
            Some(latest) => latest.map(Some),
        })
        .collect::<Result<Vec<_>, _>>()?;
    Ok(PartialDigest {
        digest: None,
        agents: latest.iter().map(|latest| latest.map(|(_, agent)| hex(&agent))).collect(),
        rounds: latest.iter().map(|latest| latest.map(|(round, _)| round)).collect(),
    })
}

/// Digests the latest checkpoints of all `agents`, and the metric rows of the world and the agents.
///
/// # Errors
/// [`Error::MissingRoles`] if the world or an agent has no folder here, [`Error::NoCheckpoint`] if an agent has no
/// complete checkpoint, [`Error::RoundsDiffer`] if the latest ones are of different rounds, [`Error::NoMetrics`] if a
/// role's metric rows are missing, [`Error::MissingRows`] if some of them are. In each of these cases there is a [`partial_digest`].
pub fn digest(run: &RunFolder, agents: usize) -> Result<RunDigest, Error> {
    let names = role_names(run, agents)?;
    let agents = &names[1..];
    let latest = agents.iter().map(|name| agent_digest(run, name)).collect::<Result<Vec<_>, _>>()?;
    let (first_round, _) = latest[0]; // A run has at least one agent.
    if let Some(i) = latest.iter().position(|&(round, _)| round != first_round) {
        return Err(Error::RoundsDiffer {
            first: agents[0].clone(),
            first_round,
            other: agents[i].clone(),
            other_round: latest[i].0,
        });
    }

    let mut hasher = Hasher::new();
    for name in &names {
        run.check_rows(name)?;
        let lines = complete_lines(&run.role(name)?.metrics_path())?;
        put_text(&mut hasher, name);
        put_number(&mut hasher, lines.len());
        hasher.update(&lines);
    }
    let metrics = hasher.finalize();

    let mut hasher = Hasher::new();
    hasher.update(b"rondo digest 1");
    put_number(&mut hasher, latest.len());
    for part in latest.iter().map(|(_, agent)| agent).chain([&metrics]) {
        hasher.update(part.as_bytes());
    }
    Ok(RunDigest {
        digest: hex(&hasher.finalize()),
        agents: latest.iter().map(|(_, agent)| hex(agent)).collect(),
        metrics: hex(&metrics),
        round: first_round,
    })
}

/// The world and all agents. Other files are not part of the run's result.
fn role_names(run: &RunFolder, agents: usize) -> Result<Vec<String>, Error> {
    let here = run.roles()?;
    let names: Vec<String> = std::iter::once("world".to_owned()).chain(agent_names(agents)).collect();
    let missing: Vec<String> = names.iter().filter(|name| !here.contains(name)).cloned().collect();
    if missing.is_empty() {
        return Ok(names);
    }
    Err(Error::MissingRoles { path: run.path().to_owned(), roles: missing })
}

fn agent_names(agents: usize) -> impl Iterator<Item = String> {
    (0..agents.max(1)).map(|agent| format!("agent-{agent}"))
}

fn agent_digest(run: &RunFolder, name: &str) -> Result<(u64, Hash), Error> {
    let role = run.role(name)?;
    let checkpoints = role.checkpoints();
    let Some(&round) = checkpoints.rounds()?.last() else {
        return Err(Error::NoCheckpoint { path: role.path().to_owned() });
    };
    let mut hasher = Hasher::new();
    for tensor in
        checkpoints.load(round)?.tensors.iter().filter(|tensor| !tensor.name.starts_with(NOT_LEARNED))
    {
        put_tensor(&mut hasher, tensor);
    }
    Ok((round, hasher.finalize()))
}

fn put_tensor(hasher: &mut Hasher, tensor: &Tensor) {
    put_text(hasher, &tensor.name);
    put_number(hasher, tensor.shape.len());
    tensor.shape.iter().for_each(|&size| put_number(hasher, size));
    hasher.update(&tensor.bytes());
}

fn put_text(hasher: &mut Hasher, text: &str) {
    put_number(hasher, text.len());
    hasher.update(text.as_bytes());
}

fn put_number(hasher: &mut Hasher, number: usize) {
    hasher.update(&(number as u64).to_le_bytes());
}

fn hex(hash: &Hash) -> String {
    hash.to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::{Checkpoint, Position, Row};

    const LAST: u64 = 30;

    struct Run {
        _tmp: tempfile::TempDir,
        folder: RunFolder,
    }

    impl Run {
        /// A run of two agents that has ended.
        fn new() -> Self {
            let tmp = tempfile::tempdir().unwrap();
            let folder = RunFolder::create(tmp.path().join("a"), "").unwrap();
            let run = Self { _tmp: tmp, folder };
            run.role("coordinator");
            for name in ["world", "agent-0", "agent-1"] {
                let mut metrics = run.role(name).metrics(Position::START).unwrap();
                metrics.append(&Row::of_learner(362, 1).with("loss", 0.5)).unwrap();
            }
            run.save("agent-0", LAST, |_| ());
            run.save("agent-1", LAST, |_| ());
            run
        }

        fn role(&self, name: &str) -> crate::RoleFolder {
            self.folder.role(name).unwrap()
        }

        fn save(&self, role: &str, round: u64, change: impl Fn(&mut Checkpoint)) {
            let tensor = |name: &str, shape: &[usize]| Tensor {
                name: format!("{name}.w"),
                shape: shape.into(),
                data: vec![0.5; 6],
            };
            let tensors = vec![tensor("critic", &[6]), tensor("actor", &[2, 3]), tensor("adam.actor", &[6])];
            let mut checkpoint = Checkpoint { round, state: b"{}".to_vec(), tensors };
            change(&mut checkpoint);
            self.role(role).checkpoints().save(&checkpoint).unwrap();
        }

        fn digest(&self) -> RunDigest {
            digest(&self.folder, 2).unwrap()
        }

        fn refusal(&self) -> String {
            let error = digest(&self.folder, 2).unwrap_err();
            assert!(error.is_unfinished() && !error.is_config() && !error.is_io());
            error.to_string().replace(&self.folder.path().display().to_string(), "RUN")
        }
    }

    #[test]
    fn equal_runs_have_equal_digests() {
        let (run, other) = (Run::new(), Run::new());
        assert_eq!(run.digest(), other.digest());
        assert_eq!(run.digest().round, LAST);
        assert_eq!(run.digest().agents[0], run.digest().agents[1]);
    }

    #[test]
    fn an_agents_digest_is_over_names_shapes_and_bytes_in_order() {
        let half = 0.5_f32.to_le_bytes().repeat(6);
        let n = |number: u64| number.to_le_bytes();
        let bytes = [
            &n(7)[..],
            b"actor.w",
            &n(2),
            &n(2),
            &n(3),
            &half, //
            &n(8),
            b"critic.w",
            &n(1),
            &n(6),
            &half,
        ]
        .concat();
        assert_eq!(Run::new().digest().agents[0], blake3::hash(&bytes).to_hex().as_str());
    }

    #[test]
    fn one_bit_of_a_weight_changes_that_agents_digest_alone() {
        let run = Run::new();
        let before = run.digest();
        run.save("agent-1", LAST, |checkpoint| {
            let weight = &mut checkpoint.tensors[1].data[5];
            *weight = f32::from_bits(weight.to_bits() ^ 1);
        });
        let after = run.digest();
        assert_ne!(after.digest, before.digest);
        assert_ne!(after.agents[1], before.agents[1]);
        assert_eq!((&after.agents[0], &after.metrics), (&before.agents[0], &before.metrics));
    }

    #[test]
    fn a_name_or_shape_counts_but_not_the_optimiser_the_state_or_the_order() {
        let run = Run::new();
        let before = run.digest();
        let changed = |change: fn(&mut Checkpoint)| {
            run.save("agent-0", LAST, change);
            run.digest() != before
        };
        assert!(changed(|checkpoint| checkpoint.tensors[1].shape = vec![3, 2]));
        assert!(changed(|checkpoint| checkpoint.tensors[0].name = "critic.v".into()));
        assert!(changed(|checkpoint| drop(checkpoint.tensors.remove(0))));
        assert!(!changed(|checkpoint| checkpoint.tensors[2].data[0] = 9.0));
        assert!(!changed(|checkpoint| checkpoint.state = b"other".to_vec()));
        assert!(!changed(|checkpoint| checkpoint.tensors.reverse()));
    }

    #[test]
    fn one_byte_of_a_metric_row_changes_the_metrics_digest_but_a_torn_line_does_not() {
        for role in ["world", "agent-0", "agent-1"] {
            let run = Run::new();
            let before = run.digest();
            let path = run.role(role).metrics_path();
            let text = fs::read_to_string(&path).unwrap();
            fs::write(&path, format!("{text}{{\"t_env\":7")).unwrap();
            assert_eq!(run.digest(), before);
            fs::write(&path, text.replace("0.5", "0.4")).unwrap();
            let after = run.digest();
            assert_ne!((&after.digest, &after.metrics), (&before.digest, &before.metrics));
            assert_eq!(after.agents, before.agents);
        }
    }

    #[test]
    fn a_row_that_moves_to_another_role_changes_the_digest() {
        let run = Run::new();
        let before = run.digest();
        fs::write(run.role("agent-0").metrics_path(), "").unwrap();
        let path = run.role("agent-1").metrics_path();
        fs::write(&path, fs::read_to_string(&path).unwrap().repeat(2)).unwrap();
        assert_ne!(run.digest().metrics, before.metrics);
    }

    #[test]
    fn an_agent_whose_checkpoints_are_all_damaged_is_named() {
        let run = Run::new();
        fs::remove_file(run.role("agent-1").path().join("checkpoints/round-000000000030/manifest.json"))
            .unwrap();
        assert!(run.refusal().starts_with("`RUN/agent-1` has no complete checkpoint\nhint: "));
    }

    #[test]
    fn agents_that_stopped_at_different_rounds_have_no_digest() {
        let run = Run::new();
        run.save("agent-1", 40, |_| ());
        assert!(run.refusal().starts_with(
            "the agents' latest checkpoints are of different rounds: agent-0 has 30, agent-1 has 40\n"
        ));
    }

    #[test]
    fn a_part_of_a_run_has_no_digest_but_its_agents_have() {
        let run = Run::new();
        let whole = run.digest();
        run.save("agent-0", 40, |_| ());
        assert!(run.refusal().starts_with("the agents' latest checkpoints are of different rounds"));
        fs::remove_dir_all(run.role("agent-1").path()).unwrap();
        let hint = "\nhint: a role that ran on another host keeps its folder there, copy it here; a run without a checkpoint \
                    continues with `rondo resume`";
        assert_eq!(run.refusal(), format!("`RUN` has no folder of agent-1{hint}"));
        let part = partial_digest(&run.folder, 2).unwrap();
        assert_eq!(
            (&part.agents, &part.rounds),
            (&vec![whole.agents.first().cloned(), None], &vec![Some(40), None])
        );
        assert_eq!(
            part.to_string(),
            format!(
                "digest    none, this is a part of a run\nagent-0   {} (round 40)\nagent-1   missing",
                whole.agents[0]
            )
        );
        assert_eq!(
            serde_json::to_string(&part).unwrap(),
            format!(r#"{{"digest":null,"agents":["{}",null],"rounds":[40,null]}}"#, whole.agents[0])
        );
        assert!(!run.folder.path().join("agent-1").exists(), "reading creates nothing");
        fs::remove_dir_all(run.role("world").path()).unwrap();
        assert_eq!(run.refusal(), format!("`RUN` has no folder of world, agent-1{hint}"));
    }

    #[test]
    fn a_role_whose_metric_rows_were_not_copied_is_named() {
        for role in ["world", "agent-1"] {
            let run = Run::new();
            fs::remove_file(run.role(role).metrics_path()).unwrap();
            assert!(run.refusal().starts_with(&format!("there is no `RUN/{role}/metrics.jsonl`\nhint: ")));
        }
    }

    #[test]
    fn rows_that_the_latest_checkpoint_counts_on_and_that_are_cut_off_are_counted() {
        let run = Run::new();
        let role = run.role("agent-1");
        let mut metrics = role.metrics(Position::START).unwrap();
        for calls in 1..=3 {
            metrics.append(&Row::of_learner(100 * calls, calls).with("loss", 0.5)).unwrap();
        }
        let state = serde_json::json!({ "metrics": metrics.sync().unwrap(), "counters": [1] });
        run.save("agent-1", LAST, |checkpoint| checkpoint.state = state.to_string().into_bytes());
        let whole = run.digest();
        // A row behind them, whole or in part, does no harm.
        let rows = fs::read_to_string(role.metrics_path()).unwrap();
        fs::write(role.metrics_path(), format!("{rows}{{\"t_env\":400")).unwrap();
        assert_eq!(run.digest(), whole);
        for cut in [1, 40] {
            fs::write(role.metrics_path(), &rows[..rows.len() - cut]).unwrap();
            assert_eq!(
                run.refusal(),
                "`RUN/agent-1/metrics.jsonl` has 2 whole rows, the latest checkpoint counts on 3\n\
                 hint: the file was cut or copied in part, copy it again"
            );
        }
    }

    #[test]
    fn agents_are_counted_as_the_run_has_them() {
        let run = Run::new();
        let two = run.digest();
        run.role("agent-5");
        assert_eq!(run.digest(), two);
        assert!(matches!(digest(&run.folder, 3), Err(Error::MissingRoles { .. })));
    }

    #[test]
    fn a_digest_is_one_line_for_programs_and_a_table_for_people() {
        let digest = RunDigest {
            digest: "d1".into(),
            agents: vec!["a0".into(), "a1".into()],
            metrics: "3e".into(),
            round: 7,
        };
        assert_eq!(
            serde_json::to_string(&digest).unwrap(),
            r#"{"digest":"d1","agents":["a0","a1"],"metrics":"3e","round":7}"#
        );
        assert_eq!(digest.to_string(), "digest    d1\nagent-0   a0\nagent-1   a1\nmetrics   3e\nround     7");
    }
}
