//! The complete state of a warehouse, to read and to set, as replays of traces do.

use std::collections::HashMap;

use super::{Direction, Layout, Warehouse};

/// Everything that the rest of an episode depends on (rware §3).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct State {
    /// In index order; the reference numbers them from 1.
    pub robots: Vec<Robot>,
    /// The positions of the shelves 1, 2, …, standing or carried.
    pub shelves: Vec<(u16, u16)>,
    /// Shelf ids in slot order.
    pub request_queue: Vec<u16>,
    /// Steps taken in the episode.
    pub step: u32,
}

/// `x` to the right, `y` downwards, both from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Robot {
    pub x: u16,
    pub y: u16,
    pub direction: Direction,
    /// The id of the shelf that it carries.
    pub carrying: Option<u16>,
}

impl Robot {
    pub(super) fn place(&self) -> (u16, u16) {
        (self.x, self.y)
    }

    pub(super) fn faces_wall(&self, layout: &Layout) -> bool {
        match self.direction {
            Direction::Up => self.y == 0,
            Direction::Down => self.y + 1 == layout.height,
            Direction::Left => self.x == 0,
            Direction::Right => self.x + 1 == layout.width,
        }
    }
}

/// Why a state cannot be set. Robots are numbered from 1, as in the reference.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    #[error("expected {expected} robots, found {found}")]
    Robots { expected: usize, found: usize },
    #[error("expected {expected} shelves, found {found}")]
    Shelves { expected: usize, found: usize },
    #[error("expected {expected} requested shelves, found {found}")]
    Requests { expected: usize, found: usize },
    #[error("{who} is at x {x}, y {y}, outside of the {width}x{height} grid")]
    Outside { who: String, x: u16, y: u16, width: u16, height: u16 },
    #[error("{who} is on the cell of {other} (x {x}, y {y})")]
    Taken { who: String, other: String, x: u16, y: u16 },
    #[error("{who} shelf {id}; there are shelves 1 to {shelves}")]
    NoSuchShelf { who: String, id: u16, shelves: usize },
    #[error("robot {robot} at x {x}, y {y} carries shelf {id}, which is at x {shelf_x}, y {shelf_y}")]
    CarriedElsewhere { robot: usize, x: u16, y: u16, id: u16, shelf_x: u16, shelf_y: u16 },
    #[error("the request queue has shelf {id} twice")]
    RequestedTwice { id: u16 },
}

impl Warehouse {
    /// The present state.
    pub fn state(&self) -> State {
        let ids = 1..=self.layout.slots.len() as u16;
        State {
            robots: self.robots.clone(),
            shelves: ids.map(|id| self.floor.place(self.floor.cell_of_shelf(id))).collect(),
            request_queue: self.requests.queue().to_vec(),
            step: self.step,
        }
    }

    /// Sets the state, which need not be one that an episode can reach. After an error the world is unchanged.
    pub fn set_state(&mut self, state: &State) -> Result<(), StateError> {
        self.check_state(state)?;
        self.robots.copy_from_slice(&state.robots);
        self.requests.set(&state.request_queue);
        self.floor.clear();
        for (id, &place) in (1..).zip(&state.shelves) {
            let cell = self.floor.cell(place);
            self.floor.put_shelf(cell, id, self.requests.contains(id));
        }
        self.put_robots();
        self.begin(state.step);
        Ok(())
    }

    fn check_state(&self, state: &State) -> Result<(), StateError> {
        let (expected, found) = (self.robots.len(), state.robots.len());
        if found != expected {
            return Err(StateError::Robots { expected, found });
        }
        let (shelves, found) = (self.layout.slots.len(), state.shelves.len());
        if found != shelves {
            return Err(StateError::Shelves { expected: shelves, found });
        }
        let (expected, found) = (self.requests.queue().len(), state.request_queue.len());
        if found != expected {
            return Err(StateError::Requests { expected, found });
        }
        self.check_places("robot", state.robots.iter().map(Robot::place))?;
        self.check_places("shelf", state.shelves.iter().copied())?;
        let shelf = |id: u16, who: &dyn Fn() -> String| {
            let place = usize::from(id).checked_sub(1).and_then(|index| state.shelves.get(index));
            place.copied().ok_or_else(|| StateError::NoSuchShelf { who: who(), id, shelves })
        };
        for (robot, &Robot { x, y, carrying, .. }) in (1..).zip(&state.robots) {
            let Some(id) = carrying else { continue };
            let (shelf_x, shelf_y) = shelf(id, &|| format!("robot {robot} carries"))?;
            if (shelf_x, shelf_y) != (x, y) {
                return Err(StateError::CarriedElsewhere { robot, x, y, id, shelf_x, shelf_y });
            }
        }
        for (slot, &id) in state.request_queue.iter().enumerate() {
            shelf(id, &|| "the request queue has".to_owned())?;
            if state.request_queue[..slot].contains(&id) {
                return Err(StateError::RequestedTwice { id });
            }
        }
        Ok(())
    }

    /// Checks that all are on the grid and no two on one cell.
    fn check_places(&self, what: &str, places: impl Iterator<Item = (u16, u16)>) -> Result<(), StateError> {
        let Layout { width, height, .. } = self.layout;
        let mut on = HashMap::new();
        for (number, (x, y)) in (1..).zip(places) {
            let who = || format!("{what} {number}");
            if x >= width || y >= height {
                return Err(StateError::Outside { who: who(), x, y, width, height });
            }
            if let Some(other) = on.insert((x, y), number) {
                return Err(StateError::Taken { who: who(), other: format!("{what} {other}"), x, y });
            }
        }
        Ok(())
    }
}
