//! The four published versions of the foraging rules (lbf §8). They differ in the reset only.

use std::fmt;

/// A version of the rules, named like the suffix of the reference's task ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rules {
    /// `lbforaging` 1.0.14 and before.
    V0,
    /// `lbforaging` 1.0.15.
    V1,
    /// `lbforaging` 1.0.16 to 1.1.1.
    V2,
    /// `lbforaging` 2.0.0.
    V3,
}

impl Rules {
    pub const ALL: [Rules; 4] = [Rules::V0, Rules::V1, Rules::V2, Rules::V3];

    /// Reads `v0` to `v3`, in either case.
    pub fn parse(text: &str) -> Option<Rules> {
        Rules::ALL.into_iter().find(|rules| rules.name().eq_ignore_ascii_case(text))
    }

    pub fn name(self) -> &'static str {
        match self {
            Rules::V0 => "v0",
            Rules::V1 => "v1",
            Rules::V2 => "v2",
            Rules::V3 => "v3",
        }
    }

    /// The release these rules come from.
    pub fn source(self) -> &'static str {
        match self {
            Rules::V0 => "lbforaging up to 1.0.14",
            Rules::V1 => "lbforaging 1.0.15",
            Rules::V2 => "lbforaging 1.0.16 to 1.1.1",
            Rules::V3 => "lbforaging 2.0.0",
        }
    }

    /// Players start on the first so many cells of a side of `cells`.
    pub(super) fn spawn_cells(self, cells: u16) -> u16 {
        match self {
            // These releases omit the last row and column by mistake.
            Rules::V0 | Rules::V1 => cells - 1,
            Rules::V2 | Rules::V3 => cells,
        }
    }

    /// `M` of lbf §3: the level of every food in a cooperative task, the largest level in others.
    pub(super) fn top_food_level(self, player_levels: impl Iterator<Item = u16>) -> u16 {
        if self == Rules::V0 {
            return player_levels.sum();
        }
        let mut smallest = [0; 3];
        let mut known = 0;
        for level in player_levels {
            if known < 3 {
                smallest[known] = level;
                known += 1;
            } else if level < smallest[2] {
                smallest[2] = level;
            }
            smallest[..known].sort_unstable();
        }
        smallest[..known].iter().sum()
    }

    /// Lowest and highest food level, both included, where M is `top`.
    pub(super) fn food_levels(self, coop: bool, top: u16) -> (u16, u16) {
        match self {
            _ if coop => (top, top),
            Rules::V3 => (1, top),
            // The upper end of the draw was exclusive, unless that left no level.
            Rules::V0 | Rules::V1 | Rules::V2 => (1, (top - 1).max(1)),
        }
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
    fn the_bound_counts_the_three_weakest_players_and_all_of_them_in_v0() {
        let top = |rules: Rules, levels: &[u16]| rules.top_food_level(levels.iter().copied());
        assert_eq!(top(Rules::V3, &[2]), 2);
        assert_eq!(top(Rules::V3, &[2, 1]), 3);
        assert_eq!(top(Rules::V3, &[2, 2, 2]), 6);
        assert_eq!(top(Rules::V3, &[2, 2, 2, 1]), 5);
        assert_eq!(top(Rules::V2, &[1, 2, 1, 2, 1]), 3);
        assert_eq!(top(Rules::V1, &[2, 2, 2, 2]), 6);
        assert_eq!(top(Rules::V0, &[2, 2, 2, 2]), 8);
    }

    #[test]
    fn a_single_weak_player_gets_food_of_level_one_under_all_rules() {
        for rules in Rules::ALL {
            assert_eq!(rules.food_levels(false, 1), (1, 1));
        }
    }
}
