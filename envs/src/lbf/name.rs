//! The names of foraging tasks, and the reference's spellings of them.

use super::{registered, Config, Impossible, Rules};

/// The form of a name, for messages.
pub(crate) const FORM: &str = "lbf-[{sight}s-]{rows}x{cols}-{players}p-{foods}f[-coop][-v0|-v1|-v2|-v3]";

const EPISODE_LIMIT: u32 = 50;

/// What is wrong with a name of this family.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum NameError {
    #[error("expected {expected}, found {found}; the form is {FORM}")]
    Part { expected: &'static str, found: String },
    #[error(
        "no release of lbforaging registers `foraging-{id}` ({limits}){elsewhere}; Rondo's own name for these numbers \
         is `{own}`"
    )]
    Unregistered { id: String, limits: &'static str, elsewhere: &'static str, own: String },
    #[error("its players see the grid as layers of numbers; Rondo has the world with vectors, `{own}`")]
    Grid { own: String },
    #[error("`{word}` {effect}, and no name here has that; without it the world is `{own}`")]
    Variant { word: &'static str, effect: &'static str, own: String },
    #[error(transparent)]
    Impossible(#[from] Impossible),
}

/// Parses a name; `None` if it is of another family. Case is ignored. The ids that the reference registers
/// (`Foraging-8x8-2p-2f-coop-v3`, also after `lbforaging:`) have the same meaning as there.
pub(crate) fn parse(name: &str) -> Option<Result<Config, NameError>> {
    let name = name.to_ascii_lowercase();
    match name.strip_prefix("lbforaging:").unwrap_or(&name).strip_prefix("foraging-") {
        Some(id) => Some(registered::parse(id)),
        None => name.strip_prefix("lbf-").map(parse_parts),
    }
}

pub(super) fn parse_parts(parts: &str) -> Result<Config, NameError> {
    let mut parts = parts.split('-').peekable();
    let sight = parts.next_if(|part| part.ends_with('s')).map(|part| {
        let sight = number(part, "s");
        sight.ok_or_else(|| wrong("a sight such as `2s`", Some(part)))
    });
    let sight = sight.transpose()?;

    let part = parts.next();
    let sides = part.and_then(|part| part.split_once('x'));
    let sides = sides.and_then(|(rows, cols)| Some((number(rows, "")?, number(cols, "")?)));
    let (rows, cols) = sides.ok_or_else(|| wrong("a grid such as `8x8`", part))?;

    let part = parts.next();
    let players = part.and_then(|part| number(part, "p"));
    let players = players.ok_or_else(|| wrong("a number of players such as `2p`", part))?;

    let part = parts.next();
    let foods = part.and_then(|part| number(part, "f"));
    let foods = foods.ok_or_else(|| wrong("a number of foods such as `2f`", part))?;

    let coop = parts.next_if_eq(&"coop").is_some();
    let rules = match parts.next() {
        None => Rules::V3,
        Some(part) => Rules::parse(part)
            .ok_or_else(|| wrong("`coop` or a version of the rules, `v0` to `v3`", Some(part)))?,
    };
    if let Some(part) = parts.next() {
        return Err(wrong("nothing after the version of the rules", Some(part)));
    }

    let all = rows.max(cols);
    let sight = sight.unwrap_or(all).min(all);
    let episode_limit = EPISODE_LIMIT;
    let config = Config { rows, cols, players, foods, coop, sight, penalty: 0.0, episode_limit, rules };
    config.check()?;
    Ok(config)
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
    /// The canonical name of these parameters: without a sight if the whole grid is seen, without a version for v3.
    /// Penalty and step limit are not part of names.
    pub fn name(&self) -> String {
        let Config { rows, cols, players, foods, .. } = self;
        let sight = if self.sight < *rows.max(cols) { format!("{}s-", self.sight) } else { String::new() };
        let coop = if self.coop { "-coop" } else { "" };
        let version = if self.rules == Rules::V3 { String::new() } else { format!("-{}", self.rules) };
        format!("lbf-{sight}{rows}x{cols}-{players}p-{foods}f{coop}{version}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn canonical(name: &str) -> String {
        parse(name).expect("of this family").expect("a good name").name()
    }

    fn mistake(name: &str) -> String {
        parse(name).expect("of this family").expect_err("a bad name").to_string()
    }

    #[test]
    fn every_spelling_has_one_canonical_name() {
        for (name, expected) in [
            ("lbf-8x8-2p-2f-coop", "lbf-8x8-2p-2f-coop"),
            ("lbf-8x8-2p-2f-coop-v3", "lbf-8x8-2p-2f-coop"),
            ("LBF-10X10-3P-3F-V2", "lbf-10x10-3p-3f-v2"),
            ("lbforaging:Foraging-8x8-2p-2f-coop-v3", "lbf-8x8-2p-2f-coop"),
            ("Foraging-8x8-2p-2f-coop-v2", "lbf-8x8-2p-2f-coop-v2"),
            ("Foraging-2s-8x8-2p-2f-v1", "lbf-2s-8x8-2p-2f-v1"),
            ("lbf-8s-8x8-2p-2f", "lbf-8x8-2p-2f"),
            ("lbf-9s-8x8-2p-2f", "lbf-8x8-2p-2f"),
            ("lbf-5x9-2p-1f", "lbf-5x9-2p-1f"),
            ("lbf-08x8-2p-2f", "lbf-8x8-2p-2f"),
        ] {
            assert_eq!(canonical(name), expected, "{name}");
        }
    }

    #[test]
    fn a_name_says_all_numbers() {
        let config = parse("lbf-2s-8x9-3p-4f-coop-v1").unwrap().unwrap();
        let expected = Config {
            rows: 8,
            cols: 9,
            players: 3,
            foods: 4,
            coop: true,
            sight: 2,
            penalty: 0.0,
            episode_limit: 50,
            rules: Rules::V1,
        };
        assert_eq!(config, expected);
    }

    #[test]
    fn other_families_are_left_to_others() {
        for name in ["", "rware-tiny-2ag", "lbf", "8x8-2p-2f", "lbforaging:lbf-8x8-2p-2f"] {
            assert_eq!(parse(name), None, "{name}");
        }
    }

    #[test]
    fn a_wrong_part_is_named_with_what_belongs_there() {
        for (name, expected) in [
            ("lbf-", "expected a grid such as `8x8`, found nothing"),
            ("lbf-8-2p-2f", "expected a grid such as `8x8`, found `8`"),
            ("lbf-+8x8-2p-2f", "expected a grid such as `8x8`, found `+8x8`"),
            ("lbf-99999x8-2p-2f", "expected a grid such as `8x8`, found `99999x8`"),
            ("lbf-xs-8x8-2p-2f", "expected a sight such as `2s`, found `xs`"),
            ("lbf-8x8-2q-2f", "expected a number of players such as `2p`, found `2q`"),
            ("lbf-8x8-2p", "expected a number of foods such as `2f`, found nothing"),
            ("lbf-8x8-2p-2f-co", "expected `coop` or a version of the rules, `v0` to `v3`, found `co`"),
            ("lbf-8x8-2p-2f-v4", "expected `coop` or a version of the rules, `v0` to `v3`, found `v4`"),
            ("lbf-8x8-2p-2f-v3-coop", "expected nothing after the version of the rules, found `coop`"),
        ] {
            let message = mistake(name);
            assert_eq!(message, format!("{expected}; the form is {FORM}"), "{name}");
        }
    }

    #[test]
    fn numbers_that_cannot_work_are_refused_with_the_reason() {
        for (name, expected) in [
            ("lbf-2x8-1p-1f", "the number of rows must be 3 to 255 (no food lies on the border), not 2"),
            (
                "lbf-8x256-1p-1f",
                "the number of columns must be 3 to 255 (no food lies on the border), not 256",
            ),
            ("lbf-8x8-0p-2f", "the number of players must be 1 to 64, not 0"),
            ("lbf-8x8-65p-2f", "the number of players must be 1 to 64, not 65"),
            ("lbf-3x3-10p-1f", "10 players do not fit on 9 cells, which is where they start on this grid"),
            ("lbf-3x3-5p-1f-v1", "5 players do not fit on 4 cells, which is where they start on this grid"),
            ("lbf-3x3-9p-1f", "9 players take all 9 cells of the grid, so no food can ever be placed"),
            ("lbf-8x8-2p-0f", "there must be at least 1 food, or an episode is over at once"),
            ("lbf-5x5-2p-26f", "the number of foods must be 1 to 25, one for each cell of the grid, not 26"),
            (
                "Foraging-5x5-17p-1f-v1",
                "17 players do not fit on 16 cells, which is where they start on this grid",
            ),
            ("lbf-0s-8x8-2p-2f", "a player must see at least 1 cell far, not 0"),
        ] {
            assert_eq!(mistake(name), expected, "{name}");
        }
    }
}
