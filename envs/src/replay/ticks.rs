//! The replay of recorded ticks: battles from the inside, the first steps of some episodes.
//!
//! An episode is played on from tick to tick; before each, places and velocities are set to the recorded ones, so that
//! differences do not grow. Compared is what everybody chose, what follows from the recorded wanted velocities alone,
//! and what the tick before led to. Only maps that come with the program can be played.

use std::io::BufRead;

use serde::Deserialize;

use super::episode::{check_length, check_same, Damage};
use super::record::Kind;
use super::{Findings, Lines, ReplayError, Report};
use crate::smaclite::{Battle, Choice, TICKS_PER_STEP};
use crate::World;

const EXACT: f64 = 1e-9;
const PLACES: f64 = 1e-4;
/// Of what follows from recorded wanted velocities.
const SPEEDS: f64 = 3e-5;

#[derive(Deserialize)]
struct Episode {
    task: String,
    episode: u64,
    fields: Vec<String>,
}

#[derive(Deserialize)]
struct Tick {
    task: String,
    episode: u64,
    t: u64,
    tick: usize,
    actions: Vec<u16>,
    order: Vec<usize>,
    units: Vec<Row>,
}

/// In the order of [`FIELDS`], for each living unit.
type Row = (usize, [f64; 2], [f64; 2], [f64; 2], [f64; 2], i64, u8, f64, f64, f64);

const FIELDS: [&str; 10] =
    ["id", "pos", "vel_before", "wanted", "new_vel", "target", "attacking", "hp", "shield", "cooldown"];

/// From a file whose first line has been read.
pub(super) fn replay<R: BufRead>(mut lines: Lines<R>) -> Result<Report, ReplayError> {
    let (mut findings, mut episodes, mut steps) = (Findings::default(), 0, 0);
    let mut playing: Option<Playing> = None;
    loop {
        findings.line = lines.number;
        let Kind { kind } = lines.parse()?;
        match kind.as_str() {
            "episode" => {
                let episode: Episode = lines.parse()?;
                playing.iter().try_for_each(Playing::check_over).map_err(|what| lines.damaged(what))?;
                playing = Some(Playing::start(&episode).map_err(|what| lines.damaged(what))?);
                episodes += 1;
            }
            "tick" => {
                let tick: Tick = lines.parse()?;
                let playing = playing.as_mut().expect("the first line is an episode's");
                playing.tick(&tick, &mut findings).map_err(|what| lines.damaged(what))?;
                steps += u64::from(tick.tick == 0);
            }
            _ => {
                let what = format!("expected a record of type `episode` or `tick`, found `{kind}`");
                return Err(lines.damaged(what));
            }
        }
        if !lines.advance()? {
            break;
        }
    }
    playing.iter().try_for_each(Playing::check_over).map_err(|what| lines.damaged(what))?;
    let Findings { mismatches, first, .. } = findings;
    Ok(Report { task: "smaclite-ticks".to_owned(), episodes, steps, mismatches, first, excused: 0 })
}

/// An episode that is being played.
struct Playing {
    task: String,
    episode: u64,
    world: Battle,
    /// The step and the tick in it that come next.
    next: (u64, usize),
}

impl Playing {
    fn start(episode: &Episode) -> Result<Playing, Damage> {
        check_same("fields", &FIELDS.map(str::to_owned).to_vec(), &episode.fields)?;
        let world = Battle::of_task(&episode.task)?;
        Ok(Playing { task: episode.task.clone(), episode: episode.episode, world, next: (1, 0) })
    }

    /// Steps are recorded with all of their ticks.
    fn check_over(&self) -> Result<(), Damage> {
        match self.next {
            (_, 0) => Ok(()),
            (t, tick) => Err(format!(
                "expected tick {tick} of step {t} of episode {}, found the end of the episode",
                self.episode
            )),
        }
    }

    fn tick(&mut self, tick: &Tick, findings: &mut Findings) -> Result<(), Damage> {
        check_same("task", &self.task, &tick.task)?;
        check_same("episode", &self.episode, &tick.episode)?;
        check_same("(t, tick)", &self.next, &(tick.t, tick.tick))?;
        check_length("actions", self.world.sizes().agents, tick.actions.len())?;
        (findings.episode, findings.t) = (tick.episode, tick.t);
        let is_first = self.next == (1, 0);
        self.enter(tick, is_first, findings)?;
        if tick.tick == 0 {
            // Whom they can aim at depends on where everybody is.
            self.world.order(&tick.actions);
        }

        // By section 7 alone, from the recorded wanted velocities.
        let wanted: Vec<(usize, [f64; 2])> = tick.units.iter().map(|row| (row.0, row.3)).collect();
        let velocities = self.world.velocities(&wanted);
        for (row, found) in tick.units.iter().zip(velocities) {
            findings.within(&format!("tick {} unit {} new_vel", tick.tick, row.0), &row.4, &found, SPEEDS);
        }
        // By the rules as a whole.
        for (row, found) in tick.units.iter().zip(self.world.choices()) {
            let &(unit, _, _, ref wanted, _, target, attacking, ..) = row;
            let field = |name: &str| format!("tick {} unit {unit} {name}", tick.tick);
            let Choice { wanted: found_wanted, target: found_target, attacking: found_attacking } = found;
            findings.within(&field("wanted"), wanted, &found_wanted, SPEEDS);
            findings.whole(|| field("target"), &target, &found_target);
            findings.value(&field("attacking"), &attacking, &found_attacking);
        }
        let mut sorted = tick.order.clone();
        sorted.sort_unstable();
        check_same("order", &self.world.living(), &sorted)?;
        self.world.act_in(&tick.order);
        self.next = if tick.tick + 1 == TICKS_PER_STEP { (tick.t + 1, 0) } else { (tick.t, tick.tick + 1) };
        Ok(())
    }

    /// Compares what came out of the tick before, and goes to the recorded state.
    fn enter(&mut self, tick: &Tick, is_first: bool, findings: &mut Findings) -> Result<(), Damage> {
        let mut state = self.world.state();
        let mut living = vec![false; state.units.len()];
        for &(unit, pos, vel, _, _, _, _, hp, shield, cooldown) in &tick.units {
            if living.get(unit) != Some(&false) {
                return Err(format!("expected another unit of the battle in `units`, found {unit}"));
            }
            living[unit] = true;
            let Some(found) = &mut state.units[unit] else {
                findings.value(&format!("tick {} unit {unit} alive", tick.tick), &true, &false);
                return Err(format!("unit {unit} lives in the record and died here"));
            };
            if !is_first {
                let field = |name: &str| format!("tick {} unit {unit} {name}", tick.tick);
                findings.within(&field("pos"), &pos, &found.pos, PLACES);
                findings.within(&field("vel_before"), &vel, &found.vel, 16.0 * PLACES);
                for (name, expected, found) in [
                    ("hp", hp, found.hp),
                    ("shield", shield, found.shield),
                    ("cooldown", cooldown, found.cooldown),
                ] {
                    findings.within(&field(name), &[expected], &[found], EXACT);
                }
            }
            (found.pos, found.vel, found.hp, found.shield, found.cooldown) = (pos, vel, hp, shield, cooldown);
        }
        for (unit, lives) in living.into_iter().enumerate() {
            if !lives {
                findings.value(
                    &format!("tick {} unit {unit} alive", tick.tick),
                    &false,
                    &state.units[unit].is_some(),
                );
                state.units[unit] = None;
            }
        }
        self.world.enter(&state).map_err(|error| format!("units: {error}"))
    }
}
