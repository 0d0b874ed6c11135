//! The keys of all messages. No other file builds or parses a key.
//!
//! All keys of a run begin with `rondo/{run}/`, so several runs can share one bus. `docs/protocol.md` has a table of
//! keys, senders and receivers.

use thiserror::Error;

/// Longest name of a run, in bytes. It is part of every key and the name of a folder.
pub const MAX_RUN_NAME: usize = 64;

/// The run name cannot be part of a key or the name of a folder.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "run name `{0}` cannot be used: expected 1 to 64 characters out of A-Z, a-z, 0-9, `.`, `_` and `-`, \
     the first of them a letter or a digit"
)]
pub struct RunNameError(pub String);

/// Accepts names that are safe both as one chunk of a key and as the name of a folder.
///
/// # Errors
/// [`RunNameError`] for anything else, also `..` and names that a shell takes for an option.
pub fn check_run_name(run: &str) -> Result<(), RunNameError> {
    let allowed = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_' | b'-');
    let fits = run.len() <= MAX_RUN_NAME
        && run.bytes().all(allowed)
        && run.bytes().next().is_some_and(|first| first.is_ascii_alphanumeric());
    fits.then_some(()).ok_or_else(|| RunNameError(run.to_owned()))
}

/// The meaning of a key. The number is the agent's index, from zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Key {
    /// env-server → this agent only: [`crate::tick::Observe`].
    Observe(u32),
    /// this agent → env-server: [`crate::tick::Act`].
    Act(u32),
    /// query of this agent to the env-server: [`crate::control::Join`]; the reply is [`crate::control::Welcome`].
    Join(u32),
    /// coordinator → every agent: [`crate::control::Rates`]; also a query with [`crate::control::RatesQuery`].
    Schedule,
    /// this agent → coordinator: [`crate::control::Progress`].
    Progress(u32),
    /// this agent → monitors: [`crate::control::Metrics`].
    AgentMetrics(u32),
    /// env-server → monitors: [`crate::control::Metrics`].
    WorldMetrics,
    /// Liveliness token of the env-server.
    AliveWorld,
    /// Liveliness token of the coordinator.
    AliveCoordinator,
    /// Liveliness token of this agent.
    AliveAgent(u32),
}

/// The keys of one run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    /// `rondo/{run}/`, the slash included.
    prefix: String,
}

impl Keys {
    /// # Errors
    /// [`RunNameError`] if the name cannot be part of a key.
    pub fn new(run: &str) -> Result<Self, RunNameError> {
        check_run_name(run)?;
        Ok(Self { prefix: format!("rondo/{run}/") })
    }

    /// The key in full.
    pub fn of(&self, key: Key) -> String {
        let prefix = &self.prefix;
        match key {
            Key::Observe(agent) => format!("{prefix}world/{agent}/observe"),
            Key::Act(agent) => format!("{prefix}agent/{agent}/act"),
            Key::Join(agent) => format!("{prefix}agent/{agent}/join"),
            Key::Schedule => format!("{prefix}schedule"),
            Key::Progress(agent) => format!("{prefix}agent/{agent}/progress"),
            Key::AgentMetrics(agent) => format!("{prefix}agent/{agent}/metrics"),
            Key::WorldMetrics => format!("{prefix}world/metrics"),
            Key::AliveWorld => format!("{prefix}alive/world"),
            Key::AliveCoordinator => format!("{prefix}alive/coordinator"),
            Key::AliveAgent(agent) => format!("{prefix}alive/agent/{agent}"),
        }
    }

    /// env-server → this agent only.
    pub fn observe(&self, agent: u32) -> String {
        self.of(Key::Observe(agent))
    }

    /// This agent → env-server.
    pub fn act(&self, agent: u32) -> String {
        self.of(Key::Act(agent))
    }

    /// Query of this agent to the env-server.
    pub fn join(&self, agent: u32) -> String {
        self.of(Key::Join(agent))
    }

    /// Coordinator → every agent; the same key answers queries.
    pub fn schedule(&self) -> String {
        self.of(Key::Schedule)
    }

    /// This agent → coordinator.
    pub fn progress(&self, agent: u32) -> String {
        self.of(Key::Progress(agent))
    }

    /// This agent → monitors.
    pub fn agent_metrics(&self, agent: u32) -> String {
        self.of(Key::AgentMetrics(agent))
    }

    /// env-server → monitors.
    pub fn world_metrics(&self) -> String {
        self.of(Key::WorldMetrics)
    }

    /// Liveliness token of the env-server.
    pub fn alive_world(&self) -> String {
        self.of(Key::AliveWorld)
    }

    /// Liveliness token of the coordinator.
    pub fn alive_coordinator(&self) -> String {
        self.of(Key::AliveCoordinator)
    }

    /// Liveliness token of this agent.
    pub fn alive_agent(&self, agent: u32) -> String {
        self.of(Key::AliveAgent(agent))
    }

    /// Key expression of all agents' joins; the env-server serves it.
    pub fn any_join(&self) -> String {
        format!("{}agent/*/join", self.prefix)
    }

    /// Key expression of all agents' progress; the coordinator subscribes to it.
    pub fn any_progress(&self) -> String {
        format!("{}agent/*/progress", self.prefix)
    }

    /// Key expression of all agents' metrics; the env-server's are under [`Keys::world_metrics`].
    pub fn any_agent_metrics(&self) -> String {
        format!("{}agent/*/metrics", self.prefix)
    }

    /// Key expression of all liveliness tokens of the run.
    pub fn any_alive(&self) -> String {
        format!("{}alive/**", self.prefix)
    }

    /// The meaning of a key of this run. `None` for other runs, unknown keys and anything that [`Keys::of`] would spell
    /// otherwise, so that each agent has one name.
    pub fn parse(&self, key: &str) -> Option<Key> {
        let rest = key.strip_prefix(&self.prefix)?;
        let mut chunks = rest.split('/');
        let mut next = || chunks.next();
        let parsed = match (next()?, next(), next(), next()) {
            ("schedule", None, None, None) => Key::Schedule,
            ("world", Some("metrics"), None, None) => Key::WorldMetrics,
            ("world", Some(agent), Some("observe"), None) => Key::Observe(index(agent)?),
            ("agent", Some(agent), Some("act"), None) => Key::Act(index(agent)?),
            ("agent", Some(agent), Some("join"), None) => Key::Join(index(agent)?),
            ("agent", Some(agent), Some("progress"), None) => Key::Progress(index(agent)?),
            ("agent", Some(agent), Some("metrics"), None) => Key::AgentMetrics(index(agent)?),
            ("alive", Some("world"), None, None) => Key::AliveWorld,
            ("alive", Some("coordinator"), None, None) => Key::AliveCoordinator,
            ("alive", Some("agent"), Some(agent), None) => Key::AliveAgent(index(agent)?),
            _ => return None,
        };
        Some(parsed)
    }
}

/// A decimal index without sign or leading zeros.
fn index(text: &str) -> Option<u32> {
    let plain = text.bytes().all(|b| b.is_ascii_digit()) && (text == "0" || !text.starts_with('0'));
    if plain {
        text.parse().ok()
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys() -> Keys {
        Keys::new("lbf-8x8.s1").unwrap()
    }

    #[test]
    fn keys_are_spelt_as_the_protocol_says() {
        let keys = keys();
        assert_eq!(keys.observe(0), "rondo/lbf-8x8.s1/world/0/observe");
        assert_eq!(keys.act(12), "rondo/lbf-8x8.s1/agent/12/act");
        assert_eq!(keys.join(1), "rondo/lbf-8x8.s1/agent/1/join");
        assert_eq!(keys.schedule(), "rondo/lbf-8x8.s1/schedule");
        assert_eq!(keys.progress(1), "rondo/lbf-8x8.s1/agent/1/progress");
        assert_eq!(keys.agent_metrics(1), "rondo/lbf-8x8.s1/agent/1/metrics");
        assert_eq!(keys.world_metrics(), "rondo/lbf-8x8.s1/world/metrics");
        assert_eq!(keys.alive_world(), "rondo/lbf-8x8.s1/alive/world");
        assert_eq!(keys.alive_coordinator(), "rondo/lbf-8x8.s1/alive/coordinator");
        assert_eq!(keys.alive_agent(3), "rondo/lbf-8x8.s1/alive/agent/3");
        assert_eq!(keys.any_join(), "rondo/lbf-8x8.s1/agent/*/join");
        assert_eq!(keys.any_progress(), "rondo/lbf-8x8.s1/agent/*/progress");
        assert_eq!(keys.any_agent_metrics(), "rondo/lbf-8x8.s1/agent/*/metrics");
        assert_eq!(keys.any_alive(), "rondo/lbf-8x8.s1/alive/**");
    }

    #[test]
    fn every_key_is_parsed_back_to_what_it_stands_for() {
        let keys = keys();
        let all = [
            Key::Observe(0),
            Key::Act(65_534),
            Key::Join(7),
            Key::Schedule,
            Key::Progress(u32::MAX),
            Key::AgentMetrics(10),
            Key::WorldMetrics,
            Key::AliveWorld,
            Key::AliveCoordinator,
            Key::AliveAgent(2),
        ];
        for key in all {
            assert_eq!(keys.parse(&keys.of(key)), Some(key));
        }
    }

    #[test]
    fn foreign_and_misspelt_keys_stand_for_nothing() {
        let keys = keys();
        for key in [
            "",
            "rondo/lbf-8x8.s1",
            "rondo/lbf-8x8.s1/",
            "rondo/other/schedule",
            "rondo/lbf-8x8.s1x/schedule",
            "rondo/lbf-8x8.s1/schedule/",
            "rondo/lbf-8x8.s1/agent/01/act",
            "rondo/lbf-8x8.s1/agent/+1/act",
            "rondo/lbf-8x8.s1/agent//act",
            "rondo/lbf-8x8.s1/agent/4294967296/act",
            "rondo/lbf-8x8.s1/agent/*/act",
            "rondo/lbf-8x8.s1/agent/1/act/x",
            "rondo/lbf-8x8.s1/world/1/act",
            "rondo/lbf-8x8.s1/alive/agent",
        ] {
            assert_eq!(keys.parse(key), None, "{key}");
        }
    }

    #[test]
    fn run_names_that_would_break_a_key_or_a_folder_are_refused() {
        let longest = "a".repeat(64);
        for name in ["a", "8", "lbf_8x8-2p.v3", longest.as_str()] {
            assert_eq!(check_run_name(name), Ok(()));
        }
        let too_long = "a".repeat(65);
        for name in ["", ".", "..", "-x", "_x", "a/b", "a*", "a b", "größe", too_long.as_str()] {
            assert_eq!(check_run_name(name), Err(RunNameError(name.to_owned())), "{name}");
        }
        assert_eq!(
            Keys::new("a/b").unwrap_err().to_string(),
            "run name `a/b` cannot be used: expected 1 to 64 characters out of A-Z, a-z, 0-9, `.`, `_` and `-`, \
             the first of them a letter or a digit"
        );
    }
}
