//! Scores of a run and statistics over seeds (algorithms §8.3).

use crate::{Curve, Point};

/// A score of several seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    pub seeds: usize,
    pub mean: f64,
    /// `None` for a single seed.
    pub standard_error: Option<f64>,
    /// Interquartile mean.
    pub iqm: f64,
}

impl Summary {
    /// `None` without values.
    pub fn of(values: &[f64]) -> Option<Self> {
        Some(Self {
            seeds: values.len(),
            mean: mean(values)?,
            standard_error: standard_error(values),
            iqm: iqm(values)?,
        })
    }
}

/// `None` without values.
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Sample standard deviation (divisor `k − 1`) over `sqrt(k)`; `None` for fewer than two values.
pub fn standard_error(values: &[f64]) -> Option<f64> {
    if values.len() < 2 {
        return None;
    }
    let k = values.len() as f64;
    let centre = mean(values)?;
    let squares: f64 = values.iter().map(|value| (value - centre).powi(2)).sum();
    Some((squares / (k - 1.0)).sqrt() / k.sqrt())
}

/// Interquartile mean: without the lowest and the highest `floor(k / 4)` values. With five seeds the best and the worst
/// are dropped, with three none. `None` without values.
pub fn iqm(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let trim = sorted.len() / 4;
    mean(&sorted[trim..sorted.len() - trim])
}

/// Centred moving average. Near the ends the mean is over those points of the window that exist.
/// A window of 0 or 1 changes nothing; an even window counts as the next odd one.
pub fn smooth(values: &[f64], window: usize) -> Vec<f64> {
    let half = window / 2;
    let around = |i: usize| {
        &values[i.saturating_sub(half)..(i.saturating_add(half).saturating_add(1)).min(values.len())]
    };
    (0..values.len()).filter_map(|i| mean(around(i))).collect()
}

/// Final performance of a run: its last test point.
pub fn final_performance(curve: &Curve) -> Option<f64> {
    curve.points.last().map(|point| point.value)
}

/// Mean of the last `count` test points (of all, if there are fewer): a less noisy end of the run.
pub fn mean_of_last(curve: &Curve, count: usize) -> Option<f64> {
    let values = values(curve);
    mean(&values[values.len().saturating_sub(count)..])
}

/// The best test point of a run.
pub fn best(curve: &Curve) -> Option<f64> {
    values(curve).into_iter().reduce(f64::max)
}

/// Area under the curve: the mean over all test points.
pub fn auc(curve: &Curve) -> Option<f64> {
    mean(&values(curve))
}

fn values(curve: &Curve) -> Vec<f64> {
    curve.points.iter().map(|point| point.value).collect()
}

/// One point of a mean over seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanPoint {
    /// Environment steps, averaged over the seeds.
    pub t_env: f64,
    pub mean: f64,
    pub standard_error: Option<f64>,
    /// Number of seeds with a value here.
    pub seeds: usize,
}

/// The mean over seeds. Every seed is smoothed by itself first (see [`smooth`]).
///
/// A test falls on the end of a round, so the test points of two seeds differ by a few steps. Where
/// the j-th points of all seeds lie within a quarter of a test interval, they are one point, at the
/// mean of their steps. Otherwise (other intervals, a missing row) the seed with the most points
/// gives the grid and the others are interpolated linearly, never beyond their ends.
///
/// Seeds may have different lengths. A point needs at least two seeds with a value (with a single curve: one), and
/// stores their number.
pub fn mean_curve(curves: &[Curve], window: usize) -> Vec<MeanPoint> {
    let smoothed: Vec<Vec<Point>> = curves
        .iter()
        .map(|curve| {
            let values = smooth(&values(curve), window);
            curve.points.iter().zip(values).map(|(point, value)| Point { value, ..*point }).collect()
        })
        .collect();
    let slack = quarter_interval(curves);
    let longest = smoothed.iter().max_by_key(|points| (points.len(), points.last().map(|p| p.t_env)));
    let Some(longest) = longest else { return Vec::new() };

    let at_index =
        |j: usize| smoothed.iter().filter_map(|points| points.get(j).copied()).collect::<Vec<Point>>();
    let by_index = (0..longest.len()).all(|j| {
        let steps = || smoothed.iter().filter_map(|points| points.get(j)).map(|point| point.t_env);
        let spread = steps().max().unwrap_or(0) - steps().min().unwrap_or(0);
        spread as f64 <= slack
    });
    let here = |j: usize| match by_index {
        true => at_index(j),
        false => {
            let t_env = longest[j].t_env;
            let value = |points: &Vec<Point>| value_at(points, t_env as f64, slack);
            smoothed.iter().filter_map(value).map(|value| Point { t_env, value }).collect()
        }
    };
    let enough = curves.len().min(2);
    (0..longest.len())
        .map(here)
        .filter(|points| points.len() >= enough)
        .filter_map(|points| mean_point(&points))
        .collect()
}

fn mean_point(points: &[Point]) -> Option<MeanPoint> {
    let values: Vec<f64> = points.iter().map(|point| point.value).collect();
    let steps: Vec<f64> = points.iter().map(|point| point.t_env as f64).collect();
    Some(MeanPoint {
        t_env: mean(&steps)?,
        mean: mean(&values)?,
        standard_error: standard_error(&values),
        seeds: points.len(),
    })
}

/// A quarter of the shortest mean interval between test points, in environment steps: test points
/// nearer than this are the same test. Infinite if no curve has two points.
pub(crate) fn quarter_interval(curves: &[Curve]) -> f64 {
    let interval = |curve: &Curve| match (curve.points.first(), curve.points.last(), curve.points.len()) {
        (Some(first), Some(last), count) if count > 1 => {
            Some((last.t_env - first.t_env) as f64 / (count - 1) as f64)
        }
        _ => None,
    };
    curves.iter().filter_map(interval).fold(f64::INFINITY, f64::min) / 4.0
}

/// The value at `t_env`, linear between test points. Up to `slack` steps outside the first and the last point their
/// values are used; `None` beyond that.
pub(crate) fn value_at(points: &[Point], t_env: f64, slack: f64) -> Option<f64> {
    let (first, last) = (points.first()?, points.last()?);
    if t_env < first.t_env as f64 - slack || t_env > last.t_env as f64 + slack {
        return None;
    }
    let after = points.partition_point(|point| (point.t_env as f64) < t_env);
    if after == 0 {
        return Some(first.value);
    }
    let left = points[after - 1];
    let Some(right) = points.get(after) else { return Some(last.value) };
    let share = (t_env - left.t_env as f64) / (right.t_env - left.t_env) as f64;
    Some(left.value + share * (right.value - left.value))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(points: &[(u64, f64)]) -> Curve {
        crate::runs::tests::curve("a", 1, points)
    }

    #[test]
    fn the_standard_error_divides_by_k_minus_one_and_by_the_root_of_k() {
        // Deviations -3, -1, 1, 3: squares 20, variance 20/3, over 4: 5/3.
        assert_eq!(standard_error(&[1.0, 3.0, 5.0, 7.0]), Some((20.0_f64 / 3.0).sqrt() / 2.0));
        assert_eq!(standard_error(&[1.0]), None);
        assert_eq!(mean(&[]), None);
    }

    #[test]
    fn of_five_seeds_the_iqm_drops_the_best_and_the_worst() {
        assert_eq!(iqm(&[100.0, 2.0, -50.0, 3.0, 4.0]), Some(3.0));
        assert_eq!(iqm(&[1.0, 2.0, 6.0]), Some(3.0));
        assert_eq!(iqm(&[0.0, 1.0, 2.0, 9.0]), Some(1.5));
        // Eight values: two at each end.
        assert_eq!(iqm(&[9.0, 8.0, 1.0, 2.0, 3.0, 5.0, -1.0, -2.0]), Some((1.0 + 2.0 + 3.0 + 5.0) / 4.0));
        assert_eq!(iqm(&[]), None);
    }

    #[test]
    fn smoothing_is_centred_and_shortens_its_window_at_the_ends() {
        let values = [0.0, 3.0, 6.0, 0.0, 1.0];
        assert_eq!(smooth(&values, 3), [1.5, 3.0, 3.0, 7.0 / 3.0, 0.5]);
        assert_eq!(smooth(&values, 2), smooth(&values, 3));
        assert_eq!(smooth(&values, 1), values);
        assert_eq!(smooth(&values, 0), values);
        assert_eq!(smooth(&values, usize::MAX), [2.0; 5]);
        assert!(smooth(&[], 5).is_empty());
    }

    #[test]
    fn the_scores_of_a_run_are_its_last_point_its_last_five_and_the_mean_of_all() {
        let run = curve(&[(0, 0.0), (10, 7.0), (20, 1.0), (30, 2.0), (40, 3.0), (50, 5.0)]);
        assert_eq!(final_performance(&run), Some(5.0));
        assert_eq!(mean_of_last(&run, 5), Some(18.0 / 5.0));
        assert_eq!(mean_of_last(&run, 50), Some(3.0));
        assert_eq!(best(&run), Some(7.0));
        assert_eq!(auc(&run), Some(3.0));
        assert_eq!(auc(&curve(&[])), None);
    }

    #[test]
    fn test_points_that_differ_by_a_few_steps_are_one_point() {
        let mean = mean_curve(&[curve(&[(10, 1.0), (102, 5.0)]), curve(&[(14, 3.0), (110, 5.0)])], 0);
        assert_eq!(
            mean,
            [
                MeanPoint { t_env: 12.0, mean: 2.0, standard_error: Some(1.0), seeds: 2 },
                MeanPoint { t_env: 106.0, mean: 5.0, standard_error: Some(0.0), seeds: 2 },
            ]
        );
    }

    #[test]
    fn seeds_with_other_test_points_are_interpolated_on_those_of_the_densest() {
        let dense = curve(&[(0, 0.0), (50, 1.0), (100, 2.0), (150, 3.0)]);
        let sparse = curve(&[(0, 4.0), (100, 8.0)]);
        let found: Vec<_> =
            mean_curve(&[sparse, dense], 0).iter().map(|p| (p.t_env, p.mean, p.seeds)).collect();
        // 150 is past the sparse curve's end, so only one seed has a value there.
        assert_eq!(found, [(0.0, 2.0, 2), (50.0, 3.5, 2), (100.0, 5.0, 2)]);
    }

    #[test]
    fn a_point_is_kept_where_at_least_two_seeds_have_got_to() {
        let seeds = [
            curve(&[(0, 1.0), (100, 1.0), (200, 1.0), (300, 9.0)]),
            curve(&[(0, 2.0), (100, 3.0), (200, 5.0)]),
            curve(&[(0, 3.0)]),
        ];
        let found: Vec<_> = mean_curve(&seeds, 0).iter().map(|p| (p.t_env, p.mean, p.seeds)).collect();
        assert_eq!(found, [(0.0, 2.0, 3), (100.0, 2.0, 2), (200.0, 3.0, 2)]);
        assert_eq!(mean_curve(&seeds[..1], 0).len(), 4);
        assert!(mean_curve(&[], 0).is_empty());
    }

    #[test]
    fn each_seed_is_smoothed_before_the_mean_is_taken() {
        let seeds = [curve(&[(0, 0.0), (10, 4.0)]), curve(&[(0, 2.0), (10, 6.0)])];
        let found: Vec<_> = mean_curve(&seeds, 3).iter().map(|p| (p.mean, p.standard_error)).collect();
        assert_eq!(found, [(3.0, Some(1.0)), (3.0, Some(1.0))]);
    }

    #[test]
    fn values_hold_for_the_slack_outside_a_curve_and_no_further() {
        let points = curve(&[(10, 1.0), (20, 3.0)]).points;
        assert_eq!(value_at(&points, 8.0, 2.0), Some(1.0));
        assert_eq!(value_at(&points, 7.9, 2.0), None);
        assert_eq!(value_at(&points, 10.0, 0.0), Some(1.0));
        assert_eq!(value_at(&points, 15.0, 0.0), Some(2.0));
        assert_eq!(value_at(&points, 22.0, 2.0), Some(3.0));
        assert_eq!(value_at(&points, 22.1, 2.0), None);
    }
}
