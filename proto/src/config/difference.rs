//! The differences between two configurations, and whether a run may be resumed with them.

use std::fmt;

use super::Config;

/// Keys that may change when a run is resumed: its length, when it saves and logs, the transport. All others affect
/// what is learned.
pub const MAY_CHANGE: [&str; 4] = ["t_max", "save.interval", "log.interval", "bus.low_latency"];

/// Longer values are not shown.
const LONGEST: usize = 200;

/// One key with two values, as in the TOML file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// With dots, for example `ppo.gamma`.
    pub key: String,
    /// `None` where the key is absent now.
    pub now: Option<String>,
    /// `None` where the key was absent.
    pub before: Option<String>,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = |value: &Option<String>| match value {
            // The text of a map, which fills a screen.
            Some(value) if value.len() > LONGEST => "a long text".to_owned(),
            Some(value) => value.clone(),
            None => "not set".to_owned(),
        };
        write!(f, "`{}` is {} and was {}", self.key, value(&self.now), value(&self.before))
    }
}

impl Config {
    /// The first key that differs from `before` although a resumed run must not change it: any key except
    /// [`MAY_CHANGE`]. `t_max` must not become smaller.
    pub fn first_difference(&self, before: &Self) -> Option<Difference> {
        let shorter = self.t_max < before.t_max;
        self.differences(before).into_iter().find(|difference| {
            !MAY_CHANGE.contains(&difference.key.as_str()) || (difference.key == "t_max" && shorter)
        })
    }

    /// Every key whose value differs, in alphabetical order.
    pub fn differences(&self, before: &Self) -> Vec<Difference> {
        let (now, before) = (flat(self), flat(before));
        let keys = now.keys().chain(before.keys().filter(|key| !now.contains_key(*key)));
        let mut keys: Vec<&String> = keys.filter(|key| now.get(*key) != before.get(*key)).collect();
        keys.sort_unstable();
        let difference = |key: &String| Difference {
            key: key.clone(),
            now: now.get(key).cloned(),
            before: before.get(key).cloned(),
        };
        keys.into_iter().map(difference).collect()
    }
}

/// Every key with dots, and its value as TOML.
fn flat(config: &Config) -> std::collections::BTreeMap<String, String> {
    fn walk(prefix: &str, table: &toml::Table, flat: &mut std::collections::BTreeMap<String, String>) {
        for (key, value) in table {
            let key = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
            match value {
                toml::Value::Table(table) => walk(&key, table, flat),
                other => drop(flat.insert(key, other.to_string())),
            }
        }
    }
    let table = config.to_toml().parse().expect("a configuration is written as TOML");
    let mut flat_table = std::collections::BTreeMap::new();
    walk("", &table, &mut flat_table);
    flat_table
}

#[cfg(test)]
mod tests {
    use crate::config::{AlgoName, Config};
    use crate::presets::{config, Family};

    fn before() -> Config {
        config("test", "any", 2, AlgoName::Ippo, Family::Lbf)
    }

    #[test]
    fn a_run_may_become_longer_and_save_at_other_times() {
        let mut now = before();
        now.t_max += 1;
        now.save.interval += 1;
        now.log.interval += 1;
        now.bus.low_latency = !now.bus.low_latency;
        assert_eq!(now.first_difference(&before()), None);
        assert_eq!(now.differences(&before()).len(), 4);
    }

    #[test]
    fn what_decides_the_result_may_not_change() {
        let text = |change: fn(&mut Config)| {
            let mut now = before();
            change(&mut now);
            now.first_difference(&before()).map(|difference| difference.to_string())
        };
        let seed = text(|c| c.seed = 7).unwrap();
        assert_eq!(seed, "`seed` is 7 and was 1");
        assert!(text(|c| c.world.task = "other".to_owned())
            .unwrap()
            .starts_with("`world.task` is \"other\" and was"));
        assert!(text(|c| c.ppo.as_mut().unwrap().entropy_coef = 0.5)
            .unwrap()
            .starts_with("`ppo.entropy_coef` is 0.5 and was"));
        assert!(text(|c| c.t_max -= 1).unwrap().starts_with("`t_max` is "));
        let map = text(|c| c.world.map = Some("x".repeat(300))).unwrap();
        assert_eq!(map, "`world.map` is a long text and was not set");
        assert!(text(|c| c.ppo = None).unwrap().contains("is not set and was"));
    }
}
