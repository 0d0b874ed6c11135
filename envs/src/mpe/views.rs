//! Observations and rewards (mpe §6, §9).

use super::physics::{distance, from_to, squared};
use super::{Game, Particles, Rules};

impl Particles {
    /// Writes the observation of `agent`. Computed in double precision, converted to float32 at the end.
    pub(super) fn view(&self, agent: usize, out: &mut [f32]) {
        assert_eq!(out.len(), self.game.layout().agents[agent].obs_size, "one place per observed number");
        let mut out = Writer { out, filled: 0 };
        let me = self.agents[agent];
        match (self.game, agent) {
            (Game::SpeakerListener, 0) => {
                for landmark in 0..self.landmarks.len() {
                    // The colour of the goal: 0.65 in its own channel.
                    out.put(if landmark == self.goal { 0.65 } else { 0.15 });
                }
            }
            (Game::SpeakerListener, _) => {
                out.pair(me.vel);
                self.landmarks.iter().for_each(|&landmark| out.pair(from_to(me.pos, landmark)));
                for word in 0..super::game::WORDS {
                    out.put(if self.said == Some(word) { 1.0 } else { 0.0 });
                }
            }
            (Game::Adversary, _) => {
                if agent > 0 {
                    out.pair(from_to(me.pos, self.landmarks[self.goal]));
                }
                self.landmarks.iter().for_each(|&landmark| out.pair(from_to(me.pos, landmark)));
                self.others(agent, &mut out);
            }
            (Game::Tag, _) => {
                out.pair(me.vel);
                out.pair(me.pos);
                self.landmarks.iter().for_each(|&landmark| out.pair(from_to(me.pos, landmark)));
                self.others(agent, &mut out);
                if agent != PREY {
                    out.pair(self.agents[PREY].vel);
                }
            }
        }
        debug_assert_eq!(out.filled, out.out.len());
    }

    /// The positions of the other agents relative to `agent`, in index order.
    fn others(&self, agent: usize, out: &mut Writer) {
        let me = self.agents[agent].pos;
        for (_, other) in self.agents.iter().enumerate().filter(|(other, _)| *other != agent) {
            out.pair(from_to(me, other.pos));
        }
    }

    /// Writes each agent's own reward for the present positions.
    pub(super) fn reward(&self, rewards: &mut [f64]) {
        match self.game {
            Game::SpeakerListener => {
                let near = -squared(from_to(self.landmarks[self.goal], self.agents[1].pos));
                // The study's code gives every agent the sum of both (mpe §9).
                rewards.fill(if self.rules == Rules::Study2021 { near + near } else { near });
            }
            Game::Adversary => {
                let goal = self.landmarks[self.goal];
                let far = distance(self.agents[0].pos, goal);
                let nearest = distance(self.agents[1].pos, goal).min(distance(self.agents[2].pos, goal));
                rewards.fill(-nearest + far);
                rewards[0] = match self.rules {
                    Rules::Study2021 => -squared(from_to(goal, self.agents[0].pos)),
                    Rules::Current | Rules::Epymarl => -far,
                };
            }
            Game::Tag => {
                let (prey, bodies) = (self.agents[PREY].pos, self.game.layout().agents);
                let touches = |predator: &usize| {
                    let touching = bodies[*predator].radius + bodies[PREY].radius;
                    distance(self.agents[*predator].pos, prey) < touching
                };
                let caught = 10.0 * (0..PREY).filter(touches).count() as f64;
                rewards.fill(caught);
                rewards[PREY] = prey.iter().fold(0.0 - caught, |reward, x| reward - out_of_bounds(x.abs()));
            }
        }
    }
}

/// The last agent of Tag.
const PREY: usize = 3;

/// The prey's penalty for an axis on which it is `x` from the middle.
fn out_of_bounds(x: f64) -> f64 {
    if x < 0.9 {
        0.0
    } else if x < 1.0 {
        (x - 0.9) * 10.0
    } else {
        libm::exp(2.0 * x - 2.0).min(10.0)
    }
}

/// Fills an observation from the left.
struct Writer<'a> {
    out: &'a mut [f32],
    filled: usize,
}

impl Writer<'_> {
    fn put(&mut self, number: f64) {
        self.out[self.filled] = number as f32;
        self.filled += 1;
    }

    fn pair(&mut self, [x, y]: [f64; 2]) {
        self.put(x);
        self.put(y);
    }
}
