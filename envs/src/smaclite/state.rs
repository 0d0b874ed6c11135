//! The complete state of a battle, to look at or to put a world into, as recorded traces do.

use std::sync::Arc;

use serde::Deserialize;

use super::set::Set;
use super::vec2::{vec2, Vec2};
use super::{Battle, Map};

/// Places and speeds beyond this are no state that a battle comes into.
const FARTHEST: f64 = 1e6;

/// Everything that decides how an episode goes on, besides the step (smaclite §5).
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// By their number; none for the dead.
    pub units: Vec<Option<UnitState>>,
    pub step: u32,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct UnitState {
    pub pos: [f64; 2],
    pub vel: [f64; 2],
    pub hp: f64,
    pub shield: f64,
    pub energy: f64,
    pub healing_available: f64,
    pub cooldown: f64,
    pub shield_cooldown: f64,
    /// 0 or 1.
    pub attacking: u8,
    /// -1 is nobody.
    pub target: i64,
}

/// Why a battle cannot be put into a state.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StateError {
    #[error("expected {expected} units, found {found}")]
    Count { expected: usize, found: usize },
    #[error("unit {unit}: expected {what}, found {found}")]
    Unit { unit: usize, what: String, found: String },
}

impl Battle {
    /// The battle of a task's name, unhurt and in formation.
    ///
    /// # Errors
    /// If no such map comes with the program.
    pub fn of_task(name: &str) -> Result<Battle, String> {
        let map = name.strip_prefix("smaclite-").and_then(Map::built_in);
        let map = map.ok_or_else(|| {
            format!("expected a battle that comes with the program in `task`, found `{name}`")
        })?;
        let limit = map.limit;
        Ok(Battle::new(Arc::new(map), limit))
    }

    /// The state now.
    pub fn state(&self) -> State {
        let unit = |unit: usize| {
            let own = &self.units[unit];
            self.living.contains(unit).then(|| UnitState {
                pos: own.at.map(f64::from),
                vel: [own.velocity.x, own.velocity.y],
                hp: own.health,
                shield: own.shield,
                energy: own.energy,
                healing_available: own.healing,
                cooldown: own.cooldown,
                shield_cooldown: own.shield_cooldown,
                attacking: u8::from(own.attacking),
                target: own.target.map_or(-1, |target| target as i64),
            })
        };
        State { units: (0..self.units.len()).map(unit).collect(), step: self.step }
    }

    /// Goes on from a state. What the episode has come to so far (damage done) starts from nothing.
    ///
    /// # Errors
    /// If there is no such state.
    pub fn set_state(&mut self, state: &State) -> Result<(), StateError> {
        self.check_state(state)?;
        self.begin();
        for unit in &mut self.units {
            unit.health = 0.0;
        }
        self.put(state);
        Ok(())
    }

    /// Whether a battle can be in a state.
    ///
    /// # Errors
    /// With the first thing that cannot be.
    pub fn check_state(&self, state: &State) -> Result<(), StateError> {
        let count = self.map.units.len();
        if state.units.len() != count {
            return Err(StateError::Count { expected: count, found: state.units.len() });
        }
        let living = state.units.iter().enumerate().filter_map(|(unit, own)| Some((unit, own.as_ref()?)));
        living.into_iter().try_for_each(|(unit, own)| self.judge(unit, own))
    }

    fn put(&mut self, state: &State) {
        self.step = state.step;
        self.living = Set::default();
        for (unit, own) in state.units.iter().enumerate() {
            let Some(state) = own else { continue };
            self.living.insert(unit);
            let own = &mut self.units[unit];
            own.at = state.pos.map(|at| at as f32);
            own.velocity = vec2(state.vel[0], state.vel[1]);
            own.health = state.hp;
            own.shield = state.shield;
            own.energy = state.energy;
            own.healing = state.healing_available;
            own.cooldown = state.cooldown;
            own.shield_cooldown = state.shield_cooldown;
            own.attacking = state.attacking == 1;
            own.target = usize::try_from(state.target).ok();
        }
    }

    fn judge(&self, unit: usize, state: &UnitState) -> Result<(), StateError> {
        let kind = self.map.kind(unit);
        let bad = |what: String, found: String| Err(StateError::Unit { unit, what, found });
        for (name, [x, y]) in [("pos", state.pos), ("vel", state.vel)] {
            if !(x.abs() <= FARTHEST && y.abs() <= FARTHEST) {
                return bad(format!("numbers within ±{FARTHEST} in `{name}`"), format!("[{x}, {y}]"));
            }
        }
        let most_energy = if kind.heals { super::unit::MOST_ENERGY } else { 0.0 };
        for (name, value, least, most) in [
            ("hp", state.hp, 0.0, kind.health),
            ("shield", state.shield, 0.0, kind.shield),
            ("energy", state.energy, 0.0, most_energy),
            ("healing_available", state.healing_available, 0.0, super::unit::MOST_ENERGY),
            ("cooldown", state.cooldown, 0.0, f64::MAX),
            ("shield_cooldown", state.shield_cooldown, 0.0, super::unit::SHIELD_PAUSE),
        ] {
            if !(least..=most).contains(&value) {
                return bad(format!("`{name}` from {least} to {most}"), value.to_string());
            }
        }
        if state.hp == 0.0 {
            return bad("a living unit to have health".to_owned(), "`hp` 0".to_owned());
        }
        if state.attacking > 1 {
            return bad("0 or 1 in `attacking`".to_owned(), state.attacking.to_string());
        }
        if !(-1..self.map.units.len() as i64).contains(&state.target) {
            return bad("another unit or -1 in `target`".to_owned(), state.target.to_string());
        }
        Ok(())
    }
}

/// What one unit made up its mind to in a tick, before anybody acts.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Choice {
    pub wanted: [f64; 2],
    pub target: i64,
    pub attacking: u8,
}

/// A battle tick by tick, for the comparison with recorded ticks.
impl Battle {
    pub(crate) fn living(&self) -> Vec<usize> {
        self.living.into_iter().collect()
    }

    /// Goes on from a state within a step, by the orders that were given. What was done to the dead stays.
    pub(crate) fn enter(&mut self, state: &State) -> Result<(), StateError> {
        self.check_state(state)?;
        self.put(state);
        Ok(())
    }

    /// Begins a step whose ticks are played one by one.
    pub(crate) fn order(&mut self, actions: &[u16]) {
        self.step += 1;
        self.give_orders(actions);
    }

    /// The new velocities that follow from wanted ones, by unit, whatever led to these (smaclite §7).
    pub(crate) fn velocities(&mut self, wanted: &[(usize, [f64; 2])]) -> Vec<[f64; 2]> {
        for &(unit, [x, y]) in wanted {
            self.scratch.wanted[unit] = vec2(x, y);
        }
        self.fill_crowd();
        self.avoid();
        wanted.iter().map(|&(unit, _)| both(self.scratch.velocities[unit])).collect()
    }

    /// What everybody chooses in this tick, by unit.
    pub(crate) fn choices(&mut self) -> Vec<Choice> {
        self.choose();
        let choice = |unit: usize| {
            let own = &self.units[unit];
            Choice {
                wanted: both(self.scratch.wanted[unit]),
                target: own.target.map_or(-1, |target| target as i64),
                attacking: u8::from(own.attacking),
            }
        };
        self.living.into_iter().map(choice).collect()
    }

    /// What follows from the choices, in this order.
    pub(crate) fn act_in(&mut self, order: &[usize]) {
        order.iter().for_each(|&unit| {
            self.act(unit);
        });
        self.bury();
    }
}

fn both(v: Vec2) -> [f64; 2] {
    [v.x, v.y]
}
