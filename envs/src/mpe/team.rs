//! A particle game for its team: the opponent is part of the world.

use rand::RngCore;

use super::game::{MAX_AGENTS, MAX_OBS, MOVES};
use super::{FrozenNetwork, NetworkError, Particles, Role};
use crate::draw::below;
use crate::scene::Scene;
use crate::{End, Opponent, Sizes, World};

/// The controlled agents of a game, and the policy of its opponent.
#[derive(Debug, Clone)]
pub struct Team {
    particles: Particles,
    opponent: Policy,
    /// The opponent's next action, if it is already computed.
    planned: Option<u16>,
    sizes: Sizes,
}

#[derive(Debug, Clone)]
enum Policy {
    /// The game has no opponent.
    Nobody,
    Network(FrozenNetwork),
    Random,
    Still,
}

/// Why an opponent cannot play in a game.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OpponentError {
    #[error("this game has no opponent to choose")]
    NoOpponent,
    #[error("the opponent's weights: {0}")]
    Weights(#[from] NetworkError),
}

impl Team {
    pub fn new(particles: Particles, opponent: &Opponent) -> Result<Team, OpponentError> {
        let role = Role::ALL.into_iter().find(|role| role.game() == particles.game);
        let policy = match (role, opponent) {
            (None, Opponent::Builtin) => Policy::Nobody,
            (None, _) => return Err(OpponentError::NoOpponent),
            (Some(_), Opponent::Random) => Policy::Random,
            (Some(_), Opponent::Still) => Policy::Still,
            (Some(role), Opponent::Builtin) => network(role, role.builtin())?,
            (Some(role), Opponent::Weights(bytes)) => network(role, bytes)?,
        };
        let layout = particles.game.layout();
        let team = &layout.agents[layout.team.clone()];
        let sizes = Sizes {
            agents: team.len(),
            obs_size: team.iter().map(|body| body.obs_size).collect(),
            n_actions: team.iter().map(|body| body.n_actions).collect(),
            episode_limit: particles.sizes().episode_limit,
        };
        Ok(Team { particles, opponent: policy, planned: None, sizes })
    }

    /// The opponent's action now.
    fn opponent_acts(&mut self, rng: &mut dyn RngCore) -> u16 {
        match &self.opponent {
            Policy::Network(_) => {
                self.think_ahead();
                self.planned.take().expect("a network always chooses")
            }
            Policy::Random => below(rng, MOVES as u32) as u16,
            Policy::Still | Policy::Nobody => 0,
        }
    }
}

fn network(role: Role, bytes: &[u8]) -> Result<Policy, NetworkError> {
    FrozenNetwork::parse(bytes, role.obs_size()).map(Policy::Network)
}

impl World for Team {
    fn sizes(&self) -> &Sizes {
        &self.sizes
    }

    fn reset(&mut self, rng: &mut dyn RngCore) {
        self.planned = None;
        self.particles.reset(rng);
    }

    /// Computes a network's action, which depends on its agent's observation only, before the team acts.
    fn think_ahead(&mut self) {
        let layout = self.particles.game.layout();
        if let (Policy::Network(network), Some(role), None) =
            (&mut self.opponent, layout.opponent, self.planned)
        {
            let mut seen = [0.0; MAX_OBS];
            let seen = &mut seen[..layout.agents[role].obs_size];
            self.particles.view(role, seen);
            self.planned = Some(self.particles.rules.action_of_network(network.choose(seen)));
        }
    }

    fn step(&mut self, actions: &[u16], rng: &mut dyn RngCore, rewards: &mut [f64]) -> End {
        let layout = self.particles.game.layout();
        let (mut all, mut earned) = ([0; MAX_AGENTS], [0.0; MAX_AGENTS]);
        let everybody = ..layout.agents.len();
        all[layout.team.clone()].copy_from_slice(actions);
        if let Some(role) = layout.opponent {
            all[role] = self.opponent_acts(rng);
        }
        let end = self.particles.play(&all[everybody], &mut earned[everybody]);
        rewards.copy_from_slice(&earned[layout.team.clone()]);
        end
    }

    fn observe(&self, agent: usize, out: &mut [f32]) {
        assert!(agent < self.sizes.agents, "an agent of the team");
        self.particles.view(self.particles.game.layout().team.start + agent, out);
    }

    fn facts(&self, report: &mut dyn FnMut(&'static str, f64)) {
        self.particles.facts(report);
    }

    fn scene(&self) -> Scene {
        self.particles.draw()
    }

    fn copy(&self) -> Box<dyn World> {
        Box::new(self.clone())
    }
}
