//! Free battles with the scripted policies that recorded the reference's: win rate, return and length are those that
//! were recorded, within what so few recorded battles can show.
//!
//! `smaclite-outcomes.json.gz` has the start and the outcome of every recorded battle. Each start is played many times
//! here with other chance; the recorded battles of a policy are then one sample from what comes out here.

use std::collections::BTreeMap;
use std::io::Read;

use envs::smaclite::{Battle, UnitState, NORTH, STOP, TARGET, WEST};
use envs::{End, World};
use flate2::read::GzDecoder;
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;

use crate::traces::excerpts;

/// Of each recorded start.
const BATTLES: u64 = 60;

/// Starts differ by so much: where bodies touch, the last bit of a place decides on which side they pass each other
/// (smaclite §11), and the reference computes its first tick in single precision.
const JITTER: f64 = 1e-5;

#[derive(Deserialize)]
struct Recorded {
    task: String,
    policy: String,
    /// Of each unit: x, y, health, shield, cooldown.
    units: Vec<[f64; 5]>,
    #[serde(rename = "return")]
    episode_return: f64,
    length: f64,
    won: bool,
}

fn recorded() -> Vec<Recorded> {
    let packed = std::fs::read(excerpts().join("smaclite-outcomes.json.gz")).expect("the file is there");
    let mut text = String::new();
    GzDecoder::new(&*packed).read_to_string(&mut text).expect("it unpacks");
    serde_json::from_str(&text).expect("it is JSON")
}

/// What a scripted agent does.
#[derive(Clone, Copy)]
struct Script {
    /// Probability of any action.
    random: f64,
    weakest: bool,
    advances: bool,
    kites: bool,
}

enum Policy {
    AnyLegal,
    Fighter(Script),
    /// Drifts to the edge on this side.
    Walls(u16),
    West,
}

fn policy(label: &str, kites: bool, rng: &mut ChaCha8Rng) -> Policy {
    let fighter =
        |random, weakest, advances, kites| Policy::Fighter(Script { random, weakest, advances, kites });
    match label {
        "any-legal" | "scattered-any" => Policy::AnyLegal,
        "fighter" => fighter(0.02, false, true, kites),
        "fighter-weak" => fighter(0.02, true, true, kites),
        "fighter-hold" => fighter(0.0, true, false, kites),
        "fighter-noisy" => fighter(0.35, false, true, false),
        "hurt-fighter" => fighter(0.05, true, true, kites),
        "weak-enemy-fighter" => fighter(0.03, true, true, kites),
        "scattered-fighter" => fighter(0.1, false, true, kites),
        "wall-fighter" => fighter(0.25, false, true, false),
        "jammed-fighter" => fighter(0.15, false, true, false),
        "walls" | "wall-walk" => Policy::Walls(NORTH + (rng.next_u32() % 2) as u16),
        "one-way-west" => Policy::West,
        other => panic!("no policy {other}"),
    }
}

fn chance(rng: &mut ChaCha8Rng, probability: f64) -> bool {
    f64::from(rng.next_u32()) < probability * 2f64.powi(32)
}

fn any(actions: &[u16], rng: &mut ChaCha8Rng) -> u16 {
    actions[rng.next_u32() as usize % actions.len()]
}

const DIRECTIONS: [[f64; 2]; 4] = [[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]];

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The first of the least.
fn least<T>(all: impl Iterator<Item = T>, key: impl Fn(&T) -> f64) -> Option<T> {
    all.reduce(|best, next| if key(&next) < key(&best) { next } else { best })
}

fn step_to(own: [f64; 2], point: [f64; 2], allowed: &[u16]) -> u16 {
    let gain = |action: &u16| {
        let direction = DIRECTIONS[usize::from(action - NORTH)];
        direction[0] * (point[0] - own[0]) + direction[1] * (point[1] - own[1])
    };
    let moves = (NORTH..=WEST).filter(|action| allowed.contains(action) && gain(action) > 0.0);
    least(moves, |action| -gain(action)).unwrap_or(STOP)
}

fn fight(
    script: Script,
    agent: usize,
    allowed: &[u16],
    world: &Battle,
    heals: bool,
    rng: &mut ChaCha8Rng,
) -> u16 {
    if chance(rng, script.random) {
        return any(allowed, rng);
    }
    let (state, agents) = (world.state(), world.sizes().agents);
    let living = |range: std::ops::Range<usize>| -> Vec<(usize, &UnitState)> {
        range.filter_map(|unit| Some((unit, state.units[unit].as_ref()?))).collect()
    };
    let own = state.units[agent].as_ref().expect("it lives");
    let shots: Vec<u16> = allowed.iter().copied().filter(|&action| action >= TARGET).collect();
    let unit = |first: usize, action: u16| {
        state.units[first + usize::from(action - TARGET)].as_ref().expect("who can be aimed at lives")
    };
    if heals {
        let hurt =
            shots.iter().copied().filter(|&action| unit(0, action).hp < FULL[usize::from(action - TARGET)]);
        return least(hurt, |&action| unit(0, action).hp).unwrap_or_else(|| {
            let mates: Vec<_> = living(0..agents).into_iter().filter(|&(mate, _)| mate != agent).collect();
            let mean =
                |axis: usize| mates.iter().map(|(_, mate)| mate.pos[axis]).sum::<f64>() / mates.len() as f64;
            if mates.is_empty() {
                STOP
            } else {
                step_to(own.pos, [mean(0), mean(1)], allowed)
            }
        });
    }
    let foes = living(agents..state.units.len());
    let near = least(foes.iter(), |(_, foe)| distance(foe.pos, own.pos)).expect("a foe lives").1;
    if script.kites && distance(near.pos, own.pos) < 4.5 && own.cooldown > 0.2 {
        let safety = |action: &u16| {
            let direction = DIRECTIONS[usize::from(action - NORTH)];
            let to = [own.pos[0] + 2.0 * direction[0], own.pos[1] + 2.0 * direction[1]];
            let nearest = foes.iter().map(|(_, foe)| distance(foe.pos, to)).fold(f64::INFINITY, f64::min);
            nearest - 0.12 * distance(to, [16.0, 16.0])
        };
        let moves = (NORTH..=WEST).filter(|action| allowed.contains(action));
        return least(moves, |action| -safety(action)).unwrap_or(STOP);
    }
    if !shots.is_empty() {
        let cost = |&action: &u16| {
            let foe = unit(agents, action);
            if script.weakest {
                foe.hp + foe.shield
            } else {
                distance(foe.pos, own.pos)
            }
        };
        return least(shots.into_iter(), cost).expect("there are some");
    }
    if script.advances {
        step_to(own.pos, near.pos, allowed)
    } else {
        STOP
    }
}

/// Allies of MMM2: a medivac, marines and marauders.
const FULL: [f64; 10] = [150.0, 45.0, 45.0, 45.0, 45.0, 45.0, 45.0, 45.0, 125.0, 125.0];

fn act(policy: &Policy, agent: usize, world: &Battle, heals: bool, rng: &mut ChaCha8Rng) -> u16 {
    let mut mask = vec![0; world.sizes().n_actions[agent]];
    world.available(agent, &mut mask);
    let allowed: Vec<u16> =
        (0..).zip(&mask).filter(|(_, &entry)| entry == 1).map(|(action, _)| action).collect();
    if world.state().units[agent].is_none() {
        assert_eq!(allowed, [0], "the dead do nothing");
        return 0;
    }
    let plain: Vec<u16> = allowed.iter().copied().filter(|&action| action < TARGET).collect();
    let shots: Vec<u16> = allowed.iter().copied().filter(|&action| action >= TARGET).collect();
    match policy {
        Policy::AnyLegal => any(&allowed, rng),
        Policy::Fighter(script) => fight(*script, agent, &allowed, world, heals, rng),
        Policy::Walls(side) => {
            if !shots.is_empty() && chance(rng, 0.25) {
                any(&shots, rng)
            } else if allowed.contains(side) && chance(rng, 0.75) {
                *side
            } else {
                any(&plain, rng)
            }
        }
        Policy::West if allowed.contains(&WEST) && chance(rng, 0.9) => WEST,
        Policy::West => any(&plain, rng),
    }
}

/// Return, length and 1 for a win.
fn play(recorded: &Recorded, rng: &mut ChaCha8Rng) -> [f64; 3] {
    let mut world = Battle::of_task(&recorded.task).unwrap();
    let mut state = world.state();
    assert_eq!(state.units.len(), recorded.units.len());
    for (unit, &[x, y, hp, shield, cooldown]) in state.units.iter_mut().zip(&recorded.units) {
        let unit = unit.as_mut().expect("all live at the start");
        let pos = [x, y].map(|at| at + JITTER * (f64::from(rng.next_u32()) / 2f64.powi(31) - 1.0));
        (unit.pos, unit.hp, unit.shield, unit.cooldown) = (pos, hp, shield, cooldown);
    }
    world.set_state(&state).unwrap();
    let agents = world.sizes().agents;
    let is_mmm2 = recorded.task == "smaclite-mmm2";
    let policy = policy(&recorded.policy, recorded.task == "smaclite-3s_vs_5z", rng);
    let mut rewards = vec![0.0; agents];
    let (mut sum, mut length) = (0.0, 0.0);
    loop {
        let actions: Vec<u16> =
            (0..agents).map(|agent| act(&policy, agent, &world, is_mmm2 && agent == 0, rng)).collect();
        let end = world.step(&actions, rng, &mut rewards);
        sum += rewards[0];
        length += 1.0;
        if end != End::Running {
            let won = world.state().units[agents..].iter().all(Option::is_none);
            return [sum, length, f64::from(u8::from(won))];
        }
    }
}

/// What came out of the battles from one start, and what was recorded from it, for one number.
struct Compared {
    recorded: f64,
    mean: f64,
    variance: f64,
    /// The share of battles here that stay below the recorded one, half of those that equal it included.
    rank: f64,
}

fn compared(recorded: f64, here: &[f64]) -> Compared {
    let n = here.len() as f64;
    let mean = here.iter().sum::<f64>() / n;
    let variance = here.iter().map(|one| (one - mean).powi(2)).sum::<f64>() / n;
    let share = |holds: &dyn Fn(f64) -> bool| here.iter().filter(|one| holds(**one)).count() as f64 / n;
    let equal = |one: f64| (one - recorded).abs() < 1e-9;
    let rank = share(&|one| one < recorded && !equal(one)) + share(&equal) / 2.0;
    Compared { recorded, mean, variance, rank }
}

#[test]
fn scripted_battles_come_out_as_the_recorded_ones_within_their_sampling_error() {
    const NUMBERS: [&str; 3] = ["return", "length", "win rate"];
    let mut recorded = recorded();
    // Without chance in the policy, battles from one start are one battle recorded several times.
    recorded.dedup_by(|b, a| {
        (b.units == a.units) && (b.episode_return, b.length) == (a.episode_return, a.length)
    });
    let mut of_policies: BTreeMap<(&str, &str, usize), Vec<Compared>> = BTreeMap::new();
    for (number, battle) in recorded.iter().enumerate() {
        let mut rng = ChaCha8Rng::seed_from_u64(number as u64);
        let played: Vec<[f64; 3]> = (0..BATTLES).map(|_| play(battle, &mut rng)).collect();
        let outcome = [battle.episode_return, battle.length, f64::from(u8::from(battle.won))];
        for k in 0..3 {
            let here: Vec<f64> = played.iter().map(|one| one[k]).collect();
            let group = of_policies.entry((&battle.task, &battle.policy, k)).or_default();
            group.push(compared(outcome[k], &here));
        }
    }

    // How many standard errors the recorded means of a task are off, over all policies together.
    for task in ["smaclite-mmm2", "smaclite-3s5z", "smaclite-3s_vs_5z"] {
        for (k, what) in NUMBERS.into_iter().enumerate() {
            let of_task = of_policies.iter().filter(|((of, _, number), _)| (*of, *number) == (task, k));
            let all: Vec<&Compared> = of_task.flat_map(|(_, group)| group).collect();
            let n = all.len() as f64;
            let mean = |what: &dyn Fn(&Compared) -> f64| all.iter().map(|one| what(one)).sum::<f64>() / n;
            let (recorded, here) = (mean(&|one| one.recorded), mean(&|one| one.mean));
            let error = (mean(&|one| one.variance) / n).sqrt();
            println!("{task} {what}: recorded {recorded:.3}, here {here:.3}, error {error:.3}");
            // One in 2,000 sound comparisons is beyond this.
            assert!(
                (recorded - here).abs() < 3.5 * error,
                "{task}, {what}: {recorded} recorded, {here} here"
            );
        }
    }
    // Recorded battles rank anywhere among those here, whatever their distribution; of each policy the mean rank is
    // near the middle.
    for ((task, policy, k), group) in &of_policies {
        let n = group.len() as f64;
        let rank = group.iter().map(|one| one.rank).sum::<f64>() / n;
        let error = 1.0 / (12.0 * n).sqrt();
        let what = NUMBERS[*k];
        assert!((rank - 0.5).abs() < 3.2 * error, "{task}, {policy}: recorded {what} of rank {rank:.2}");
    }
}
