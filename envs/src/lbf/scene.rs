//! The picture of a foraging world: a grid, foods and players with their levels.

use super::Foraging;
use crate::scene::{Colour, Scene, Shape};

const FOOD: Colour = Colour(196, 48, 43);

impl Foraging {
    /// One unit is one cell.
    pub(super) fn draw(&self) -> Scene {
        let (width, height) = (f64::from(self.config.cols), f64::from(self.config.rows));
        let line = |from, to| Shape::Line { from, to, width: 0.03, colour: Colour::GRID };
        let columns = (0..=self.config.cols).map(f64::from).map(|x| line((x, 0.0), (x, height)));
        let rows = (0..=self.config.rows).map(f64::from).map(|y| line((0.0, y), (width, y)));
        let mut shapes: Vec<Shape> = columns.chain(rows).collect();
        for food in &self.foods {
            let (x, y) = centre(food.row, food.col);
            shapes.push(Shape::Circle { x, y, radius: 0.32, fill: FOOD });
            shapes.push(level(x, y, food.level));
        }
        for (agent, player) in self.players.iter().enumerate() {
            let (x, y) = centre(player.row, player.col);
            let (x, y, side) = (x - 0.36, y - 0.36, 0.72);
            shapes.push(Shape::Rectangle { x, y, width: side, height: side, fill: Colour::of_agent(agent) });
            shapes.push(level(x + side / 2.0, y + side / 2.0, player.level));
        }
        let caption = format!("step {}, {} foods left", self.step, self.foods.len());
        Scene { width, height, background: Colour::PAPER, shapes, caption }
    }
}

fn centre(row: u16, col: u16) -> (f64, f64) {
    (f64::from(col) + 0.5, f64::from(row) + 0.5)
}

fn level(x: f64, y: f64, level: u16) -> Shape {
    Shape::Text { x, y, size: 0.5, text: level.to_string(), colour: Colour::WHITE }
}
