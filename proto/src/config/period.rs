//! The length of a period of the schedule: a number, or infinite.

use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// The switching period `s` of algorithms §6.2. In files a whole number or `"inf"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Period {
    /// The pattern moves on by one agent after this many steps; [`super::SwitchUnit`] is their unit.
    Every(u64),
    /// The pattern never moves: fixed two-timescale learning.
    Infinite,
}

/// The text is not a period.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("period `{0}`: expected a whole number from 1, or `inf`")]
pub struct PeriodError(String);

const INFINITE: &str = "inf";

impl fmt::Display for Period {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Every(steps) => steps.fmt(f),
            Self::Infinite => f.write_str(INFINITE),
        }
    }
}

impl FromStr for Period {
    type Err = PeriodError;

    fn from_str(text: &str) -> Result<Self, PeriodError> {
        match text.parse() {
            _ if text == INFINITE => Ok(Self::Infinite),
            Ok(steps) if steps > 0 => Ok(Self::Every(steps)),
            _ => Err(PeriodError(text.to_owned())),
        }
    }
}

impl Serialize for Period {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Every(steps) => serializer.serialize_u64(*steps),
            Self::Infinite => serializer.serialize_str(INFINITE),
        }
    }
}

impl<'de> Deserialize<'de> for Period {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NumberOrInf;

        impl Visitor<'_> for NumberOrInf {
            type Value = Period;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a whole number from 1, or \"inf\"")
            }

            fn visit_u64<E: Error>(self, steps: u64) -> Result<Period, E> {
                Ok(Period::Every(steps))
            }

            fn visit_i64<E: Error>(self, steps: i64) -> Result<Period, E> {
                let unexpected = serde::de::Unexpected::Signed(steps);
                u64::try_from(steps).map(Period::Every).map_err(|_| E::invalid_value(unexpected, &self))
            }

            /// TOML's own `inf`, without quotes, means the same.
            fn visit_f64<E: Error>(self, steps: f64) -> Result<Period, E> {
                if steps == f64::INFINITY {
                    return Ok(Period::Infinite);
                }
                Err(E::invalid_value(serde::de::Unexpected::Float(steps), &self))
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Period, E> {
                text.parse().map_err(E::custom)
            }
        }

        deserializer.deserialize_any(NumberOrInf)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Holder {
        period: Period,
    }

    fn read(text: &str) -> Result<Period, String> {
        toml::from_str::<Holder>(text).map(|holder| holder.period).map_err(|error| error.message().to_owned())
    }

    #[test]
    fn a_period_is_a_number_or_inf() {
        assert_eq!(read("period = 100"), Ok(Period::Every(100)));
        assert_eq!(read("period = \"inf\""), Ok(Period::Infinite));
        assert_eq!(read("period = inf"), Ok(Period::Infinite));
        assert_eq!(read("period = \"100\""), Ok(Period::Every(100)));
        let expected = "expected a whole number from 1, or \"inf\"";
        for (text, found) in
            [("-1", "integer `-1`"), ("1.5", "floating point `1.5`"), ("-inf", "floating point `-inf`")]
        {
            assert_eq!(read(&format!("period = {text}")), Err(format!("invalid value: {found}, {expected}")));
        }
        assert_eq!(
            read("period = \"never\""),
            Err("period `never`: expected a whole number from 1, or `inf`".to_owned())
        );
    }

    #[test]
    fn a_period_is_written_as_it_is_read() {
        for (period, text) in
            [(Period::Every(10_000), "period = 10000\n"), (Period::Infinite, "period = \"inf\"\n")]
        {
            assert_eq!(toml::to_string(&Holder { period }).unwrap(), text);
            assert_eq!(read(text), Ok(period));
            assert_eq!(period.to_string().parse(), Ok(period));
        }
        assert_eq!("0".parse::<Period>(), Err(PeriodError("0".to_owned())));
    }
}
