//! The analytic example as text: the numbers of algorithms §10.

use crate::estimation::{eigenvalues, spectral_radius, Matrix, Problem, Scheme};

/// The updates of the tables' rows, as in algorithms §10.
const ROWS: [usize; 8] = [1, 2, 3, 4, 5, 6, 9, 15];
/// Last row of IIBR if it diverges.
const LAST_DIVERGING_ROW: usize = 6;
/// Gains that fit into a row.
const SHOWN_GAINS: usize = 4;
/// Far beyond every count in the table of the paper's case.
const UPDATE_LIMIT: usize = 100_000;

/// Trajectories, spectral radii and convergence times, computed now.
pub fn estimation_report(problem: &Problem) -> String {
    [facts(problem), matrices(problem), trajectories(problem), radii(problem), periods(problem)].join("\n")
}

/// The first gains, and whether there are more.
fn gains(k: &[f64]) -> String {
    let shown: Vec<_> = k.iter().take(SHOWN_GAINS).map(|k| format!("{k:.6}")).collect();
    shown.join(", ") + if k.len() > SHOWN_GAINS { ", …" } else { "" }
}

fn facts(problem: &Problem) -> String {
    let star = problem.fixed_point();
    format!(
        "Estimation by {} agents: y_i = x + v_i, z_i = K_i y_i, variance of v_i {}\n\
         J(K) = E sum_ij S_ij (x - z_i)(x - z_j) / n^2, S_ii = p = {}, S_ij = q = {}\n\
         fixed point K* = ({}), J* = {:.6}, J(0) = {:.6}\n",
        problem.agents(),
        problem.variance(),
        problem.p(),
        problem.q(),
        gains(&star),
        problem.cost(&star),
        problem.cost(&problem.start()),
    )
}

fn matrices(problem: &Problem) -> String {
    let (n, w) = (problem.agents(), problem.best_damping());
    // Eigenvalues are shown for three rows only, as in the paper.
    let wide = |text: String| if n == 3 { format!("{text:<52}") } else { String::new() };
    let mut text = format!("{:<37}{}spectral radius\n", "", wide("eigenvalues".to_owned()));
    let mut row = |name: &str, a: &Matrix| {
        let values = eigenvalues(a).into_iter().flatten().map(|value| match value.im {
            0.0 => format!("{:.6}", value.re),
            im => format!("{:.6}{im:+.6}i", value.re),
        });
        let values = wide(values.collect::<Vec<_>>().join("  "));
        text += &format!("{name:<37}{values}{:.6}\n", spectral_radius(a));
    };
    row("cost matrix", &problem.gamma());
    row("IIBR, one update", &Scheme::IIBR.update_matrix(problem, 0));
    row(&format!("IIBR damped by {w:.4}, one update"), &Scheme::damped(w).update_matrix(problem, 0));
    row(&format!("SIBR, one sweep ({n} updates)"), &Scheme::SIBR.sweep_matrix(problem));
    row("omega = 0.5, one sweep", &Scheme::multi_timescale(0.5, 1).sweep_matrix(problem));
    text + &format!("SIBR per update: {:.4}\n", problem.rho(0.0).powf(1.0 / n as f64))
}

fn trajectories(problem: &Problem) -> String {
    let (iibr, sibr) = (Scheme::IIBR.trajectory(problem, 15), Scheme::SIBR.trajectory(problem, 15));
    let diverges = spectral_radius(&Scheme::IIBR.update_matrix(problem, 0)) > 1.0;
    let width = gains(&sibr[0]).chars().count().max(30);
    let mut text =
        format!("{:>6}  {:>11}  {:>10}  {:>width$}  {:>9}\n", "update", "IIBR each K", "J", "SIBR K", "J");
    for step in ROWS {
        let (each, cost) = match diverges && step > LAST_DIVERGING_ROW {
            false => (format!("{:.6}", iibr[step][0]), format!("{:.6}", problem.cost(&iibr[step]))),
            true => ("-".to_owned(), "-".to_owned()),
        };
        let in_turn = problem.cost(&sibr[step]);
        text +=
            &format!("{step:>6}  {each:>11}  {cost:>10}  {:>width$}  {in_turn:>9.6}\n", gains(&sibr[step]));
    }
    text
}

fn radii(problem: &Problem) -> String {
    let n = problem.agents();
    let mut text = format!(
        "Multi-timescale: the fast agent moves to its best response, the others by the share omega\n\
         of the way, in turns of one update. Spectral radius of {n} updates:\n"
    );
    let omegas: Vec<f64> = (0..=10).map(|tenth| f64::from(tenth) / 10.0).collect();
    let line = |name: &str, cells: Vec<String>| format!("{name:<6}{}\n", cells.join("  "));
    text += &line("omega", omegas.iter().map(|omega| format!("{omega:>6.1}")).collect());
    text += &line("rho", omegas.iter().map(|omega| format!("{:>6.4}", problem.rho(*omega))).collect());
    let ((omega, least), w) = (problem.best_omega(), problem.best_damping());
    let unstable = problem.stability_limit();
    let unstable = unstable.map_or("stable up to 1".to_owned(), |limit| format!("unstable from {limit:.4}"));
    text += &format!("best omega {omega:.4} (rho {least:.4}); {unstable}\n");
    let damped = spectral_radius(&Scheme::damped(w).sweep_matrix(problem));
    text += &format!("all at once, damped by {w:.4}, the best factor: rho {damped:.4}\n");
    text + &claim(problem.rho(0.0), least, damped)
}

/// The conclusion from these numbers.
fn claim(sequential: f64, two_timescales: f64, damped: f64) -> String {
    // A smaller difference is a rounding error.
    let faster = |a: f64, b: f64| a < b - 1e-6;
    let first = match faster(two_timescales, sequential) {
        true => "Here the sequential scheme converges faster when the others move slowly meanwhile",
        false => "Here it does not help the sequential scheme when the others move meanwhile",
    };
    let second = match (faster(damped, two_timescales), faster(two_timescales, damped)) {
        (true, _) => "all agents\nat once with one common, damped rate are faster still, so different rates are not needed",
        (_, true) => "all agents\nat once with one common, damped rate are slower than that",
        _ => "all agents\nat once with one common, damped rate are as fast",
    };
    format!("{first}; {second}.\n")
}

fn periods(problem: &Problem) -> String {
    let mut text =
        "Updates from K = 0 until max |K_i - K*_i| < 1e-6, by the length s of a turn:\n".to_owned();
    text += &format!("{:<25}{:>6}{:>6}{:>6}\n", "s", 1, 2, 10);
    let count = |scheme: Scheme| {
        let updates = scheme.updates_until(problem, 1e-6, UPDATE_LIMIT);
        updates.map_or("never".to_owned(), |updates| updates.to_string())
    };
    for omega in [0.0, 0.5] {
        let cells = [1, 2, 10].map(|s| count(Scheme::multi_timescale(omega, s)));
        text += &format!("omega = {omega:<17}{:>6}{:>6}{:>6}\n", cells[0], cells[1], cells[2]);
    }
    let w = problem.best_damping();
    let damped = count(Scheme::damped(w));
    text + &format!("all at once, damped {w:.4}{damped:>5}{damped:>6}{damped:>6}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn has(report: &str, lines: &[&str]) {
        lines.iter().for_each(|line| assert!(report.contains(line), "no `{line}` in\n{report}"));
    }

    #[test]
    fn the_report_prints_the_numbers_of_the_spec() {
        let report = estimation_report(&Problem::PAPER);
        has(
            &report,
            &[
                "fixed point K* = (0.857143, 0.857143, 0.857143), J* = 0.142857, J(0) = 1.000000",
                "     5     4.469136   15.363766    1.407407, 0.913580, 0.222222   0.182340",
                "    15            -           -    0.868842, 0.929376, 0.801188   0.143416",
                "rho   0.5443  0.5446  0.5422  0.5327  0.5130  0.4826  0.4443  0.6686  1.0740",
                "best omega 0.6188 (rho 0.4366); unstable from 0.7842",
                "all at once, damped by 0.7500, the best factor: rho 0.4219",
                "the others move slowly meanwhile; all agents\nat once with one common, damped rate are faster still, \
                 so different rates are not needed.",
                "omega = 0                    72   143   711",
                "omega = 0.5                  57    50    56",
                "0.518519+0.165635i  0.518519-0.165635i",
            ],
        );
    }

    #[test]
    fn another_problem_has_its_own_numbers() {
        // Two agents, p = 2, q = 1, σ² = 1: Γ = (4 1; 1 4), η = 3, K* = 3/5, c = 1/4; J(0) = 6/4, J* = 0.6.
        let report = estimation_report(&Problem::new(2.0, 1.0, 1.0, 2).unwrap());
        has(
            &report,
            &[
                "Estimation by 2 agents: y_i = x + v_i, z_i = K_i y_i, variance of v_i 1\n",
                "S_ii = p = 2, S_ij = q = 1\n",
                "fixed point K* = (0.600000, 0.600000), J* = 0.600000, J(0) = 1.500000",
                "cost matrix                          5.000000\n",
                "IIBR, one update                     0.250000\n",
                "SIBR, one sweep (2 updates)          0.062500\n",
                "stable up to 1\n",
                "    15     0.600000    0.600000              0.600000, 0.600000   0.600000",
            ],
        );
        assert!(!report.contains("eigenvalues"), "{report}");
        // Many agents: rows end after four gains.
        let report = estimation_report(&Problem::new(1.0, 1.0, 0.5, 6).unwrap());
        has(&report, &["SIBR, one sweep (6 updates)", "0.923077, 0.923077, 0.923077, 0.923077, …)"]);
    }

    #[test]
    fn no_claim_goes_beyond_its_numbers() {
        for (radii, said) in [
            (
                (0.5, 0.4, 0.3),
                "move slowly meanwhile; all agents\nat once with one common, damped rate are faster still",
            ),
            (
                (0.5, 0.4, 0.45),
                "move slowly meanwhile; all agents\nat once with one common, damped rate are slower",
            ),
            (
                (0.5, 0.4, 0.4),
                "move slowly meanwhile; all agents\nat once with one common, damped rate are as fast",
            ),
            (
                (0.5, 0.5, 0.6),
                "it does not help the sequential scheme when the others move meanwhile; all agents\nat",
            ),
        ] {
            let claim = claim(radii.0, radii.1, radii.2);
            assert!(claim.contains(said), "{radii:?}: {claim}");
        }
    }
}
