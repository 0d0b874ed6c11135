//! The parameters of a warehouse, and their checks.

use std::fmt;

use super::layout::{sides, Layout};

/// The longest side of a grid: far beyond any published task.
const MAX_SIDE: u64 = 255;
/// The most robots: the reference registers up to 19, and the search for the longest train stores them in 64 bits.
pub(super) const MAX_ROBOTS: u16 = 64;
/// The largest sight that the reference registers; observations grow with its square.
const MAX_SENSOR_RANGE: u16 = 5;

/// The parameters of a warehouse.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Config {
    /// Blocks of shelves above each other.
    pub shelf_rows: u16,
    /// Blocks of shelves side by side; odd.
    pub shelf_columns: u16,
    /// Shelves above each other in a block.
    pub column_height: u16,
    pub robots: u16,
    /// Shelves that are requested at any time.
    pub requests: u16,
    /// How many cells away a robot sees, in a square.
    pub sensor_range: u16,
    /// Steps after which an episode ends in any case.
    pub episode_limit: u32,
    pub rules: Rules,
}

/// A version of the rules, named like the suffix of the reference's task ids. Both are played alike (rware §8).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rules {
    /// `rware` 1.0.x.
    V1,
    /// `rware` 2.0.0.
    V2,
}

impl Rules {
    /// Reads `v1` or `v2`, in either case.
    pub fn parse(text: &str) -> Option<Rules> {
        [Rules::V1, Rules::V2].into_iter().find(|rules| rules.name().eq_ignore_ascii_case(text))
    }

    pub fn name(self) -> &'static str {
        match self {
            Rules::V1 => "v1",
            Rules::V2 => "v2",
        }
    }

    /// The release these rules come from.
    pub fn source(self) -> &'static str {
        match self {
            Rules::V1 => "rware 1.0.x",
            Rules::V2 => "rware 2.0.0",
        }
    }
}

impl fmt::Display for Rules {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Why a warehouse with these numbers cannot exist.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Impossible {
    #[error("the number of {what} must be at least 1, not 0")]
    Nothing { what: &'static str },
    #[error(
        "the number of shelf columns must be odd (the middle one makes room for the goals), not {found}"
    )]
    EvenColumns { found: u16 },
    #[error("the grid would have {width}x{height} cells; no side may be longer than {MAX_SIDE}")]
    Side { width: u64, height: u64 },
    #[error("the number of robots must be 1 to {MAX_ROBOTS}, not {found}")]
    Robots { found: u16 },
    #[error("{robots} robots do not fit on the {cells} cells of the grid")]
    Crowd { robots: u16, cells: u32 },
    #[error(
        "{requests} requests are too many for {shelves} shelves; one at least must be left to be requested next"
    )]
    Requests { requests: u16, shelves: usize },
    #[error("there must be at least 1 request; without requests no robot can earn a reward")]
    NoRequests,
    #[error("a robot must see 1 to {MAX_SENSOR_RANGE} cells far, not {found}")]
    SensorRange { found: u16 },
    #[error("the step limit must be at least 1, not 0")]
    EpisodeLimit,
}

impl Config {
    /// Checks the parameters and returns the floor plan. Traces may have an empty request queue.
    pub(super) fn layout(&self) -> Result<Layout, Impossible> {
        let (rows, columns, high) = (self.shelf_rows, self.shelf_columns, self.column_height);
        for (what, found) in [("shelf rows", rows), ("shelves in a column", high)] {
            if found == 0 {
                return Err(Impossible::Nothing { what });
            }
        }
        if columns.is_multiple_of(2) {
            return Err(Impossible::EvenColumns { found: columns });
        }
        let (width, height) = sides(rows, columns, high);
        if width.max(height) > MAX_SIDE {
            return Err(Impossible::Side { width, height });
        }
        let robots = self.robots;
        if !(1..=MAX_ROBOTS).contains(&robots) {
            return Err(Impossible::Robots { found: robots });
        }
        let cells = (width * height) as u32;
        if u32::from(robots) > cells {
            return Err(Impossible::Crowd { robots, cells });
        }
        if !(1..=MAX_SENSOR_RANGE).contains(&self.sensor_range) {
            return Err(Impossible::SensorRange { found: self.sensor_range });
        }
        if self.episode_limit == 0 {
            return Err(Impossible::EpisodeLimit);
        }
        let layout = Layout::new(rows, columns, high);
        let (requests, shelves) = (self.requests, layout.slots.len());
        if usize::from(requests) >= shelves {
            return Err(Impossible::Requests { requests, shelves });
        }
        Ok(layout)
    }

    /// Checks that there are requests, too.
    pub(super) fn check_playable(&self) -> Result<(), Impossible> {
        self.layout()?;
        if self.requests == 0 {
            return Err(Impossible::NoRequests);
        }
        Ok(())
    }
}
