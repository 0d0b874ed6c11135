//! The names of warehouse tasks, and the reference's spellings of them.

use std::iter::Peekable;
use std::str::Split;

use super::{registered, Config, Impossible, Rules};

/// The form of a name, for messages.
pub(crate) const FORM: &str =
    "rware-[{sight}s-]{tiny|small|medium|large|ROWSxCOLUMNS}-[{height}h-]{robots}ag[-easy|-hard|-{requests}req][-v1|-v2]";

/// Name, shelf rows, shelf columns.
pub(super) const SIZES: [(&str, u16, u16); 4] =
    [("tiny", 1, 3), ("small", 2, 3), ("medium", 2, 5), ("large", 3, 5)];
pub(super) const COLUMN_HEIGHT: u16 = 8;
pub(super) const SENSOR_RANGE: u16 = 1;
const EPISODE_LIMIT: u32 = 500;

/// What is wrong with a name of this family.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum NameError {
    #[error("expected {expected}, found {found}; the form is {FORM}")]
    Part { expected: &'static str, found: String },
    #[error("its robots see images (`{image}`); Rondo has the warehouse with vectors, `{own}`")]
    Image { image: String, own: String },
    #[error(
        "`global` pays every robot for every delivery; Rondo pays each for its own, `{own}`, and the sum of the team's \
         rewards there is what `global` pays"
    )]
    Global { own: String },
    #[error(
        "`twostage` pays half for a delivery and half for bringing the shelf back; Rondo pays for deliveries alone, \
         `{own}`"
    )]
    TwoStage { own: String },
    #[error("no release of rware registers `rware-{id}`; Rondo's own name for these numbers is `{own}`")]
    Unregistered { id: String, own: String },
    #[error(transparent)]
    Impossible(#[from] Impossible),
}

/// Parses a name; `None` if it is of another family. Case is ignored. The ids that the reference registers
/// (`rware-tiny-2ag-easy-v2`, `rware-1x3-8h-2ag-4req-indiv-v2`, also after `rware:`) have the same meaning as there.
pub(crate) fn parse(name: &str) -> Option<Result<Config, NameError>> {
    let name = name.to_ascii_lowercase();
    let of_package = name.strip_prefix("rware:");
    let id = of_package.unwrap_or(&name).strip_prefix("rware-")?;
    Some(parse_id(id, of_package.is_some()))
}

/// Parses what follows `rware-`. Rondo's names and the reference's ids have one form, but some words occur in the
/// reference's ids only. With such a word, or with the prefix `rware:`, the id must be one that it registers.
fn parse_id(id: &str, of_package: bool) -> Result<Config, NameError> {
    let (image, parts) = match id.split_once('-') {
        Some((word @ ("img" | "imgdict"), rest)) => (Some(word.to_owned()), rest),
        _ => (None, id),
    };
    // Whether images turn with the robot. It has no effect on vectors, but ids of vectors contain it too.
    let (turned, parts) = match parts.strip_prefix("nd-") {
        Some(rest) => (true, rest),
        None => (false, parts),
    };
    let (config, reward) = parse_parts(parts)?;
    config.check_playable()?;
    let own = config.name();
    if let Some(image) = image {
        return Err(NameError::Image { image, own });
    }
    match reward {
        Some(Reward::Global) => return Err(NameError::Global { own }),
        Some(Reward::TwoStage) => return Err(NameError::TwoStage { own }),
        Some(Reward::Individual) | None => {}
    }
    if (of_package || turned || reward.is_some()) && !registered::is_id(id, &config) {
        return Err(NameError::Unregistered { id: id.to_owned(), own });
    }
    Ok(config)
}

/// The reference's words for its kinds of rewards.
enum Reward {
    /// Each robot for its own deliveries; the only kind here.
    Individual,
    Global,
    TwoStage,
}

fn parse_parts(parts: &str) -> Result<(Config, Option<Reward>), NameError> {
    let mut parts = parts.split('-').peekable();
    let sensor_range = optional(&mut parts, |part| number(part, "s")).unwrap_or(SENSOR_RANGE);

    let part = parts.next();
    let (shelf_rows, shelf_columns) = part
        .and_then(size)
        .ok_or_else(|| wrong("a size (tiny, small, medium, large, or such as `1x3`)", part))?;

    let column_height = optional(&mut parts, |part| number(part, "h")).unwrap_or(COLUMN_HEIGHT);

    let part = parts.next();
    let robots = part.and_then(|part| number(part, "ag"));
    let robots = robots.ok_or_else(|| wrong("a number of robots such as `2ag`", part))?;

    let requests = optional(&mut parts, |part| requests(part, robots)).unwrap_or(robots);
    let reward = optional(&mut parts, reward);

    let rules = match parts.next() {
        None => Rules::V2,
        Some(part) => Rules::parse(part).ok_or_else(|| {
            wrong(
                "`easy`, `hard`, a number of requests such as `4req`, or the rules, `v1` or `v2`",
                Some(part),
            )
        })?,
    };
    if let Some(part) = parts.next() {
        return Err(wrong("nothing after the version of the rules", Some(part)));
    }
    let config = Config {
        shelf_rows,
        shelf_columns,
        column_height,
        robots,
        requests,
        sensor_range,
        episode_limit: EPISODE_LIMIT,
        rules,
    };
    Ok((config, reward))
}

fn reward(part: &str) -> Option<Reward> {
    match part {
        "indiv" => Some(Reward::Individual),
        "global" => Some(Reward::Global),
        "twostage" => Some(Reward::TwoStage),
        _ => None,
    }
}

/// Takes the next part if `read` understands it.
fn optional<T>(parts: &mut Peekable<Split<'_, char>>, read: impl FnOnce(&str) -> Option<T>) -> Option<T> {
    let found = read(parts.peek()?)?;
    parts.next();
    Some(found)
}

/// Shelf rows and columns.
fn size(part: &str) -> Option<(u16, u16)> {
    if let Some(&(_, rows, columns)) = SIZES.iter().find(|(name, ..)| *name == part) {
        return Some((rows, columns));
    }
    let (rows, columns) = part.split_once('x')?;
    Some((number(rows, "")?, number(columns, "")?))
}

/// The length of the request queue.
fn requests(part: &str, robots: u16) -> Option<u16> {
    match part {
        "easy" => Some(robots.saturating_mul(2)),
        "hard" => Some(robots / 2),
        _ => number(part, "req"),
    }
}

/// Digits, then `unit`.
fn number(part: &str, unit: &str) -> Option<u16> {
    let digits = part.strip_suffix(unit)?;
    // `parse` alone would accept a sign.
    digits.bytes().all(|byte| byte.is_ascii_digit()).then(|| digits.parse().ok())?
}

fn wrong(expected: &'static str, found: Option<&str>) -> NameError {
    let found = match found {
        None | Some("") => "nothing".to_owned(),
        Some(part) => format!("`{part}`"),
    };
    NameError::Part { expected, found }
}

impl Config {
    /// The canonical name of these parameters: without defaults, and with words where there are some. The step limit is
    /// not part of names.
    pub fn name(&self) -> String {
        let Config { shelf_rows, shelf_columns, column_height, robots, requests, sensor_range, .. } = *self;
        let sight = if sensor_range == SENSOR_RANGE { String::new() } else { format!("{sensor_range}s-") };
        let size = SIZES.iter().find(|&&(_, rows, columns)| (rows, columns) == (shelf_rows, shelf_columns));
        let size = match size {
            Some((name, ..)) => (*name).to_owned(),
            None => format!("{shelf_rows}x{shelf_columns}"),
        };
        let high = if column_height == COLUMN_HEIGHT { String::new() } else { format!("{column_height}h-") };
        let queue = match requests {
            _ if requests == robots => String::new(),
            _ if requests == robots.saturating_mul(2) => "-easy".to_owned(),
            _ if requests == robots / 2 => "-hard".to_owned(),
            _ => format!("-{requests}req"),
        };
        let version = if self.rules == Rules::V2 { String::new() } else { format!("-{}", self.rules) };
        format!("rware-{sight}{size}-{high}{robots}ag{queue}{version}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(name: &str) -> Config {
        parse(name).expect("of this family").expect("a good name")
    }

    fn mistake(name: &str) -> String {
        parse(name).expect("of this family").expect_err("a bad name").to_string()
    }

    #[test]
    fn every_spelling_has_one_canonical_name() {
        for (name, expected) in [
            ("rware-tiny-2ag", "rware-tiny-2ag"),
            ("rware:rware-tiny-2ag-v1", "rware-tiny-2ag-v1"),
            ("RWARE:RWARE-SMALL-4AG-HARD-V2", "rware-small-4ag-hard"),
            ("rware-tiny-2ag-easy-v2", "rware-tiny-2ag-easy"),
            ("rware-medium-6ag-hard-v1", "rware-medium-6ag-hard-v1"),
            ("rware-2x5-19ag", "rware-medium-19ag"),
            ("rware-1x3-8h-2ag-4req-indiv-v2", "rware-tiny-2ag-easy"),
            ("rware-1x3-2ag-1req", "rware-tiny-2ag-hard"),
            ("rware-4x9-4ag-7req", "rware-4x9-4ag-7req"),
            ("rware-2s-tiny-4h-02ag", "rware-2s-tiny-4h-2ag"),
            ("rware-1s-large-4ag-4req", "rware-large-4ag"),
        ] {
            assert_eq!(config(name).name(), expected, "{name}");
            assert_eq!(config(expected), config(name), "{name}");
        }
    }

    #[test]
    fn a_name_says_all_numbers() {
        let expected = Config {
            shelf_rows: 3,
            shelf_columns: 5,
            column_height: 6,
            robots: 5,
            requests: 2,
            sensor_range: 2,
            episode_limit: 500,
            rules: Rules::V1,
        };
        assert_eq!(config("rware-2s-large-6h-5ag-hard-v1"), expected);
    }

    #[test]
    fn difficulties_are_lengths_of_the_request_queue() {
        for (name, requests) in [
            ("rware-tiny-2ag-easy", 4),
            ("rware-tiny-2ag", 2),
            ("rware-tiny-2ag-hard", 1),
            ("rware-small-5ag-hard", 2),
            ("rware-small-5ag-easy", 10),
        ] {
            assert_eq!(config(name).requests, requests, "{name}");
        }
    }

    #[test]
    fn other_families_are_left_to_others() {
        for name in ["", "lbf-8x8-2p-2f", "rware", "tiny-2ag", "rware:tiny-2ag"] {
            assert_eq!(parse(name), None, "{name}");
        }
    }

    #[test]
    fn a_wrong_part_is_named_with_what_belongs_there() {
        let size = "a size (tiny, small, medium, large, or such as `1x3`)";
        let robots = "a number of robots such as `2ag`";
        let end = "`easy`, `hard`, a number of requests such as `4req`, or the rules, `v1` or `v2`";
        for (name, expected, found) in [
            ("rware-", size, "nothing"),
            ("rware-2ag", size, "`2ag`"),
            ("rware-huge-2ag", size, "`huge`"),
            ("rware-1x-2ag", size, "`1x`"),
            ("rware-image-tiny-2ag", size, "`image`"),
            ("rware-tiny", robots, "nothing"),
            ("rware-tiny-2p", robots, "`2p`"),
            ("rware-tiny-+2ag", robots, "`+2ag`"),
            ("rware-tiny-99999ag", robots, "`99999ag`"),
            ("rware-tiny-2ag-normal", end, "`normal`"),
            ("rware-tiny-2ag-v3", end, "`v3`"),
            ("rware-tiny-2ag-v1-easy", "nothing after the version of the rules", "`easy`"),
        ] {
            assert_eq!(
                mistake(name),
                format!("expected {expected}, found {found}; the form is {FORM}"),
                "{name}"
            );
        }
    }

    #[test]
    fn numbers_that_cannot_work_are_refused_with_the_reason() {
        for (name, expected) in [
            ("rware-tiny-0ag", "the number of robots must be 1 to 64, not 0"),
            ("rware-tiny-65ag", "the number of robots must be 1 to 64, not 65"),
            ("rware-1x1-1h-17ag-1req", "17 robots do not fit on the 16 cells of the grid"),
            ("rware-0x3-2ag", "the number of shelf rows must be at least 1, not 0"),
            ("rware-tiny-0h-2ag", "the number of shelves in a column must be at least 1, not 0"),
            (
                "rware-2x4-2ag",
                "the number of shelf columns must be odd (the middle one makes room for the goals), not 4",
            ),
            ("rware-29x3-2ag", "the grid would have 10x263 cells; no side may be longer than 255"),
            ("rware-1x65535-2ag", "the grid would have 196606x11 cells; no side may be longer than 255"),
            (
                "rware-tiny-16ag-easy",
                "32 requests are too many for 32 shelves; one at least must be left to be requested next",
            ),
            (
                "rware-tiny-1ag-hard",
                "there must be at least 1 request; without requests no robot can earn a reward",
            ),
            ("rware-0s-tiny-2ag", "a robot must see 1 to 5 cells far, not 0"),
            ("rware-6s-tiny-2ag", "a robot must see 1 to 5 cells far, not 6"),
        ] {
            assert_eq!(mistake(name), expected, "{name}");
        }
    }
}
