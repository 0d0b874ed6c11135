//! The names of battles, and the spellings of SMAClite, SMAC and EPyMARL.

use std::sync::Arc;

use super::{Battle, Map, MapError, FAMILY};
use crate::family::{Made, Refusal, Request};
use crate::Opponent;

/// The form of a name, for messages.
pub(super) const FORM: &str = "smaclite-{map}[-smac-limits]";

/// How names of this family begin: SMAClite's ids with and without the module that registers them, Rondo's names,
/// EPyMARL's and SMAC's keys.
const BEGINNINGS: [&str; 10] = [
    "smaclite:smaclite/",
    "smaclite:smaclite-",
    "smaclite/",
    "smaclite:",
    "smaclite-",
    "smaclite_",
    "smac/",
    "smac:",
    "smac-",
    "smac_",
];

/// StarCraft II itself.
const GAME: [&str; 6] = ["sc2/", "sc2:", "sc2-", "sc2_", "starcraft2/", "starcraft2:"];

const LIMITS: &str = "-smac-limits";

/// Maps of SMAC that have no file here.
const NOT_HERE: [&str; 12] = [
    "1c3s5z",
    "10m_vs_11m",
    "25m",
    "2m_vs_1z",
    "2s_vs_1sc",
    "3s_vs_3z",
    "3s_vs_4z",
    "5m_vs_6m",
    "6h_vs_8z",
    "8m_vs_9m",
    "so_many_baneling",
    "so_many_banelings",
];

/// Understands `smaclite-mmm2`, `smaclite/MMM2-v0`, `smac:MMM2` and `MMM2`, in any case of letters.
pub(super) fn make(request: &Request) -> Option<Result<Made, Refusal>> {
    let name = request.name.to_ascii_lowercase();
    if let Some(map) = GAME.iter().find_map(|begin| name.strip_prefix(begin)) {
        return Some(Err(Refusal::Missing(no_starcraft(map))));
    }
    if matches!(&*name, "sc2" | "starcraft2") {
        return Some(Err(Refusal::Missing(no_starcraft("3s_vs_5z"))));
    }
    if matches!(&*name, "smac" | "smaclite") {
        return Some(made_of_name("", request));
    }
    if let Some(rest) = BEGINNINGS.iter().find_map(|begin| name.strip_prefix(begin)) {
        return Some(made_of_name(rest, request));
    }
    // A map's own name, as EPyMARL and SMAC have it.
    let map = parts(&name).0;
    (Map::built_in(map).is_some() || NOT_HERE.contains(&map)).then(|| made_of_name(&name, request))
}

fn no_starcraft(map: &str) -> String {
    let instead = match Map::built_in(parts(map).0) {
        Some(map) => format!("`smaclite-{}` is that battle", map.name.to_ascii_lowercase()),
        None => "`smaclite-3s_vs_5z`, for example, is a battle".to_owned(),
    };
    format!(
        "that is StarCraft II, which Rondo does not play; {instead} by SMAClite's simple rules, without the game: results \
         there and results of SMAC cannot be compared"
    )
}

/// The map and the rules of a name without its beginning.
fn parts(name: &str) -> (&str, Option<&'static str>) {
    match name.strip_suffix(LIMITS) {
        Some(name) => (name, Some(FAMILY.rules[1])),
        // The version that SMAClite registers.
        None => (name.strip_suffix("-v0").unwrap_or(name), None),
    }
}

fn made_of_name(name: &str, request: &Request) -> Result<Made, Refusal> {
    let (map, rules) = parts(name);
    let have = || Map::all().map(|map| map.name).collect::<Vec<_>>().join(", ");
    if NOT_HERE.contains(&map) {
        return Err(Refusal::Missing(format!(
            "Rondo has no file for that map of SMAC; there are {}, and `--map FILE` plays one of your own",
            have()
        )));
    }
    let found = if map.is_empty() { "nothing".to_owned() } else { format!("`{map}`") };
    let map = Map::built_in(map).ok_or_else(|| {
        Refusal::Name(format!("expected a map ({}), found {found}; the form is {FORM}", have()))
    })?;
    if *request.opponent != Opponent::Builtin {
        return Err(no_opponent());
    }
    made(map, request.rules.or(rules))
}

pub(crate) fn no_opponent() -> Refusal {
    Refusal::Opponent("a battle has no opponent to choose".to_owned())
}

fn made(map: Map, rules: Option<&str>) -> Result<Made, Refusal> {
    let [usual, limits] = [FAMILY.rules[0], FAMILY.rules[1]];
    let wanted = rules.unwrap_or(usual);
    let rules = [usual, limits].into_iter().find(|known| known.eq_ignore_ascii_case(wanted));
    let rules = rules.ok_or_else(|| Refusal::Rules(wanted.to_owned()))?;
    let mut name = format!("smaclite-{}", map.name.to_ascii_lowercase());
    let mut limit = map.limit;
    if rules == limits {
        name += LIMITS;
        limit = map.smac_limit;
    }
    let world = Box::new(Battle::new(Arc::new(map), limit));
    Ok(Made { name, rules, source: "smaclite 0.0.1", world })
}

/// Why there is no battle on a map of the user's own.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum BadMap {
    Map(MapError),
    Refused(Refusal),
}

/// A battle on a map of the user's own.
pub(crate) fn made_of_map(text: &str, rules: Option<&str>) -> Result<Made, BadMap> {
    let map = Map::parse(text).map_err(BadMap::Map)?;
    if Map::built_in(&map.name).is_some_and(|known| known != map) || NOT_HERE.contains(&&*map.name) {
        let line = 1 + text.lines().position(|line| line.trim_start().starts_with("name")).unwrap_or(0);
        let what = format!("`{}` is the name of a map of SMAC: give yours a name of its own", map.name);
        return Err(BadMap::Map(MapError { line, what }));
    }
    made(map, rules).map_err(BadMap::Refused)
}
