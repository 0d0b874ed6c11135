//! A batch in parts that go through the networks one after the other, so that memory for activations is that of
//! one part however many episodes there are, and stays in the cache.

use std::ops::Range;

use crate::network::Kind;

/// A part of a feed-forward batch has no more rows, unless a single episode has: what both passes then touch
/// fits the second-level cache.
const ROWS: usize = 512;

/// A part of a recurrent batch has no more episodes: enough rows of one time step for fast products.
const EPISODES: usize = 16;

/// Which of the episodes that have `rows` rows each, in this order, make up each part. Depends on nothing else,
/// because the parts fix the order of summation.
pub(crate) fn parts(kind: Kind, rows: &[usize]) -> Vec<Range<usize>> {
    let fits = |part: &Range<usize>, next: usize| match kind {
        Kind::Fc => rows[part.clone()].iter().sum::<usize>() + rows[next] <= ROWS,
        Kind::Gru => part.len() < EPISODES,
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
        assert_eq!(parts(Kind::Fc, &[300, 200, 12, 1]), [0..3, 3..4]);
        assert_eq!(parts(Kind::Fc, &[5000, 500, 13]), [0..1, 1..2, 2..3]);
        assert_eq!(parts(Kind::Gru, &[900; 33]), [0..16, 16..32, 32..33]);
        assert!(parts(Kind::Gru, &[]).is_empty());
    }
}
