//! Our curves against a reference's: test point by test point, and over the whole.

use std::fmt;

use crate::meaning::{differences, mixture, Difference};
use crate::stats::{mean, mean_curve, quarter_interval, value_at, Summary};
use crate::Curve;

/// Both sides at the reference's test points. [`fmt::Display`] prints it as a table and a verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    pub rows: Vec<Row>,
    /// The mean of each seed over those test points that all seeds of both sides reach; a seed
    /// weighs as one sample. `None` if there is no such point.
    pub overall: Option<Overall>,
    /// Differences between the sides that change the meaning of their numbers.
    pub differences: Vec<Difference>,
    /// Differences among the runs of our side, and among those of the reference's.
    pub mixtures: [Vec<Difference>; 2],
    our_label: String,
    reference_label: String,
}

/// One test point of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Environment steps, averaged over the reference's seeds.
    pub t_env: f64,
    /// `None` if no seed of ours reaches this point.
    pub ours: Option<Summary>,
    pub reference: Summary,
}

/// Both sides over all common test points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overall {
    pub ours: Summary,
    pub reference: Summary,
    pub test_points: usize,
}

impl Row {
    /// Whether ours keeps up here, by the rule of [`keeps_up`]; `None` where ours has no value.
    pub fn keeps_up(&self) -> Option<bool> {
        self.ours.map(|ours| keeps_up(&ours, &self.reference))
    }
}

impl Overall {
    /// Whether ours keeps up over the whole, by the rule of [`keeps_up`].
    pub fn keeps_up(&self) -> bool {
        keeps_up(&self.ours, &self.reference)
    }
}

/// Ours keeps up if its mean is at least the reference's mean minus one standard error of the
/// difference, `sqrt(se_ours² + se_reference²)`. A side with one seed has no standard error and
/// adds nothing. Noise and few seeds widen this margin. With many seeds, a learner as good as the reference fails by
/// chance in one case of six, with two or three seeds more often. The verdict is over all test points; single rows
/// may differ from it.
pub fn keeps_up(ours: &Summary, reference: &Summary) -> bool {
    let square = |side: &Summary| side.standard_error.unwrap_or(0.0).powi(2);
    ours.mean >= reference.mean - (square(ours) + square(reference)).sqrt()
}

/// Compares at each test point of the reference's mean over seeds (see [`mean_curve`]).
///
/// Each seed of either side is interpolated linearly between its own test points; at its ends the
/// end's value holds for another quarter of a test interval.
pub fn compare(ours: &[Curve], reference: &[Curve]) -> Comparison {
    let slack = quarter_interval(ours).min(quarter_interval(reference));
    let at = |curves: &[Curve], t_env: f64| -> Vec<f64> {
        curves.iter().filter_map(|curve| value_at(&curve.points, t_env, slack)).collect()
    };
    let grid: Vec<f64> = mean_curve(reference, 0).iter().map(|point| point.t_env).collect();
    let row = |t_env: &f64| {
        let reference = Summary::of(&at(reference, *t_env))?;
        Some(Row { t_env: *t_env, ours: Summary::of(&at(ours, *t_env)), reference })
    };
    let rows = grid.iter().filter_map(row).collect();

    let common: Vec<f64> = grid
        .into_iter()
        .filter(|t_env| {
            at(ours, *t_env).len() == ours.len() && at(reference, *t_env).len() == reference.len()
        })
        .collect();
    let averages = |curves: &[Curve]| {
        let average = |curve: &Curve| {
            let values: Vec<f64> =
                common.iter().filter_map(|t_env| value_at(&curve.points, *t_env, slack)).collect();
            mean(&values)
        };
        Summary::of(&curves.iter().filter_map(average).collect::<Vec<f64>>())
    };
    let overall = match (averages(ours), averages(reference)) {
        (Some(ours), Some(reference)) => Some(Overall { ours, reference, test_points: common.len() }),
        _ => None,
    };
    Comparison {
        rows,
        overall,
        differences: differences(ours.iter().chain(reference)),
        mixtures: [mixture(ours), mixture(reference)],
        our_label: labels(ours),
        reference_label: labels(reference),
    }
}

fn labels(curves: &[Curve]) -> String {
    let mut labels: Vec<&str> = curves.iter().map(|curve| curve.label.as_str()).collect();
    labels.sort_unstable();
    labels.dedup();
    match labels.is_empty() {
        true => "no run".to_owned(),
        false => labels.join("; "),
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.differences.is_empty() {
            writeln!(
                f,
                "warning: the numbers of these runs do not have the same meaning: {}",
                list(&self.differences)
            )?;
        }
        for (side, mixture) in ["ours", "reference"].into_iter().zip(&self.mixtures) {
            if !mixture.is_empty() {
                writeln!(f, "warning: {side} mixes different experiments:  {}", list(mixture))?;
            }
        }
        writeln!(f, "ours:      {}", self.our_label)?;
        writeln!(f, "reference: {}", self.reference_label)?;
        writeln!(
            f,
            "mean ± standard error (seeds); yes: ours >= reference - one standard error of the difference"
        )?;
        writeln!(f)?;
        writeln!(f, "{:>10}  {:>24}  {:>24}  keeps up", "t_env", "ours", "reference")?;
        for row in &self.rows {
            let ours = row.ours.map_or("-".to_owned(), |ours| cell(&ours));
            let answer = row.keeps_up().map_or("-", |yes| if yes { "yes" } else { "no" });
            writeln!(f, "{:>10.0}  {:>24}  {:>24}  {answer}", row.t_env, ours, cell(&row.reference))?;
        }
        writeln!(f)?;
        if self.differences.iter().any(Difference::is_of_scale) {
            return write!(f, "verdict: none, the numbers do not have the same meaning (see the first line)");
        }
        let Some(overall) = &self.overall else {
            return write!(
                f,
                "verdict: nothing to compare, no test point is reached by all seeds of both sides"
            );
        };
        let single = self.rows.iter().filter(|row| row.keeps_up() == Some(true)).count();
        let compared = self.rows.iter().filter(|row| row.ours.is_some()).count();
        write!(
            f,
            "verdict: {} the reference, {} against {} over the {} test points that all seeds reach \
             ({single} of {compared} test points by themselves)",
            if overall.keeps_up() { "keeps up with" } else { "falls behind" },
            cell(&overall.ours),
            cell(&overall.reference),
            overall.test_points,
        )
    }
}

fn list(differences: &[Difference]) -> String {
    differences.iter().map(Difference::to_string).collect::<Vec<_>>().join(", ")
}

fn cell(side: &Summary) -> String {
    let error = side.standard_error.map_or("?".to_owned(), |error| format!("{error:.4}"));
    format!("{:.4} ± {error} ({})", side.mean, side.seeds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runs::tests::curve;

    fn reference() -> Vec<Curve> {
        vec![
            curve("reference", 1, &[(0, 0.0), (100, 2.0), (200, 4.0)]),
            curve("reference", 2, &[(0, 0.0), (100, 4.0), (200, 8.0)]),
        ]
    }

    #[test]
    fn ours_may_be_one_standard_error_of_the_difference_below_and_no_more() {
        let summary = |mean, standard_error| Summary { seeds: 2, mean, standard_error, iqm: mean };
        let reference = summary(10.0, Some(4.0));
        assert!(keeps_up(&summary(5.0, Some(3.0)), &reference));
        assert!(!keeps_up(&summary(4.99, Some(3.0)), &reference));
        assert!(keeps_up(&summary(6.0, None), &reference));
        assert!(!keeps_up(&summary(5.99, None), &reference));
    }

    #[test]
    fn each_test_point_of_the_reference_is_compared_with_our_interpolated_seeds() {
        // Ours tests at 4, 50 and 150: held at 0, interpolated at 100, not there at 200.
        let ours = [curve("ours", 7, &[(4, 1.0), (50, 0.0), (150, 8.0)])];
        let comparison = compare(&ours, &reference());
        let found: Vec<_> = comparison
            .rows
            .iter()
            .map(|row| (row.t_env, row.ours.map(|ours| ours.mean), row.keeps_up()))
            .collect();
        assert_eq!(
            found,
            [(0.0, Some(1.0), Some(true)), (100.0, Some(4.0), Some(true)), (200.0, None, None)]
        );
        // At 100 the reference is 3 ± 1; over 0 and 100 its seeds average 1 and 2, ours 2.5.
        assert_eq!(comparison.rows[1].reference.standard_error, Some(1.0));
        let overall = comparison.overall.unwrap();
        assert_eq!((overall.test_points, overall.ours.mean, overall.reference.mean), (2, 2.5, 1.5));
        assert_eq!(overall.reference.standard_error, Some(0.5));
    }

    #[test]
    fn the_table_says_who_is_compared_and_ends_in_a_verdict() {
        let ours = [curve("ours", 7, &[(0, 0.0), (100, 1.0), (200, 1.0)])];
        let text = compare(&ours, &reference()).to_string();
        assert!(text.starts_with("ours:      ours\nreference: reference\n"), "{text}");
        assert!(
            text.contains("       200            1.0000 ± ? (1)       6.0000 ± 2.0000 (2)  no\n"),
            "{text}"
        );
        assert!(
            text.ends_with(
                "verdict: falls behind the reference, 0.6667 ± ? (1) against 3.0000 ± 1.0000 (2) \
                 over the 3 test points that all seeds reach (1 of 3 test points by themselves)"
            ),
            "{text}"
        );
    }

    #[test]
    fn sides_whose_numbers_mean_other_things_get_a_warning_and_no_verdict() {
        let with = |key: &str, value: &str| {
            let mut curve = curve("ours", 7, &[(0, 0.0), (100, 1.0)]);
            curve.settings.insert(key.to_owned(), value.to_owned());
            curve
        };
        let text = compare(&[with("world.reward", "sum")], &[with("world.reward", "mean")]).to_string();
        let first =
            "warning: the numbers of these runs do not have the same meaning: world.reward (mean | sum)\n";
        assert!(text.starts_with(first), "{text}");
        assert!(
            text.ends_with("verdict: none, the numbers do not have the same meaning (see the first line)"),
            "{text}"
        );
        let text = compare(&[with("world.pad", "true")], &[with("world.pad", "false")]).to_string();
        assert!(
            text.starts_with("warning: the numbers of these runs do not have the same meaning: world.pad"),
            "{text}"
        );
        assert!(text.contains("verdict: keeps up with"), "{text}");
        let mixed = [with("algo.hidden", "64"), with("algo.hidden", "128")];
        let text = compare(&mixed, &reference()).to_string();
        let first = "warning: ours mixes different experiments:  algo.hidden (128 | 64)\n";
        assert!(text.starts_with(first), "{text}");
    }

    #[test]
    fn with_nothing_in_common_the_verdict_says_so() {
        let ours = [curve("ours", 7, &[(1000, 0.0), (1100, 1.0)])];
        assert_eq!(compare(&ours, &reference()).overall, None);
        let text = compare(&[], &[]).to_string();
        assert!(
            text.ends_with("nothing to compare, no test point is reached by all seeds of both sides"),
            "{text}"
        );
    }
}
