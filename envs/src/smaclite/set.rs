//! Small sets of units, one bit each.

/// Most units of both sides on a map: one bit each.
pub(super) const MOST_UNITS: usize = 128;

/// A set of units by their overall number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Set(u128);

impl Set {
    pub fn insert(&mut self, unit: usize) {
        self.0 |= 1 << unit;
    }

    pub fn remove(&mut self, unit: usize) {
        self.0 &= !(1 << unit);
    }

    pub fn contains(self, unit: usize) -> bool {
        self.0 >> unit & 1 == 1
    }

    pub fn without(mut self, unit: usize) -> Set {
        self.remove(unit);
        self
    }

    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    pub fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    pub fn and(self, other: Set) -> Set {
        Set(self.0 & other.0)
    }

    pub fn minus(self, other: Set) -> Set {
        Set(self.0 & !other.0)
    }

    pub fn or(self, other: Set) -> Set {
        Set(self.0 | other.0)
    }
}

impl FromIterator<usize> for Set {
    fn from_iter<I: IntoIterator<Item = usize>>(units: I) -> Set {
        let mut set = Set::default();
        units.into_iter().for_each(|unit| set.insert(unit));
        set
    }
}

/// In the order of their numbers.
impl IntoIterator for Set {
    type Item = usize;
    type IntoIter = Units;
    fn into_iter(self) -> Units {
        Units(self.0)
    }
}

pub(super) struct Units(u128);

impl Iterator for Units {
    type Item = usize;
    fn next(&mut self) -> Option<usize> {
        if self.0 == 0 {
            return None;
        }
        let unit = self.0.trailing_zeros() as usize;
        self.0 &= self.0 - 1;
        Some(unit)
    }
}
