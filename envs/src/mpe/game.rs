//! The three games and the bodies in them, in the reference's order (mpe §1, §2).

use std::ops::Range;

/// The most agents in one game, for arrays on the stack.
pub(super) const MAX_AGENTS: usize = 4;
/// The most numbers that one agent sees.
pub(super) const MAX_OBS: usize = 16;
/// Steps after which every episode ends.
pub(super) const EPISODE_LIMIT: u32 = 25;
/// Words of the speaker, one for each landmark.
pub(super) const WORDS: usize = 3;
/// Nothing and four directions.
pub(super) const MOVES: usize = 5;

/// Force of an action, unless a body has another.
pub(crate) const PUSH: f64 = 5.0;

/// One of the particle games.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Game {
    SpeakerListener,
    Adversary,
    Tag,
}

/// The numbers of a game.
#[derive(Debug)]
pub(crate) struct Layout {
    /// The canonical name of the task.
    pub task: &'static str,
    /// The version of the reference's id whose rules are [`super::Rules::Current`].
    pub version: u32,
    pub agents: &'static [Body],
    pub landmarks: usize,
    pub landmark_radius: f64,
    /// Whether agents bounce off landmarks.
    pub landmarks_collide: bool,
    /// Landmarks start in `[-spread, spread)` on both axes.
    pub spread: f64,
    /// Whether one of the landmarks is a goal.
    pub has_goal: bool,
    /// Length of the communication vectors, also in games without a speaker.
    pub comm_size: usize,
    /// The agents that the learners control.
    pub team: Range<usize>,
    /// The agent that they do not control.
    pub opponent: Option<usize>,
}

/// An agent's body, and what it sees and can do.
#[derive(Debug, PartialEq)]
pub(crate) struct Body {
    pub name: &'static str,
    pub radius: f64,
    pub movable: bool,
    pub collides: bool,
    /// Force of an action; mass is 1.
    pub push: f64,
    pub max_speed: Option<f64>,
    pub obs_size: usize,
    pub n_actions: usize,
}

const SPEAKER: Body = Body {
    name: "speaker_0",
    radius: 0.075,
    movable: false,
    collides: false,
    push: PUSH,
    max_speed: None,
    obs_size: 3,
    n_actions: WORDS,
};

const LISTENER: Body = Body { name: "listener_0", movable: true, obs_size: 11, n_actions: MOVES, ..SPEAKER };

const fn of_adversary(name: &'static str, obs_size: usize) -> Body {
    Body { name, radius: 0.15, obs_size, ..LISTENER }
}

const fn predator(name: &'static str) -> Body {
    Body { name, collides: true, push: 3.0, max_speed: Some(1.0), obs_size: 16, ..LISTENER }
}

const PREY: Body =
    Body { name: "agent_0", radius: 0.05, push: 4.0, max_speed: Some(1.3), obs_size: 14, ..predator("") };

static SPEAKER_LISTENER: Layout = Layout {
    task: "mpe-simple-speaker-listener",
    version: 4,
    agents: &[SPEAKER, LISTENER],
    landmarks: 3,
    landmark_radius: 0.04,
    landmarks_collide: false,
    spread: 1.0,
    has_goal: true,
    comm_size: WORDS,
    team: 0..2,
    opponent: None,
};

static ADVERSARY: Layout = Layout {
    task: "mpe-simple-adversary",
    version: 3,
    agents: &[of_adversary("adversary_0", 8), of_adversary("agent_0", 10), of_adversary("agent_1", 10)],
    landmarks: 2,
    landmark_radius: 0.08,
    landmarks_collide: false,
    spread: 1.0,
    has_goal: true,
    comm_size: 2,
    team: 1..3,
    opponent: Some(0),
};

static TAG: Layout = Layout {
    task: "mpe-simple-tag",
    version: 3,
    agents: &[predator("adversary_0"), predator("adversary_1"), predator("adversary_2"), PREY],
    landmarks: 2,
    landmark_radius: 0.2,
    landmarks_collide: true,
    spread: 0.9,
    has_goal: false,
    comm_size: 2,
    team: 0..3,
    opponent: Some(3),
};

impl Layout {
    /// Whether this agent's actions are words instead of forces.
    pub fn speaks(&self, agent: usize) -> bool {
        !self.agents[agent].movable
    }
}

impl Game {
    pub const ALL: [Game; 3] = [Game::SpeakerListener, Game::Adversary, Game::Tag];

    pub(crate) fn layout(self) -> &'static Layout {
        match self {
            Game::SpeakerListener => &SPEAKER_LISTENER,
            Game::Adversary => &ADVERSARY,
            Game::Tag => &TAG,
        }
    }
}
