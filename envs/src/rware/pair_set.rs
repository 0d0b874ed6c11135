//! CPython's iteration order of a set of coordinate pairs, which decides some ties (rware §5.3).
//!
//! A set is an open hash table that is read slot by slot, so the order follows from the members' hashes and the order
//! of insertion. Members are never removed here.

use super::traffic::MAX_CELLS;

/// Slots of a new table.
const SMALLEST: usize = 8;
/// Room for [`MAX_CELLS`] / 2 members by the rule of growth; no tie needs more.
const LARGEST: usize = 128;
const _: () = assert!(MAX_CELLS / 2 * 5 < (LARGEST - 1) * 3);
/// Slots after the first that are tried before the next jump, if the table has so many.
const RUN: usize = 9;

/// A set of pairs `(x, y)`.
#[derive(Debug)]
pub(super) struct PairSet {
    slots: [Option<(u16, u16)>; LARGEST],
    size: usize,
    members: usize,
}

impl PairSet {
    /// Inserts the pairs in order.
    pub fn of(pairs: impl Iterator<Item = (u16, u16)>) -> PairSet {
        let mut set = PairSet { slots: [None; LARGEST], size: SMALLEST, members: 0 };
        for pair in pairs {
            set.insert(pair);
        }
        set
    }

    /// The pairs in CPython's order.
    pub fn iter(&self) -> impl Iterator<Item = (u16, u16)> + '_ {
        self.slots[..self.size].iter().flatten().copied()
    }

    fn insert(&mut self, pair: (u16, u16)) {
        let slot = self.slot_for(pair);
        if self.slots[slot].replace(pair).is_some() {
            return;
        }
        self.members += 1;
        if self.members * 5 >= (self.size - 1) * 3 {
            self.grow();
        }
    }

    /// Grows to more than four times the members, which are inserted again in slot order.
    fn grow(&mut self) {
        let old = std::mem::replace(&mut self.slots, [None; LARGEST]);
        while self.size <= 4 * self.members {
            self.size *= 2;
        }
        for pair in old.into_iter().flatten() {
            let slot = self.slot_for(pair);
            self.slots[slot] = Some(pair);
        }
    }

    /// The slot of the pair, or the free slot for it.
    fn slot_for(&self, pair: (u16, u16)) -> usize {
        let hash = hash(pair);
        let mask = self.size as u64 - 1;
        let (mut start, mut perturb) = (hash & mask, hash);
        loop {
            let first = start as usize;
            let last = if first + RUN < self.size { first + RUN } else { first };
            let fits = |&slot: &usize| self.slots[slot].is_none_or(|other| other == pair);
            if let Some(slot) = (first..=last).find(fits) {
                return slot;
            }
            perturb >>= 5;
            start = start.wrapping_mul(5).wrapping_add(1).wrapping_add(perturb) & mask;
        }
    }
}

/// CPython's hash of a tuple of two small integers, which hash to themselves.
fn hash((x, y): (u16, u16)) -> u64 {
    const PRIME_1: u64 = 11_400_714_785_074_694_791;
    const PRIME_2: u64 = 14_029_467_366_897_019_727;
    const PRIME_5: u64 = 2_870_177_450_012_600_261;
    let mix = |acc: u64, item: u16| {
        let acc = acc.wrapping_add(u64::from(item).wrapping_mul(PRIME_2));
        acc.rotate_left(31).wrapping_mul(PRIME_1)
    };
    let hash = mix(mix(PRIME_5, x), y).wrapping_add(2 ^ PRIME_5 ^ 3_527_539);
    // CPython keeps -1 for errors.
    if hash == u64::MAX {
        1_546_275_796
    } else {
        hash
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Members in order of insertion, and in CPython 3.11's order.
    type Listed<'a> = (&'a [(u16, u16)], &'a [(u16, u16)]);

    const SETS: [Listed; 4] = [
        (&[(7, 2), (2, 10), (8, 6)], &[(2, 10), (7, 2), (8, 6)]),
        // The fifth member makes the table grow.
        (&[(4, 11), (8, 16), (9, 9), (8, 6), (6, 15)], &[(6, 15), (9, 9), (8, 16), (8, 6), (4, 11)]),
        (
            &[(0, 14), (14, 24), (8, 6), (13, 20), (4, 11), (11, 13), (0, 26), (15, 26)],
            &[(14, 24), (0, 26), (13, 20), (11, 13), (15, 26), (8, 6), (4, 11), (0, 14)],
        ),
        // Grown twice.
        (
            &[
                (2, 22),
                (1, 28),
                (6, 16),
                (8, 8),
                (15, 9),
                (4, 10),
                (6, 20),
                (9, 17),
                (1, 23),
                (10, 3),
                (4, 11),
                (0, 6),
                (12, 26),
                (3, 23),
                (7, 5),
                (4, 27),
                (3, 6),
                (13, 15),
                (6, 25),
                (2, 23),
            ],
            &[
                (1, 28),
                (10, 3),
                (4, 27),
                (9, 17),
                (2, 23),
                (6, 20),
                (3, 6),
                (4, 11),
                (8, 8),
                (1, 23),
                (13, 15),
                (2, 22),
                (6, 16),
                (6, 25),
                (4, 10),
                (12, 26),
                (3, 23),
                (0, 6),
                (15, 9),
                (7, 5),
            ],
        ),
    ];

    #[test]
    fn sets_are_listed_as_by_cpython() {
        for (members, listed) in SETS {
            let found: Vec<_> = PairSet::of(members.iter().copied()).iter().collect();
            assert_eq!(found, listed);
        }
    }

    #[test]
    fn a_member_that_comes_again_changes_nothing() {
        let (members, listed) = SETS[1];
        let twice = members.iter().flat_map(|&pair| [pair, members[0], pair]);
        assert_eq!(PairSet::of(twice).iter().collect::<Vec<_>>(), listed);
    }

    #[test]
    fn hashes_are_those_of_cpython() {
        assert_eq!(hash((0, 0)), 9_988_604_870_027_030_631);
        assert_eq!(hash((9, 10)), 4_001_662_073_422_813_760);
    }
}
