//! Multi-robot warehouse: robots on a grid carry requested shelves to the goals and put them back.
//!
//! The rules are in `docs/spec/rware.md`; comments cite its sections. The only randomness in a step is the shelf that
//! is requested after a delivery. A step allocates nothing.

mod config;
mod floor;
mod layout;
mod name;
mod pair_set;
mod registered;
mod requests;
mod reset;
mod scene;
mod state;
mod traffic;

use rand::RngCore;
use serde::Deserialize;

pub use config::{Config, Impossible, Rules};
use floor::{Floor, SEEN};
pub use layout::Layout;
use name::{parse, NameError, FORM};
pub(crate) use requests::Requests;
pub use state::{Robot, State, StateError};
use traffic::Traffic;

use crate::family::{Family, Made, Refusal, Request};
use crate::scene::Scene;
use crate::{End, Opponent, Sizes, World};

pub(crate) static FAMILY: Family = Family {
    name: "rware",
    title: "Multi-robot warehouse",
    about: "Robots drive through a warehouse, lift shelves and carry them. Some shelves are requested; a robot that \
            brings one to a goal earns 1, and another shelf is requested in its place. Robots without load pass \
            under shelves, robots with a load do not, and no two share a cell. A robot sees where it is and, around \
            itself, robots, shelves and which of them are requested; it chooses between nothing, driving ahead, \
            turning left or right, and lifting or putting down. Rewards are rare: most random episodes have none.",
    // Those of the multi-timescale study, then more of the usual benchmark.
    tasks: &[
        "rware-tiny-2ag",
        "rware-tiny-4ag",
        "rware-small-4ag",
        "rware-tiny-2ag-easy",
        "rware-tiny-2ag-hard",
        "rware-tiny-4ag-hard",
        "rware-small-2ag",
        "rware-medium-6ag",
        "rware-large-8ag",
    ],
    form: FORM,
    rules: &["v2", "v1"],
    paper_rules: "v1",
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
        return Err(Refusal::Opponent("a warehouse has no opponent to choose".to_owned()));
    }
    let rules = match request.rules {
        Some(version) => Rules::parse(version).ok_or_else(|| Refusal::Rules(version.to_owned()))?,
        None => config.rules,
    };
    let config = Config { rules, ..config };
    let name = config.name();
    let world = Warehouse::new(config).map_err(|why| Refusal::Impossible(why.to_string()))?;
    Ok(Made { name, rules: rules.name(), source: rules.source(), world: Box::new(world) })
}

/// The actions, as `step` takes them (rware §5). Higher numbers count as [`NOOP`].
pub const NOOP: u16 = 0;
pub const FORWARD: u16 = 1;
pub const TURN_LEFT: u16 = 2;
pub const TURN_RIGHT: u16 = 3;
pub const TOGGLE_LOAD: u16 = 4;
pub const N_ACTIONS: usize = 5;

/// Numbers about the robot itself, at the start of an observation (rware §6).
const OF_ITSELF: usize = 8;

/// The direction of a robot, numbered as in observations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Direction {
    Up = 0,
    Down = 1,
    Left = 2,
    Right = 3,
}

impl Direction {
    pub const ALL: [Direction; 4] = [Direction::Up, Direction::Down, Direction::Left, Direction::Right];

    fn turned_right(self) -> Direction {
        match self {
            Direction::Up => Direction::Right,
            Direction::Right => Direction::Down,
            Direction::Down => Direction::Left,
            Direction::Left => Direction::Up,
        }
    }

    fn turned_left(self) -> Direction {
        self.turned_right().turned_right().turned_right()
    }
}

/// The world. Make one with [`Warehouse::new`], then `reset` or [`Warehouse::set_state`].
#[derive(Debug, Clone)]
pub struct Warehouse {
    config: Config,
    layout: Layout,
    sizes: Sizes,
    robots: Vec<Robot>,
    /// Holds the shelves, and the robots a second time, by cell.
    floor: Floor,
    requests: Requests,
    step: u32,
    /// Shelves delivered since the start of the episode.
    deliveries: u32,
    /// The actions of the last step, with [`NOOP`] for moves that were not granted.
    effective: Vec<u16>,
    traffic: Traffic,
}

impl Warehouse {
    /// A world with all shelves on their slots and the robots in the first cells. Reset it before use.
    pub fn new(config: Config) -> Result<Warehouse, Impossible> {
        let layout = config.layout()?;
        let agents = usize::from(config.robots);
        let side = 2 * usize::from(config.sensor_range) + 1;
        let sizes = Sizes {
            agents,
            obs_size: vec![OF_ITSELF + side * side * SEEN; agents],
            n_actions: vec![N_ACTIONS; agents],
            episode_limit: config.episode_limit,
        };
        let robot = |cell| {
            let (x, y) = (cell % layout.width, cell / layout.width);
            Robot { x, y, direction: Direction::Up, carrying: None }
        };
        let mut world = Warehouse {
            robots: (0..config.robots).map(robot).collect(),
            floor: Floor::new(&layout, config.sensor_range),
            requests: Requests::new(config.requests, layout.slots.len()),
            step: 0,
            deliveries: 0,
            effective: vec![NOOP; agents],
            traffic: Traffic::new(agents),
            sizes,
            layout,
            config,
        };
        world.fill_floor();
        Ok(world)
    }

    pub fn config(&self) -> &Config {
        &self.config
    }

    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The actions of the last step, with [`NOOP`] for moves that were not granted (rware §5.2).
    pub fn effective_actions(&self) -> &[u16] {
        &self.effective
    }

    /// The ties of the last step: groups of robots (from 0, ascending) that wanted one free cell, with equally long
    /// trains behind them (rware §5.3). [`Warehouse::effective_actions`] shows which of them moved.
    pub fn ties(&self) -> Vec<Vec<usize>> {
        self.traffic.ties()
    }

    /// A step in which `redraw` chooses each newly requested shelf: one of [`Requests::unrequested`].
    pub(crate) fn step_with(
        &mut self,
        actions: &[u16],
        rewards: &mut [f64],
        redraw: impl FnMut(&Requests) -> u16,
    ) -> End {
        assert_eq!(actions.len(), self.robots.len(), "one action per robot");
        assert_eq!(rewards.len(), self.robots.len(), "one place per robot for rewards");
        self.step = self.step.saturating_add(1);
        rewards.fill(0.0);
        self.want_cells(actions);
        self.traffic.settle(&self.floor);
        self.act();
        self.deliver(rewards, redraw);
        if self.step >= self.config.episode_limit {
            End::TimeLimit
        } else {
            End::Running
        }
    }

    /// Sets the cell that each robot wants; a robot with a load stays if a shelf stands ahead (rware §5.1).
    fn want_cells(&mut self, actions: &[u16]) {
        for (i, (robot, &action)) in self.robots.iter().zip(actions).enumerate() {
            let own = self.floor.cell(robot.place());
            let (action, wanted) = match action {
                FORWARD if robot.faces_wall(&self.layout) => (FORWARD, own),
                FORWARD => match self.floor.ahead(own, robot.direction) {
                    ahead if robot.carrying.is_some() && self.is_shelf_standing(ahead) => (NOOP, own),
                    ahead => (FORWARD, ahead),
                },
                TURN_LEFT..=TOGGLE_LOAD => (action, own),
                _ => (NOOP, own),
            };
            self.effective[i] = action;
            self.traffic.own[i] = own;
            self.traffic.wanted[i] = wanted;
        }
    }

    /// A shelf on a cell stands there, unless the robot on that cell has a load: then it carries this shelf.
    fn is_shelf_standing(&self, cell: usize) -> bool {
        let is_loaded = |robot: usize| self.robots[robot].carrying.is_some();
        self.floor.shelf(cell).is_some() && !self.floor.robot(cell).is_some_and(is_loaded)
    }

    /// Carries out the granted actions (rware §5.4). All robots leave their cells before any enters a new one, which
    /// may be another's old cell.
    fn act(&mut self) {
        let Traffic { own, wanted, granted } = &self.traffic;
        for (i, robot) in self.robots.iter_mut().enumerate() {
            if !granted[i] {
                self.effective[i] = NOOP;
                continue;
            }
            let cell = own[i];
            match self.effective[i] {
                FORWARD if wanted[i] != cell => {
                    self.floor.lift_robot(cell);
                    if robot.carrying.is_some() {
                        self.floor.lift_shelf(cell);
                    }
                }
                TURN_LEFT | TURN_RIGHT => {
                    let right = self.effective[i] == TURN_RIGHT;
                    let facing = robot.direction;
                    robot.direction = if right { facing.turned_right() } else { facing.turned_left() };
                    self.floor.put_robot(cell, i, robot.direction);
                }
                TOGGLE_LOAD if robot.carrying.is_none() => robot.carrying = self.floor.shelf(cell),
                TOGGLE_LOAD if !self.layout.is_highway(robot.x, robot.y) => robot.carrying = None,
                _ => {}
            }
        }
        for (i, robot) in self.robots.iter_mut().enumerate() {
            if self.effective[i] == FORWARD && wanted[i] != own[i] {
                (robot.x, robot.y) = self.floor.place(wanted[i]);
                self.floor.put_robot(wanted[i], i, robot.direction);
                if let Some(shelf) = robot.carrying {
                    self.floor.put_shelf(wanted[i], shelf, self.requests.contains(shelf));
                }
            }
        }
    }

    /// Deliveries (rware §5.5). A shelf on the second goal that is drawn for the first is delivered in the same step.
    fn deliver(&mut self, rewards: &mut [f64], mut redraw: impl FnMut(&Requests) -> u16) {
        for goal in self.layout.goals {
            let cell = self.floor.cell(goal);
            let Some(shelf) = self.floor.shelf(cell).filter(|&shelf| self.requests.contains(shelf)) else {
                continue;
            };
            // Only in a state set by a test can a shelf be here without a robot. The reference then uses the index −1,
            // which is the last robot.
            let robot = self.floor.robot(cell).unwrap_or(rewards.len() - 1);
            rewards[robot] += 1.0;
            self.deliveries = self.deliveries.saturating_add(1);
            let next = redraw(&self.requests);
            self.requests.replace(shelf, next);
            self.floor.mark(shelf, false);
            self.floor.mark(next, true);
        }
    }
}

impl World for Warehouse {
    fn sizes(&self) -> &Sizes {
        &self.sizes
    }

    fn reset(&mut self, rng: &mut dyn RngCore) {
        self.draw_start(rng);
    }

    fn step(&mut self, actions: &[u16], rng: &mut dyn RngCore, rewards: &mut [f64]) -> End {
        self.step_with(actions, rewards, |requests| requests.draw(rng))
    }

    /// The robot itself, then the square around it (rware §6).
    fn observe(&self, agent: usize, out: &mut [f32]) {
        assert_eq!(out.len(), self.sizes.obs_size[agent], "one place per observed number");
        let Robot { x, y, direction, carrying } = self.robots[agent];
        let (itself, around) = out.split_at_mut(OF_ITSELF);
        let flag = |yes: bool| f32::from(u8::from(yes));
        itself.fill(0.0);
        itself[0] = f32::from(x);
        itself[1] = f32::from(y);
        itself[2] = flag(carrying.is_some());
        itself[3 + direction as usize] = 1.0;
        itself[7] = flag(self.layout.is_highway(x, y));
        self.floor.look(self.floor.cell((x, y)), around);
    }

    fn facts(&self, report: &mut dyn FnMut(&'static str, f64)) {
        report("deliveries", f64::from(self.deliveries));
    }

    fn scene(&self) -> Scene {
        self.draw()
    }

    fn copy(&self) -> Box<dyn World> {
        Box::new(self.clone())
    }
}
