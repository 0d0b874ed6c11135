//! The complete state of a foraging world, to read and to set, as replays of traces do.

use serde::Deserialize;

use super::{Foraging, WALL};

/// Everything that the rest of an episode depends on (lbf §2).
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct State {
    /// In index order. Two may share a cell.
    pub players: Vec<Player>,
    /// The remaining foods, in row-major order; [`Foraging::set_state`] accepts any order.
    pub foods: Vec<Food>,
    /// `S` of lbf §2, which normalises rewards.
    pub food_level_sum_at_reset: u32,
    /// Steps taken in the episode.
    pub step: u32,
}

/// Row 0 is the north, column 0 the west.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub struct Player {
    pub row: u16,
    pub col: u16,
    pub level: u16,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub struct Food {
    pub row: u16,
    pub col: u16,
    pub level: u16,
}

/// Why a state cannot be set.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    #[error("expected {expected} players, found {found}")]
    Players { expected: usize, found: usize },
    #[error("expected at most {expected} foods, found {found}")]
    Foods { expected: u16, found: usize },
    #[error("{who} is at row {row}, column {col}, outside of the {rows}x{cols} grid")]
    Outside { who: String, row: u16, col: u16, rows: u16, cols: u16 },
    #[error("{who} is on the cell of a food (row {row}, column {col})")]
    OnFood { who: String, row: u16, col: u16 },
    #[error("{who} has level {level}; levels are 1 to {}", WALL - 1)]
    Level { who: String, level: u16 },
    #[error("food_level_sum_at_reset is 0, but there are foods; rewards are divided by it")]
    NoSum,
}

impl Foraging {
    /// The present state.
    pub fn state(&self) -> State {
        State {
            players: self.players.clone(),
            foods: self.foods.clone(),
            food_level_sum_at_reset: self.level_sum_at_reset,
            step: self.step,
        }
    }

    /// Sets the state, which need not be one that a reset can draw. After an error the world is unchanged.
    pub fn set_state(&mut self, state: &State) -> Result<(), StateError> {
        self.check_state(state)?;
        self.clear_foods();
        for &food in &state.foods {
            self.put_food(food);
        }
        self.players.copy_from_slice(&state.players);
        self.level_sum_at_reset = state.food_level_sum_at_reset;
        self.step = state.step;
        (self.items_collected, self.levels_collected) = (0, 0);
        self.effective.fill(super::NONE);
        self.earned.fill(0.0);
        Ok(())
    }

    fn check_state(&self, state: &State) -> Result<(), StateError> {
        let (expected, found) = (self.players.len(), state.players.len());
        if found != expected {
            return Err(StateError::Players { expected, found });
        }
        let (expected, found) = (self.config.foods, state.foods.len());
        if found > usize::from(expected) {
            return Err(StateError::Foods { expected, found });
        }
        let (rows, cols) = (self.config.rows, self.config.cols);
        let check = |who: &dyn Fn() -> String, row: u16, col: u16, level: u16| {
            if row >= rows || col >= cols {
                return Err(StateError::Outside { who: who(), row, col, rows, cols });
            }
            if !(1..WALL).contains(&level) {
                return Err(StateError::Level { who: who(), level });
            }
            Ok(())
        };
        for (k, food) in state.foods.iter().enumerate() {
            let (who, place) = (|| format!("food {k}"), (food.row, food.col));
            check(&who, food.row, food.col, food.level)?;
            if state.foods[..k].iter().any(|other| (other.row, other.col) == place) {
                return Err(StateError::OnFood { who: who(), row: food.row, col: food.col });
            }
        }
        for (i, player) in state.players.iter().enumerate() {
            let (who, place) = (|| format!("player {i}"), (player.row, player.col));
            check(&who, player.row, player.col, player.level)?;
            if state.foods.iter().any(|food| (food.row, food.col) == place) {
                return Err(StateError::OnFood { who: who(), row: player.row, col: player.col });
            }
        }
        if state.food_level_sum_at_reset == 0 && !state.foods.is_empty() {
            return Err(StateError::NoSum);
        }
        Ok(())
    }
}
