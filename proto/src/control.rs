//! The rare messages: joining, the schedule, progress and metrics.
//!
//! [`crate::codec`] encodes them by position, so a change of a struct here needs a new wire version.

mod join;
mod schedule;

pub use join::{Join, Refusal, Seat, Welcome};
pub use schedule::{Progress, Rates, RatesQuery};

use crate::codec::Message;
use serde::{Deserialize, Serialize};

/// Scalars for a live display: one row of a metrics file.
///
/// - key: `agent/{i}/metrics` or `world/metrics`
/// - from agent i or the env-server to monitors, best effort
/// - if lost: nothing happens; the files in the run folder are the record
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Environment steps counted so far.
    pub t_env: u64,
    /// Update calls that the agent has completed. The env-server counts no update calls and sends training rounds.
    pub update_calls: u64,
    /// Names and values; a value may be infinite or not a number, because learning can diverge.
    pub scalars: Vec<(String, f64)>,
}

impl Message for Metrics {
    const TAG: u8 = 8;
    const NAME: &'static str = "Metrics";
    const MAX_BYTES: usize = 4096;

    fn check(&self) -> Result<(), String> {
        if self.scalars.iter().any(|(name, _)| name.is_empty()) {
            return Err("a scalar has an empty name".to_owned());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::{decode, encode, WireError, WIRE_VERSION};

    fn metrics(scalars: usize) -> Metrics {
        let scalars = (0..scalars).map(|i| (format!("scalar_{i:04}"), i as f64)).collect();
        Metrics { t_env: 20_000_000, update_calls: 40_000, scalars }
    }

    #[test]
    fn metrics_of_any_value_come_back_bit_for_bit() {
        let mut sent = metrics(3);
        sent.scalars[0].1 = f64::NAN;
        sent.scalars[1].1 = -0.0;
        let received: Metrics = decode(&encode(&sent).unwrap()).unwrap();
        let bits = |m: &Metrics| m.scalars.iter().map(|(n, x)| (n.clone(), x.to_bits())).collect::<Vec<_>>();
        assert_eq!(bits(&received), bits(&sent));
        assert_eq!((received.t_env, received.update_calls), (20_000_000, 40_000));
    }

    #[test]
    fn the_fullest_permitted_metrics_pass_and_one_more_scalar_does_not() {
        // Frame 2, two counters of 5 and 3 bytes, length of the list 1; each scalar takes 1 + 11 + 8.
        let most = (Metrics::MAX_BYTES - 11) / 20;
        let bytes = encode(&metrics(most)).unwrap();
        assert_eq!(bytes.len(), 11 + 20 * most);
        assert_eq!(decode::<Metrics>(&bytes), Ok(metrics(most)));
        assert_eq!(
            encode(&metrics(most + 1)),
            Err(WireError::TooLong { name: "Metrics", limit: 4096, found: 11 + 20 * (most + 1) })
        );
    }

    #[test]
    fn many_short_scalars_do_not_run_into_the_decoders_own_limit() {
        let scalars = vec![("x".to_owned(), 0.5); 400];
        let sent = Metrics { t_env: 0, update_calls: 0, scalars };
        assert_eq!(decode(&encode(&sent).unwrap()), Ok(sent));
    }

    #[test]
    fn scalars_without_a_name_are_refused() {
        let nameless = Metrics { scalars: vec![(String::new(), 1.0)], ..metrics(0) };
        assert_eq!(encode(&nameless).unwrap_err().to_string(), "Metrics message: a scalar has an empty name");
    }

    #[test]
    fn hostile_lengths_are_refused() {
        // Two counters of zero, then a list of 2^64 - 1 scalars; or one scalar whose name is that long.
        let length = [253, 255, 255, 255, 255, 255, 255, 255, 255];
        let list = [&[WIRE_VERSION, 8, 0, 0][..], &length].concat();
        let name = [&[WIRE_VERSION, 8, 0, 0, 1][..], &length].concat();
        let huge_list = [&list[..], &[1; 2000]].concat();
        // A list is refused when its elements end, a text by its length alone.
        for (bytes, text) in [
            (list, "Metrics message of 13 bytes is cut off: expected at least 14"),
            (huge_list, "Metrics message of 2013 bytes is cut off: expected at least 2014"),
            (name, "Metrics message of 14 bytes: a length in it is larger than such a message can be"),
        ] {
            assert_eq!(decode::<Metrics>(&bytes).unwrap_err().to_string(), text);
        }
    }

    #[test]
    fn leftover_and_overlong_bytes_are_refused() {
        let mut bytes = encode(&metrics(1)).unwrap();
        bytes.push(0);
        assert_eq!(decode::<Metrics>(&bytes), Err(WireError::Trailing { name: "Metrics", extra: 1 }));
        bytes.resize(4097, 0);
        assert_eq!(
            decode::<Metrics>(&bytes),
            Err(WireError::TooLong { name: "Metrics", limit: 4096, found: 4097 })
        );
    }
}
