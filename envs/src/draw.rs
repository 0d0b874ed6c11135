//! Uniform integers. Our own code, so that the episodes of a seed do not change with a library's version.

use rand::RngCore;

/// A uniform number from `0..n` (multiply and reject, Lemire 2019). `n` is at least 1.
pub fn below(rng: &mut dyn RngCore, n: u32) -> u32 {
    let mut wide = u64::from(rng.next_u32()) * u64::from(n);
    if (wide as u32) < n {
        // The lowest 2^32 mod n remainders would occur once too often.
        let surplus = n.wrapping_neg() % n;
        while (wide as u32) < surplus {
            wide = u64::from(rng.next_u32()) * u64::from(n);
        }
    }
    (wide >> 32) as u32
}

/// A uniform number from `low..=high`.
pub fn between(rng: &mut dyn RngCore, low: u16, high: u16) -> u16 {
    debug_assert!(low <= high);
    low + below(rng, u32::from(high - low) + 1) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the listed words in order.
    struct Words(Vec<u32>);

    impl RngCore for Words {
        fn next_u32(&mut self) -> u32 {
            self.0.remove(0)
        }
        fn next_u64(&mut self) -> u64 {
            unreachable!("only 32-bit words are drawn")
        }
        fn fill_bytes(&mut self, _: &mut [u8]) {
            unreachable!("only 32-bit words are drawn")
        }
    }

    #[test]
    fn the_range_of_words_is_cut_into_equal_parts() {
        // 2^32 mod 3 = 1, so exactly the word 0 is drawn again; the rest splits 2^32 - 1 = 3 * 1431655765.
        assert_eq!(below(&mut Words(vec![0, 1]), 3), 0);
        assert_eq!(below(&mut Words(vec![1_431_655_765]), 3), 0);
        assert_eq!(below(&mut Words(vec![1_431_655_766]), 3), 1);
        assert_eq!(below(&mut Words(vec![2_863_311_530]), 3), 1);
        assert_eq!(below(&mut Words(vec![2_863_311_531]), 3), 2);
        assert_eq!(below(&mut Words(vec![u32::MAX]), 3), 2);
    }

    #[test]
    fn both_ends_are_drawn() {
        assert_eq!(between(&mut Words(vec![0, 1]), 4, 6), 4);
        assert_eq!(between(&mut Words(vec![u32::MAX]), 4, 6), 6);
        assert_eq!(between(&mut Words(vec![12345]), 5, 5), 5);
    }
}
