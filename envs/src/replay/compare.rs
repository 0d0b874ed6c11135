//! Compares recorded values with computed ones, counts differences and stores the first.

use std::fmt::Debug;

use super::Mismatch;

/// The differences so far, and the present place in the trace.
#[derive(Clone, Default)]
pub(super) struct Findings {
    pub line: u64,
    pub episode: u64,
    pub t: u64,
    pub mismatches: u64,
    pub first: Option<Mismatch>,
}

/// Equality of traces: floats in every bit.
pub(super) trait Same: Debug {
    fn same(&self, other: &Self) -> bool;
}

impl Same for f32 {
    fn same(&self, other: &f32) -> bool {
        self.to_bits() == other.to_bits()
    }
}

impl Same for f64 {
    fn same(&self, other: &f64) -> bool {
        self.to_bits() == other.to_bits()
    }
}

macro_rules! same_by_eq {
    ($($t:ty),*) => { $(impl Same for $t {
        fn same(&self, other: &$t) -> bool {
            self == other
        }
    })* };
}
same_by_eq!(bool, u8, u16, u32);

impl Findings {
    pub fn value<T: Same>(&mut self, field: &str, expected: &T, found: &T) {
        if !expected.same(found) {
            self.differs(|| field.to_owned(), expected, found);
        }
    }

    /// Two lists of one length, which the reader of the record has checked.
    pub fn list<T: Same>(&mut self, field: &str, expected: &[T], found: &[T]) {
        debug_assert_eq!(expected.len(), found.len());
        for (k, (expected, found)) in expected.iter().zip(found).enumerate() {
            if !expected.same(found) {
                self.differs(|| format!("{field}[{k}]"), expected, found);
            }
        }
    }

    /// Doubles that may differ by `tolerance`: absolute for small numbers, else relative to their size.
    pub fn near(&mut self, field: &str, expected: &[f64], found: &[f64], tolerance: f64) {
        debug_assert_eq!(expected.len(), found.len());
        for (k, (expected, found)) in expected.iter().zip(found).enumerate() {
            // NaN is near to nothing.
            let near = (expected - found).abs() <= tolerance * expected.abs().max(1.0);
            if !near {
                self.differs(|| format!("{field}[{k}]"), expected, found);
            }
        }
    }

    /// Numbers that may differ by `tolerance`, however large they are.
    pub fn within(&mut self, field: &str, expected: &[f64], found: &[f64], tolerance: f64) {
        debug_assert_eq!(expected.len(), found.len());
        for (k, (expected, found)) in expected.iter().zip(found).enumerate() {
            let near = (expected - found).abs() <= tolerance;
            if !near {
                self.differs(|| format!("{field}[{k}]"), expected, found);
            }
        }
    }

    /// Two values that are compared as a whole.
    pub fn whole<T: PartialEq + Debug>(&mut self, field: impl Fn() -> String, expected: &T, found: &T) {
        if expected != found {
            self.differs(field, expected, found);
        }
    }

    /// Takes in what was found elsewhere.
    pub fn add(&mut self, other: Findings) {
        self.mismatches += other.mismatches;
        self.first = self.first.take().or(other.first);
    }

    fn differs(&mut self, field: impl Fn() -> String, expected: &dyn Debug, found: &dyn Debug) {
        self.mismatches += 1;
        if self.first.is_none() {
            self.first = Some(Mismatch {
                line: self.line,
                episode: self.episode,
                t: self.t,
                field: field(),
                expected: format!("{expected:?}"),
                found: format!("{found:?}"),
            });
        }
    }
}
