//! Networks and Adam a second time, in the simplest form: double precision, dense tensors, candle's automatic
//! differentiation, none of our kernels. The tests compare whole update calls of the learners with these.

use algos::network::Kind;
use algos::saved::NamedTensor;
use candle_core::{DType, Device, Result, Tensor, Var};

/// One network's parameters with Adam's moments.
pub struct Parameters {
    pub values: Vec<Var>,
    m: Vec<Tensor>,
    v: Vec<Tensor>,
    steps: i32,
}

impl Parameters {
    /// Those of `owner` among a learner's tensors.
    pub fn of(tensors: Vec<NamedTensor>, owner: &str) -> Result<Self> {
        let values: Vec<Var> = tensors
            .into_iter()
            .filter(|(name, ..)| name.starts_with(&format!("{owner}.")))
            .map(|(_, shape, data)| {
                let data: Vec<f64> = data.iter().map(|&x| f64::from(x)).collect();
                Var::from_tensor(&Tensor::from_vec(data, shape, &Device::Cpu)?)
            })
            .collect::<Result<_>>()?;
        let zeros: Vec<Tensor> = values.iter().map(|v| v.zeros_like()).collect::<Result<_>>()?;
        Ok(Self { m: zeros.clone(), v: zeros, values, steps: 0 })
    }

    /// Clip to `max_norm`, then Adam, as PyTorch does them. Returns the norm before clipping.
    pub fn descend(&mut self, loss: &Tensor, max_norm: f64, lr: f64) -> Result<f64> {
        let gradients = loss.backward()?;
        let gradients: Vec<Tensor> =
            self.values.iter().map(|v| gradients.get(v).expect("a gradient").clone()).collect();
        let mut squares = 0.0;
        for g in &gradients {
            squares += g.sqr()?.sum_all()?.to_scalar::<f64>()?;
        }
        let factor = (max_norm / (squares.sqrt() + 1e-6)).min(1.0);
        self.steps += 1;
        for (i, g) in gradients.iter().enumerate() {
            let g = (g * factor)?;
            self.m[i] = ((&self.m[i] * 0.9)? + (&g * 0.1)?)?;
            self.v[i] = ((&self.v[i] * 0.999)? + (g.sqr()? * 0.001)?)?;
            let m_hat = (&self.m[i] / (1.0 - 0.9f64.powi(self.steps)))?;
            let v_hat = (&self.v[i] / (1.0 - 0.999f64.powi(self.steps)))?;
            let step = (m_hat / (v_hat.sqrt()? + 1e-8)?)?;
            self.values[i].set(&(self.values[i].as_tensor() - (step * lr)?)?)?;
        }
        Ok(squares.sqrt())
    }
}

/// Updates `target` after update call `calls` (algorithms §4.4).
pub fn update_target(rule: f64, calls: u64, copied: &mut u64, target: &[Var], values: &[Var]) -> Result<()> {
    let (hard, tau) = (rule > 1.0, rule);
    if !hard || (calls - *copied) as f64 >= rule {
        *copied = calls;
        for (target, value) in target.iter().zip(values) {
            let tau = if hard { 1.0 } else { tau };
            target.set(&((target.as_tensor() * (1.0 - tau))? + (value.as_tensor() * tau)?)?)?;
        }
    }
    Ok(())
}

fn linear(x: &Tensor, w: &[Var]) -> Result<Tensor> {
    x.matmul(&w[0])?.broadcast_add(&w[1])
}

fn sigmoid(x: &Tensor) -> Result<Tensor> {
    (x.neg()?.exp()? + 1.0)?.recip()
}

/// `obs`: `B × T × O`; result `B × T × outputs`.
pub fn forward(kind: Kind, w: &[Var], obs: &Tensor) -> Result<Tensor> {
    let (b, t, _) = obs.dims3()?;
    if kind == Kind::Fc {
        let x = linear(&obs.flatten(0, 1)?, &w[0..2])?.relu()?;
        return linear(&linear(&x, &w[2..4])?.relu()?, &w[4..6])?.reshape((b, t, ()));
    }
    let hidden = w[1].dim(0)?;
    let mut h = Tensor::zeros((b, hidden), DType::F64, &Device::Cpu)?;
    let mut outs = Vec::new();
    for step in 0..t {
        let x = linear(&obs.narrow(1, step, 1)?.squeeze(1)?, &w[0..2])?.relu()?;
        let (gx, gh) = (linear(&x, &w[2..4])?, linear(&h, &w[4..6])?);
        let gate = |g: &Tensor, k: usize| g.narrow(1, k * hidden, hidden);
        let r = sigmoid(&(gate(&gx, 0)? + gate(&gh, 0)?)?)?;
        let z = sigmoid(&(gate(&gx, 1)? + gate(&gh, 1)?)?)?;
        let c = (gate(&gx, 2)? + (r * gate(&gh, 2)?)?)?.tanh()?;
        h = ((z.neg()? + 1.0)? * c)?.add(&(z * h)?)?;
        outs.push(linear(&h, &w[6..8])?);
    }
    Tensor::stack(&outs, 1)
}

/// Largest and mean absolute difference between the tensors of `owner` among a learner's and `values`.
pub fn distance(tensors: Vec<NamedTensor>, owner: &str, values: &[Var]) -> Result<(f64, f64)> {
    let (mut largest, mut sum, mut n) = (0.0f64, 0.0, 0);
    let ours = tensors.into_iter().filter(|(name, ..)| name.starts_with(&format!("{owner}.")));
    for ((_, _, ours), theirs) in ours.zip(values) {
        for (&a, b) in ours.iter().zip(theirs.flatten_all()?.to_vec1::<f64>()?) {
            let d = (f64::from(a) - b).abs();
            (largest, sum, n) = (largest.max(d), sum + d, n + 1);
        }
    }
    assert!(n > 0);
    Ok((largest, sum / f64::from(n)))
}
