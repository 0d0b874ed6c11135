//! Who plays the agents that nobody in the team controls.

use std::sync::Arc;

/// The policy of a task's opponent. Only tasks that have one take another than [`Opponent::Builtin`].
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Opponent {
    /// The frozen network that comes with the task, where it needs one.
    #[default]
    Builtin,
    /// A uniformly random action in every step.
    Random,
    /// It never does anything.
    Still,
    /// The bytes of a safetensors file with a frozen network, of the form that [`crate::mpe::FrozenNetwork`]
    /// describes. Its scores mean: nothing, +x, -x, +y, -y; the world translates.
    Weights(Arc<[u8]>),
}
