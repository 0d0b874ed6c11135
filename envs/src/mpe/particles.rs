//! A whole particle game, in which all agents of the reference act through `step`, the opponent too. Teams play it
//! through [`super::Team`].

use rand::RngCore;

use super::game::{EPISODE_LIMIT, MAX_AGENTS, WORDS};
use super::physics::{contact_force, distance, integrate, Particle};
use super::{Game, Rules};
use crate::draw::below;
use crate::scene::Scene;
use crate::{End, Sizes, World};

/// The simulation of one game under one version of the rules. Make one with [`Particles::new`], then `reset` or
/// [`Particles::set_state`].
#[derive(Debug, Clone)]
pub struct Particles {
    pub(super) game: Game,
    pub(super) rules: Rules,
    sizes: Sizes,
    pub(super) agents: Vec<Particle>,
    pub(super) landmarks: Vec<[f64; 2]>,
    /// The goal landmark; 0 in games without a goal.
    pub(super) goal: usize,
    /// The speaker's word in the last step.
    pub(super) said: Option<usize>,
    pub(super) step: u32,
    /// Since the start of the episode: pairs of agents that touched, counted once in each step.
    pub(super) collisions: u32,
}

impl Particles {
    /// A world with all bodies at the origin. Reset it before use.
    pub fn new(game: Game, rules: Rules) -> Particles {
        let layout = game.layout();
        let sizes = Sizes {
            agents: layout.agents.len(),
            obs_size: layout.agents.iter().map(|body| body.obs_size).collect(),
            n_actions: layout.agents.iter().map(|body| body.n_actions).collect(),
            episode_limit: EPISODE_LIMIT,
        };
        Particles {
            game,
            rules,
            agents: vec![Particle::default(); sizes.agents],
            landmarks: vec![[0.0; 2]; layout.landmarks],
            goal: 0,
            said: None,
            step: 0,
            collisions: 0,
            sizes,
        }
    }

    /// Plays one joint action of all agents; `rewards` has a place for each. Nothing is drawn.
    pub fn play(&mut self, actions: &[u16], rewards: &mut [f64]) -> End {
        assert_eq!(actions.len(), self.sizes.agents, "one action per agent");
        assert_eq!(rewards.len(), self.sizes.agents, "one place per agent for rewards");
        self.step = self.step.saturating_add(1);
        let over = self.step >= EPISODE_LIMIT;
        if over && self.rules == Rules::Epymarl {
            // The wrapper repeats the observation from before this step, without a reward (mpe §7).
            rewards.fill(0.0);
        } else {
            self.speak(actions);
            self.push(actions);
            self.count_collisions();
            self.reward(rewards);
        }
        if over {
            End::TimeLimit
        } else {
            End::Running
        }
    }

    /// Sets the speaker's word (mpe §5.4). A word that does not exist is silence.
    fn speak(&mut self, actions: &[u16]) {
        if self.game.layout().speaks(0) {
            let word = usize::from(actions[0]);
            self.said = (word < WORDS).then_some(word);
        }
    }

    fn count_collisions(&mut self) {
        let bodies = self.game.layout().agents;
        for (a, body) in bodies.iter().enumerate().filter(|(_, body)| body.collides) {
            for (b, other) in bodies.iter().enumerate().skip(a + 1).filter(|(_, body)| body.collides) {
                let apart = distance(self.agents[a].pos, self.agents[b].pos);
                self.collisions += u32::from(apart < body.radius + other.radius);
            }
        }
    }

    /// Moves the bodies (mpe §5.1 to §5.3).
    fn push(&mut self, actions: &[u16]) {
        let layout = self.game.layout();
        let mut forces = [[0.0; 2]; MAX_AGENTS];
        for ((force, body), &action) in forces.iter_mut().zip(layout.agents).zip(actions) {
            *force = self.rules.direction(action).map(|unit| unit * body.push);
        }
        for (a, body) in layout.agents.iter().enumerate().filter(|(_, body)| body.collides) {
            for (b, other) in layout.agents.iter().enumerate().skip(a + 1).filter(|(_, body)| body.collides) {
                let touching = body.radius + other.radius;
                if let Some(force) = contact_force(self.agents[a].pos, self.agents[b].pos, touching) {
                    add(&mut forces[a], force);
                    add(&mut forces[b], force.map(|force| -force));
                }
            }
            if layout.landmarks_collide {
                let touching = body.radius + layout.landmark_radius;
                for &landmark in &self.landmarks {
                    if let Some(force) = contact_force(self.agents[a].pos, landmark, touching) {
                        add(&mut forces[a], force);
                    }
                }
            }
        }
        for ((particle, body), force) in self.agents.iter_mut().zip(layout.agents).zip(forces) {
            if body.movable {
                integrate(particle, force, body, self.rules);
            }
        }
    }
}

fn add(sum: &mut [f64; 2], force: [f64; 2]) {
    for (sum, force) in sum.iter_mut().zip(force) {
        *sum += force;
    }
}

impl World for Particles {
    fn sizes(&self) -> &Sizes {
        &self.sizes
    }

    /// In the reference's order of draws: the goal, then agents, then landmarks (mpe §3).
    fn reset(&mut self, rng: &mut dyn RngCore) {
        let layout = self.game.layout();
        self.goal = if layout.has_goal { below(rng, layout.landmarks as u32) as usize } else { 0 };
        for particle in &mut self.agents {
            *particle = Particle { pos: [uniform(rng, 1.0), uniform(rng, 1.0)], vel: [0.0; 2] };
        }
        for landmark in &mut self.landmarks {
            *landmark = [uniform(rng, layout.spread), uniform(rng, layout.spread)];
        }
        (self.said, self.step, self.collisions) = (None, 0, 0);
    }

    fn step(&mut self, actions: &[u16], _: &mut dyn RngCore, rewards: &mut [f64]) -> End {
        self.play(actions, rewards)
    }

    fn observe(&self, agent: usize, out: &mut [f32]) {
        self.view(agent, out);
    }

    fn facts(&self, report: &mut dyn FnMut(&'static str, f64)) {
        let place = |agent: usize| self.agents[agent].pos;
        let goal = self.landmarks[self.goal];
        let nearest = |from: std::ops::Range<usize>, to: [f64; 2]| {
            from.map(|agent| distance(place(agent), to)).fold(f64::INFINITY, f64::min)
        };
        match self.game {
            Game::SpeakerListener => report("goal_distance", nearest(1..2, goal)),
            Game::Adversary => {
                report("goal_distance", nearest(1..3, goal));
                report("adversary_goal_distance", nearest(0..1, goal));
            }
            Game::Tag => {
                report("collisions", f64::from(self.collisions));
                report("prey_distance", nearest(0..3, place(3)));
            }
        }
    }

    fn scene(&self) -> Scene {
        self.draw()
    }

    fn copy(&self) -> Box<dyn World> {
        Box::new(self.clone())
    }
}

/// A number from `[-bound, bound)`, from 53 random bits.
fn uniform(rng: &mut dyn RngCore, bound: f64) -> f64 {
    /// 2⁻⁵³
    const UNIT: f64 = 1.0 / (1_u64 << 53) as f64;
    -bound + 2.0 * bound * ((rng.next_u64() >> 11) as f64 * UNIT)
}
