//! Which robots may move: the cells that they want, and which robot gets each (rware §5.1 to §5.3).

use super::config::MAX_ROBOTS;
use super::floor::{Cell, Floor};
use super::pair_set::PairSet;

/// Every robot mentions its own cell and the one it wants.
pub(super) const MAX_CELLS: usize = 2 * MAX_ROBOTS as usize;

/// The graph of a step: robot `i` is on `own[i]` and wants `wanted[i]`, which is its own cell if it stays.
#[derive(Debug, Clone)]
pub(super) struct Traffic {
    pub own: Vec<Cell>,
    pub wanted: Vec<Cell>,
    /// Whether the robot is granted its action.
    pub granted: Vec<bool>,
}

impl Traffic {
    pub fn new(robots: usize) -> Traffic {
        Traffic { own: vec![0; robots], wanted: vec![0; robots], granted: vec![false; robots] }
    }

    /// Decides which actions are granted. `floor` has the robots on their own cells.
    pub fn settle(&mut self, floor: &Floor) {
        self.granted.fill(false);
        for robot in 0..self.own.len() {
            let wanted = self.wanted[robot];
            if floor.robot(wanted).is_some() {
                // A robot that stays is a ring of one. Two cannot swap; a longer ring can move.
                self.granted[robot] |= self.ring(robot, floor).is_some_and(|length| length != 2);
            } else if !self.wanted[..robot].contains(&wanted) {
                self.admit(wanted, floor);
            }
        }
    }

    /// The length of the ring that this robot is part of: each is on the cell that the one behind wants.
    fn ring(&self, robot: usize, floor: &Floor) -> Option<usize> {
        let mut at = robot;
        for length in 1..=self.own.len() {
            at = floor.robot(self.wanted[at])?;
            if at == robot {
                return Some(length);
            }
        }
        None
    }

    /// Grants the longest path into a free cell.
    fn admit(&mut self, free: Cell, floor: &Floor) {
        let mut cell = free;
        while let Some(robot) = self.winner(cell, floor) {
            self.granted[robot] = true;
            cell = self.own[robot];
        }
    }

    /// The next robot on the longest path back from `cell`.
    fn winner(&self, cell: Cell, floor: &Floor) -> Option<usize> {
        let mut rivals = self.rivals(cell);
        let first = rivals.next()?;
        if rivals.next().is_none() {
            return Some(first);
        }
        let tied = self.longest_trains(cell);
        if tied.is_power_of_two() {
            return Some(tied.trailing_zeros() as usize);
        }
        self.first_in_cell_order(cell, tied, floor)
    }

    /// The robots that want a cell and are not on it, in robot order.
    fn rivals(&self, cell: Cell) -> impl Iterator<Item = usize> + '_ {
        (0..self.own.len()).filter(move |&robot| self.wanted[robot] == cell && self.own[robot] != cell)
    }

    /// The rivals for a cell with the longest train, as bits.
    fn longest_trains(&self, cell: Cell) -> u64 {
        let (mut tied, mut longest) = (0, 0);
        for rival in self.rivals(cell) {
            let length = self.train(rival, 0);
            if length > longest {
                (tied, longest) = (0, length);
            }
            if length == longest {
                tied |= 1 << rival;
            }
        }
        tied
    }

    /// The length of the longest train that this robot leads. `ahead` are the robots in front, as bits: on a ring a
    /// train ends where it would meet itself.
    fn train(&self, robot: usize, ahead: u64) -> u32 {
        if ahead >> robot & 1 == 1 {
            return 0;
        }
        let ahead = ahead | 1 << robot;
        1 + self.rivals(self.own[robot]).map(|next| self.train(next, ahead)).max().unwrap_or(0)
    }

    /// The robot of those with equal trains whose own cell comes first in the reference's graph (rware §5.3).
    #[cold]
    fn first_in_cell_order(&self, contested: Cell, tied: u64, floor: &Floor) -> Option<usize> {
        let is_tied = |cell: Cell| floor.robot(cell).filter(|&robot| tied >> robot & 1 == 1);
        let mut mentioned = Cells::new();
        for (&own, &wanted) in self.own.iter().zip(&self.wanted) {
            mentioned.add(own);
            mentioned.add(wanted);
        }
        let component = self.component(contested, floor);
        let in_component = |cell: &Cell| component.list().contains(cell);
        if 2 * component.list().len() >= mentioned.list().len() {
            return mentioned.list().iter().find_map(|&cell| is_tied(cell));
        }
        let earliest = mentioned.list().iter().copied().find(in_component)?;
        let found = self.component(earliest, floor);
        let set = PairSet::of(found.list().iter().map(|&cell| floor.place(cell)));
        let copy = PairSet::of(set.iter());
        let winner = copy.iter().find_map(|place| is_tied(floor.cell(place)));
        winner
    }

    /// All cells connected with `start`, breadth first: from each cell the one that its robot wants, then the cells of
    /// the robots that want it.
    fn component(&self, start: Cell, floor: &Floor) -> Cells {
        let mut cells = Cells::new();
        cells.add(start);
        let mut next = 0;
        while let Some(&cell) = cells.list().get(next) {
            if let Some(robot) = floor.robot(cell) {
                cells.add(self.wanted[robot]);
            }
            for rival in self.rivals(cell) {
                cells.add(self.own[rival]);
            }
            next += 1;
        }
        cells
    }

    /// The groups of robots, ascending, that wanted one cell with equally long trains. A cell whose robot stays has no
    /// ties.
    pub fn ties(&self) -> Vec<Vec<usize>> {
        let robots = 0..self.own.len();
        let mut ties: Vec<Vec<usize>> = Vec::new();
        for robot in robots.clone() {
            let cell = self.wanted[robot];
            let stays = |other: usize| self.own[other] == cell && self.wanted[other] == cell;
            if self.wanted[..robot].contains(&cell) || robots.clone().any(stays) {
                continue;
            }
            let tied = self.longest_trains(cell);
            if tied.count_ones() > 1 {
                ties.push(robots.clone().filter(|robot| tied >> robot & 1 == 1).collect());
            }
        }
        ties.sort();
        ties
    }
}

/// Distinct cells in the order of their first mention.
struct Cells {
    cells: [Cell; MAX_CELLS],
    length: usize,
}

impl Cells {
    fn new() -> Cells {
        Cells { cells: [0; MAX_CELLS], length: 0 }
    }

    fn list(&self) -> &[Cell] {
        &self.cells[..self.length]
    }

    fn add(&mut self, cell: Cell) {
        if !self.list().contains(&cell) {
            self.cells[self.length] = cell;
            self.length += 1;
        }
    }
}
