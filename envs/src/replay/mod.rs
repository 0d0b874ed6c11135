//! Replays recorded traces of reference environments: compares every value with those of the worlds here for the same
//! start and the same actions.
//!
//! A trace is a text of one JSON object per line: a header, then episodes of one `reset` and its `step`s.

mod compare;
mod episode;
mod lbf;
mod lines;
mod mpe;
mod record;
mod rware;
mod smaclite;
mod ticks;

use std::fmt;
use std::io::{self, BufRead};

use serde::Deserialize;

use compare::Findings;
use lines::Lines;

/// The supported version of the trace format.
const FORMAT_VERSION: u32 = 1;

/// The result of a complete replay.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// As the header names it.
    pub task: String,
    pub episodes: u64,
    pub steps: u64,
    /// Values that differ. An episode continues from its own state, so one cause may count several times.
    pub mismatches: u64,
    pub first: Option<Mismatch>,
    /// Steps that differ and are not counted above, because bodies touch to the last bit (smaclite §11). Only battles
    /// have them.
    pub excused: u64,
}

/// One value that differs.
#[derive(Debug, Clone, PartialEq)]
pub struct Mismatch {
    pub line: u64,
    pub episode: u64,
    /// Steps since the start of the episode; 0 is the start itself.
    pub t: u64,
    /// The path in the record, such as `obs[1][4]`: agent 1, fifth number.
    pub field: String,
    /// As recorded.
    pub expected: String,
    /// As computed here.
    pub found: String,
}

/// Why a trace could not be replayed to its end.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    #[error("{file}, line {line}: cannot read on: {source}")]
    Read { file: String, line: u64, source: io::Error },
    #[error("{file}, line {line}: {what}")]
    Damaged { file: String, line: u64, what: String },
    #[error(
        "{file} is a trace of `{family}` (task `{task}`), which cannot be replayed; lbf, rware, mpe and smaclite can"
    )]
    Unsupported { file: String, family: String, task: String },
}

/// Replays a whole trace. `name` is its name in messages, for instance its path.
///
/// The report counts values that differ. Anything that makes a replay meaningless (a line that is not a record, an
/// impossible state, an incomplete episode) is an error.
pub fn replay(lines: impl BufRead, name: &str) -> Result<Report, ReplayError> {
    let mut lines = Lines::new(lines, name);
    if !lines.advance()? {
        return Err(lines.damaged("expected a header, found the end of the file"));
    }
    // Recorded ticks come without a header.
    if lines.parse::<record::Kind>()?.kind == "episode" {
        return ticks::replay(lines);
    }
    let start: HeaderStart = lines.parse()?;
    if start.kind != "header" {
        return Err(
            lines.damaged(format!("expected a record of type `header` first, found `{}`", start.kind))
        );
    }
    if start.format_version != FORMAT_VERSION {
        let found = start.format_version;
        return Err(lines.damaged(format!("expected format_version {FORMAT_VERSION}, found {found}")));
    }
    match start.env.as_str() {
        "lbf" => lbf::replay(lines, start.task),
        "mpe" => mpe::replay(lines, start.task),
        "rware" => rware::replay(lines, start.task),
        "smaclite" => smaclite::replay(lines, start.task),
        _ => Err(ReplayError::Unsupported { file: name.to_owned(), family: start.env, task: start.task }),
    }
}

/// What headers of all families have.
#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct HeaderStart {
    #[serde(rename = "type")]
    kind: String,
    format_version: u32,
    env: String,
    task: String,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Report { task, episodes, steps, mismatches, excused, .. } = self;
        write!(f, "{task}: {episodes} episodes, {steps} steps, {mismatches} mismatches")?;
        if *excused > 0 {
            write!(f, " ({excused} steps excused: bodies touch to the last bit)")?;
        }
        match &self.first {
            None => Ok(()),
            Some(first) => write!(f, "; the first: {first}"),
        }
    }
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Mismatch { line, episode, t, field, expected, found } = self;
        write!(f, "line {line}, episode {episode}, t {t}, {field}: expected {expected}, found {found}")
    }
}
