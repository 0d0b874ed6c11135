//! Frozen networks: the opponents of Tag and Adversary, read from safetensors files (mpe §8).
//!
//! ```text
//! x = (obs − running_mean) / sqrt(running_var + 1e-5) · in_fn.weight + in_fn.bias
//! h = relu(fc1 x)      h = relu(fc2 h)      scores = fc3 h
//! ```
//!
//! Weights are `[out, in]`, float32; any hidden widths are allowed. The action with the highest score is chosen, the
//! lowest one of several. Scores mean, in this order: nothing, **+x, −x, +y, −y**.

use std::sync::Arc;

use safetensors::{Dtype, SafeTensorError, SafeTensors};

use super::game::MOVES;

/// Added to the variance before the root.
pub(super) const EPSILON: f64 = 1e-5;

/// The tensors of a frozen network's file.
pub(super) const TENSORS: [&str; 10] = [
    "in_fn.weight",
    "in_fn.bias",
    "in_fn.running_mean",
    "in_fn.running_var",
    "fc1.weight",
    "fc1.bias",
    "fc2.weight",
    "fc2.bias",
    "fc3.weight",
    "fc3.bias",
];

/// Why bytes are not a frozen network for a role.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NetworkError {
    #[error("expected a safetensors file: {0}")]
    NoSafetensors(String),
    #[error("expected a tensor `{name}`, found none; a frozen network has {}", TENSORS.join(", "))]
    Missing { name: &'static str },
    #[error("found a tensor `{name}`, which has no meaning; a frozen network has {}", TENSORS.join(", "))]
    Unknown { name: String },
    #[error("expected F32 in tensor `{name}`, found {found}")]
    Kind { name: &'static str, found: String },
    #[error("expected the shape {expected} in tensor `{name}`, found {found:?}")]
    Shape { name: &'static str, expected: String, found: Vec<usize> },
    #[error("expected {expected} in tensor `{name}`, found {found} at place {place}")]
    Number { name: &'static str, expected: &'static str, found: f32, place: usize },
}

/// A network that acts and does not learn. Copies share their weights.
#[derive(Debug, Clone)]
pub struct FrozenNetwork {
    layers: Arc<Layers>,
    /// Scratch: input and hidden activations.
    x: Vec<f64>,
    h1: Vec<f64>,
    h2: Vec<f64>,
}

#[derive(Debug)]
struct Layers {
    mean: Vec<f64>,
    /// `weight / sqrt(var + ε)`
    scale: Vec<f64>,
    shift: Vec<f64>,
    fc1: Layer,
    fc2: Layer,
    fc3: Layer,
}

/// Float32 values in double precision: scores do not depend on a platform's order of addition.
#[derive(Debug)]
struct Layer {
    /// `[in, out]`, so that a zero input skips a whole row.
    weight: Vec<f64>,
    bias: Vec<f64>,
}

impl FrozenNetwork {
    /// Reads the bytes of a safetensors file as a network that sees `inputs` numbers.
    pub fn parse(bytes: &[u8], inputs: usize) -> Result<FrozenNetwork, NetworkError> {
        let file = SafeTensors::deserialize(bytes)
            .map_err(|error: SafeTensorError| NetworkError::NoSafetensors(error.to_string()))?;
        if let Some(name) = file.names().into_iter().filter(|name| !TENSORS.contains(name)).min() {
            return Err(NetworkError::Unknown { name: name.to_owned() });
        }
        let file = File { file };
        let vector = |name| file.tensor(name, &[Some(inputs)]).map(|(_, values)| values);
        let (weight, shift) = (vector("in_fn.weight")?, vector("in_fn.bias")?);
        let (mean, var) = (vector("in_fn.running_mean")?, vector("in_fn.running_var")?);
        if let Some(place) = var.iter().position(|&var| var < 0.0) {
            let (name, found) = ("in_fn.running_var", var[place] as f32);
            return Err(NetworkError::Number { name, expected: "no negative variance", found, place });
        }
        let scale = weight.iter().zip(&var).map(|(weight, var)| weight / (var + EPSILON).sqrt()).collect();
        let fc1 = file.layer("fc1.weight", "fc1.bias", inputs, None)?;
        let fc2 = file.layer("fc2.weight", "fc2.bias", fc1.bias.len(), None)?;
        let fc3 = file.layer("fc3.weight", "fc3.bias", fc2.bias.len(), Some(MOVES))?;
        Ok(FrozenNetwork {
            x: vec![0.0; inputs],
            h1: vec![0.0; fc1.bias.len()],
            h2: vec![0.0; fc2.bias.len()],
            layers: Arc::new(Layers { mean, scale, shift, fc1, fc2, fc3 }),
        })
    }

    /// The scores of the five actions for an observation of the right length.
    pub fn scores(&mut self, obs: &[f32]) -> [f64; MOVES] {
        assert_eq!(obs.len(), self.x.len(), "one place per observed number");
        let layers = &*self.layers;
        for (i, x) in self.x.iter_mut().enumerate() {
            *x = (f64::from(obs[i]) - layers.mean[i]) * layers.scale[i] + layers.shift[i];
        }
        layers.fc1.forward(&self.x, &mut self.h1);
        relu(&mut self.h1);
        layers.fc2.forward(&self.h1, &mut self.h2);
        relu(&mut self.h2);
        let mut scores = [0.0; MOVES];
        layers.fc3.forward(&self.h2, &mut scores);
        scores
    }

    /// The network's choice, in its own directions: 1 is +x, 2 is -x, 3 is +y, 4 is -y.
    pub fn choose(&mut self, obs: &[f32]) -> u16 {
        let scores = self.scores(obs);
        let mut best = 0;
        for (action, score) in scores.iter().enumerate() {
            if *score > scores[best] {
                best = action;
            }
        }
        best as u16
    }
}

impl Layer {
    fn forward(&self, input: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&self.bias);
        for (row, &x) in self.weight.chunks_exact(out.len()).zip(input) {
            // Half of all hidden activations are zero.
            if x != 0.0 {
                for (out, weight) in out.iter_mut().zip(row) {
                    *out += x * weight;
                }
            }
        }
    }
}

fn relu(values: &mut [f64]) {
    for value in values {
        *value = value.max(0.0);
    }
}

struct File<'a> {
    file: SafeTensors<'a>,
}

impl File<'_> {
    fn layer(
        &self,
        weight: &'static str,
        bias: &'static str,
        inputs: usize,
        outputs: Option<usize>,
    ) -> Result<Layer, NetworkError> {
        let (shape, values) = self.tensor(weight, &[outputs, Some(inputs)])?;
        let outputs = shape[0];
        let (_, bias) = self.tensor(bias, &[Some(outputs)])?;
        let mut transposed = vec![0.0; values.len()];
        for (to, row) in values.chunks_exact(inputs).enumerate() {
            for (from, &value) in row.iter().enumerate() {
                transposed[from * outputs + to] = value;
            }
        }
        Ok(Layer { weight: transposed, bias })
    }

    /// Shape and values of a tensor of that shape; `None` allows any length above 0.
    fn tensor(
        &self,
        name: &'static str,
        shape: &[Option<usize>],
    ) -> Result<(Vec<usize>, Vec<f64>), NetworkError> {
        let tensor = self.file.tensor(name).map_err(|_| NetworkError::Missing { name })?;
        if tensor.dtype() != Dtype::F32 {
            return Err(NetworkError::Kind { name, found: tensor.dtype().to_string() });
        }
        let found = tensor.shape();
        let fits = |(expected, &found): (&Option<usize>, &usize)| expected.map_or(found > 0, |n| n == found);
        if found.len() != shape.len() || !shape.iter().zip(found).all(fits) {
            let sizes: Vec<String> =
                shape.iter().map(|size| size.map_or("any".to_owned(), |n| n.to_string())).collect();
            let expected = format!("[{}]", sizes.join(", "));
            return Err(NetworkError::Shape { name, expected, found: found.to_vec() });
        }
        let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().expect("chunks of 4 bytes"));
        let values: Vec<f32> = tensor.data().chunks_exact(4).map(number).collect();
        if let Some(place) = values.iter().position(|value| !value.is_finite()) {
            let (expected, found) = ("finite numbers", values[place]);
            return Err(NetworkError::Number { name, expected, found, place });
        }
        Ok((found.to_vec(), values.into_iter().map(f64::from).collect()))
    }
}
