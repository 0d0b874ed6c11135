//! Battles of small armies by the published rules of SMAClite, which are StarCraft's in outline.
//!
//! The comments cite docs/spec/smaclite.md. All chance is in the order in which units act within a tick; a step
//! allocates nothing.

mod crowd;
mod formation;
mod map;
mod name;
mod scene;
mod set;
mod solve;
mod state;
mod tick;
mod unit;
mod vec2;
mod views;
mod walls;

use std::sync::Arc;

use rand::RngCore;

use crowd::Crowd;
pub use map::MapError;
use map::{Map, Side};
use name::FORM;
pub(crate) use name::{made_of_map, no_opponent, BadMap};
use set::Set;
use solve::HalfPlane;
pub(crate) use state::Choice;
pub use state::{State, StateError, UnitState};
use unit::Plane;
pub(crate) use unit::TICKS as TICKS_PER_STEP;
use vec2::{vec2, Vec2};

use crate::draw::below;
use crate::family::Family;
use crate::scene::Scene;
use crate::{End, Sizes, World};

pub(crate) static FAMILY: Family = Family {
    name: "smaclite",
    title: "Small battles (SMAClite)",
    about: "Two armies fight; the team's agents are the units of one side, each sees what is within 9 cells of it and \
            chooses between standing still, four directions, and one enemy to shoot at (a medivac: one ally to heal) \
            within 6 cells. Enemies march on the team's start and shoot whom they meet, healers first. Everybody earns \
            the same: the damage done, 10 for each enemy killed and 200 for the battle, scaled so that a battle won is \
            worth 20. The dead can do nothing but action 0 and see zeros. These are SMAClite's rules, not StarCraft \
            II: a step is 0.5 s instead of 0.36 s, shots hit at once, nobody turns, accelerates or finds ways around \
            walls, the enemies follow this one simple plan, and every battle starts from the same places. Results here \
            and results of SMAC cannot be compared. The limit is EPyMARL's 150 steps; with the rules `smac-limits`, \
            which --paper takes, it is that of the map in SMAC. `--map FILE` plays a map of your own.",
    tasks: &[
        "smaclite-mmm2",
        "smaclite-3s5z",
        "smaclite-3s_vs_5z",
        "smaclite-2s3z",
        "smaclite-3m",
        "smaclite-8m",
        "smaclite-mmm",
        "smaclite-3s5z_vs_3s6z",
        "smaclite-27m_vs_30m",
        "smaclite-bane_vs_bane",
        "smaclite-2c_vs_64zg",
        "smaclite-corridor",
    ],
    form: FORM,
    rules: &["smaclite", "smac-limits"],
    paper_rules: "smac-limits",
    make: name::make,
};

/// The actions, as `step` takes them (smaclite §4); [`TARGET`] + k is target k.
pub const NOOP: u16 = 0;
pub const STOP: u16 = 1;
pub const NORTH: u16 = 2;
pub const WEST: u16 = 5;
pub const TARGET: u16 = 6;

/// Of north, south, east and west.
const DIRECTIONS: [Vec2; 4] = [vec2(0.0, 1.0), vec2(0.0, -1.0), vec2(1.0, 0.0), vec2(-1.0, 0.0)];

/// How far a move goes if it takes the whole step, and how far ahead it has to be free.
const MOVE: f64 = 2.0;
const FREE: f64 = 1.0;

/// What a battle won earns, besides 10 for each enemy (smaclite §9).
const VICTORY: f64 = 200.0;
const KILL: f64 = 10.0;
/// What all of a battle is scaled to.
const RETURN: f64 = 20.0;

/// What a unit was told to do. Whom a target means does not depend on who is alive.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Order {
    Stop,
    Move(Vec2),
    Target(usize),
    /// March to the map's point and fight on the way: the enemies, all of the battle.
    Advance,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Unit {
    at: [f32; 2],
    velocity: Vec2,
    health: f64,
    shield: f64,
    energy: f64,
    /// Of the energy spent, what was not healed with yet, in health.
    healing: f64,
    cooldown: f64,
    shield_cooldown: f64,
    target: Option<usize>,
    attacking: bool,
    order: Order,
}

impl Unit {
    fn place(&self) -> Vec2 {
        vec2(f64::from(self.at[0]), f64::from(self.at[1]))
    }
}

/// From one to another, in the precision of positions.
fn towards(from: [f32; 2], to: [f32; 2]) -> Vec2 {
    vec2(f64::from(to[0] - from[0]), f64::from(to[1] - from[1]))
}

fn distance(from: [f32; 2], to: [f32; 2]) -> f64 {
    let along = |axis: usize| f64::from(to[axis]) - f64::from(from[axis]);
    vec2(along(0), along(1)).length()
}

/// The numbers of a unit's type that a tick needs at hand.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Facts {
    kind: usize,
    radius: f64,
    speed: f64,
    range: f64,
    heals: bool,
    plane: Plane,
    /// Whom it can hit or heal, of both sides, the dead included.
    can_hit: Set,
}

/// A battle. Make one through [`crate::task`], then `reset` or [`Battle::set_state`].
#[derive(Debug, Clone)]
pub struct Battle {
    map: Arc<Map>,
    sizes: Sizes,
    facts: Arc<[Facts]>,
    /// `damage[a][v]`: of one attack of type a on type v.
    damage: Arc<[Vec<f64>]>,
    max_radius: f64,
    /// Of each plane, the dead included.
    ground: Set,
    allies: Set,
    healers: Set,
    /// Whether observations tell the shields of allies, and of enemies.
    shields: [bool; 2],
    type_bits: usize,
    units: Vec<Unit>,
    living: Set,
    step: u32,
    last_actions: Vec<u16>,
    /// So far in this episode.
    damage_dealt: f64,
    damage_taken: f64,
    scratch: Scratch,
}

/// Filled anew in every tick, kept to allocate nothing.
#[derive(Debug, Clone)]
struct Scratch {
    crowd: Crowd,
    /// Targets before the tick.
    before: Vec<Option<usize>>,
    wanted: Vec<Vec2>,
    velocities: Vec<Vec2>,
    order: Vec<usize>,
    planes: Vec<HalfPlane>,
    more_planes: Vec<HalfPlane>,
}

impl Battle {
    /// A battle that is to be reset first.
    fn new(map: Arc<Map>, episode_limit: u32) -> Battle {
        let count = map.units.len();
        let kinds: Vec<&unit::Kind> = (0..count).map(|unit| map.kind(unit)).collect();
        let of_plane = |plane| (0..count).filter(|&unit| kinds[unit].plane == plane).collect::<Set>();
        let (ground, air) = (of_plane(Plane::Ground), of_plane(Plane::Air));
        let facts = |(unit, kind): (usize, &&unit::Kind)| {
            let on = |plane, units| if kind.can_hit(plane) { units } else { Set::default() };
            Facts {
                kind: map.units[unit].kind,
                radius: kind.radius(),
                speed: kind.speed,
                range: kind.range,
                heals: kind.heals,
                plane: kind.plane,
                can_hit: on(Plane::Ground, ground).or(on(Plane::Air, air)),
            }
        };
        let facts: Arc<[Facts]> = kinds.iter().enumerate().map(facts).collect();
        let damage =
            map.kinds.iter().map(|(_, from)| map.kinds.iter().map(|(_, to)| from.damage_to(to)).collect());
        let mut battle = Battle {
            sizes: views::sizes(&map, episode_limit),
            damage: damage.collect(),
            max_radius: facts.iter().fold(0.0, |most, facts| facts.radius.max(most)),
            ground,
            allies: (0..map.allies).collect(),
            healers: (0..count).filter(|&unit| facts[unit].heals).collect(),
            shields: [Side::Allies, Side::Enemies].map(|side| map.has_shields(side)),
            type_bits: map.type_bits(),
            units: Vec::with_capacity(count),
            living: Set::default(),
            step: 0,
            last_actions: vec![NOOP; map.allies],
            damage_dealt: 0.0,
            damage_taken: 0.0,
            scratch: Scratch {
                crowd: Crowd::new(map.width, map.height),
                before: vec![None; count],
                wanted: vec![Vec2::ZERO; count],
                velocities: vec![Vec2::ZERO; count],
                order: Vec::with_capacity(count),
                planes: Vec::with_capacity(4 * map.walls.len() + count),
                more_planes: Vec::with_capacity(4 * map.walls.len() + count),
            },
            facts,
            map,
        };
        battle.begin();
        battle
    }

    /// The battle that a recorded trace describes: its units, each with its side and type, allies first. They have no
    /// places until [`Battle::set_state`].
    pub(crate) fn recorded(
        name: &str,
        size: [u32; 2],
        rectangles: Vec<[u32; 4]>,
        attack: [f64; 2],
        units: &[(bool, &str)],
        episode_limit: u32,
    ) -> Result<Battle, String> {
        if units.len() > set::MOST_UNITS {
            return Err(format!("expected at most {} units, found {}", set::MOST_UNITS, units.len()));
        }
        let [width, height] = size;
        let outside = |&&[x, y, w, h]: &&[u32; 4]| {
            let beyond = |at: u32, length, most| at.checked_add(length).is_none_or(|end| end > most);
            beyond(x, w, width) || beyond(y, h, height)
        };
        if width == 0 || height == 0 || width > map::LARGEST || height > map::LARGEST {
            return Err(format!(
                "expected a map of up to {} cells each way, found {width} x {height}",
                map::LARGEST
            ));
        }
        if let Some(wall) = rectangles.iter().find(outside) {
            return Err(format!("expected obstacles on the map of {width} x {height} cells, found {wall:?}"));
        }
        if let Some((_, kind)) = units.iter().find(|(_, kind)| unit::Kind::known(kind).is_none()) {
            return Err(map::unknown_unit(kind));
        }
        let side = |is_ally| if is_ally { Side::Allies } else { Side::Enemies };
        let units: Vec<_> = units.iter().map(|&(is_ally, kind)| (side(is_ally), kind, [0.0; 2])).collect();
        let ground = map::Ground { size, rectangles, attack };
        let map = map::assemble(name, ground, &units, unit::Kind::known);
        if map.allies == 0 || map.enemies() == 0 {
            return Err("expected units on both sides".to_owned());
        }
        Ok(Battle::new(Arc::new(map), episode_limit))
    }

    /// The bits of observations that tell types: the name of each type.
    pub(crate) fn type_names(&self) -> Vec<&str> {
        let names = self.map.kinds.iter().map(|(name, _)| name.as_str());
        names.take(self.type_bits).collect()
    }

    pub(crate) fn max_radius(&self) -> f64 {
        self.max_radius
    }

    /// smaclite §3: everybody in formation, unhurt.
    fn begin(&mut self) {
        self.units.clear();
        for (unit, placed) in self.map.units.iter().enumerate() {
            let kind = self.map.kind(unit);
            self.units.push(Unit {
                at: placed.at,
                velocity: Vec2::ZERO,
                health: kind.health,
                shield: kind.shield,
                energy: if kind.heals { unit::FIRST_ENERGY } else { 0.0 },
                healing: 0.0,
                cooldown: 0.0,
                shield_cooldown: 0.0,
                target: None,
                attacking: false,
                order: if placed.side == Side::Allies { Order::Stop } else { Order::Advance },
            });
        }
        self.living = (0..self.units.len()).collect();
        self.last_actions.fill(NOOP);
        (self.step, self.damage_dealt, self.damage_taken) = (0, 0.0, 0.0);
    }

    fn is_ally(&self, unit: usize) -> bool {
        unit < self.map.allies
    }

    fn enemies(&self) -> Set {
        self.living.minus(self.allies)
    }

    /// No enemy is left.
    pub(crate) fn is_won(&self) -> bool {
        self.enemies().is_empty()
    }

    /// A step in which `shuffle` puts the living units into the order in which they act, once a tick.
    pub(crate) fn step_with(
        &mut self,
        actions: &[u16],
        rewards: &mut [f64],
        mut shuffle: impl FnMut(&mut [usize]),
    ) -> End {
        assert_eq!(actions.len(), self.map.allies, "one action per agent");
        assert_eq!(rewards.len(), self.map.allies, "one place per agent for rewards");
        self.step = self.step.saturating_add(1);
        self.give_orders(actions);
        let mut earned = 0.0;
        for _ in 0..TICKS_PER_STEP {
            earned += self.tick(&mut shuffle);
        }
        if self.is_won() {
            earned += VICTORY;
        }
        rewards.fill(earned / (self.max_reward() / RETURN));
        if self.is_won() || self.living.and(self.allies).is_empty() {
            End::Terminated
        } else if self.step >= self.sizes.episode_limit {
            End::TimeLimit
        } else {
            End::Running
        }
    }

    /// An action that is not available is as good as standing still.
    fn give_orders(&mut self, actions: &[u16]) {
        for (agent, &action) in actions.iter().enumerate() {
            let is_alive = self.living.contains(agent);
            let action = if self.is_available(agent, action) {
                action
            } else if is_alive {
                STOP
            } else {
                NOOP
            };
            self.last_actions[agent] = action;
            let order = match action {
                NORTH..=WEST => {
                    Order::Move(self.units[agent].place() + MOVE * DIRECTIONS[usize::from(action - NORTH)])
                }
                TARGET.. => Order::Target(self.target_of(agent, action)),
                _ => Order::Stop,
            };
            self.units[agent].order = order;
        }
    }

    /// Whom an action aims at: healers at allies, all others at enemies.
    fn target_of(&self, agent: usize, action: u16) -> usize {
        let first = if self.facts[agent].heals { 0 } else { self.map.allies };
        first + usize::from(action - TARGET)
    }

    /// R (smaclite §9).
    pub(crate) fn max_reward(&self) -> f64 {
        let enemies = (self.map.allies..self.units.len()).map(|unit| self.map.kind(unit));
        VICTORY + enemies.fold(0.0, |sum, kind| sum + KILL + kind.health + kind.shield)
    }
}

impl World for Battle {
    fn sizes(&self) -> &Sizes {
        &self.sizes
    }

    fn warning(&self) -> Option<String> {
        self.map.note.clone()
    }

    fn reset(&mut self, _: &mut dyn RngCore) {
        self.begin();
    }

    fn step(&mut self, actions: &[u16], rng: &mut dyn RngCore, rewards: &mut [f64]) -> End {
        self.step_with(actions, rewards, |order| {
            for last in (1..order.len()).rev() {
                order.swap(last, below(rng, last as u32 + 1) as usize);
            }
        })
    }

    fn shares_reward(&self) -> bool {
        true
    }

    fn observe(&self, agent: usize, out: &mut [f32]) {
        self.view(agent, out);
    }

    fn available(&self, agent: usize, out: &mut [u8]) {
        self.mask(agent, out);
    }

    fn facts(&self, report: &mut dyn FnMut(&'static str, f64)) {
        report("battle_won", f64::from(u8::from(self.is_won())));
        report("allies_left", self.living.and(self.allies).len() as f64);
        report("enemies_left", self.enemies().len() as f64);
        report("damage_dealt", self.damage_dealt);
        report("damage_taken", self.damage_taken);
    }

    fn scene(&self) -> Scene {
        self.draw()
    }

    fn copy(&self) -> Box<dyn World> {
        Box::new(self.clone())
    }
}
