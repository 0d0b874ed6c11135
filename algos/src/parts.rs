//! Splits a batch into parts that go through the networks one after another. The memory for activations is that of
//! one part, for any number of episodes, and stays in the cache.

use std::ops::Range;

use crate::network::Kind;

/// Most rows in a part of a feed-forward batch, unless one episode has more. The data of both passes then fits the
/// second-level cache.
const ROWS: usize = 512;

/// Most episodes in a part of a recurrent batch: enough rows in one time step for fast products.
const EPISODES: usize = 16;

/// Most rows in a part for a GPU, unless one episode has more: enough to keep it busy, and about a gigabyte of
/// activations with networks 128 wide.
const ROWS_ON_GPU: usize = 65_536;

/// What the size of a part is chosen for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum PartSize {
    /// A processor's cache.
    #[default]
    Cache,
    /// A GPU and its memory.
    Gpu,
}

/// The ranges of episodes of each part, where `rows` are the rows of each episode. Depends on nothing else, because
/// the parts determine the order of summation.
pub(crate) fn parts(kind: Kind, rows: &[usize], size: PartSize) -> Vec<Range<usize>> {
    let fits = |part: &Range<usize>, next: usize| {
        let rows_with_next = || rows[part.start..=next].iter().sum::<usize>();
        match (size, kind) {
            (PartSize::Cache, Kind::Fc) => rows_with_next() <= ROWS,
            (PartSize::Cache, Kind::Gru) => part.len() < EPISODES,
            (PartSize::Gpu, _) => rows_with_next() <= ROWS_ON_GPU,
        }
    };
    let mut parts: Vec<Range<usize>> = Vec::new();
    for next in 0..rows.len() {
        match parts.last_mut() {
            Some(part) if fits(part, next) => part.end = next + 1,
            _ => parts.push(next..next + 1),
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn feed_forward_parts_are_cut_by_rows_and_recurrent_ones_by_episodes() {
        assert_eq!(parts(Kind::Fc, &[300, 200, 12, 1], PartSize::Cache), [0..3, 3..4]);
        assert_eq!(parts(Kind::Fc, &[5000, 500, 13], PartSize::Cache), [0..1, 1..2, 2..3]);
        assert_eq!(parts(Kind::Gru, &[900; 33], PartSize::Cache), [0..16, 16..32, 32..33]);
        assert!(parts(Kind::Gru, &[], PartSize::Cache).is_empty());
    }

    #[test]
    fn parts_for_a_gpu_are_large_for_both_kinds() {
        for kind in [Kind::Fc, Kind::Gru] {
            assert_eq!(parts(kind, &[50; 1311], PartSize::Gpu), [0..1310, 1310..1311]);
            assert_eq!(parts(kind, &[65_000, 536, 1, 70_000, 2], PartSize::Gpu), [0..2, 2..3, 3..4, 4..5]);
        }
    }
}
