//! The start of an episode (lbf §3, §8). The positions of the last episode do not matter.

use rand::RngCore;

use super::{Food, Foraging, Player};
use crate::draw::{below, between};

/// Tries to place one player, and all foods together (lbf §3).
const TRIES: u32 = 1000;
const PLAYER_LEVELS: (u16, u16) = (1, 2);
/// Two foods are further apart than this, in steps: the block and the two bars of rule 4 together.
const FOOD_DISTANCE: u16 = 2;

impl Foraging {
    pub(super) fn draw_start(&mut self, rng: &mut dyn RngCore) {
        self.clear_foods();
        self.place_players(rng);
        self.place_foods(rng);
        self.level_sum_at_reset = self.foods.iter().map(|food| u32::from(food.level)).sum();
        self.step = 0;
        (self.items_collected, self.levels_collected) = (0, 0);
        self.effective.fill(super::NONE);
        self.earned.fill(0.0);
    }

    pub(super) fn clear_foods(&mut self) {
        while let Some(food) = self.foods.pop() {
            let cell = self.cell(food.row, food.col);
            self.field[cell] = 0;
        }
    }

    /// Adds a food at its place in row-major order.
    pub(super) fn put_food(&mut self, food: Food) {
        let cell = self.cell(food.row, food.col);
        self.field[cell] = food.level;
        let place = self.foods.partition_point(|other| (other.row, other.col) < (food.row, food.col));
        self.foods.insert(place, food);
    }

    fn place_players(&mut self, rng: &mut dyn RngCore) {
        let rows = self.config.rules.spawn_cells(self.config.rows);
        let cols = self.config.rules.spawn_cells(self.config.cols);
        for i in 0..self.players.len() {
            let mut place = (0, 0);
            for _ in 0..TRIES {
                place = (between(rng, 0, rows - 1), between(rng, 0, cols - 1));
                if !self.is_taken(i, place) {
                    break;
                }
            }
            if self.is_taken(i, place) {
                // Reached only on an almost full grid, and rarely then.
                let mut cells = (0..rows).flat_map(|row| (0..cols).map(move |col| (row, col)));
                place =
                    cells.find(|&cell| !self.is_taken(i, cell)).expect("the players fit, checked in `new`");
            }
            let level = between(rng, PLAYER_LEVELS.0, PLAYER_LEVELS.1);
            self.players[i] = Player { row: place.0, col: place.1, level };
        }
    }

    /// Whether one of the first `placed` players stands there.
    fn is_taken(&self, placed: usize, place: (u16, u16)) -> bool {
        self.players[..placed].iter().any(|player| (player.row, player.col) == place)
    }

    fn place_foods(&mut self, rng: &mut dyn RngCore) {
        let top = self.config.rules.top_food_level(self.players.iter().map(|player| player.level));
        let (low, high) = self.config.rules.food_levels(self.config.coop, top);
        let inner = (u32::from(self.config.rows) - 2, u32::from(self.config.cols) - 2);
        for _ in 0..TRIES {
            if self.foods.len() == usize::from(self.config.foods) {
                return;
            }
            let (row, col) = (1 + below(rng, inner.0) as u16, 1 + below(rng, inner.1) as u16);
            let crowded = |food: &Food| food.row.abs_diff(row) + food.col.abs_diff(col) <= FOOD_DISTANCE;
            if self.foods.iter().any(crowded) || self.is_taken(self.players.len(), (row, col)) {
                continue;
            }
            // A fixed level is not drawn.
            let level = if low == high { low } else { between(rng, low, high) };
            self.put_food(Food { row, col, level });
        }
    }
}
