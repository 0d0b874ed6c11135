//! Who is near: finds the units around a point without looking at all of them.
//!
//! The map is cut into strips from left to right and into others from bottom to top, and each strip knows its units.
//! Who is near a point is in a strip near it both ways.

use super::set::Set;

/// How broad a strip is: about twice the reach at which bodies push each other.
const STRIP: f32 = 2.0;

#[derive(Debug, Clone)]
pub(super) struct Crowd {
    columns: Vec<Set>,
    rows: Vec<Set>,
}

impl Crowd {
    pub fn new(width: u32, height: u32) -> Crowd {
        let strips = |length: u32| vec![Set::default(); (length as f32 / STRIP).ceil() as usize];
        Crowd { columns: strips(width), rows: strips(height) }
    }

    /// Forgets everybody, then takes these units where they stand.
    pub fn fill(&mut self, units: impl Iterator<Item = (usize, [f32; 2])>) {
        self.columns.fill(Set::default());
        self.rows.fill(Set::default());
        for (unit, [x, y]) in units {
            let (column, row) = (strip(x, self.columns.len()), strip(y, self.rows.len()));
            self.columns[column].insert(unit);
            self.rows[row].insert(unit);
        }
    }

    /// All within `reach` of a point, and some that are farther.
    pub fn around(&self, [x, y]: [f32; 2], reach: f32) -> Set {
        let all = |strips: &[Set], at: f32| {
            let (first, last) = (strip(at - reach, strips.len()), strip(at + reach, strips.len()));
            strips[first..=last].iter().fold(Set::default(), |all, &strip| all.or(strip))
        };
        all(&self.columns, x).and(all(&self.rows, y))
    }
}

/// Units can be outside the map: they are in its outermost strip, as whoever looks for them there is.
fn strip(at: f32, strips: usize) -> usize {
    // A cast saturates, so that what is below 0 is 0.
    ((at / STRIP) as usize).min(strips - 1)
}
