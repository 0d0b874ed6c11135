//! A network under training: parameters, gradient, optimiser. It accounts for the time of its passes, so that the
//! algorithms need no stopwatch.

use rand::Rng;

use crate::acting::Acting;
use crate::adam::Adam;
use crate::device::Device;
use crate::host::{Host, Laps, Seconds};
use crate::kernels::gru::Steps;
use crate::network::{Activations, Network};
use crate::params::initial;

/// One network of a learner. `rows` are those of `steps`, packed by time.
#[derive(Clone, Debug)]
pub(crate) struct Trained {
    pub network: Network,
    pub values: Vec<f32>,
    pub adam: Adam,
    /// What the last forward pass left; `activations.out` is `rows × outputs`.
    pub activations: Activations,
    gradient: Vec<f32>,
    acting: Acting,
    laps: Laps,
}

/// The step that an update call makes (algorithms §4.2, §6.4).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Descent {
    /// Learning rate.
    pub lr: f64,
    /// Largest L2 norm of the gradient.
    pub max_grad_norm: f64,
    /// At rate 0 Adam's moments do not change.
    pub hold_frozen_moments: bool,
}

impl Trained {
    /// Initial parameters from `rng` (algorithms §1.3).
    pub fn new(network: Network, rng: &mut impl Rng) -> Self {
        let values = initial(&network.blocks(), rng);
        Self {
            adam: Adam::new(values.len()),
            activations: Activations::default(),
            gradient: vec![0.0; values.len()],
            acting: Acting::default(),
            laps: Laps::default(),
            network,
            values,
        }
    }

    /// Computes the passes on this device from now on.
    pub fn compute_on(&mut self, device: &Device) {
        self.activations.on = device.passes();
        self.acting.compute_on(device);
    }

    /// Uses this clock from now on.
    pub fn run_on(&mut self, host: Host) {
        self.laps.run_on(host);
    }

    /// Seconds so far.
    pub fn seconds(&self) -> Seconds {
        self.laps.seconds
    }

    /// Starts an episode in each of `copies` environment copies: recurrent states are zero.
    pub fn begin_round(&mut self, copies: usize) {
        self.acting.begin(copies, self.network.hidden);
    }

    /// One tick: the outputs (`rows × outputs`), where row `k` of `obs` (`rows × inputs`) shows environment copy
    /// `copies[k]`. The caller chooses actions from them, then calls [`Trained::has_chosen`].
    pub fn act(&mut self, copies: &[u16], obs: &[f32]) -> &mut [f32] {
        self.laps.start();
        self.acting.step(&self.network, &self.values, copies, obs);
        self.laps.add(|seconds| &mut seconds.acting);
        self.acting.out()
    }

    /// Ends the account of a tick.
    pub fn has_chosen(&mut self) {
        self.laps.add(|seconds| &mut seconds.choosing);
    }

    /// Begins the account of an update call.
    pub fn begin_update(&mut self) {
        self.laps.start();
    }

    /// A forward pass over `obs` (`rows × inputs`).
    pub fn forward(&mut self, obs: &[f32], steps: &Steps) {
        self.laps.add(|seconds| &mut seconds.layout);
        self.network.forward(&self.values, obs, steps, &mut self.activations);
        self.laps.add(|seconds| &mut seconds.forward);
    }

    /// The same with other parameters, those of a target network.
    pub fn forward_with(&mut self, values: &[f32], obs: &[f32], steps: &Steps) {
        self.laps.add(|seconds| &mut seconds.layout);
        self.network.forward(values, obs, steps, &mut self.activations);
        self.laps.add(|seconds| &mut seconds.forward);
    }

    /// The result of the last forward pass, `rows × outputs`.
    pub fn out(&self) -> &[f32] {
        &self.activations.out
    }

    /// Accounts for the time since the last pass as waiting.
    pub fn has_waited(&mut self) {
        self.laps.add(|seconds| &mut seconds.waiting);
    }

    /// Adds the gradient of a loss, from its gradient `d_out` (`rows × outputs`) by the result of the last forward
    /// pass, which was over the same rows.
    pub fn backward(&mut self, obs: &[f32], steps: &Steps, d_out: &[f32]) {
        self.laps.add(|seconds| &mut seconds.loss);
        let Self { network, values, activations, gradient, .. } = self;
        network.backward(values, obs, steps, d_out, activations, gradient);
        self.laps.add(|seconds| &mut seconds.backward);
    }

    /// Clips the gradient, makes the step of Adam and clears the gradient. Returns the norm before clipping.
    pub fn descend(&mut self, by: Descent) -> f64 {
        let Self { values, adam, gradient, .. } = self;
        let norm = adam.clipped_step(values, gradient, by.max_grad_norm, by.lr, by.hold_frozen_moments);
        gradient.fill(0.0);
        self.laps.add(|seconds| &mut seconds.optimiser);
        norm
    }
}
