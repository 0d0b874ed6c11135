//! The analytic example as text: what a reproduction of spec §10 has to show.

use crate::estimation::{
    best_omega, cost, eigenvalues, fixed_point, gamma, rho, spectral_radius, stability_limit, Matrix, Scheme,
};

/// Updates after which the tables of the report show a row, as in the spec.
const ROWS: [usize; 8] = [1, 2, 3, 4, 5, 6, 9, 15];
/// IIBR has left the scale by then.
const LAST_IIBR_ROW: usize = 6;
/// Far beyond every count in the table.
const UPDATE_LIMIT: usize = 100_000;

/// Trajectories, eigenvalues, spectral radii and convergence times, computed now.
pub fn estimation_report() -> String {
    let sections = [facts(), matrices(), trajectories(), radii(), periods()];
    sections.join("\n")
}

fn facts() -> String {
    let star = fixed_point();
    format!(
        "Estimation by three agents: y_i = x + v_i, z_i = K_i y_i, J(K) = E (x - mean z)^2\n\
         fixed point K* = ({}), J* = {:.6}, J(0) = {:.6}\n",
        star.map(|k| format!("{k:.6}")).join(", "),
        cost(&star),
        cost(&[0.0; 3]),
    )
}

fn matrices() -> String {
    let mut text = format!("{:<32}{:<50}{}\n", "", "eigenvalues", "spectral radius");
    let mut row = |name: &str, a: &Matrix| {
        let values = eigenvalues(a).map(|value| match value.im {
            0.0 => format!("{:.6}", value.re),
            im => format!("{:.6}{im:+.6}i", value.re),
        });
        text += &format!("{name:<32}{:<50}{:.6}\n", values.join("  "), spectral_radius(a));
    };
    row("cost matrix", &gamma());
    row("IIBR, one update", &Scheme::IIBR.update_matrix(0));
    row("SIBR, one sweep (3 updates)", &Scheme::SIBR.sweep_matrix());
    row("omega = 0.5, one sweep", &Scheme::multi_timescale(0.5, 1).sweep_matrix());
    text + &format!("SIBR per update: {:.4}\n", rho(0.0).cbrt())
}

fn trajectories() -> String {
    let (iibr, sibr) = (Scheme::IIBR.trajectory(15), Scheme::SIBR.trajectory(15));
    let mut text =
        format!("{:>6}  {:>11}  {:>10}  {:>30}  {:>9}\n", "update", "IIBR each K", "J", "SIBR K", "J");
    for step in ROWS {
        let (each, diverging) = match step <= LAST_IIBR_ROW {
            true => (format!("{:.6}", iibr[step][0]), format!("{:.6}", cost(&iibr[step]))),
            false => ("-".to_owned(), "-".to_owned()),
        };
        let gains = sibr[step].map(|k| format!("{k:.6}")).join(", ");
        text += &format!("{step:>6}  {each:>11}  {diverging:>10}  {gains:>30}  {:>9.6}\n", cost(&sibr[step]));
    }
    text
}

fn radii() -> String {
    let mut text =
        "Multi-timescale: the fast agent goes to its best response, the others the share omega\n".to_owned();
    text += "of the way, in turns of one update. Spectral radius of a sweep of 3 updates:\n";
    let omegas: Vec<f64> = (0..=10).map(|tenth| f64::from(tenth) / 10.0).collect();
    let line = |name: &str, cells: Vec<String>| format!("{name:<6}{}\n", cells.join("  "));
    text += &line("omega", omegas.iter().map(|omega| format!("{omega:>6.1}")).collect());
    text += &line("rho", omegas.iter().map(|omega| format!("{:>6.4}", rho(*omega))).collect());
    let (omega, least) = best_omega();
    let damped = spectral_radius(&Scheme::damped(0.75).sweep_matrix());
    text += &format!("best omega {omega:.4} (rho {least:.4}); unstable from {:.4}\n", stability_limit());
    text + &format!("for comparison: all agents at once, damped by 0.75: {damped:.4} per 3 updates\n")
}

fn periods() -> String {
    let mut text =
        "Updates from K = 0 until max |K_i - K*_i| < 1e-6, by the length s of a turn:\n".to_owned();
    text += &format!("{:<13}{:>6}{:>6}{:>6}\n", "s", 1, 2, 10);
    for omega in [0.0, 0.5] {
        let count = |s| Scheme::multi_timescale(omega, s).updates_until(1e-6, UPDATE_LIMIT);
        let cells = [1, 2, 10].map(|s| count(s).map_or("never".to_owned(), |updates| updates.to_string()));
        text += &format!("omega = {omega:<5}{:>6}{:>6}{:>6}\n", cells[0], cells[1], cells[2]);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_report_prints_the_numbers_of_the_spec() {
        let report = estimation_report();
        for line in [
            "fixed point K* = (0.857143, 0.857143, 0.857143), J* = 0.142857, J(0) = 1.000000",
            "     5     4.469136   15.363766    1.407407, 0.913580, 0.222222   0.182340",
            "    15            -           -    0.868842, 0.929376, 0.801188   0.143416",
            "rho   0.5443  0.5446  0.5422  0.5327  0.5130  0.4826  0.4443  0.6686  1.0740",
            "best omega 0.6188 (rho 0.4366); unstable from 0.7842",
            "omega = 0        72   143   711",
            "omega = 0.5      57    50    56",
        ] {
            assert!(report.contains(line), "no `{line}` in\n{report}");
        }
        assert!(report.contains("0.518519+0.165635i  0.518519-0.165635i"), "{report}");
    }
}
