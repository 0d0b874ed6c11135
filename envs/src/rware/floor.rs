//! Robots and shelves by cell, and what a robot sees of them (rware §3, §6).

use super::{Direction, Layout};

/// Observed numbers per cell: robot, its direction one-hot, shelf, requested.
pub(super) const SEEN: usize = 7;
const SHELF: usize = 5;
const REQUESTED: usize = 6;
/// Without a robot the direction is up.
const EMPTY: [f32; SEEN] = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// A cell of the floor. The grid has a border as wide as robots see, which is always empty.
pub(super) type Cell = usize;

/// The two occupancy layers, and the observed numbers of each cell, kept up to date so that an observation is a copy.
#[derive(Debug, Clone)]
pub(super) struct Floor {
    border: usize,
    stride: usize,
    /// Robot number (from 1) by cell; 0 is none.
    robots: Vec<u16>,
    /// Shelf id by cell; 0 is none.
    shelves: Vec<u16>,
    /// By shelf id; id 0 is unused.
    cell_of_shelf: Vec<Cell>,
    /// [`SEEN`] numbers per cell.
    seen: Vec<f32>,
}

impl Floor {
    /// An empty floor.
    pub fn new(layout: &Layout, sensor_range: u16) -> Floor {
        let border = usize::from(sensor_range);
        let stride = usize::from(layout.width) + 2 * border;
        let cells = stride * (usize::from(layout.height) + 2 * border);
        Floor {
            border,
            stride,
            robots: vec![0; cells],
            shelves: vec![0; cells],
            cell_of_shelf: vec![0; layout.slots.len() + 1],
            seen: EMPTY.repeat(cells),
        }
    }

    pub fn clear(&mut self) {
        self.robots.fill(0);
        self.shelves.fill(0);
        for seen in self.seen.chunks_exact_mut(SEEN) {
            seen.copy_from_slice(&EMPTY);
        }
    }

    pub fn cell(&self, (x, y): (u16, u16)) -> Cell {
        (usize::from(y) + self.border) * self.stride + usize::from(x) + self.border
    }

    /// `(x, y)` of a cell of the grid.
    pub fn place(&self, cell: Cell) -> (u16, u16) {
        ((cell % self.stride - self.border) as u16, (cell / self.stride - self.border) as u16)
    }

    /// The next cell in that direction, at a wall a cell of the border.
    pub fn ahead(&self, cell: Cell, direction: Direction) -> Cell {
        match direction {
            Direction::Up => cell - self.stride,
            Direction::Down => cell + self.stride,
            Direction::Left => cell - 1,
            Direction::Right => cell + 1,
        }
    }

    /// The robot on a cell, numbered from 0.
    pub fn robot(&self, cell: Cell) -> Option<usize> {
        usize::from(self.robots[cell]).checked_sub(1)
    }

    /// The id of the shelf on a cell, standing or carried.
    pub fn shelf(&self, cell: Cell) -> Option<u16> {
        Some(self.shelves[cell]).filter(|&id| id != 0)
    }

    pub fn cell_of_shelf(&self, id: u16) -> Cell {
        self.cell_of_shelf[usize::from(id)]
    }

    /// Puts a robot on a cell, or turns the robot there.
    pub fn put_robot(&mut self, cell: Cell, robot: usize, direction: Direction) {
        self.robots[cell] = robot as u16 + 1;
        let seen = &mut self.seen[cell * SEEN..][..SHELF];
        seen.fill(0.0);
        seen[0] = 1.0;
        seen[1 + direction as usize] = 1.0;
    }

    pub fn lift_robot(&mut self, cell: Cell) {
        self.robots[cell] = 0;
        self.seen[cell * SEEN..][..SHELF].copy_from_slice(&EMPTY[..SHELF]);
    }

    pub fn put_shelf(&mut self, cell: Cell, id: u16, requested: bool) {
        self.shelves[cell] = id;
        self.cell_of_shelf[usize::from(id)] = cell;
        self.seen[cell * SEEN + SHELF] = 1.0;
        self.seen[cell * SEEN + REQUESTED] = f32::from(u8::from(requested));
    }

    pub fn lift_shelf(&mut self, cell: Cell) {
        self.shelves[cell] = 0;
        self.seen[cell * SEEN + SHELF..][..2].fill(0.0);
    }

    /// Marks a shelf on the floor as requested or not.
    pub fn mark(&mut self, id: u16, requested: bool) {
        let cell = self.cell_of_shelf(id);
        self.seen[cell * SEEN + REQUESTED] = f32::from(u8::from(requested));
    }

    /// Writes the square of cells around `cell`, row by row from the upper left.
    pub fn look(&self, cell: Cell, out: &mut [f32]) {
        let side = (2 * self.border + 1) * SEEN;
        let mut start = (cell - self.border * (self.stride + 1)) * SEEN;
        for row in out.chunks_exact_mut(side) {
            row.copy_from_slice(&self.seen[start..start + side]);
            start += self.stride * SEEN;
        }
    }
}
