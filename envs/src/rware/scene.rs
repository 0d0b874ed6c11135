//! The picture of a warehouse: highways and slots, shelves, goals, and robots with their loads.

use super::{Robot, Warehouse};
use crate::rware::Direction;
use crate::scene::{Colour, Scene, Shape};

const SLOT: Colour = Colour(232, 230, 222);
const GOAL: Colour = Colour(70, 75, 86);
const SHELF: Colour = Colour(176, 164, 146);
const REQUESTED: Colour = Colour(240, 186, 28);

impl Warehouse {
    /// One unit is one cell. Standing shelves fill their cells, carried ones lie small on their robots.
    pub(super) fn draw(&self) -> Scene {
        let (width, height) = (f64::from(self.layout.width), f64::from(self.layout.height));
        let mut shapes: Vec<Shape> =
            self.layout.slots.iter().map(|&slot| square(centre(slot), 1.0, SLOT)).collect();
        for goal in self.layout.goals {
            let (x, y) = centre(goal);
            shapes.push(square((x, y), 1.0, GOAL));
            shapes.push(Shape::Text { x, y, size: 0.6, text: "G".to_owned(), colour: Colour::WHITE });
        }
        let line = |from, to| Shape::Line { from, to, width: 0.03, colour: Colour::GRID };
        let columns = (0..=self.layout.width).map(f64::from);
        shapes.extend(columns.map(|x| line((x, 0.0), (x, height))));
        let rows = (0..=self.layout.height).map(f64::from);
        shapes.extend(rows.map(|y| line((0.0, y), (width, y))));

        let is_carried = |id: &u16| self.robots.iter().any(|robot| robot.carrying == Some(*id));
        let ids = 1..=self.layout.slots.len() as u16;
        for id in ids.filter(|id| !is_carried(id)) {
            let place = self.floor.place(self.floor.cell_of_shelf(id));
            shapes.push(square(centre(place), 0.84, self.colour_of(id)));
        }
        for (agent, robot) in self.robots.iter().enumerate() {
            let (x, y) = centre(robot.place());
            shapes.push(Shape::Circle { x, y, radius: 0.36, fill: Colour::of_agent(agent) });
            shapes.push(nose(robot));
            if let Some(id) = robot.carrying {
                shapes.push(square((x, y), 0.36, Colour::INK));
                shapes.push(square((x, y), 0.3, self.colour_of(id)));
            }
        }
        let requests: Vec<String> = self.requests.queue().iter().map(u16::to_string).collect();
        let caption = format!(
            "step {}, {} delivered, shelves requested: {}",
            self.step,
            self.deliveries,
            requests.join(" ")
        );
        Scene { width, height, background: Colour::PAPER, shapes, caption }
    }

    fn colour_of(&self, shelf: u16) -> Colour {
        if self.requests.contains(shelf) {
            REQUESTED
        } else {
            SHELF
        }
    }
}

fn centre((x, y): (u16, u16)) -> (f64, f64) {
    (f64::from(x) + 0.5, f64::from(y) + 0.5)
}

fn square((x, y): (f64, f64), side: f64, fill: Colour) -> Shape {
    Shape::Rectangle { x: x - side / 2.0, y: y - side / 2.0, width: side, height: side, fill }
}

/// A triangle that points ahead, from the robot's rim to the edge of its cell.
fn nose(robot: &Robot) -> Shape {
    let (x, y) = centre(robot.place());
    let (ahead_x, ahead_y) = match robot.direction {
        Direction::Up => (0.0, -1.0),
        Direction::Down => (0.0, 1.0),
        Direction::Left => (-1.0, 0.0),
        Direction::Right => (1.0, 0.0),
    };
    let corner = |ahead: f64, aside: f64| {
        (x + ahead * ahead_x - aside * ahead_y, y + ahead * ahead_y + aside * ahead_x)
    };
    Shape::Polygon {
        corners: vec![corner(0.49, 0.0), corner(0.24, 0.2), corner(0.24, -0.2)],
        fill: Colour::INK,
    }
}
