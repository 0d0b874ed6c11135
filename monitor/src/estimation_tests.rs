//! Every number of algorithms §10, to the digits printed there.

use super::*;

/// The paper's case.
const PAPER: Problem = Problem::PAPER;

fn matrix(rows: [[f64; 3]; 3]) -> Matrix {
    rows.map(|row| row.to_vec()).to_vec()
}

#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected} within {tolerance}");
}

fn sorted(a: &Matrix) -> Vec<(f64, f64)> {
    let mut values: Vec<_> =
        eigenvalues(a).expect("three rows").iter().map(|value| (value.re, value.im)).collect();
    values.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    values
}

#[track_caller]
fn has_eigenvalues(a: &Matrix, expected: [(f64, f64); 3]) {
    for (found, expected) in sorted(a).into_iter().zip(expected) {
        close(found.0, expected.0, 1e-7);
        close(found.1, expected.1, 1e-7);
    }
}

#[test]
fn the_fixed_point_is_six_sevenths_and_costs_one_seventh() {
    let star = PAPER.fixed_point();
    assert_eq!(star, [6.0 / 7.0; 3]);
    close(PAPER.cost(&star), 1.0 / 7.0, 1e-15);
    assert_eq!(PAPER.cost(&PAPER.start()), 1.0);
    (0..3).for_each(|i| close(PAPER.best_response(&star, i), star[i], 1e-15));
}

#[test]
fn both_forms_of_the_cost_agree() {
    for k in [[0.0, 0.0, 0.0], [1.0, -2.0, 3.5], [0.9, 0.8, 0.857]] {
        close(PAPER.excess_cost(&k), PAPER.cost(&k) - 1.0 / 7.0, 1e-14);
    }
}

#[test]
fn gamma_has_the_eigenvalues_of_the_spec() {
    assert_eq!(PAPER.gamma(), matrix([[1.5, 1.0, 1.0], [1.0, 1.5, 1.0], [1.0, 1.0, 1.5]]));
    has_eigenvalues(&PAPER.gamma(), [(0.5, 0.0), (0.5, 0.0), (3.5, 0.0)]);
}

#[test]
fn iibr_diverges_with_spectral_radius_four_thirds() {
    let a = Scheme::IIBR.update_matrix(&PAPER, 0);
    let off = -2.0 / 3.0;
    assert_eq!(a, matrix([[0.0, off, off], [off, 0.0, off], [off, off, 0.0]]));
    has_eigenvalues(&a, [(-4.0 / 3.0, 0.0), (2.0 / 3.0, 0.0), (2.0 / 3.0, 0.0)]);
    close(spectral_radius(&a), 4.0 / 3.0, 1e-12);
}

#[test]
fn a_sweep_of_sibr_has_the_papers_matrix_and_complex_eigenvalues() {
    let a = Scheme::SIBR.sweep_matrix(&PAPER);
    let paper = [[0.0, -18.0, -18.0], [0.0, 12.0, -6.0], [0.0, 4.0, 16.0]];
    for (row, expected) in a.iter().zip(paper) {
        row.iter().zip(expected).for_each(|(found, expected)| close(*found, expected / 27.0, 1e-15));
    }
    let (re, im) = (14.0 / 27.0, 20.0_f64.sqrt() / 27.0);
    has_eigenvalues(&a, [(0.0, 0.0), (re, -im), (re, im)]);
    close(re, 0.518519, 5e-7);
    close(im, 0.165635, 5e-7);
    close(spectral_radius(&a), 6.0 * 6.0_f64.sqrt() / 27.0, 1e-12);
    close(spectral_radius(&a), 0.544331, 5e-7);
    close(spectral_radius(&a).cbrt(), 0.8165, 5e-5);
}

#[test]
fn the_iibr_iterates_are_those_of_the_table() {
    let table = [
        (1, 2.0, 1.666667),
        (2, -0.666667, 2.851852),
        (3, 2.888889, 4.958848),
        (4, -1.851852, 8.704618),
        (5, 4.469136, 15.363766),
        (6, -3.958848, 27.202250),
    ];
    let trajectory = Scheme::IIBR.trajectory(&PAPER, 6);
    for (step, gain, expected) in table {
        trajectory[step].iter().for_each(|k| close(*k, gain, 5e-7));
        close(PAPER.cost(&trajectory[step]), expected, 6e-7);
    }
}

#[test]
fn the_sibr_iterates_are_those_of_the_table() {
    let table = [
        (1, [2.0, 0.0, 0.0], 0.333333),
        (2, [2.0, 0.666667, 0.0], 0.259259),
        (3, [2.0, 0.666667, 0.222222], 0.251029),
        (4, [1.407407, 0.666667, 0.222222], 0.192501),
        (5, [1.407407, 0.913580, 0.222222], 0.182340),
        (6, [1.407407, 0.913580, 0.452675], 0.173489),
        (9, [1.089163, 0.972108, 0.625819], 0.151041),
        (15, [0.868842, 0.929376, 0.801188], 0.143416),
    ];
    let trajectory = Scheme::SIBR.trajectory(&PAPER, 15);
    for (step, gains, expected) in table {
        trajectory[step].iter().zip(gains).for_each(|(k, gain)| close(*k, gain, 5e-7));
        close(PAPER.cost(&trajectory[step]), expected, 5e-7);
    }
}

#[test]
fn sibr_never_raises_the_cost_and_iibr_multiplies_its_excess_by_sixteen_ninths() {
    let sibr = Scheme::SIBR.trajectory(&PAPER, 100);
    assert!(
        sibr.windows(2).all(|pair| PAPER.excess_cost(&pair[1]) <= PAPER.excess_cost(&pair[0])),
        "Proposition 1"
    );
    let iibr = Scheme::IIBR.trajectory(&PAPER, 30);
    iibr.windows(2)
        .for_each(|pair| close(PAPER.excess_cost(&pair[1]) / PAPER.excess_cost(&pair[0]), 16.0 / 9.0, 1e-9));
}

#[test]
fn a_start_with_the_right_mean_lets_even_iibr_converge_at_two_thirds() {
    let star = 6.0 / 7.0;
    let k = [star + 1.0, star - 1.0, star];
    close(PAPER.distance(&Scheme::IIBR.step(&PAPER, &k, 0)) / PAPER.distance(&k), 2.0 / 3.0, 1e-14);
}

#[test]
fn the_spectral_radius_over_omega_is_that_of_the_table() {
    let table = [
        (0.0, 0.5443),
        (0.1, 0.5446),
        (0.2, 0.5422),
        (0.3, 0.5327),
        (0.4, 0.5130),
        (0.5, 0.4826),
        (0.6, 0.4443),
        (0.7, 0.6686),
        (0.8, 1.0740),
        (1.0, 2.3704),
    ];
    table.iter().for_each(|(omega, expected)| close(PAPER.rho(*omega), *expected, 5e-5));
    // By hand: at ω = 1/2 the polynomial is λ³ − 20/27 λ² + 139/5832 λ + 1000/19683; with its real
    // root −0.2180945 the pair has modulus sqrt(1000/19683 / 0.2180945) = 0.4826497.
    close(PAPER.rho(0.5), 0.4826497, 5e-8);
}

#[test]
fn the_best_omega_is_where_the_real_eigenvalue_overtakes_the_complex_pair() {
    let (omega, least) = PAPER.best_omega();
    close(omega, 0.618754, 5e-7);
    close(least, 0.436565, 5e-7);
    // Better than a value from a coarse grid, and than every neighbour.
    assert!(least < PAPER.rho(0.6185) && least < PAPER.rho(omega - 1e-5) && least < PAPER.rho(omega + 1e-5));
    let [real, pair, _] = eigenvalues(&Scheme::multi_timescale(omega, 1).sweep_matrix(&PAPER)).unwrap();
    close(-real.re, pair.modulus(), 1e-7);
}

#[test]
fn stability_ends_where_an_eigenvalue_passes_minus_one() {
    close(PAPER.stability_limit().unwrap(), 0.784162, 5e-7);
    assert!(PAPER.rho(0.7841) < 1.0 && PAPER.rho(0.7842) > 1.0, "between 0.7841 and 0.7842");
    let [real, ..] =
        eigenvalues(&Scheme::multi_timescale(PAPER.stability_limit().unwrap(), 1).sweep_matrix(&PAPER))
            .unwrap();
    close(real.re, -1.0, 1e-9);
}

#[test]
fn uniform_damping_is_best_at_three_quarters_and_stable_below_six_sevenths() {
    let sweep = |w: f64| spectral_radius(&Scheme::damped(w).sweep_matrix(&PAPER));
    close(sweep(0.75), 0.75_f64.powi(3), 1e-9);
    close(sweep(0.75), 0.4219, 5e-5);
    assert!(sweep(0.74) > sweep(0.75) && sweep(0.76) > sweep(0.75));
    assert!(sweep(6.0 / 7.0 - 1e-6) < 1.0 && sweep(6.0 / 7.0 + 1e-6) > 1.0);
}

#[test]
fn long_turns_cost_the_sequential_scheme_dearly_and_the_multi_timescale_one_nothing() {
    let updates =
        |omega| [1, 2, 10].map(|s| Scheme::multi_timescale(omega, s).updates_until(&PAPER, 1e-6, 10_000));
    assert_eq!(updates(0.0), [Some(72), Some(143), Some(711)]);
    assert_eq!(updates(0.5), [Some(57), Some(50), Some(56)]);
    assert_eq!(Scheme::IIBR.updates_until(&PAPER, 1e-6, 10_000), None);
}

#[test]
fn the_matrices_are_what_the_steps_do() {
    for scheme in [Scheme::IIBR, Scheme::SIBR, Scheme::multi_timescale(0.3, 2)] {
        let k = [0.3, -1.2, 2.5];
        let star = PAPER.fixed_point();
        let stepped = (0..3 * scheme.period).fold(k.to_vec(), |k, u| scheme.step(&PAPER, &k, u));
        let a = scheme.sweep_matrix(&PAPER);
        let sweep = if scheme == Scheme::IIBR { 3 } else { 3 * scheme.period };
        assert_eq!(sweep, 3 * scheme.period);
        for i in 0..3 {
            let predicted: f64 = (0..3).map(|j| a[i][j] * (k[j] - star[j])).sum();
            close(stepped[i] - star[i], predicted, 1e-13);
        }
    }
}

#[test]
fn eigenvalues_of_known_matrices_are_right() {
    has_eigenvalues(&matrix([[0.0; 3]; 3]), [(0.0, 0.0); 3]);
    has_eigenvalues(&matrix([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]]), [(2.0, 0.0); 3]);
    // A rotation about an axis: 1 and ± i; mirrored: −1 and ± i.
    has_eigenvalues(
        &matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
        [(0.0, -1.0), (0.0, 1.0), (1.0, 0.0)],
    );
    has_eigenvalues(
        &matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
        [(-1.0, 0.0), (0.0, -1.0), (0.0, 1.0)],
    );
    has_eigenvalues(
        &matrix([[1.0, 5.0, -7.0], [0.0, 2.0, 3.0], [0.0, 0.0, 3.0]]),
        [(1.0, 0.0), (2.0, 0.0), (3.0, 0.0)],
    );
    assert!(
        spectral_radius(&matrix([[f64::NAN; 3]; 3])).is_nan(),
        "what cannot be computed does not look stable"
    );
}

/// p = 2, q = 1, σ² = 1, n = 2, by hand: Γ = (4 1; 1 4), η = (3, 3), K* = 3/5, coupling 1/4.
#[test]
fn two_agents_with_other_weights_are_as_worked_out_by_hand() {
    let two = Problem::new(2.0, 1.0, 1.0, 2).unwrap();
    assert_eq!(two.gamma(), [[4.0, 1.0], [1.0, 4.0]]);
    two.fixed_point().into_iter().for_each(|k| close(k, 0.6, 1e-15));
    // (1,1) S (1,1)ᵀ / 4, and less (0.6)² (1,1) Γ (1,1)ᵀ / 4.
    close(two.cost(&two.start()), 1.5, 1e-15);
    close(two.cost(&two.fixed_point()), 0.6, 1e-15);
    // K = (1, 0): errors (0, 1), noise 2·1·1: (2 + 2) / 4.
    close(two.cost(&[1.0, 0.0]), 1.0, 1e-15);
    close(two.excess_cost(&[1.0, 0.0]), 0.4, 1e-15);
    close(two.best_response(&[1.0, 0.0], 1), 0.5, 1e-15);
    // Jacobi has ± 1/4; a sweep of Gauss–Seidel 0 and (1/4)²; there is nothing to damp.
    close(spectral_radius(&Scheme::IIBR.update_matrix(&two, 0)), 0.25, 1e-12);
    close(two.rho(0.0), 1.0 / 16.0, 1e-12);
    assert_eq!(Scheme::SIBR.sweep_matrix(&two), [[0.0, -0.25], [0.0, 0.0625]]);
    assert_eq!((two.best_damping(), two.stability_limit()), (1.0, None));
    // SIBR from 0: 3/4, then (3 − 3/4) / 4 = 9/16, then (3 − 9/16) / 4 = 39/64.
    let sibr = Scheme::SIBR.trajectory(&two, 3);
    assert_eq!(sibr[1..], [vec![0.75, 0.0], vec![0.75, 0.5625], vec![39.0 / 64.0, 0.5625]]);
}

/// p = q = 1, σ² = 1, n = 4: Γ = I + ones, η = 4, K* = 4/5, coupling 1/2.
#[test]
fn four_agents_are_as_worked_out_by_hand() {
    let four = Problem::new(1.0, 1.0, 1.0, 4).unwrap();
    four.fixed_point().into_iter().for_each(|k| close(k, 0.8, 1e-15));
    // The error of a mean: (1 − 4/5)² + (1/16) 4 (4/5)².
    close(four.cost(&four.fixed_point()), 0.2, 1e-15);
    // Jacobi: −3/2 along (1,1,1,1), 1/2 across it.
    close(spectral_radius(&Scheme::IIBR.update_matrix(&four, 0)), 1.5, 1e-12);
    // Damped by 2 / (2 + 2/2): 1 − (2/3)(5/2) = −2/3 and 1 − (2/3)(1/2) = 2/3.
    close(four.best_damping(), 2.0 / 3.0, 1e-15);
    let damped = Scheme::damped(four.best_damping());
    close(spectral_radius(&damped.update_matrix(&four, 0)), 2.0 / 3.0, 1e-12);
    close(spectral_radius(&damped.sweep_matrix(&four)), (2.0_f64 / 3.0).powi(4), 1e-12);
    // One after another from 0: 2, then (4 − 2) / 2 = 1, (4 − 3) / 2 = 1/2, (4 − 7/2) / 2 = 1/4.
    assert_eq!(Scheme::SIBR.trajectory(&four, 4)[4], [2.0, 1.0, 0.5, 0.25]);
    assert_eq!(eigenvalues(&four.gamma()), None);
}

#[test]
fn agents_whose_errors_do_not_meet_in_the_cost_are_there_after_one_update() {
    for variance in [0.0, 3.0] {
        let apart = Problem::new(1.0, 0.0, variance, 5).unwrap();
        let k = Scheme::IIBR.step(&apart, &apart.start(), 0);
        close(apart.distance(&k), 0.0, 1e-15);
        close(k[0], 1.0 / (1.0 + variance), 1e-15);
        assert_eq!((apart.rho(0.0), apart.best_damping(), apart.stability_limit()), (0.0, 1.0, None));
    }
}

#[test]
fn the_largest_team_has_the_radii_of_the_formulas() {
    let many = Problem::new(1.0, 1.0, 0.5, MOST_AGENTS).unwrap();
    close(spectral_radius(&Scheme::IIBR.update_matrix(&many, 0)), 31.0 * 2.0 / 3.0, 1e-10);
    let w = many.best_damping();
    close(spectral_radius(&Scheme::damped(w).update_matrix(&many, 0)), 1.0 - w / 3.0, 1e-12);
    assert!(many.rho(0.0) < 1.0, "Proposition 1");
}

#[test]
fn the_sweep_is_the_product_of_its_updates() {
    for (scheme, problem) in [
        (Scheme::multi_timescale(0.3, 2), PAPER),
        (Scheme::multi_timescale(0.7, 1), Problem::new(2.0, -0.3, 0.1, 5).unwrap()),
    ] {
        let updates = (0..problem.agents() * scheme.period).map(|u| scheme.update_matrix(&problem, u));
        let expected = updates.reduce(|sweep, update| product(&update, &sweep)).unwrap();
        let found = scheme.sweep_matrix(&problem);
        found.iter().flatten().zip(expected.iter().flatten()).for_each(|(f, e)| close(*f, *e, 1e-14));
    }
}

#[test]
fn the_radius_by_squaring_is_that_of_the_eigenvalues() {
    for omega in [0.0, 0.2, 0.5, 0.61875, 0.7, 1.0] {
        let a = Scheme::multi_timescale(omega, 1).sweep_matrix(&PAPER);
        let modulus = eigenvalues(&a).unwrap().iter().map(Eigenvalue::modulus).fold(0.0, f64::max);
        close(spectral_radius(&a), modulus, 1e-9);
    }
    // A triple zero and a double one that is not diagonal.
    close(spectral_radius(&matrix([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])), 0.0, 0.0);
    close(spectral_radius(&matrix([[0.5, 9.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.1]])), 0.5, 1e-12);
}

#[test]
fn what_has_no_answer_is_refused_with_what_was_expected() {
    let refused = |p, q, variance, n| Problem::new(p, q, variance, n).unwrap_err().to_string();
    assert_eq!(refused(1.0, 1.0, 0.5, 1), "`--n 1`: expected a number of agents from 2 to 32");
    assert_eq!(refused(1.0, 1.0, 0.5, 33), "`--n 33`: expected a number of agents from 2 to 32");
    assert_eq!(refused(0.0, 1.0, 0.5, 3), "`--p 0`: expected a weight from 1e-9 to 1e9");
    assert_eq!(refused(f64::NAN, 1.0, 0.5, 3), "`--p NaN`: expected a weight from 1e-9 to 1e9");
    assert_eq!(refused(1.0, f64::INFINITY, 0.5, 3), "`--q inf`: expected a weight from -1e9 to 1e9");
    assert_eq!(refused(1.0, f64::NAN, 0.5, 3), "`--q NaN`: expected a weight from -1e9 to 1e9");
    assert_eq!(refused(1.0, 1.0, -0.5, 3), "`--variance -0.5`: expected a variance from 0 to 1e9");
    // Without noise only the mean matters, and any gains with that mean will do.
    for (p, q, variance, n) in [(1.0, 1.0, 0.0, 3), (1.0, 2.0, 0.5, 3), (1.0, -0.75, 0.5, 3)] {
        let text = refused(p, q, variance, n);
        assert!(
            text.contains("the cost has no single minimum") && text.contains(&format!("q = {q}")),
            "{text}"
        );
    }
    assert!(Problem::new(1.0, -0.74, 0.5, 3).is_ok() && Problem::new(1.0, 1.49, 0.5, 3).is_ok());
    assert_eq!(Problem::new(1.0, 1.0, 0.5, 3), Ok(PAPER));
}
