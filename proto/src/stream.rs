//! Random streams by name: each has an owner and a purpose, and is derived from the seed alone.
//!
//! Streams with different names are independent for all practical purposes, so a new stream does not change what the
//! others draw. Streams are short-lived, one for each round or update call, so that no checkpoint holds a state.

use rand_chacha::rand_core::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Separates these keys from every other use of the hash. A change of it changes every result.
const CONTEXT: &str = "rondo 2026 random stream v1";

/// The stream named by `owner`, `purpose` and `index` of the experiment with this `seed`.
///
/// `owner` is who draws (`agent/0`, `world`, `team`), `purpose` what is drawn (`initial-weights`, `replay`), and
/// `index` numbers streams of one kind, for instance by round and environment copy.
///
/// The ChaCha8 key is BLAKE3 in its key derivation mode over: the seed, the length of `owner` and its UTF-8, the
/// length of `purpose` and its UTF-8, the values of `index`; all numbers as little-endian u64. The lengths keep
/// (`ab`, `c`) and (`a`, `bc`) different.
pub fn stream(seed: u64, owner: &str, purpose: &str, index: &[u64]) -> ChaCha8Rng {
    let mut hasher = blake3::Hasher::new_derive_key(CONTEXT);
    hasher.update(&seed.to_le_bytes());
    for name in [owner, purpose] {
        hasher.update(&(name.len() as u64).to_le_bytes());
        hasher.update(name.as_bytes());
    }
    for value in index {
        hasher.update(&value.to_le_bytes());
    }
    ChaCha8Rng::from_seed(*hasher.finalize().as_bytes())
}

#[cfg(test)]
mod tests {
    use super::stream;
    use rand_chacha::rand_core::RngCore;

    fn first_two(seed: u64, owner: &str, purpose: &str, index: &[u64]) -> [u64; 2] {
        let mut rng = stream(seed, owner, purpose, index);
        [rng.next_u64(), rng.next_u64()]
    }

    #[test]
    fn the_first_draws_of_a_named_stream_never_change() {
        assert_eq!(first_two(1, "agent-0", "actions", &[]), [17878479529785437639, 9545311159646729274]);
        assert_eq!(first_two(1, "world", "copy", &[3]), [14032520055505336418, 5656420132505767079]);
    }

    #[test]
    fn every_part_of_the_name_makes_another_stream() {
        let names: [(u64, &str, &str, &[u64]); 9] = [
            (1, "ab", "c", &[]),
            (2, "ab", "c", &[]),
            (1, "a", "bc", &[]),
            (1, "abc", "", &[]),
            (1, "c", "ab", &[]),
            (1, "ab", "c", &[0]),
            (1, "ab", "c", &[1]),
            (1, "ab", "c", &[0, 0]),
            (1, "ab", "c\0\0\0\0\0\0\0\0", &[]),
        ];
        let draws = names.map(|(seed, owner, purpose, index)| first_two(seed, owner, purpose, index));
        for (i, a) in draws.iter().enumerate() {
            assert!(!draws[..i].contains(a), "{:?} repeats an earlier stream", names[i]);
        }
    }
}
