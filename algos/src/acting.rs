//! A network that acts in several environment copies, with a recurrent state for each.

use crate::device::Device;
use crate::network::{ActWork, Network};

/// Recurrent states of the environment copies and the buffers of a tick.
#[derive(Clone, Debug, Default)]
pub(crate) struct Acting {
    /// `copies × H`.
    states: Vec<f32>,
    /// States of the rows of this tick.
    rows: Vec<f32>,
    work: ActWork,
}

impl Acting {
    /// Computes ticks of many rows on `device` from now on.
    pub fn compute_on(&mut self, device: &Device) {
        self.work.on = device.passes();
    }

    /// Starts an episode in each of `copies` environment copies: recurrent states are zero.
    pub fn begin(&mut self, copies: usize, hidden: usize) {
        self.states.clear();
        self.states.resize(copies * hidden, 0.0);
    }

    /// One tick, in which row `k` of `obs` (`rows × inputs`) shows
    /// environment copy `copies[k]`.
    pub fn step(&mut self, network: &Network, values: &[f32], copies: &[u16], obs: &[f32]) {
        let Self { states, rows, work } = self;
        let hidden = network.hidden;
        rows.clear();
        for &copy in copies {
            rows.extend_from_slice(&states[usize::from(copy) * hidden..][..hidden]);
        }
        network.act(values, obs, copies.len(), rows, work);
        for (row, &copy) in rows.chunks_exact(hidden).zip(copies) {
            states[usize::from(copy) * hidden..][..hidden].copy_from_slice(row);
        }
    }

    /// The outputs of the last tick, `rows × outputs`.
    pub fn out(&mut self) -> &mut [f32] {
        &mut self.work.out
    }
}
