//! A linear layer with or without ReLU, forward and backward.
//!
//! ```text
//! y  = x W + b                         x: rows × in,  W: in × out,  b: out
//! dW = xᵀ dy     db = Σ_rows dy        dx = dy Wᵀ
//! ```
//!
//! Weights are stored `in × out`, the transpose of PyTorch's, so neither the forward product of a few rows nor the
//! weight gradient needs a repacked copy.

use super::gemm::{add_product, product, Matrix};
use super::math::{add_rows, fill_rows, vectorized};

/// Borrowed weights of one layer.
#[derive(Clone, Copy, Debug)]
pub struct Linear<'a> {
    /// `in × out`.
    pub weight: &'a [f32],
    /// `out`.
    pub bias: &'a [f32],
}

impl Linear<'_> {
    fn sizes(&self) -> (usize, usize) {
        (self.weight.len() / self.bias.len(), self.bias.len())
    }

    /// `y = x W + b`; `y` is resized to `rows × out`.
    pub fn forward(&self, x: &[f32], rows: usize, y: &mut Vec<f32>) {
        let (inputs, outputs) = self.sizes();
        y.resize(rows * outputs, 0.0);
        fill_rows(y, self.bias);
        add_product(y, Matrix::new(x, rows, inputs), Matrix::new(self.weight, inputs, outputs));
    }

    /// `y = max(x W + b, 0)`.
    pub fn forward_relu(&self, x: &[f32], rows: usize, y: &mut Vec<f32>) {
        self.forward(x, rows, y);
        relu(y);
    }

    /// `dx = dy Wᵀ`; `dx` is resized to `rows × in`.
    pub fn input_gradient(&self, dy: &[f32], rows: usize, dx: &mut Vec<f32>) {
        let (inputs, outputs) = self.sizes();
        dx.resize(rows * inputs, 0.0);
        product(dx, Matrix::new(dy, rows, outputs), Matrix::new(self.weight, inputs, outputs).t());
    }
}

/// Adds `xᵀ dy` to `dW` and `Σ_rows dy` to `db`.
pub fn add_weight_gradient(x: &[f32], dy: &[f32], rows: usize, d_weight: &mut [f32], d_bias: &mut [f32]) {
    let outputs = d_bias.len();
    let inputs = d_weight.len() / outputs;
    add_product(d_weight, Matrix::new(x, rows, inputs).t(), Matrix::new(dy, rows, outputs));
    add_rows(d_bias, &dy[..rows * outputs]);
}

/// `y = max(y, 0)` in place.
pub fn relu(y: &mut [f32]) {
    vectorized(|| y.iter_mut().for_each(|y| *y = y.max(0.0)));
}

/// Zeroes `dy` where the layer's output `y` is not positive (relu'(0) = 0, as in PyTorch).
pub fn relu_backward(y: &[f32], dy: &mut [f32]) {
    vectorized(|| {
        for (y, dy) in y.iter().zip(dy) {
            *dy = if *y > 0.0 { *dy } else { 0.0 };
        }
    });
}
