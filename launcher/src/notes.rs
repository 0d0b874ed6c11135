//! Notes for readers of a run's numbers, one line each.

use std::collections::BTreeSet;

use envs::Opponent;
use monitor::Curve;
use proto::config::{Config, EndOfBatch};

use crate::experiment::Experiment;

/// Prints the notes on a new run.
pub fn print(experiment: &Experiment, config: &Config) {
    if let Some(note) = rule_brought(experiment, config) {
        eprintln!("note: {note}");
    }
    print_opponent(config);
}

/// Prints the notes on a run that is resumed.
pub fn print_opponent(config: &Config) {
    if let Some(note) = opponent(config) {
        eprintln!("note: {note}");
    }
}

/// A note if `--profile` or `--paper` sets another rule for the end of a batch than the default. None if the user sets
/// the rule, or the learner does not have it.
fn rule_brought(experiment: &Experiment, config: &Config) -> Option<String> {
    let rule = config.ppo.as_ref()?.end_of_batch;
    let is_set = |setting: &String| {
        let key = setting.split_once('=').map_or(setting.as_str(), |(key, _)| key);
        ["ppo.end_of_batch", "ppo"].contains(&key)
    };
    if experiment.settings.iter().any(is_set) {
        return None;
    }
    let by = experiment.profile.as_ref().map_or("--paper".to_owned(), |name| format!("--profile {name}"));
    let what = match rule {
        EndOfBatch::Correct | EndOfBatch::NoBootstrap => return None,
        EndOfBatch::Epymarl => {
            "the reference's rule, which expects further rewards after an episode has ended: foraging teams unlearn by it"
        }
        EndOfBatch::Benchmark2021 => {
            "the rule of 2021, which uses a value in place of the last reward of a batch's longest episodes"
        }
    };
    Some(format!("`{by}` sets ppo.end_of_batch = {rule}, {what}; the default is ppo.end_of_batch = correct"))
}

/// A note if the opponent of a run is not the one of the published tables. None without an opponent, or if its weights
/// come from a file.
pub fn opponent(config: &Config) -> Option<String> {
    opponent_in(&config.world.task, &config.world.opponent)
}

/// [`opponent`] by the task's and the opponent's names.
fn opponent_in(task: &str, opponent: &str) -> Option<String> {
    let has_one = |task: envs::Task| task.with_opponent(&Opponent::Still).is_ok();
    let ours = ["builtin", "random", "still"].contains(&opponent);
    (ours && envs::task(task).is_ok_and(has_one)).then(|| {
        format!(
            "the opponent in {task} is Rondo's own ({opponent}), not the reference's, which is not included: returns \
             do not compare with the paper's tables; `--opponent FILE` loads the reference's weights \
             (envs/opponents/README.md)"
        )
    })
}

/// Notes on curves that are compared, one line each.
pub fn on_curves(curves: &[Curve]) -> BTreeSet<String> {
    let opponent = |curve: &Curve| opponent_in(&curve.task, curve.settings.get("world.opponent")?);
    curves.iter().filter_map(opponent).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both notes on a run that these words ask for.
    fn notes(task: &str, algo: &str, change: impl FnOnce(&mut Experiment)) -> [Option<String>; 2] {
        let mut experiment = Experiment::of(task, algo);
        change(&mut experiment);
        let config = experiment.configure("run").unwrap();
        [rule_brought(&experiment, &config), opponent(&config)]
    }

    #[test]
    fn a_rule_that_the_profile_or_the_paper_brings_is_named() {
        let epymarl = |by: &str| {
            Some(format!(
                "`{by}` sets ppo.end_of_batch = epymarl, the reference's rule, which expects further rewards after \
                 an episode has ended: foraging teams unlearn by it; the default is ppo.end_of_batch = correct"
            ))
        };
        let rule = |algo: &str, paper: bool, profile: Option<&str>, set: &[&str]| {
            let change = |e: &mut Experiment| {
                e.paper = paper;
                e.profile = profile.map(str::to_owned);
                e.settings = set.iter().map(|&word| word.to_owned()).collect();
            };
            notes("lbf-5x5-2p-1f", algo, change)[0].clone()
        };
        assert_eq!(rule("mtppo", true, None, &[]), epymarl("--paper"));
        assert_eq!(rule("ippo", false, Some("epymarl"), &[]), epymarl("--profile epymarl"));
        assert_eq!(rule("ippo", true, Some("epymarl"), &["algo.hidden=8"]), epymarl("--profile epymarl"));
        let of_2021 = rule("sppo", false, Some("benchmark2021"), &[]).unwrap();
        assert!(
            of_2021.starts_with("`--profile benchmark2021` sets ppo.end_of_batch = benchmark2021, "),
            "{of_2021}"
        );
        // The rule is the default, or the user sets it, or the learner does not have it.
        for (algo, paper, profile, set) in [
            ("mtppo", false, None, &[][..]),
            ("mtppo", false, Some("rondo"), &[]),
            ("mtppo", true, Some("rondo"), &[]),
            ("mtppo", true, None, &["ppo.end_of_batch=correct"]),
            ("mtppo", true, None, &["ppo.end_of_batch=epymarl"]),
            ("mtppo", false, Some("epymarl"), &["ppo.end_of_batch=no_bootstrap"]),
            ("mtql", true, None, &[]),
            ("iql", false, Some("epymarl"), &[]),
        ] {
            assert_eq!(rule(algo, paper, profile, set), None, "{algo} {paper} {profile:?} {set:?}");
        }
    }

    #[test]
    fn an_opponent_of_ours_is_said_not_to_be_the_papers() {
        for (task, canonical) in
            [("mpe-simple-tag", "mpe-simple-tag-2021"), ("mpe-simple-adversary", "mpe-simple-adversary-2021")]
        {
            let [_, note] = notes(task, "mtppo", |e| e.paper = true);
            let expected = format!(
                "the opponent in {canonical} is Rondo's own (builtin), not the reference's, which is not included: \
                 returns do not compare with the paper's tables; `--opponent FILE` loads the reference's weights \
                 (envs/opponents/README.md)"
            );
            assert_eq!(note, Some(expected));
            for who in ["random", "still"] {
                let [_, note] = notes(task, "iql", |e| e.opponent = Some(who.to_owned()));
                assert!(
                    note.is_some_and(|note| note.contains(&format!("Rondo's own ({who})"))),
                    "{task} {who}"
                );
            }
            // A file of weights is named by its digest.
            let mut config = Experiment::of(task, "mtppo").configure("run").unwrap();
            config.world.opponent = store::digest_of(b"weights");
            assert_eq!(opponent(&config), None, "{task}");
        }
        for task in ["mpe-simple-speaker-listener", "lbf-5x5-2p-1f", "rware-tiny-2ag"] {
            assert_eq!(notes(task, "mtppo", |e| e.paper = true)[1], None, "{task}");
        }
    }
}
