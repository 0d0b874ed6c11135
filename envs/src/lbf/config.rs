//! The parameters of a foraging world, and their checks.

use super::rules::Rules;

/// The longest side of a grid: far beyond any published task. Cell numbers still fit.
const MAX_SIDE: u16 = 255;
/// The most players: an observation grows with them, all observations together with their square.
const MAX_PLAYERS: u16 = 64;

/// The parameters of a foraging world.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    pub rows: u16,
    pub cols: u16,
    pub players: u16,
    /// Foods placed by a reset; fewer when there is no room.
    pub foods: u16,
    /// Every food needs the three weakest players together (lbf §3).
    pub coop: bool,
    /// How many cells away a player sees; the longer side or more shows everything.
    pub sight: u16,
    /// Subtracted from the reward of each player whose loading fails.
    pub penalty: f64,
    /// Steps after which an episode ends in any case.
    pub episode_limit: u32,
    pub rules: Rules,
}

/// Why a world with these numbers cannot exist.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Impossible {
    #[error("{axis} must be 3 to {MAX_SIDE} (no food lies on the border), not {found}")]
    Side { axis: &'static str, found: u16 },
    #[error("the number of players must be 1 to {MAX_PLAYERS}, not {found}")]
    Players { found: u16 },
    #[error("{players} players do not fit on {cells} cells, which is where they start on this grid")]
    Crowd { players: u16, cells: u32 },
    #[error("there must be at least 1 food, or an episode is over at once")]
    NoFood,
    #[error("{players} players take all {cells} cells of the grid, so no food can ever be placed")]
    Full { players: u16, cells: u32 },
    #[error("the number of foods must be 1 to {cells}, one for each cell of the grid, not {found}")]
    Foods { found: u16, cells: u32 },
    #[error("a player must see at least 1 cell far, not {found}")]
    Sight { found: u16 },
    #[error("the penalty must be a finite number, not {found}")]
    Penalty { found: f64 },
    #[error("the step limit must be at least 1, not 0")]
    EpisodeLimit,
}

impl Config {
    /// Checks that the world can exist. More foods than fit are allowed, as in the reference: see [`Config::warning`].
    pub(super) fn check(&self) -> Result<(), Impossible> {
        for (axis, found) in [("the number of rows", self.rows), ("the number of columns", self.cols)] {
            if !(3..=MAX_SIDE).contains(&found) {
                return Err(Impossible::Side { axis, found });
            }
        }
        let (players, foods) = (self.players, self.foods);
        if !(1..=MAX_PLAYERS).contains(&players) {
            return Err(Impossible::Players { found: players });
        }
        let spawn = |cells| u32::from(self.rules.spawn_cells(cells));
        let cells = spawn(self.rows) * spawn(self.cols);
        if u32::from(players) > cells {
            return Err(Impossible::Crowd { players, cells });
        }
        if foods == 0 {
            return Err(Impossible::NoFood);
        }
        let cells = u32::from(self.rows) * u32::from(self.cols);
        if u32::from(players) == cells {
            return Err(Impossible::Full { players, cells });
        }
        if u32::from(foods) > cells {
            return Err(Impossible::Foods { found: foods, cells });
        }
        if self.sight == 0 {
            return Err(Impossible::Sight { found: self.sight });
        }
        if !self.penalty.is_finite() {
            return Err(Impossible::Penalty { found: self.penalty });
        }
        if self.episode_limit == 0 {
            return Err(Impossible::EpisodeLimit);
        }
        Ok(())
    }

    /// A warning if not all foods fit: a reset places as many as possible (lbf §3, rule 4), and observations keep a
    /// place for each of them.
    pub(super) fn warning(&self) -> Option<String> {
        let foods = self.foods;
        let room = super::capacity::shortfall(self.rows, self.cols, foods)?;
        Some(format!(
            "a reset places at most {room} of the {foods} foods: none lies on the border, and any two are at least \
             three steps apart"
        ))
    }
}
