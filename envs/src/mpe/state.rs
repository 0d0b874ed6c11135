//! The complete state of a particle game, to read and to set, as replays of traces do.

use serde::Deserialize;

use super::game::EPISODE_LIMIT;
use super::physics::Particle;
use super::Particles;

/// Larger positions and speeds are rejected. Games stay within about 6 (mpe §6).
const FARTHEST: f64 = 1e6;

/// Everything that the rest of an episode depends on (mpe §2).
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct State {
    /// All agents in the reference's order, the opponent too.
    pub agents: Vec<Agent>,
    /// Positions.
    pub landmarks: Vec<[f64; 2]>,
    /// `None` in Tag.
    pub goal_landmark: Option<usize>,
    /// Steps taken in the episode.
    pub step: u32,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Agent {
    pub pos: [f64; 2],
    pub vel: [f64; 2],
    /// Its word in the last step, one-hot; zeros for silence.
    pub comm: Vec<f64>,
}

/// Why a state cannot be set.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StateError {
    #[error("expected {expected} {what}, found {found}")]
    Count { what: &'static str, expected: usize, found: usize },
    #[error("expected numbers within ±{FARTHEST} for the {what} {number}, found {found:?}")]
    Number { what: &'static str, number: usize, found: [f64; 2] },
    #[error("the {what} {number} has a velocity, but this body cannot move")]
    Moving { what: &'static str, number: usize },
    #[error(
        "expected {expected} numbers in the comm of agent {agent}, zeros or one 1 if it is a speaker, found {found:?}"
    )]
    Comm { agent: usize, expected: usize, found: Vec<f64> },
    #[error("expected {expected} as goal_landmark, found {found}")]
    Goal { expected: String, found: String },
    #[error("expected a step before {EPISODE_LIMIT}, where episodes end, found {found}")]
    Step { found: u32 },
}

impl Particles {
    /// The present state.
    pub fn state(&self) -> State {
        let layout = self.game.layout();
        let agent = |(number, particle): (usize, &Particle)| {
            let mut comm = vec![0.0; layout.comm_size];
            if let Some(word) = self.said.filter(|_| layout.speaks(number)) {
                comm[word] = 1.0;
            }
            Agent { pos: particle.pos, vel: particle.vel, comm }
        };
        State {
            agents: self.agents.iter().enumerate().map(agent).collect(),
            landmarks: self.landmarks.clone(),
            goal_landmark: layout.has_goal.then_some(self.goal),
            step: self.step,
        }
    }

    /// Sets the state, which need not be one that a reset can draw. After an error the world is unchanged.
    pub fn set_state(&mut self, state: &State) -> Result<(), StateError> {
        let said = self.check_state(state)?;
        for (particle, agent) in self.agents.iter_mut().zip(&state.agents) {
            *particle = Particle { pos: agent.pos, vel: agent.vel };
        }
        self.landmarks.copy_from_slice(&state.landmarks);
        self.goal = state.goal_landmark.unwrap_or(0);
        (self.said, self.step, self.collisions) = (said, state.step, 0);
        Ok(())
    }

    /// Checks the state and returns the speaker's word.
    fn check_state(&self, state: &State) -> Result<Option<usize>, StateError> {
        let layout = self.game.layout();
        check_count("agents", self.agents.len(), state.agents.len())?;
        check_count("landmarks", self.landmarks.len(), state.landmarks.len())?;
        let mut said = None;
        for (number, (agent, body)) in state.agents.iter().zip(layout.agents).enumerate() {
            check_numbers("place of agent", number, agent.pos)?;
            check_numbers("velocity of agent", number, agent.vel)?;
            if !body.movable && agent.vel != [0.0; 2] {
                return Err(StateError::Moving { what: "agent", number });
            }
            let refusal = || {
                let (expected, found) = (layout.comm_size, agent.comm.clone());
                StateError::Comm { agent: number, expected, found }
            };
            let word = parse_comm(&agent.comm, layout.comm_size).ok_or_else(refusal)?;
            if word.is_some() && !layout.speaks(number) {
                return Err(refusal());
            }
            said = said.or(word);
        }
        for (number, &landmark) in state.landmarks.iter().enumerate() {
            check_numbers("place of landmark", number, landmark)?;
        }
        let good = match state.goal_landmark {
            Some(goal) => layout.has_goal && goal < layout.landmarks,
            None => !layout.has_goal,
        };
        if !good {
            let expected = match layout.has_goal {
                true => format!("a number below {}", layout.landmarks),
                false => "null".to_owned(),
            };
            let found = state.goal_landmark.map_or("null".to_owned(), |goal| goal.to_string());
            return Err(StateError::Goal { expected, found });
        }
        if state.step >= EPISODE_LIMIT {
            return Err(StateError::Step { found: state.step });
        }
        Ok(said)
    }
}

/// The word of a communication vector, or `Some(None)` for silence; `None` if it is neither.
fn parse_comm(comm: &[f64], size: usize) -> Option<Option<usize>> {
    let word = comm.iter().position(|&number| number != 0.0);
    let one_hot =
        |word: usize| comm.iter().enumerate().all(|(k, &number)| number == if k == word { 1.0 } else { 0.0 });
    (comm.len() == size && word.is_none_or(one_hot)).then_some(word)
}

fn check_count(what: &'static str, expected: usize, found: usize) -> Result<(), StateError> {
    if found == expected {
        Ok(())
    } else {
        Err(StateError::Count { what, expected, found })
    }
}

fn check_numbers(what: &'static str, number: usize, found: [f64; 2]) -> Result<(), StateError> {
    // NaN fails every comparison.
    if found.iter().all(|number| number.abs() <= FARTHEST) {
        Ok(())
    } else {
        Err(StateError::Number { what, number, found })
    }
}
