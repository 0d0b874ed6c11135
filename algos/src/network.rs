//! The two agent networks of algorithms §1.1 and the critic of algorithms §1.2, over flat parameter vectors.
//!
//! ```text
//! FC :  x = relu(L1 o)   h = relu(L2 x)        out = L3 h
//! GRU:  x = relu(L1 o)   h_t = GRU(x, h_{t-1})  out = L3 h_t      h_{-1} = 0
//! ```
//!
//! No layer norm, no dropout, no orthogonal initialisation, no output scaling.

use crate::device::{Passes, ROWS_TO_ACT_ON_GPU};
use crate::kernels::gru::{Gru, GruCache, GruGradient, Steps};
use crate::kernels::linear::{add_weight_gradient, relu_backward, Linear};
use crate::params::{take, take_mut, Block};

/// The kind of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Two hidden ReLU layers.
    Fc,
    /// A ReLU layer, a GRU cell, a linear head.
    Gru,
}

/// Shape of a network: `inputs → hidden → hidden → outputs`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Network {
    /// Feed-forward or recurrent.
    pub kind: Kind,
    /// Numbers in an input row: the observation, and for a policy or Q network the additional inputs of
    /// algorithms §1.4.
    pub inputs: usize,
    /// Hidden width, `H`.
    pub hidden: usize,
    /// Actions of a policy, 1 for a critic.
    pub outputs: usize,
}

/// Activations of a forward pass for its backward pass, and work space.
#[derive(Clone, Debug, Default)]
pub struct Activations {
    /// The device's passes, if not the CPU's. They fill `out` only.
    pub(crate) on: Option<Passes>,
    x: Vec<f32>,
    h: Vec<f32>,
    gru: GruCache,
    /// `rows × outputs`.
    pub out: Vec<f32>,
    dx: Vec<f32>,
    dh: Vec<f32>,
}

/// Work space of [`Network::act`].
#[derive(Clone, Debug, Default)]
pub struct ActWork {
    /// The device's passes for ticks of many rows, if not the CPU's.
    pub(crate) on: Option<Passes>,
    x: Vec<f32>,
    h: Vec<f32>,
    gx: Vec<f32>,
    gh: Vec<f32>,
    /// `rows × outputs`.
    pub out: Vec<f32>,
}

/// The borrowed layers of a network.
struct Layers<'a> {
    first: Linear<'a>,
    middle: Middle<'a>,
    head: Linear<'a>,
}

enum Middle<'a> {
    Fc(Linear<'a>),
    Gru(Gru<'a>),
}

impl Network {
    /// Names, shapes and initial bounds of the parameters, in their order in the flat vector.
    pub fn blocks(&self) -> Vec<Block> {
        let (i, h, o) = (self.inputs, self.hidden, self.outputs);
        let of_fan_in = |fan_in: usize| 1.0 / (fan_in as f32).sqrt();
        let block =
            |name, shape: &[usize], fan_in| Block { name, shape: shape.to_vec(), bound: of_fan_in(fan_in) };
        let mut blocks = vec![block("fc1.weight", &[i, h], i), block("fc1.bias", &[h], i)];
        blocks.extend(match self.kind {
            Kind::Fc => vec![block("fc2.weight", &[h, h], h), block("fc2.bias", &[h], h)],
            // The bound of the input matrices depends on the hidden width too, as in PyTorch.
            Kind::Gru => vec![
                block("gru.weight_ih", &[h, 3 * h], h),
                block("gru.bias_ih", &[3 * h], h),
                block("gru.weight_hh", &[h, 3 * h], h),
                block("gru.bias_hh", &[3 * h], h),
            ],
        });
        blocks.extend([block("head.weight", &[h, o], h), block("head.bias", &[o], h)]);
        blocks
    }

    /// Length of the flat parameter vector.
    pub fn parameters(&self) -> usize {
        self.blocks().iter().map(Block::len).sum()
    }

    fn layers<'a>(&self, mut values: &'a [f32]) -> Layers<'a> {
        let (i, h, o) = (self.inputs, self.hidden, self.outputs);
        let rest = &mut values;
        let first = Linear { weight: take(rest, i * h), bias: take(rest, h) };
        let middle = match self.kind {
            Kind::Fc => Middle::Fc(Linear { weight: take(rest, h * h), bias: take(rest, h) }),
            Kind::Gru => Middle::Gru(Gru {
                w_i: take(rest, h * 3 * h),
                b_i: take(rest, 3 * h),
                w_h: take(rest, h * 3 * h),
                b_h: take(rest, 3 * h),
            }),
        };
        Layers { first, middle, head: Linear { weight: take(rest, h * o), bias: take(rest, o) } }
    }

    /// Forward pass of `o` (`steps.rows() × inputs`, packed by time); the result is `to.out`.
    pub fn forward(&self, values: &[f32], o: &[f32], steps: &Steps, to: &mut Activations) {
        if let Some(device) = &mut to.on {
            return device.forward(self, values, o, steps, &mut to.out);
        }
        let rows = steps.rows();
        let layers = self.layers(values);
        layers.first.forward_relu(o, rows, &mut to.x);
        match layers.middle {
            Middle::Fc(linear) => {
                linear.forward_relu(&to.x, rows, &mut to.h);
                layers.head.forward(&to.h, rows, &mut to.out);
            }
            Middle::Gru(gru) => {
                gru.forward(&to.x, steps, &mut to.gru);
                layers.head.forward(&to.gru.h, rows, &mut to.out);
            }
        }
    }

    /// Adds the gradient of all parameters to `gradient`, because a batch comes in parts. `d_out` (`rows × outputs`) is
    /// the gradient of the loss with respect to `from.out` of the preceding [`Network::forward`].
    pub fn backward(
        &self,
        values: &[f32],
        o: &[f32],
        steps: &Steps,
        d_out: &[f32],
        from: &mut Activations,
        gradient: &mut [f32],
    ) {
        if let Some(device) = &mut from.on {
            return device.backward(steps, d_out, gradient);
        }
        let (rows, h) = (steps.rows(), self.hidden);
        let layers = self.layers(values);
        let mut rest = gradient;
        let rest = &mut rest;
        let (first_w, first_b) = (take_mut(rest, self.inputs * h), take_mut(rest, h));
        layers.head.input_gradient(d_out, rows, &mut from.dh);
        match layers.middle {
            Middle::Fc(linear) => {
                let (w, b) = (take_mut(rest, h * h), take_mut(rest, h));
                relu_backward(&from.h, &mut from.dh);
                add_weight_gradient(&from.x, &from.dh, rows, w, b);
                linear.input_gradient(&from.dh, rows, &mut from.dx);
            }
            Middle::Gru(gru) => {
                let gradient = GruGradient {
                    w_i: take_mut(rest, h * 3 * h),
                    b_i: take_mut(rest, 3 * h),
                    w_h: take_mut(rest, h * 3 * h),
                    b_h: take_mut(rest, 3 * h),
                };
                gru.backward(&from.x, steps, &from.dh, &mut from.gru, gradient, &mut from.dx);
            }
        }
        let state = if self.kind == Kind::Fc { &from.h } else { &from.gru.h };
        add_weight_gradient(
            state,
            d_out,
            rows,
            take_mut(rest, h * self.outputs),
            take_mut(rest, self.outputs),
        );
        relu_backward(&from.x, &mut from.dx);
        add_weight_gradient(o, &from.dx, rows, first_w, first_b);
    }

    /// One time step for `rows` rows while acting; the result is `work.out`. `state` (`rows × H`) is
    /// updated by a recurrent network and ignored by a feed-forward one.
    pub fn act(&self, values: &[f32], o: &[f32], rows: usize, state: &mut [f32], work: &mut ActWork) {
        if let Some(device) = work.on.as_ref().filter(|_| rows >= ROWS_TO_ACT_ON_GPU) {
            return device.act(self, values, o, rows, state, &mut work.out);
        }
        let layers = self.layers(values);
        layers.first.forward_relu(o, rows, &mut work.x);
        match layers.middle {
            Middle::Fc(linear) => {
                linear.forward_relu(&work.x, rows, &mut work.h);
                layers.head.forward(&work.h, rows, &mut work.out);
            }
            Middle::Gru(gru) => {
                gru.step(&work.x, state, rows, &mut work.gx, &mut work.gh);
                layers.head.forward(state, rows, &mut work.out);
            }
        }
    }
}
