//! The picture of a foraging world: a chequered grid, foods and players with their levels, and for the last step who
//! loaded, with or without success, and the rewards.

use super::{Food, Foraging, Player, LOAD};
use crate::scene::{Colour, Scene, Shape};

const DARK_CELL: Colour = Colour(236, 236, 228);
const FOOD: Colour = Colour(196, 48, 43);
const STALK: Colour = Colour(110, 74, 40);
const LEAF: Colour = Colour(74, 146, 60);
/// Around a player whose loading failed, and around one that was rewarded.
const IN_VAIN: Colour = Colour(242, 183, 5);
const REWARDED: Colour = Colour(34, 136, 60);
/// Behind a negative reward.
const PUNISHED: Colour = Colour(176, 30, 30);

impl Foraging {
    /// One unit is one cell.
    pub(super) fn draw(&self) -> Scene {
        let mut shapes = self.grid();
        self.foods.iter().for_each(|food| draw_food(&mut shapes, food));
        for (agent, player) in self.players.iter().enumerate() {
            let loads = self.effective[agent] == LOAD;
            draw_player(&mut shapes, agent, player, loads, self.earned[agent]);
        }
        let foods = match self.foods.len() {
            0 => "no food left".to_owned(),
            1 => "1 food left".to_owned(),
            n => format!("{n} foods left"),
        };
        Scene {
            width: f64::from(self.config.cols),
            height: f64::from(self.config.rows),
            background: Colour::PAPER,
            shapes,
            caption: format!("step {} of {}, {foods}", self.step, self.config.episode_limit),
        }
    }

    /// Cells in two shades: visible even where lines would be thinner than a pixel.
    fn grid(&self) -> Vec<Shape> {
        let cells = (0..self.config.rows).flat_map(|row| (0..self.config.cols).map(move |col| (row, col)));
        let dark = cells.filter(|(row, col)| (row + col) % 2 == 1);
        let cell = |(row, col): (u16, u16)| Shape::Rectangle {
            x: f64::from(col),
            y: f64::from(row),
            width: 1.0,
            height: 1.0,
            fill: DARK_CELL,
        };
        let (right, bottom) = (f64::from(self.config.cols), f64::from(self.config.rows));
        let edge = |from, to| Shape::Line { from, to, width: 0.06, colour: Colour::GRID };
        let edges = [
            edge((0.0, 0.0), (right, 0.0)),
            edge((right, 0.0), (right, bottom)),
            edge((right, bottom), (0.0, bottom)),
            edge((0.0, bottom), (0.0, 0.0)),
        ];
        dark.map(cell).chain(edges).collect()
    }
}

/// An apple.
fn draw_food(shapes: &mut Vec<Shape>, food: &Food) {
    let (x, y) = centre(food.row, food.col);
    let stalk = (x + 0.05, y - 0.42);
    shapes.extend([
        Shape::Line { from: (x, y - 0.2), to: stalk, width: 0.06, colour: STALK },
        Shape::Polygon {
            corners: vec![
                (x + 0.03, y - 0.27),
                (x + 0.12, y - 0.4),
                (x + 0.28, y - 0.4),
                (x + 0.2, y - 0.29),
            ],
            fill: LEAF,
        },
        Shape::Circle { x: x - 0.09, y: y + 0.03, radius: 0.26, fill: FOOD },
        Shape::Circle { x: x + 0.09, y: y + 0.03, radius: 0.26, fill: FOOD },
        Shape::Circle { x, y: y + 0.1, radius: 0.27, fill: FOOD },
        level(x, y + 0.05, food.level),
    ]);
}

/// A square with cut corners: its level in the middle, its number above, its reward below.
fn draw_player(shapes: &mut Vec<Shape>, agent: usize, player: &Player, loads: bool, earned: f64) {
    let (x, y) = centre(player.row, player.col);
    if loads {
        let fill = if earned > 0.0 { REWARDED } else { IN_VAIN };
        shapes.push(Shape::Circle { x, y, radius: 0.5, fill });
    }
    let (side, cut) = (0.36, 0.24);
    let corners = [(-side, -cut), (-cut, -side), (cut, -side), (side, -cut)];
    let around = corners.iter().copied().chain(corners.iter().map(|(x, y)| (-x, -y)));
    let corners = around.map(|(dx, dy)| (x + dx, y + dy)).collect();
    shapes.push(Shape::Polygon { corners, fill: Colour::of_agent(agent) });
    let number = format!("#{agent}");
    shapes.push(Shape::Text { x, y: y - 0.23, size: 0.19, text: number, colour: Colour::WHITE });
    if earned != 0.0 {
        let (text, fill) = (format!("{earned:+.2}"), if earned > 0.0 { REWARDED } else { PUNISHED });
        let (left, top) = (x - 0.43, y + 0.24);
        shapes.push(Shape::Rectangle { x: left, y: top, width: 0.86, height: 0.26, fill });
        shapes.push(Shape::Text { x, y: top + 0.13, size: 0.25, text, colour: Colour::WHITE });
    }
    shapes.push(level(x, y + 0.03, player.level));
}

fn centre(row: u16, col: u16) -> (f64, f64) {
    (f64::from(col) + 0.5, f64::from(row) + 0.5)
}

fn level(x: f64, y: f64, level: u16) -> Shape {
    Shape::Text { x, y, size: 0.42, text: level.to_string(), colour: Colour::WHITE }
}

#[cfg(test)]
mod tests {
    use rand::RngCore;

    use super::super::{Config, Rules, State};
    use super::*;
    use crate::World;

    /// A step of foraging draws nothing.
    struct NoChance;

    impl RngCore for NoChance {
        fn next_u32(&mut self) -> u32 {
            unreachable!("foraging draws nothing in a step")
        }
        fn next_u64(&mut self) -> u64 {
            unreachable!("foraging draws nothing in a step")
        }
        fn fill_bytes(&mut self, _: &mut [u8]) {
            unreachable!("foraging draws nothing in a step")
        }
    }

    /// Players of levels 1, 1 and 2 around one food of level 3, and a food of level 1 far away.
    fn world() -> Foraging {
        let (rows, cols, players, foods) = (5, 6, 3, 2);
        let config = Config {
            rows,
            cols,
            players,
            foods,
            coop: false,
            sight: 6,
            penalty: 0.25,
            episode_limit: 50,
            rules: Rules::V3,
        };
        let mut world = Foraging::new(config).unwrap();
        let player = |row, col, level| Player { row, col, level };
        let food = |row, col, level| Food { row, col, level };
        let state = State {
            players: vec![player(1, 1, 1), player(0, 2, 1), player(1, 3, 2)],
            foods: vec![food(1, 2, 3), food(3, 4, 1)],
            food_level_sum_at_reset: 4,
            step: 6,
        };
        world.set_state(&state).unwrap();
        world
    }

    fn circles(scene: &Scene, colour: Colour) -> Vec<(f64, f64)> {
        let of_colour = |shape: &Shape| match *shape {
            Shape::Circle { x, y, radius: 0.5, fill } if fill == colour => Some((x, y)),
            _ => None,
        };
        scene.shapes.iter().filter_map(of_colour).collect()
    }

    fn texts(scene: &Scene) -> Vec<&str> {
        let texts = scene.shapes.iter().filter_map(|shape| match shape {
            Shape::Text { text, .. } => Some(text.as_str()),
            _ => None,
        });
        texts.collect()
    }

    #[test]
    fn foods_and_players_are_on_their_cells_with_their_levels() {
        let scene = world().scene();
        assert_eq!((scene.width, scene.height), (6.0, 5.0));
        assert_eq!(scene.caption, "step 6 of 50, 2 foods left");
        assert_eq!(texts(&scene), ["3", "1", "#0", "1", "#1", "1", "#2", "2"]);
        let far = Shape::Text { x: 4.5, y: 3.55, size: 0.42, text: "1".to_owned(), colour: Colour::WHITE };
        assert!(scene.shapes.contains(&far), "{:?}", scene.shapes);
        assert_eq!((circles(&scene, IN_VAIN), circles(&scene, REWARDED)), (vec![], vec![]));
    }

    #[test]
    fn who_loaded_is_marked_with_what_came_of_it() {
        let mut world = world();
        let mut rewards = [0.0; 3];
        // Levels 1 and 1 are not enough for level 3.
        world.step(&[LOAD, LOAD, 0], &mut NoChance, &mut rewards);
        let scene = world.scene();
        assert_eq!(circles(&scene, IN_VAIN), [(1.5, 1.5), (2.5, 0.5)]);
        assert_eq!(texts(&scene), ["3", "1", "#0", "-0.25", "1", "#1", "-0.25", "1", "#2", "2"]);
        // Levels 1 and 2 are enough: rewards 1 * 3 / (3 * 4) and 2 * 3 / (3 * 4).
        world.step(&[LOAD, 0, LOAD], &mut NoChance, &mut rewards);
        let scene = world.scene();
        assert_eq!(circles(&scene, REWARDED), [(1.5, 1.5), (3.5, 1.5)]);
        assert_eq!(circles(&scene, IN_VAIN), []);
        assert_eq!(texts(&scene), ["1", "#0", "+0.25", "1", "#1", "1", "#2", "+0.50", "2"]);
        assert_eq!(scene.caption, "step 8 of 50, 1 food left");
    }
}
