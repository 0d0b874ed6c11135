//! `rondo eval`: plays episodes with a trained team and reports its returns.

use std::collections::BTreeMap;
use std::path::PathBuf;

use algos::learner::Choice;
use env_server::Played;
use process::Failure;
use proto::config::{Learner, PolicyTest};
use proto::exit;
use serde::Serialize;

use crate::notes;
use crate::team::Team;

/// The result's file in the run folder, without `--json`.
const FILE: &str = "evaluation.json";

/// Options of commands that let a trained team play.
#[derive(Debug, Clone, clap::Args)]
pub struct Playing {
    /// Random seed of the episodes
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Take the most probable actions instead of sampling (Q-learning always takes the best)
    #[arg(long, conflicts_with = "sample")]
    pub greedy: bool,
    /// Sample actions from the policy, even if the run's own tests do not
    #[arg(long)]
    pub sample: bool,
}

impl Playing {
    /// Applies the options to a team. Returns how it will act, in one word.
    ///
    /// # Errors
    /// If its algorithm does not have these options.
    pub fn prepare(&self, team: &mut Team) -> Result<&'static str, Failure> {
        let name = team.config.algo.name;
        if name.learner() == Learner::Q {
            if self.sample {
                let text =
                    format!("`--sample`: {name} has no probabilities to draw from, it takes the best action");
                return Err(Failure::new(exit::USAGE, text));
            }
            return Ok("greedy");
        }
        let as_configured = team.config.ppo.as_ref().map(|ppo| ppo.policy_test);
        let greedy = self.greedy || (!self.sample && as_configured == Some(PolicyTest::Greedy));
        team.choose(if greedy { Choice::Greedy } else { Choice::Sample });
        Ok(if greedy { "greedy" } else { "sample" })
    }
}

/// Play episodes with the trained agents of a run, without learning
#[derive(Debug, Clone, clap::Args)]
pub struct Eval {
    /// The run folder
    run: PathBuf,
    /// Episodes to play
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    episodes: u32,
    #[command(flatten)]
    playing: Playing,
    /// Where to write the result as JSON; without it `evaluation.json` in the run folder, if that can be written to
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Serialize)]
struct Evaluation<'a> {
    task: &'a str,
    algo: &'static str,
    /// Training rounds before.
    round: u64,
    seed: u64,
    episodes: usize,
    actions: &'static str,
    return_mean: f64,
    /// Why these returns do not compare with published tables, if a reader could compare them.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_comparable: Option<String>,
    /// Divisor `k`, as in tests (algorithms §8.2).
    return_std: f64,
    /// Sample standard deviation (divisor `k - 1`) over the root of `k`; `None` for a single episode.
    return_stderr: Option<f64>,
    ep_length_mean: f64,
    /// Means of what the world reports of an episode, by name.
    #[serde(flatten)]
    facts: BTreeMap<String, f64>,
    /// Each agent's own.
    agent_return_means: Vec<f64>,
    returns: Vec<f64>,
}

impl Eval {
    pub fn run(&self) -> Result<(), Failure> {
        process::start_logs(None);
        let mut team = Team::open(&self.run)?;
        let actions = self.playing.prepare(&mut team)?;
        let worlds = team.play(self.episodes, self.playing.seed, |_, _| Ok(()))?;
        let returns: Vec<f64> = worlds.played().map(|episode| episode.episode_return).collect();
        let k = returns.len() as f64;
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / k;
        let return_mean = mean(&mut returns.iter().copied());
        let squares = returns.iter().map(|r| (r - return_mean).powi(2)).sum::<f64>();
        let evaluation = Evaluation {
            task: &team.config.world.task,
            algo: team.config.algo.name.as_str(),
            round: team.round,
            seed: self.playing.seed,
            episodes: returns.len(),
            actions,
            return_mean,
            not_comparable: notes::opponent(&team.config),
            return_std: (squares / k).sqrt(),
            return_stderr: (k > 1.0).then(|| (squares / (k - 1.0)).sqrt() / k.sqrt()),
            ep_length_mean: mean(&mut worlds.played().map(|episode| episode.length as f64)),
            facts: means_of_facts(worlds.played()),
            agent_return_means: (0..team.config.world.agents as usize)
                .map(|agent| mean(&mut worlds.played().map(|episode| episode.returns[agent])))
                .collect(),
            returns,
        };
        println!("{} · {} · after round {}", evaluation.task, evaluation.algo, evaluation.round);
        let stderr = evaluation.return_stderr.map_or("–".to_owned(), |e| format!("{e:.4}"));
        println!(
            "  return_mean      {:.4} (standard error {stderr}, standard deviation {:.4})",
            evaluation.return_mean, evaluation.return_std
        );
        if let Some(why) = &evaluation.not_comparable {
            println!("  not comparable   {why}");
        }
        println!("  ep_length_mean   {:.2}", evaluation.ep_length_mean);
        for (name, mean) in &evaluation.facts {
            println!("  {name:16} {mean:.4}");
        }
        let own: Vec<_> = evaluation.agent_return_means.iter().map(|mean| format!("{mean:.4}")).collect();
        println!("  of each agent    {}", own.join(", "));
        println!("  episodes         {}, seed {}, actions: {actions}", evaluation.episodes, evaluation.seed);
        let path = self.json.clone().unwrap_or_else(|| self.run.join(FILE));
        let text = serde_json::to_string_pretty(&evaluation).map_err(|e| Failure::new(exit::BUG, e))?;
        match std::fs::write(&path, text + "\n") {
            Ok(()) => println!("  written to       {}", path.display()),
            Err(error) if self.json.is_some() => {
                return Err(Failure::new(exit::IO, format!("cannot write {}: {error}", path.display())));
            }
            // Nobody asked for it, and the run may be somebody else's.
            Err(error) => {
                eprintln!("not written to {}: {error}; `--json FILE` writes it elsewhere", path.display());
            }
        }
        Ok(())
    }
}

/// Named as in metric rows.
fn means_of_facts<'a>(played: impl Iterator<Item = Played<'a>>) -> BTreeMap<String, f64> {
    let (mut sums, mut episodes) = (BTreeMap::new(), 0.0);
    for episode in played {
        episodes += 1.0;
        for (name, value) in episode.facts {
            *sums.entry(format!("{name}_mean")).or_insert(0.0) += value;
        }
    }
    sums.into_iter().map(|(name, sum)| (name, sum / episodes)).collect()
}
