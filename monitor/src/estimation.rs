//! The analytic example (algorithms §10): agents estimate one number, each from its own noisy observation. It is small
//! enough for exact answers. It shows that simultaneous best responses can diverge where sequential ones converge, and
//! that the sequential scheme can become faster when the other agents move slowly meanwhile. It does not show that
//! agents need different timescales: in the paper's case, simultaneous updates with one common damping are a little
//! faster still. Pure mathematics; no file, no picture.
//!
//! ```text
//! x ~ N(0,1),  y_i = x + v_i,  v_i ~ N(0, σ²),  ẑ_i = K_i y_i          n agents
//! J(K)      = E Σ_ij S_ij (x − ẑ_i)(x − ẑ_j) / n²                      S_ii = p,  S_ij = q
//!           = (q (Σ_i (1−K_i))² + (p−q) Σ_i (1−K_i)² + p σ² Σ_i K_i²) / n²
//! J(K) − J* = (1/n²) (K−K*)ᵀ Γ (K−K*)
//!             Γ_ii = p (1+σ²),  Γ_ij = q,  η_i = p + (n−1) q,  Γ K* = η
//! BR_i(K)   = (η_i − Σ_{j≠i} Γ_ij K_j) / Γ_ii
//! K_i      <- K_i + w_i (BR_i(K) − K_i)      all i at once, from the same K
//! ```
//! The paper's case is p = q = 1, σ² = 0.5, n = 3, where `J` is the error of the team's mean estimate.
//!
//! With `w = 1` for all agents this is the simultaneous iterative best response (IIBR, Jacobi); with `w = 1` for one
//! agent in turn and 0 for the others, the sequential one (SIBR, Gauss–Seidel). Multi-timescale is in between: 1 for
//! the fast agent, ω for the others. That and a common `w` below 1 are our extensions of the example.

/// `K_i` by agent.
pub type Gains = Vec<f64>;
/// By row, then column.
pub type Matrix = Vec<Vec<f64>>;

/// Larger teams take long to compute and do not fit the tables.
pub const MOST_AGENTS: usize = 32;

/// The parameters of the example.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Problem {
    /// Weight of the square of each agent's error.
    p: f64,
    /// Weight of the product of two agents' errors.
    q: f64,
    /// `σ²`, the variance of `v_i`.
    variance: f64,
    /// `n`.
    agents: usize,
}

/// Why parameters are invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Unsolvable {
    #[error("`--n {0}`: expected a number of agents from 2 to {MOST_AGENTS}")]
    Agents(usize),
    #[error("`--{name} {found}`: expected {expected}")]
    Number { name: &'static str, found: f64, expected: &'static str },
    #[error(
        "p = {p}, q = {q}, variance = {variance}, n = {agents}: the cost has no single minimum; it has one where \
         p (1 + variance) is above q and above -(n - 1) q"
    )]
    NoMinimum { p: f64, q: f64, variance: f64, agents: usize },
}

impl Problem {
    /// The paper's example.
    pub const PAPER: Self = Self { p: 1.0, q: 1.0, variance: 0.5, agents: 3 };

    /// # Errors
    /// If a number is out of range, or the cost has no single minimum.
    pub fn new(p: f64, q: f64, variance: f64, agents: usize) -> Result<Self, Unsolvable> {
        /// Squares and products of such numbers are finite.
        const LARGEST: f64 = 1e9;
        let number = |name, found: f64, fits: bool, expected| match fits && found.abs() <= LARGEST {
            true => Ok(()),
            false => Err(Unsolvable::Number { name, found, expected }),
        };
        number("p", p, p >= 1e-9, "a weight from 1e-9 to 1e9")?;
        number("q", q, true, "a weight from -1e9 to 1e9")?;
        number("variance", variance, variance >= 0.0, "a variance from 0 to 1e9")?;
        if !(2..=MOST_AGENTS).contains(&agents) {
            return Err(Unsolvable::Agents(agents));
        }
        let problem = Self { p, q, variance, agents };
        // The eigenvalues of Γ: the first for the mean of the agents, the second for differences between them.
        if problem.diagonal() + problem.others() * q <= 0.0 || problem.diagonal() - q <= 0.0 {
            return Err(Unsolvable::NoMinimum { p, q, variance, agents });
        }
        Ok(problem)
    }

    pub fn p(&self) -> f64 {
        self.p
    }

    pub fn q(&self) -> f64 {
        self.q
    }

    pub fn variance(&self) -> f64 {
        self.variance
    }

    pub fn agents(&self) -> usize {
        self.agents
    }

    /// `n − 1`.
    fn others(&self) -> f64 {
        (self.agents - 1) as f64
    }

    /// `Γ_ii`.
    fn diagonal(&self) -> f64 {
        self.p * (1.0 + self.variance)
    }

    /// `η_i`.
    fn eta(&self) -> f64 {
        self.p + self.others() * self.q
    }

    /// `Γ_ij / Γ_ii`: an agent's best response moves by minus this when one other agent moves by one.
    fn coupling(&self) -> f64 {
        self.q / self.diagonal()
    }

    /// The start of every trajectory. Its mean is not that of K*, so IIBR diverges from here if it diverges at all.
    pub fn start(&self) -> Gains {
        vec![0.0; self.agents]
    }

    /// `Γ`.
    pub fn gamma(&self) -> Matrix {
        let entry = |i, j| if i == j { self.diagonal() } else { self.q };
        (0..self.agents).map(|i| (0..self.agents).map(|j| entry(i, j)).collect()).collect()
    }

    /// `J(K)`, the expected cost of the team's estimates.
    pub fn cost(&self, k: &[f64]) -> f64 {
        let errors = k.iter().map(|k| 1.0 - k);
        let (sum, squares) = (errors.clone().sum::<f64>(), errors.map(|e| e * e).sum::<f64>());
        let noise = self.p * self.variance * k.iter().map(|k| k * k).sum::<f64>();
        (self.q * sum * sum + (self.p - self.q) * squares + noise) / (self.agents * self.agents) as f64
    }

    /// `K*`: all entries are equal, so a row of `Γ K = η` gives them.
    pub fn fixed_point(&self) -> Gains {
        vec![self.eta() / (self.diagonal() + self.others() * self.q); self.agents]
    }

    /// `J(K) − J*`, without the cancellation of the plain difference near K*.
    pub fn excess_cost(&self, k: &[f64]) -> f64 {
        let d = || k.iter().zip(self.fixed_point()).map(|(k, star)| k - star);
        let (sum, squares) = (d().sum::<f64>(), d().map(|d| d * d).sum::<f64>());
        (self.q * sum * sum + (self.diagonal() - self.q) * squares) / (self.agents * self.agents) as f64
    }

    /// `max_i |K_i − K*_i|`.
    pub fn distance(&self, k: &[f64]) -> f64 {
        largest(k.iter().zip(self.fixed_point()).map(|(k, star)| (k - star).abs()))
    }

    /// `BR_i(K)`: the best `K_i` while the others keep theirs.
    pub fn best_response(&self, k: &[f64], i: usize) -> f64 {
        let others: f64 = k.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, k)| self.q * k).sum();
        (self.eta() - others) / self.diagonal()
    }

    /// `ρ(ω)` of one sweep of `n` updates, with turns of one update.
    pub fn rho(&self, omega: f64) -> f64 {
        spectral_radius(&Scheme::multi_timescale(omega, 1).sweep_matrix(self))
    }

    /// The ω between 0 and 1 with the smallest `ρ`, and that `ρ`: the best of a grid, then golden section between
    /// its neighbours.
    pub fn best_omega(&self) -> (f64, f64) {
        const GRID: usize = 400;
        let at = |i: usize| i as f64 / GRID as f64;
        let best = (0..=GRID).map(|i| (i, self.rho(at(i)))).min_by(|a, b| a.1.total_cmp(&b.1));
        let (best, at_best) = best.expect("the grid has points");
        let (mut low, mut high) = (at(best.saturating_sub(1)), at((best + 1).min(GRID)));
        let share = (5.0_f64.sqrt() - 1.0) / 2.0;
        while high - low > 1e-9 {
            let (left, right) = (high - share * (high - low), low + share * (high - low));
            if self.rho(left) < self.rho(right) {
                high = right;
            } else {
                low = left;
            }
        }
        let omega = 0.5 * (low + high);
        // At an end of the interval the grid's own point can be the best.
        let least = self.rho(omega);
        if least <= at_best {
            (omega, least)
        } else {
            (at(best), at_best)
        }
    }

    /// The ω from which on the scheme does not converge: `ρ = 1`, between the best ω and 1. `None` if it converges for
    /// every ω.
    pub fn stability_limit(&self) -> Option<f64> {
        let (mut stable, mut unstable) = (self.best_omega().0, 1.0);
        if self.rho(unstable) < 1.0 {
            return None;
        }
        while unstable - stable > 1e-12 {
            let middle = 0.5 * (stable + unstable);
            if self.rho(middle) < 1.0 {
                stable = middle;
            } else {
                unstable = middle;
            }
        }
        Some(unstable)
    }

    /// The common factor `w` with which simultaneous updates converge fastest: it makes the two eigenvalues of an
    /// update equal in modulus, `1 − w (1 + (n−1) c)` and `1 − w (1 − c)` with the coupling `c`.
    pub fn best_damping(&self) -> f64 {
        2.0 / (2.0 + (self.others() - 1.0) * self.coupling())
    }
}

/// A scheme of updates: `fast` is the weight of the agent whose turn it is, `slow` that of the others. The turn goes
/// to the next agent after `period` updates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scheme {
    pub fast: f64,
    pub slow: f64,
    /// Updates per turn; 0 counts as 1.
    pub period: usize,
}

impl Scheme {
    /// All agents move to their best responses at once.
    pub const IIBR: Self = Self::damped(1.0);
    /// One agent after another moves to its best response.
    pub const SIBR: Self = Self::multi_timescale(0.0, 1);

    /// The fast agent moves to its best response, the others by the share `omega` of the way.
    pub const fn multi_timescale(omega: f64, period: usize) -> Self {
        Self { fast: 1.0, slow: omega, period }
    }

    /// All agents move by the share `w` of the way at once.
    pub const fn damped(w: f64) -> Self {
        Self { fast: w, slow: w, period: 1 }
    }

    /// `w_i` in update `u` of `n` agents.
    fn weight(&self, u: usize, i: usize, n: usize) -> f64 {
        if i == u / self.period.max(1) % n {
            self.fast
        } else {
            self.slow
        }
    }

    /// `K` after update `u`.
    pub fn step(&self, problem: &Problem, k: &[f64], u: usize) -> Gains {
        let towards = |(i, k_i): (usize, &f64)| {
            k_i + self.weight(u, i, problem.agents) * (problem.best_response(k, i) - k_i)
        };
        k.iter().enumerate().map(towards).collect()
    }

    /// `K` before the first update and after each of `updates`.
    pub fn trajectory(&self, problem: &Problem, updates: usize) -> Vec<Gains> {
        let mut k = problem.start();
        let after = (0..updates).map(|u| {
            k = self.step(problem, &k, u);
            k.clone()
        });
        std::iter::once(problem.start()).chain(after).collect()
    }

    /// `A` with `K − K* <- A (K − K*)` in update `u`, from the equations:
    /// `A_ij = −w_i Γ_ij / Γ_ii`, and `1 − w_i` on the diagonal.
    pub fn update_matrix(&self, problem: &Problem, u: usize) -> Matrix {
        let n = problem.agents;
        let entry = |i, j| match (self.weight(u, i, n), i == j) {
            (w, true) => 1.0 - w,
            (w, false) => -w * problem.coupling(),
        };
        (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
    }

    /// The product over one sweep, in which every agent has its turn once: `n · period` updates.
    pub fn sweep_matrix(&self, problem: &Problem) -> Matrix {
        let n = problem.agents;
        let mut sweep: Matrix =
            (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect();
        for u in 0..n * self.period.max(1) {
            // Row i becomes (1 − w_i) of itself, less w_i c of every other row: no matrix product is needed.
            let sums: Gains = (0..n).map(|j| sweep.iter().map(|row| row[j]).sum()).collect();
            for (i, row) in sweep.iter_mut().enumerate() {
                let w = self.weight(u, i, n);
                for (entry, sum) in row.iter_mut().zip(&sums) {
                    *entry = (1.0 - w) * *entry - w * problem.coupling() * (sum - *entry);
                }
            }
        }
        sweep
    }

    /// Number of updates from the start until `max_i |K_i − K*_i| < tolerance`; `None` if not within `limit`.
    pub fn updates_until(&self, problem: &Problem, tolerance: f64, limit: usize) -> Option<usize> {
        let mut k = problem.start();
        for u in 0..=limit {
            let distance = problem.distance(&k);
            if distance < tolerance {
                return Some(u);
            }
            if !distance.is_finite() {
                return None;
            }
            k = self.step(problem, &k, u);
        }
        None
    }
}

/// A complex number `re + i im`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eigenvalue {
    pub re: f64,
    pub im: f64,
}

impl Eigenvalue {
    pub fn modulus(&self) -> f64 {
        self.re.hypot(self.im)
    }
}

/// The eigenvalues of a matrix of three rows and columns: the roots of its characteristic polynomial, the isolated
/// real one first. `None` for another matrix. A double root is accurate to about half the digits, as with every method
/// that starts from the coefficients.
pub fn eigenvalues(a: &Matrix) -> Option<[Eigenvalue; 3]> {
    if a.len() != 3 {
        return None;
    }
    // det(λ − A) = λ³ − t λ² + m λ − d
    let minor = |i: usize, j: usize| a[i][i] * a[j][j] - a[i][j] * a[j][i];
    let t = a[0][0] + a[1][1] + a[2][2];
    let m = minor(0, 1) + minor(0, 2) + minor(1, 2);
    let d = a[0][0] * minor(1, 2) - a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0])
        + a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);

    let r = isolated_root(t, m, d);
    // What remains after division by λ − r: λ² − 2 h λ + q.
    let (h, q) = ((t - r) / 2.0, m - r * (t - r));
    let discriminant = h * h - q;
    let root = discriminant.abs().sqrt();
    let pair = match discriminant >= 0.0 {
        true => [Eigenvalue { re: h + root, im: 0.0 }, Eigenvalue { re: h - root, im: 0.0 }],
        false => [Eigenvalue { re: h, im: root }, Eigenvalue { re: h, im: -root }],
    };
    Some([Eigenvalue { re: r, im: 0.0 }, pair[0], pair[1]])
}

/// A real root of `p(λ) = λ³ − t λ² + m λ − d` that is not part of a double one (unless all three
/// are equal). `p` has its inflection at `λ = t/3`. On the side given by the sign of its value there it crosses zero
/// exactly once, so bisection finds the root. If that value is zero, `λ = t/3` is the root.
fn isolated_root(t: f64, m: f64, d: f64) -> f64 {
    let p = |x: f64| ((x - t) * x + m) * x - d;
    // No root is larger in modulus than this (Cauchy).
    let bound = 1.0 + t.abs().max(m.abs()).max(d.abs());
    let centre = t / 3.0;
    if p(centre) == 0.0 {
        return centre;
    }
    let (mut low, mut high) = if p(centre) > 0.0 { (-bound, centre) } else { (centre, bound) };
    loop {
        let middle = 0.5 * (low + high);
        // The interval cannot be split: its ends are neighbours (or NaN).
        if !(low < middle && middle < high) {
            return middle;
        }
        if p(middle) > 0.0 {
            high = middle;
        } else {
            low = middle;
        }
    }
}

/// The largest modulus of an eigenvalue: below 1 the iteration converges from any start. It is the limit of
/// `‖A^m‖^(1/m)`. Squaring 50 times makes `m` so large that neither the choice of the norm nor a rounding error in a
/// late square matters.
pub fn spectral_radius(a: &Matrix) -> f64 {
    /// `m = 2^50`.
    const SQUARINGS: i32 = 50;
    let (mut power, mut log_radius) = (a.clone(), 0.0);
    for squared in 0..=SQUARINGS {
        // Scaled to 1 before each square against overflow; the scale is stored as a logarithm.
        let norm = largest(power.iter().flatten().map(|entry| entry.abs()));
        if norm == 0.0 || !norm.is_finite() {
            return norm;
        }
        log_radius += norm.ln() / 2_f64.powi(squared);
        power.iter_mut().flatten().for_each(|entry| *entry /= norm);
        power = product(&power, &power);
    }
    log_radius.exp()
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut product = vec![vec![0.0; b[0].len()]; a.len()];
    for (row, out) in a.iter().zip(&mut product) {
        for (factor, other) in row.iter().zip(b) {
            out.iter_mut().zip(other).for_each(|(out, entry)| *out += factor * entry);
        }
    }
    product
}

/// Unlike `f64::max`, returns NaN if any value is NaN: a diverged distance must not look small.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |a, b| if a.is_nan() || a > b { a } else { b })
}

#[cfg(test)]
#[path = "estimation_tests.rs"]
mod tests;
