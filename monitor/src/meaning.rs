//! Settings that change the meaning of returns: two runs can be compared only if they are equal.

use std::collections::BTreeSet;
use std::fmt;

use crate::Curve;

/// Settings that change the meaning of a return, beside the task with its rules.
pub const MEANING: [&str; 4] = ["world.reward", "world.opponent", "world.pad", "ppo.policy_test"];

const TASK: &str = "world.task";
const REWARD: &str = "world.reward";

/// A setting in which runs differ, with all values it has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    pub key: String,
    pub values: BTreeSet<String>,
}

impl Difference {
    /// Whether it changes the scale of returns, so that a verdict would be meaningless.
    pub fn is_of_scale(&self) -> bool {
        [TASK, REWARD].contains(&self.key.as_str())
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let values: Vec<&str> = self.values.iter().map(String::as_str).collect();
        write!(f, "{} ({})", self.key, values.join(" | "))
    }
}

/// Differences between these runs that change the meaning of returns. Missing settings count as equal.
pub fn differences<'a>(curves: impl Iterator<Item = &'a Curve> + Clone) -> Vec<Difference> {
    let differing = |key: &str| {
        let values: BTreeSet<String> = curves.clone().filter_map(|curve| value(curve, key)).collect();
        (values.len() > 1).then(|| Difference { key: key.to_owned(), values })
    };
    std::iter::once(TASK).chain(MEANING).filter_map(differing).collect()
}

/// Differences among the configurations of one side, whose mean is then over different experiments.
pub fn mixture(curves: &[Curve]) -> Vec<Difference> {
    let keys: BTreeSet<&String> = curves.iter().flat_map(|curve| curve.settings.keys()).collect();
    let differing = |key: &String| {
        let of = |curve: &Curve| curve.settings.get(key).cloned().unwrap_or("unset".to_owned());
        let values: BTreeSet<String> = curves.iter().map(of).collect();
        (values.len() > 1).then(|| Difference { key: key.clone(), values })
    };
    keys.into_iter().filter_map(differing).collect()
}

fn value(curve: &Curve, key: &str) -> Option<String> {
    match key {
        TASK => Some(task(curve)),
        // EPyMARL's name for it; without a scalarisation it takes the sum.
        REWARD => curve.settings.get(REWARD).cloned().or_else(|| {
            match curve.settings.get("common_reward")?.as_str() {
                "True" => {
                    Some(curve.settings.get("reward_scalarisation").map_or("sum", String::as_str).to_owned())
                }
                _ => Some("individual".to_owned()),
            }
        }),
        _ => curve.settings.get(key).cloned(),
    }
}

/// The canonical name, which contains the rules. Curve files of EPyMARL have it in a setting.
fn task(curve: &Curve) -> String {
    let name = curve.settings.get("env_args.key").unwrap_or(&curve.task);
    let Ok(task) = envs::task(name) else { return curve.task.clone() };
    // EPyMARL's wrapper around PettingZoo has rules of its own.
    let task = if name.starts_with("pz-mpe-") { task.with_rules("epymarl").unwrap_or(task) } else { task };
    task.name().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runs::tests::curve;

    fn with(task: &str, settings: &[(&str, &str)]) -> Curve {
        let settings = settings.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned()));
        Curve { task: task.to_owned(), settings: settings.collect(), ..curve("a", 1, &[(0, 0.0)]) }
    }

    fn found(curves: &[Curve]) -> Vec<String> {
        differences(curves.iter()).iter().map(Difference::to_string).collect()
    }

    #[test]
    fn each_setting_that_changes_what_a_return_means_is_named_with_its_values() {
        for (key, one, other) in [
            ("world.reward", "mean", "sum"),
            ("world.opponent", "builtin", "random"),
            ("world.pad", "false", "true"),
            ("ppo.policy_test", "greedy", "sample"),
        ] {
            let curves = [with("lbf-5x5-2p-1f", &[(key, other)]), with("lbf-5x5-2p-1f", &[(key, one)])];
            assert_eq!(found(&curves), [format!("{key} ({one} | {other})")]);
        }
        assert_eq!(
            found(&[with("lbf-5x5-2p-1f", &[]), with("lbf-5x5-2p-1f-v2", &[])]),
            ["world.task (lbf-5x5-2p-1f | lbf-5x5-2p-1f-v2)"]
        );
        let hidden = [with("t", &[("algo.hidden", "64")]), with("t", &[("algo.hidden", "128")])];
        assert!(found(&hidden).is_empty());
        assert_eq!(mixture(&hidden)[0].to_string(), "algo.hidden (128 | 64)");
    }

    #[test]
    fn a_reference_of_the_same_game_is_no_difference() {
        let ours = with("lbf-5x5-2p-1f", &[("world.reward", "sum"), ("world.pad", "false")]);
        let key = ("env_args.key", "lbforaging:Foraging-5x5-2p-1f-v3");
        assert!(found(&[ours.clone(), with("lbf-5x5-2p-1f", &[key, ("common_reward", "True")])]).is_empty());
        let mean = with("lbf-5x5-2p-1f", &[key, ("common_reward", "True"), ("reward_scalarisation", "mean")]);
        assert_eq!(found(&[ours.clone(), mean]), ["world.reward (mean | sum)"]);
        let individual = with("lbf-5x5-2p-1f", &[key, ("common_reward", "False")]);
        assert_eq!(found(&[ours, individual]), ["world.reward (individual | sum)"]);

        let ours = with("mpe-simple-speaker-listener-epymarl", &[]);
        let theirs = with("mpe-speaker-listener", &[("env_args.key", "pz-mpe-simple-speaker-listener-v4")]);
        assert!(found(&[ours, theirs]).is_empty());
    }
}
