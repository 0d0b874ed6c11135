//! The start of an episode (rware §4).

use rand::RngCore;

use super::{Direction, Warehouse};
use crate::draw::below;

impl Warehouse {
    pub(super) fn draw_start(&mut self, rng: &mut dyn RngCore) {
        let (width, height) = (u32::from(self.layout.width), u32::from(self.layout.height));
        for i in 0..self.robots.len() {
            // Distinct cells: a taken one is drawn again.
            let place = loop {
                let cell = below(rng, width * height);
                let place = ((cell % width) as u16, (cell / width) as u16);
                if self.robots[..i].iter().all(|robot| robot.place() != place) {
                    break place;
                }
            };
            (self.robots[i].x, self.robots[i].y) = place;
        }
        for robot in &mut self.robots {
            robot.direction = Direction::ALL[below(rng, 4) as usize];
            robot.carrying = None;
        }
        self.requests.redraw_all(rng);
        self.fill_floor();
        self.begin(0);
    }

    /// Puts all shelves on their slots and the robots where they are.
    pub(super) fn fill_floor(&mut self) {
        self.floor.clear();
        for (id, &slot) in (1..).zip(&self.layout.slots) {
            let cell = self.floor.cell(slot);
            self.floor.put_shelf(cell, id, self.requests.contains(id));
        }
        self.put_robots();
    }

    pub(super) fn put_robots(&mut self) {
        for (i, robot) in self.robots.iter().enumerate() {
            let cell = self.floor.cell(robot.place());
            self.floor.put_robot(cell, i, robot.direction);
        }
    }

    /// Clears the record of the last step.
    pub(super) fn begin(&mut self, step: u32) {
        self.step = step;
        self.deliveries = 0;
        self.effective.fill(super::NOOP);
        for (i, robot) in self.robots.iter().enumerate() {
            let cell = self.floor.cell(robot.place());
            (self.traffic.own[i], self.traffic.wanted[i]) = (cell, cell);
        }
    }
}
