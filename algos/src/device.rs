//! The device that a learner computes on: the CPU with this crate's kernels, or a GPU.
//!
//! Only [`crate::network::Network`] differs: forward and backward pass of a whole batch, and the forward pass of a
//! tick with many rows. Batches, losses, clipping, Adam, targets and checkpoints are the same code in the host's
//! memory, so a checkpoint of one device can be resumed on another. Devices add in different orders, so results
//! differ in their last bits.
//!
//! The feature `cuda` uses a GPU through candle. The arithmetic is in `passes.rs`; tests compile it too and run it on
//! candle's CPU device.

#[cfg(any(test, feature = "cuda"))]
mod passes;
/// Replaces the passes in a build without GPU support; no value of it exists.
#[cfg(not(any(test, feature = "cuda")))]
mod passes {
    use crate::kernels::gru::Steps;
    use crate::network::Network;

    #[derive(Clone, Debug)]
    pub enum Passes {}

    impl Passes {
        pub fn forward(&mut self, _: &Network, _: &[f32], _: &[f32], _: &Steps, _: &mut Vec<f32>) {
            match *self {}
        }
        pub fn backward(&mut self, _: &Steps, _: &[f32], _: &mut [f32]) {
            match *self {}
        }
        pub fn act(&self, _: &Network, _: &[f32], _: &[f32], _: usize, _: &mut [f32], _: &mut Vec<f32>) {
            match *self {}
        }
    }
}

use std::fmt;
use std::str::FromStr;
use std::sync::{Arc, Mutex, OnceLock};

pub(crate) use passes::Passes;

use crate::parts::PartSize;

/// From this many rows on a tick is computed on the GPU. Below, the copies to and from it are assumed to cost more
/// than they save. An estimate, not measured yet.
pub const ROWS_TO_ACT_ON_GPU: usize = 1024;

/// A device by name: `cpu`, `cuda` (the first GPU) or `cuda:N`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceName {
    /// The kernels of this crate.
    #[default]
    Cpu,
    /// The GPU with this number, from 0.
    Cuda(usize),
}

/// A device cannot be used, or stopped working.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DeviceError {
    /// Unknown name.
    #[error(
        "`{0}` is not a device: expected cpu, cuda or cuda:N with the number of a GPU, for example cuda:1"
    )]
    Unknown(String),
    /// The build lacks the feature `cuda`.
    #[error(
        "`{0}` was requested, but this build of Rondo computes on the CPU only\n\
         hint: `cargo build --release --features cuda` builds one for GPUs where the CUDA toolkit is installed; \
         or omit `--device`"
    )]
    NotBuilt(DeviceName),
    /// There is no such GPU, or no driver for it.
    #[error(
        "`{name}` was requested, but it cannot be used: {reason}\n\
         hint: does `nvidia-smi` list that GPU, and is its driver as new as the CUDA toolkit of this build? \
         `--device cpu` works everywhere"
    )]
    Unusable {
        /// The requested device.
        name: DeviceName,
        /// The driver's message.
        reason: String,
    },
    /// A computation failed on it.
    #[error("the computation on the GPU failed: {0}")]
    Failed(String),
}

impl FromStr for DeviceName {
    type Err = DeviceError;

    fn from_str(text: &str) -> Result<Self, DeviceError> {
        let number = match text {
            "cpu" => return Ok(Self::Cpu),
            "cuda" => Some(0),
            other => other.strip_prefix("cuda:").and_then(|number| number.parse().ok()),
        };
        number.map(Self::Cuda).ok_or_else(|| DeviceError::Unknown(text.to_owned()))
    }
}

impl fmt::Display for DeviceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Cuda(number) => write!(f, "cuda:{number}"),
        }
    }
}

impl DeviceName {
    /// `cpu` or `cuda`. Devices of one kind, on equal hardware, are expected to give equal bits.
    pub fn kind(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda(_) => "cuda",
        }
    }

    /// Checks that this build supports the device. [`DeviceName::open`] finds out whether it exists.
    ///
    /// # Errors
    /// [`DeviceError::NotBuilt`].
    pub fn check(self) -> Result<(), DeviceError> {
        match self {
            Self::Cuda(_) if !cfg!(feature = "cuda") => Err(DeviceError::NotBuilt(self)),
            _ => Ok(()),
        }
    }

    /// Opens the device.
    ///
    /// # Errors
    /// [`DeviceError::NotBuilt`], or [`DeviceError::Unusable`] if there is no such GPU.
    pub fn open(self) -> Result<Device, DeviceError> {
        self.check()?;
        match self {
            Self::Cpu => Ok(Device::default()),
            #[cfg(feature = "cuda")]
            Self::Cuda(number) => {
                let unusable =
                    |error| DeviceError::Unusable { name: self, reason: passes::first_line(&error) };
                Ok(Device::of_candle(candle_core::Device::new_cuda(number).map_err(unusable)?))
            }
            #[cfg(not(feature = "cuda"))]
            Self::Cuda(_) => unreachable!("refused above"),
        }
    }
}

/// An open device. The default one is the CPU with this crate's kernels.
#[derive(Clone, Debug, Default)]
pub struct Device {
    passes: Option<Passes>,
    shared: Arc<Shared>,
}

/// What all passes on one device share.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    /// The first failed computation. Results after it are zeros, so the owner of the learner checks this before it uses
    /// them.
    failure: OnceLock<String>,
    /// Held during a pass. Every pass waits for its result at its end, so one thread's work is complete before
    /// another's starts, and cuBLAS has one user at a time.
    #[cfg_attr(not(any(test, feature = "cuda")), allow(dead_code))]
    turn: Mutex<()>,
}

impl Device {
    #[cfg(any(test, feature = "cuda"))]
    pub(crate) fn of_candle(device: candle_core::Device) -> Self {
        let shared = Arc::<Shared>::default();
        Self { passes: Some(Passes::on(device, shared.clone())), shared }
    }

    /// What a network needs to compute on this device, with separate buffers; `None` on the CPU.
    pub(crate) fn passes(&self) -> Option<Passes> {
        self.passes.clone()
    }

    /// The size of a part of a batch.
    pub(crate) fn part_size(&self) -> PartSize {
        if self.passes.is_some() {
            PartSize::Gpu
        } else {
            PartSize::Cache
        }
    }

    /// The first failed computation, if any.
    ///
    /// # Errors
    /// [`DeviceError::Failed`]. The learner's state must not be used then.
    pub fn check(&self) -> Result<(), DeviceError> {
        self.shared.failure.get().map_or(Ok(()), |reason| Err(DeviceError::Failed(reason.clone())))
    }
}

#[cfg(test)]
mod tests;
