//! The three versions of the particle rules: the maintained packages, EPyMARL's view of them, and the 2021 study.
//!
//! `current` means release 1.1.1 of `mpe2`. Its worlds are those of `pettingzoo` 1.24.3 to the last bit: every recorded
//! episode was played with both. The repository of `mpe2` changed a reward after that release. The change is **not** in
//! `current`: no release had it when the episodes were recorded, and we have not examined which of the three games it
//! changes and how. Before `current` follows a later release, record episodes with it and compare (`rondo replay`). If
//! a number differs, it is another version of the rules and needs another name.

use std::fmt;

/// A version of the rules, by the suffix of task names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rules {
    /// The package in its release 1.1.1 (mpe §5, §6). Opponents move as they were trained to (mpe §8).
    Current,
    /// As [`Rules::Current`], but the outcome of the last step is lost (mpe §7), and the opponent's choice is not
    /// translated into this world's directions, so it moves backwards (mpe §8).
    Epymarl,
    /// The original particle code with its own order of integration, directions and rewards (mpe §9).
    Study2021,
}

impl Rules {
    pub const ALL: [Rules; 3] = [Rules::Current, Rules::Epymarl, Rules::Study2021];

    /// Reads `current`, `epymarl` or `2021`, in any case.
    pub fn parse(text: &str) -> Option<Rules> {
        Rules::ALL.into_iter().find(|rules| rules.name().eq_ignore_ascii_case(text))
    }

    pub fn name(self) -> &'static str {
        match self {
            Rules::Current => "current",
            Rules::Epymarl => "epymarl",
            Rules::Study2021 => "2021",
        }
    }

    /// Where these rules come from.
    pub fn source(self) -> &'static str {
        match self {
            Rules::Current => "mpe2 1.1.1 / pettingzoo 1.24.3",
            Rules::Epymarl => "EPyMARL v2 on pettingzoo 1.24.3",
            Rules::Study2021 => "the 2021 study's particle code",
        }
    }

    /// The unit direction of an action (mpe §4, §9), zero for actions that do not exist.
    pub(super) fn direction(self, action: u16) -> [f64; 2] {
        match if self == Rules::Study2021 { mirrored(action) } else { action } {
            1 => [-1.0, 0.0],
            2 => [1.0, 0.0],
            3 => [0.0, -1.0],
            4 => [0.0, 1.0],
            _ => [0.0, 0.0],
        }
    }

    /// The action of this world for a frozen network's choice, in which 1 is +x, 2 is -x, 3 is +y and 4 is -y (mpe §8).
    pub(super) fn action_of_network(self, choice: u16) -> u16 {
        match self {
            Rules::Current => mirrored(choice),
            // Backwards in `Epymarl`, as in EPyMARL. In `Study2021` the directions are the network's.
            Rules::Epymarl | Rules::Study2021 => choice,
        }
    }
}

/// Swaps the two directions of each axis.
fn mirrored(action: u16) -> u16 {
    match action {
        1 => 2,
        2 => 1,
        3 => 4,
        4 => 3,
        other => other,
    }
}

impl fmt::Display for Rules {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn networks_push_as_they_were_trained_to_except_under_epymarl() {
        let push = |rules: Rules, choice| rules.direction(rules.action_of_network(choice));
        for (choice, meant) in
            [(0, [0.0, 0.0]), (1, [1.0, 0.0]), (2, [-1.0, 0.0]), (3, [0.0, 1.0]), (4, [0.0, -1.0])]
        {
            assert_eq!(push(Rules::Current, choice), meant);
            assert_eq!(push(Rules::Study2021, choice), meant);
            assert_eq!(push(Rules::Epymarl, choice), [-meant[0], -meant[1]]);
        }
    }
}
