//! Gradient clipping and Adam (β 0.9 / 0.999, ε 1e-8), one pass over a flat parameter vector.
//!
//! Our own code, because resuming a run exactly needs the moments, which candle-nn's optimiser keeps private, and
//! because the learning rate changes between update calls while the moments stay (algorithms §6.4).

use crate::kernels::math::{sum_of_squares, vectorized};

const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Moments and step count of one parameter vector.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Adam {
    /// First moments.
    pub m: Vec<f32>,
    /// Second moments.
    pub v: Vec<f32>,
    /// Steps taken.
    pub steps: u64,
}

impl Adam {
    /// Zero moments for `n` parameters.
    pub fn new(n: usize) -> Self {
        Self { m: vec![0.0; n], v: vec![0.0; n], steps: 0 }
    }

    /// Scales a longer gradient down to the norm `max_norm`, then calls [`Adam::step`]. Returns the norm before. With
    /// `hold_frozen` the moments do not change at learning rate 0.
    pub fn clipped_step(
        &mut self,
        parameters: &mut [f32],
        gradient: &[f32],
        max_norm: f64,
        lr: f64,
        hold_frozen: bool,
    ) -> f64 {
        let (norm, factor) = clip(gradient, max_norm);
        if lr > 0.0 || !hold_frozen {
            self.step(parameters, gradient, factor, lr);
        }
        norm
    }

    /// One step with learning rate `lr` on `gradient * scale`.
    ///
    /// With `lr = 0` the moments and the step count change and the parameters do not.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], scale: f32, lr: f64) {
        self.steps += 1;
        let t = self.steps as f64;
        let step_size = (lr / (1.0 - f64::from(BETA_1).powf(t))) as f32;
        // The inverse, because a division for each parameter costs as much as all the rest but the root.
        let root_correction = (1.0 / (1.0 - f64::from(BETA_2).powf(t)).sqrt()) as f32;
        let (m, v) = (&mut self.m[..], &mut self.v[..]);
        vectorized(|| {
            for (((p, g), m), v) in parameters.iter_mut().zip(gradient).zip(m).zip(v) {
                let g = g * scale;
                *m = BETA_1 * *m + (1.0 - BETA_1) * g;
                *v = BETA_2 * *v + (1.0 - BETA_2) * g * g;
                *p -= step_size * (*m / (v.sqrt() * root_correction + EPSILON));
            }
        });
    }
}

/// L2 norm of a gradient, and the factor that scales it down to `max_norm` (1 if it is below).
fn clip(gradient: &[f32], max_norm: f64) -> (f64, f32) {
    let norm = sum_of_squares(gradient).sqrt();
    // The small constant is PyTorch's, so that clipped steps agree with it.
    (norm, (max_norm / (norm + 1e-6)).min(1.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_two_steps_are_those_computed_by_hand() {
        // Step 1: m̂ = g, v̂ = g², so p moves by lr·sign(g). Step 2, gradient 3 after 1:
        // m̂ = (0.9·0.1·1 + 0.1·3) / (1 − 0.81) = 2.0526316, v̂ = (0.999·0.001 + 0.001·9) / (1 − 0.998001)
        //    = 5.0020010, Δ = 0.1·2.0526316 / 2.2365153 = 0.0917780
        let mut adam = Adam::new(1);
        let mut p = [1.0];
        adam.step(&mut p, &[1.0], 1.0, 0.1);
        assert!((p[0] - 0.9).abs() < 1e-6, "{p:?}");
        adam.step(&mut p, &[3.0], 1.0, 0.1);
        assert!((p[0] - (0.9 - 0.091_778_0)).abs() < 1e-6, "{p:?}");
    }

    #[test]
    fn rate_zero_moves_the_moments_but_not_one_bit_of_the_parameters() {
        let mut adam = Adam::new(2);
        let mut p = [0.3, -0.7];
        adam.step(&mut p, &[1.0, -2.0], 1.0, 0.0);
        assert_eq!(p, [0.3, -0.7]);
        assert!(adam.m[0] > 0.0 && adam.v[1] > 0.0 && adam.steps == 1);
    }

    #[test]
    fn a_long_gradient_is_shortened_to_the_norm_and_a_short_one_is_left_alone() {
        let (norm, factor) = clip(&[30.0, 40.0], 10.0);
        assert_eq!(norm, 50.0);
        assert!((factor - 0.2).abs() < 1e-7);
        assert_eq!(clip(&[3.0, 4.0], 10.0), (5.0, 1.0));
    }
}
