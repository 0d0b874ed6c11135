//! Level-based foraging: players walk on a grid and eat foods that need enough levels side by side.
//!
//! The rules are in `docs/spec/lbf.md`; comments cite its sections. All randomness is in the reset. A step is
//! deterministic and allocates nothing.

mod capacity;
mod config;
mod name;
mod registered;
mod reset;
mod rules;
mod scene;
mod state;

use rand::RngCore;

pub use config::{Config, Impossible};
use name::{parse, NameError, FORM};
pub use rules::Rules;
pub use state::{Food, Player, State, StateError};

use crate::family::{Family, Made, Refusal, Request};
use crate::scene::Scene;
use crate::{End, Opponent, Sizes, World};

pub(crate) static FAMILY: Family = Family {
    name: "lbf",
    title: "Level-based foraging",
    about: "Players walk on a grid and eat food together. Every player and every food has a level; a food is eaten \
            when players who stand beside it and load at the same time have its level between them, and each is \
            rewarded with its share of it. All food of an episode is worth 1 to the team. A player sees the food \
            and the players in sight, with their levels, and chooses between nothing, four moves and loading. In a \
            cooperative (`coop`) task no player can eat alone.",
    // Those of the multi-timescale study, then the rest of the usual benchmark.
    tasks: &[
        "lbf-5x5-2p-1f",
        "lbf-8x8-2p-2f-coop",
        "lbf-10x10-3p-3f",
        "lbf-15x15-4p-3f",
        "lbf-2s-8x8-2p-2f-coop",
        "lbf-2s-10x10-3p-3f",
        "lbf-15x15-3p-5f",
        "lbf-15x15-4p-5f",
    ],
    form: FORM,
    rules: &["v3", "v2", "v1", "v0"],
    paper_rules: "v2",
    make,
};

fn make(request: &Request) -> Option<Result<Made, Refusal>> {
    let config = match parse(request.name)? {
        Ok(config) => config,
        Err(NameError::Impossible(why)) => return Some(Err(Refusal::Impossible(why.to_string()))),
        Err(why @ NameError::Part { .. }) => return Some(Err(Refusal::Name(why.to_string()))),
        Err(why) => return Some(Err(Refusal::Missing(why.to_string()))),
    };
    Some(made(config, request))
}

fn made(config: Config, request: &Request) -> Result<Made, Refusal> {
    if *request.opponent != Opponent::Builtin {
        return Err(Refusal::Opponent("foraging has no opponent to choose".to_owned()));
    }
    let rules = match request.rules {
        Some(version) => Rules::parse(version).ok_or_else(|| Refusal::Rules(version.to_owned()))?,
        None => config.rules,
    };
    let config = Config { rules, ..config };
    let name = config.name();
    let world = Foraging::new(config).map_err(|why| Refusal::Impossible(why.to_string()))?;
    Ok(Made { name, rules: rules.name(), source: rules.source(), world: Box::new(world) })
}

/// The actions, as `step` takes them (lbf §4). Higher numbers count as [`NONE`].
pub const NONE: u16 = 0;
pub const NORTH: u16 = 1;
pub const SOUTH: u16 = 2;
pub const WEST: u16 = 3;
pub const EAST: u16 = 4;
pub const LOAD: u16 = 5;
pub const N_ACTIONS: usize = 6;

/// Food level of the cells around the grid, so that one comparison excludes food and walls.
const WALL: u16 = u16::MAX;

/// The world. Make one with [`Foraging::new`], then `reset` or [`Foraging::set_state`].
#[derive(Debug, Clone)]
pub struct Foraging {
    config: Config,
    sizes: Sizes,
    players: Vec<Player>,
    /// The foods left, in row-major order, as observations list them.
    foods: Vec<Food>,
    /// Food level by cell; one cell of [`WALL`] around the grid.
    field: Vec<u16>,
    level_sum_at_reset: u32,
    /// Since the start of the episode.
    items_collected: u32,
    levels_collected: u32,
    step: u32,
    /// The actions of the last step, with [`NONE`] for invalid ones.
    effective: Vec<u16>,
    /// The rewards of the last step, for pictures.
    earned: Vec<f64>,
    /// Work space of a step: the cell that each player names, and the number of players that name each cell (zero
    /// between steps).
    named: Vec<usize>,
    named_by: Vec<u8>,
}

impl Foraging {
    /// A world without foods, with all players in the upper left corner at level 1. Reset it before use.
    pub fn new(config: Config) -> Result<Foraging, Impossible> {
        config.check()?;
        let agents = usize::from(config.players);
        let obs_size = 3 * (usize::from(config.foods) + agents);
        let sizes = Sizes {
            agents,
            obs_size: vec![obs_size; agents],
            n_actions: vec![N_ACTIONS; agents],
            episode_limit: config.episode_limit,
        };
        let (rows, stride) = (usize::from(config.rows), usize::from(config.cols) + 2);
        let mut field = vec![WALL; (rows + 2) * stride];
        for row in 1..=rows {
            field[row * stride + 1..(row + 1) * stride - 1].fill(0);
        }
        Ok(Foraging {
            players: vec![Player { row: 0, col: 0, level: 1 }; agents],
            foods: Vec::with_capacity(usize::from(config.foods)),
            named_by: vec![0; field.len()],
            field,
            level_sum_at_reset: 0,
            items_collected: 0,
            levels_collected: 0,
            step: 0,
            effective: vec![NONE; agents],
            earned: vec![0.0; agents],
            named: vec![0; agents],
            sizes,
            config,
        })
    }

    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The actions of the last step, with [`NONE`] for invalid ones. A move that another player blocked is still a move
    /// here (lbf §4, §5.2).
    pub fn effective_actions(&self) -> &[u16] {
        &self.effective
    }

    fn stride(&self) -> usize {
        usize::from(self.config.cols) + 2
    }

    fn cell(&self, row: u16, col: u16) -> usize {
        (usize::from(row) + 1) * self.stride() + usize::from(col) + 1
    }

    fn is_food(&self, cell: usize) -> bool {
        (1..WALL).contains(&self.field[cell])
    }

    /// The neighbours of a cell of the grid: north, south, west, east.
    fn neighbours(&self, cell: usize) -> [usize; 4] {
        [cell - self.stride(), cell + self.stride(), cell - 1, cell + 1]
    }

    /// Replaces invalid actions and sets the cell that each player names (lbf §4, §5.2).
    fn name_cells(&mut self, actions: &[u16]) {
        for (i, &action) in actions.iter().enumerate() {
            let own = self.cell(self.players[i].row, self.players[i].col);
            let neighbours = self.neighbours(own);
            let (action, named) = match action {
                NORTH..=EAST => match neighbours[usize::from(action - NORTH)] {
                    target if self.field[target] == 0 => (action, target),
                    _ => (NONE, own),
                },
                LOAD if neighbours.into_iter().any(|cell| self.is_food(cell)) => (LOAD, own),
                _ => (NONE, own),
            };
            self.effective[i] = action;
            self.named[i] = named;
            self.named_by[named] += 1;
        }
    }

    /// A player gets the cell that it alone names (lbf §5.2). A player that fails to leave stays, even if another one
    /// has entered its cell, so two players can share a cell.
    fn move_players(&mut self) {
        for ((player, &action), &named) in self.players.iter_mut().zip(&self.effective).zip(&self.named) {
            if self.named_by[named] == 1 {
                match action {
                    NORTH => player.row -= 1,
                    SOUTH => player.row += 1,
                    WEST => player.col -= 1,
                    EAST => player.col += 1,
                    _ => {}
                }
            }
        }
        for &named in &self.named {
            self.named_by[named] = 0;
        }
    }

    /// Loading (lbf §5.3). Takes loaders in index order, each with all others beside the same food. The order of foods
    /// has no effect, except in a state set by a test in which a player stands beside two foods: then the first in the
    /// order north, south, west, east is loaded.
    fn load(&mut self, rewards: &mut [f64]) {
        // Loaders have named their own cell. From here on `named` lists the loaders that are not done.
        /// Marks a player who does not load or is done.
        const NO_LOADER: usize = usize::MAX;
        for (named, &action) in self.named.iter_mut().zip(&self.effective) {
            if action != LOAD {
                *named = NO_LOADER;
            }
        }
        for first in 0..self.named.len() {
            if self.named[first] == NO_LOADER {
                continue;
            }
            let Some(food) = self.neighbours(self.named[first]).into_iter().find(|&cell| self.is_food(cell))
            else {
                continue;
            };
            let around = self.neighbours(food);
            let beside = |cell: usize| around.contains(&cell); // never true for NO_LOADER
            let food_level = u64::from(self.field[food]);
            let strength: u64 = (first..self.named.len())
                .filter(|&i| beside(self.named[i]))
                .map(|i| u64::from(self.players[i].level))
                .sum();
            let eaten = strength >= food_level;
            for (i, reward) in rewards.iter_mut().enumerate().skip(first) {
                if !beside(self.named[i]) {
                    continue;
                }
                *reward = if eaten {
                    // Two exact integers and one division: equal to the reference in every bit.
                    let earned = u64::from(self.players[i].level) * food_level;
                    earned as f64 / (strength * u64::from(self.level_sum_at_reset)) as f64
                } else {
                    0.0 - self.config.penalty
                };
                self.named[i] = NO_LOADER;
            }
            if eaten {
                self.items_collected += 1;
                self.levels_collected += food_level as u32;
                self.remove_food(food);
            }
        }
    }

    /// Later foods move up one place in the observation (lbf §6).
    fn remove_food(&mut self, cell: usize) {
        self.field[cell] = 0;
        let stride = self.stride();
        self.foods.retain(|food| (usize::from(food.row) + 1) * stride + usize::from(food.col) + 1 != cell);
    }
}

impl World for Foraging {
    fn sizes(&self) -> &Sizes {
        &self.sizes
    }

    fn warning(&self) -> Option<String> {
        self.config.warning()
    }

    fn reset(&mut self, rng: &mut dyn RngCore) {
        self.draw_start(rng);
    }

    fn step(&mut self, actions: &[u16], _: &mut dyn RngCore, rewards: &mut [f64]) -> End {
        assert_eq!(actions.len(), self.players.len(), "one action per player");
        assert_eq!(rewards.len(), self.players.len(), "one place per player for rewards");
        self.step = self.step.saturating_add(1);
        rewards.fill(0.0);
        self.name_cells(actions);
        self.move_players();
        if self.effective.contains(&LOAD) {
            self.load(rewards);
        }
        self.earned.copy_from_slice(rewards);
        if self.foods.is_empty() {
            End::Terminated
        } else if self.step >= self.config.episode_limit {
            End::TimeLimit
        } else {
            End::Running
        }
    }

    /// The foods in sight, the observer, the others in sight; each as row, column, level (lbf §6).
    fn observe(&self, agent: usize, out: &mut [f32]) {
        assert_eq!(out.len(), self.sizes.obs_size[agent], "one place per observed number");
        let me = self.players[agent];
        let sight = self.config.sight;
        // The origin of coordinates: the corner of the grid if all of it is in sight.
        let (top, left) = (me.row - me.row.min(sight), me.col - me.col.min(sight));
        let (food_slots, player_slots) = out.split_at_mut(3 * usize::from(self.config.foods));

        let near = |food: &&Food| food.row.abs_diff(me.row) <= sight && food.col.abs_diff(me.col) <= sight;
        let foods = self.foods.iter().filter(near).map(|food| (food.row - top, food.col - left, food.level));
        fill(food_slots, foods);

        // Players are seen in a full window from that corner, even where the grid's edge moves it off centre.
        let span = 2 * sight;
        let seen = |p: &&Player| (top..=top + span).contains(&p.row) && (left..=left + span).contains(&p.col);
        let (before, after) = (&self.players[..agent], &self.players[agent + 1..]);
        let others = before.iter().chain(after).filter(seen);
        let players = std::iter::once(&me).chain(others);
        fill(player_slots, players.map(|p| (p.row - top, p.col - left, p.level)));
    }

    fn facts(&self, report: &mut dyn FnMut(&'static str, f64)) {
        report("items_collected", f64::from(self.items_collected));
        report("levels_collected", f64::from(self.levels_collected));
    }

    fn scene(&self) -> Scene {
        self.draw()
    }

    fn copy(&self) -> Box<dyn World> {
        Box::new(self.clone())
    }
}

/// Writes `things` as triples and fills the rest with the triple for nothing.
fn fill(slots: &mut [f32], things: impl Iterator<Item = (u16, u16, u16)>) {
    let mut slots = slots.chunks_exact_mut(3);
    for ((row, col, level), slot) in things.zip(&mut slots) {
        slot.copy_from_slice(&[f32::from(row), f32::from(col), f32::from(level)]);
    }
    slots.for_each(|slot| slot.copy_from_slice(&[-1.0, -1.0, 0.0]));
}
