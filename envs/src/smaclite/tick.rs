//! One tick: whom everybody targets, where it wants to go, where it can go, and what it does there (smaclite §5).

use super::solve::{solve, HalfPlane};
use super::unit::{
    Plane, ENERGY_PER_TICK, FIRST_HEAL, HEALED_PER_ENERGY, HEALED_PER_TICK, MOST_ENERGY, SCAN, SHIELD_PAUSE,
    SHIELD_PER_TICK, TICK,
};
use super::vec2::{is_within, Vec2};
use super::walls::Body;
use super::{distance, towards, vec2, Battle, Order, Set, KILL};

/// An attack is pushed on so many times harder where bodies overlap: once a tick instead of once a second.
const TICKS_PER_SECOND: f64 = 16.0;

impl Battle {
    /// Plays a tick and returns what it earned.
    pub(super) fn tick(&mut self, shuffle: &mut impl FnMut(&mut [usize])) -> f64 {
        self.choose();
        let mut order = std::mem::take(&mut self.scratch.order);
        order.clear();
        order.extend(self.living);
        shuffle(&mut order);
        let earned = order.iter().fold(0.0, |sum, &unit| sum + self.act(unit));
        self.scratch.order = order;
        self.bury();
        earned
    }

    /// smaclite §5.6.
    pub(super) fn bury(&mut self) {
        for unit in self.living {
            if self.units[unit].health <= 0.0 {
                self.living.remove(unit);
            }
        }
    }

    /// Everything in a tick that comes before anybody acts.
    pub(super) fn choose(&mut self) {
        self.drop_targets();
        self.fill_crowd();
        self.want_velocities();
        self.avoid();
    }

    pub(super) fn fill_crowd(&mut self) {
        let units = &self.units;
        self.scratch.crowd.fill(self.living.into_iter().map(|unit| (unit, units[unit].at)));
    }

    /// smaclite §5.1.
    fn drop_targets(&mut self) {
        for unit in self.living {
            let target = self.units[unit].target;
            self.scratch.before[unit] = target;
            let lives = |other: &usize| self.units[*other].health > 0.0;
            self.units[unit].target = match self.units[unit].order {
                Order::Stop | Order::Move(_) => None,
                Order::Target(other) => Some(other).filter(lives),
                Order::Advance => target
                    .filter(lives)
                    .filter(|&other| self.units[other].target == Some(unit) || self.is_in_range(unit, other)),
            };
        }
    }

    /// smaclite §5.
    fn is_in_range(&self, unit: usize, other: usize) -> bool {
        let way = towards(self.units[unit].at, self.units[other].at);
        let (own, its) = (&self.facts[unit], &self.facts[other]);
        is_within(way.x, way.y, own.range + own.radius + its.radius)
    }

    /// The living units of a side that `unit` can hit, not farther than all scans reach, and their distance.
    fn scan(&self, unit: usize, side: Set) -> impl Iterator<Item = (usize, f64)> + '_ {
        let reach = SCAN + self.max_radius;
        let at = self.units[unit].at;
        // The strips are looked up in single precision: a little farther than asked.
        let near = self.scratch.crowd.around(at, reach as f32 + 0.01);
        let near = near.and(side).and(self.facts[unit].can_hit);
        near.into_iter()
            .map(move |other| (other, distance(at, self.units[other].at)))
            .filter(move |&(_, distance)| distance <= reach)
    }

    /// smaclite §5.2 and §5.3. Where everybody stands does not change here, so candidates are looked up when a unit
    /// needs them.
    fn want_velocities(&mut self) {
        let has_target = |unit: &usize| self.units[*unit].target.is_some();
        let fighters = self.enemies().minus(self.healers);
        let somebody_seeks = !fighters.into_iter().all(|unit| has_target(&unit));
        let team_has_healer = !self.living.and(self.allies).and(self.healers).is_empty();
        // Whose own targets healers follow the pace of: as they were before anybody chose.
        let idle_healers: Set =
            self.enemies().and(self.healers).into_iter().filter(|unit| !has_target(unit)).collect();
        for unit in self.living {
            let speed = if self.facts[unit].heals {
                self.pace_of_healer(unit, idle_healers.contains(unit), somebody_seeks)
            } else {
                self.facts[unit].speed
            };
            self.scratch.wanted[unit] = match self.units[unit].order {
                Order::Stop => Vec2::ZERO,
                Order::Move(goal) => speed * way(goal - self.units[unit].place()),
                Order::Target(other) => self.engage(unit, other, speed),
                Order::Advance => {
                    let chosen = match self.units[unit].target {
                        None if self.facts[unit].heals => self.patient(unit),
                        None => self.prey(unit),
                        Some(target)
                            if team_has_healer && !self.facts[unit].heals && !self.facts[target].heals =>
                        {
                            self.nearest(unit, Set::default()).or(Some(target))
                        }
                        kept => kept,
                    };
                    self.units[unit].target = chosen;
                    match chosen {
                        None => speed * way(self.map.attack - self.units[unit].place()),
                        Some(other) => self.engage(unit, other, speed),
                    }
                }
            };
        }
    }

    /// A healer keeps to the slowest of its candidates.
    fn pace_of_healer(&self, unit: usize, is_idle: bool, somebody_seeks: bool) -> f64 {
        let own = self.facts[unit].speed;
        let slowest = |least: f64, other: usize| least.min(self.facts[other].speed);
        let pace = if is_idle {
            self.scan(unit, self.enemies()).fold(f64::INFINITY, |least, (other, _)| slowest(least, other))
        } else if somebody_seeks && !self.is_ally(unit) {
            self.attackers_of(unit).into_iter().fold(f64::INFINITY, slowest)
        } else {
            f64::INFINITY
        };
        if pace.is_finite() {
            pace
        } else {
            own
        }
    }

    /// The allies that target a unit that could hit them.
    fn attackers_of(&self, unit: usize) -> Set {
        let allies = self.living.and(self.allies).and(self.facts[unit].can_hit);
        allies.into_iter().filter(|&ally| self.units[ally].target == Some(unit)).collect()
    }

    /// Whom an enemy fighter without a target takes.
    fn prey(&self, unit: usize) -> Option<usize> {
        self.nearest(unit, self.attackers_of(unit))
    }

    /// The best target of an enemy fighter: healers first, then the nearest. `attackers` are also considered where
    /// they are far, after everybody else of their kind.
    fn nearest(&self, unit: usize, attackers: Set) -> Option<usize> {
        const FAR: f64 = 2e9;
        let close = self.scan(unit, self.living.and(self.allies)).filter(|&(other, distance)| {
            distance < SCAN + self.facts[other].radius || self.units[other].target == Some(unit)
        });
        let far = attackers.into_iter().map(|ally| (ally, FAR));
        let alive = |&(other, _): &(usize, f64)| self.units[other].health > 0.0;
        let key = |(other, distance): (usize, f64)| (!self.facts[other].heals, distance);
        close
            .chain(far)
            .filter(alive)
            .reduce(|best, next| if key(next) < key(best) { next } else { best })
            .map(|(other, _)| other)
    }

    /// Whom an enemy healer without a patient takes: the weakest that is hurt or fights.
    fn patient(&self, unit: usize) -> Option<usize> {
        let needs_care = |&(other, distance): &(usize, f64)| {
            let patient = &self.units[other];
            patient.health > 0.0
                && distance < SCAN + self.facts[other].radius
                && (patient.health < self.map.kind(other).health || patient.target.is_some())
        };
        let candidates = self.scan(unit, self.enemies()).filter(needs_care).map(|(other, _)| other);
        let health = |other: usize| self.units[other].health;
        candidates.reduce(|best, next| if health(next) < health(best) { next } else { best })
    }

    /// Stands and attacks a unit in range, or goes there.
    fn engage(&mut self, unit: usize, other: usize, speed: f64) -> Vec2 {
        if self.facts[unit].can_hit.contains(other) && self.is_in_range(unit, other) {
            self.units[unit].attacking = true;
            return Vec2::ZERO;
        }
        speed * way(towards(self.units[unit].at, self.units[other].at))
    }

    /// smaclite §5.4: the new velocities of all, from the same places and the velocities before.
    pub(super) fn avoid(&mut self) {
        let (mut planes, mut more_planes) = self.take_planes();
        for unit in self.living {
            let wanted = self.scratch.wanted[unit];
            self.scratch.velocities[unit] = if wanted == Vec2::ZERO {
                Vec2::ZERO
            } else {
                planes.clear();
                if self.facts[unit].plane == Plane::Ground {
                    self.keep_off_walls(unit, &mut planes);
                }
                let walls = planes.len();
                self.keep_off_others(unit, &mut planes);
                solve(&planes, walls, self.facts[unit].speed, wanted, &mut more_planes)
            };
        }
        (self.scratch.planes, self.scratch.more_planes) = (planes, more_planes);
    }

    /// smaclite §6.
    fn keep_off_walls(&self, unit: usize, planes: &mut Vec<HalfPlane>) {
        let (own, facts) = (&self.units[unit], &self.facts[unit]);
        let body = Body { at: own.place(), velocity: own.velocity, radius: facts.radius };
        for wall in self.map.walls.iter().filter(|wall| wall.is_near(body.at, facts.radius + facts.speed)) {
            wall.restrict(body, planes);
        }
    }

    /// smaclite §7.
    fn keep_off_others(&self, unit: usize, planes: &mut Vec<HalfPlane>) {
        let (own, facts) = (&self.units[unit], &self.facts[unit]);
        let reach = self.max_radius + facts.radius;
        let plane = match facts.plane {
            Plane::Ground => self.ground,
            Plane::Air => self.living.minus(self.ground),
        };
        let near = self.scratch.crowd.around(own.at, reach as f32 + 0.01).and(plane).without(unit);
        for other in near {
            let its = &self.units[other];
            if distance(own.at, its.at) > reach {
                continue;
            }
            let q = towards(own.at, its.at);
            let share = if self.scratch.wanted[other] == Vec2::ZERO { 1.0 } else { 0.5 };
            let (direction, excess) =
                keep_apart(q, own.velocity - its.velocity, facts.radius + self.facts[other].radius);
            planes.push(HalfPlane { direction, point: own.velocity + share * excess });
        }
    }

    /// smaclite §5.5: what one unit does in this tick, and what that earns.
    pub(super) fn act(&mut self, unit: usize) -> f64 {
        let facts = &self.facts[unit];
        let kind = &self.map.kinds[facts.kind].1;
        let (heals, cooldown, most_shield) = (facts.heals, kind.cooldown, kind.shield);
        let velocity = self.scratch.velocities[unit];
        let own = &mut self.units[unit];
        if own.health <= 0.0 {
            return 0.0;
        }
        own.velocity = velocity;
        for (at, speed) in own.at.iter_mut().zip([velocity.x, velocity.y]) {
            *at = (f64::from(*at) + speed * TICK) as f32;
        }
        own.cooldown = (own.cooldown - TICK).max(0.0);
        own.shield_cooldown = (own.shield_cooldown - TICK).max(0.0);
        if own.shield_cooldown == 0.0 && own.shield < most_shield {
            own.shield = (own.shield + SHIELD_PER_TICK).min(most_shield);
        }
        if heals {
            own.energy = (own.energy + ENERGY_PER_TICK).min(MOST_ENERGY);
        }
        let other = match own.order {
            Order::Stop => {
                own.target = None;
                return 0.0;
            }
            Order::Move(_) => return 0.0,
            Order::Target(other) => other,
            Order::Advance => match own.target {
                Some(other) => other,
                None => return 0.0,
            },
        };
        if !std::mem::take(&mut own.attacking) || own.cooldown > 0.0 {
            return 0.0;
        }
        own.cooldown = cooldown;
        if heals {
            self.heal(unit, other);
            0.0
        } else {
            self.attack(unit, other)
        }
    }

    fn attack(&mut self, unit: usize, victim: usize) -> f64 {
        let kind = &self.map.kinds[self.facts[unit].kind].1;
        let (attacks, blast, dies) = (kind.attacks, kind.blast, kind.dies);
        let mut earned = 0.0;
        for _ in 0..attacks {
            earned += self.hit(unit, victim);
            if blast > 0.0 {
                let side = if self.is_ally(victim) { self.allies } else { self.enemies() };
                let centre = self.units[victim].at;
                for other in side.and(self.living).and(self.facts[unit].can_hit).without(victim) {
                    if distance(centre, self.units[other].at) <= blast {
                        earned += self.hit(unit, other);
                    }
                }
            }
        }
        if dies {
            self.units[unit].health = 0.0;
        }
        earned
    }

    /// Damage to one unit, and what it earns.
    fn hit(&mut self, unit: usize, victim: usize) -> f64 {
        let damage = self.damage[self.facts[unit].kind][self.facts[victim].kind];
        let kind = &self.map.kinds[self.facts[victim].kind].1;
        let its = &mut self.units[victim];
        if its.health <= 0.0 {
            return 0.0;
        }
        if kind.shield > 0.0 {
            its.shield_cooldown = SHIELD_PAUSE;
        }
        let absorbed = damage.min(its.shield);
        its.shield -= absorbed;
        let hurt = (damage - absorbed - kind.armour).min(its.health).max(0.0);
        its.health -= hurt;
        let lost = absorbed + hurt;
        let killed = its.health <= 0.0;
        if self.is_ally(victim) {
            self.damage_taken += lost;
            return 0.0;
        }
        self.damage_dealt += lost;
        if killed {
            lost + KILL
        } else {
            lost
        }
    }

    fn heal(&mut self, unit: usize, patient: usize) {
        let most = self.map.kind(patient).health;
        let missing = most - self.units[patient].health;
        let own = &mut self.units[unit];
        let is_new = self.scratch.before[unit] != own.target;
        if (is_new && own.energy < FIRST_HEAL) || missing <= 0.0 {
            own.target = None;
            return;
        }
        let need = missing.min(HEALED_PER_TICK);
        if own.healing < need {
            let spent = own.energy.min(1.0);
            own.energy -= spent;
            own.healing += HEALED_PER_ENERGY * spent;
        }
        let given = need.min(own.healing);
        own.healing -= given;
        self.units[patient].health += given;
    }

    /// The lists of half-planes, out of the way of `self`.
    fn take_planes(&mut self) -> (Vec<HalfPlane>, Vec<HalfPlane>) {
        (std::mem::take(&mut self.scratch.planes), std::mem::take(&mut self.scratch.more_planes))
    }
}

/// The direction of a way, of length 1; nothing where there is none.
fn way(along: Vec2) -> Vec2 {
    if along == Vec2::ZERO {
        along
    } else {
        along.normalised()
    }
}

/// How a body keeps apart from another that is `q` away, at a relative velocity `w0` and a distance of at least
/// `apart`: the direction of its half-plane, and by how much velocities have to change together.
fn keep_apart(q: Vec2, w0: Vec2, apart: f64) -> (Vec2, Vec2) {
    let squares = (q.square(), apart * apart);
    let (w, reach) = if squares.0 > squares.1 {
        let w = w0 - q;
        let along = w.dot(q);
        if along >= 0.0 || along * along <= squares.1 * w.square() {
            let l = (squares.0 - squares.1).sqrt();
            let left = vec2(q.x * l - q.y * apart, q.x * apart + q.y * l);
            let right = vec2(-q.x * l - q.y * apart, q.x * apart - q.y * l);
            let direction = 1.0 / squares.0 * if q.det(w) > 0.0 { left } else { right };
            return (direction, w0.dot(direction) * direction - w0);
        }
        (w, apart)
    } else {
        (w0 - TICKS_PER_SECOND * q, TICKS_PER_SECOND * apart)
    };
    let n = w.normalised();
    (n.right(), (reach - w.length()) * n)
}
