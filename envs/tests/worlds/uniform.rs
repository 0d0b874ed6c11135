//! Whether values fall evenly.
//!
//! A chi-square statistic is compared with its quantile for p = 1e-4, so a right implementation fails one such
//! comparison in 10,000 if the seed were drawn anew; with fixed seeds the outcome never changes.

use std::collections::BTreeMap;

/// The upper 1e-4 quantile of chi-square (Wilson and Hilferty; off by less than 1 % for 1 degree and more).
pub fn quantile(degrees: usize) -> f64 {
    const Z: f64 = 3.719;
    let v = 2.0 / (9.0 * degrees as f64);
    degrees as f64 * (1.0 - v + Z * v.sqrt()).powi(3)
}

/// Whether the values fall evenly on all of `support`, and nowhere else.
pub fn assert_uniform<T: Ord + std::fmt::Debug + Copy>(
    what: &str,
    support: impl Iterator<Item = T>,
    values: impl Iterator<Item = T>,
) {
    let mut counts: BTreeMap<T, u32> = support.map(|value| (value, 0)).collect();
    let mut total = 0;
    for value in values {
        *counts.get_mut(&value).unwrap_or_else(|| panic!("{what}: {value:?} must not occur")) += 1;
        total += 1;
    }
    if counts.len() == 1 {
        return;
    }
    let expected = f64::from(total) / counts.len() as f64;
    assert!(expected >= 5.0, "{what}: too few values for this test");
    let statistic: f64 = counts.values().map(|&n| (f64::from(n) - expected).powi(2) / expected).sum();
    let most = quantile(counts.len() - 1);
    assert!(statistic < most, "{what}: chi-square {statistic:.1}, expected below {most:.1}: {counts:?}");
}

#[test]
fn the_test_of_uniformity_notices_a_slight_bias() {
    let biased = (0..20_000).map(|k| if k % 25 == 0 { 0 } else { k % 6 });
    let outcome = std::panic::catch_unwind(|| assert_uniform("biased die", 0..6, biased));
    assert!(outcome.is_err());
    assert_uniform("fair die", 0..6, (0..20_000).map(|k| k % 6));
}
