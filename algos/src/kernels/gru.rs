//! A gated recurrent unit over a batch of sequences, forward and backward through time.
//!
//! PyTorch's form, with the reset gate after the recurrent matrix and its bias (algorithms §1.1):
//!
//! ```text
//! r  = σ(x W_ir + b_ir + h W_hr + b_hr)          z = σ(x W_iz + b_iz + h W_hz + b_hz)
//! c  = tanh(x W_in + b_in + r ⊙ (h W_hn + b_hn))
//! h' = (1 − z) ⊙ c + z ⊙ h
//! ```
//!
//! The products of the inputs with `W_i` and those of both weight gradients are computed once for all time steps.
//! Only the recurrent product is inside the loop over time. Rows are packed by time ([`Steps`]), so finished sequences
//! cost nothing.

use super::gemm::{add_product, product, Matrix};
use super::math::{add_rows, fill_rows, sigmoid, tanh, vectorized};

/// How the rows of a batch of sequences are packed: time step by time step, the longest sequence first.
///
/// Row `offset(t) + k` is step `t` of the `k`-th longest sequence; the sequences that are still running
/// at `t` are always the first `count(t)` ones.
#[derive(Clone, Debug, Default)]
pub struct Steps {
    counts: Vec<usize>,
    offsets: Vec<usize>,
    rows: usize,
}

impl Steps {
    /// For sequences of these lengths, in descending order.
    pub fn of_lengths(lengths: &[usize]) -> Self {
        debug_assert!(lengths.windows(2).all(|w| w[0] >= w[1]), "longest first");
        let longest = lengths.first().copied().unwrap_or(0);
        let mut running = lengths.len();
        let count = |t: usize| {
            while lengths[running - 1] <= t {
                running -= 1;
            }
            running
        };
        let counts: Vec<usize> = (0..longest).map(count).collect();
        let offsets = counts.iter().scan(0, |sum, n| {
            let offset = *sum;
            *sum += n;
            Some(offset)
        });
        Self { offsets: offsets.collect(), rows: counts.iter().sum(), counts }
    }

    /// Number of time steps, `T`.
    pub fn len(&self) -> usize {
        self.counts.len()
    }

    /// True when there is no step at all.
    pub fn is_empty(&self) -> bool {
        self.counts.is_empty()
    }

    /// Sequences running at step `t`.
    pub fn count(&self, t: usize) -> usize {
        self.counts[t]
    }

    /// The first row of step `t`.
    pub fn offset(&self, t: usize) -> usize {
        self.offsets[t]
    }

    /// All rows.
    pub fn rows(&self) -> usize {
        self.rows
    }
}

/// Borrowed weights; the columns are the gates r, z, c in this order. `H` = hidden width.
#[derive(Clone, Copy, Debug)]
pub struct Gru<'a> {
    /// `in × 3H`.
    pub w_i: &'a [f32],
    /// `3H`.
    pub b_i: &'a [f32],
    /// `H × 3H`.
    pub w_h: &'a [f32],
    /// `3H`.
    pub b_h: &'a [f32],
}

/// Activations of the forward pass and work space, reused between calls.
#[derive(Clone, Debug, Default)]
pub struct GruCache {
    /// `rows × 3H`: the input products, later their gradients.
    gx: Vec<f32>,
    /// `rows × 3H`: the recurrent products, later their gradients.
    gh: Vec<f32>,
    r: Vec<f32>,
    z: Vec<f32>,
    c: Vec<f32>,
    h_prev: Vec<f32>,
    /// `rows × H`: the hidden state after each step.
    pub h: Vec<f32>,
    /// Gradient carried from step `t` to `t − 1`.
    carry: Vec<f32>,
    w_h_t: Vec<f32>,
}

/// Borrowed gradients of [`Gru`]'s weights.
#[derive(Debug)]
pub struct GruGradient<'a> {
    /// `in × 3H`.
    pub w_i: &'a mut [f32],
    /// `3H`.
    pub b_i: &'a mut [f32],
    /// `H × 3H`.
    pub w_h: &'a mut [f32],
    /// `3H`.
    pub b_h: &'a mut [f32],
}

impl Gru<'_> {
    fn hidden(&self) -> usize {
        self.b_h.len() / 3
    }

    fn inputs(&self) -> usize {
        self.w_i.len() / self.b_i.len()
    }

    /// One step for `rows` rows: `h` (`rows × H`) is replaced by `h'`. `gx`, `gh`: work space.
    pub fn step(&self, x: &[f32], h: &mut [f32], rows: usize, gx: &mut Vec<f32>, gh: &mut Vec<f32>) {
        let (inputs, hidden) = (self.inputs(), self.hidden());
        gx.resize(rows * 3 * hidden, 0.0);
        gh.resize(rows * 3 * hidden, 0.0);
        fill_rows(gx, self.b_i);
        add_product(gx, Matrix::new(x, rows, inputs), Matrix::new(self.w_i, inputs, 3 * hidden));
        fill_rows(gh, self.b_h);
        add_product(gh, Matrix::new(h, rows, hidden), Matrix::new(self.w_h, hidden, 3 * hidden));
        vectorized(|| {
            let rows = gx.chunks_exact(3 * hidden).zip(gh.chunks_exact(3 * hidden));
            for ((gx, gh), h) in rows.zip(h.chunks_exact_mut(hidden)) {
                let (gx, gh) = (Gates::of(gx), Gates::of(gh));
                for (j, h) in h.iter_mut().enumerate() {
                    let r = sigmoid(gx.r[j] + gh.r[j]);
                    let z = sigmoid(gx.z[j] + gh.z[j]);
                    let c = tanh(gx.c[j] + r * gh.c[j]);
                    *h = (1.0 - z) * c + z * *h;
                }
            }
        });
    }

    /// All steps from a zero state: reads `x` (`steps.rows() × in`), leaves the states in `cache.h`.
    pub fn forward(&self, x: &[f32], steps: &Steps, cache: &mut GruCache) {
        let (inputs, hidden, rows) = (self.inputs(), self.hidden(), steps.rows());
        cache.gx.resize(rows * 3 * hidden, 0.0);
        cache.gh.resize(rows * 3 * hidden, 0.0);
        for states in [&mut cache.r, &mut cache.z, &mut cache.c, &mut cache.h_prev, &mut cache.h] {
            states.resize(rows * hidden, 0.0);
        }
        fill_rows(&mut cache.gx, self.b_i);
        add_product(&mut cache.gx, Matrix::new(x, rows, inputs), Matrix::new(self.w_i, inputs, 3 * hidden));
        fill_rows(&mut cache.gh, self.b_h);

        for t in 0..steps.len() {
            let (start, n) = (steps.offset(t), steps.count(t));
            let (done, rest) = cache.h.split_at_mut(start * hidden);
            let h_prev = &mut cache.h_prev[start * hidden..(start + n) * hidden];
            let gh = &mut cache.gh[start * 3 * hidden..(start + n) * 3 * hidden];
            if t == 0 {
                h_prev.fill(0.0);
            } else {
                let before = steps.offset(t - 1) * hidden;
                h_prev.copy_from_slice(&done[before..before + n * hidden]);
                add_product(gh, Matrix::new(h_prev, n, hidden), Matrix::new(self.w_h, hidden, 3 * hidden));
            }
            let span = start * hidden..(start + n) * hidden;
            let (r, z, c) = (&mut cache.r[span.clone()], &mut cache.z[span.clone()], &mut cache.c[span]);
            let gx = &cache.gx[start * 3 * hidden..(start + n) * 3 * hidden];
            gates_forward(hidden, gx, gh, h_prev, r, z, c, &mut rest[..n * hidden]);
        }
    }

    /// Adds the gradients of all weights to `gradient` and writes that of the inputs into `dx` (`rows × in`). `dh`
    /// (`rows × H`) is the gradient of the loss with respect to every state of [`Gru::forward`].
    pub fn backward(
        &self,
        x: &[f32],
        steps: &Steps,
        dh: &[f32],
        cache: &mut GruCache,
        gradient: GruGradient,
        dx: &mut Vec<f32>,
    ) {
        let (inputs, hidden, rows) = (self.inputs(), self.hidden(), steps.rows());
        // The backward recurrent product needs W_hᵀ; transposed once, it needs no packing per step.
        transpose(self.w_h, hidden, 3 * hidden, &mut cache.w_h_t);
        cache.carry.clear();
        cache.carry.resize(steps.counts.first().map_or(0, |n| n * hidden), 0.0);

        for t in (0..steps.len()).rev() {
            let (start, n) = (steps.offset(t), steps.count(t));
            let span = start * hidden..(start + n) * hidden;
            let wide = start * 3 * hidden..(start + n) * 3 * hidden;
            let carry = &mut cache.carry[..n * hidden];
            let forward = Forward {
                r: &cache.r[span.clone()],
                z: &cache.z[span.clone()],
                c: &cache.c[span.clone()],
                h_prev: &cache.h_prev[span.clone()],
            };
            let gh = &mut cache.gh[wide.clone()];
            gates_backward(hidden, &forward, &dh[span], carry, &mut cache.gx[wide], gh);
            if t > 0 {
                let w_h_t = Matrix::new(&cache.w_h_t, 3 * hidden, hidden);
                add_product(carry, Matrix::new(gh, n, 3 * hidden), w_h_t);
            }
        }

        let d_gx = Matrix::new(&cache.gx, rows, 3 * hidden);
        let d_gh = Matrix::new(&cache.gh, rows, 3 * hidden);
        add_product(gradient.w_i, Matrix::new(x, rows, inputs).t(), d_gx);
        add_rows(gradient.b_i, &cache.gx[..rows * 3 * hidden]);
        add_product(gradient.w_h, Matrix::new(&cache.h_prev, rows, hidden).t(), d_gh);
        add_rows(gradient.b_h, &cache.gh[..rows * 3 * hidden]);
        dx.resize(rows * inputs, 0.0);
        product(dx, d_gx, Matrix::new(self.w_i, inputs, 3 * hidden).t());
    }
}

/// The three gates' parts of one row.
struct Gates<'a> {
    r: &'a [f32],
    z: &'a [f32],
    c: &'a [f32],
}

impl<'a> Gates<'a> {
    #[inline(always)]
    fn of(row: &'a [f32]) -> Self {
        let hidden = row.len() / 3;
        let (r, rest) = row.split_at(hidden);
        let (z, c) = rest.split_at(hidden);
        Self { r, z, c }
    }
}

/// Activations that one step's backward pass needs.
struct Forward<'a> {
    r: &'a [f32],
    z: &'a [f32],
    c: &'a [f32],
    h_prev: &'a [f32],
}

#[allow(clippy::too_many_arguments)] // the cell's variables, each once
fn gates_forward(
    hidden: usize,
    gx: &[f32],
    gh: &[f32],
    h_prev: &[f32],
    r: &mut [f32],
    z: &mut [f32],
    c: &mut [f32],
    h: &mut [f32],
) {
    vectorized(|| {
        for (i, (gx, gh)) in gx.chunks_exact(3 * hidden).zip(gh.chunks_exact(3 * hidden)).enumerate() {
            let row = i * hidden..(i + 1) * hidden;
            let (gx, gh, h_prev) = (Gates::of(gx), Gates::of(gh), &h_prev[row.clone()]);
            let (r, z) = (&mut r[row.clone()], &mut z[row.clone()]);
            let (c, h) = (&mut c[row.clone()], &mut h[row]);
            for j in 0..hidden {
                r[j] = sigmoid(gx.r[j] + gh.r[j]);
                z[j] = sigmoid(gx.z[j] + gh.z[j]);
                c[j] = tanh(gx.c[j] + r[j] * gh.c[j]);
                h[j] = (1.0 - z[j]) * c[j] + z[j] * h_prev[j];
            }
        }
    });
}

/// `carry` is the gradient from step `t + 1`, and becomes the part `dh ⊙ z` of the one for `t − 1`. `gx`, and `gh` with
/// `h W_h + b_h`, are overwritten by their gradients.
fn gates_backward(
    hidden: usize,
    forward: &Forward,
    dh: &[f32],
    carry: &mut [f32],
    gx: &mut [f32],
    gh: &mut [f32],
) {
    vectorized(|| {
        for (i, (gx, gh)) in gx.chunks_exact_mut(3 * hidden).zip(gh.chunks_exact_mut(3 * hidden)).enumerate()
        {
            let row = i * hidden..(i + 1) * hidden;
            let (r, z) = (&forward.r[row.clone()], &forward.z[row.clone()]);
            let (c, h_prev) = (&forward.c[row.clone()], &forward.h_prev[row.clone()]);
            let (dh, carry) = (&dh[row.clone()], &mut carry[row]);
            let (gx_r, rest) = gx.split_at_mut(hidden);
            let (gx_z, gx_c) = rest.split_at_mut(hidden);
            let (gh_r, rest) = gh.split_at_mut(hidden);
            let (gh_z, gh_c) = rest.split_at_mut(hidden);
            for j in 0..hidden {
                let d = dh[j] + carry[j];
                let d_c = d * (1.0 - z[j]) * (1.0 - c[j] * c[j]);
                let d_z = d * (h_prev[j] - c[j]) * z[j] * (1.0 - z[j]);
                let d_r = d_c * gh_c[j] * r[j] * (1.0 - r[j]);
                (gx_r[j], gx_z[j], gx_c[j]) = (d_r, d_z, d_c);
                (gh_r[j], gh_z[j], gh_c[j]) = (d_r, d_z, d_c * r[j]);
                carry[j] = d * z[j];
            }
        }
    });
}

fn transpose(matrix: &[f32], rows: usize, cols: usize, out: &mut Vec<f32>) {
    out.resize(rows * cols, 0.0);
    for (i, row) in matrix.chunks_exact(cols).enumerate() {
        for (j, x) in row.iter().enumerate() {
            out[j * rows + i] = *x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_packed_by_time_with_the_longest_sequence_first() {
        let steps = Steps::of_lengths(&[4, 2, 2, 1]);
        let counts: Vec<_> = (0..steps.len()).map(|t| (steps.offset(t), steps.count(t))).collect();
        assert_eq!(counts, [(0, 4), (4, 3), (7, 1), (8, 1)]);
        assert_eq!(steps.rows(), 9);
        assert!(Steps::of_lengths(&[]).is_empty());
    }
}
