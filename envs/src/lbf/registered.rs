//! The task ids that releases of `lbforaging` register. They have the same meaning here. An id that no release
//! registers is refused, because it comes from another package and may mean other numbers.

use super::name::{parse_parts, NameError};
use super::{Config, Rules};

/// Ids that PyMARLzoo+ 1.1.0 adds to those of `lbforaging`, without the ending `-coop-v2` or `-coop-v3`. Every player
/// and every food has level 3 there. It also redefines some ids of `lbforaging` so; here they keep their own meaning.
const LEVEL_3: [&str; 12] = [
    "8s-25x25-8p-5f",
    "5s-25x25-8p-5f",
    "7s-50x50-8p-5f",
    "7s-30x30-7p-5f",
    "7s-30x30-7p-4f",
    "4s-30x30-8p-5f",
    "7s-20x20-5p-3f",
    "5s-20x20-5p-3f",
    "7s-15x15-5p-3f",
    "6s-12x12-2p-2f",
    "4s-11x11-3p-2f",
    "4s-11x11-4p-3f",
];

/// Words after `-coop` in the ids of variants, and what they change.
const VARIANTS: [(&str, &str); 2] =
    [("-ind", "puts every food at level 1"), ("-pen", "takes 0.1 from each player whose loading fails")];

/// Parses what follows `foraging-`, in lower case.
pub(super) fn parse(id: &str) -> Result<Config, NameError> {
    let (grid, parts) = match id.strip_prefix("grid-") {
        Some(parts) => (true, parts),
        None => (false, id),
    };
    let mut plain = parts.to_owned();
    let mut variant = None;
    for (word, effect) in VARIANTS {
        if let Some(at) = plain.find(word) {
            plain.replace_range(at..at + word.len(), "");
            variant = variant.or(Some((word, effect)));
        }
    }
    let config = parse_parts(&plain)?;
    let own = config.name();
    if grid {
        return Err(NameError::Grid { own });
    }
    if let Some((word, effect)) = variant {
        return Err(NameError::Variant { word, effect, own });
    }
    if registers(&config) && is_id_of(parts, &config) {
        return Ok(config);
    }
    let level_3 = config.coop
        && config.rules >= Rules::V2
        && LEVEL_3
            .iter()
            .any(|other| parts.strip_prefix(other).is_some_and(|rest| rest.starts_with("-coop")));
    let elsewhere = if level_3 {
        "; PyMARLzoo+ registers it with every player and every food at level 3, which is another world"
    } else {
        ""
    };
    Err(NameError::Unregistered { id: id.to_owned(), limits: limits(config.rules), elsewhere, own })
}

fn registers(config: &Config) -> bool {
    let Config { rows, cols, players, foods, sight, rules, .. } = *config;
    let most_players = match rules {
        Rules::V0 => 4,
        Rules::V1 | Rules::V2 => 19,
        Rules::V3 => 9,
    };
    // 1.1.1 has every sight, the other releases the whole grid or two cells.
    let sight = rules == Rules::V2 || sight == rows || sight == 2;
    rows == cols
        && (5..=19).contains(&rows)
        && (2..=most_players).contains(&players)
        // Release 2.0.0 has up to 4 foods, its newest source 9.
        && (1..=9).contains(&foods)
        && sight
}

/// The condition of [`registers`], in words.
fn limits(rules: Rules) -> &'static str {
    match rules {
        Rules::V0 => "v0 ids have square grids of side 5 to 19, 2 to 4 players, 1 to 9 foods, and a sight of `2s` or none",
        Rules::V1 => "v1 ids have square grids of side 5 to 19, 2 to 19 players, 1 to 9 foods, and a sight of `2s` or none",
        Rules::V2 => "v2 ids have square grids of side 5 to 19, 2 to 19 players, 1 to 9 foods, and a sight below the side or none",
        Rules::V3 => "v3 ids have square grids of side 5 to 19, 2 to 9 players, 1 to 9 foods, and a sight of `2s` or none",
    }
}

/// Whether a release writes these numbers so. Without a version gymnasium takes the newest.
fn is_id_of(parts: &str, config: &Config) -> bool {
    let newest = Config { rules: Rules::V3, ..config.clone() }.name();
    let numbers = newest.strip_prefix("lbf-").expect("all names begin so");
    let version = parts.strip_prefix(numbers).and_then(|rest| rest.strip_prefix('-'));
    parts == numbers || version == Some(config.rules.name())
}
