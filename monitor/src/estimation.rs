//! The analytic example: three agents estimate one number, each from its own noisy view of it.
//! Small enough for exact answers, and it shows why agents should learn on different timescales
//! (spec §10). Pure mathematics; no file, no picture.
//!
//! ```text
//! x ~ N(0,1),  y_i = x + v_i,  v_i ~ N(0, 0.5),  ẑ_i = K_i y_i
//! J(K)      = E (x − (ẑ_1+ẑ_2+ẑ_3)/3)² = (1 − mean K)² + (0.5/9) Σ K_i²
//! J(K) − J* = (1/9) (K−K*)ᵀ Γ (K−K*)        Γ = 0.5 I + ones,  η = (3,3,3),  Γ K* = η
//! BR_i(K)   = (η_i − Σ_{j≠i} Γ_ij K_j) / Γ_ii
//! K_i      <- K_i + w_i (BR_i(K) − K_i)      all i at once, from the same K
//! ```
//! `w = 1` for all is the iterative best response all at once (IIBR, Jacobi), `w = 1` for one agent
//! in turn and 0 for the others the sequential one (SIBR, Gauss–Seidel). Multi-timescale is in
//! between: 1 for the fast agent, ω for the others. That last one is our extension of the example.

/// The fixed point is symmetric in the agents, but the schemes are not.
pub const AGENTS: usize = 3;
/// Variance of `v_i`.
pub const NOISE_VARIANCE: f64 = 0.5;
/// `η_i`.
const ETA: f64 = AGENTS as f64;
/// Where every trajectory starts. Its mean is not that of K*, so IIBR diverges from here.
pub const START: Gains = [0.0; AGENTS];

/// `K_i` by agent.
pub type Gains = [f64; AGENTS];
/// By row, then column.
pub type Matrix = [[f64; AGENTS]; AGENTS];

/// `Γ`.
pub fn gamma() -> Matrix {
    let mut gamma = [[1.0; AGENTS]; AGENTS];
    (0..AGENTS).for_each(|i| gamma[i][i] += NOISE_VARIANCE);
    gamma
}

/// `J(K)`, the expected squared error of the team's estimate.
pub fn cost(k: &Gains) -> f64 {
    let n = AGENTS as f64;
    let mean = k.iter().sum::<f64>() / n;
    let squares: f64 = k.iter().map(|k| k * k).sum();
    (1.0 - mean).powi(2) + NOISE_VARIANCE / (n * n) * squares
}

/// `K*`: all entries are equal, so a row of `Γ K = η` gives them.
pub fn fixed_point() -> Gains {
    [ETA / gamma()[0].iter().sum::<f64>(); AGENTS]
}

/// `J(K) − J*`, without the cancellation of the plain difference near K*.
pub fn excess_cost(k: &Gains) -> f64 {
    let (star, gamma) = (fixed_point(), gamma());
    let d: Gains = std::array::from_fn(|i| k[i] - star[i]);
    let form: f64 = (0..AGENTS).map(|i| (0..AGENTS).map(|j| d[i] * gamma[i][j] * d[j]).sum::<f64>()).sum();
    form / (AGENTS * AGENTS) as f64
}

/// `|K − K*|`: the largest difference of an entry, which is the norm behind the spec's counts.
pub fn distance(k: &Gains) -> f64 {
    largest(k.iter().zip(fixed_point()).map(|(k, star)| (k - star).abs()))
}

/// `BR_i(K)`: the best `K_i` while the others keep theirs.
pub fn best_response(k: &Gains, i: usize) -> f64 {
    let gamma = gamma();
    let others: f64 = (0..AGENTS).filter(|&j| j != i).map(|j| gamma[i][j] * k[j]).sum();
    (ETA - others) / gamma[i][i]
}

/// Who moves how far: `fast` is the weight of the agent whose turn it is, `slow` of the others;
/// turns go round after `period` updates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scheme {
    pub fast: f64,
    pub slow: f64,
    /// Updates per turn; 0 counts as 1.
    pub period: usize,
}

impl Scheme {
    /// All agents go to their best response at once.
    pub const IIBR: Self = Self::damped(1.0);
    /// One agent after the other goes to its best response.
    pub const SIBR: Self = Self::multi_timescale(0.0, 1);

    /// The fast agent goes to its best response, the others the share `omega` of the way.
    pub const fn multi_timescale(omega: f64, period: usize) -> Self {
        Self { fast: 1.0, slow: omega, period }
    }

    /// All agents go the share `w` of the way at once.
    pub const fn damped(w: f64) -> Self {
        Self { fast: w, slow: w, period: 1 }
    }

    /// `w` in update `u`.
    pub fn weights(&self, u: usize) -> Gains {
        let fast = u / self.period.max(1) % AGENTS;
        std::array::from_fn(|i| if i == fast { self.fast } else { self.slow })
    }

    /// `K` after update `u`.
    pub fn step(&self, k: &Gains, u: usize) -> Gains {
        let w = self.weights(u);
        std::array::from_fn(|i| k[i] + w[i] * (best_response(k, i) - k[i]))
    }

    /// `K` before the first update and after each of `updates`.
    pub fn trajectory(&self, updates: usize) -> Vec<Gains> {
        let mut k = START;
        let after = (0..updates).map(|u| {
            k = self.step(&k, u);
            k
        });
        std::iter::once(START).chain(after).collect()
    }

    /// `A` with `K − K* <- A (K − K*)` in update `u`, read off the equations:
    /// `A_ij = −w_i Γ_ij / Γ_ii`, and `1 − w_i` on the diagonal.
    pub fn update_matrix(&self, u: usize) -> Matrix {
        let (w, gamma) = (self.weights(u), gamma());
        std::array::from_fn(|i| {
            std::array::from_fn(|j| if i == j { 1.0 - w[i] } else { -w[i] * gamma[i][j] / gamma[i][i] })
        })
    }

    /// The product over one sweep, in which every agent has its turn once: `3 · period` updates.
    pub fn sweep_matrix(&self) -> Matrix {
        let first = self.update_matrix(0);
        (1..AGENTS * self.period.max(1)).fold(first, |sweep, u| product(&self.update_matrix(u), &sweep))
    }

    /// How many updates from [`START`] until `|K − K*| < tolerance`; `None` if not within `limit`.
    pub fn updates_until(&self, tolerance: f64, limit: usize) -> Option<usize> {
        let mut k = START;
        for u in 0..=limit {
            if distance(&k) < tolerance {
                return Some(u);
            }
            k = self.step(&k, u);
        }
        None
    }
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..AGENTS).map(|l| a[i][l] * b[l][j]).sum()))
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

/// The roots of the characteristic polynomial, the isolated real one first. A double root is found
/// to about half the digits, as by every method that starts from the coefficients.
pub fn eigenvalues(a: &Matrix) -> [Eigenvalue; AGENTS] {
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
    [Eigenvalue { re: r, im: 0.0 }, pair[0], pair[1]]
}

/// A real root of `p(λ) = λ³ − t λ² + m λ − d` that is not part of a double one (unless all three
/// are equal). `p` bends one way left of `λ = t/3` and the other way right of it, so on the side
/// to which its value there points it crosses zero exactly once: bisection cannot miss. Where that
/// value is zero, the root is found.
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
        // The interval no longer splits: its ends are neighbours (or not numbers).
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

/// The largest modulus of an eigenvalue: below 1 the iteration converges, from any start.
pub fn spectral_radius(a: &Matrix) -> f64 {
    largest(eigenvalues(a).iter().map(Eigenvalue::modulus))
}

/// Unlike `f64::max`, lets a value that is not a number win: a diverged distance is not a small one.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |a, b| if a.is_nan() || a > b { a } else { b })
}

/// `ρ(ω)` of one sweep of three updates, with turns of one update.
pub fn rho(omega: f64) -> f64 {
    spectral_radius(&Scheme::multi_timescale(omega, 1).sweep_matrix())
}

/// The ω between 0 and 1 with the smallest `ρ`, and that `ρ`: the best of a thousand, then golden
/// section between its neighbours.
pub fn best_omega() -> (f64, f64) {
    const GRID: usize = 1000;
    let at = |i: usize| i as f64 / GRID as f64;
    let best = (0..=GRID).min_by(|a, b| rho(at(*a)).total_cmp(&rho(at(*b)))).unwrap_or(0);
    let (mut low, mut high) = (at(best.saturating_sub(1)), at((best + 1).min(GRID)));
    let share = (5.0_f64.sqrt() - 1.0) / 2.0;
    while high - low > 1e-9 {
        let (left, right) = (high - share * (high - low), low + share * (high - low));
        if rho(left) < rho(right) {
            high = right;
        } else {
            low = left;
        }
    }
    let omega = 0.5 * (low + high);
    (omega, rho(omega))
}

/// The ω from which on the scheme no longer converges: `ρ = 1`, between the best ω and 1.
pub fn stability_limit() -> f64 {
    let (mut stable, mut unstable) = (best_omega().0, 1.0);
    while unstable - stable > 1e-12 {
        let middle = 0.5 * (stable + unstable);
        if rho(middle) < 1.0 {
            stable = middle;
        } else {
            unstable = middle;
        }
    }
    unstable
}

#[cfg(test)]
#[path = "estimation_tests.rs"]
mod tests;
