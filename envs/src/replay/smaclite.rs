//! The replay of a recorded battle: every step starts from the state recorded before it, with the recorded orders of
//! acting, and every value is compared.
//!
//! Positions are single precision, and where bodies touch to the last bit one unit in the last place decides which way
//! they turn. The reference's own re-implementations differ there too, so up to 1 step in 200 is excused whose
//! positions differ a little (smaclite §11); one that differs otherwise is not.

use std::collections::BTreeMap;
use std::io::BufRead;

use serde::Deserialize;

use super::episode::{check_length, check_same, play, Damage, Episodes, RecordedSizes, Trace};
use super::record::{EpymarlHeader, EpymarlStep};
use super::{Findings, Lines, ReplayError, Report};
use crate::smaclite::{Battle, State, UnitState};
use crate::{End, World};

/// Of health, shields, energy, times and rewards.
const EXACT: f64 = 1e-9;
const PLACES: f64 = 1e-4;
/// What moves a unit by so much in a tick.
const SPEEDS: f64 = 16.0 * PLACES;
const VIEWS: f64 = 1e-5;

/// A step is excused where a place differs by more than this and by less than that.
const TOUCHING: std::ops::Range<f64> = 1e-5..0.05;
/// One step of so many.
const EXCUSED: u64 = 200;

pub(super) fn replay<R: BufRead>(lines: Lines<R>, task: String) -> Result<Report, ReplayError> {
    let header: Header = lines.parse()?;
    let world = world(&header, &task).map_err(|what| lines.damaged(what))?;
    let trace = Trace::new(world.sizes());
    let rewards = vec![0.0; world.sizes().agents];
    let before = world.state();
    play(lines, task, Replay { world, rewards, before, steps: 0, touching: Vec::new() }, trace)
}

#[derive(Deserialize)]
struct Header {
    n_agents: usize,
    n_actions: Vec<usize>,
    obs_sizes: Vec<usize>,
    episode_limit: u32,
    agents: Vec<String>,
    params: Params,
    epymarl: EpymarlHeader,
}

#[derive(Deserialize)]
struct Params {
    n_enemies: usize,
    ticks_per_step: usize,
    max_reward: f64,
    max_unit_radius: f64,
    width: u32,
    height: u32,
    attack_point: [f64; 2],
    unit_type_one_hot: BTreeMap<String, usize>,
    obstacles_xywh: Vec<[u32; 4]>,
    units: Vec<UnitOfHeader>,
}

#[derive(Deserialize)]
struct UnitOfHeader {
    id: usize,
    id_in_faction: usize,
    faction: Faction,
    #[serde(rename = "type")]
    kind: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Faction {
    Ally,
    Enemy,
}

#[derive(Deserialize)]
struct Reset {
    episode: u64,
    state: Start,
    obs: Vec<Vec<f64>>,
    avail_actions: Vec<Vec<u8>>,
    global_state: Vec<f64>,
}

#[derive(Deserialize)]
struct Start {
    units: Vec<UnitOfStart>,
}

#[derive(Deserialize)]
struct UnitOfStart {
    id: usize,
    alive: u8,
    pos: Option<[f64; 2]>,
    vel: Option<[f64; 2]>,
    hp: f64,
    shield: f64,
    energy: f64,
    healing_available: f64,
    cooldown: f64,
    shield_cooldown: f64,
    attacking: u8,
    target: i64,
}

#[derive(Deserialize)]
struct Step {
    episode: u64,
    t: u64,
    actions: Vec<u16>,
    random: Random,
    rewards: Vec<f64>,
    obs: Vec<Vec<f64>>,
    terminated: bool,
    truncated: bool,
    info: Info,
    avail_actions: Vec<Vec<u8>>,
    epymarl: EpymarlStep,
    state: Later,
    global_state: Vec<f64>,
}

#[derive(Deserialize)]
struct Random {
    tick_orders: Vec<Vec<usize>>,
}

#[derive(Deserialize)]
struct Info {
    battle_won: bool,
}

/// The state after a step: a row for each living unit.
#[derive(Deserialize)]
struct Later {
    fields: Vec<String>,
    units: Vec<Row>,
}

/// In the order of [`FIELDS`].
type Row = (usize, [f64; 2], [f64; 2], f64, f64, f64, f64, f64, f64, u8, i64);

const FIELDS: [&str; 11] = [
    "id",
    "pos",
    "vel",
    "hp",
    "shield",
    "energy",
    "healing_available",
    "cooldown",
    "shield_cooldown",
    "attacking",
    "target",
];

/// The battle that the header describes.
fn world(header: &Header, task: &str) -> Result<Battle, Damage> {
    let Params { width, height, attack_point, .. } = header.params;
    let recorded = &header.params.units;
    let enemies = recorded.iter().filter(|unit| unit.faction == Faction::Enemy).count();
    check_same("params.n_enemies", &enemies, &header.params.n_enemies)?;
    check_same("n_agents", &(recorded.len() - enemies), &header.n_agents)?;
    for (id, unit) in recorded.iter().enumerate() {
        let is_ally = id < header.n_agents;
        let field = |name: &str| format!("params.units[{id}].{name}");
        check_same(&field("id"), &id, &unit.id)?;
        check_same(&field("faction"), &if is_ally { Faction::Ally } else { Faction::Enemy }, &unit.faction)?;
        let in_faction = if is_ally { id } else { id - header.n_agents };
        check_same(&field("id_in_faction"), &in_faction, &unit.id_in_faction)?;
    }
    let units: Vec<(bool, &str)> =
        recorded.iter().map(|unit| (unit.faction == Faction::Ally, unit.kind.as_str())).collect();
    let rectangles = header.params.obstacles_xywh.clone();
    let limit = header.episode_limit;
    let world = Battle::recorded(task, [width, height], rectangles, attack_point, &units, limit)
        .map_err(|why| format!("params: {why}"))?;
    check_same("params.ticks_per_step", &crate::smaclite::TICKS_PER_STEP, &header.params.ticks_per_step)?;
    check_same("params.max_reward", &world.max_reward(), &header.params.max_reward)?;
    check_same("params.max_unit_radius", &world.max_radius(), &header.params.max_unit_radius)?;
    let types = world.type_names().into_iter().map(str::to_owned).zip(0..).collect();
    check_same("params.unit_type_one_hot", &types, &header.params.unit_type_one_hot)?;
    let sizes = RecordedSizes {
        agents: &header.agents,
        obs_sizes: &header.obs_sizes,
        n_actions: &header.n_actions,
        episode_limit: header.episode_limit,
        epymarl: &header.epymarl,
    };
    sizes.check_with_state(world.sizes(), world.global_state_size())?;
    Ok(world)
}

struct Replay {
    world: Battle,
    /// Scratch.
    rewards: Vec<f64>,
    /// As recorded: where the next step starts.
    before: State,
    steps: u64,
    /// What differs in the steps that may be excused: the number of values, and the first of them.
    touching: Vec<Findings>,
}

impl Episodes for Replay {
    type Reset = Reset;
    type Step = Step;

    fn reset(&mut self, reset: &Reset, trace: &mut Trace) -> Result<(), Damage> {
        trace.check_over()?;
        trace.check_views(&reset.obs, &reset.avail_actions)?;
        let count = self.before.units.len();
        check_length("state.units", count, reset.state.units.len())?;
        check_length("global_state", self.world.global_state_size(), reset.global_state.len())?;
        let mut units = Vec::new();
        for (id, unit) in reset.state.units.iter().enumerate() {
            check_same(&format!("state.units[{id}].id"), &id, &unit.id)?;
            units.push(unit.state(id)?);
        }
        self.before = State { units, step: 0 };
        self.world.set_state(&self.before).map_err(|error| format!("state: {error}"))?;
        trace.begin(reset.episode);
        self.compare_views(&reset.obs, &reset.avail_actions, &reset.global_state, &mut trace.findings);
        Ok(())
    }

    fn step(&mut self, step: &Step, trace: &mut Trace) -> Result<(), Damage> {
        trace.check_next(step.episode, step.t)?;
        trace.check_views(&step.obs, &step.avail_actions)?;
        trace.check_actions(&step.actions)?;
        check_length("rewards", self.rewards.len(), step.rewards.len())?;
        check_length("random.tick_orders", crate::smaclite::TICKS_PER_STEP, step.random.tick_orders.len())?;
        check_length("global_state", self.world.global_state_size(), step.global_state.len())?;
        check_same("state.fields", &FIELDS.map(str::to_owned).to_vec(), &step.state.fields)?;
        let after = self.recorded_state(&step.state, step.t)?;

        // Recorded a record ago, so it was checked when it was read.
        self.world.set_state(&self.before).map_err(|error| format!("state before the step: {error}"))?;
        let (mut orders, mut strange) = (step.random.tick_orders.iter(), None);
        let end = self.world.step_with(&step.actions, &mut self.rewards, |living| {
            let order = orders.next().expect("one for each tick");
            let mut sorted = order.clone();
            sorted.sort_unstable();
            if sorted == living {
                living.copy_from_slice(order);
            } else if strange.is_none() {
                strange = Some((sorted, living.to_vec()));
            }
        });

        let mut found = Findings { t: step.t, ..Findings::default() };
        (found.line, found.episode) = (trace.findings.line, trace.findings.episode);
        if let Some((recorded, living)) = strange {
            found.whole(|| "random.tick_orders".to_owned(), &recorded, &living);
        }
        self.compare_views(&step.obs, &step.avail_actions, &step.global_state, &mut found);
        let farthest = self.compare_state(&after, &mut found);
        let terminated = end == End::Terminated;
        let truncated = step.t >= u64::from(self.world.sizes().episode_limit);
        found.within("rewards", &step.rewards, &self.rewards, EXACT);
        found.value("terminated", &step.terminated, &terminated);
        found.value("truncated", &step.truncated, &false);
        found.value("info.battle_won", &step.info.battle_won, &self.world.is_won());
        found.within("epymarl.reward", &[step.epymarl.reward], &self.rewards[..1], EXACT);
        found.value("epymarl.terminated", &step.epymarl.terminated, &terminated);
        found.value("epymarl.truncated", &step.epymarl.truncated, &truncated);

        self.steps += 1;
        trace.findings.t = step.t;
        if found.mismatches > 0 && TOUCHING.contains(&farthest) {
            self.touching.push(found);
        } else {
            trace.findings.add(found);
        }
        trace.settle(terminated || truncated, step.terminated || step.truncated || truncated);
        self.before = after;
        Ok(())
    }

    /// Too many are no accident: then all of them count.
    fn excused(&mut self, findings: &mut Findings) -> u64 {
        let steps = self.touching.len() as u64;
        if steps <= self.steps.div_ceil(EXCUSED) {
            return steps;
        }
        self.touching.drain(..).for_each(|found| findings.add(found));
        0
    }
}

impl Replay {
    fn recorded_state(&self, recorded: &Later, t: u64) -> Result<State, Damage> {
        let mut units = vec![None; self.before.units.len()];
        for (
            k,
            &(
                id,
                pos,
                vel,
                hp,
                shield,
                energy,
                healing_available,
                cooldown,
                shield_cooldown,
                attacking,
                target,
            ),
        ) in recorded.units.iter().enumerate()
        {
            let state = UnitState {
                pos,
                vel,
                hp,
                shield,
                energy,
                healing_available,
                cooldown,
                shield_cooldown,
                attacking,
                target,
            };
            let place = units.get_mut(id).filter(|place| place.is_none());
            *place.ok_or_else(|| {
                format!("expected another unit of the battle in `state.units[{k}]`, found {id}")
            })? = Some(state);
        }
        let state = State { units, step: u32::try_from(t).unwrap_or(u32::MAX) };
        self.world.check_state(&state).map_err(|error| format!("state: {error}"))?;
        Ok(state)
    }

    /// Compares what each agent and what a centralised learner sees.
    fn compare_views(&self, obs: &[Vec<f64>], avail: &[Vec<u8>], global: &[f64], findings: &mut Findings) {
        let sizes = self.world.sizes();
        for (i, (obs, mask)) in obs.iter().zip(avail).enumerate() {
            let mut seen = vec![0.0; sizes.obs_size[i]];
            self.world.observe(i, &mut seen);
            findings.within(&format!("obs[{i}]"), obs, &widened(&seen), VIEWS);
            let mut available = vec![0; sizes.n_actions[i]];
            self.world.available(i, &mut available);
            findings.list(&format!("avail_actions[{i}]"), mask, &available);
        }
        let mut seen = vec![0.0; self.world.global_state_size()];
        self.world.global_state(&mut seen);
        findings.within("global_state", global, &widened(&seen), VIEWS);
    }

    /// Compares the state after a step, and says how far the worst place is off.
    fn compare_state(&self, recorded: &State, findings: &mut Findings) -> f64 {
        let found = self.world.state();
        let mut farthest: f64 = 0.0;
        for (id, units) in recorded.units.iter().zip(&found.units).enumerate() {
            let field = |name: &str| format!("state.units[{id}].{name}");
            let (expected, found) = match units {
                (Some(expected), Some(found)) => (expected, found),
                (None, None) => continue,
                (expected, found) => {
                    findings.value(&field("alive"), &expected.is_some(), &found.is_some());
                    continue;
                }
            };
            for (expected, found) in expected.pos.iter().zip(&found.pos) {
                farthest = farthest.max((expected - found).abs());
            }
            findings.within(&field("pos"), &expected.pos, &found.pos, PLACES);
            findings.within(&field("vel"), &expected.vel, &found.vel, SPEEDS);
            for (name, expected, found) in [
                ("hp", expected.hp, found.hp),
                ("shield", expected.shield, found.shield),
                ("energy", expected.energy, found.energy),
                ("healing_available", expected.healing_available, found.healing_available),
                ("cooldown", expected.cooldown, found.cooldown),
                ("shield_cooldown", expected.shield_cooldown, found.shield_cooldown),
            ] {
                findings.within(&field(name), &[expected], &[found], EXACT);
            }
            findings.value(&field("attacking"), &expected.attacking, &found.attacking);
            findings.whole(|| field("target"), &expected.target, &found.target);
        }
        farthest
    }
}

impl UnitOfStart {
    fn state(&self, id: usize) -> Result<Option<UnitState>, Damage> {
        if self.alive == 0 {
            return Ok(None);
        }
        let missing = |name: &str| format!("expected numbers in `state.units[{id}].{name}`, found none");
        Ok(Some(UnitState {
            pos: self.pos.ok_or_else(|| missing("pos"))?,
            vel: self.vel.ok_or_else(|| missing("vel"))?,
            hp: self.hp,
            shield: self.shield,
            energy: self.energy,
            healing_available: self.healing_available,
            cooldown: self.cooldown,
            shield_cooldown: self.shield_cooldown,
            attacking: self.attacking,
            target: self.target,
        }))
    }
}

fn widened(seen: &[f32]) -> Vec<f64> {
    seen.iter().copied().map(f64::from).collect()
}
