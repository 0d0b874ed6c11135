//! The policy: masked softmax, sampling, and the clipped objective with its gradient with respect to the logits.

use crate::kernels::math::{exp, ln};

/// Added to a probability before its logarithm (algorithms §3.2).
const TINY: f32 = 1e-10;

/// Turns logits into probabilities in place. Unavailable actions, whose logits become −1e10, get exactly 0
/// (algorithms §3.1). If no action is available, the result is uniform, as in the reference.
pub fn softmax(logits: &mut [f32], avail: &[u8]) {
    for (logit, &allowed) in logits.iter_mut().zip(avail) {
        *logit = if allowed != 0 { *logit } else { -1e10 };
    }
    let max = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let mut sum = 0.0;
    for logit in logits.iter_mut() {
        let distance = *logit - max;
        // `exp` does not underflow to zero by itself.
        *logit = if distance < -80.0 { 0.0 } else { exp(distance) };
        sum += *logit;
    }
    logits.iter_mut().for_each(|p| *p /= sum);
}

/// The action whose share of `[0, 1)` contains `u`.
pub fn sample(probabilities: &[f32], u: f32) -> u16 {
    let mut sum = 0.0;
    let mut last = 0;
    for (action, &p) in probabilities.iter().enumerate() {
        if p > 0.0 {
            sum += p;
            last = action;
            if u < sum {
                break;
            }
        }
    }
    // Rounding can leave the sum below `u`. The last possible action is taken then.
    last as u16
}

/// The action with the largest probability, the lowest of equals.
pub fn most_probable(probabilities: &[f32]) -> u16 {
    let best = |best: usize, action: usize| {
        if probabilities[action] > probabilities[best] {
            action
        } else {
            best
        }
    };
    (0..probabilities.len()).fold(0, best) as u16
}

/// The rows and constants of the clipped objective.
#[derive(Debug)]
pub struct Terms<'a> {
    /// `rows × n_actions`.
    pub avail: &'a [u8],
    /// By row.
    pub actions: &'a [u16],
    /// `A` by row.
    pub advantages: &'a [f32],
    /// ε.
    pub clip: f32,
    /// `c_ent`.
    pub entropy_coef: f32,
    /// `1 / (n Σ m)`, of the whole batch.
    pub scale: f32,
}

/// Sums over the rows.
#[derive(Debug)]
pub struct Found {
    /// `−Σ (S + c_ent H)`.
    pub loss: f64,
    /// `Σ H`.
    pub entropy: f64,
    /// Rows with a ratio outside the clip range.
    pub clipped: u32,
}

impl Terms<'_> {
    fn n_actions(&self) -> usize {
        self.avail.len() / self.actions.len()
    }

    /// Appends `log(π(a) + 1e-10)` of the actions taken to `out`.
    pub fn log_probabilities(&self, logits: &[f32], out: &mut Vec<f32>) {
        let n = self.n_actions();
        let mut pi = vec![0.0; n];
        for (row, &action) in self.actions.iter().enumerate() {
            pi.copy_from_slice(&logits[row * n..(row + 1) * n]);
            softmax(&mut pi, &self.avail[row * n..(row + 1) * n]);
            out.push(ln(pi[usize::from(action)] + TINY));
        }
    }

    /// Writes the gradient of the actor loss with respect to the logits into `d_logits` (`rows × n_actions`).
    ///
    /// ```text
    /// g_k = ∂L/∂π_k = −scale ( [k = a] A ρ / (π(a) + 1e-10) − c_ent (log(π_k + 1e-10) + π_k / (π_k + 1e-10)) )
    /// ∂L/∂logit_j = π_j ( g_j − Σ_k g_k π_k )
    /// ```
    ///
    /// The first term is absent where the minimum selects the clipped branch outside its range.
    pub fn gradient(&self, logits: &[f32], log_p_old: &[f32], d_logits: &mut Vec<f32>) -> Found {
        let n = self.n_actions();
        d_logits.resize(logits.len(), 0.0);
        let mut pi = vec![0.0; n];
        let (mut surrogate_sum, mut entropy_sum, mut clipped_count) = (0.0f64, 0.0f64, 0u32);
        for (row, &action) in self.actions.iter().enumerate() {
            let span = row * n..(row + 1) * n;
            let (action, adv) = (usize::from(action), self.advantages[row]);
            pi.copy_from_slice(&logits[span.clone()]);
            softmax(&mut pi, &self.avail[span.clone()]);

            let rho = exp(ln(pi[action] + TINY) - log_p_old[row]);
            let clipped = rho.clamp(1.0 - self.clip, 1.0 + self.clip);
            let surrogate = (rho * adv).min(clipped * adv);
            let flows = rho == clipped || rho * adv < clipped * adv;
            clipped_count += u32::from(rho != clipped);

            let g = &mut d_logits[span];
            let mut entropy = 0.0;
            let mut g_dot_pi = 0.0;
            for (k, (g, &p)) in g.iter_mut().zip(&pi).enumerate() {
                let log_p = ln(p + TINY);
                entropy -= p * log_p;
                let by_entropy = -(log_p + p / (p + TINY));
                let by_surrogate = if k == action && flows { adv * rho / (p + TINY) } else { 0.0 };
                *g = -self.scale * (by_surrogate + self.entropy_coef * by_entropy);
                g_dot_pi += *g * p;
            }
            for (g, &p) in g.iter_mut().zip(&pi) {
                *g = p * (*g - g_dot_pi);
            }
            surrogate_sum += f64::from(surrogate);
            entropy_sum += f64::from(entropy);
        }
        Found {
            loss: -(surrogate_sum + f64::from(self.entropy_coef) * entropy_sum),
            entropy: entropy_sum,
            clipped: clipped_count,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forbidden_actions_have_probability_zero_and_are_never_sampled() {
        let mut p = [5.0, 1.0, 1.0];
        softmax(&mut p, &[0, 1, 1]);
        assert_eq!(p, [0.0, 0.5, 0.5]);
        let drawn: Vec<_> = [0.0, 0.49, 0.5, 0.999_999_9].map(|u| sample(&p, u)).into();
        assert_eq!(drawn, [1, 1, 2, 2]);
        assert_eq!(sample(&[0.3, 0.3, 0.0], 0.999), 1, "rounding never reaches an impossible action");
    }

    #[test]
    fn the_greedy_choice_is_the_most_probable_action_and_the_first_of_equals() {
        assert_eq!(most_probable(&[0.2, 0.5, 0.3]), 1);
        assert_eq!(most_probable(&[0.0, 0.4, 0.4, 0.2]), 1);
    }

    /// `L(logits)` in double precision, directly from the equations.
    fn plain_loss(terms: &Terms, logits: &[f64], log_p_old: &[f32]) -> f64 {
        let n = terms.n_actions();
        let mut loss = 0.0;
        for (row, &action) in terms.actions.iter().enumerate() {
            let e: Vec<f64> = (0..n)
                .map(|k| if terms.avail[row * n + k] != 0 { logits[row * n + k].exp() } else { 0.0 })
                .collect();
            let pi: Vec<f64> = e.iter().map(|x| x / e.iter().sum::<f64>()).collect();
            let rho = ((pi[usize::from(action)] + 1e-10).ln() - f64::from(log_p_old[row])).exp();
            let (adv, eps) = (f64::from(terms.advantages[row]), f64::from(terms.clip));
            let s = (rho * adv).min(rho.clamp(1.0 - eps, 1.0 + eps) * adv);
            let h = -pi.iter().map(|p| p * (p + 1e-10).ln()).sum::<f64>();
            loss -= f64::from(terms.scale) * (s + f64::from(terms.entropy_coef) * h);
        }
        loss
    }

    #[test]
    fn the_gradient_by_the_logits_agrees_with_finite_differences_in_every_branch_of_the_clip() {
        // Ratios below, inside and above the range, with advantages of both signs, and one mask.
        let logits = [0.3, -1.0, 0.8, 0.1, 0.2, -0.4, 1.2, 0.0, 0.5, -0.2, 0.9, 0.4f32];
        let avail = [1, 1, 1, 1, 1, 1, 1, 0, 1, 1, 1, 1];
        let log_p_old = [-0.5, -2.5, -0.9, -3.0f32];
        for sign in [1.0, -1.0] {
            let terms = Terms {
                avail: &avail,
                actions: &[2, 0, 2, 1],
                advantages: &[1.5 * sign, 0.7 * sign, -0.3 * sign, 2.0 * sign],
                clip: 0.2,
                entropy_coef: 0.05,
                scale: 0.125,
            };
            let mut found = Vec::new();
            let report = terms.gradient(&logits, &log_p_old, &mut found);
            let logits: Vec<f64> = logits.iter().map(|&x| f64::from(x)).collect();
            let loss = plain_loss(&terms, &logits, &log_p_old);
            assert!((report.loss - loss / 0.125).abs() < 4e-6, "{} {loss}", report.loss);
            for j in 0..logits.len() {
                let at = |h: f64| {
                    let mut moved = logits.clone();
                    moved[j] += h;
                    plain_loss(&terms, &moved, &log_p_old)
                };
                let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
                assert!((f64::from(found[j]) - expected).abs() < 2e-6, "logit {j}: {} {expected}", found[j]);
            }
        }
    }

    #[test]
    fn with_the_acting_policy_the_ratio_is_one_and_the_gradient_is_that_of_a2c() {
        // ∂/∂logit_j of −A log π(a) is −A ([j = a] − π_j) (algorithms §12, check 9).
        let logits = [0.3, -1.0, 0.8, 0.1f32];
        let terms = Terms {
            avail: &[1; 4],
            actions: &[2],
            advantages: &[1.7],
            clip: 0.2,
            entropy_coef: 0.0,
            scale: 1.0,
        };
        let (mut log_p, mut found) = (Vec::new(), Vec::new());
        terms.log_probabilities(&logits, &mut log_p);
        let report = terms.gradient(&logits, &log_p, &mut found);
        assert_eq!(report.clipped, 0);
        assert!((report.loss + 1.7).abs() < 1e-6);
        let mut pi = logits;
        softmax(&mut pi, &[1; 4]);
        for j in 0..4 {
            let expected = -1.7 * (f32::from(u8::from(j == 2)) - pi[j]);
            assert!((found[j] - expected).abs() < 1e-6, "{found:?}");
        }
    }
}
