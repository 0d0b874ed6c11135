//! Forward and backward passes through the networks of algorithms §1.1, the same with candle's autograd, and matrix
//! products alone. Items are floating-point operations, so items per second compare directly.
//!
//! ```text
//! cargo bench -p algos
//! ```

use algos::kernels::gemm::{product, Matrix};
use algos::kernels::gru::Steps;
use algos::network::{Activations, Kind, Network};
use algos::params::initial;
use candle_core::{Device, Tensor, Var};
use divan::counter::ItemsCount;
use divan::{black_box, Bencher};
use rand_chacha::rand_core::SeedableRng;
use rand_chacha::ChaCha8Rng;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() {
    divan::main();
}

const INPUTS: usize = 20;
const HIDDEN: usize = 128;
const ACTIONS: usize = 5;
/// Steps of an episode in the recurrent cases.
const STEPS: usize = 50;

/// Rows, inner size, columns.
#[divan::bench(args = ["1024x1024x1024", "5000x128x128", "750x128x128", "75x128x128", "750x128x5"])]
fn matrix_product(bencher: Bencher, shape: &str) {
    let sizes: Vec<usize> = shape.split('x').map(|size| size.parse().expect("a number")).collect();
    let (m, k, n) = (sizes[0], sizes[1], sizes[2]);
    let (a, b, mut c) = (vec![1.0; m * k], vec![0.5; k * n], vec![0.0; m * n]);
    bencher
        .counter(ItemsCount::new(2 * m * k * n))
        .bench_local(|| product(black_box(&mut c), Matrix::new(&a, m, k), Matrix::new(&b, k, n)));
}

/// One network with inputs and a gradient of its outputs.
struct Pass {
    network: Network,
    values: Vec<f32>,
    steps: Steps,
    obs: Vec<f32>,
    d_out: Vec<f32>,
}

impl Pass {
    fn new(kind: Kind, lengths: &[usize]) -> Pass {
        let network = Network { kind, inputs: INPUTS, hidden: HIDDEN, outputs: ACTIONS };
        let steps = Steps::of_lengths(lengths);
        let rows = steps.rows();
        let wave = |size: usize| (0..size).map(|k| (k as f32 * 0.37).sin()).collect::<Vec<f32>>();
        Pass {
            values: initial(&network.blocks(), &mut ChaCha8Rng::seed_from_u64(1)),
            network,
            steps,
            obs: wave(rows * INPUTS),
            d_out: wave(rows * ACTIONS),
        }
    }

    /// Operations of a forward and a backward pass, which counts as two.
    fn flops(&self) -> usize {
        let middle = if self.network.kind == Kind::Fc { 1 } else { 6 };
        6 * self.steps.rows() * (INPUTS * HIDDEN + middle * HIDDEN * HIDDEN + HIDDEN * ACTIONS)
    }

    fn bench(&self, bencher: Bencher) {
        let (mut to, mut gradient) = (Activations::default(), vec![0.0; self.values.len()]);
        bencher.counter(ItemsCount::new(self.flops())).bench_local(|| {
            gradient.fill(0.0);
            self.network.forward(&self.values, &self.obs, &self.steps, &mut to);
            self.network.backward(&self.values, &self.obs, &self.steps, &self.d_out, &mut to, &mut gradient);
            black_box(&gradient);
        });
    }

    /// The parameters as candle variables, by block.
    fn variables(&self) -> Vec<Var> {
        let mut rest = self.values.as_slice();
        let mut variable = |shape: Vec<usize>| {
            let (data, later) = rest.split_at(shape.iter().product());
            rest = later;
            let tensor = Tensor::from_vec(data.to_vec(), shape, &Device::Cpu).expect("sizes agree");
            Var::from_tensor(&tensor).expect("a tensor can vary")
        };
        self.network.blocks().into_iter().map(|block| variable(block.shape)).collect()
    }

    fn tensor(&self, data: &[f32], columns: usize) -> Tensor {
        Tensor::from_vec(data.to_vec(), (data.len() / columns, columns), &Device::Cpu).expect("sizes agree")
    }
}

#[divan::bench(args = [75, 750, 5000, 32_000])]
fn fc_ours(bencher: Bencher, rows: usize) {
    Pass::new(Kind::Fc, &vec![1; rows]).bench(bencher);
}

#[divan::bench(args = [750, 5000])]
fn fc_candle(bencher: Bencher, rows: usize) {
    let pass = Pass::new(Kind::Fc, &vec![1; rows]);
    let (v, obs, d_out) =
        (pass.variables(), pass.tensor(&pass.obs, INPUTS), pass.tensor(&pass.d_out, ACTIONS));
    let gradient = || -> candle_core::Result<_> {
        let x = obs.matmul(&v[0])?.broadcast_add(&v[1])?.relu()?;
        let h = x.matmul(&v[2])?.broadcast_add(&v[3])?.relu()?;
        let out = h.matmul(&v[4])?.broadcast_add(&v[5])?;
        (out * &d_out)?.sum_all()?.backward()
    };
    bencher
        .counter(ItemsCount::new(pass.flops()))
        .bench_local(|| black_box(gradient().expect("sizes agree")));
}

#[divan::bench(args = [10, 32, 64])]
fn gru_ours(bencher: Bencher, episodes: usize) {
    Pass::new(Kind::Gru, &vec![STEPS; episodes]).bench(bencher);
}

#[divan::bench(args = [10])]
fn gru_candle(bencher: Bencher, episodes: usize) {
    let pass = Pass::new(Kind::Gru, &vec![STEPS; episodes]);
    let (v, obs, d_out) =
        (pass.variables(), pass.tensor(&pass.obs, INPUTS), pass.tensor(&pass.d_out, ACTIONS));
    let sigmoid = |x: Tensor| -> candle_core::Result<Tensor> { (x.neg()?.exp()? + 1.0)?.recip() };
    let gradient = || -> candle_core::Result<_> {
        let mut h = Tensor::zeros((episodes, HIDDEN), candle_core::DType::F32, &Device::Cpu)?;
        let mut states = Vec::new();
        for t in 0..STEPS {
            let x = obs.narrow(0, t * episodes, episodes)?;
            let x = x.matmul(&v[0])?.broadcast_add(&v[1])?.relu()?;
            let gx = x.matmul(&v[2])?.broadcast_add(&v[3])?;
            let gh = h.matmul(&v[4])?.broadcast_add(&v[5])?;
            let gate = |g: &Tensor, k: usize| g.narrow(1, k * HIDDEN, HIDDEN);
            let r = sigmoid((gate(&gx, 0)? + gate(&gh, 0)?)?)?;
            let z = sigmoid((gate(&gx, 1)? + gate(&gh, 1)?)?)?;
            let c = (gate(&gx, 2)? + (r * gate(&gh, 2)?)?)?.tanh()?;
            h = (((1.0 - &z)? * c)? + (z * &h)?)?;
            states.push(h.clone());
        }
        let out = Tensor::cat(&states, 0)?.matmul(&v[6])?.broadcast_add(&v[7])?;
        (out * &d_out)?.sum_all()?.backward()
    };
    bencher
        .counter(ItemsCount::new(pass.flops()))
        .bench_local(|| black_box(gradient().expect("sizes agree")));
}
