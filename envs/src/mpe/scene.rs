//! The picture of a particle game: bodies to scale, colours by role, a ring around the goal.

use super::game::WORDS;
use super::{Game, Particles};
use crate::scene::{Colour, Scene, Shape};

/// Distance from the middle to the border; bodies further out are drawn at the border.
const REACH: f64 = 1.5;

const OBSTACLE: Colour = Colour(176, 176, 170);
const OPPONENT: Colour = Colour(213, 94, 0);
const TEAM: Colour = Colour(0, 114, 178);
const SPEAKER: Colour = Colour(120, 120, 120);
/// Colours of the landmarks of Speaker-Listener and of the words, by number.
const WORD: [Colour; WORDS] = [Colour(204, 60, 50), Colour(60, 160, 70), Colour(70, 90, 200)];
const WORD_NAME: [&str; WORDS] = ["red", "green", "blue"];

impl Particles {
    /// One unit is one unit of the world.
    pub(super) fn draw(&self) -> Scene {
        let layout = self.game.layout();
        let mut shapes = vec![];
        let axis = |from, to| Shape::Line { from, to, width: 0.005, colour: Colour::GRID };
        // The square in which all bodies start.
        let (low, high) = (REACH - 1.0, REACH + 1.0);
        for (a, b) in [(low, low), (high, high)] {
            shapes.push(axis((a, low), (b, high)));
            shapes.push(axis((low, a), (high, b)));
        }
        for (number, &landmark) in self.landmarks.iter().enumerate() {
            let fill = match self.game {
                Game::SpeakerListener => WORD[number],
                Game::Adversary | Game::Tag => OBSTACLE,
            };
            if layout.has_goal && number == self.goal {
                shapes.push(circle(landmark, layout.landmark_radius + 0.05, Colour::INK));
                shapes.push(circle(landmark, layout.landmark_radius + 0.03, Colour::PAPER));
            }
            shapes.push(circle(landmark, layout.landmark_radius, fill));
        }
        for (number, (particle, body)) in self.agents.iter().zip(layout.agents).enumerate() {
            let fill = match self.game {
                _ if layout.opponent == Some(number) => OPPONENT,
                Game::SpeakerListener if number == 0 => SPEAKER,
                _ => TEAM,
            };
            shapes.push(circle(particle.pos, body.radius, fill));
            let (x, y) = place(particle.pos);
            if layout.team.contains(&number) {
                let text = (number - layout.team.start).to_string();
                shapes.push(Shape::Text { x, y, size: 1.2 * body.radius, text, colour: Colour::WHITE });
            }
        }
        if let Some(word) = self.said {
            let [x, y] = self.agents[0].pos;
            shapes.push(circle([x + 0.1, y + 0.1], 0.04, WORD[word]));
        }
        let side = 2.0 * REACH;
        Scene { width: side, height: side, background: Colour::PAPER, shapes, caption: self.caption() }
    }

    fn caption(&self) -> String {
        let step = self.step;
        match self.game {
            Game::SpeakerListener => {
                let said = self.said.map_or("nothing", |word| WORD_NAME[word]);
                format!("step {step}, the goal is {}, agent 0 said {said}", WORD_NAME[self.goal])
            }
            Game::Adversary => format!("step {step}, the team knows the ringed goal, the adversary does not"),
            Game::Tag => format!("step {step}, the team chases the prey"),
        }
    }
}

/// A position of the world in the picture, whose y goes down.
fn place([x, y]: [f64; 2]) -> (f64, f64) {
    (REACH + x.clamp(-REACH, REACH), REACH - y.clamp(-REACH, REACH))
}

fn circle(pos: [f64; 2], radius: f64, fill: Colour) -> Shape {
    let (x, y) = place(pos);
    Shape::Circle { x, y, radius, fill }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mpe::Rules;

    #[test]
    fn up_in_the_world_is_up_in_the_picture_and_who_left_it_stands_at_its_border() {
        let mut world = Particles::new(Game::Tag, Rules::Current);
        world.agents[3].pos = [-0.5, 0.75];
        world.agents[0].pos = [2.0, -7.0];
        let circles = world.draw().shapes.into_iter().filter_map(|shape| match shape {
            Shape::Circle { x, y, radius, .. } => Some((x, y, radius)),
            _ => None,
        });
        let circles: Vec<_> = circles.collect();
        assert_eq!(circles[2], (3.0, 3.0, 0.075));
        assert_eq!(circles[5], (1.0, 0.75, 0.05));
    }

    #[test]
    fn the_speakers_word_is_shown() {
        let mut world = Particles::new(Game::SpeakerListener, Rules::Current);
        (world.goal, world.said) = (2, Some(1));
        let scene = world.draw();
        assert_eq!(scene.caption, "step 0, the goal is blue, agent 0 said green");
        assert_eq!(scene.shapes.last(), Some(&circle([0.1, 0.1], 0.04, WORD[1])));
    }
}
