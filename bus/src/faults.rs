//! Seeded faults for the in-memory bus: publications that are lost, duplicated or overtaken.

/// Probability of each fault, per publication. What happens to the `n`-th publication on a key is a function of the
/// seed, the key and `n`, and does not depend on threads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Faults {
    pub(crate) seed: u64,
    /// Probabilities. If they sum to more than 1, the later ones are reduced.
    pub(crate) loss: f64,
    pub(crate) duplicate: f64,
    pub(crate) reorder: f64,
}

/// What happens to one publication.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fate {
    Deliver,
    Lose,
    Duplicate,
    /// Delivered after the next publication that reaches the same subscriber.
    Overtaken,
}

impl Faults {
    pub(crate) fn fate(&self, key: &str, n: u64) -> Fate {
        let of_key = key.bytes().fold(self.seed, |hash, byte| mix(hash ^ u64::from(byte)));
        // The upper 53 bits as a number in [0, 1).
        let draw = (mix(of_key ^ mix(n)) >> 11) as f64 / (1u64 << 53) as f64;
        if draw < self.loss {
            Fate::Lose
        } else if draw < self.loss + self.duplicate {
            Fate::Duplicate
        } else if draw < self.loss + self.duplicate + self.reorder {
            Fate::Overtaken
        } else {
            Fate::Deliver
        }
    }
}

/// One step of SplitMix64 (Steele, Lea and Flood 2014): spreads any input over all bits.
fn mix(input: u64) -> u64 {
    let mut z = input.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mix_agrees_with_published_values_of_splitmix64() {
        // The first two outputs of the generator started at 1234567.
        assert_eq!(mix(1_234_567), 6_457_827_717_110_365_317);
        assert_eq!(mix(1_234_567u64.wrapping_add(0x9e37_79b9_7f4a_7c15)), 3_203_168_211_198_807_973);
    }

    #[test]
    fn fates_come_as_often_as_asked_and_again_the_same() {
        let faults = Faults { seed: 7, loss: 0.1, duplicate: 0.2, reorder: 0.3 };
        let fates: Vec<_> = (0..10_000).map(|n| faults.fate("a/b", n)).collect();
        assert_eq!(fates, (0..10_000).map(|n| faults.fate("a/b", n)).collect::<Vec<_>>());
        let share = |fate| fates.iter().filter(|&&f| f == fate).count() as f64 / 10_000.0;
        assert!((share(Fate::Lose) - 0.1).abs() < 0.02);
        assert!((share(Fate::Duplicate) - 0.2).abs() < 0.02);
        assert!((share(Fate::Overtaken) - 0.3).abs() < 0.02);
        assert!((share(Fate::Deliver) - 0.4).abs() < 0.02);
        assert_ne!(fates, (0..10_000).map(|n| faults.fate("a/c", n)).collect::<Vec<_>>());
    }
}
