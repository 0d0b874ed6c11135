//! Types of units: the numbers of `units.toml`, and of a map's own `[units.NAME]`.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

/// Of a second; a step has [`TICKS`].
pub(super) const TICK: f64 = 1.0 / 16.0;
pub(crate) const TICKS: usize = 8;

/// How far everybody looks for targets, from centre to edge.
pub(super) const SCAN: f64 = 5.0;

/// Shields come back so many seconds after the last hit, and so much a tick.
pub(super) const SHIELD_PAUSE: f64 = 10.0;
pub(super) const SHIELD_PER_TICK: f64 = 0.125;

/// Of healers.
pub(super) const FIRST_ENERGY: f64 = 50.0;
pub(super) const MOST_ENERGY: f64 = 200.0;
pub(super) const ENERGY_PER_TICK: f64 = 0.03515625;
/// Without so much energy a healer begins with no patient.
pub(super) const FIRST_HEAL: f64 = 5.0;
pub(super) const HEALED_PER_ENERGY: f64 = 3.0;
pub(super) const HEALED_PER_TICK: f64 = 0.5625;

/// What is in `units.toml`, by name.
static KNOWN: LazyLock<BTreeMap<String, Kind>> =
    LazyLock::new(|| toml::from_str(include_str!("units.toml")).expect("a test reads this file"));

/// What all units of a type have in common (smaclite §2).
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Kind {
    pub health: f64,
    #[serde(default)]
    pub shield: f64,
    #[serde(default)]
    pub armour: f64,
    /// Of one attack, and how many come at once; without meaning for who heals.
    #[serde(default)]
    pub damage: f64,
    #[serde(default = "one")]
    pub attacks: u32,
    #[serde(default)]
    pub bonus: Option<Bonus>,
    /// An attack also hits the victim's side within this distance of the victim.
    #[serde(default)]
    pub blast: f64,
    /// It dies of its own attack.
    #[serde(default)]
    pub dies: bool,
    #[serde(default)]
    pub heals: bool,
    /// Seconds between attacks.
    #[serde(default)]
    pub cooldown: f64,
    pub range: f64,
    pub speed: f64,
    /// From edge to edge.
    pub size: f64,
    #[serde(default)]
    pub plane: Plane,
    #[serde(default)]
    pub attributes: Vec<String>,
    /// The planes of whom it can hit, or heal.
    pub hits: Vec<Plane>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Bonus {
    pub damage: f64,
    /// An attribute of the victim.
    pub against: String,
}

/// Bodies push each other on their own plane only.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Plane {
    #[default]
    Ground,
    Air,
}

fn one() -> u32 {
    1
}

/// Numbers beyond this are no unit's.
const MOST: f64 = 10_000.0;
/// Larger units would not fit between walls.
const LARGEST: f64 = 8.0;
const MOST_ATTACKS: u32 = 100;

impl Kind {
    pub fn known(name: &str) -> Option<&'static Kind> {
        KNOWN.get(name)
    }

    pub fn known_names() -> String {
        KNOWN.keys().map(String::as_str).collect::<Vec<_>>().join(", ")
    }

    pub fn radius(&self) -> f64 {
        self.size / 2.0
    }

    pub fn can_hit(&self, plane: Plane) -> bool {
        self.hits.contains(&plane)
    }

    /// Of one attack on a victim of that type.
    pub fn damage_to(&self, victim: &Kind) -> f64 {
        let counts = |bonus: &&Bonus| victim.attributes.contains(&bonus.against);
        self.damage + self.bonus.as_ref().filter(counts).map_or(0.0, |bonus| bonus.damage)
    }

    /// What is wrong with the numbers of a type that a map brings with it.
    pub fn judge(&self) -> Result<(), String> {
        let bonus = self.bonus.as_ref().map_or(0.0, |bonus| bonus.damage);
        for (name, value, least, most) in [
            ("health", self.health, f64::MIN_POSITIVE, MOST),
            ("shield", self.shield, 0.0, MOST),
            ("armour", self.armour, 0.0, MOST),
            ("damage", self.damage, 0.0, MOST),
            ("bonus.damage", bonus, 0.0, MOST),
            ("blast", self.blast, 0.0, LARGEST),
            ("cooldown", self.cooldown, 0.0, MOST),
            ("range", self.range, 0.0, MOST),
            ("speed", self.speed, 0.0, MOST),
            ("size", self.size, 0.01, LARGEST),
        ] {
            if !(least..=most).contains(&value) {
                return Err(format!("expected a {name} from {} to {most}, found {value}", shown(least)));
            }
        }
        if !(1..=MOST_ATTACKS).contains(&self.attacks) {
            return Err(format!("expected 1 to {MOST_ATTACKS} attacks at once, found {}", self.attacks));
        }
        if self.hits.is_empty() {
            return Err("expected `ground`, `air` or both in `hits`, found nothing".to_owned());
        }
        Ok(())
    }
}

fn shown(least: f64) -> String {
    if least == f64::MIN_POSITIVE {
        "above 0".to_owned()
    } else {
        least.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_types_of_units_can_be_read_and_have_possible_numbers() {
        assert_eq!(KNOWN.len(), 8);
        for (name, kind) in KNOWN.iter() {
            assert_eq!(kind.judge(), Ok(()), "{name}");
            assert!(kind.heals || (kind.damage > 0.0 && kind.cooldown > 0.0), "{name}");
        }
    }

    #[test]
    fn damage_includes_the_bonus_against_the_attribute() {
        let kind = |name| Kind::known(name).unwrap();
        assert_eq!(kind("marauder").damage_to(kind("stalker")), 20.0);
        assert_eq!(kind("marauder").damage_to(kind("marine")), 10.0);
        assert_eq!(kind("stalker").damage_to(kind("medivac")), 18.0);
        assert_eq!(kind("zealot").damage_to(kind("stalker")), 8.0);
    }
}
