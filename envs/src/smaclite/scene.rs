//! A battle from above.

use super::{Battle, Unit};
use crate::scene::{Colour, Scene, Shape};

const ALLY: Colour = Colour(0, 114, 178);
const ENEMY: Colour = Colour(213, 94, 0);
const ROCK: Colour = Colour(120, 116, 108);

impl Battle {
    pub(super) fn draw(&self) -> Scene {
        let (width, height) = (f64::from(self.map.width), f64::from(self.map.height));
        let mut shapes = Vec::new();
        for &[x, y, w, h] in &self.map.rectangles {
            let [x, y, w, h] = [x, y, w, h].map(f64::from);
            shapes.push(Shape::Rectangle { x, y: height - y - h, width: w, height: h, fill: ROCK });
        }
        for unit in self.living {
            let Unit { at: [x, y], .. } = self.units[unit];
            let fill = if self.is_ally(unit) { ALLY } else { ENEMY };
            let (x, y) = (f64::from(x), height - f64::from(y));
            shapes.push(Shape::Circle { x, y, radius: self.facts[unit].radius, fill });
        }
        let (allies, enemies) = (self.living.and(self.allies).len(), self.enemies().len());
        let caption = format!("step {}, {allies} allies against {enemies} enemies", self.step);
        Scene { width, height, background: Colour::PAPER, shapes, caption }
    }
}
