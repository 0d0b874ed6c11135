//! The passes of [`crate::network`] on candle's tensors: on a GPU, or in tests on candle's CPU device.
//!
//! The derivatives are written out as in the kernels, without candle's autograd: there is no graph to walk, relu'(0)
//! is 0 as elsewhere, and a recurrent network computes for all steps at once what does not depend on the step before.
//! A dozen small operations per step forward and five back remain inside the loops over time.
//!
//! A pass copies its inputs and weights to the device, and waits only for its result.

use std::sync::{Arc, MutexGuard, PoisonError};

use candle_core::{DType, Device, Result, Tensor};

use super::Shared;
use crate::kernels::gru::Steps;
use crate::network::Network;

/// One network's passes on a device, with the activations of its last forward pass.
#[derive(Clone, Debug)]
pub struct Passes {
    device: Device,
    shared: Arc<Shared>,
    kept: Option<Kept>,
}

/// Waits until no other pass uses the device. A pass that panicked leaves nothing incomplete.
fn turn(shared: &Shared) -> MutexGuard<'_, ()> {
    shared.turn.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The layers of a network, on the device.
#[derive(Clone, Debug)]
struct Layers {
    first: Linear,
    middle: Middle,
    head: Linear,
}

#[derive(Clone, Debug)]
enum Middle {
    Fc(Linear),
    Gru { of_input: Linear, of_state: Linear },
}

/// `weight`: `in × out`; `bias`: `out`.
#[derive(Clone, Debug)]
struct Linear {
    weight: Tensor,
    bias: Tensor,
}

/// Activations of a forward pass over `rows` rows.
#[derive(Clone, Debug)]
struct Kept {
    layers: Layers,
    /// `rows × inputs`.
    o: Tensor,
    /// `rows × H`.
    x: Tensor,
    /// `rows × H`.
    h: Tensor,
    /// In a recurrent network.
    cells: Vec<Cell>,
}

/// One time step of `n` sequences, in the symbols of [`crate::kernels::gru`].
#[derive(Clone, Debug)]
struct Cell {
    /// `n × H`: the state before.
    h_prev: Tensor,
    /// `n × 2H`: both gates.
    rz: Tensor,
    /// `n × H`.
    c: Tensor,
    /// `n × H`: the candidate's part of the recurrent product.
    gh_c: Tensor,
    /// `n × H`: the state after.
    h: Tensor,
}

impl Passes {
    pub fn on(device: Device, shared: Arc<Shared>) -> Self {
        Self { device, shared, kept: None }
    }

    /// As [`Network::forward`]; `out` becomes `rows × outputs`, zeros after a failure.
    pub fn forward(
        &mut self,
        network: &Network,
        values: &[f32],
        o: &[f32],
        steps: &Steps,
        out: &mut Vec<f32>,
    ) {
        let shared = self.shared.clone();
        let _turn = turn(&shared);
        let result = self.try_forward(network, values, o, steps);
        *out = self.noted(result).unwrap_or_else(|| vec![0.0; steps.rows() * network.outputs]);
    }

    /// As [`Network::backward`], for the preceding [`Passes::forward`]; adds nothing after a failure.
    pub fn backward(&mut self, steps: &Steps, d_out: &[f32], gradient: &mut [f32]) {
        let shared = self.shared.clone();
        let _turn = turn(&shared);
        let result = match self.kept.take() {
            Some(kept) => kept.backward(steps, d_out, &self.device),
            None => Err(candle_core::Error::msg("there is no forward pass to go back through")),
        };
        let found = self.noted(result).unwrap_or_default();
        gradient.iter_mut().zip(found).for_each(|(sum, part)| *sum += part);
    }

    /// As [`Network::act`]; `out` becomes `rows × outputs`, zeros after a failure.
    pub fn act(
        &self,
        network: &Network,
        values: &[f32],
        o: &[f32],
        rows: usize,
        state: &mut [f32],
        out: &mut Vec<f32>,
    ) {
        let _turn = turn(&self.shared);
        let result = self.try_act(network, values, o, rows, state);
        *out = self.noted(result).unwrap_or_else(|| vec![0.0; rows * network.outputs]);
    }

    fn noted<T>(&self, result: Result<T>) -> Option<T> {
        result.map_err(|error| self.shared.failure.get_or_init(|| first_line(&error)).len()).ok()
    }

    fn try_forward(
        &mut self,
        network: &Network,
        values: &[f32],
        o: &[f32],
        steps: &Steps,
    ) -> Result<Vec<f32>> {
        self.kept = None;
        let layers = Layers::of(network, values, &self.device)?;
        let o = Tensor::from_slice(o, (steps.rows(), network.inputs), &self.device)?;
        let x = layers.first.forward(&o)?.relu()?;
        let (h, cells) = match &layers.middle {
            Middle::Fc(linear) => (linear.forward(&x)?.relu()?, vec![]),
            Middle::Gru { of_input, of_state } => {
                let cells = forward_through_time(&of_input.forward(&x)?, of_state, steps)?;
                (joined(&cells, |cell| &cell.h)?, cells)
            }
        };
        let out = numbers(&layers.head.forward(&h)?);
        self.kept = Some(Kept { layers, o, x, h, cells });
        out
    }

    fn try_act(
        &self,
        network: &Network,
        values: &[f32],
        o: &[f32],
        rows: usize,
        state: &mut [f32],
    ) -> Result<Vec<f32>> {
        let layers = Layers::of(network, values, &self.device)?;
        let o = Tensor::from_slice(o, (rows, network.inputs), &self.device)?;
        let x = layers.first.forward(&o)?.relu()?;
        let h = match &layers.middle {
            Middle::Fc(linear) => linear.forward(&x)?.relu()?,
            Middle::Gru { of_input, of_state } => {
                let h = Tensor::from_slice(state, (rows, network.hidden), &self.device)?;
                let h = Cell::forward(&of_input.forward(&x)?, h, of_state)?.h;
                state.copy_from_slice(&numbers(&h)?);
                h
            }
        };
        numbers(&layers.head.forward(&h)?)
    }
}

impl Layers {
    /// `values` is copied as a whole; the layers are views of the copy.
    fn of(network: &Network, values: &[f32], device: &Device) -> Result<Self> {
        let values = Tensor::from_slice(values, values.len(), device)?;
        let mut start = 0;
        let mut blocks = network.blocks().into_iter();
        let mut next = || -> Result<Tensor> {
            let block = blocks.next().expect("as many blocks as the network's kind has");
            start += block.len();
            values.narrow(0, start - block.len(), block.len())?.reshape(block.shape)
        };
        let mut linear = || -> Result<Linear> { Ok(Linear { weight: next()?, bias: next()? }) };
        let first = linear()?;
        let middle = match network.kind {
            crate::network::Kind::Fc => Middle::Fc(linear()?),
            crate::network::Kind::Gru => Middle::Gru { of_input: linear()?, of_state: linear()? },
        };
        Ok(Self { first, middle, head: linear()? })
    }
}

impl Linear {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        x.matmul(&self.weight)?.broadcast_add(&self.bias)
    }

    /// `dx` of `dy`.
    fn input_gradient(&self, dy: &Tensor) -> Result<Tensor> {
        dy.matmul(&self.weight.t()?)
    }
}

/// `dW` and `db` of a layer with inputs `x` and `dy`, the gradient by its outputs.
fn weight_gradient(x: &Tensor, dy: &Tensor) -> Result<[Tensor; 2]> {
    Ok([x.t()?.matmul(dy)?, dy.sum(0)?])
}

/// `dy` where the layer's output `y`, which is never negative, is positive.
fn relu_backward(y: &Tensor, dy: &Tensor) -> Result<Tensor> {
    dy * y.sign()?
}

/// σ through tanh: three operations instead of four.
fn sigmoid(x: &Tensor) -> Result<Tensor> {
    x.affine(0.5, 0.0)?.tanh()?.affine(0.5, 0.5)
}

/// `1 − x`.
fn complement(x: &Tensor) -> Result<Tensor> {
    x.affine(-1.0, 1.0)
}

/// The three or two gates' parts of `x` (`n × kH`), each `n × H`.
fn gate(x: &Tensor, k: usize, hidden: usize) -> Result<Tensor> {
    x.narrow(1, k * hidden, hidden)
}

impl Cell {
    /// `gx`: `n × 3H`, the products of the inputs; `h_prev`: `n × H`.
    fn forward(gx: &Tensor, h_prev: Tensor, of_state: &Linear) -> Result<Self> {
        let hidden = h_prev.dim(1)?;
        let gh = of_state.forward(&h_prev)?;
        let rz = sigmoid(&(gx.narrow(1, 0, 2 * hidden)? + gh.narrow(1, 0, 2 * hidden)?)?)?;
        let (r, z, gh_c) = (gate(&rz, 0, hidden)?, gate(&rz, 1, hidden)?, gate(&gh, 2, hidden)?);
        let c = (gate(gx, 2, hidden)? + (r * &gh_c)?)?.tanh()?;
        let h = (&c + (z * (&h_prev - &c)?)?)?;
        Ok(Self { h_prev, rz, c, gh_c, h })
    }
}

/// All steps from a zero state. `gx`: `rows × 3H`.
fn forward_through_time(gx: &Tensor, of_state: &Linear, steps: &Steps) -> Result<Vec<Cell>> {
    let hidden = of_state.weight.dim(0)?;
    let mut cells: Vec<Cell> = Vec::with_capacity(steps.len());
    for t in 0..steps.len() {
        let n = steps.count(t);
        let h_prev = match cells.last() {
            Some(cell) => cell.h.narrow(0, 0, n)?,
            None => Tensor::zeros((n, hidden), DType::F32, gx.device())?,
        };
        cells.push(Cell::forward(&gx.narrow(0, steps.offset(t), n)?, h_prev, of_state)?);
    }
    Ok(cells)
}

/// One part of all steps' cells, packed like the rows.
fn joined(cells: &[Cell], part: impl Fn(&Cell) -> &Tensor) -> Result<Tensor> {
    Tensor::cat(&cells.iter().map(part).collect::<Vec<_>>(), 0)
}

impl Kept {
    /// The gradient of all parameters from `d_out` (`rows × outputs`).
    fn backward(&self, steps: &Steps, d_out: &[f32], device: &Device) -> Result<Vec<f32>> {
        let Layers { middle, head, .. } = &self.layers;
        let d_out = Tensor::from_slice(d_out, (steps.rows(), head.bias.dim(0)?), device)?;
        let dh = head.input_gradient(&d_out)?;
        let (dx, of_middle) = match middle {
            Middle::Fc(linear) => {
                let dh = relu_backward(&self.h, &dh)?;
                (linear.input_gradient(&dh)?, weight_gradient(&self.x, &dh)?.to_vec())
            }
            Middle::Gru { of_input, of_state } => {
                let h_prev = joined(&self.cells, |cell| &cell.h_prev)?;
                let (d_gx, d_gh) = self.backward_through_time(&h_prev, of_state, steps, &dh)?;
                let [w_i, b_i] = weight_gradient(&self.x, &d_gx)?;
                let [w_h, b_h] = weight_gradient(&h_prev, &d_gh)?;
                (of_input.input_gradient(&d_gx)?, vec![w_i, b_i, w_h, b_h])
            }
        };
        let dx = relu_backward(&self.x, &dx)?;
        let of_first = weight_gradient(&self.o, &dx)?;
        let of_head = weight_gradient(&self.h, &d_out)?;
        let blocks = of_first.iter().chain(&of_middle).chain(&of_head);
        numbers(&Tensor::cat(&blocks.map(Tensor::flatten_all).collect::<Result<Vec<_>>>()?, 0)?)
    }

    /// The gradients of the input products and of the recurrent ones, both `rows × 3H`, from `dh` (`rows × H`), the
    /// gradient of the loss by every state.
    ///
    /// ```text
    /// δ_t = dh_t + (δ_{t+1} ⊙ z_{t+1} + d_gh_{t+1} W_hᵀ)          the whole gradient of the state of step t
    /// d_gx = δ ⊙ [k_r, k_z, k_c]       k_c = (1 − z)(1 − c²)      k_r = k_c (h W_hn + b_hn) r (1 − r)
    /// d_gh = δ ⊙ [k_r, k_z, k_c r]     k_z = (h_prev − c) z (1 − z)
    /// ```
    ///
    /// The factors `k` do not depend on δ, so they are computed for all steps at once.
    fn backward_through_time(
        &self,
        h_prev: &Tensor,
        of_state: &Linear,
        steps: &Steps,
        dh: &Tensor,
    ) -> Result<(Tensor, Tensor)> {
        let (rows, hidden) = dh.dims2()?;
        let rz = joined(&self.cells, |cell| &cell.rz)?;
        let (r, z) = (gate(&rz, 0, hidden)?, gate(&rz, 1, hidden)?);
        let (c, gh_c) = (joined(&self.cells, |cell| &cell.c)?, joined(&self.cells, |cell| &cell.gh_c)?);
        let k_c = (complement(&z)? * complement(&c.sqr()?)?)?;
        let k_z = ((h_prev - &c)? * (&z * complement(&z)?)?)?;
        let k_r = ((&k_c * &gh_c)? * (&r * complement(&r)?)?)?;
        let k_gx = Tensor::stack(&[&k_r, &k_z, &k_c], 1)?;
        let k_gh = Tensor::stack(&[&k_r, &k_z, &(&k_c * &r)?], 1)?;

        let mut deltas: Vec<Tensor> = Vec::with_capacity(steps.len());
        let mut carry: Option<Tensor> = None;
        for t in (0..steps.len()).rev() {
            let (start, n) = (steps.offset(t), steps.count(t));
            let own = dh.narrow(0, start, n)?;
            let delta = match &carry {
                Some(carry) => added_to_head(&own, carry)?,
                None => own,
            };
            if t > 0 {
                let d_gh = k_gh.narrow(0, start, n)?.broadcast_mul(&delta.unsqueeze(1)?)?;
                let through_gates = of_state.input_gradient(&d_gh.reshape((n, 3 * hidden))?)?;
                carry = Some((through_gates + (&delta * z.narrow(0, start, n)?)?)?);
            }
            deltas.push(delta);
        }
        deltas.reverse();
        let delta = Tensor::cat(&deltas, 0)?.unsqueeze(1)?;
        let of = |k: &Tensor| k.broadcast_mul(&delta)?.reshape((rows, 3 * hidden));
        Ok((of(&k_gx)?, of(&k_gh)?))
    }
}

/// `whole` with `part` added to its first rows: sequences that end here get no gradient from later steps.
fn added_to_head(whole: &Tensor, part: &Tensor) -> Result<Tensor> {
    let (n, of_part) = (whole.dim(0)?, part.dim(0)?);
    if n == of_part {
        return whole + part;
    }
    let head = (whole.narrow(0, 0, of_part)? + part)?;
    Tensor::cat(&[&head, &whole.narrow(0, of_part, n - of_part)?], 0)
}

fn numbers(tensor: &Tensor) -> Result<Vec<f32>> {
    tensor.flatten_all()?.to_vec1()
}

/// The message of an error, without the stack that candle may append.
pub fn first_line(error: &candle_core::Error) -> String {
    error.to_string().lines().next().unwrap_or("no reason given").to_owned()
}
