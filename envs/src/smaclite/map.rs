//! Maps: terrain, two sides and where they start. A map is a small TOML file; those of `maps/` come with the program.

use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;

use super::formation::places;
use super::set::MOST_UNITS;
use super::unit::{Kind, Plane};
use super::vec2::{vec2, Vec2};
use super::walls::Wall;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Allies,
    Enemies,
}

/// A map that can be played.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Map {
    pub name: String,
    /// What a user should know before a team learns here.
    pub note: Option<String>,
    pub limit: u32,
    pub smac_limit: u32,
    pub width: u32,
    pub height: u32,
    /// Row by row from below, whether a cell is blocked.
    blocked: Vec<bool>,
    pub walls: Vec<Wall>,
    /// Corner, width and height of each wall, as the file has them.
    pub rectangles: Vec<[u32; 4]>,
    /// Where the enemies march to.
    pub attack: Vec2,
    /// Allies first, then enemies; each side in the order of the file.
    pub units: Vec<Placed>,
    pub allies: usize,
    /// The types on this map, by name.
    pub kinds: Vec<(String, Kind)>,
}

/// A unit at the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Placed {
    pub side: Side,
    /// Index into [`Map::kinds`].
    pub kind: usize,
    pub at: [f32; 2],
}

/// Why a map cannot be played, and in which line of its file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("line {line}: {what}")]
pub struct MapError {
    pub line: usize,
    pub what: String,
}

/// The maps that come with the program, the three of the multi-timescale study first.
static BUILT_IN: [&str; 12] = [
    include_str!("maps/MMM2.toml"),
    include_str!("maps/3s5z.toml"),
    include_str!("maps/3s_vs_5z.toml"),
    include_str!("maps/2s3z.toml"),
    include_str!("maps/3m.toml"),
    include_str!("maps/8m.toml"),
    include_str!("maps/MMM.toml"),
    include_str!("maps/3s5z_vs_3s6z.toml"),
    include_str!("maps/27m_vs_30m.toml"),
    include_str!("maps/bane_vs_bane.toml"),
    include_str!("maps/2c_vs_64zg.toml"),
    include_str!("maps/corridor.toml"),
];

/// A map as its file has it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: Spanned<String>,
    note: Option<String>,
    limit: Spanned<u32>,
    smac_limit: Option<Spanned<u32>>,
    size: Spanned<[u32; 2]>,
    #[serde(default)]
    blocked: Vec<Spanned<[u32; 4]>>,
    attack: Spanned<[f64; 2]>,
    #[serde(default)]
    allies: Vec<Group>,
    #[serde(default)]
    enemies: Vec<Group>,
    #[serde(default)]
    units: std::collections::BTreeMap<String, Spanned<Kind>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Group {
    at: Spanned<[f64; 2]>,
    units: Spanned<Vec<Spanned<(String, u32)>>>,
}

/// Of every map.
const EPYMARL_LIMIT: u32 = 150;
const LONGEST_NAME: usize = 40;
const SMALLEST: u32 = 4;
pub(super) const LARGEST: u32 = 256;
const LONGEST: u32 = 100_000;
/// Bodies that overlap by less touch.
const TOUCH: f64 = 1e-4;

impl Map {
    /// The built-in map of that name, in any case of letters.
    pub fn built_in(name: &str) -> Option<Map> {
        Map::all().find(|map| map.name.eq_ignore_ascii_case(name))
    }

    pub fn all() -> impl Iterator<Item = Map> {
        BUILT_IN.iter().map(|text| Map::parse(text).expect("a test reads the built-in maps"))
    }

    /// Reads a map's file.
    pub fn parse(text: &str) -> Result<Map, MapError> {
        let line_of = |span: Range<usize>| text[..span.start.min(text.len())].matches('\n').count() + 1;
        let file: File = toml::from_str(text).map_err(|error| MapError {
            line: error.span().map_or(1, line_of),
            what: error.message().to_owned(),
        })?;
        compile(file).map_err(|(span, what)| MapError { line: line_of(span), what })
    }

    pub fn is_blocked(&self, x: u32, y: u32) -> bool {
        self.blocked[(y * self.width + x) as usize]
    }

    pub fn kind(&self, unit: usize) -> &Kind {
        &self.kinds[self.units[unit].kind].1
    }

    pub fn enemies(&self) -> usize {
        self.units.len() - self.allies
    }

    pub fn has_healer(&self, side: Side) -> bool {
        self.of(side).any(|kind| kind.heals)
    }

    /// Whether observations say how much shield a unit of that side has left (smaclite §8).
    pub fn has_shields(&self, side: Side) -> bool {
        self.of(side).any(|kind| kind.shield > 0.0)
    }

    /// Numbers that say of which type a unit is: none where each side has one type only (smaclite §8).
    pub fn type_bits(&self) -> usize {
        let mixed = |side| {
            let mut kinds = self.units.iter().filter(|unit| unit.side == side).map(|unit| unit.kind);
            kinds.next().is_some_and(|first| kinds.any(|kind| kind != first))
        };
        if mixed(Side::Allies) || mixed(Side::Enemies) {
            self.kinds.len()
        } else {
            0
        }
    }

    /// The first unit that starts where it cannot stand, and why.
    fn first_in_the_way(&self) -> Option<(usize, String)> {
        let place = |unit: usize| {
            let [x, y] = self.units[unit].at.map(f64::from);
            vec2(x, y)
        };
        (0..self.units.len()).find_map(|unit| {
            let (own, at) = (self.kind(unit), place(unit));
            let on_map =
                (0.0..f64::from(self.width)).contains(&at.x) && (0.0..f64::from(self.height)).contains(&at.y);
            let in_wall = |wall: &Wall| wall.is_near(at, own.radius() - TOUCH);
            let overlaps = |&other: &usize| {
                let its = self.kind(other);
                its.plane == own.plane && (place(other) - at).length() < own.radius() + its.radius() - TOUCH
            };
            if !on_map {
                Some((unit, "outside the map".to_owned()))
            } else if own.plane == Plane::Ground && self.walls.iter().any(in_wall) {
                Some((unit, "in blocked cells".to_owned()))
            } else {
                let other = (0..unit).find(overlaps)?;
                let name = &self.kinds[self.units[other].kind].0;
                Some((unit, format!("over a {name} that starts there too")))
            }
        })
    }

    fn of(&self, side: Side) -> impl Iterator<Item = &Kind> {
        self.units.iter().filter(move |unit| unit.side == side).map(|unit| &self.kinds[unit.kind].1)
    }
}

/// A mistake and where in the text it is.
type Mistake = (Range<usize>, String);

fn compile(file: File) -> Result<Map, Mistake> {
    let name = file.name.get_ref();
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    if name.is_empty() || name.len() > LONGEST_NAME || !name.chars().all(is_part) {
        let text = format!("expected a name of 1 to {LONGEST_NAME} letters, digits and `_`, found `{name}`");
        return Err((file.name.span(), text));
    }
    let [width, height] = *file.size.get_ref();
    if [width, height].iter().any(|side| !(SMALLEST..=LARGEST).contains(side)) {
        let text =
            format!("expected a size of {SMALLEST} to {LARGEST} cells each way, found {width} x {height}");
        return Err((file.size.span(), text));
    }
    let limit = checked_limit(&file.limit)?;
    let smac_limit = file.smac_limit.as_ref().map_or(Ok(limit), checked_limit)?;
    let within = |[x, y]: [f64; 2]| {
        // Not-a-number is in no range.
        (0.0..f64::from(width)).contains(&x) && (0.0..f64::from(height)).contains(&y)
    };
    for wall in &file.blocked {
        let [x, y, w, h] = *wall.get_ref();
        let fits =
            |at: u32, length: u32, most| length > 0 && at.checked_add(length).is_some_and(|end| end <= most);
        if !fits(x, w, width) || !fits(y, h, height) {
            let text = format!(
                "expected blocked cells within the map of {width} x {height} cells, found {w} x {h} cells from ({x}, {y}) on"
            );
            return Err((wall.span(), text));
        }
    }
    let attack = *file.attack.get_ref();
    if !within(attack) {
        return Err((file.attack.span(), format!("expected a point on the map, found {attack:?}")));
    }
    for kind in file.units.values() {
        kind.get_ref().judge().map_err(|what| (kind.span(), what))?;
    }
    let kind_of = |name: &str| file.units.get(name).map(Spanned::get_ref).or_else(|| Kind::known(name));

    let sides = [(Side::Allies, &file.allies, "allies"), (Side::Enemies, &file.enemies, "enemies")];
    let (mut units, mut spans) = (Vec::new(), Vec::new());
    for (side, groups, title) in sides {
        if groups.is_empty() {
            return Err((
                file.name.span(),
                format!("map {name} has no {title}: expected a group `[[{title}]]`"),
            ));
        }
        for group in groups {
            let centre = *group.at.get_ref();
            if !within(centre) {
                return Err((group.at.span(), format!("expected a point on the map, found {centre:?}")));
            }
            let first = units.len();
            for member in group.units.get_ref() {
                let (kind, count) = member.get_ref();
                if kind_of(kind).is_none() {
                    return Err((member.span(), unknown_unit(kind)));
                }
                let room = (MOST_UNITS - units.len()) as u32;
                if *count == 0 || *count > room {
                    let text = format!(
                        "expected at least one, and at most {MOST_UNITS} units on the map: found {count} more with room \
                         for {room}"
                    );
                    return Err((member.span(), text));
                }
                units.extend((0..*count).map(|_| (side, kind.as_str(), [0.0; 2])));
                spans.extend((0..*count).map(|_| member.span()));
            }
            let group_units = &mut units[first..];
            if group_units.is_empty() {
                return Err((group.units.span(), "expected units in this group, found none".to_owned()));
            }
            let size = |kind: &str| kind_of(kind).expect("it was found above").size;
            let sizes: Vec<f64> = group_units.iter().map(|(_, kind, _)| size(kind)).collect();
            for ((.., at), place) in group_units.iter_mut().zip(places(side, centre, &sizes)) {
                *at = place;
            }
        }
    }
    let ground = Ground {
        size: [width, height],
        rectangles: file.blocked.iter().map(|wall| *wall.get_ref()).collect(),
        attack,
    };
    let map = Map { note: file.note, limit, smac_limit, ..assemble(name, ground, &units, kind_of) };
    match map.first_in_the_way() {
        None => Ok(map),
        Some((unit, problem)) => {
            let (_, kind, [x, y]) = units[unit];
            Err((spans[unit].clone(), format!("a {kind} would start at ({x}, {y}), {problem}")))
        }
    }
}

/// What a map is without its units.
pub(super) struct Ground {
    pub size: [u32; 2],
    /// Within the size.
    pub rectangles: Vec<[u32; 4]>,
    pub attack: [f64; 2],
}

/// A map of these units, allies first; all of their types are known.
pub(super) fn assemble<'k>(
    name: &str,
    ground: Ground,
    units: &[(Side, &str, [f32; 2])],
    kind_of: impl Fn(&str) -> Option<&'k Kind>,
) -> Map {
    let mut names: Vec<&str> = units.iter().map(|(_, kind, _)| *kind).collect();
    names.sort_unstable();
    names.dedup();
    let kind = |name: &&str| Some(((*name).to_owned(), kind_of(name)?.clone()));
    let index = |name: &str| names.binary_search(&name).expect("the names are of these units");
    let Ground { size: [width, height], rectangles, attack } = ground;
    let mut blocked = vec![false; (width * height) as usize];
    for &[x, y, w, h] in &rectangles {
        for y in y..y + h {
            blocked[(y * width + x) as usize..][..w as usize].fill(true);
        }
    }
    let wall = |[x, y, w, h]: [u32; 4]| Wall::new(f64::from(x), f64::from(y), f64::from(w), f64::from(h));
    Map {
        name: name.to_owned(),
        note: None,
        limit: EPYMARL_LIMIT,
        smac_limit: EPYMARL_LIMIT,
        width,
        height,
        blocked,
        walls: rectangles.iter().copied().map(wall).collect(),
        rectangles,
        attack: vec2(attack[0], attack[1]),
        units: units.iter().map(|&(side, kind, at)| Placed { side, kind: index(kind), at }).collect(),
        allies: units.iter().filter(|(side, ..)| *side == Side::Allies).count(),
        kinds: names.iter().filter_map(kind).collect(),
    }
}

pub(super) fn unknown_unit(name: &str) -> String {
    let known = Kind::known_names();
    format!(
        "unknown unit `{name}`: expected one of {known}, or one that the map describes in `[units.{name}]`"
    )
}

fn checked_limit(limit: &Spanned<u32>) -> Result<u32, Mistake> {
    if (1..=LONGEST).contains(limit.get_ref()) {
        Ok(*limit.get_ref())
    } else {
        Err((limit.span(), format!("expected a limit of 1 to {LONGEST} steps, found {}", limit.get_ref())))
    }
}
