//! The names of particle tasks, and the spellings of the reference packages.

use super::{missing, Game, Rules};

/// The form of a name, for messages.
pub(crate) const FORM: &str = "mpe-simple-{speaker-listener|adversary|tag}[-epymarl|-2021]";

/// What is wrong with a name of this family.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum NameError {
    #[error("expected `simple-speaker-listener`, `simple-adversary` or `simple-tag`, found {found}; the form is {FORM}")]
    Game { found: String },
    #[error("expected nothing, `epymarl` or `2021` after `{game}`, found {found}; the form is {FORM}")]
    Rules { game: &'static str, found: String },
    #[error("expected nothing or `v{current}` after `pz-mpe-{game}`, found {found}")]
    Version { game: &'static str, current: u32, found: String },
    #[error(
        "`{found}` is a particle world that Rondo does not have; it has `simple-speaker-listener`, \
         `simple-adversary` and `simple-tag`"
    )]
    Missing { found: String },
    #[error(
        "version {found} of `{game}` moves particles in another order than any rules here; take version \
         {current}, or `{game}-2021` for the original particle code"
    )]
    Old { game: &'static str, found: u32, current: u32 },
}

/// The package whose spelling a name has.
#[derive(Clone, Copy, PartialEq)]
enum Speller {
    /// Rondo, PettingZoo, MPE2 or the study of 2021.
    Any,
    /// EPyMARL, which registers PettingZoo's games as `pz-mpe-simple-tag-v3` and plays them by its own rules.
    Epymarl,
}

/// Parses a name; `None` if it is of another family. Case is ignored, `_` is the same as `-`. Names of the reference
/// (`mpe2:simple_tag_v3`, `pz-mpe-simple-tag-v3`, `mpe:SimpleTag-v0`) have the same meaning as there.
pub(crate) fn parse(name: &str) -> Option<Result<(Game, Rules), NameError>> {
    let name = name.to_ascii_lowercase().replace('_', "-");
    if let Some(rest) = name.strip_prefix("pz-mpe-") {
        return Some(parse_rest(rest, Speller::Epymarl));
    }
    let name = name.strip_prefix("pettingzoo").map_or(&*name, |rest| rest.trim_start_matches(SEPARATORS));
    let package = name.strip_prefix("mpe2").or_else(|| name.strip_prefix("mpe"));
    let rest = package.and_then(|rest| rest.strip_prefix(SEPARATORS));
    let rest =
        rest.or_else(|| (name.starts_with("simple") || missing::game(name).is_some()).then_some(name))?;
    Some(parse_rest(rest, Speller::Any))
}

/// Between a package and the name of a game: in an id, a key, an import, and here.
const SEPARATORS: [char; 4] = [':', '/', '.', '-'];

fn parse_rest(rest: &str, speller: Speller) -> Result<(Game, Rules), NameError> {
    for game in Game::ALL {
        let name = game.short_name();
        // As in `SimpleTag-v0`, the form of the ids that the 2021 study registered.
        let joined = rest.strip_prefix(&name.replace('-', ""));
        let suffix = match rest.strip_prefix(name).or(joined) {
            Some("") => None,
            Some(rest) if rest.starts_with('-') => Some(&rest[1..]),
            _ => continue,
        };
        let rules = match (suffix, speller) {
            (Some("v0"), Speller::Any) if joined.is_some() => Rules::Study2021,
            _ => parse_rules(game, suffix, speller)?,
        };
        return Ok((game, rules));
    }
    match missing::game(rest) {
        Some(found) => Err(NameError::Missing { found }),
        None => Err(NameError::Game { found: quoted(rest) }),
    }
}

fn parse_rules(game: Game, suffix: Option<&str>, speller: Speller) -> Result<Rules, NameError> {
    let usual = match speller {
        Speller::Any => Rules::Current,
        Speller::Epymarl => Rules::Epymarl,
    };
    let Some(suffix) = suffix else { return Ok(usual) };
    let name = game.short_name();
    let current = game.layout().version;
    let version = suffix.strip_prefix('v').filter(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()));
    match version.and_then(|digits| digits.parse().ok()) {
        Some(version) if version == current => Ok(usual),
        Some(found) if found < current => Err(NameError::Old { game: name, found, current }),
        _ if speller == Speller::Epymarl => {
            Err(NameError::Version { game: name, current, found: quoted(suffix) })
        }
        _ => Rules::parse(suffix).ok_or_else(|| NameError::Rules { game: name, found: quoted(suffix) }),
    }
}

fn quoted(part: &str) -> String {
    match part {
        "" => "nothing".to_owned(),
        part => format!("`{part}`"),
    }
}

impl Game {
    /// Such as `simple-tag`.
    fn short_name(self) -> &'static str {
        self.layout().task.strip_prefix("mpe-").expect("all tasks of the family begin so")
    }

    /// The canonical name of this game under these rules.
    pub(super) fn name(self, rules: Rules) -> String {
        let task = self.layout().task;
        match rules {
            Rules::Current => task.to_owned(),
            Rules::Epymarl | Rules::Study2021 => format!("{task}-{rules}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn canonical(name: &str) -> String {
        let (game, rules) = parse(name).expect("of this family").expect("a good name");
        game.name(rules)
    }

    fn mistake(name: &str) -> String {
        parse(name).expect("of this family").expect_err("a bad name").to_string()
    }

    #[test]
    fn every_spelling_has_one_canonical_name() {
        for (name, expected) in [
            ("mpe-simple-tag", "mpe-simple-tag"),
            ("mpe-simple-tag-current", "mpe-simple-tag"),
            ("MPE-Simple-Tag-EPyMARL", "mpe-simple-tag-epymarl"),
            ("mpe-simple-adversary-2021", "mpe-simple-adversary-2021"),
            ("simple_tag_v3", "mpe-simple-tag"),
            ("simple-tag-v3", "mpe-simple-tag"),
            ("pz-mpe-simple-tag-v3", "mpe-simple-tag-epymarl"),
            ("pz-mpe-simple-speaker-listener-v4", "mpe-simple-speaker-listener-epymarl"),
            ("pz-mpe-simple-adversary", "mpe-simple-adversary-epymarl"),
            ("mpe/simple_tag_v3", "mpe-simple-tag"),
            ("mpe2.simple_tag_v3", "mpe-simple-tag"),
            ("pettingzoo.mpe.simple_tag_v3", "mpe-simple-tag"),
            ("pettingzoo/mpe/simple_tag_v3", "mpe-simple-tag"),
            ("mpe:simple_tag_v3", "mpe-simple-tag"),
            ("mpe2:simple_adversary_v3", "mpe-simple-adversary"),
            ("simple_speaker_listener_v4", "mpe-simple-speaker-listener"),
            ("mpe:SimpleTag-v0", "mpe-simple-tag-2021"),
            ("mpe:SimpleSpeakerListener-v0", "mpe-simple-speaker-listener-2021"),
            ("SimpleAdversary-v0", "mpe-simple-adversary-2021"),
        ] {
            assert_eq!(canonical(name), expected, "{name}");
        }
    }

    #[test]
    fn other_families_are_left_to_others() {
        for name in ["", "mpe", "lbf-8x8-2p-2f", "tag", "rware-tiny-2ag"] {
            assert_eq!(parse(name), None, "{name}");
        }
    }

    #[test]
    fn a_wrong_name_is_answered_with_what_belongs_there() {
        for (name, expected) in [
            ("mpe-", "expected `simple-speaker-listener`, `simple-adversary` or `simple-tag`, found nothing"),
            (
                "mpe-simple-spreads",
                "expected `simple-speaker-listener`, `simple-adversary` or `simple-tag`, found `simple-spreads`",
            ),
            (
                "simple_tags_v3",
                "expected `simple-speaker-listener`, `simple-adversary` or `simple-tag`, found `simple-tags-v3`",
            ),
            ("simple_tag_v4", "expected nothing, `epymarl` or `2021` after `simple-tag`, found `v4`"),
            ("mpe-simple-tag-", "expected nothing, `epymarl` or `2021` after `simple-tag`, found nothing"),
            ("mpe-simple-tag-2020", "expected nothing, `epymarl` or `2021` after `simple-tag`, found `2020`"),
        ] {
            assert_eq!(mistake(name), format!("{expected}; the form is {FORM}"), "{name}");
        }
    }

    #[test]
    fn a_spelling_of_epymarl_has_no_other_rules_behind_it() {
        assert_eq!(
            mistake("pz-mpe-simple-tag-2021"),
            "expected nothing or `v3` after `pz-mpe-simple-tag`, found `2021`"
        );
        let old = mistake("pz-mpe-simple-tag-v2");
        assert!(old.starts_with("version 2 of `simple-tag` moves particles in another order"), "{old}");
    }

    #[test]
    fn versions_with_another_order_of_integration_are_refused_with_the_reason() {
        for (name, game, found, current) in [
            ("simple_tag_v2", "simple-tag", 2, 3),
            ("simple_tag_v0", "simple-tag", 0, 3),
            ("mpe:simple_speaker_listener_v3", "simple-speaker-listener", 3, 4),
        ] {
            let expected = format!(
                "version {found} of `{game}` moves particles in another order than any rules here; take version \
                 {current}, or `{game}-2021` for the original particle code"
            );
            assert_eq!(mistake(name), expected, "{name}");
        }
    }
}
