//! What agents see, what they may do, and the state of all that only a centralised learner would see (smaclite §8).

use super::map::{Map, Side};
use super::{distance, Battle, DIRECTIONS, FREE, NOOP, NORTH, STOP, TARGET, WEST};
use crate::Sizes;

/// Farther than this nobody sees.
const SIGHT: f64 = 9.0;
/// Targets can be chosen within this distance, whatever the range of a weapon.
const AIM: f64 = 6.0;
/// Who is there, its distance, and how far it is away each way; then its health.
const OF_OTHERS: usize = 5;

pub(super) fn sizes(map: &Map, episode_limit: u32) -> Sizes {
    let (allies, enemies) = (map.allies, map.enemies());
    let of_itself = |side| 1 + usize::from(map.has_shields(side)) + map.type_bits();
    let [ally, enemy] = [Side::Allies, Side::Enemies].map(|side| OF_OTHERS - 1 + of_itself(side));
    let obs_size = DIRECTIONS.len() + enemies * enemy + (allies - 1) * ally + of_itself(Side::Allies);
    let targets = if map.has_healer(Side::Allies) { enemies.max(allies) } else { enemies };
    Sizes {
        agents: allies,
        obs_size: vec![obs_size; allies],
        n_actions: vec![usize::from(TARGET) + targets; allies],
        episode_limit,
    }
}

/// Writes numbers one after the other.
struct Writer<'a> {
    out: &'a mut [f32],
    at: usize,
}

impl Writer<'_> {
    fn put(&mut self, number: f64) {
        self.out[self.at] = number as f32;
        self.at += 1;
    }

    fn skip(&mut self, numbers: usize) {
        self.out[self.at..self.at + numbers].fill(0.0);
        self.at += numbers;
    }
}

impl Battle {
    /// smaclite §4: whether an agent may choose an action now.
    pub(super) fn is_available(&self, agent: usize, action: u16) -> bool {
        if !self.living.contains(agent) {
            return action == NOOP;
        }
        match action {
            NOOP => false,
            STOP => true,
            NORTH..=WEST => self.is_free(agent, usize::from(action - NORTH)),
            TARGET.. => usize::from(action) < self.sizes.n_actions[agent] && self.can_aim(agent, action),
        }
    }

    fn is_free(&self, agent: usize, direction: usize) -> bool {
        let to = self.units[agent].place() + FREE * DIRECTIONS[direction];
        let on_map = (0.0..f64::from(self.map.width)).contains(&to.x)
            && (0.0..f64::from(self.map.height)).contains(&to.y);
        on_map && !self.map.is_blocked(to.x as u32, to.y as u32)
    }

    fn can_aim(&self, agent: usize, action: u16) -> bool {
        let target = self.target_of(agent, action);
        let side_is_right = if self.facts[agent].heals {
            self.is_ally(target) && !self.facts[target].heals
        } else {
            target < self.units.len()
        };
        side_is_right
            && self.living.contains(target)
            && distance(self.units[agent].at, self.units[target].at) <= AIM
    }

    pub(super) fn mask(&self, agent: usize, out: &mut [u8]) {
        assert_eq!(out.len(), self.sizes.n_actions[agent], "one place per action");
        for (action, place) in (0..).zip(out) {
            *place = u8::from(self.is_available(agent, action));
        }
    }

    pub(super) fn view(&self, agent: usize, out: &mut [f32]) {
        assert_eq!(out.len(), self.sizes.obs_size[agent], "one place per observed number");
        if !self.living.contains(agent) {
            out.fill(0.0);
            return;
        }
        let mut writer = Writer { out, at: 0 };
        for direction in 0..DIRECTIONS.len() {
            writer.put(f64::from(u8::from(self.is_free(agent, direction))));
        }
        let all = self.units.len();
        for enemy in self.map.allies..all {
            let aim = TARGET + (enemy - self.map.allies) as u16;
            self.other(agent, enemy, |world| u8::from(world.can_aim(agent, aim)), &mut writer);
        }
        for ally in (0..self.map.allies).filter(|&ally| ally != agent) {
            self.other(agent, ally, |_| 1, &mut writer);
        }
        self.body(agent, &mut writer);
    }

    /// What an agent sees of another unit: nothing if it is dead or far.
    fn other(&self, agent: usize, unit: usize, flag: impl Fn(&Battle) -> u8, writer: &mut Writer) {
        let away = distance(self.units[agent].at, self.units[unit].at);
        if !self.living.contains(unit) || away > SIGHT {
            writer.skip(OF_OTHERS - 1 + self.body_size(unit));
            return;
        }
        writer.put(f64::from(flag(self)));
        writer.put(away / SIGHT);
        let way = super::towards(self.units[agent].at, self.units[unit].at);
        writer.put(way.x / SIGHT);
        writer.put(way.y / SIGHT);
        self.body(unit, writer);
    }

    fn body_size(&self, unit: usize) -> usize {
        1 + usize::from(self.shields[self.side(unit)]) + self.type_bits
    }

    /// Health, shield where the side has any, type where a side has several.
    fn body(&self, unit: usize, writer: &mut Writer) {
        self.health(unit, writer);
        self.shield_and_type(unit, writer);
    }

    fn health(&self, unit: usize, writer: &mut Writer) {
        writer.put(self.units[unit].health / self.map.kind(unit).health);
    }

    fn shield_and_type(&self, unit: usize, writer: &mut Writer) {
        let kind = self.map.kind(unit);
        if self.shields[self.side(unit)] {
            writer.put(if kind.shield > 0.0 { self.units[unit].shield / kind.shield } else { 0.0 });
        }
        let bit = writer.at + self.facts[unit].kind;
        writer.skip(self.type_bits);
        if self.type_bits > 0 {
            writer.out[bit] = 1.0;
        }
    }

    fn side(&self, unit: usize) -> usize {
        usize::from(!self.is_ally(unit))
    }

    /// How many numbers the state of all has.
    pub(crate) fn global_state_size(&self) -> usize {
        let bodies: usize = (0..self.units.len())
            .map(|unit| self.body_size(unit) + 2 + usize::from(self.is_ally(unit)))
            .sum();
        bodies + self.sizes.agents * self.sizes.n_actions[0]
    }

    /// Everything, from above: for centralised learners and for the comparison with recorded battles.
    pub(crate) fn global_state(&self, out: &mut [f32]) {
        assert_eq!(out.len(), self.global_state_size(), "one place per number");
        let mut writer = Writer { out, at: 0 };
        let [width, height] = [self.map.width, self.map.height].map(f64::from);
        for unit in 0..self.units.len() {
            if !self.living.contains(unit) {
                writer.skip(self.body_size(unit) + 2 + usize::from(self.is_ally(unit)));
                continue;
            }
            self.health(unit, &mut writer);
            let (own, kind) = (&self.units[unit], self.map.kind(unit));
            if self.is_ally(unit) {
                writer.put(match kind.heals {
                    true => own.energy / super::unit::MOST_ENERGY,
                    false if kind.cooldown > 0.0 => own.cooldown / kind.cooldown,
                    false => 0.0,
                });
            }
            let place = own.place();
            writer.put((place.x - width / 2.0) / width);
            writer.put((place.y - height / 2.0) / height);
            self.shield_and_type(unit, &mut writer);
        }
        for agent in 0..self.sizes.agents {
            let action = usize::from(self.last_actions[agent]);
            let row = writer.at;
            writer.skip(self.sizes.n_actions[agent]);
            // Before the first step nobody has done anything.
            if self.step > 0 {
                writer.out[row + action] = 1.0;
            }
        }
    }
}
