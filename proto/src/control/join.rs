//! Joining: an agent requests its seat, and the env-server grants or refuses it.

use crate::codec::Message;
use crate::config::limits;
use serde::{Deserialize, Serialize};
use std::fmt;

/// An agent's request for its seat in the run. The key names the seat.
///
/// - key: query on `agent/{i}/join`
/// - from agent i to the env-server, which replies with [`Welcome`]
/// - if lost: sent again; the same `nonce` gets the same seat again
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Join {
    /// [`crate::config::Config::digest`] of the configuration this agent runs with.
    pub config_digest: [u8; 32],
    /// Random per process. Separates a retry from a second process with this id.
    pub nonce: u64,
    /// Rounds that this agent can start from, ascending: those of its valid checkpoints, and 0 if it had a seat in
    /// this run before. Empty if the agent's folder is new.
    pub checkpoints: Vec<u64>,
}

impl Message for Join {
    const TAG: u8 = 3;
    const NAME: &'static str = "Join";
    const MAX_BYTES: usize = 4096;

    fn check(&self) -> Result<(), String> {
        if !self.checkpoints.is_sorted_by(|a, b| a < b) {
            return Err("the checkpoints are not strictly increasing".to_owned());
        }
        Ok(())
    }
}

/// The answer to [`Join`].
///
/// - key: reply to the query on `agent/{i}/join`
/// - from the env-server to agent i
/// - if lost: the agent sends its request again
///
/// The env-server holds the query until all agents have joined. Only then is the round known from which all of them
/// can start.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Welcome {
    Seat(Seat),
    Refused(Refusal),
}

impl Message for Welcome {
    const TAG: u8 = 4;
    const NAME: &'static str = "Welcome";
    const MAX_BYTES: usize = 1024;

    fn check(&self) -> Result<(), String> {
        match self {
            Self::Seat(seat) => seat.check(),
            Self::Refused(_) => Ok(()),
        }
    }
}

/// What an agent needs before its first tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seat {
    /// Messages of other epochs are ignored.
    pub epoch: u32,
    /// Training rounds completed: start fresh at 0, else load the checkpoint of this round.
    pub round: u64,
    /// Environment steps counted before this round.
    pub t_env: u64,
    /// Agents in the team.
    pub agents: u32,
    /// Numbers in an observation.
    pub obs_size: u32,
    /// Number of actions.
    pub n_actions: u32,
    /// Environment copies, which are the episodes of a training round.
    pub copies: u32,
    /// Episodes in a test.
    pub test_episodes: u32,
    /// Most world steps in an episode.
    pub episode_limit: u32,
}

impl Seat {
    fn check(&self) -> Result<(), String> {
        let widest = u32::from(u16::MAX);
        let bounds = [
            ("agents", self.agents, limits::MAX_AGENTS),
            ("obs_size", self.obs_size, widest),
            ("n_actions", self.n_actions, widest),
            ("copies", self.copies, limits::MAX_COPIES),
            ("test_episodes", self.test_episodes, limits::MAX_TEST_EPISODES),
            ("episode_limit", self.episode_limit, u32::MAX),
        ];
        for (name, value, most) in bounds {
            if !(1..=most).contains(&value) {
                return Err(format!("{name} is {value}: expected 1 to {most}"));
            }
        }
        Ok(())
    }
}

/// Why an agent gets no seat. The text is for the person who started that agent. `ours` is the env-server's value,
/// `theirs` the agent's.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// The agent has another wire version.
    Version { ours: u8, theirs: u8 },
    /// The agent runs with another configuration.
    Config { ours: [u8; 32], theirs: [u8; 32] },
    /// Another living process has this seat.
    IdTaken { id: u32 },
    /// There is no such seat.
    IdOutOfRange { id: u32, agents: u32 },
    /// The request could not be decoded. Made by [`Refusal::malformed`].
    Malformed(String),
    /// The run is ending.
    Closing,
    /// No round is held by every process, and starting at 0 would discard work. Made by [`Refusal::no_common_round`].
    NoCommonRound(String),
}

impl Refusal {
    /// Longest text in a refusal, in bytes.
    const MAX_REASON: usize = 512;

    /// The request could not be decoded, for this reason, which is cut to the size of the message.
    pub fn malformed(reason: impl fmt::Display) -> Self {
        Self::Malformed(cut(reason.to_string(), Self::MAX_REASON))
    }

    /// Which process holds which rounds, cut to the size of the message.
    pub fn no_common_round(who_holds_what: &str) -> Self {
        Self::NoCommonRound(cut(who_holds_what.to_owned(), Self::MAX_REASON))
    }
}

/// At most the first `most` bytes of a text, without half a character at the end.
fn cut(mut text: String, most: usize) -> String {
    let mut end = text.len().min(most);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.truncate(end);
    text
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Version { ours, theirs } => write!(
                f,
                "this agent has wire version {theirs}, the env-server {ours}; \
                 install the same version of rondo on every host"
            ),
            Self::Config { ours, theirs } => write!(
                f,
                "this agent's configuration has the digest {}…, the env-server's {}…; \
                 start both with the same config.toml",
                short_hex(theirs),
                short_hex(ours)
            ),
            Self::IdTaken { id } => write!(
                f,
                "agent {id} has already joined as another process; stop that one, or start this one with another id"
            ),
            Self::IdOutOfRange { id, agents } => {
                write!(f, "there is no agent {id} in a team of {agents}; ids go from 0 to {}", agents.saturating_sub(1))
            }
            Self::Malformed(reason) => write!(
                f,
                "the env-server cannot decode the request to join: {reason}; \
                 install the same version of rondo on every host"
            ),
            Self::Closing => f.write_str("the run is ending and accepts no more agents; resume it to continue"),
            Self::NoCommonRound(who_holds_what) => write!(
                f,
                "no checkpoint is held by every process ({who_holds_what}), so the run does not start\nhint: does \
                 each role have its own old run folder as `--out`? Copy a missing folder there. `--start-over` at the \
                 env-server starts from the beginning and sets the old state aside"
            ),
        }
    }
}

impl std::error::Error for Refusal {}

/// The beginning of a digest, enough to see that two differ.
fn short_hex(digest: &[u8; 32]) -> String {
    digest[..6].iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::{decode, encode, WireError};

    fn seat() -> Seat {
        Seat {
            epoch: 1,
            round: 40_000,
            t_env: 20_000_000,
            agents: 3,
            obs_size: 18,
            n_actions: 6,
            copies: 10,
            test_episodes: 100,
            episode_limit: 50,
        }
    }

    #[test]
    fn a_join_comes_back_as_it_was_sent() {
        let join = Join { config_digest: [7; 32], nonce: u64::MAX, checkpoints: vec![0, 250, 70_000] };
        assert_eq!(decode(&encode(&join).unwrap()), Ok(join));
    }

    #[test]
    fn a_join_that_is_cut_off_anywhere_says_what_came_and_what_was_expected() {
        let join = Join { config_digest: [7; 32], nonce: u64::MAX, checkpoints: vec![0, 250, 70_000] };
        let bytes = encode(&join).unwrap();
        for found in 2..bytes.len() {
            let error = decode::<Join>(&bytes[..found]).unwrap_err();
            let WireError::CutOff { name: "Join", expected, .. } = error else { panic!("{error:?}") };
            assert!((found + 1..=bytes.len()).contains(&expected), "{found} of {}: {expected}", bytes.len());
            let text = format!("Join message of {found} bytes is cut off: expected at least {expected}");
            assert_eq!(error.to_string(), text);
        }
        assert_eq!(
            decode::<Join>(&[]).unwrap_err().to_string(),
            "Join message of 0 bytes: expected at least 2"
        );
    }

    #[test]
    fn a_welcome_that_is_no_welcome_is_refused_in_words() {
        let mut bytes = encode(&Welcome::Refused(Refusal::malformed("é"))).unwrap();
        let text = |bytes: &[u8]| decode::<Welcome>(bytes).unwrap_err().to_string();
        let last = bytes.len() - 1;
        bytes[last] = 0xff;
        assert!(text(&bytes)
            .starts_with(&format!("Welcome message of {} bytes: a text in it is not UTF-8: ", last + 1)));
        bytes[2] = 9;
        assert!(text(&bytes).contains("integer `9`, expected variant index"), "{}", text(&bytes));
        bytes[2] = 255;
        assert!(
            text(&bytes).ends_with(": a number in it has more bytes than expected there"),
            "{}",
            text(&bytes)
        );
    }

    #[test]
    fn checkpoints_out_of_order_are_refused() {
        for checkpoints in [vec![2, 1], vec![5, 5]] {
            let join = Join { config_digest: [7; 32], nonce: 1, checkpoints };
            assert_eq!(
                encode(&join).unwrap_err().to_string(),
                "Join message: the checkpoints are not strictly increasing"
            );
        }
    }

    #[test]
    fn every_welcome_comes_back_as_it_was_sent() {
        let refusals = [
            Refusal::Version { ours: 1, theirs: 2 },
            Refusal::Config { ours: [0; 32], theirs: [255; 32] },
            Refusal::IdTaken { id: 3 },
            Refusal::IdOutOfRange { id: 3, agents: 3 },
            Refusal::malformed("Join message: …"),
            Refusal::Closing,
        ];
        let all = refusals.map(Welcome::Refused).into_iter().chain([Welcome::Seat(seat())]);
        for welcome in all {
            assert_eq!(decode(&encode(&welcome).unwrap()), Ok(welcome));
        }
    }

    #[test]
    fn a_seat_in_an_impossible_run_is_refused() {
        let refused = |seat: Seat| encode(&Welcome::Seat(seat)).unwrap_err();
        let value = |what: &str| WireError::Value { name: "Welcome", what: what.to_owned() };
        assert_eq!(refused(Seat { agents: 0, ..seat() }), value("agents is 0: expected 1 to 65535"));
        assert_eq!(
            refused(Seat { obs_size: 65_536, ..seat() }),
            value("obs_size is 65536: expected 1 to 65535")
        );
        assert_eq!(refused(Seat { copies: 10_001, ..seat() }), value("copies is 10001: expected 1 to 10000"));
    }

    #[test]
    fn a_long_reason_is_cut_between_characters() {
        let refusal = Refusal::malformed("é".repeat(300) + "x");
        assert_eq!(refusal, Refusal::Malformed("é".repeat(256)));
        let odd = Refusal::malformed("x".to_owned() + &"é".repeat(300));
        assert_eq!(odd, Refusal::Malformed("x".to_owned() + &"é".repeat(255)));
        encode(&Welcome::Refused(odd)).unwrap();
    }

    #[test]
    fn refusals_say_what_to_do() {
        let texts = [
            Refusal::Config { ours: [0xab; 32], theirs: [1; 32] },
            Refusal::IdTaken { id: 2 },
            Refusal::IdOutOfRange { id: 3, agents: 3 },
        ]
        .map(|refusal| refusal.to_string());
        assert_eq!(
            texts,
            [
                "this agent's configuration has the digest 010101010101…, the env-server's abababababab…; \
                 start both with the same config.toml",
                "agent 2 has already joined as another process; stop that one, or start this one with another id",
                "there is no agent 3 in a team of 3; ids go from 0 to 2",
            ]
        );
    }
}
