//! The scores of each group of runs, as a table: final, last five, best, and mean over all test points.

use std::fmt;

use crate::stats::{auc, best, final_performance, mean_of_last, quarter_interval, Summary};
use crate::{Curve, Group};

/// Test points of the mean at the end of a run.
const LAST: usize = 5;

/// The scores of one group over its seeds.
#[derive(Debug, Clone, PartialEq)]
pub struct Scores {
    pub label: String,
    pub seeds: usize,
    /// Name and value, in the order of the table.
    pub scores: Vec<(&'static str, Summary)>,
    /// First and last step at which seeds end, if these are different test points.
    pub ends: Option<(u64, u64)>,
}

/// The scores of each group; a group without points has none. [`fmt::Display`] prints a group's as a table.
pub fn scores(groups: &[Group]) -> Vec<Scores> {
    groups.iter().map(of_group).collect()
}

fn of_group(group: &Group) -> Scores {
    let over_seeds = |score: &dyn Fn(&Curve) -> Option<f64>| {
        Summary::of(&group.curves.iter().filter_map(score).collect::<Vec<f64>>())
    };
    let scores = [
        ("final", over_seeds(&final_performance)),
        ("mean of last 5", over_seeds(&|curve| mean_of_last(curve, LAST))),
        ("best", over_seeds(&best)),
        ("AUC", over_seeds(&auc)),
    ];
    let ends = || group.curves.iter().filter_map(|curve| curve.points.last()).map(|point| point.t_env);
    let ends = ends().min().zip(ends().max());
    Scores {
        label: group.label.clone(),
        seeds: group.curves.len(),
        scores: scores.into_iter().filter_map(|(name, score)| Some((name, score?))).collect(),
        ends: ends.filter(|(first, last)| (last - first) as f64 > quarter_interval(&group.curves)),
    }
}

impl fmt::Display for Scores {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seeds = if self.seeds == 1 { "1 seed".to_owned() } else { format!("{} seeds", self.seeds) };
        write!(f, "{} ({seeds}", self.label)?;
        if let Some((first, last)) = self.ends {
            write!(f, "; they end between steps {first} and {last}")?;
        }
        writeln!(f, ")")?;
        write!(f, "  {:<14}  {:>10}  {:>14}  {:>10}", "score", "mean", "standard error", "IQM")?;
        for (name, score) in &self.scores {
            let error = score.standard_error.map_or("-".to_owned(), |error| format!("{error:.4}"));
            write!(f, "\n  {name:<14}  {:>10.4}  {error:>14}  {:>10.4}", score.mean, score.iqm)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runs::tests::curve;

    #[test]
    fn a_group_has_five_scores_with_their_errors() {
        // The two runs: final 5 and 7, last five 3.6 and 5.6, best 7 and 9, all 3 and 5.
        let points = |shift: f64| {
            [(0, 0.0), (10, 7.0), (20, 1.0), (30, 2.0), (40, 3.0), (50, 5.0)].map(|(t, v)| (t, v + shift))
        };
        let curves = vec![curve("a", 1, &points(0.0)), curve("a", 2, &points(2.0))];
        let table = scores(&[Group { label: "a".to_owned(), curves }]);
        assert_eq!(
            table[0].to_string(),
            "a (2 seeds)\n\
             \u{20} score                 mean  standard error         IQM\n\
             \u{20} final               6.0000          1.0000      6.0000\n\
             \u{20} mean of last 5      4.6000          1.0000      4.6000\n\
             \u{20} best                8.0000          1.0000      8.0000\n\
             \u{20} AUC                 4.0000          1.0000      4.0000"
        );
    }

    #[test]
    fn seeds_that_end_elsewhere_are_named() {
        let curves =
            vec![curve("a", 1, &[(0, 1.0), (10, 1.0)]), curve("a", 2, &[(0, 1.0), (10, 1.0), (20, 3.0)])];
        let text = scores(&[Group { label: "a".to_owned(), curves }])[0].to_string();
        assert!(text.starts_with("a (2 seeds; they end between steps 10 and 20)\n"), "{text}");
        let one = scores(&[Group { label: "a".to_owned(), curves: vec![curve("a", 1, &[(0, 1.0)])] }]);
        assert!(one[0].to_string().contains("\n  final               1.0000               -      1.0000\n"));
    }
}
